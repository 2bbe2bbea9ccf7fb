"""Interface of a neighbour search: positions in, slot-major tables `[K, N]` of source indices out.

A search finds all sources within its radius of every target. Which sources a target may see near a thin wall
is a bit mask: a target sees a source where their bits meet. Tables are allocated on the host, with the same
number of slots for every target; inside the loop they keep that shape, and a table that is too small says so.
"""

from __future__ import annotations

import abc
from typing import NamedTuple

import equinox as eqx
import numpy as np

from jaxsph.core.arrays import Array, Bool, Float, Int
from jaxsph.core.pairs import SPARE, Period

WIDTH = 2
"""Cells per search radius (-): five lines of half-radius cells hold 30 % fewer candidates than three of whole
ones."""

SPREADING = 1.3
"""Ratio of the places for points beside the water to those there are when they are counted (-): water that
spreads wets walls, and every count anew compiles the step again."""


class Grid(eqx.Module):
    """A box of cells that particles are sorted by.

    Particles outside the box are counted in the nearest cell, which loses no pair; along a periodic axis
    they must have been moved into the box (`cells.wrap`).
    """

    origin: tuple[float, ...] = eqx.field(static=True)
    """Low corner of the box, m."""
    cell: float = eqx.field(static=True)
    """Side of a cell, m; along a periodic axis cells are longer, so that a whole number of them fits."""
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
    """Table of the neighbours of every target, and the number of slots that it needed."""

    indices: Int[Array, "K N"]
    """Index of the source in each slot; the number of sources (the empty source) where the slot is empty."""
    most: Int[Array, ""]
    """Largest number of neighbours of any target: above K, the table has overflowed."""

    @property
    def overflow(self) -> Bool[Array, ""]:
        """True where neighbours were lost because a target had more than K."""
        return self.most > self.indices.shape[0]


class AbstractSearch(eqx.Module):
    """A neighbour search, with all that it has allocated on the host."""

    @classmethod
    @abc.abstractmethod
    def of(cls, grid: Grid, water: np.ndarray, nodes: np.ndarray) -> AbstractSearch:
        """Search allocated for the initial state.

        **Arguments**: `grid` covers the walls at rest and has the search's radius; `water`, `nodes`:
        positions `[N, D]` (m), targets and sources together, of a search around the water's particles and
        of one around other points.
        **Raises** ValueError for a grid that the search cannot do, ImportError naming the missing extra.
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
        """Table of all sources within the radius of each target, `capacity` of them at most; positions in m.

        **Arguments**: `sees` and `kind` are bit masks: a pair counts where `sees[i] & kind[j]` is not zero;
        `same`: the first N sources are the targets, and a particle is not its own neighbour.
        Not differentiated: the table is a piecewise constant function of the positions.
        """

    @abc.abstractmethod
    def grown(self) -> AbstractSearch:
        """The same search with a quarter more room in what it has allocated beside the tables."""


def needed_capacity(most: int, spare: float = SPARE) -> int:
    """Number of slots of a table whose fullest target has `most` neighbours now.

    `spare` times as many, rounded up to a multiple of four.
    """
    return max(4, int(np.ceil(most * spare / 4)) * 4)
