"""Solids of any shape that move as a given function of time, such as a rocking bed or a plunger."""

from __future__ import annotations

import abc
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.model.meaning import Entry, Exchange
from jaxsph.model.solids import AbstractWall
from jaxsph.parts.pose import PosedSolid
from jaxsph.solids.shapes import AbstractShape

__all__ = ["AbstractPath", "DrivenSolid", "Motion"]


class Motion(eqx.Module):
    """Motion of a driven solid at time t."""

    pose: Float[Array, " P"]
    """Pose (`model.rigid`)."""
    velocity: Float[Array, " V"]
    """Velocity of the pivot, m/s, and angular velocity, rad/s."""


class AbstractPath(eqx.Module):
    """Path of a driven solid: its motions as functions of time.

    Implement `pose`; velocities and accelerations follow by differentiation.
    """

    @abc.abstractmethod
    def pose(self, t: Scalar) -> Float[Array, " V"]:
        """Surge (m), heave (m) and pitch (rad) at the time t (s), zero at t = 0; in 3-D all six motions."""


class DrivenSolid(PosedSolid, AbstractWall):
    """Solid of any shape that follows a given path and does work on the water."""

    shape: AbstractShape
    """Shape in the position at rest."""
    path: AbstractPath
    """Pose as a function of time."""
    pivot: Float[Array, " D"]
    """Point at rest about which the solid turns, m."""
    rows: tuple[int, int] = eqx.field(static=True)
    """Index of the solid's first ghost, and index after its last ghost; an entry of `Ghosts.dummies`."""
    name: str = eqx.field(static=True, default="driven", kw_only=True)

    def start(self, dtype: Any) -> Motion:
        """See `AbstractMovingSolid`."""
        return self._at(jnp.zeros((), dtype))

    def entries(self):
        """See `AbstractPart`."""
        return {self.name: Entry(f"work of the {self.name} on the water", Exchange.GIVEN)}

    def move(self, motion, water, depth_volume, t, dt):
        """See `AbstractWall`."""
        del motion, water, depth_volume
        return self._at(t + dt)

    def _at(self, t: Scalar) -> Motion:
        """Motion at the time t (s)."""
        pose, change = jax.jvp(lambda t: self.space.pose(self.path.pose(t)), (t,), (jnp.ones_like(t),))
        return Motion(pose, self.space.velocity(pose, change))

    def halfway(self, old, new, dt):
        """See `AbstractWall`."""
        del dt
        middle = 0.5 * (self.space.coordinates(old.pose) + self.space.coordinates(new.pose))
        return Motion(self.space.pose(middle), old.velocity)

    def with_velocity(self, motion, after):
        """See `AbstractWall`."""
        return Motion(motion.pose, after.velocity)

    def acceleration(self, old, new, x, dt):
        """See `AbstractWall`."""
        before, after = (self.velocity(Motion(old.pose, m.velocity), x) for m in (old, new))
        return (after - before) / dt + self.centripetal(old, x)

    def cover(self, motion, x, dx):
        """See `AbstractWall`: the solid hides no ghosts of other solids."""
        del motion, dx
        return jnp.ones_like(x[:, 0])
