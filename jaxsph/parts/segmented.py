"""Segmented wavemaker of a basin, whose displacement varies across the basin."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.parts.paddle import AbstractPaddle
from jaxsph.waves.fields import AbstractWaveField

__all__ = ["SegmentedPaddle", "Segments"]


class Segments(eqx.Module):
    """Motion of the joints between the segments at time t."""

    X: Float[Array, " S"]
    """Displacements from rest, m, positive into the basin."""
    U: Float[Array, " S"]
    """Velocities, m/s."""


class SegmentedPaddle(AbstractPaddle):
    """Wavemaker of many hinged segments, which follows the depth-averaged flow of waves.

    A relaxation zone in front of the wavemaker imposes the velocity profile. The slope dX/dy of the face is a
    few hundredths, and is neglected in the mirror images of the water.
    """

    field: AbstractWaveField
    """Waves whose flow the wavemaker follows."""
    y: Float[Array, " S"]
    """Positions y of the joints between the segments, m, evenly spaced, from one side wall to the other."""
    rows: tuple[int, int] = eqx.field(static=True)
    face: float = eqx.field(static=True, default=0.0, kw_only=True)
    name: str = eqx.field(static=True, default="paddle", kw_only=True)

    def start(self, dtype: Any) -> Segments:
        """See `AbstractMovingSolid`: a wavemaker at rest."""
        return Segments(jnp.zeros(len(self.y), dtype), jnp.zeros(len(self.y), dtype))

    def pose(self, motion):
        """See `AbstractMovingSolid`: the pose of the middle segment."""
        X = self._middle(motion.X)
        return jnp.stack([X, 0.0 * X, 0.0 * X]), jnp.zeros(2)

    def readings(self, dim):
        """See `AbstractPart`."""
        (reading,) = super().readings(dim).values()
        return {self.name: reading._replace(long_name=f"{reading.long_name} in the middle of its width")}

    def read(self, state, sampled):
        """See `AbstractPart`."""
        return {self.name: self._middle(state.X)}

    def move(self, motion, water, depth_volume, t, dt):
        """See `AbstractWall`."""
        del motion, water, depth_volume
        return Segments(
            *jax.jvp(lambda t: self.field.mean_displacement(self.y, t), (t + dt,), (jnp.ones_like(t),))
        )

    def halfway(self, old, new, dt):
        """See `AbstractWall`."""
        del dt
        return Segments(0.5 * (old.X + new.X), old.U)

    def with_velocity(self, motion, after):
        """See `AbstractWall`."""
        return Segments(motion.X, after.U)

    def shift(self, motion, x):
        """See `AbstractPaddle`."""
        return self._across(motion.X, x)

    def speed(self, motion, x):
        """See `AbstractPaddle`."""
        return self._across(motion.U, x)

    def _across(self, values: Float[Array, " S"], x: Float[Array, "N 3"]) -> Float[Array, " N"]:
        """Values beside points x (m), linear between the joints; behind a side wall, the values at the
        mirrored points."""
        low, high = self.y[0], self.y[-1]
        inside = high - jnp.abs(high - (low + jnp.abs(x[:, 1] - low)))
        return jnp.interp(inside, self.y, values)

    def _middle(self, values: Float[Array, " S"]) -> Scalar:
        """Value in the middle of the basin's width."""
        return jnp.interp(0.5 * (self.y[0] + self.y[-1]), self.y, values)
