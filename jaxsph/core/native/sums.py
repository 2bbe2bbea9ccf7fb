"""Loops over a neighbour table: sums of a translated pair law, and weighted sums with given weights.

Both loops compute the sums of several targets at a time, and the sums stay in registers. A weighted sum reads
the weights and the indices of neighbours in blocks of targets (`BlockedTable`). For a pair law the
fields of the sources are first copied into rows, so that the fields of a neighbour are adjacent in memory.
For each group of targets, one per lane, the loop then goes through the table's slots. In each slot the rows
of the lanes' neighbours are loaded and transposed into one vector per field, and the terms of the law are
added to the sums.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir

from jaxsph.core.blocks import BLOCK
from jaxsph.core.native.calls import Call, begin_call
from jaxsph.core.native.threads import in_parts
from jaxsph.core.native.translation import FUSED, translated
from jaxsph.core.native.vectors import INDEX, Builder, Value, Vectors, scalar, smaller, vector_bytes

TOGETHER = 4
"""Number of fields that are loaded and transposed together."""

PACKED = 8192
"""Number of sources in a part of the loop that copies their fields."""

PAIRS = 32768
"""Number of pairs in a part of a loop, approximately: 20 to 150 microseconds of work."""


class PairLoop(NamedTuple):
    """Pair law, with the types of its arguments and results."""

    jaxpr: Any
    """The law on scalars, a function of the fields of the target and the source, of the constants, and of the
    values in the slot."""
    targets: Sequence[np.dtype]
    sources: Sequence[np.dtype]
    constants: Sequence[np.dtype]
    slots: Sequence[np.dtype]
    """Arguments that have a value in every slot, in blocks of targets (`BlockedTable`)."""
    sums: Sequence[np.dtype]
    """Results that are added up over the slots."""
    weights: Sequence[np.dtype]
    """Results that are stored for every slot, in blocks of targets."""
    scattered: Sequence[np.dtype]
    """Results that are added up for every source."""
    kind: np.dtype
    """Type of all fields of the sources and of all `scattered` results."""

    @property
    def row(self) -> int:
        """Number of elements in a row of the sources' fields, including unused ones at the end."""
        return _padded(len(self.sources))

    @property
    def scattered_row(self) -> int:
        """Number of elements in a row of results for a source, including unused ones at the end."""
        return _padded(len(self.scattered))

    @property
    def in_blocks(self) -> bool:
        """Whether the loop goes through blocks of targets."""
        return bool(self.weights or self.slots)

    def module(self, name: str, lanes: int) -> ir.Module:
        """Code of the loop as a function that XLA calls.

        Its arguments are the table `[K, N]`, the fields of the targets `[N]` and those of the sources `[M]`,
        the constants, and the values by slot; its results are the sums `[N]`, the weights in blocks, the rows
        of the sources' fields `[M, row]` and those of the results for sources `[M, scattered_row]`. M and N
        must be at least `lanes`, and N at least `BLOCK` if the loop goes through blocks.
        """
        module, call = begin_call(name)
        slots, targets = call.sizes(0, 2)
        count = self._count(call)
        with in_parts(call, count, INDEX(PACKED)) as (part, begin, end):
            self._pack(Vectors(part.builder, lanes), part, begin, end)
        together = BLOCK if self.in_blocks else lanes
        # threads must not add to the same source at the same time
        length = targets if self.scattered else part_length(call.builder, slots, together)
        with in_parts(call, targets, length) as (part, begin, end):
            self._sum(Vectors(part.builder, lanes), part, begin, end)
        call.finish()
        return module

    def _count(self, call: Call) -> Value:
        """Number of sources."""
        return call.sizes(len(self.sums) + len(self.weights), 1, of="results")[0]

    def _rows(self, call: Call) -> tuple[Value, Value]:
        """Addresses of the rows of the sources' fields, and of those of the results for sources."""
        first = len(self.sums) + len(self.weights)
        return call.result(first), call.result(first + 1)

    def _pack(self, vectors: Vectors, call: Call, begin: Value, end: Value) -> None:
        """Copies the fields of sources into rows, and fills the rows of results with zeros."""
        builder, dtype = vectors.builder, self.kind
        first = 1 + len(self.targets)
        sources = [call.argument(first + k) for k in range(len(self.sources))]
        (rows, scattered), count = self._rows(call), self._count(call)
        with vectors.loop(begin, end, vectors.lanes) as (group, _, _):
            at, _ = _first(builder, group, count, vectors.lanes)
            fields = [vectors.load(field, dtype, at) for field in sources]
            for first, row in _row_parts(vectors, fields, dtype):
                for lane, part in enumerate(row):
                    start = builder.mul(builder.add(at, INDEX(lane)), INDEX(self.row))
                    place = vectors.place(rows, dtype, builder.add(start, INDEX(first)))
                    builder.store(part, place, align=self._align)
            start = builder.mul(at, INDEX(self.scattered_row))
            for k in range(self.scattered_row):
                place = builder.add(start, INDEX(k * vectors.lanes))
                vectors.store(vectors.constant(0, dtype), scattered, dtype, place)

    @property
    def _align(self) -> int:
        """Alignment of `TOGETHER` elements of a row, bytes; at most 16."""
        return min(TOGETHER * self.kind.itemsize, 16)

    def _sum(self, vectors: Vectors, call: Call, begin: Value, end: Value) -> None:
        """Computes the results for targets."""
        builder, table, lanes = vectors.builder, call.argument(0), vectors.lanes
        slots, targets = call.sizes(0, 2)
        arguments = iter(range(1, 1 + sum(map(len, self[1:5]))))
        mine, _, fixed, by_slot = ([(next(arguments), kind) for kind in group] for group in self[1:5])
        constants = [vectors.spread(call.scalar(k, kind)) for k, kind in fixed]
        fields, by_slot = ([(call.argument(k), kind) for k, kind in group] for group in (mine, by_slot))
        results = [call.result(k) for k in range(len(self.sums) + len(self.weights))]
        rows, scattered = self._rows(call)
        empty = vectors.spread(builder.trunc(builder.sub(self._count(call), INDEX(1)), ir.IntType(32)))
        if self.in_blocks:  # the last block must be complete
            end = builder.and_(builder.add(end, INDEX(BLOCK - 1)), INDEX(-BLOCK))
        with vectors.loop(begin, end, lanes) as (group, _, _):
            at, within = _first(builder, group, targets, BLOCK if self.in_blocks else lanes)
            block = builder.add(builder.mul(builder.sub(group, within), slots), within)
            once = vectors.from_index(builder.sub(builder.sub(group, within), at))
            mine = [vectors.load(a, kind, at) for a, kind in fields]
            zeros = [vectors.constant(0, kind) for kind in self.sums]
            with vectors.loop(INDEX(0), slots, 1, *zeros) as (slot, totals, new):
                place = builder.add(builder.mul(slot, targets), at)
                neighbours = vectors.intrinsic("umin", _slot(vectors, table, np.int32, place, lanes), empty)
                in_block = builder.add(block, builder.mul(slot, INDEX(BLOCK)))

                def terms(
                    neighbours: Value = neighbours,
                    mine: list[Value] = mine,
                    in_block: Value = in_block,
                    once: Value = once,
                ) -> list[Value]:
                    theirs = self._gathered(vectors, rows, neighbours)
                    given = [vectors.load(a, kind, in_block) for a, kind in by_slot]
                    inputs = [*mine, *theirs, *constants, *given]
                    found = translated(vectors, self.jaxpr, (), inputs, {*mine, *constants})
                    kept = len(self.sums) + len(self.weights)
                    for_sources = [builder.select(once, a, vectors.like(a, 0.0)) for a in found[kept:]]
                    self._scatter(vectors, scattered, neighbours, for_sources)
                    return found[:kept]

                filled = builder.icmp_unsigned("<", neighbours, empty)
                nothing = [vectors.constant(0, kind) for kind in self.weights]
                found = _where_filled(vectors, filled, terms, [*totals, *nothing], len(totals))
                new += found[: len(totals)]
                for a, kind, result in zip(
                    found[len(totals) :], self.weights, results[len(totals) :], strict=True
                ):
                    vectors.store(a, result, kind, in_block)
            for total, kind, result in zip(totals, self.sums, results, strict=False):
                vectors.store_where(once, total, result, kind, at)

    def _gathered(self, vectors: Vectors, rows: Value, neighbours: Value) -> list[Value]:
        """Fields of the sources with these indices."""
        starts = _row_starts(vectors, neighbours, self.row)
        found: list[Value] = []
        part = ir.VectorType(scalar(self.kind), TOGETHER)
        for first in range(0, self.row, TOGETHER):
            places = [self._place(vectors, rows, start, first) for start in starts]
            parts = [vectors.builder.load(place, typ=part, align=self._align) for place in places]
            found += vectors.transposed(parts)
        return found[: len(self.sources)]

    def _scatter(self, vectors: Vectors, rows: Value, neighbours: Value, values: list[Value]) -> None:
        """Adds values to the rows of the sources with these indices, of which several may be the same."""
        builder = vectors.builder
        starts = _row_starts(vectors, neighbours, self.scattered_row) if values else []
        part = ir.VectorType(scalar(self.kind), TOGETHER)
        for first, row in _row_parts(vectors, values, self.kind):
            for start, value in zip(starts, row, strict=True):
                place = self._place(vectors, rows, start, first)
                total = builder.fadd(builder.load(place, typ=part, align=self._align), value)
                builder.store(total, place, align=self._align)

    def _place(self, vectors: Vectors, rows: Value, start: Value, first: int) -> Value:
        """Address of the element `first` of the row that begins at `start`."""
        return vectors.place(rows, self.kind, vectors.builder.add(start, INDEX(first)))


