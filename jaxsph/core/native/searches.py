"""Loops of a neighbour search: the order of the sources by cell, and the candidates of every target."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from llvmlite import ir

from jaxsph.core.native.calls import Call, begin_call
from jaxsph.core.native.threads import in_parts
from jaxsph.core.native.translation import FUSED
from jaxsph.core.native.vectors import INDEX, Builder, Value, Vectors, smaller, vector_bytes

INT = ir.IntType(32)

BLOCK = 16
"""Number of targets whose neighbours are listed before they are written to the table; 64 bytes of a row."""


PART = 32 * BLOCK
"""Number of targets in a part of the search."""


class CandidateLoop(NamedTuple):
    """Search among the sources in the cells around each target, for positions of one type."""

    dtype: np.dtype
    shape: tuple[int, ...]
    """Number of cells along every axis."""
    width: int
    """Number of cells on either side of a target's cell that may contain its neighbours."""
    period: tuple[tuple[int, float], ...]
    """Periodic axes and their lengths, m."""

    @property
    def lanes(self) -> int:
        """Number of candidates that are examined at a time."""
        return vector_bytes() // self.dtype.itemsize

    def module(self, name: str) -> ir.Module:
        """Code of the loop as a function that XLA calls.

        **Arguments**: the square of the radius (m2); the coordinates of the targets, an array `[N]` per axis
        (m); their bit masks `sees`, the source that each must not find, and the number of the first cell of
        their lane, `[N]`; the index of their cell along each axis, an array `[N]` per axis; the coordinates
        of the sources by cell, an array `[M]` per axis (m); their bit masks `kind` and indices, `[M]`; and
        the first source of each cell, `[C + 1]`. Arrays of sources are followed by `lanes` unused elements.
        **Results**: the neighbours `[K, N]`, followed by the number M in unused slots, and the number of
        neighbours `[N]`, which may exceed K.
        """
        module, call = begin_call(name)
        (count,) = call.sizes(1, 1)
        with in_parts(call, count, INDEX(PART)) as (part, begin, end):
            self._search(part, begin, end)
        call.finish()
        return module

    def _search(self, call: Call, first: Value, end: Value) -> None:
        """Lists the neighbours of targets."""
        b, one, v = call.builder, Vectors(call.builder, 1), Vectors(call.builder, self.lanes)
        radius2, rows, found = v.spread(call.scalar(0, self.dtype)), call.result(0), call.result(1)
        (capacity, count), arguments = call.sizes(0, 2, of="results"), itertools.count(1)

        def arrays(number: int) -> list[Value]:
            """Data of the next arguments."""
            return [call.argument(next(arguments)) for _ in range(number)]

        dim = len(self.shape)
        targets, (sees, own, lanes), homes, sources, (kinds, indices, starts) = (
            arrays(number) for number in (dim, 3, dim, dim, 3)
        )
        unused = b.sub(b.trunc(call.sizes(1 + 2 * dim + 3, 1)[0], INT), INT(self.lanes))
        most, lists = b.trunc(capacity, INT), b.add(b.udiv(capacity, INDEX(self.lanes)), INDEX(2))
        listed = b.alloca(v.type(np.int32), b.mul(lists, INDEX(BLOCK)))
        pitch, none = b.mul(lists, INDEX(self.lanes)), v.constant(0, np.int32)

        with one.loop(first, end, BLOCK) as (begin, _, _):
            size = smaller(b, INDEX(BLOCK), b.sub(end, begin))
            with one.loop(INDEX(0), size, 1, INT(0)) as (target, (longest,), longer):
                i, here = b.add(begin, target), one.place(listed, np.int32, b.mul(target, pitch))
                mask, me = (v.spread(one.element(a, np.int32, i)) for a in (sees, own))
                x = [v.spread(one.element(a, self.dtype, i)) for a in targets]
                home = [one.element(a, np.int32, i) for a in homes]
                number, lane = INT(0), one.element(lanes, np.int32, i)
                for span in self._spans(one, starts, lane, home):
                    with one.loop(*span, self.lanes, number) as (k, (number,), new):
                        at = b.zext(k, INDEX)
                        there = [v.load(a, self.dtype, at) for a in sources]
                        index = v.load(indices, np.int32, at)
                        near = self._near(v, self._distance2(v, x, there), radius2, b.sub(span[1], k))
                        seen = b.icmp_signed("!=", b.and_(mask, v.load(kinds, np.int32, at)), none)
                        near = b.and_(near, b.and_(seen, b.icmp_signed("!=", index, me)))
                        # the neighbours come first; the next vector overwrites the lanes behind them
                        v.store(
                            v.packed(index, near), here, np.int32, b.zext(smaller(b, number, most), INDEX)
                        )
                        new.append(b.add(number, v.count(near)))
                b.store(number, one.place(found, np.int32, i))
                longer.append(_larger(b, longest, smaller(b, number, most)))
            # Rows of the table may be a multiple of 4096 bytes apart, and would then replace each other in
            # the cache if each target wrote to all rows in turn.
            longest, numbers = b.zext(longest, INDEX), one.place(found, np.int32, begin)
            _fill(v, (listed, pitch), (numbers, most), (size, longest), unused)
            table = one.place(rows, np.int32, begin), count
            _transpose(one, (listed, pitch), table, size, longest)
            _clear(one, table, size, (longest, capacity), unused)

    def _near(self, v: Vectors, squares: Value, radius2: Value, left: Value) -> Value:
        """Mask of the candidates within the radius; only the first `left` lanes contain candidates."""
        lane = ir.Constant(v.type(np.int32), list(range(self.lanes)))
        inside = v.builder.icmp_signed("<", lane, v.spread(left))
        return v.builder.and_(v.builder.fcmp_ordered("<", squares, radius2), inside)

    def _spans(
        self, one: Vectors, starts: Value, lane: Value, home: list[Value]
    ) -> Iterator[tuple[Value, Value]]:
        """Yields the first source and the end of the sources in each line of cells of a lane.

        The lines around the cell `home` run along the last axis; along a periodic axis they continue at the
        other end of the grid. See `core.search.cells`, whose cells of positions that are not numbers may have
        any index.
        """
        b = one.builder
        reach, periodic = range(-self.width, self.width + 1), dict(self.period)
        home = [
            b.select(b.icmp_unsigned("<", index, INT(n)), index, INT(0))
            for index, n in zip(home, self.shape, strict=True)
        ]

        def beside(axis: int, step: int) -> tuple[Value, Value]:
            """Index of the cell `step` cells away, and whether this cell is in the grid."""
            index, n = b.add(home[axis], INT(step)), INT(self.shape[axis])
            if axis in periodic:
                index = b.select(b.icmp_signed("<", index, INT(0)), b.add(index, n), index)
                index = b.select(b.icmp_signed("<", index, n), index, b.sub(index, n))
            return index, b.icmp_unsigned("<", index, n)

        *across, last = range(len(self.shape))
        n = INT(self.shape[last])
        bottom, top = (b.add(home[last], INT(step)) for step in (reach[0], reach[-1]))
        parts = [(_larger(b, bottom, INT(0)), b.sub(n, _larger(b, b.sub(n, b.add(top, INT(1))), INT(0))))]
        if last in periodic:
            under, over = b.icmp_signed("<", bottom, INT(0)), _larger(b, b.sub(b.add(top, INT(1)), n), INT(0))
            parts.append((b.select(under, b.add(bottom, n), INT(0)), b.select(under, n, over)))
        for offset in itertools.product(reach, repeat=len(across)):
            line, there = INT(0), ir.IntType(1)(1)
            for axis, step in zip(across, offset, strict=True):
                index, inside = beside(axis, step)
                line, there = b.add(b.mul(line, INT(self.shape[axis])), index), b.and_(there, inside)
            line = b.add(lane, b.mul(b.select(there, line, INT(0)), n))
            for part in parts:
                cells = (b.sext(b.add(line, cell), INDEX) for cell in part)
                first, end = (one.element(starts, np.int32, cell) for cell in cells)
                yield first, b.select(there, end, first)

    def _distance2(self, v: Vectors, x: list[Value], y: list[Value]) -> Value:
        """Squares of the distances between positions (m2), to the nearest image along periodic axes."""
        b, lengths = v.builder, dict(self.period)
        total = v.constant(0.0, self.dtype)
        for axis, (a, c) in enumerate(zip(x, y, strict=True)):
            r = b.fsub(a, c)
            if axis in lengths:
                length, none = v.like(r, lengths[axis]), v.like(r, 0.0)
                half = v.like(r, 0.5 * lengths[axis])
                above = b.select(b.fcmp_ordered(">", r, half), length, none)
                below = b.select(b.fcmp_ordered("<", r, b.fneg(half)), length, none)
                r = b.fadd(b.fsub(r, above), below)
            total = b.fadd(b.fmul(r, r, flags=FUSED), total, flags=FUSED)
        return total


