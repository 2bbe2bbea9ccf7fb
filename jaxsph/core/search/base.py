"""Interface of a neighbour search: positions in, slot-major tables `[K, N]` of source indices out.

A search finds all sources within its radius of every target. Who may see whom near a thin wall is a bit mask:
a target sees a source when their bits meet. Tables are allocated on the host, with so many slots for every
target; inside the loop they have that shape, and a table that is too small says so.
"""

from __future__ import annotations

import abc
from typing import NamedTuple

import equinox as eqx
import numpy as np

from jaxsph.core.arrays import Array, Bool, Float, Int
from jaxsph.core.pairs import SPARE, Period

WIDTH = 2
"""Cells per search radius: five lines of half-radius cells hold 30 % fewer candidates than three whole."""


class Grid(eqx.Module):
    """A box of cells. Particles outside it are counted in the nearest cell, which loses no pair; along a
    periodic axis they must have been `wrapped` into it."""

    origin: tuple[float, ...] = eqx.field(static=True)
    cell: float = eqx.field(static=True)
    """Side of a cell, m; along a periodic axis cells are longer, so that a whole number of them fits."""
    shape: tuple[int, ...] = eqx.field(static=True)
    period: Period = eqx.field(static=True, default=())

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
    """Neighbours of every target, and what is needed to trust them."""

    indices: Int[Array, "K N"]
    """Source of each slot; the number of sources itself (the empty source) where the slot is empty."""
    most: Int[Array, ""]
    """Largest number of neighbours found: above K, the table has overflowed."""

    @property
    def overflow(self) -> Bool[Array, ""]:
        """Whether neighbours were lost."""
        return self.most > self.indices.shape[0]


class AbstractSearch(eqx.Module):
    """A way to find neighbours, with all that it has allocated on the host."""

    @classmethod
    @abc.abstractmethod
    def of(cls, grid: Grid, water: np.ndarray, nodes: np.ndarray) -> AbstractSearch:
        """The search for the initial state.

        **Arguments**: `grid` covers what stands at rest and has the search's radius; `water`, `nodes`:
        positions `[N, D]` (m), targets and sources together, of a search for the water and for other places.
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
        """All sources within the radius of each target, `capacity` at most.

        **Arguments**: `sees` and `kind` are bit masks: a pair counts where `sees[i] & kind[j]` is not zero;
        `same`: the first N sources are the targets, and a particle is not its own neighbour.
        Not differentiated: the table is a piecewise constant function of the positions.
        """

    @abc.abstractmethod
    def grown(self) -> AbstractSearch:
        """The same search with a quarter more of what it has allocated beside the tables."""


def needed_capacity(most: int, spare: float = SPARE) -> int:
    """Slots for tables whose fullest target has `most` neighbours now: some spare, a multiple of four."""
    return max(4, int(np.ceil(most * spare / 4)) * 4)