def _padded(count: int) -> int:
    """Number of elements in a row of `count` fields."""
    return -(-count // TOGETHER) * TOGETHER


def _row_parts(vectors: Vectors, fields: list[Value], dtype: np.dtype) -> Iterator[tuple[int, list[Value]]]:
    """First element of each part of the rows of these fields, and the part of each lane's row."""
    padded = fields + [vectors.constant(0, dtype)] * (_padded(len(fields)) - len(fields))
    for first in range(0, len(padded), TOGETHER):
        yield first, vectors.rows(padded[first : first + TOGETHER])


def _row_starts(vectors: Vectors, indices: Value, length: int) -> list[Value]:
    """Place of the first element of the row with each lane's index."""
    builder = vectors.builder
    elements = builder.mul(indices, vectors.constant(length, np.int32))
    return [builder.zext(builder.extract_element(elements, INDEX(k)), INDEX) for k in range(vectors.lanes)]


class WeightedLoop(NamedTuple):
    """Weighted sum over neighbours of a field of one type."""

    dtype: np.dtype

    @property
    def lanes(self) -> int:
        """Number of targets in a vector."""
        return vector_bytes() // self.dtype.itemsize

    def module(self, name: str) -> ir.Module:
        """Code of the loop as a function that XLA calls.

        Its arguments are the table and the weights in blocks, and the field of the sources `[M]`; its result
        is the sums `[N]`. N must be at least `BLOCK`.
        """
        module, call = begin_call(name)
        slots, targets = self._sizes(call)
        with in_parts(call, targets, part_length(call.builder, slots, BLOCK)) as (part, begin, end):
            self._sum(Vectors(part.builder, self.lanes), part, begin, end)
        call.finish()
        return module

    def _sizes(self, call: Call) -> tuple[Value, Value]:
        """Numbers of slots and of targets."""
        (entries,), (targets,) = call.sizes(0, 1), call.sizes(0, 1, of="results")
        columns = call.builder.and_(call.builder.add(targets, INDEX(BLOCK - 1)), INDEX(-BLOCK))
        return call.builder.udiv(entries, columns), targets

    def _sum(self, vectors: Vectors, call: Call, begin: Value, end: Value) -> None:
        """Computes the sums for targets."""
        builder = vectors.builder
        indices, weights, field = (call.argument(k) for k in range(3))
        (slots, targets), (count,) = self._sizes(call), call.sizes(2, 1)
        empty = vectors.spread(builder.trunc(builder.sub(count, INDEX(1)), ir.IntType(32)))
        zeros = [vectors.constant(0, self.dtype)] * (BLOCK // self.lanes)
        with vectors.loop(begin, end, BLOCK) as (block, _, _):
            at, _ = _first(builder, block, targets, BLOCK)
            first = builder.mul(block, slots)
            with vectors.loop(INDEX(0), slots, 1, *zeros) as (slot, totals, new):
                start = builder.add(first, builder.mul(slot, INDEX(BLOCK)))
                places = [builder.add(start, INDEX(k * self.lanes)) for k in range(BLOCK // self.lanes)]
                neighbours = [
                    vectors.intrinsic("umin", vectors.load(indices, np.int32, place), empty)
                    for place in places
                ]
                here = [builder.icmp_unsigned("!=", one, empty) for one in neighbours]

                def terms(places: list[Value] = places, neighbours: list[Value] = neighbours) -> list[Value]:
                    return [
                        builder.fmul(
                            vectors.load(weights, self.dtype, place),
                            vectors.gathered(field, self.dtype, one),
                            flags=FUSED,
                        )
                        for place, one in zip(places, neighbours, strict=True)
                    ]

                filled = functools.reduce(builder.or_, here)
                new += _where_filled(vectors, filled, terms, totals, len(totals))
            for k, total in enumerate(totals):
                vectors.store(total, call.result(0), self.dtype, builder.add(at, INDEX(k * self.lanes)))


class BlockLoop(NamedTuple):
    """Copy of a table into blocks of targets (`BlockedTable`)."""

    def module(self, name: str) -> ir.Module:
        """Code of the loop as a function that XLA calls.

        Its argument is the table `[K, N]`, its result the table in blocks. N must be at least `BLOCK`.
        """
        module, call = begin_call(name)
        slots, targets = call.sizes(0, 2)
        with in_parts(call, targets, part_length(call.builder, slots, BLOCK)) as (part, begin, end):
            b, vectors = part.builder, Vectors(part.builder, BLOCK)
            table, blocks = part.argument(0), part.result(0)
            slots, targets = part.sizes(0, 2)
            with vectors.loop(begin, end, BLOCK) as (block, _, _):
                at, _ = _first(b, block, targets, BLOCK)
                with vectors.loop(INDEX(0), slots, 1) as (slot, _, _):
                    listed = _slot(vectors, table, np.int32, b.add(b.mul(slot, targets), at), BLOCK)
                    place = b.add(b.mul(block, slots), b.mul(slot, INDEX(BLOCK)))
                    vectors.store(listed, blocks, np.int32, place)
        call.finish()
        return module


def part_length(builder: Builder, slots: Value, together: int) -> Value:
    """Number of targets in a part of a loop over a table's slots, a multiple of `together`."""
    slots = builder.select(builder.icmp_signed("<", slots, INDEX(1)), INDEX(1), slots)
    groups = builder.udiv(INDEX(PAIRS // together), slots)
    return builder.mul(builder.add(groups, INDEX(1)), INDEX(together))


def _first(builder: Builder, group: Value, targets: Value, together: int) -> tuple[Value, Value]:
    """First target of a group, and its position among the targets that are stored `together`.

    The last of these overlap those before if the number of targets is no multiple of `together`, which is a
    power of 2.
    """
    within = builder.and_(group, INDEX(together - 1))
    start, last = builder.sub(group, within), builder.sub(targets, INDEX(together))
    return builder.add(smaller(builder, start, last), within), within


def _slot(vectors: Vectors, rows: Value, dtype: Any, place: Value, stride: int) -> Value:
    """Elements of a slot from `place` on. The elements that follow `stride` later are needed for the next
    targets; the processor does not load them early on its own, since slots are far apart in memory."""
    vectors.prefetch(rows, dtype, vectors.builder.add(place, INDEX(stride)))
    return vectors.load(rows, dtype, place)


def _where_filled(
    vectors: Vectors, filled: Value, terms: Callable[[], list[Value]], before: list[Value], sums: int
) -> list[Value]:
    """The terms of a slot, the first `sums` of them added to the totals in `before`; or the values `before`,
    if the slot is filled in no lane, as spare slots are."""
    builder = vectors.builder
    outside = builder.block
    with builder.if_then(vectors.intrinsic("vector.reduce.or", filled, result=ir.IntType(1))):
        new = terms()
        added = zip(before[:sums], new, strict=False)
        new[:sums] = [builder.fadd(total, term, flags=FUSED) for total, term in added]
        inside = builder.block
    found = []
    for value, other in zip(before, new, strict=True):
        phi = builder.phi(value.type)
        phi.add_incoming(value, outside)
        phi.add_incoming(other, inside)
        found.append(phi)
    return found
