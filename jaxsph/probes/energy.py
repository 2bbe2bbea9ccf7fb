"""What is measured inside the loop, at the sample rate: gauges, sensors, chamber, energy."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp

from jaxsph.core.arrays import Scalar, columns, dot
from jaxsph.model.interfaces import AbstractProbe, Model
from jaxsph.model.state import State


class EnergyProbe(AbstractProbe):
    """Stored energies over the initial state, a body's too, powers exchanged and lost, the largest speed.

    Powers of paddle, PTO, sponge, contact and projection are sums over every step since the last sample;
    those of viscosity and density diffusion are taken at the sample.
    """

    sample_dt: Scalar
    compression0: Scalar
    """Compression energy of the initial state, J (J/m in 2-D)."""
    field0: Scalar | None = None
    """Potential energy of the initial state in the body force field, J; None without a field."""
    body0: Scalar | None = None
    """Potential energy of the rigid body in the initial state, J; None without one."""
    dim: int = eqx.field(static=True, default=2)

    @classmethod
    def over(cls, model: Model, state: State, sample_dt: Scalar) -> EnergyProbe:
        """The probe whose stored energies are counted from this state."""
        field0 = None if model.force is None else cls.field(model, state)
        body0 = None if model.body is None else model.body.energy(state.body, model.g)[1]
        return cls(sample_dt, model.scheme.compression(state.particles), field0, body0, len(model.g))

    @staticmethod
    def field(model: Model, state: State) -> Scalar:
        """Potential energy in the body force field, J (J/m in 2-D)."""
        return jnp.sum(state.particles.m * model.force.potential(state.particles.x))

    def measure(self, model, state, tables):
        """See `AbstractProbe`."""
        p = state.particles
        speed2 = dot(columns(p.u), columns(p.u))
        lost = model.scheme.dissipation(model, state, tables)
        potential = -jnp.sum(p.m * model.g[-1] * (p.x[:, -1] - model.z0[p.id]))
        if self.field0 is not None:
            potential = potential + self.field(model, state) - self.field0
        kinetic = 0.5 * jnp.sum(p.m * speed2)
        if self.body0 is not None:
            own, height = model.body.energy(state.body, model.g)
            kinetic, potential = kinetic + own, potential + height - self.body0
        return {
            "kinetic": kinetic,
            "potential": potential,
            "compression": model.scheme.compression(p) - self.compression0,
            "power_paddle": state.work.paddle / self.sample_dt,
            "power_sponge": state.work.sponge / self.sample_dt,
            "loss_viscous": lost.viscous,
            "loss_diffusive": lost.diffusive,
            "power_contact": state.work.contact / self.sample_dt,
            "power_projection": state.work.projection / self.sample_dt,
            "max_speed": jnp.sqrt(jnp.max(speed2)),
            "paddle": state.paddle[0],
        }

    def describe(self):
        """See `AbstractProbe`."""
        energy, power = _per_metre("J", self.dim), _per_metre("W", self.dim)
        return {
            "kinetic": (energy, "kinetic energy"),
            "potential": (energy, "potential energy over the initial state"),
            "compression": (energy, "compression energy over the initial state"),
            "power_paddle": (power, "power of the paddle on the water, mean since the last sample"),
            "power_sponge": (power, "power taken by the sponge, mean since the last sample"),
            "loss_viscous": (power, "viscous dissipation"),
            "loss_diffusive": (power, "dissipation by the density diffusion"),
            "power_contact": (power, "power lost by water that meets a solid, mean since the last sample"),
            "power_projection": (power, "power lost in the projection, mean since the last sample"),
            "max_speed": ("m s-1", "largest speed of a particle"),
            "paddle": ("m", "displacement of the paddle"),
        }


def _per_metre(units: str, dim: int) -> str:
    """Of the tank's width in two dimensions."""
    return f"{units} m-1" if dim == 2 else units
