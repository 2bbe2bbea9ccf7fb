"""Vectors of lanes in LLVM's intermediate representation: types, constants, loads and loops."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator
from fractions import Fraction
from typing import Any

import llvmlite.binding as llvm
import numpy as np
from llvmlite import ir

Value = Any
"""Value in a register, of a type of `ir`: a scalar, a vector or an address. The type hints of llvmlite are
incomplete."""
Builder = Any
"""Writer of instructions, an `ir.IRBuilder`."""

LOG_2 = Fraction("0.69314718055994530941723212145817656807")
"""Natural logarithm of 2, with more digits than a float."""

POINTER = ir.PointerType()
INDEX = ir.IntType(64)
_SCALARS = {
    "float32": ir.FloatType(),
    "float64": ir.DoubleType(),
    "int32": ir.IntType(32),
    "bool": ir.IntType(1),
}
"""Types of the elements of arrays, by NumPy's names."""


def vector_bytes() -> int:
    """Size of a vector, bytes: that of the processor's widest registers, at least 32."""
    return 64 if llvm.get_host_cpu_features().get("avx512f") else 32


class UntranslatableError(Exception):
    """An operation or a type has no translation; JAX's form of the loop is used instead."""


def scalar(dtype: Any) -> ir.Type:
    """Type of an array's elements. **Raises** UntranslatableError for types that are not in `_SCALARS`."""
    try:
        return _SCALARS[np.dtype(dtype).name]
    except (KeyError, TypeError):
        raise UntranslatableError(f"arrays of {dtype}") from None


def smaller(b: Builder, a: Value, c: Value) -> Value:
    """The smaller of two integers."""
    return b.select(b.icmp_signed("<", a, c), a, c)


