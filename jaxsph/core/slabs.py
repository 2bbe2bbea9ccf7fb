"""Slabs of particles along the tank, one per device, and pair sums across the edges of the slabs.

Every search sorts the particles along the first axis and cuts them into blocks of equal count, the slabs. The
slabs are therefore always balanced, and a particle that leaves its slab belongs to another slab after the
next search. Arrays of the water cover the whole tank and are split over the devices along the particles'
axis. Operations on every particle, and sums over all particles, are written as for one device. Only pair
sums, and operations on selected particles (`Slabs.take`, `Slabs.add`), depend on the slabs. Every device
computes a pair sum for the targets of its slab, and includes the particles at the near ends of the adjacent
slabs (the halo). Every device stores all ghosts, because they are few.

On one device there is one slab, and no halo.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from jaxsph.core.arrays import Array, Bool, Float, Int
from jaxsph.core.blocks import BlockedTable
from jaxsph.core.native.forms import blocked
from jaxsph.core.pairs import (
    Fields,
    Law,
    Smoothing,
    pair_sum,
    pair_weights,
    weighted_sum,
    with_empty,
)
from jaxsph.core.transforms import gather_linearly

AXIS = "slabs"
"""Name of the mesh axis of the devices."""


WHOLE = PartitionSpec()
"""Partition of an array that every device stores in full."""


def split(ndim: int) -> PartitionSpec:
    """Partition of an array over the devices along the last of its dimensions."""
    return PartitionSpec(*(None,) * (ndim - 1), AXIS)


class Sources(NamedTuple):
    """Sources of a pair sum: the fields of the water, followed by the fields of the ghosts."""

    water: Fields
    """Fields of the water's particles by name, `[N]`."""
    ghosts: Fields
    """Fields of the ghosts by name, `[G]`, the same fields as those of the water; empty for a sum over the
    water only."""
    halo: Fields = {}  # noqa: RUF012 (a field of a named tuple, which nothing writes to)
    """Fields of the water in the slabs' halos, if they have already been fetched (`Slabs.fetch`)."""

    def adding(self, name: str, water: Any, ghosts: Any) -> Sources:
        """Sources with one more field of the water and the ghosts."""
        return Sources(self.water | {name: water}, self.ghosts | {name: ghosts}, self.halo)

    def changing(self, name: str, water: Any) -> Sources:
        """Sources with the water's field `name` replaced."""
        halo = {k: a for k, a in self.halo.items() if k != name}
        return Sources(self.water | {name: water}, self.ghosts, halo)

    def behind(self, ghosts: Fields, **names: str) -> Sources:
        """Sources whose ghosts have the fields `ghosts`. For each field k the water supplies its field
        `names[k]`, or its field k if `names` has no k."""
        of = {k: names.get(k, k) for k in ghosts}
        halo = {k: self.halo[name] for k, name in of.items() if name in self.halo}
        return Sources({k: self.water[name] for k, name in of.items()}, ghosts, halo)


SPLIT_SOURCES = Sources(split(1), WHOLE, split(1))
"""Partitions of sources: water and halos are split over the devices, and every device stores all ghosts."""
SPLIT_TABLE = BlockedTable(split(2), split(1))  # pyright: ignore[reportArgumentType]
"""Partitions of a table, whose targets are split over the devices."""


