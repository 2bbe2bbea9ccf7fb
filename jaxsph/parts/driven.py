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
from jaxsph.parts.pose import PosedSolid, spread
from jaxsph.solids.shapes import AbstractShape

__all__ = ["AbstractPath", "DrivenSolid", "Motion"]


class Motion(eqx.Module):
    """Motion of a driven solid at time t: surge, heave and pitch about its pivot."""

    pose: Float[Array, "3"]
    """Surge (m), heave (m) and pitch (rad, positive from z towards x) from the position at rest."""
    velocity: Float[Array, "3"]
    """Velocities of surge (m/s), heave (m/s) and pitch (rad/s)."""


class AbstractPath(eqx.Module):
    """Path of a driven solid: its pose as a function of time.

    Implement `pose`; velocities and accelerations follow by differentiation.
    """

    @abc.abstractmethod
    def pose(self, t: Scalar) -> Float[Array, "3"]:
        """Surge (m), heave (m) and pitch (rad) at the time t (s), zero at t = 0."""


class DrivenSolid(PosedSolid, AbstractWall):
    """Solid of any shape that follows a given path and does work on the water."""

    shape: AbstractShape
    """Shape in the position at rest."""
    path: AbstractPath
    """Pose as a function of time."""
    pivot: Float[Array, "2"]
    """Point (x, z) at rest about which the solid turns, m."""
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
        pose, velocity = jax.jvp(self.path.pose, (t,), (jnp.ones_like(t),))
        return Motion(pose, velocity)

    def halfway(self, old, new, dt):
        """See `AbstractWall`."""
        del dt
        return Motion(0.5 * (old.pose + new.pose), old.velocity)

    def with_velocity(self, motion, after):
        """See `AbstractWall`."""
        return Motion(motion.pose, after.velocity)

    def velocity(self, motion, x):
        """See `AbstractMovingSolid`."""
        r = self.lever(motion, x)
        turning = jnp.zeros_like(x).at[:, 0].set(r[:, -1]).at[:, -1].set(-r[:, 0])
        return spread(x, motion.velocity[:2]) + motion.velocity[2] * turning

    def acceleration(self, old, new, x, dt):
        """See `AbstractWall`."""
        before, after = (self.velocity(Motion(old.pose, m.velocity), x) for m in (old, new))
        return (after - before) / dt + self.centripetal(old, x)

    def cover(self, motion, x, dx):
        """See `AbstractWall`: the solid hides no ghosts of other solids."""
        del motion, dx
        return jnp.ones_like(x[:, 0])
