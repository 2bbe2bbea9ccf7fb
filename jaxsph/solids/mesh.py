"""Shape whose surface is a triangle mesh, with its distance interpolated on a grid."""

from __future__ import annotations

from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.scipy.ndimage import map_coordinates

from jaxsph.core.arrays import Array, Float
from jaxsph.solids.shapes import AbstractShape, plain_numbers

MARGIN = 4
"""Number of grid intervals between a mesh and the boundary of its grid, on every side."""


class Mesh(AbstractShape):
    """Shape inside a closed surface of triangles, given by the distances of grid points from the surface.

    Between the points the distance is interpolated linearly, so that a wall thinner than two grid intervals
    is not resolved and sharp edges are rounded by about an interval. Outside the grid, the distance is the
    value at the nearest point of the grid plus the distance from that point. This sum is an upper bound.
    """

    away: Float[Array, "X Y Z"] = eqx.field(converter=plain_numbers)
    """Distances of the grid's points from the surface, m; negative inside."""
    low: Float[Array, "3"] = eqx.field(converter=plain_numbers)
    """First point (x, y, z) of the grid, m."""
    side: Float[Array, ""] = eqx.field(converter=plain_numbers)
    """Distance between neighbouring points of the grid, m."""
    extent: tuple[tuple[float, ...], tuple[float, ...]] = eqx.field(static=True)
    """Lowest and highest coordinates (x, y, z) of the surface, m."""
    inside: tuple[float, tuple[float, ...], tuple[tuple[float, ...], ...]] = eqx.field(static=True)
    """Volume, centre and inertia tensor, as `moments` returns them."""

    @classmethod
    def on_grid(
        cls,
        distance: Callable[[np.ndarray], np.ndarray],
        extent: tuple[np.ndarray, np.ndarray],
        inside: tuple[float, tuple[float, ...], tuple[tuple[float, ...], ...]],
        side: float,
    ) -> Mesh:
        """Mesh whose distances are computed on a grid of spacing `side` (m).

        **Arguments**: `distance`: distances (m) of points `[N, 3]` (m) from the surface; `extent`, `inside`:
        see the fields of the same names.
        """
        low, high = (np.asarray(end, float) for end in extent)
        counts = np.ceil((high - low) / side).astype(int) + 1 + 2 * MARGIN
        first = 0.5 * (low + high) - 0.5 * side * (counts - 1)
        axes = [a + side * np.arange(count) for a, count in zip(first, counts, strict=True)]
        away = distance(np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3))
        plain = tuple(map(float, low)), tuple(map(float, high))
        return cls(away.reshape(counts), tuple(map(float, first)), float(side), plain, inside)

    def distance(self, x):
        """See `AbstractShape`."""
        away, low, side = (jnp.asarray(a, x.dtype) for a in (self.away, self.low, self.side))
        high = low + side * (np.array(away.shape) - 1)
        nearest = jnp.clip(x, low, high)
        beyond = jnp.sqrt(jnp.sum((x - nearest) ** 2, axis=1) + 1e-20)
        return map_coordinates(away, list(((nearest - low) / side).T), order=1, mode="nearest") + beyond

    def bounds(self):
        """See `AbstractShape`."""
        low, high = self.extent
        return np.array(low), np.array(high)

    def moments(self):
        """See `AbstractShape`."""
        volume, centre, inertia = self.inside
        return volume, centre, np.array(inertia)
