"""Solids that translate and rotate in the x-z plane, the common base of rigid bodies and driven solids."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.model.solids import AbstractMovingSolid
from jaxsph.solids.contact import TOUCH, push_off
from jaxsph.solids.shapes import AbstractShape

__all__ = ["PosedSolid", "spread", "turn"]


class PosedSolid(AbstractMovingSolid):
    """Moving solid of any shape, whose state has a `pose`: surge (m), heave (m), pitch (rad) of its pivot.

    The state also has a `velocity` (m/s, m/s, rad/s).
    """

    shape: eqx.AbstractVar[AbstractShape]
    """Shape in the position at rest."""
    pivot: eqx.AbstractVar[Float[Array, "2"]]
    """Point (x, z) at rest about which the solid turns, m."""

    def carry(self, motion: Any, x: Float[Array, "N D"]) -> Float[Array, "N D"]:
        """Present positions (m) of points of the solid, from their positions x (m) at rest."""
        return turn(x - spread(x, self.pivot), motion.pose[2]) + self._place_of_pivot(motion, x)

    def place(self, motion, x, nodes):
        """See `AbstractMovingSolid`. The node of a ghost is the ghost's own position."""
        del nodes
        there = self.carry(motion, x)
        return there, there

    def lever(self, motion: Any, x: Float[Array, "N D"]) -> Float[Array, "N D"]:
        """Positions of points x (m) relative to the present position of the pivot, m."""
        return x - self._place_of_pivot(motion, x)

    def centripetal(self, motion: Any, x: Float[Array, "N D"]) -> Float[Array, "N D"]:
        """Centripetal acceleration of the solid at points x (m), m/s2, due to constant rotation."""
        return -(motion.velocity[2] ** 2) * self.lever(motion, x) * spread(x, jnp.ones_like(self.pivot))

    def distance(self, motion: Any, x: Float[Array, "N D"]) -> Float[Array, " N"]:
        """Distance of points x (m) from the solid's surface, m; negative inside."""
        at_rest = turn(self.lever(motion, x), -motion.pose[2]) + spread(x, self.pivot)
        return self.shape.distance(at_rest)

    def push(self, motion, x, dx, c0):
        """See `AbstractSolid`."""
        return push_off(lambda x: self.distance(motion, x), x, dx, c0)

    def contains(self, motion, x, dx):
        """See `AbstractSolid`."""
        return self.distance(motion, x) < -0.5 * dx

    def outline(self, far):
        """See `AbstractSolid`."""
        del far
        return self.shape.outline()

    def pose(self, motion):
        """See `AbstractMovingSolid`."""
        return motion.pose, self.pivot

    def touches(self, motion, x, dx):
        """See `AbstractMovingSolid`."""
        return self.distance(motion, x) < TOUCH * dx

    def _place_of_pivot(self, motion: Any, x: Float[Array, "N D"]) -> Float[Array, " D"]:
        """Present position of the pivot, m."""
        return spread(x, self.pivot + motion.pose[:2])


def spread(x: Float[Array, "N D"], at: Float[Array, "2"]) -> Float[Array, " D"]:
    """Vector `at` (x, z) in the plane of motion, with as many components as the positions x."""
    return jnp.zeros(x.shape[1], x.dtype).at[jnp.array([0, -1])].set(at)


def turn(r: Float[Array, "N D"], angle: Scalar) -> Float[Array, "N D"]:
    """Vectors r turned in the x-z plane by `angle` (rad), positive from z towards x."""
    c, s = jnp.cos(angle), jnp.sin(angle)
    return r.at[:, 0].set(c * r[:, 0] + s * r[:, -1]).at[:, -1].set(c * r[:, -1] - s * r[:, 0])
