"""Solids that translate and rotate, the common base of rigid bodies and driven solids."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Float
from jaxsph.model.rigid import SPACES, AbstractSpace
from jaxsph.model.solids import AbstractMovingSolid
from jaxsph.solids.contact import TOUCH, push_off
from jaxsph.solids.shapes import AbstractShape

__all__ = ["PosedSolid"]


class PosedSolid(AbstractMovingSolid):
    """Moving solid of any shape, whose state has the `pose` of its pivot (`model.rigid`) and a `velocity`."""

    shape: eqx.AbstractVar[AbstractShape]
    """Shape in the position at rest."""
    pivot: eqx.AbstractVar[Float[Array, " D"]]
    """Point at rest about which the solid turns, m."""

    @property
    def space(self) -> AbstractSpace:
        """Space in which the solid moves."""
        return SPACES[len(self.pivot)]

    def carry(self, motion: Any, x: Float[Array, "N D"]) -> Float[Array, "N D"]:
        """Present positions (m) of points of the solid, from their positions x (m) at rest."""
        return self.space.rotated(motion.pose, x - self.pivot) + self._place_of_pivot(motion)

    def place(self, motion, x, nodes):
        """See `AbstractMovingSolid`. The node of a ghost is the ghost's own position."""
        del nodes
        there = self.carry(motion, x)
        return there, there

    def lever(self, motion: Any, x: Float[Array, "N D"]) -> Float[Array, "N D"]:
        """Positions of points x (m) relative to the present position of the pivot, m."""
        return x - self._place_of_pivot(motion)

    def directions(self, motion: Any, x: Float[Array, "N D"]) -> Float[Array, "V N D"]:
        """Velocity of the solid at points x (m) per unit of each component of its velocity (-, m)."""
        return self.space.directions(self.lever(motion, x))

    def velocity(self, motion, x):
        """See `AbstractMovingSolid`."""
        return jnp.einsum("knd,k->nd", self.directions(motion, x), motion.velocity)

    def centripetal(self, motion: Any, x: Float[Array, "N D"]) -> Float[Array, "N D"]:
        """Centripetal acceleration of the solid at points x (m), m/s2, for constant angular velocity."""
        return self.space.centripetal(motion.velocity, self.lever(motion, x))

    def distance(self, motion: Any, x: Float[Array, "N D"]) -> Float[Array, " N"]:
        """Distance of points x (m) from the solid's surface, m; negative inside."""
        at_rest = self.space.rotated_back(motion.pose, self.lever(motion, x)) + self.pivot
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
        return self.space.coordinates(motion.pose), self.pivot

    def touches(self, motion, x, dx):
        """See `AbstractMovingSolid`."""
        return self.distance(motion, x) < TOUCH * dx

    def _place_of_pivot(self, motion: Any) -> Float[Array, " D"]:
        """Present position of the pivot, m."""
        return self.pivot + motion.pose[: len(self.pivot)]
