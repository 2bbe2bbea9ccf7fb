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
import itertools
from collections.abc import Callable, Sequence
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
    """The law on scalars, a function of the fields of the target and the source and of the constants."""
    held: Sequence[np.dtype]
    """Scalars that the jaxpr contains."""
    targets: Sequence[np.dtype]
    sources: Sequence[np.dtype]
    """All fields of the sources have the same type."""
    constants: Sequence[np.dtype]
    sums: Sequence[np.dtype]
    """Results that are added up over the slots."""
    weights: Sequence[np.dtype]
    """Results that are stored for every slot, in blocks of targets (`BlockedTable`)."""

    @property
    def row(self) -> int:
        """Number of elements in a row of the sources' fields, including unused ones at the end."""
        return -(-len(self.sources) // TOGETHER) * TOGETHER

    def module(self, name: str, lanes: int) -> ir.Module:
        """Code of the loop as a function that XLA calls.

        Its arguments are the table `[K, N]`, the scalars `held`, the fields of the targets `[N]` and those
        of the sources `[M]`, and the constants; its results are the sums `[N]`, the weights in blocks,
        and the rows `[M, row]`. M and N must be at least `lanes`, and N at least `BLOCK` with weights.
        """
        module, call = begin_call(name)
        slots, targets = call.sizes(0, 2)
        (count,) = call.sizes(1 + len(self.held) + len(self.targets), 1)
        with in_parts(call, count, INDEX(PACKED)) as (part, begin, end):
            self._pack(Vectors(part.builder, lanes), part, begin, end)
        together = BLOCK if self.weights else lanes
        with in_parts(call, targets, part_length(call.builder, slots, together)) as (part, begin, end):
            self._sum(Vectors(part.builder, lanes), part, begin, end)
        call.finish()
        return module

    def _pack(self, vectors: Vectors, call: Call, begin: Value, end: Value) -> None:
        """Copies the fields of sources into rows."""
        builder, dtype = vectors.builder, self.sources[0]
        first = 1 + len(self.held) + len(self.targets)
        sources = [call.argument(first + k) for k in range(len(self.sources))]
        rows, (count,) = call.result(len(self.sums) + len(self.weights)), call.sizes(first, 1)
        with vectors.loop(begin, end, vectors.lanes) as (group, _, _):
            at, _ = _first(builder, group, count, vectors.lanes)
            fields = [vectors.load(field, dtype, at) for field in sources]
            fields += [vectors.constant(0, dtype)] * (self.row - len(fields))
            for k in range(0, self.row, TOGETHER):
                for lane, part in enumerate(vectors.rows(fields[k : k + TOGETHER])):
                    row = builder.mul(builder.add(at, INDEX(lane)), INDEX(self.row))
                    place = vectors.place(rows, dtype, builder.add(row, INDEX(k)))
                    builder.store(part, place, align=self._align)

    @property
    def _align(self) -> int:
        """Alignment of `TOGETHER` elements of a row, bytes; at most 16."""
        return min(TOGETHER * self.sources[0].itemsize, 16)

    def _sum(self, vectors: Vectors, call: Call, begin: Value, end: Value) -> None:
        """Computes the results for targets."""
        builder, table, lanes = vectors.builder, call.argument(0), vectors.lanes
        slots, targets = call.sizes(0, 2)
        of_targets = 1 + len(self.held)
        of_sources = of_targets + len(self.targets)
        of_constants = of_sources + len(self.sources)
        held = [vectors.spread(call.scalar(1 + k, kind)) for k, kind in enumerate(self.held)]
        constants = [
            vectors.spread(call.scalar(of_constants + k, kind)) for k, kind in enumerate(self.constants)
        ]
        fields = [call.argument(of_targets + k) for k in range(len(self.targets))]
        (count,) = call.sizes(of_sources, 1)
        *results, rows = (call.result(k) for k in range(len(self.sums) + len(self.weights) + 1))
        empty = vectors.spread(builder.trunc(builder.sub(count, INDEX(1)), ir.IntType(32)))
        if self.weights:  # the last block must be complete
            end = builder.and_(builder.add(end, INDEX(BLOCK - 1)), INDEX(-BLOCK))
        with vectors.loop(begin, end, lanes) as (group, _, _):
            at, within = _first(builder, group, targets, BLOCK if self.weights else lanes)
            block = builder.add(builder.mul(builder.sub(group, within), slots), within)
            mine = [vectors.load(a, kind, at) for a, kind in zip(fields, self.targets, strict=True)]
            zeros = [vectors.constant(0, kind) for kind in self.sums]
            with vectors.loop(INDEX(0), slots, 1, *zeros) as (slot, totals, new):
                place = builder.add(builder.mul(slot, targets), at)
                neighbours = vectors.intrinsic("umin", _slot(vectors, table, np.int32, place, lanes), empty)

                def terms(neighbours: Value = neighbours, mine: list[Value] = mine) -> list[Value]:
                    theirs = self._gathered(vectors, rows, neighbours)
                    fixed = {*held, *mine, *constants}
                    return translated(vectors, self.jaxpr, held, [*mine, *theirs, *constants], fixed)

                if self.weights:
                    found = terms()
                    in_block = builder.add(block, builder.mul(slot, INDEX(BLOCK)))
                    stored = zip(found, [*self.sums, *self.weights], results, strict=True)
                    for a, kind, result in itertools.islice(stored, len(self.sums), None):
                        vectors.store(a, result, kind, in_block)
                    new += _sums(vectors, totals, found)
                else:
                    filled = builder.icmp_unsigned("<", neighbours, empty)
                    new += _sums_where(vectors, totals, filled, terms)
            for total, kind, result in zip(totals, self.sums, results, strict=False):
                vectors.store(total, result, kind, at)

    def _gathered(self, vectors: Vectors, rows: Value, neighbours: Value) -> list[Value]:
        """Fields of the sources with these indices."""
        builder, dtype, lanes = vectors.builder, self.sources[0], vectors.lanes
        elements = builder.mul(neighbours, vectors.constant(self.row, np.int32))
        starts = [
            builder.zext(builder.extract_element(elements, INDEX(lane)), INDEX) for lane in range(lanes)
        ]
        found: list[Value] = []
        part = ir.VectorType(scalar(dtype), TOGETHER)
        for first in range(0, self.row, TOGETHER):
            parts = [
                builder.load(
                    vectors.place(rows, dtype, builder.add(start, INDEX(first))),
                    typ=part,
                    align=self._align,
                )
                for start in starts
            ]
            found += vectors.transposed(parts)
        return found[: len(self.sources)]


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

                new += _sums_where(vectors, totals, functools.reduce(builder.or_, here), terms)
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


def _sums(vectors: Vectors, totals: list[Value], terms: list[Value]) -> list[Value]:
    """Totals with the terms added."""
    return [
        vectors.builder.fadd(total, term, flags=FUSED) for total, term in zip(totals, terms, strict=False)
    ]


def _sums_where(
    vectors: Vectors, totals: list[Value], filled: Value, terms: Callable[[], list[Value]]
) -> list[Value]:
    """Totals with the terms added, unless the slot is filled in no lane: spare slots are empty."""
    builder = vectors.builder
    before = builder.block
    with builder.if_then(vectors.intrinsic("vector.reduce.or", filled, result=ir.IntType(1))):
        new = _sums(vectors, totals, terms())
        inside = builder.block
    found = []
    for total, value in zip(totals, new, strict=True):
        phi = builder.phi(total.type)
        phi.add_incoming(total, before)
        phi.add_incoming(value, inside)
        found.append(phi)
    return found