def _larger(b: Builder, a: Value, c: Value) -> Value:
    """The larger of two integers."""
    return b.select(b.icmp_signed("<", a, c), c, a)


def _fill(
    v: Vectors, lists: tuple[Value, Value], numbers: tuple[Value, Value], size: tuple[Value, Value], a: Value
) -> None:
    """Writes the integer `a` behind the elements of each list, up to a common length.

    **Arguments**: `lists`: the data, and the distance between successive lists; `numbers`: the numbers of
    elements, and their upper limit; `size`: the number of lists, and the length. Up to one vector more may be
    written.
    """
    b, one = v.builder, Vectors(v.builder, 1)
    with one.loop(INDEX(0), size[0], 1) as (k, _, _):
        number = smaller(b, one.element(numbers[0], np.int32, k), numbers[1])
        with v.loop(b.zext(number, INDEX), size[1], v.lanes) as (slot, _, _):
            v.store(v.spread(a), lists[0], np.int32, b.add(b.mul(k, lists[1]), slot))


def _clear(
    one: Vectors, table: tuple[Value, Value], count: Value, rows: tuple[Value, Value], a: Value
) -> None:
    """Writes the integer `a` to the first `count` columns of a range of rows of a table."""
    b = one.builder
    with one.loop(*rows, 1) as (row, _, _):
        start = b.mul(row, table[1])
        with one.loop(INDEX(0), count, 1) as (k, _, _):
            b.store(a, one.place(table[0], np.int32, b.add(start, k)))


def _transpose(
    one: Vectors, lists: tuple[Value, Value], table: tuple[Value, Value], count: Value, length: Value
) -> None:
    """Copies `count` lists of `length` integers to the columns of a table.

    **Arguments**: `lists`, `table`: the data, and the distance between successive lists or rows.
    """
    b = one.builder
    with one.loop(INDEX(0), length, 1) as (slot, _, _):
        row = b.mul(slot, table[1])
        with one.loop(INDEX(0), count, 1) as (k, _, _):
            value = one.element(lists[0], np.int32, b.add(b.mul(k, lists[1]), slot))
            b.store(value, one.place(table[0], np.int32, b.add(row, k)))


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