class Slabs(eqx.Module):
    """Devices, each with one slab of particles, and the number of particles in a halo."""

    devices: tuple[Any, ...] = eqx.field(static=True, default=(None,))
    """Devices, from the first slab along the tank to the last."""
    halo: int = eqx.field(static=True, default=0)
    """Number of particles that a slab sends to each adjacent slab."""
    points: int = eqx.field(static=True, default=0)
    """Largest number of ghosts or other points near the water of one slab; 0 for no limit."""

    @property
    def count(self) -> int:
        """Number of slabs."""
        return len(self.devices)

    @property
    def mesh(self) -> Mesh:
        """Mesh of the devices over which JAX distributes arrays."""
        return Mesh(np.array(self.devices), (AXIS,), axis_types=(jax.sharding.AxisType.Auto,))

    def in_halo(self, n: int) -> int:
        """Number of particles in a halo of a slab with n particles: `halo`, limited to n, or zero on one
        device."""
        return 0 if self.count == 1 else min(self.halo, n)

    def over_slabs(self, function: Callable, arguments: tuple, partitions: Any, results: Any) -> Any:
        """Results of a function that every device runs on its slab of the arguments.

        **Arguments**: `partitions`, `results`: partitions of the arguments and of the results; a single
        partition applies to all arrays of a pytree.
        """
        if self.count == 1:
            return function(*arguments)
        mapped = jax.shard_map(
            function, mesh=self.mesh, in_specs=partitions, out_specs=results, check_vma=False
        )
        return mapped(*arguments)

    def gather(self, a: Array) -> Array:
        """Array of the water, copied in full to every device for operations that cannot be split over
        devices."""
        if self.count == 1:
            return a
        return jax.lax.with_sharding_constraint(a, NamedSharding(self.mesh, WHOLE))

    def largest(
        self, values: Sequence[Float[Array, " N"]], vectors: Sequence[Float[Array, "N D"]]
    ) -> tuple[Float[Array, " M"], Float[Array, "M D"]]:
        """Maxima of M fields of the water, and the value of the corresponding vector field at each
        maximum."""

        def local(values, vectors):
            at = [jnp.argmax(a) for a in values]
            found = [jnp.append(v[k], a[k]) for k, a, v in zip(at, values, vectors, strict=True)]
            rows = jnp.stack(found)
            if self.count > 1:
                # one message for all fields: an argmax over devices would send three messages per field
                every = jax.lax.all_gather(rows, AXIS)
                rows = jax.vmap(lambda of: of[jnp.argmax(of[:, -1])], in_axes=1)(every)
            return rows[:, -1], rows[:, :-1]

        along = PartitionSpec(AXIS)
        return self.over_slabs(local, (values, vectors), (along, along), WHOLE)

    def take(self, fields: Fields, rows: Int[Array, " C"]) -> Fields:
        """Fields `[C]` of the particles with the indices `rows`, on every device."""

        def local(fields, rows):
            leaves, structure = jax.tree.flatten(fields)
            at, here = _local(rows, len(leaves[0]))
            every = jax.lax.psum(jnp.where(here, jnp.stack([a[at] for a in leaves]), 0.0), AXIS)
            return jax.tree.unflatten(structure, list(every))

        if self.count == 1:
            return jax.tree.map(lambda a: a[rows], fields)
        return self.over_slabs(local, (fields, rows), (split(1), WHOLE), WHOLE)

    def add(
        self, a: Float[Array, "N D"], rows: Int[Array, " C"], change: Float[Array, "C D"]
    ) -> Float[Array, "N D"]:
        """Vectors `a` of the water with `change` added at the indices `rows`; an index beyond the last
        particle is ignored."""

        def local(a, rows, change):
            at, here = _local(rows, len(a))
            return a.at[at].add(jnp.where(here[:, None], change, 0.0))

        if self.count == 1:
            return a.at[rows].add(change, mode="drop")
        along = PartitionSpec(AXIS)
        return self.over_slabs(local, (a, rows, change), (along, WHOLE, WHOLE), along)

    def fetch(self, sources: Sources) -> Sources:
        """Sources with their halos, fetched once for several sums; without this call each sum fetches the
        halos."""
        missing = {k: a for k, a in sources.water.items() if k not in sources.halo}
        if self.count == 1 or not missing:
            return sources
        halo = self.over_slabs(self.halos, (missing,), (split(1),), split(1))
        return sources._replace(halo={**sources.halo, **halo})

    def halos(self, fields: Fields) -> Fields:
        """Fields of the particles in a slab's halos, those from the preceding slab first; for use within
        `over_slabs`."""
        leaves, structure = jax.tree.flatten(fields)
        found: list[Any] = [None] * len(leaves)
        # one message to each side for all fields of one type
        for dtype in {leaf.dtype for leaf in leaves}:
            of = [k for k, leaf in enumerate(leaves) if leaf.dtype == dtype]
            rows = jnp.stack([leaves[k] for k in of])
            halo = self.in_halo(rows.shape[1])
            both = self._from_beside(rows[:, -halo:], rows[:, :halo])
            for k, row in zip(of, jnp.concatenate(both, axis=1), strict=True):
                found[k] = row
        return jax.tree.unflatten(structure, found)

    def with_halo(self, fields: Fields, halo: Fields | None = None) -> Fields:
        """Fields of a slab's particles, `[n]`, followed by the fields of the slab's halos; for use within
        `over_slabs`.

        `halo`: halos that have already been fetched, by the field's name.
        """
        if self.count == 1:
            return fields
        there = halo or {}
        there = there | self.halos({k: a for k, a in fields.items() if k not in there})
        return {k: jax.tree.map(lambda a, b: jnp.concatenate([a, b]), a, there[k]) for k, a in fields.items()}

    def _from_beside(self, last: Array, first: Array) -> tuple[Array, Array]:
        """Last particles of the preceding slab, and first particles of the following slab; zeros for a
        missing slab."""
        if self.count == 2:
            # each slab has one adjacent slab: a single message instead of one to each side
            here = jax.lax.axis_index(AXIS)
            other = jax.lax.ppermute(jnp.where(here == 0, last, first), AXIS, [(0, 1), (1, 0)])
            none = jnp.zeros_like(other)
            return jnp.where(here == 0, none, other), jnp.where(here == 0, other, none)
        before = jax.lax.ppermute(last, AXIS, self._pairs(1))
        return before, jax.lax.ppermute(first, AXIS, self._pairs(-1))

    def _pairs(self, step: int) -> list[tuple[int, int]]:
        """Pairs (sender, receiver) of devices; the receiver is `step` slabs farther along the tank."""
        return [(k, k + step) for k in range(self.count) if 0 <= k + step < self.count]

    def sources(self, sources: Sources) -> Fields:
        """Fields of all sources for a slab's targets, with the empty source at the end; for use within
        `over_slabs`."""
        every = self.with_halo(sources.water, sources.halo)
        if sources.ghosts:
            every = jax.tree.map(lambda a, b: jnp.concatenate([a, b]), every, sources.ghosts)
        return with_empty(every)


