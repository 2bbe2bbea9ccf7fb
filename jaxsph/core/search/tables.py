"""Neighbour tables of the water and of points; every device makes the tables of its slab."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import PartitionSpec

from jaxsph.core.arrays import Array, Bool, Components, Float, Int, columns, stack
from jaxsph.core.native.forms import blocked, true_indices
from jaxsph.core.search.base import WIDTH, AbstractSearch, Grid
from jaxsph.core.search.cells import behind_others, cell_index, cell_key, cell_order
from jaxsph.core.slabs import AXIS, SPLIT_TABLE, WHOLE, Neighbours, PointNeighbours, Slabs, split


class Seen(NamedTuple):
    """Sources of a search: their positions, and bit masks of their kinds."""

    x: Float[Array, "M D"]
    """Positions, m."""
    kind: Int[Array, " M"]
    """Bit masks of the sources' kinds: a target sees a source if `sees & kind` is not zero."""


NARROW = 1 << 30
"""Halo size, in particles, that is reported if a slab is too narrow for a halo of any size."""


def sort_by_cell(
    slabs: Slabs, grid: Grid, particles: Any, x: Float[Array, "N D"], last: Bool[Array, " N"]
) -> tuple[Any, Array]:
    """Particles (a pytree of arrays `[N]` or `[N, D]`) at x (m) in the order of their cells.

    On one device the particles of the mask `last` come behind all others. On several devices, particles that
    have left a slab move to the adjacent slab and others take their place, so that every slab keeps its
    number of particles. **Returns** also whether any particle moved past the halo of its slab and was lost.
    """
    if slabs.count == 1:
        order = behind_others(cell_order(x, grid), last)
        return jax.tree.map(lambda a: a[order], particles), jnp.zeros((), bool)

    def local(particles, key):
        n, halo, here = len(key), slabs.in_halo(len(key)), jax.lax.axis_index(AXIS)
        leaves, structure = jax.tree.flatten(particles)
        fields: dict[int, Any] = {k: columns(a) if a.ndim == 2 else a for k, a in enumerate(leaves)}
        fields = slabs.with_halo(fields | {len(leaves): key})
        keys = fields.pop(len(leaves))
        # order along the tank: the halo before the slab, the slab, the halo after the slab
        place = jnp.concatenate([n + jnp.arange(halo), jnp.arange(n), n + halo + jnp.arange(halo)])
        least, largest = jnp.iinfo(jnp.int32).min, jnp.iinfo(jnp.int32).max
        keys = keys.at[n : n + halo].set(jnp.where(here > 0, keys[n : n + halo], least))
        keys = keys.at[n + halo :].set(jnp.where(here < slabs.count - 1, keys[n + halo :], largest))
        # after sorting, the middle n particles form this slab; the others belong to the adjacent slabs
        order = place[jnp.argsort(keys[place], stable=True)[halo : halo + n]]
        fields = jax.tree.map(lambda a: a[order], fields)
        found = [stack(fields[k]) if a.ndim == 2 else fields[k] for k, a in enumerate(leaves)]
        keys = keys[order]
        first, last = (jax.lax.all_gather(k, AXIS) for k in (keys[0], keys[-1]))
        # no particle was lost or repeated if the sums of keys and of squared keys (modulo 2^32) are unchanged
        before, after = (jax.lax.psum(jnp.stack([jnp.sum(k), jnp.sum(k * k)]), AXIS) for k in (key, keys))
        return jax.tree.unflatten(structure, found), jnp.any(last[:-1] > first[1:]) | jnp.any(before != after)

    key = cell_key(jax.lax.stop_gradient(x), grid)
    partitions = (jax.tree.map(lambda _: PartitionSpec(AXIS), particles), split(1))
    return slabs.over_slabs(local, (particles, key), partitions, (PartitionSpec(AXIS), WHOLE))


def water_neighbours(
    slabs: Slabs,
    method: AbstractSearch,
    water: Seen,
    sees: Int[Array, " N"],
    ghosts: Seen,
    capacity: int,
) -> tuple[Neighbours, Int[Array, ""], Int[Array, ""]]:
    """Neighbours of the water's particles among the water and the ghosts; the particles are sorted by cell.

    **Returns** also the largest number of neighbours, and the number of particles that the largest halo must
    contain.
    """

    def local(x, kind, sees, ghosts):
        every, n = _with_halo(slabs, x, kind), kind.shape[0]
        x, sources = stack(x), jnp.concatenate([every.x, ghosts.x])
        kinds = jnp.concatenate([every.kind, ghosts.kind])
        found = method.table(x, sources, capacity, sees, kinds, same=True)
        if slabs.count == 1:
            return blocked(found.indices), found.most, jnp.zeros((), jnp.int32)
        halo = _halo(slabs, _grid_of(method), x, n)
        return blocked(found.indices), *(jax.lax.pmax(a, AXIS) for a in (found.most, halo))

    arguments = (columns(water.x), water.kind, sees, ghosts)
    partitions = (split(1), split(1), split(1), WHOLE)
    table, most, halo = slabs.over_slabs(local, arguments, partitions, (SPLIT_TABLE, WHOLE, WHOLE))
    return Neighbours(table, slabs), most, halo


def _grid_of(method: AbstractSearch) -> Grid:
    """Cells of the search, by which particles are sorted; only the search by cells supports several slabs."""
    return method.grid  # pyright: ignore[reportAttributeAccessIssue]


