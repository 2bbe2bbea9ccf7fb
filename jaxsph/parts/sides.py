"""Inner faces of a chamber's front and back walls, upright or inclined, and the water between the walls."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxsph.core.arrays import Array, Components, Float, Scalar

__all__ = ["Face", "Sides"]

Face = float | Sequence[Sequence[float]] | np.ndarray
"""Inner face of a wall, as the x (m) of an upright face or the corners (x, z) (m) from the bottom up."""


class Sides(eqx.Module):
    """Inner faces of a chamber's two walls, as straight lines between positions x at common levels.

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

        leaves = (jnp.asarray(a, dtype) for a in (z, at(front), at(back)))
        return cls(*leaves, start=int(np.searchsorted(z, start)))

    def at(self, z: Array) -> tuple[Array, Array]:
        """Positions x (m) of the inner faces of the front and the back wall at levels z (m)."""
        height = jnp.maximum(jnp.diff(self.z), 1e-9)
        share = jnp.clip((z[..., None] - self.z[:-1]) / height, 0.0, 1.0)
        x0, x1 = (x[0] + jnp.sum(share * jnp.diff(x), axis=-1) for x in (self.x0, self.x1))
        return x0, x1

    def between(self, x: Components, before: Scalar | float, behind: Scalar) -> Array:
        """Mask of points x from `before` (m) ahead of the front face to `behind` (m) past the back face."""
        x0, x1 = self.at(x[-1])
        return (x[0] > x0 - before) & (x[0] < x1 + behind)

    def ends(self) -> tuple[Scalar, Scalar]:
        """Smallest x (m) of the front wall's face, and largest x (m) of the back wall's face."""
        return jnp.min(self.x0), jnp.max(self.x1)

    def level(self, volume: Scalar) -> Scalar:
        """Level (m) of a flat surface, from the `volume` of water (m2) between level `start` and the surface.

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
