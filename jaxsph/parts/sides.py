"""Inner faces of a chamber's walls, and the water between them, in two and three dimensions."""

from __future__ import annotations

import abc
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxsph.core.arrays import Array, Components, Float, Scalar, on_device
from jaxsph.solids.shapes import outline_distance

__all__ = ["AbstractSides", "Face", "Plan", "Sides"]

Face = float | Sequence[Sequence[float]] | np.ndarray
"""Inner face of a wall, as the x (m) of an upright face or the corners (x, z) (m) from the bottom up."""


class AbstractSides(eqx.Module):
    """Inner faces of a chamber's walls."""

    @property
    @abc.abstractmethod
    def base(self) -> Scalar:
        """Level above which water between the walls is counted, m."""

    @abc.abstractmethod
    def between(self, x: Components, before: Scalar | float, behind: Scalar) -> Array:
        """Mask of points x (m) between the walls.

        The mask also includes points inside the walls: in the front wall of a two-dimensional chamber up to
        `before` (m) from the face of the wall, and in all other walls up to `behind` (m) from the face.
        """

    @abc.abstractmethod
    def ends(self) -> tuple[Scalar, Scalar]:
        """Smallest and largest x of the chamber, m."""

    @abc.abstractmethod
    def level(self, volume: Scalar) -> Scalar:
        """Level (m) of a flat surface, from the `volume` of water (m3; m2 in 2-D) above `base`."""

    @abc.abstractmethod
    def surface(self, level: Scalar) -> Scalar:
        """Area of a flat water surface at a level (m), m2; its length, m, in two dimensions."""


class Plan(AbstractSides):
    """Upright walls around a chamber in three dimensions."""

    corners: Float[Array, "K 2"]
    """Corners (x, y) of the water surface, m."""
    start: Scalar
    """Level above which water between the walls is counted, m."""

    @property
    def base(self):
        """See `AbstractSides`."""
        return self.start

    def between(self, x, before, behind):
        """See `AbstractSides`. All walls are alike: `before` is not used."""
        del before
        return outline_distance(jnp.stack([x[0], x[1]], axis=-1), self.corners) < behind

    def ends(self):
        """See `AbstractSides`."""
        return jnp.min(self.corners[:, 0]), jnp.max(self.corners[:, 0])

    def level(self, volume):
        """See `AbstractSides`."""
        return self.base + volume / self.surface(self.base)

    def surface(self, level):
        """See `AbstractSides`."""
        del level
        (x, y), (x1, y1) = self.corners.T, jnp.roll(self.corners, -1, axis=0).T
        return 0.5 * jnp.abs(jnp.sum(x * y1 - x1 * y))


class Sides(AbstractSides):
    """Inner faces of the front and back wall of a chamber in two dimensions, upright or inclined: straight
    lines between positions x at common levels.

    Below the lowest level and above the highest the faces are upright.
    """

    z: Float[Array, " K"]
    """Levels, in ascending order, m."""
    x0: Float[Array, " K"]
    """Position x of the front wall's inner face at these levels, m."""
    x1: Float[Array, " K"]
    """Position x of the back wall's inner face at these levels, m."""
    start: int = eqx.field(static=True)
    """Index of the level above which water between the walls is counted."""

    @classmethod
    def of(cls, front: Face, back: Face, low: float, start: float, high: float, dtype: Any) -> Sides:
        """Builds the sides from two faces, for levels `low` to `high` (m); counts water above `start` (m)."""
        corners = [np.atleast_2d(np.asarray(f, float)) for f in (front, back) if np.ndim(f)]
        between = [c[(c[:, 1] > low) & (c[:, 1] < high), 1] for c in corners]
        z = np.sort(np.concatenate([[low, start, high], *between]))

        def at(face: Face) -> np.ndarray:
            if not np.ndim(face):
                return np.full(len(z), face)
            x, heights = np.asarray(face, float).T
            return np.interp(z, heights, x)

        leaves = (on_device(a, dtype) for a in (z, at(front), at(back)))
        return cls(*leaves, start=int(np.searchsorted(z, start)))

    def at(self, z: Array) -> tuple[Array, Array]:
        """Positions x (m) of the inner faces of the front and the back wall at levels z (m)."""
        height = jnp.maximum(jnp.diff(self.z), 1e-9)
        share = jnp.clip((z[..., None] - self.z[:-1]) / height, 0.0, 1.0)
        x0, x1 = (x[0] + jnp.sum(share * jnp.diff(x), axis=-1) for x in (self.x0, self.x1))
        return x0, x1

    @property
    def base(self):
        """See `AbstractSides`."""
        return self.z[self.start]

    def between(self, x, before, behind):
        """See `AbstractSides`."""
        x0, x1 = self.at(x[-1])
        return (x[0] > x0 - before) & (x[0] < x1 + behind)

    def surface(self, level):
        """See `AbstractSides`."""
        x0, x1 = self.at(level)
        return x1 - x0

    def ends(self):
        """See `AbstractSides`."""
        return jnp.min(self.x0), jnp.max(self.x1)

    def level(self, volume):
        """See `AbstractSides`.

        Between two levels the walls are straight, and the volume is a quadratic function of the height.
        """
        wide = self.x1 - self.x0
        cells = 0.5 * (wide[1:] + wide[:-1]) * jnp.diff(self.z)
        under = jnp.concatenate([jnp.zeros_like(cells[:1]), jnp.cumsum(cells)])
        under = under - under[self.start]
        k = jnp.clip(jnp.sum(under <= volume) - 1, 0, len(self.z) - 2)
        more, height = volume - under[k], jnp.maximum(self.z[k + 1] - self.z[k], 1e-9)
        spread = (wide[k + 1] - wide[k]) / height
        root = jnp.sqrt(jnp.maximum(wide[k] ** 2 + 2.0 * spread * more, 1e-12))
        return self.z[k] + 2.0 * more / (wide[k] + root)