ONE = Slabs()
"""A single slab on one device."""


class Neighbours(eqx.Module):
    """Neighbours of every particle among the water and the ghosts, and sums over them."""

    table: BlockedTable
    """Indices of the neighbours among the sources of the particle's slab (`Slabs.sources`)."""
    slabs: Slabs = eqx.field(static=True, default=ONE)

    @classmethod
    def of(cls, indices: Int[Array, "K N"]) -> Neighbours:
        """Neighbours of all particles on one device, from the indices of the sources in each slot."""
        return cls(blocked(indices))

    @property
    def indices(self) -> Int[Array, "K N"]:
        """Index of the source in each slot, among the sources of the particle's slab."""
        return self.table.indices

    def sum(self, law: Law, smoothing: Smoothing, targets: Fields, sources: Sources) -> Any:
        """Sum of a pair law over the neighbours, see `pairs.pair_sum`."""
        return self._over(_of_indices(pair_sum, law, smoothing), targets, sources, split(1))

    def sum_at(
        self, rows: Int[Array, " C"], law: Law, smoothing: Smoothing, targets: Fields, sources: Sources
    ) -> Any:
        """Sum of a pair law over the neighbours of the particles with the indices `rows`.

        `targets`: fields of these particles.
        """

        def local(rows, sources, indices, targets):
            at, here = _local(rows, indices.shape[1])
            table = indices[:, at]
            found = pair_sum(law, smoothing, targets, self.slabs.sources(sources), table)
            return jax.lax.psum(jax.tree.map(lambda a: jnp.where(here, a, 0.0), found), AXIS)

        if self.slabs.count == 1:
            return pair_sum(law, smoothing, targets, self.slabs.sources(sources), self.indices[:, rows])
        partitions = (WHOLE, SPLIT_SOURCES, split(2), WHOLE)
        arguments = (rows, sources, self.indices, targets)
        return self.slabs.over_slabs(local, arguments, partitions, WHOLE)

    def weights(self, law: Law, smoothing: Smoothing, targets: Fields, sources: Sources) -> Any:
        """Sum of the law's first result, and the law's second result for every slot; see
        `pairs.pair_weights`."""
        results = split(1), split(1)
        return self._over(functools.partial(pair_weights, law, smoothing), targets, sources, results)

    def weighted_sum(self, weights: Float[Array, " E"], f: Sources) -> Float[Array, " N"]:
        """Sum of the weights times the field "f" of the neighbours, see `pairs.weighted_sum`."""
        return self._over(_weighted_sum, weights, f, split(1))

    def _over(self, function: Callable, first: Any, sources: Sources, results: Any) -> Any:
        """Results of `function(first, sources, table)` for the targets of every slab."""

        def local(first, sources, table):
            return function(first, self.slabs.sources(sources), table)

        partitions = jax.tree.map(lambda a: split(a.ndim), first), SPLIT_SOURCES, SPLIT_TABLE
        return self.slabs.over_slabs(local, (first, sources, self.table), partitions, results)


class Chosen(eqx.Module):
    """Selected particles of the water, whose fields every device can gather. The list of particles has a
    fixed length, and an entry may be empty."""

    rows: Int[Array, " I"]
    """Index of the particle in every entry; an empty entry contains the index of the water's last
    particle."""
    there: Bool[Array, " I"]
    """Whether each entry contains a particle."""
    slabs: Slabs = eqx.field(static=True, default=ONE)

    @classmethod
    def of(cls, rows: Int[Array, " I"], n: int, slabs: Slabs) -> Chosen:
        """Selection of the particles with the indices `rows` among n particles; an index of n marks an empty
        entry."""
        return cls(jnp.minimum(rows, n - 1), rows < n, slabs)

    def fields(self, fields: Fields) -> Fields:
        """Fields of the particles, `[I]`; an empty entry (see `there`) has the fields of the last
        particle."""
        if self.slabs.count == 1:
            return jax.tree.map(lambda a: gather_linearly(a, self.rows), fields)
        return self.slabs.take(fields, self.rows)