def point_neighbours(
    slabs: Slabs,
    method: AbstractSearch,
    points: Float[Array, "P D"],
    sees: Int[Array, " P"],
    water: Seen,
    capacity: int,
) -> tuple[PointNeighbours, Int[Array, ""], Int[Array, ""]]:
    """Neighbours of points (m) in the water, which is sorted by cell.

    If the slabs limit the number of points (`Slabs.points`), only points near the water are in the table.
    **Returns** also the largest number of neighbours, and the largest number of points near the water of one
    slab.
    """
    count = points.shape[0]
    if not count:
        none = jnp.zeros((), jnp.int32)
        return PointNeighbours.of(jnp.zeros((capacity, 0), jnp.int32)), none, none
    places = min(count, slabs.points or count)  # per slab
    if slabs.count == 1 and places == count:
        found = method.table(points, water.x, capacity, sees, water.kind, same=False)
        return PointNeighbours.of(found.indices), found.most, jnp.zeros((), jnp.int32)

    def local(x, kind, points, sees):
        every = _with_halo(slabs, x, kind)
        grid = _grid_of(method)
        mine = beside(every.x, points, grid) & _in_slab(slabs, grid, stack(x), points)
        rows = true_indices(mine, places)
        at = jnp.minimum(rows, count - 1)
        # an unused entry sees no source
        sees = jnp.where(rows < count, sees[at], 0)
        found = method.table(points[at], every.x, capacity, sees, every.kind, same=False)
        needs = found.most, jnp.sum(mine).astype(jnp.int32)
        return (
            blocked(found.indices),
            rows,
            *(needs if slabs.count == 1 else (jax.lax.pmax(a, AXIS) for a in needs)),
        )

    arguments = (columns(water.x), water.kind, *jax.lax.stop_gradient((points, sees)))
    partitions = (split(1), split(1), WHOLE, WHOLE)
    table, rows, most, crowd = slabs.over_slabs(
        local, arguments, partitions, (SPLIT_TABLE, split(1), WHOLE, WHOLE)
    )
    spots = jnp.arange(len(rows), dtype=jnp.int32)
    at = jnp.full(count, len(rows), jnp.int32).at[rows].set(spots, mode="drop")
    return PointNeighbours(table, rows, at, slabs), most, crowd


def _with_halo(slabs: Slabs, x: Components, kind: Int[Array, " n"]) -> Seen:
    """Particles of a slab at x (m), followed by the particles of its halos; for use within `over_slabs`.

    A slab at an end of the tank has an empty halo, filled with zeros. These entries are moved to the tank's
    other end. If the entries stayed in a cell of this slab, they would prolong the search, because the search
    takes as long for every line of cells as for the most crowded line.
    """
    every = slabs.with_halo({"x": x, "kind": kind})
    if slabs.count == 1:
        return Seen(stack(every["x"]), every["kind"])
    end = jnp.where(jax.lax.axis_index(AXIS) == 0, 1e9, -1e9).astype(x[0].dtype)
    along = jnp.where(every["kind"] == 0, end, every["x"][0])
    return Seen(stack((along, *every["x"][1:])), every["kind"])


def _halo(slabs: Slabs, grid: Grid, x: Float[Array, "n D"], n: int) -> Int[Array, ""]:
    """Number of a slab's particles, at x (m), within reach of an adjacent slab; the larger of the numbers
    on the two sides.

    `NARROW` if all particles of this slab are within reach of the adjacent slab: the reach of that slab may
    then extend past this one.
    """
    cell = cell_index(x, grid)[:, 0]
    first = jax.lax.all_gather(cell[0], AXIS)
    here = jax.lax.axis_index(AXIS)
    beyond = first[(here + 1) % slabs.count]
    beyond = jnp.where(here + 1 < slabs.count, beyond, jnp.iinfo(jnp.int32).max)
    before, after = jnp.sum(cell <= cell[0] + WIDTH), jnp.sum(cell >= beyond - WIDTH)
    before = jnp.where(here > 0, before, 0)
    most = jnp.maximum(before, after).astype(jnp.int32)
    return jnp.where(most >= n, NARROW, most)


def _in_slab(
    slabs: Slabs, grid: Grid, x: Float[Array, "n D"], points: Float[Array, "P D"]
) -> Bool[Array, " P"]:
    """Whether this slab, with particles at x (m), computes the sum at each of the points (m)."""
    cell, at = cell_index(x, grid)[:, 0], cell_index(points, grid)[:, 0]
    if slabs.count == 1:
        return jnp.ones(at.shape, bool)
    first = jax.lax.all_gather(cell[0], AXIS)
    # the last slab that begins at or before the point
    owner = jnp.maximum(jnp.sum(first[:, None] <= at[None, :], axis=0) - 1, 0)
    return owner == jax.lax.axis_index(AXIS)


def beside(x: Float[Array, "M D"], points: Float[Array, "P D"], grid: Grid) -> Bool[Array, " P"]:
    """Mask of the points (m) that may have one of the particles at x (m) within the search radius.

    Points at the walls of an empty part of a tank, for example, are not in the mask.
    """
    full = jnp.zeros(int(np.prod(grid.shape)), bool).at[cell_key(x, grid)].set(True).reshape(grid.shape)
    for axis in range(len(grid.shape)):
        around = full
        for step in range(1, WIDTH + 1):
            for way in (step, -step):
                moved = jnp.roll(full, way, axis)
                if axis not in dict(grid.period):
                    ends = slice(0, way) if way > 0 else slice(way, None)
                    moved = moved.at[(slice(None),) * axis + (ends,)].set(False)
                around |= moved
        full = around
    return full.reshape(-1)[cell_key(points, grid)]