class Vectors:
    """Writer of instructions on vectors with a fixed number of lanes."""

    def __init__(self, builder: Builder, lanes: int) -> None:
        """Writer that appends to the `builder` instructions on vectors with this number of lanes."""
        self.builder = builder
        self.lanes = lanes

    def type(self, dtype: Any) -> Any:
        """Type of a vector of elements."""
        return ir.VectorType(scalar(dtype), self.lanes)

    def constant(self, value: Any, dtype: Any) -> Value:
        """Vector with the constant `value` in every lane."""
        kind = self.type(dtype)
        plain = np.asarray(value, dtype).item()
        return ir.Constant(kind, [ir.Constant(kind.element, plain)] * self.lanes)

    def like(self, a: Value, value: float) -> Value:
        """Vector of the type of `a`, with `value` in every lane."""
        return ir.Constant(a.type, [ir.Constant(a.type.element, value)] * self.lanes)

    def spread(self, value: Value) -> Value:
        """Vector with the scalar `value` in every lane."""
        nothing = ir.Constant(ir.VectorType(value.type, self.lanes), ir.Undefined)
        first = self.builder.insert_element(nothing, value, INDEX(0))
        return self.shuffled(first, first, [0] * self.lanes)

    def from_index(self, first: Value) -> Value:
        """Mask of the lanes whose number is at least `first`."""
        numbers = ir.Constant(ir.VectorType(INDEX, self.lanes), [INDEX(k) for k in range(self.lanes)])
        return self.builder.icmp_signed(">=", numbers, self.spread(first))

    def shuffled(self, a: Value, b: Value, order: list[int]) -> Value:
        """Vector of the lanes of a followed by b that `order` lists."""
        mask = ir.VectorType(ir.IntType(32), len(order))
        return self.builder.shuffle_vector(a, b, ir.Constant(mask, [ir.IntType(32)(k) for k in order]))

    def intrinsic(self, name: str, *values: Value, result: ir.Type | None = None) -> Value:
        """Result of one of LLVM's intrinsic functions, by its name without the types."""
        kind = values[0].type
        width = {"float": "f32", "double": "f64", "i1": "i1", "i32": "i32"}[str(kind.element)]
        full = f"llvm.{name}.v{kind.count}{width}"
        module = self.builder.module
        signature = ir.FunctionType(result or kind, [value.type for value in values])
        function = module.globals.get(full) or ir.Function(module, signature, full)
        return self.builder.call(function, values)

    def count(self, mask: Value) -> Value:
        """Number of lanes in which a mask is true, as a 32-bit integer."""
        bits, module = ir.IntType(self.lanes), self.builder.module
        name = f"llvm.ctpop.i{self.lanes}"
        function = module.globals.get(name) or ir.Function(module, ir.FunctionType(bits, [bits]), name)
        number = self.builder.call(function, [self.builder.bitcast(mask, bits)])
        return self.builder.zext(number, ir.IntType(32))

    def packed(self, a: Value, mask: Value) -> Value:
        """The 32-bit elements of a vector in whose lanes a mask is true, followed by any numbers."""
        features, b = llvm.get_host_cpu_features(), self.builder
        if self.lanes != 8 or features.get("avx512f") or not features.get("avx2"):
            return self.intrinsic("experimental.vector.compress", a, mask, self.constant(0, np.int32))
        # without an instruction for this, LLVM would store one lane after the other
        byte, name = ir.IntType(8), "orders"
        row = ir.ArrayType(byte, 8)
        orders: Any = b.module.globals.get(name)
        if not orders:
            orders = ir.GlobalVariable(b.module, ir.ArrayType(row, 256), name)
            orders.linkage, orders.global_constant = "internal", True
            first = [[k for k in range(8) if bits >> k & 1] for bits in range(256)]
            orders.initializer = ir.Constant(orders.value_type, [(lanes + 8 * [0])[:8] for lanes in first])
        bits = b.zext(b.bitcast(mask, byte), INDEX)
        order = b.load(b.gep(orders, [bits], source_etype=row), typ=ir.VectorType(byte, 8), align=1)
        kind, name = self.type(np.int32), "llvm.x86.avx2.permd"
        permute = b.module.globals.get(name) or ir.Function(
            b.module, ir.FunctionType(kind, [kind, kind]), name
        )
        return b.call(permute, [a, b.zext(order, kind)])

    def load(self, array: Value, dtype: Any, at: Value) -> Value:
        """Consecutive elements of an array from the index `at` on."""
        place = self.place(array, dtype, at)
        return self.builder.load(place, typ=self.type(dtype), align=np.dtype(dtype).itemsize)

    def store(self, value: Value, array: Value, dtype: Any, at: Value) -> None:
        """Stores consecutive elements of an array from the index `at` on."""
        self.builder.store(value, self.place(array, dtype, at), align=np.dtype(dtype).itemsize)

    def store_where(self, mask: Value, value: Value, array: Value, dtype: Any, at: Value) -> None:
        """Stores the elements in whose lanes a mask is true, the first lane's element at the index `at`."""
        align, kinds = ir.IntType(32), [value.type, POINTER, ir.IntType(32), mask.type]
        width = {"float": "f32", "double": "f64"}[str(value.type.element)]
        module, name = self.builder.module, f"llvm.masked.store.v{self.lanes}{width}.p0"
        function = module.globals.get(name) or ir.Function(
            module, ir.FunctionType(ir.VoidType(), kinds), name
        )
        place = self.place(array, dtype, at)
        self.builder.call(function, [value, place, align(np.dtype(dtype).itemsize), mask])

    def element(self, array: Value, dtype: Any, at: Value) -> Value:
        """Element of an array with the index `at`."""
        return self.builder.load(self.place(array, dtype, at), typ=scalar(dtype))

    def gathered(self, array: Value, dtype: Any, at: Value) -> Value:
        """Elements of an array with the indices `at`, one per lane; faster than the processor's gather."""
        found = ir.Constant(self.type(dtype), ir.Undefined)
        for lane in range(self.lanes):
            index = self.builder.zext(self.builder.extract_element(at, INDEX(lane)), INDEX)
            found = self.builder.insert_element(found, self.element(array, dtype, index), INDEX(lane))
        return found

    def place(self, array: Value, dtype: Any, at: Value) -> Value:
        """Address of an element of an array."""
        return self.builder.gep(array, [at], source_etype=scalar(dtype))

    def prefetch(self, array: Value, dtype: Any, at: Value) -> None:
        """Asks the processor to load the elements from the index `at` on, which need not exist."""
        kinds = [POINTER, *[ir.IntType(32)] * 3]
        module, name = self.builder.module, "llvm.prefetch.p0"
        function = module.globals.get(name) or ir.Function(
            module, ir.FunctionType(ir.VoidType(), kinds), name
        )
        read, stays, data = (ir.IntType(32)(k) for k in (0, 3, 1))
        self.builder.call(function, [self.place(array, dtype, at), read, stays, data])

    def transposed(self, rows: list[Value]) -> list[Value]:
        """Vectors of the first, second, third and fourth elements of `rows` of four elements, one per lane.

        Rows k, k + 4, k + 8, ... form one vector, so that every shuffle of two such vectors stays within
        groups of four lanes.
        """
        return self._exchanged([self._joined(rows[k::4]) for k in range(4)])

    def rows(self, columns: list[Value]) -> list[Value]:
        """Rows of four elements, one per lane: the inverse of `transposed`."""
        found = self._exchanged(columns)
        parts = [list(range(group, group + 4)) for group in range(0, self.lanes, 4)]
        return [self.shuffled(a, a, part) for part in parts for a in found]

    def _exchanged(self, vectors: list[Value]) -> list[Value]:
        """Four vectors, each group of whose lanes contains a column of the same groups of four `vectors`."""
        first, second, third, fourth = vectors
        found = []
        for pick in ([0, 4, 1, 5], [2, 6, 3, 7]):
            a, b = self._interleaved(first, second, pick), self._interleaved(third, fourth, pick)
            found += [self._interleaved(a, b, half) for half in ([0, 1, 4, 5], [2, 3, 6, 7])]
        return found

    def _joined(self, parts: list[Value]) -> Value:
        """Vector of the elements of the parts, one part after the other; their number is a power of 2."""
        while len(parts) > 1:
            size = parts[0].type.count
            pairs = zip(parts[::2], parts[1::2], strict=True)
            parts = [self.shuffled(a, b, list(range(2 * size))) for a, b in pairs]
        return parts[0]

    def _interleaved(self, a: Value, b: Value, order: list[int]) -> Value:
        """Vector whose groups of four lanes contain these elements (a: 0 to 3, b: 4 to 7) of each group."""
        return self.shuffled(
            a,
            b,
            [
                group + k % 4 + (self.lanes if k > 3 else 0)
                for group in range(0, self.lanes, 4)
                for k in order
            ],
        )

    @contextlib.contextmanager
    def loop(
        self, first: Value, end: Value, step: int, *starts: Value
    ) -> Iterator[tuple[Value, list[Value], list[Value]]]:
        """Loop over the integers first, first + step, ... below `end`.

        Yields the counter; the values carried from iteration to iteration, which begin with `starts`, and are
        the last values after the loop; and an empty list, to which the body appends the new values.
        """
        builder, function = self.builder, self.builder.function
        before, head = builder.block, function.append_basic_block()
        body, after = function.append_basic_block(), function.append_basic_block()
        builder.branch(head)
        builder.position_at_end(head)
        at, *carried = (builder.phi(start.type) for start in (first, *starts))
        builder.cbranch(builder.icmp_signed("<", at, end), body, after)
        builder.position_at_end(body)
        new: list[Value] = []
        yield at, carried, new
        new = [builder.add(at, at.type(step)), *new]
        for phi, start, value in zip((at, *carried), (first, *starts), new, strict=True):
            phi.add_incoming(start, before)
            phi.add_incoming(value, builder.block)
        builder.branch(head)
        builder.position_at_end(after)

    def exponential(self, x: Value) -> Value:
        """Exponential function, by exp(x) = 2^n exp(r) with |r| <= log(2)/2 and the Taylor series of exp(r).

        The relative error of the series is below 1e-8 in float32 and below 1e-17 in float64. Results below
        the normal numbers are replaced by the smallest normal number, and results above half of the largest
        number by this half.
        """
        b, fused = self.builder, ("contract",)
        info = np.finfo("float32" if isinstance(x.type.element, ir.FloatType) else "float64")
        x = self.intrinsic("maximum", x, self.like(x, (info.minexp + 0.5) * math.log(2.0)))
        x = self.intrinsic("minimum", x, self.like(x, (info.maxexp - 1) * math.log(2.0)))
        n = self.intrinsic("rint", b.fmul(x, self.like(x, 1.0 / math.log(2.0))))
        # log(2) in two parts; the product of n and the first part is exact
        high = float(round(LOG_2 * 2**12) / Fraction(2**12))
        r = b.fsub(x, b.fmul(n, self.like(x, high), flags=fused), flags=fused)
        r = b.fsub(r, b.fmul(n, self.like(x, float(LOG_2 - Fraction(high))), flags=fused), flags=fused)
        degree = 7 if info.bits == 32 else 13
        series = self.like(x, 1.0 / math.factorial(degree))
        for k in range(degree - 1, -1, -1):
            term = self.like(x, 1.0 / math.factorial(k))
            series = b.fadd(b.fmul(series, r, flags=fused), term, flags=fused)
        whole = ir.VectorType(ir.IntType(info.bits), self.lanes)

        def integer(value: int) -> Value:
            return ir.Constant(whole, [whole.element(value)] * self.lanes)

        exponent = b.add(b.fptosi(n, whole), integer(1 - info.minexp))
        return b.fmul(series, b.bitcast(b.shl(exponent, integer(info.nmant)), x.type))
