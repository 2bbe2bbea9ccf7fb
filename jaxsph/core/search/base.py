"""Interface of a neighbour search, which makes slot-major tables `[K, N]` of source indices from positions.

A search finds all sources within its radius around every target. Near a thin wall, bit masks select the
sources that a target sees: a target sees a source if the masks of target and source share a bit. Tables are
allocated on the host, with the same number of slots for every target. The tables keep that shape inside the
time loop, which reports an overflow if a table is too small.
"""

from __future__ import annotations

import abc
from typing import NamedTuple

import equinox as eqx
import numpy as np

from jaxsph.core.arrays import Array, Bool, Float, Int
from jaxsph.core.pairs import SPARE, Period

WIDTH = 2
"""Number of cells per search radius (-). In two dimensions, five lines of cells of half the radius contain
30 % fewer candidates than three lines of cells of the full radius."""

SPREADING = 1.3
"""Ratio (-) of `Slabs.points` to the largest number of points near the water of one slab at the start.

As the water spreads, more points are near the water, and every change of `Slabs.points` recompiles the step.
"""
SPREADS_ON = 2.0
"""Ratio (-) used instead of `SPREADING` once the number of points near a slab's water has exceeded
`Slabs.points`."""


class Grid(eqx.Module):
    """A box of cells by which particles are sorted.

    A particle outside the box is assigned to the nearest cell, so that no pair is lost. Along a periodic axis
    particles must first be moved into the box (`cells.wrap`).
    """

    origin: tuple[float, ...] = eqx.field(static=True)
    """Low corner of the box, m."""
    cell: float = eqx.field(static=True)
    """Side of a cell, m; along a periodic axis cells may be longer, so that a whole number of cells fits the
    period."""
    shape: tuple[int, ...] = eqx.field(static=True)
    """Number of cells along every axis."""
    period: Period = eqx.field(static=True, default=())
    """Periodic axes and their lengths, m."""

    @property
    def radius(self) -> float:
        """Search radius (support plus skin), m."""
        return WIDTH * self.cell

    @property
    def sides(self) -> tuple[float, ...]:
        """Sides of a cell along every axis, m."""
        lengths = dict(self.period)
        return tuple(lengths[k] / n if k in lengths else self.cell for k, n in enumerate(self.shape))


class Table(NamedTuple):
    """Table of the neighbours of every target, and the number of slots that it needs."""

    indices: Int[Array, "K N"]
    """Index of the source in each slot; in an empty slot the number of sources (the empty source's index)."""
    most: Int[Array, ""]
    """Largest number of neighbours of any target; if this number exceeds K, the table has overflowed."""

    @property
    def overflow(self) -> Bool[Array, ""]:
        """True if neighbours were lost because a target had more than K neighbours."""
        return self.most > self.indices.shape[0]


class AbstractSearch(eqx.Module):
    """A neighbour search, with the array sizes that were allocated for the search on the host."""

    @classmethod
    @abc.abstractmethod
    def of(cls, grid: Grid, water: np.ndarray, nodes: np.ndarray) -> AbstractSearch:
        """Search allocated for the initial state.

        **Arguments**: `grid`: cells that cover the walls at rest, and set the search radius; `water`:
        positions `[N, D]` (m) of targets and sources together, for the search around the water's particles;
        `nodes`: positions of targets and sources for the search around other points.
        **Raises** ValueError if the search does not support the grid, ImportError if its package is missing.
        """

    @abc.abstractmethod
    def table(
        self,
        targets: Float[Array, "N D"],
        sources: Float[Array, "M D"],
        capacity: int,
        sees: Int[Array, " N"],
        kind: Int[Array, " M"],
        same: bool,
    ) -> Table:
        """Table of the sources within the search radius around each target, at most `capacity` per target;
        positions in m.

        **Arguments**: `sees` and `kind` are bit masks, and a pair is listed if `sees[i] & kind[j]` is not
        zero; `same`: whether the first N sources are the targets; a particle is then not its own neighbour.
        The table is not differentiated, because the table is a piecewise constant function of the positions.
        """

    @abc.abstractmethod
    def grown(self) -> AbstractSearch:
        """The same search with a quarter more space in all allocations except the tables."""


def needed_capacity(most: int, spare: float = SPARE) -> int:
    """Size to allocate for a table that now needs the size `most`.

    The size is `spare` times `most`, rounded up to a multiple of four.
    """
    return max(4, int(np.ceil(most * spare / 4)) * 4)


def rounded_up(count: int, limit: int) -> int:
    """The `count`, rounded up to a multiple of the largest power of 2 that is at most `limit`, or of 1."""
    step = 1 << max(limit, 1).bit_length() - 1
    return -(-count // step) * step
