"""Neighbour search by cells of half the search radius, into slot-major tables `[K, N]` of source indices.

Sources are sorted by cell. In every line of cells the candidates of a target are one contiguous range of the
sorted sources; a loop over this range keeps the candidates within the radius. Along a periodic axis a whole
number of cells fits the period, lines continue at the other end, and distances are measured to the nearest
image.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from jaxsph.core.arrays import Array, Bool, Float, Int
from jaxsph.core.native.forms import Candidates, native_neighbours, native_order
from jaxsph.core.pairs import Period, nearest_image
from jaxsph.core.search.base import WIDTH, AbstractSearch, Grid, Table

LARGEST_INDEX = np.iinfo(np.int32).max
"""Largest int32: the largest index into a flat array."""


class Cells(AbstractSearch):
    """Neighbour search in cells of half the search radius: the default."""

    grid: Grid
    """Cells by which the sources are sorted."""

    @classmethod
    def of(cls, grid, water, nodes):
        """See `AbstractSearch.of`; this search allocates nothing but the tables."""
        del water, nodes
        return cls(grid)

    def table(self, targets, sources, capacity, sees, kind, same):
        """See `AbstractSearch.table`."""
        return search(targets, sources, self.grid, capacity, sees, kind, same)

    def grown(self):
        """See `AbstractSearch.grown`; this search allocates nothing but the tables."""
        return self


def grid_over(low: np.ndarray, high: np.ndarray, radius: float, period: Period = ()) -> Grid:
    """Grid of cells over the box from `low` to `high` (m), for searches within `radius` (m).

    Along a periodic axis the grid covers one period from `low`. **Raises** ValueError if a period is so short
    that a particle would find the same cell, and thus the same sources, in both directions.
    """
    cell = float(radius) / WIDTH
    span = np.asarray(high, float) - np.asarray(low, float)
    shape = [int(n) for n in np.maximum(np.ceil(span / cell), 1)]
    for axis, length in period:
        shape[axis] = int(length / cell)
        if shape[axis] < 2 * WIDTH + 1:
            raise ValueError(
                f"period = {length:g} m along axis {axis} is too short for a search radius of {radius:g} m: "
                f"at least {(2 * WIDTH + 1) * cell:g} m are needed; use a longer period or a smaller spacing"
            )
    return Grid(tuple(float(a) for a in low), cell, tuple(shape), period)


def wrap(
    x: Float[Array, "N D"], carry: Float[Array, "N D"], low: tuple[float, ...], period: Period
) -> tuple[Float[Array, "N D"], Float[Array, "N D"]]:
    """Positions (m) shifted by a period into [low, low + period), and their rounding errors (m).

    The shift is exact, because its rounding error is added to `carry` (Knuth's two-sum).
    """
    if not period:
        return x, carry
    lengths = dict(period)
    length = jnp.asarray([lengths.get(axis, 0.0) for axis in range(x.shape[1])], x.dtype)
    start = jnp.asarray(low, x.dtype)
    shift = jnp.where(x < start, length, jnp.where(x >= start + length, -length, 0.0))
    new = x + shift
    kept = new - x
    return new, carry + ((x - (new - kept)) + (shift - kept))


def cell_index(x: Float[Array, "N D"], grid: Grid) -> Int[Array, "N D"]:
    """Cell of every position (m), one index per axis."""
    side = jnp.asarray(grid.sides, x.dtype) if grid.period else grid.cell
    scaled = (x - jnp.asarray(grid.origin, x.dtype)) / side
    # clip first: an integer conversion of a huge float is undefined
    upper = jnp.asarray(grid.shape, x.dtype) - 1
    return jnp.floor(jnp.clip(scaled, 0.0, upper)).astype(jnp.int32)


def cell_key(x: Float[Array, "N D"], grid: Grid) -> Int[Array, " N"]:
    """Flat index of the cell that contains each position (m), in row-major order (last axis fastest)."""
    cell = cell_index(x, grid)
    key = cell[:, 0]
    for axis in range(1, len(grid.shape)):
        key = key * grid.shape[axis] + cell[:, axis]
    return key


def cell_order(x: Float[Array, "N D"], grid: Grid) -> Int[Array, " N"]:
    """Permutation that sorts particles at x (m) by cell; stable, so that sorted particles keep their
    order."""
    return _sort(cell_key(jax.lax.stop_gradient(x), grid), int(np.prod(grid.shape)))[0]


def behind_others(order: Int[Array, " N"], last: Bool[Array, " N"]) -> Int[Array, " N"]:
    """A permutation, with the particles of the mask `last` moved behind all others; stable."""
    return order[_sort(last[order].astype(jnp.int32), 2)[0]]


def search(
    targets: Float[Array, "N D"],
    sources: Float[Array, "M D"],
    grid: Grid,
    capacity: int,
    sees: Int[Array, " N"],
    kind: Int[Array, " M"],
    same: bool,
) -> Table:
    """Table of the sources within the search radius around each target, at most `capacity` per target.

    **Arguments**: positions in m; `sees` and `kind` are bit masks, and a pair is listed if
    `sees[i] & kind[j]` is not zero; `same`: whether the first N sources are the targets; a particle is then
    not its own neighbour. The table is not differentiated, because the table is a piecewise constant function
    of positions.
    """
    targets, sources = jax.lax.stop_gradient((targets, sources))
    find = functools.partial(_search, grid=grid, capacity=capacity, same=same)

    @jax.custom_batching.custom_vmap
    def one(*arrays):
        return jax.tree.map(lambda a: a[0], find(*(a[None] for a in arrays)))

    @one.def_vmap
    def _(lanes, batched, *arrays):
        # one search over all lanes: the batched form of a loop whose length differs from lane to lane would
        # select between old and new slots in every iteration
        every = (
            a if b else jnp.broadcast_to(a, (lanes, *a.shape)) for a, b in zip(arrays, batched, strict=True)
        )
        tables = find(*every)
        return tables, jax.tree.map(lambda _: True, tables)

    return one(targets, sources, sees, kind)


def _search(
    targets: Float[Array, "B N D"],
    sources: Float[Array, "B M D"],
    sees: Int[Array, "B N"],
    kind: Int[Array, "B M"],
    *,
    grid: Grid,
    capacity: int,
    same: bool,
) -> Table:
    """Tables `[B, K, N]` of B lanes; the cells are numbered consecutively from lane to lane."""
    lanes, n_lane, m_lane = *targets.shape[:2], sources.shape[1]
    n = lanes * n_lane
    targets, sources = (a.reshape(-1, a.shape[-1]) for a in (targets, sources))
    sees, kind = sees.reshape(-1), kind.reshape(-1)
    lane = jnp.arange(lanes, dtype=jnp.int32)
    of_target, of_source = (jnp.repeat(lane, k) if lanes > 1 else lane for k in (n_lane, m_lane))
    per_lane = int(np.prod(grid.shape))
    order, start = _sort(cell_key(sources, grid) + of_source * per_lane, lanes * per_lane)
    xs = tuple(sources[order, k] for k in range(targets.shape[1]))
    kinds = kind[order]
    x_i = tuple(targets[:, k] for k in range(targets.shape[1]))
    me = jnp.arange(n, dtype=jnp.int32) + of_target * (m_lane - n_lane)
    radius2 = jnp.asarray(grid.radius, targets.dtype) ** 2

    own = me if same else jnp.full_like(me, -1)
    lane_begin = jnp.broadcast_to(of_target * per_lane, (n,)).astype(jnp.int32)
    home = cell_index(targets, grid)
    among = Candidates(x_i, sees, own, lane_begin, home, xs, kinds, order, start, radius2)
    natives = native_neighbours(among, grid.shape, WIDTH, grid.period, capacity)
    rows, count = natives or _neighbours(among, grid, capacity)
    if lanes > 1:
        rows = jnp.minimum(rows - (of_target * m_lane)[None, :], m_lane)
    indices = rows.reshape(capacity, lanes, n_lane).swapaxes(0, 1)
    return Table(indices, jnp.max(count.reshape(lanes, n_lane), axis=1, initial=0))


def _neighbours(among: Candidates, grid: Grid, capacity: int) -> tuple[Array, Array]:
    """JAX's form of `native_neighbours`."""
    home, last = among.home, grid.shape[-1]

    def span(offset, low, high):
        """First candidate, and the end of the candidates, in one line of cells."""
        row, inside = _line(home, offset, grid)
        inside &= low <= high
        begin = among.lane + jnp.where(inside, row, 0) * last
        first = among.start[begin + low]
        return first, jnp.where(inside, among.start[begin + high + 1], first)

    def candidate(first, end, c, found):
        rows, count = found
        k = jnp.minimum(first + c, len(among.indices) - 1)
        there = (a[k] for a in among.sources)
        r = nearest_image(tuple(a - b for a, b in zip(among.x, there, strict=True)), grid.period)
        r2, j = sum(a**2 for a in r), among.indices[k]
        seen = (among.sees & among.kinds[k]) != 0
        near = (first + c < end) & (r2 < among.radius2) & seen & (j != among.own)
        # Every candidate, near or not, is written to the next free slot. A candidate that is not near is
        # overwritten by the next candidate, or cleared later. A spare last slot receives the excess.
        slot = jnp.minimum(count, capacity)
        return put(rows, slot, j), count + near.astype(jnp.int32)

    n = len(among.sees)
    rows, put = _slots(capacity + 1, n)
    found = (rows, jnp.zeros(n, jnp.int32))
    spans = (
        span(offset, low, high)
        for offset in itertools.product(range(-WIDTH, WIDTH + 1), repeat=len(grid.shape) - 1)
        for low, high in _spans(home, grid)
    )
    for first, end in spans:
        add = functools.partial(candidate, first, end)
        found = jax.lax.fori_loop(0, jnp.max(end - first, initial=0), add, found)
    rows, count = found
    filled = jnp.arange(capacity, dtype=jnp.int32)[:, None] < count[None, :]
    return jnp.where(filled, rows.reshape(capacity + 1, n)[:capacity], len(among.indices)), count


def _sort(key: Int[Array, " M"], cells: int) -> tuple[Int[Array, " M"], Int[Array, " C"]]:
    """Order of the sources by cell number, and the position in that order at which every cell begins.

    The order is stable.
    """
    if native := native_order(key, cells):
        return native
    order = jnp.argsort(key, stable=True).astype(jnp.int32)
    return order, jnp.cumsum(jnp.zeros(cells + 1, jnp.int32).at[key + 1].add(1), dtype=jnp.int32)


def _line(
    home: Int[Array, "N D"], offset: tuple[int, ...], grid: Grid
) -> tuple[Int[Array, " N"], Bool[Array, " N"]]:
    """Index of the line of cells (along the last axis) that is `offset` cells away from the line of each
    cell `home`, and whether this line is in the grid."""
    row, inside = jnp.zeros(home.shape[0], jnp.int32), jnp.ones(home.shape[0], bool)
    for axis, step in enumerate(offset):
        index = home[:, axis] + step
        if axis in dict(grid.period):
            index = index % grid.shape[axis]
        inside &= (index >= 0) & (index < grid.shape[axis])
        row = row * grid.shape[axis] + index
    return row, inside


def _spans(home: Int[Array, "N D"], grid: Grid) -> list[tuple[Int[Array, " N"], Int[Array, " N"]]]:
    """First and last cell along the last axis within a search radius of every cell `home`. If that axis is
    periodic, a second span contains the cells within the radius at the other end of the grid."""
    last = grid.shape[-1]
    bottom, top = home[:, -1] - WIDTH, home[:, -1] + WIDTH
    spans = [(jnp.maximum(bottom, 0), jnp.minimum(top, last - 1))]
    if len(grid.shape) - 1 in dict(grid.period):
        over = jnp.where(bottom < 0, bottom + last, 0)
        spans.append((over, jnp.where(bottom < 0, last - 1, jnp.where(top >= last, top - last, -1))))
    return spans


def _slots(capacity: int, n: int) -> tuple[Int[Array, "..."], Callable]:
    """Empty slots for n targets, and the function that writes one slot of every target.

    One index into a flat array shortens the search by a fifth, compared with two indices. The index fits into
    int32 up to 8.6 million targets with 250 slots.
    """
    target = jnp.arange(n, dtype=jnp.int32)
    how = {"mode": "promise_in_bounds", "unique_indices": True}
    if capacity * n <= LARGEST_INDEX:
        return jnp.zeros(capacity * n, jnp.int32), lambda rows, k, j: rows.at[k * n + target].set(j, **how)
    return jnp.zeros((capacity, n), jnp.int32), lambda rows, k, j: rows.at[k, target].set(j, **how)
