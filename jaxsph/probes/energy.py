"""Probe of a run's energy budget: energy stored in water and bodies, power exchanged, and power lost."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp

from jaxsph.core.arrays import Scalar, columns, dot
from jaxsph.model.interfaces import Model
from jaxsph.model.meaning import Entry, Exchange, Reading
from jaxsph.model.probe import AbstractProbe
from jaxsph.model.state import State

__all__ = ["EnergyProbe", "per_metre"]


class EnergyProbe(AbstractProbe):
    """Probe of energies, powers, largest speed and active limiters.

    Potential and compression energy are relative to the initial state, but kinetic energy is not.
    Powers from the ledger are means over all steps since the last sample. Powers that the scheme does not add
    to the ledger (`AbstractScheme.losses`) are those at the time of the sample. `PartProbe` gives the power
    of a power take-off.
    """

    sample_dt: Scalar
    """Time between samples, s."""
    compression0: Scalar
    """Compression energy of the initial state, J (J/m in 2-D)."""
    potential0: Scalar
    """Potential energy of water (due to the body forces), bodies and links at the start, J (J/m in 2-D)."""
    entries: tuple[tuple[str, Entry], ...] = eqx.field(static=True)
    """Names and meanings of the energies in the model's ledger."""
    losses: tuple[tuple[str, str], ...] = eqx.field(static=True)
    """Names and meanings of the lost powers that are not in the ledger."""
    limiters: tuple[tuple[str, str], ...] = eqx.field(static=True)
    """Names of the limiters of the model's scheme, and the effect of each limiter on a particle."""
    dim: int = eqx.field(static=True, default=2)
    """Number of dimensions."""

    @classmethod
    def over(cls, model: Model, state: State, sample_dt: Scalar) -> EnergyProbe:
        """Builds the probe with energies relative to `state`, for samples `sample_dt` (s) apart."""
        entries, scheme = tuple(model.entries().items()), model.scheme
        losses, limiters = tuple(scheme.losses().items()), tuple(scheme.limiters().items())
        compression0 = model.scheme.compression(state.particles)
        potential0 = jnp.asarray(_held(model, state)[1], model.dt.dtype)
        return cls(sample_dt, compression0, potential0, entries, losses, limiters, len(model.g))

    @staticmethod
    def held(model: Model, state: State) -> tuple[Scalar | float, Scalar | float]:
        """Kinetic energy of the bodies, and potential energy of water, bodies and links, J (J/m in 2-D).

        The potential energy of the water is that due to the model's `forces`, which do not include gravity.
        """
        kinetic = potential = 0.0
        for force in model.forces:
            potential = potential + jnp.sum(state.particles.m * force.potential(state.particles.x))
        for body in model.bodies:
            own, height = body.energy(state.parts[body.name], model.g)
            kinetic, potential = kinetic + own, potential + height
        return kinetic, potential + model.mechanism.stored(state.parts, model.time(state))

    def measure(self, model, state, tables):
        """See `AbstractProbe.measure`."""
        p = state.particles
        speed2 = dot(columns(p.u), columns(p.u))
        lost = model.scheme.dissipation(model, state, tables)
        of_bodies, held = self.held(model, state)
        lifted = -jnp.sum(p.m * model.g[-1] * (p.x[:, -1] - model.z0[p.id]))
        given = jnp.zeros_like(self.sample_dt)
        powers = {}
        for name, entry in self.entries:
            amount = state.ledger[name].recent
            if entry.exchange is Exchange.GIVEN:
                given = given + amount
            elif entry.exchange is Exchange.TAKEN:
                powers[f"power_{name}"] = amount / self.sample_dt
        steps = p.x.shape[0] * self.sample_dt / model.dt
        return {
            "kinetic": 0.5 * jnp.sum(p.m * speed2) + of_bodies,
            "potential": lifted + (held - self.potential0),
            "compression": model.scheme.compression(p) - self.compression0,
            "power_paddle": given / self.sample_dt,
            **powers,
            **{f"loss_{name}": lost[name] for name, _ in self.losses},
            "max_speed": jnp.sqrt(jnp.max(speed2)),
            **{f"limited_{name}": state.limits[name].recent / steps for name, _ in self.limiters},
        }

    def describe(self):
        """See `AbstractProbe.describe`."""
        energy, power = per_metre("J", self.dim), per_metre("W", self.dim)
        mean = "mean since the last sample"
        given = "power given to the water by paddles, driven bodies, relaxation zones and body forces"
        return {
            "kinetic": Reading(energy, "kinetic energy", group="energy"),
            "potential": Reading(energy, "potential energy relative to the initial state", group="energy"),
            "compression": Reading(
                energy, "compression energy relative to the initial state", group="energy"
            ),
            "power_paddle": Reading(power, f"{given}, {mean}", group="energy"),
            **{
                f"power_{name}": Reading(power, f"power: {entry.long_name}, {mean}", group="energy")
                for name, entry in self.entries
                if entry.exchange is Exchange.TAKEN
            },
            **{f"loss_{name}": Reading(power, what, group="energy") for name, what in self.losses},
            "max_speed": Reading("m s-1", "largest speed of a particle"),
            **{
                f"limited_{name}": Reading("1", f"share of particles, {mean}: {what}")
                for name, what in self.limiters
            },
        }


def per_metre(units: str, dim: int) -> str:
    """Units of a quantity of the whole tank, which in two dimensions is per metre of width."""
    return f"{units} m-1" if dim == 2 else units


_held = eqx.filter_jit(EnergyProbe.held)
"""Computes `EnergyProbe.held`; traced once for all problems of the same form, as a single program."""
