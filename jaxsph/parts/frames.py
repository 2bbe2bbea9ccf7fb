"""Frames of chambers: the walls of a chamber are at rest in the tank, or move with a body."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Components, Float, columns
from jaxsph.model.air import AbstractFrame
from jaxsph.model.rigid import SPACES, AbstractSpace

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
    pivot: Float[Array, " D"]
    """Pivot of the body at rest, m."""

    def back(self, parts, x):
        """See `AbstractFrame`."""
        arm = self.space.rotated_back(parts[self.body].pose, self._arm(parts, x))
        return columns(arm + self.pivot)

    def turned_back(self, parts, vectors):
        """See `AbstractFrame`."""
        return columns(self.space.rotated_back(parts[self.body].pose, jnp.stack(vectors, axis=-1)))

    def turned(self, parts, vectors):
        """See `AbstractFrame`."""
        return columns(self.space.rotated(parts[self.body].pose, jnp.stack(vectors, axis=-1)))

    def reaction(self, parts, x, force):
        """See `AbstractFrame`: forces, and moments about the pivot."""
        ways = self.space.directions(self._arm(parts, x))
        return {self.body: -jnp.einsum("knd,nd->k", ways, jnp.stack(force, axis=-1))}

    @property
    def space(self) -> AbstractSpace:
        """Space in which the body moves."""
        return SPACES[len(self.pivot)]

    def _arm(self, parts, x: Components) -> Float[Array, "N D"]:
        """Vectors from the present position of the pivot to points x (m), m."""
        return jnp.stack(x, axis=-1) - self.pivot - parts[self.body].pose[: len(self.pivot)]
