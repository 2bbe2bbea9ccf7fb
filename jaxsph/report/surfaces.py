"""Free surface of a run in three dimensions for its page: heights on a grid of points, from the particles."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from jaxsph.report.pack import UNSEEN

MOST = 1_500_000
"""Largest product of the numbers of grid points and frames in a page; about 3 MB of data."""
MOST_CELLS = 10_000
"""Largest number of cells of a grid, so that a picture is drawn quickly."""
FINE = 2.0
"""Smallest side of a grid cell, in spacings; such a cell always contains a particle of the highest layer."""
LAYER = 0.75
"""Half the thickness of the layer of particles that make up the surface, in spacings."""
DROP = 1.5
"""Least height above the surrounding surface, in spacings, at which a particle counts as a drop."""
MIDDLE = np.zeros((1, 2))
CORNERS = 0.5 * np.array([[0.0, 0.0], [1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]])
"""Points of a cell relative to its centre, in sides of the cell."""
LEVELS = 128
"""Number of levels per spacing to which heights are rounded; the steps are smaller than particle noise."""


@dataclass(frozen=True)
class HeightGrid:
    """Grid of cells in the x-y plane of a tank, for the heights of the free surface."""

    low: np.ndarray
    """Corner (x, y) of the grid with the smallest coordinates, m."""
    sides: np.ndarray
    """Sides of a cell along x and y, m."""
    counts: tuple[int, int]
    """Numbers of cells along x and y."""
    dx: float
    """Spacing of the particles, m."""

    @classmethod
    def over(cls, low: np.ndarray, high: np.ndarray, dx: float, most: int) -> HeightGrid:
        """Grid of at most about `most` cells between the corners (x, y) `low` and `high` (m)."""
        extent = np.asarray(high, float) - low
        side = max(FINE * dx, float(np.sqrt(np.prod(extent) / most)))
        counts = np.maximum(np.floor(extent / side + 1e-6).astype(int), 2)
        return cls(np.asarray(low, float), extent / counts, (int(counts[0]), int(counts[1])), dx)

    def axes(self) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates x and y (m) of the grid's points: the tank's sides, and the centres of the cells."""
        found = []
        for a, side, count in zip(self.low, self.sides, self.counts, strict=True):
            found.append(a + side * np.array([0.0, *(np.arange(count) + 0.5), count]))
        return found[0], found[1]

    def heights(self, x: np.ndarray, inside: Callable[[np.ndarray], np.ndarray] | None = None) -> np.ndarray:
        """Height `[X, Y]` (m) of the free surface at every point of `axes`; NaN where there is no surface.

        The surface is half a spacing above the mean of the highest layer of particles at x `[N, 3]` (m). A
        single particle in the air is not part of the layer. `inside`: whether points `[N, 3]` (m) are inside
        a solid. Below a solid there is no free surface. At the side of a solid the surface continues by one
        cell into the solid, so that there is no gap in a picture.
        """
        cells = np.floor((x[:, :2] - self.low) / self.sides).astype(int)
        there = ((cells >= 0) & (cells < self.counts)).all(axis=1) & np.isfinite(x[:, 2])
        index, z = cells[there, 0] * self.counts[1] + cells[there, 1], x[there, 2]
        count = self.counts[0] * self.counts[1]
        top = np.full(count, -np.inf)
        np.maximum.at(top, index, z)
        top = np.where(np.isfinite(top), top, np.nan).reshape(self.counts)
        middle = np.where(np.isfinite(top), _around(top, np.nanmedian, 3), np.nan)
        # a particle far above its surroundings is a drop; a particle below them is not in the highest layer
        regular = (top < middle + DROP * self.dx) & (top > middle - 0.5 * self.dx)
        middle = np.where(regular, top, middle).ravel()
        near = np.abs(z - middle[index]) < LAYER * self.dx
        layer = np.bincount(index[near], minlength=count)
        mean = np.bincount(index[near], z[near], count) / np.maximum(layer, 1)
        found = (np.where(layer > 0, mean, middle) + 0.5 * self.dx).reshape(self.counts)
        return _to_sides(found if inside is None else self._with_solids(found, inside))

    def _with_solids(self, found: np.ndarray, inside: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """Heights (m) of the cells: none inside solids, except for the first cell beside the surface."""
        # a solid over the water begins directly above the water, or after a gap of one spacing
        below = self._within(found + self.dx, inside, MIDDLE) | self._within(
            found + 2.0 * self.dx, inside, MIDDLE
        )
        free = np.where(below, np.nan, found)
        # a cell that is partly inside a solid may have no particle in its free part
        sunk = free < _around(free, np.nanmedian, 1) - 2.0 * self.dx
        free = np.where(sunk & self._within(found + self.dx, inside, CORNERS), np.nan, free)
        beside = _around(free, np.nanmean, 1)
        return np.where(np.isnan(free) & self._within(beside, inside, CORNERS), beside, free)

    def _within(
        self, heights: np.ndarray, inside: Callable[[np.ndarray], np.ndarray], at: np.ndarray
    ) -> np.ndarray:
        """Whether each cell, at its height (m), is inside a solid at one of the points `at`, which are given
        like `CORNERS`."""
        middle = np.stack(np.meshgrid(*(a[1:-1] for a in self.axes()), indexing="ij"), -1)
        found = np.zeros(self.counts, bool)
        for shift in at:
            points = np.concatenate([middle + shift * self.sides, np.nan_to_num(heights)[..., None]], -1)
            found |= inside(points.reshape(-1, 3)).reshape(self.counts)
        return found & np.isfinite(heights)


def _to_sides(heights: np.ndarray) -> np.ndarray:
    """Heights (m) of the cells `[X, Y]`, continued by half a cell to the tank's sides, `[X + 2, Y + 2]`."""
    level, beyond = np.pad(heights, 1, mode="edge"), np.pad(heights, 1, mode="reflect", reflect_type="odd")
    return np.where(np.isfinite(beyond), 0.5 * (level + beyond), level)


def _around(values: np.ndarray, law: Callable[..., np.ndarray], least: int) -> np.ndarray:
    """`law` of the values in 3 by 3 cells around each cell `[X, Y]`; NaN for fewer than `least` values."""
    padded = np.pad(values, 1, constant_values=np.nan)
    windows = np.lib.stride_tricks.sliding_window_view(padded, (3, 3)).reshape(*values.shape, 9)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a window without values
        found = law(windows, axis=-1)
    return np.where(np.isfinite(windows).sum(axis=-1) >= least, found, np.nan)


def in_levels(heights: np.ndarray, dx: float) -> tuple[np.ndarray, float, float]:
    """Heights (m) as levels (uint16), with the height of level 0 and the step (m); NaN becomes `UNSEEN`."""
    seen = heights[np.isfinite(heights)]
    low, high = (float(seen.min()), float(seen.max())) if seen.size else (0.0, 1.0)
    step = max(dx / LEVELS, (high - low) / (UNSEEN - 1))
    levels = np.rint((np.nan_to_num(heights, nan=low) - low) / step).astype(np.uint16)
    return np.where(np.isfinite(heights), levels, UNSEEN).astype(np.uint16), low, step
