"""Loops of a neighbour search: the order of the sources by cell, and the candidates of every target."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
from llvmlite import ir

from jaxsph.core.native.calls import begin_call
from jaxsph.core.native.translation import FUSED
from jaxsph.core.native.vectors import INDEX, Builder, Value, Vectors, scalar

INT = ir.IntType(32)


class CandidateLoop(NamedTuple):
    """Search among candidates in `dim` dimensions, for positions of one type."""

    dim: int
    dtype: np.dtype
    spans: int
    """Number of ranges of candidates for a target."""
    period: tuple[tuple[int, float], ...]
    """Periodic axes and their lengths, m."""

    def module(self, name: str) -> ir.Module:
        """Code of the loop as a function that XLA calls.

        **Arguments**: the square of the radius (m2); the coordinates of the targets, an array `[N]` per axis
        (m); their bit masks `sees` and the source that each must not find, `[N]`; the coordinates of the
        candidates, `[M]`; their bit masks `kind` and indices, `[M]`; the first candidates of the targets'
        ranges, then the ends of these ranges, an array `[N]` per range. **Results**: the neighbours
        `[K, N]`, and their number `[N]`, which may exceed K.
        """
        module, call = begin_call(name)
        b, v = call.builder, Vectors(call.builder, 1)
        radius2, rows, found = call.scalar(0, self.dtype), call.result(0), call.result(1)
        (capacity, count), arguments = call.sizes(0, 2, of="results"), itertools.count(1)

        def arrays(number: int) -> list[Value]:
            """Data of the next arguments."""
            return [call.argument(next(arguments)) for _ in range(number)]

        targets, (sees, own), sources, (kinds, indices), firsts, ends = (
            arrays(number) for number in (self.dim, 2, self.dim, 2, self.spans, self.spans)
        )
        most, neighbours = b.trunc(capacity, INT), b.alloca(INT, b.add(capacity, INDEX(1)))
        with v.loop(INDEX(0), count, 1) as (i, _, _):
            mask, me = v.element(sees, np.int32, i), v.element(own, np.int32, i)
            x = [v.element(a, self.dtype, i) for a in targets]
            number = INT(0)
            for first, end in zip(firsts, ends, strict=True):
                span = v.element(first, np.int32, i), v.element(end, np.int32, i)
                with v.loop(*span, 1, number) as (k, (number,), new):
                    at = b.zext(k, INDEX)
                    there = [v.element(a, self.dtype, at) for a in sources]
                    index = v.element(indices, np.int32, at)
                    seen = b.and_(mask, v.element(kinds, np.int32, at))
                    near = b.and_(
                        b.fcmp_ordered("<", self._distance2(b, x, there), radius2),
                        b.and_(b.icmp_signed("!=", seen, INT(0)), b.icmp_signed("!=", index, me)),
                    )
                    # every candidate is written; the next one overwrites it unless it is near
                    slot = b.select(b.icmp_signed("<", number, most), number, most)
                    b.store(index, v.place(neighbours, np.int32, b.zext(slot, INDEX)))
                    new.append(b.add(number, b.zext(near, INT)))
            b.store(number, v.place(found, np.int32, i))
            kept = b.select(b.icmp_signed("<", number, most), number, most)
            with v.loop(INT(0), kept, 1) as (k, _, _):
                slot = b.zext(k, INDEX)
                at = b.add(b.mul(slot, count), i)
                b.store(v.element(neighbours, np.int32, slot), v.place(rows, np.int32, at))
        call.finish()
        return module

    def _distance2(self, b: Builder, x: list[Value], y: list[Value]) -> Value:
        """Square of the distance between two positions (m2), to the nearest image along periodic axes."""
        kind, lengths = scalar(self.dtype), dict(self.period)
        total = kind(0.0)
        for axis, (a, c) in enumerate(zip(x, y, strict=True)):
            r = b.fsub(a, c)
            if axis in lengths:
                length, none = kind(lengths[axis]), kind(0.0)
                half = kind(0.5 * lengths[axis])
                above = b.select(b.fcmp_ordered(">", r, half), length, none)
                below = b.select(b.fcmp_ordered("<", r, b.fneg(half)), length, none)
                r = b.fadd(b.fsub(r, above), below)
            total = b.fadd(b.fmul(r, r, flags=FUSED), total, flags=FUSED)
        return total


class CellOrder(NamedTuple):
    """Order of points by the numbers of their cells; points of one cell keep their order."""

    def module(self, name: str) -> ir.Module:
        """Code of the loops as a function that XLA calls.

        **Argument**: the cells of the points, `[M]`. **Results**: the indices of the points in the order of
        their cells, `[M]`; the position in this order at which each cell begins, and M at the end, `[C + 1]`;
        an array `[C + 1]` that the loops use.
        """
        module, call = begin_call(name)
        b, v = call.builder, Vectors(call.builder, 1)
        cells, order, starts, places = call.argument(0), *(call.result(k) for k in range(3))
        (count,), (bounds,) = call.sizes(0, 1), call.sizes(1, 1, of="results")

        def place(array: Value, k: Value) -> Value:
            return v.place(array, np.int32, k)

        def cell_of(k: Value) -> Value:
            cell = b.sext(v.element(cells, np.int32, k), INDEX)
            # the cell of a position that is not a number may be any integer
            return b.select(b.icmp_unsigned("<", cell, b.sub(bounds, INDEX(1))), cell, INDEX(0))

        with v.loop(INDEX(0), bounds, 1) as (k, _, _):
            b.store(INT(0), place(starts, k))
        with v.loop(INDEX(0), count, 1) as (k, _, _):
            behind = place(starts, b.add(cell_of(k), INDEX(1)))
            b.store(b.add(b.load(behind, typ=INT), INT(1)), behind)
        with v.loop(INDEX(0), bounds, 1, INT(0)) as (k, (before,), new):
            new.append(b.add(before, v.element(starts, np.int32, k)))
            b.store(new[0], place(starts, k))
            b.store(new[0], place(places, k))
        with v.loop(INDEX(0), count, 1) as (k, _, _):
            free = place(places, cell_of(k))
            at = b.load(free, typ=INT)
            b.store(b.trunc(k, INT), place(order, b.zext(at, INDEX)))
            b.store(b.add(at, INT(1)), free)
        call.finish()
        return module
