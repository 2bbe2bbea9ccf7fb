"""Probes of devices: a chamber and its turbine, a rigid body and its power take-off, a paddle."""

from __future__ import annotations

import equinox as eqx

from jaxsph.core.arrays import Scalar, columns
from jaxsph.model.meaning import Reading
from jaxsph.model.probe import AbstractProbe
from jaxsph.model.state import State
from jaxsph.probes.energy import per_metre

__all__ = ["BodyProbe", "ChamberProbe", "PaddleProbe", "RimProbe"]


class ChamberProbe(AbstractProbe):
    """Probe of a chamber: water level and volume, air flow and pressure, and the power of its turbine."""

    sample_dt: Scalar
    """Time between samples, s."""
    which: int = eqx.field(static=True, default=0)
    """Index of the chamber in `Model.chambers`."""
    suffix: str = eqx.field(static=True, default="")
    """End of the readings' names, where there are several chambers."""
    further: tuple[tuple[str, Reading], ...] = eqx.field(static=True, default=())
    """Readings of the chamber's air besides pressure and flow: names and meanings."""
    harvest: tuple[str, ...] = eqx.field(static=True, default=("pto",))
    """Names in the ledger of the energies that its power take-off takes."""
    dim: int = eqx.field(static=True, default=2)
    """Number of dimensions."""

    def measure(self, model, state, tables):
        """See `AbstractProbe`."""
        x, V = columns(state.particles.x), model.scheme.volume(state.particles)
        chamber = model.chambers[self.which]
        air = state.own[chamber.name]
        readings = {
            "chamber_level": chamber.level(x, V, model.dx),
            "chamber_volume": chamber.volume(x, V, model.dx),
            "P_a": air.P_a,
            "flow": air.q,
            "flow_mean": air.driven.recent / self.sample_dt,
            **chamber.read(air),
        }
        readings = {name + self.suffix: value for name, value in readings.items()}
        return readings | _powers(self.harvest, state, self.sample_dt)

    def describe(self):
        """See `AbstractProbe`."""
        area, flow = ("m2", "m2 s-1") if self.dim == 2 else ("m3", "m3 s-1")
        width = " per unit width" if self.dim == 2 else ""
        found = {
            "chamber_level": Reading("m", "mean elevation of the chamber's surface over the still level"),
            "chamber_volume": Reading(area, "water in the chamber above the level where flow is measured"),
            "P_a": Reading("Pa", "gauge pressure of the chamber's air, positive when compressed"),
            "flow": Reading(flow, f"flow of air out of the chamber{width}"),
            "flow_mean": Reading(flow, "flow out of the chamber, mean since the last sample"),
            **dict(self.further),
        }
        readings = {name + self.suffix: reading for name, reading in found.items()}
        return readings | _of_powers(self.harvest, self.dim)


class BodyProbe(AbstractProbe):
    """Probe of a rigid body: its motion, the water's force on it, and the power of its power take-off."""

    sample_dt: Scalar
    """Time between samples, s."""
    which: int = eqx.field(static=True, default=0)
    """Index of the body in `Model.bodies`."""
    suffix: str = eqx.field(static=True, default="")
    """End of the readings' names, where there are several bodies."""
    dim: int = eqx.field(static=True, default=2)
    """Number of dimensions."""
    harvest: tuple[str, ...] = eqx.field(static=True, default=())
    """Names in the ledger of the energies that its power take-off takes."""

    def measure(self, model, state, tables):
        """See `AbstractProbe`."""
        body = model.bodies[self.which]
        own = state.own[body.name]
        readings = {
            "surge": own.pose[0],
            "heave": own.pose[1],
            "pitch": own.pose[2],
            "body_velocity": own.velocity,
            "body_force": own.force + own.contact,
            "body_force_mean": own.impulse.recent / self.sample_dt,
        }
        readings = {name + self.suffix: value for name, value in readings.items()}
        return readings | _powers(self.harvest, state, self.sample_dt)

    def describe(self):
        """See `AbstractProbe`."""
        units = "N m-1, N m-1, N" if self.dim == 2 else "N, N, N m"
        force = "the water's force on the body, and its moment about the pivot"
        found = {
            "surge": Reading("m", "displacement of the body along the tank"),
            "heave": Reading("m", "displacement of the body upwards"),
            "pitch": Reading("rad", "angle of the body, positive landward"),
            "body_velocity": Reading(
                "m s-1, m s-1, rad s-1", "velocities of surge, heave and pitch", "motion"
            ),
            "body_force": Reading(units, force, "motion"),
            "body_force_mean": Reading(units, f"{force}, mean since the last sample", "motion"),
        }
        readings = {name + self.suffix: reading for name, reading in found.items()}
        return readings | _of_powers(self.harvest, self.dim)


class PaddleProbe(AbstractProbe):
    """Probe of a piston wavemaker: its displacement, m."""

    name: str = eqx.field(static=True, default="paddle")
    """Name of the paddle in the model."""

    def measure(self, model, state, tables):
        """See `AbstractProbe`."""
        del model, tables
        return {self.name: state.own[self.name].X}

    def describe(self):
        """See `AbstractProbe`."""
        return {self.name: Reading("m", f"displacement of the {self.name}")}


class RimProbe(AbstractProbe):
    """Water that has left a tank over its rim."""

    name: str = eqx.field(static=True, default="rim")
    """Name of the rim."""
    dim: int = eqx.field(static=True, default=2)

    def measure(self, model, state, tables):
        """See `AbstractProbe`."""
        del tables
        return {"spilt": state.own[self.name].mass.total / model.scheme.rho0}

    def describe(self):
        """See `AbstractProbe`."""
        units = "m2" if self.dim == 2 else "m3"
        return {"spilt": Reading(units, "volume of water that has left over the rim since the start")}


def _powers(harvest: tuple[str, ...], state: State, sample_dt: Scalar) -> dict[str, Scalar]:
    """Powers of power take-offs, W (W/m in 2-D), means since the last sample, by their series' names."""
    return {f"power_{name}": state.ledger[name].recent / sample_dt for name in harvest}


def _of_powers(harvest: tuple[str, ...], dim: int) -> dict[str, Reading]:
    """Meaning of the readings of `_powers`."""
    what = "power taken by the PTO, mean since the last sample"
    return {f"power_{name}": Reading(per_metre("W", dim), what) for name in harvest}
