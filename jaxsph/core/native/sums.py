"""Loop over a neighbour table that evaluates a translated pair law for several targets at a time.

The fields of the sources are first copied into rows, so that the fields of a neighbour are adjacent in
memory. For each group of targets, one per lane, the loop then goes through the table's slots. In each slot
the rows of the lanes' neighbours are loaded and transposed into one vector per field, and the terms of the
law are added to sums that stay in registers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir

from jaxsph.core.native.calls import begin_call
from jaxsph.core.native.translation import FUSED, translated
from jaxsph.core.native.vectors import INDEX, Value, Vectors, scalar

TOGETHER = 4
"""Number of fields that are loaded and transposed together."""


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
    """Results that are stored for every slot."""

    @property
    def row(self) -> int:
        """Number of elements in a row of the sources' fields, including unused ones at the end."""
        return -(-len(self.sources) // TOGETHER) * TOGETHER

    def module(self, name: str, lanes: int) -> ir.Module:
        """Code of the loop as a function that XLA calls.

        Its arguments are the table `[K, N]`, the scalars `held`, the fields of the targets `[N]` and those
        of the sources `[M]`, and the constants; its results are the sums `[N]`, the weights `[K, N]`, and the
        rows `[M, row]`. N must be at least `lanes`.
        """
        module, call = begin_call(name)
        vectors = Vectors(call.builder, lanes)
        builder, table = call.builder, call.argument(0)
        slots, targets = call.sizes(0, 2)
        of_targets = 1 + len(self.held)
        of_sources = of_targets + len(self.targets)
        of_constants = of_sources + len(self.sources)
        held = [vectors.spread(call.scalar(1 + k, kind)) for k, kind in enumerate(self.held)]
        constants = [
            vectors.spread(call.scalar(of_constants + k, kind)) for k, kind in enumerate(self.constants)
        ]
        fields = [call.argument(of_targets + k) for k in range(len(self.targets))]
        sources = [call.argument(of_sources + k) for k in range(len(self.sources))]
        (count,) = call.sizes(of_sources, 1)
        *results, rows = (call.result(k) for k in range(len(self.sums) + len(self.weights) + 1))
        self._pack(vectors, sources, count, rows)
        last = builder.sub(targets, INDEX(lanes))
        empty = vectors.spread(builder.trunc(builder.sub(count, INDEX(1)), ir.IntType(32)))
        with vectors.loop(INDEX(0), targets, lanes) as (group, _, _):
            # the last group overlaps the one before it if the number of targets is no multiple of the lanes
            at = builder.select(builder.icmp_signed("<", group, last), group, last)
            mine = [vectors.load(a, kind, at) for a, kind in zip(fields, self.targets, strict=True)]
            zeros = [vectors.constant(0, kind) for kind in self.sums]
            with vectors.loop(INDEX(0), slots, 1, *zeros) as (slot, totals, new):
                place = builder.add(builder.mul(slot, targets), at)
                neighbours = self._neighbours(vectors, table, place)

                def terms(neighbours: Value = neighbours, mine: list[Value] = mine) -> list[Value]:
                    theirs = self._gathered(vectors, rows, neighbours)
                    return translated(vectors, self.jaxpr, held, [*mine, *theirs, *constants])

                if self.weights:
                    found = terms()
                    for a, kind, result in zip(
                        found[len(self.sums) :], self.weights, results[len(self.sums) :], strict=True
                    ):
                        vectors.store(a, result, kind, place)
                    new += _sums(vectors, totals, found)
                else:
                    new += _sums_where_filled(vectors, totals, neighbours, empty, terms)
            for total, kind, result in zip(totals, self.sums, results, strict=False):
                vectors.store(total, result, kind, at)
        call.finish()
        return module

    def _pack(self, vectors: Vectors, sources: list[Value], count: Value, rows: Value) -> None:
        """Copies the fields of all sources into rows."""
        builder, dtype = vectors.builder, self.sources[0]
        with vectors.loop(INDEX(0), count, 1) as (source, _, _):
            row = builder.mul(source, INDEX(self.row))
            for k, field in enumerate(sources):
                value = vectors.element(field, dtype, source)
                builder.store(value, vectors.place(rows, dtype, builder.add(row, INDEX(k))))

    def _neighbours(self, vectors: Vectors, table: Value, place: Value) -> Value:
        """Indices of the lanes' sources in a slot, at a place in the table."""
        found = vectors.load(table, np.int32, place)
        vectors.prefetch(table, np.int32, vectors.builder.add(place, INDEX(vectors.lanes)))
        return found

    def _gathered(self, vectors: Vectors, rows: Value, neighbours: Value) -> list[Value]:
        """Fields of the sources with these indices."""
        builder, dtype, lanes = vectors.builder, self.sources[0], vectors.lanes
        starts = [
            builder.mul(
                builder.zext(builder.extract_element(neighbours, INDEX(lane)), INDEX), INDEX(self.row)
            )
            for lane in range(lanes)
        ]
        found: list[Value] = []
        part = ir.VectorType(scalar(dtype), TOGETHER)
        align = TOGETHER * np.dtype(dtype).itemsize
        for first in range(0, self.row, TOGETHER):
            parts = [
                builder.load(
                    vectors.place(rows, dtype, builder.add(start, INDEX(first))),
                    typ=part,
                    align=min(align, 16),
                )
                for start in starts
            ]
            found += vectors.transposed(parts)
        return found[: len(self.sources)]


def _sums(vectors: Vectors, totals: list[Value], terms: list[Value]) -> list[Value]:
    """Totals with the terms added."""
    return [
        vectors.builder.fadd(total, term, flags=FUSED) for total, term in zip(totals, terms, strict=False)
    ]


def _sums_where_filled(
    vectors: Vectors,
    totals: list[Value],
    neighbours: Value,
    empty: Value,
    terms: Callable[[], list[Value]],
) -> list[Value]:
    """Totals with the terms added, unless the slot is empty in all lanes: spare slots are."""
    builder = vectors.builder
    filled = builder.icmp_unsigned("!=", neighbours, empty)
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
