"""Frames of chambers: the walls of a chamber are at rest in the tank, or move with a body."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Components, Float, Scalar, dot
from jaxsph.model.air import AbstractFrame

__all__ = ["BodyFrame", "TankFrame"]


class TankFrame(AbstractFrame):
    """Frame of a chamber whose walls are at rest in the tank."""

    def back(self, parts, x):
        """See `AbstractFrame`."""
        del parts
        return x

    def turned_back(self, parts, vectors):
        """See `AbstractFrame`."""
        del parts
        return vectors

    def turned(self, parts, vectors):
        """See `AbstractFrame`."""
        del parts
        return vectors

    def reaction(self, parts, x, force):
        """See `AbstractFrame`: no body carries the chamber."""
        del parts, x, force
        return {}


class BodyFrame(AbstractFrame):
    """Frame of a chamber whose walls belong to a rigid body."""

    body: str = eqx.field(static=True)
    """Name of the body."""
    pivot: Float[Array, "2"]
    """Pivot (x, z) of the body at rest, m."""

    def back(self, parts, x):
        """See `AbstractFrame`."""
        arm_x, arm_z = self._arm(parts, x)
        arm_x, arm_z = _turned((arm_x, arm_z), -parts[self.body].pose[2])
        return (self.pivot[0] + arm_x, *x[1:-1], self.pivot[1] + arm_z)

    def turned_back(self, parts, vectors):
        """See `AbstractFrame`."""
        return _turned(vectors, -parts[self.body].pose[2])

    def turned(self, parts, vectors):
        """See `AbstractFrame`."""
        return _turned(vectors, parts[self.body].pose[2])

    def reaction(self, parts, x, force):
        """See `AbstractFrame`: two forces, and the moment about the pivot, positive from z towards x."""
        arm_x, arm_z = self._arm(parts, x)
        moment = dot((arm_z, -arm_x), (force[0], force[-1]))
        return {self.body: -jnp.stack([jnp.sum(a) for a in (force[0], force[-1], moment)])}

    def _arm(self, parts, x: Components) -> tuple[Array, Array]:
        """Vectors (x, z) from the present position of the pivot to points x (m), m."""
        pose = parts[self.body].pose
        return x[0] - self.pivot[0] - pose[0], x[-1] - self.pivot[1] - pose[1]


def _turned(vectors: Components, angle: Scalar) -> Components:
    """Vectors turned in the x-z plane by `angle` (rad), positive from z towards x."""
    c, s = jnp.cos(angle), jnp.sin(angle)
    first, last = vectors[0], vectors[-1]
    return (c * first + s * last, *vectors[1:-1], c * last - s * first)
