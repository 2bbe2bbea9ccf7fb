"""Probes of devices: a chamber and its turbine, a rigid body and its power take-off, a paddle."""

from __future__ import annotations

import equinox as eqx

from jaxsph.core.arrays import Scalar, columns
from jaxsph.model.interfaces import AbstractProbe, Reading
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

    def measure(self, model, state, tables):
        """See `AbstractProbe`."""
        x, V = columns(state.particles.x), model.scheme.volume(state.particles)
        chamber = model.chambers[self.which]
        air, taken = state.own[chamber.name], state.ledger[chamber.energy].recent
        readings = {
            "chamber_level": chamber.level(x, V, model.dx),
            "chamber_volume": chamber.volume(x, V, model.dx),
            "P_a": air.P_a,
            "flow": air.q,
            "flow_mean": air.driven.recent / self.sample_dt,
            "power_pto": taken / self.sample_dt,
            **chamber.read(air),
        }
        return {name + self.suffix: value for name, value in readings.items()}

    def describe(self):
        """See `AbstractProbe`."""
        found = {
            "chamber_level": Reading("m", "mean elevation of the chamber's surface over the still level"),
            "chamber_volume": Reading("m2", "water in the chamber above the level where flow is measured"),
            "P_a": Reading("Pa", "gauge pressure of the chamber's air, positive when compressed"),
            "flow": Reading("m2 s-1", "flow of air out of the chamber per unit width"),
            "flow_mean": Reading("m2 s-1", "flow out of the chamber, mean since the last sample"),
            "power_pto": Reading("W m-1", "power taken by the PTO, mean since the last sample"),
            **dict(self.further),
        }
        return {name + self.suffix: reading for name, reading in found.items()}


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

    def measure(self, model, state, tables):
        """See `AbstractProbe`."""
        body = model.bodies[self.which]
        own = state.own[body.name]
        taken = sum((state.ledger[name].recent for name in body.harvest()), 0.0 * self.sample_dt)
        readings = {
            "surge": own.pose[0],
            "heave": own.pose[1],
            "pitch": own.pose[2],
            "body_velocity": own.velocity,
            "body_force": own.force + own.contact,
            "body_force_mean": own.impulse.recent / self.sample_dt,
            "power_pto": taken / self.sample_dt,
        }
        return {name + self.suffix: value for name, value in readings.items()}

    def describe(self):
        """See `AbstractProbe`."""
        power = per_metre("W", self.dim)
        force = "the water's force on the body, and its moment about the pivot"
        found = {
            "surge": Reading("m", "displacement of the body along the tank"),
            "heave": Reading("m", "displacement of the body upwards"),
            "pitch": Reading("rad", "angle of the body, positive landward"),
            "body_velocity": Reading(
                "m s-1, m s-1, rad s-1", "velocities of surge, heave and pitch", "motion"
            ),
            "body_force": Reading("N, N, N m", force, "motion"),
            "body_force_mean": Reading("N, N, N m", f"{force}, mean since the last sample", "motion"),
            "power_pto": Reading(power, "power taken by the PTO, mean since the last sample"),
        }
        return {name + self.suffix: reading for name, reading in found.items()}


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
