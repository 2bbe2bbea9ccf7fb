"""Solids of any shape whose motion is a given function of time: a rocking bed, a plunger, a hinged paddle."""

from __future__ import annotations

import abc
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.model.interfaces import AbstractWall, Entry, Exchange
from jaxsph.parts.body import spread, turn
from jaxsph.solids.contact import TOUCH, push_off
from jaxsph.solids.shapes import AbstractShape

__all__ = ["AbstractPath", "DrivenSolid", "Motion"]


class Motion(eqx.Module):
    """Motion of a driven solid at time t: surge, heave and pitch about its pivot."""

    pose: Float[Array, "3"]
    """Surge (m), heave (m) and pitch (rad, positive from z towards x) from the place at rest."""
    velocity: Float[Array, "3"]
    """Velocities of surge, heave and pitch, m/s, m/s, rad/s."""


class AbstractPath(eqx.Module):
    """Path of a driven solid: its pose as a function of time.

    Write `pose`; velocities and accelerations follow by differentiation.
    """

    @abc.abstractmethod
    def pose(self, t: Scalar) -> Float[Array, "3"]:
        """Surge (m), heave (m) and pitch (rad) at the time t (s), zero at t = 0."""


class DrivenSolid(AbstractWall):
    """Solid of any shape that follows a given path and does work on the water."""

    shape: AbstractShape
    """Shape in the place at rest."""
    path: AbstractPath
    """Pose as a function of time."""
    pivot: Float[Array, "2"]
    """Point (x, z) about which the solid turns, at rest, m."""
    rows: tuple[int, int] = eqx.field(static=True)
    """Index of the solid's first ghost, and of the one after its last: an entry of `Ghosts.dummies`."""
    name: str = eqx.field(static=True, default="driven", kw_only=True)

    def start(self, dtype: Any) -> Motion:
        """See `AbstractMovingSolid`."""
        return self._at(jnp.zeros((), dtype))

    def entries(self):
        """See `AbstractMovingSolid`."""
        return {self.name: Entry(f"work of the {self.name} on the water", Exchange.GIVEN)}

    def move(self, own, water, depth_volume, t, dt):
        """See `AbstractWall`."""
        del own, water, depth_volume
        return self._at(t + dt)

    def _at(self, t: Scalar) -> Motion:
        """Motion at the time t (s)."""
        pose, velocity = jax.jvp(self.path.pose, (t,), (jnp.ones_like(t),))
        return Motion(pose, velocity)

    def halfway(self, old, new, dt):
        """See `AbstractMovingSolid`."""
        del dt
        return Motion(0.5 * (old.pose + new.pose), old.velocity)

    def with_velocity(self, own, after):
        """See `AbstractWall`."""
        return Motion(own.pose, after.velocity)

    def place(self, own, x, nodes):
        """See `AbstractMovingSolid`: a driven solid's ghosts are their own nodes."""
        del nodes
        there = turn(x - spread(x, self.pivot), own.pose[2]) + self._pivot(own, x)
        return there, there

    def velocity(self, own, x):
        """See `AbstractMovingSolid`."""
        r = x - self._pivot(own, x)
        turning = jnp.zeros_like(x).at[:, 0].set(r[:, -1]).at[:, -1].set(-r[:, 0])
        return spread(x, own.velocity[:2]) + own.velocity[2] * turning

    def acceleration(self, old, new, x, dt):
        """See `AbstractWall`."""
        before, after = (self.velocity(Motion(old.pose, m.velocity), x) for m in (old, new))
        r = (x - self._pivot(old, x)) * spread(x, jnp.ones_like(self.pivot))
        return (after - before) / dt - old.velocity[2] ** 2 * r

    def cover(self, own, x, dx):
        """See `AbstractWall`: ghosts of other solids bound the water as they are."""
        del own, dx
        return jnp.ones_like(x[:, 0])

    def distance(self, own: Motion, x: Float[Array, "N D"]) -> Float[Array, " N"]:
        """Distance of points x (m) from the solid's surface, m; negative inside."""
        at_rest = turn(x - self._pivot(own, x), -own.pose[2]) + spread(x, self.pivot)
        return self.shape.distance(at_rest)

    def push(self, own, x, dx, c0):
        """See `AbstractSolid`."""
        return push_off(lambda x: self.distance(own, x), x, dx, c0)

    def contains(self, own, x, dx):
        """See `AbstractSolid`."""
        return self.distance(own, x) < -0.5 * dx

    def touches(self, own, x, dx):
        """See `AbstractMovingSolid`."""
        return self.distance(own, x) < TOUCH * dx

    def _pivot(self, own: Motion, x: Float[Array, "N D"]) -> Float[Array, " D"]:
        """Present position of the pivot, m."""
        return spread(x, self.pivot + own.pose[:2])
