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
from jaxsph.solids.contact import TOUCH, spring
from jaxsph.solids.shapes import AbstractShape

__all__ = ["AbstractPath", "DrivenSolid", "Motion"]


class Motion(eqx.Module):
    """Motion of a driven solid at time t: surge, heave and pitch about its pivot."""

    pose: Float[Array, "3"]
    """Surge (m), heave (m) and pitch (rad, positive from z towards x) from its place at rest."""
    velocity: Float[Array, "3"]
    """m/s, m/s, rad/s."""


class AbstractPath(eqx.Module):
    """Motion of a solid as a function of time: write `pose`, velocities and accelerations follow."""

    @abc.abstractmethod
    def pose(self, t: Scalar) -> Float[Array, "3"]:
        """Surge (m), heave (m) and pitch (rad) at the time t (s), zero at t = 0."""


class DrivenSolid(AbstractWall):
    """A solid of any shape that follows a path, and what its motion gives to the water."""

    shape: AbstractShape
    path: AbstractPath
    pivot: Float[Array, "2"]
    """x and z of the point about which it turns, at rest, m."""
    rows: tuple[int, int] = eqx.field(static=True)
    """Its dummies among the ghosts: an entry of `Ghosts.dummies`."""
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
        """See `AbstractMovingSolid`: dummies are their own nodes."""
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
        """Distance of x (m) from its surface, m; negative inside."""
        at_rest = turn(x - self._pivot(own, x), -own.pose[2]) + spread(x, self.pivot)
        return self.shape.distance(at_rest)

    def push(self, own, x, dx, c0):
        """See `AbstractSolid`."""
        away, back = jax.vjp(lambda x: self.distance(own, x), x)
        (normal,) = back(jnp.ones_like(away))
        return spring(away, dx, c0)[:, None] * normal

    def entered(self, own, x, dx):
        """See `AbstractSolid`."""
        return self.distance(own, x) < -0.5 * dx

    def touched(self, own, x, dx):
        """See `AbstractMovingSolid`."""
        return self.distance(own, x) < TOUCH * dx

    def _pivot(self, own: Motion, x: Float[Array, "N D"]) -> Float[Array, " D"]:
        """Place of the pivot, m."""
        return spread(x, self.pivot + own.pose[:2])
