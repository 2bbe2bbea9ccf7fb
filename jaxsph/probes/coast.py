"""Probes of waves at a fixed solid: overtopping of its crest and run-up on its face."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp

from jaxsph.core.arrays import Scalar, columns
from jaxsph.model.meaning import Reading
from jaxsph.model.probe import AbstractProbe

__all__ = ["OvertoppingProbe", "RunUpProbe"]

HALF_WIDTH = 2.0
"""Half-width along x, in spacings, of the zone in which the flow over a crest is measured."""


class OvertoppingProbe(AbstractProbe):
    """Probe of the water that overtops the crest of a solid, per metre of crest.

    `overtopped` (m2) is the increase of the volume of water behind the crest since the start: the water that
    has passed over the crest, minus the water that has come back or left the tank. `overtopping` (m2/s) is
    the flow over the crest at the time of the sample.
    """

    crest: Scalar
    """Position x of the crest's landward end, m."""
    top: Scalar
    """Level of the crest, m."""
    still: Scalar
    """Volume of water behind the crest at the start, m2."""
    solid: str = eqx.field(static=True)
    """Name of the solid."""

    def measure(self, model, state, tables):
        """See `AbstractProbe.measure`."""
        del tables
        x, V = columns(state.particles.x), model.scheme.volume(state.particles) / model.walls.width
        # the edge is one spacing wide, so that the passage of one particle causes no jump
        share = jnp.clip((x[0] - self.crest) / model.dx + 0.5, 0.0, 1.0)
        near = jnp.clip(HALF_WIDTH - jnp.abs(x[0] - self.crest) / model.dx + 0.5, 0.0, 1.0)
        above = jnp.where(x[-1] > self.top - 0.5 * model.dx, near, 0.0)
        flow = jnp.sum(V * above * state.particles.u[:, 0]) / (2.0 * HALF_WIDTH * model.dx)
        return {
            f"overtopped_{self.solid}": jnp.sum(V * share) - self.still,
            f"overtopping_{self.solid}": flow,
        }

    def describe(self):
        """See `AbstractProbe.describe`."""
        behind = (
            f"increase of the volume of water behind the crest of the {self.solid} since the start, per "
            "metre of crest"
        )
        return {
            f"overtopped_{self.solid}": Reading("m2", behind),
            f"overtopping_{self.solid}": Reading("m2 s-1", f"flow over the crest of the {self.solid}"),
        }


class RunUpProbe(AbstractProbe):
    """Probe of the highest level of water on the seaward face of a solid, above still water (m).

    A particle within one spacing of the face wets the face.
    """

    crest: Scalar
    """Position x of the crest's landward end, where the face ends, m."""
    still: Scalar
    """Still water level, m."""
    solid: str = eqx.field(static=True)
    """Name of the solid, one of the model's bodies."""

    def measure(self, model, state, tables):
        """See `AbstractProbe.measure`."""
        del tables
        (body,) = (body for body in model.bodies if body.name == self.solid)
        x = state.particles.x
        wets = body.distance(state.parts[self.solid], x) < model.dx
        wets &= (x[:, 0] < self.crest) & (state.particles.m > 0.0)
        highest = jnp.max(jnp.where(wets, x[:, -1], -jnp.inf))
        # half of a particle is above its centre; for a dry face the level is z = 0
        level = jnp.where(jnp.isfinite(highest), highest + 0.5 * model.dx, 0.0)
        return {f"run_up_{self.solid}": level - self.still}

    def describe(self):
        """See `AbstractProbe.describe`."""
        words = f"highest level of water on the face of the {self.solid}, above still water"
        return {f"run_up_{self.solid}": Reading("m", words)}
