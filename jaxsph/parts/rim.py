"""Open rim of a tank, over which splashing water leaves; the mass of this water is recorded."""

from __future__ import annotations

from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp

from jaxsph.core.arrays import Scalar
from jaxsph.model.interfaces import AbstractOutlet, Model
from jaxsph.model.meaning import Entry, Reading
from jaxsph.model.state import State, Tally

__all__ = ["Rim", "Spill"]


class Spill(eqx.Module):
    """Water that has left a tank over its rim."""

    mass: Tally
    """Mass of this water, kg (kg/m in 2-D)."""


class Rim(AbstractOutlet):
    """Top of a tank's walls, over which water leaves permanently.

    A particle that is more than half a spacing above the rim at a neighbour search loses its mass, and thus
    all effect on the flow. This particle then rests in a corner of the tank at the height of the rim, so that
    the number of particles and the shapes of arrays stay the same.
    """

    corner: tuple[float, ...] = eqx.field(static=True)
    """Position, m, in a corner of the tank at the height of the rim, where particles without mass rest."""
    name: str = eqx.field(static=True, default="rim", kw_only=True)
    usual_name: ClassVar[str] = "rim"

    def start(self, dtype: Any) -> Spill:
        """See `AbstractOutlet`: no water has left yet."""
        return Spill(Tally.zero(dtype))

    def entries(self):
        """See `AbstractPart`."""
        return {self.name: Entry(f"energy of the water that leaves over the {self.name}")}

    def readings(self, dim):
        """See `AbstractPart`."""
        units = "m2" if dim == 2 else "m3"
        what = "volume of water that has left over the rim since the start"
        return {self.called("spilt"): Reading(units, what)}

    def read(self, state, sampled):
        """See `AbstractPart`."""
        return {self.called("spilt"): state.mass.total / sampled.rho0}

    def drain(self, model: Model, state: State) -> State:
        """See `AbstractOutlet`."""
        p, before = state.particles, state.parts[self.name]
        over = (p.x[:, -1] > self.corner[-1] + 0.5 * model.dx) | (p.m == 0.0)
        rest = jnp.asarray(self.corner, p.x.dtype)
        left = eqx.tree_at(
            lambda a: (a.x, a.u, a.m, a.p),
            p,
            (
                jnp.where(over[:, None], rest, p.x),
                jnp.where(over[:, None], 0.0, p.u),
                jnp.where(over, 0.0, p.m),
                jnp.where(over, 0.0, p.p),
            ),
        )
        lost = energy(model, state) - energy(model, eqx.tree_at(lambda s: s.particles, state, left))
        spill = Spill(before.mass.add(jnp.sum(p.m - left.m)))
        ledger = {**state.ledger, self.name: state.ledger[self.name].add(lost)}
        changed = (left, {**state.parts, self.name: spill}, ledger)
        return eqx.tree_at(lambda s: (s.particles, s.parts, s.ledger), state, changed)


def energy(model: Model, state: State) -> Scalar:
    """Kinetic, compression and potential energy of the water, J (J/m in 2-D).

    The potential energy is zero at the initial heights of the particles.
    """
    p = state.particles
    lifted = -model.g[-1] * (p.x[:, -1] - model.z0[p.id])
    return jnp.sum(p.m * (0.5 * jnp.sum(p.u**2, axis=1) + lifted)) + model.scheme.compression(p)