class PointNeighbours(eqx.Module):
    """Neighbours of points that every device stores, such as ghosts. The sum at a point is computed by one
    slab."""

    table: BlockedTable
    """Indices of the neighbours of every entry of `rows`, or of every point if `rows` is empty."""
    rows: Int[Array, " R"]
    """Indices of the points whose sums each slab computes, slab by slab; an unused entry contains the number
    of points."""
    places: Int[Array, " P"]
    """Index of every point's entry in `rows`; the length of `rows` for a point that is not near the water."""
    slabs: Slabs = eqx.field(static=True, default=ONE)

    @classmethod
    def of(cls, indices: Int[Array, "K P"]) -> PointNeighbours:
        """Neighbours of all points on one device, from the indices of the sources in each slot."""
        none = jnp.zeros(0, jnp.int32)
        return cls(blocked(indices), none, none)

    @property
    def indices(self) -> Int[Array, "K S"]:
        """Index of the source in each slot, for every entry of `rows`, or for every point if `rows` is
        empty."""
        return self.table.indices

    def sum(self, law: Law, smoothing: Smoothing, targets: Fields, sources: Sources) -> Any:
        """Sum of a pair law over the neighbours of every point; zero for a point that is not near the
        water."""

        def local(targets, sources, table, rows, places):
            found = pair_sum(law, smoothing, self._of_slab(targets, rows), sources, table.indices)
            return self._of_points(found, places)

        return self._over(local, targets, sources, WHOLE)

    def weights(self, law: Law, smoothing: Smoothing, targets: Fields, sources: Sources) -> Any:
        """Sum of the law's first result at every point, and the law's second result for every slot."""

        def local(targets, sources, table, rows, places):
            found, weights = pair_weights(law, smoothing, self._of_slab(targets, rows), sources, table)
            return self._of_points(found, places), weights

        return self._over(local, targets, sources, (WHOLE, split(1)))

    def weighted_sum(self, weights: Float[Array, " E"], f: Sources) -> Float[Array, " P"]:
        """Sum at every point of the weights times the field "f" of the point's neighbours."""

        def local(weights, sources, table, rows, places):
            return self._of_points(_weighted_sum(weights, sources, table), places)

        return self._over(local, weights, f, WHOLE, split(1))

    def _over(
        self, function: Callable, first: Any, sources: Sources, results: Any, split_first: Any = WHOLE
    ) -> Any:
        """Results of `function(first, sources, table, rows, places)` on every slab."""

        def local(first, sources, *table):
            return function(first, self.slabs.sources(sources), *table)

        partitions = split_first, SPLIT_SOURCES, SPLIT_TABLE, split(1), WHOLE
        arguments = first, sources, self.table, self.rows, self.places
        return self.slabs.over_slabs(local, arguments, partitions, results)

    def _of_slab(self, targets: Fields, rows: Int[Array, " S"]) -> Fields:
        """Fields of the points whose sums a slab computes; unused entries repeat the last point."""
        if not self.rows.size:
            return targets
        return jax.tree.map(lambda a: a[jnp.minimum(rows, a.shape[0] - 1)], targets)

    def _of_points(self, found: Any, places: Int[Array, " P"]) -> Any:
        """Sums at all points, collected from all slabs; for use within `over_slabs`."""
        leaves, structure = jax.tree.flatten(found)
        if not self.rows.size or not leaves:
            return found
        every = jnp.stack(leaves)
        if self.slabs.count > 1:
            every = jax.lax.all_gather(every, AXIS, axis=1, tiled=True)
        every = jnp.concatenate([every, jnp.zeros_like(every[:, :1])], axis=1)
        return jax.tree.unflatten(structure, list(every[:, places]))


def _of_indices(summed: Callable, law: Law, smoothing: Smoothing) -> Callable:
    """Function of (targets, sources, table) that sums a pair law over the indices in the table."""
    return lambda targets, sources, table: summed(law, smoothing, targets, sources, table.indices)


def _weighted_sum(weights: Float[Array, " E"], sources: Fields, table: BlockedTable) -> Float[Array, " N"]:
    """Sum of the weights times the field "f" of the sources, see `pairs.weighted_sum`."""
    return weighted_sum(weights, sources["f"], table)


def _local(rows: Int[Array, " C"], n: int) -> tuple[Int[Array, " C"], Bool[Array, " C"]]:
    """Indices of particles within a slab of n particles, and whether the particles are in the slab; for use
    within `over_slabs`."""
    at = rows - jax.lax.axis_index(AXIS) * n
    return jnp.clip(at, 0, n - 1), (at >= 0) & (at < n)
