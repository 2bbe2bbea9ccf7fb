"""Translation of JAX's operations on scalars into instructions on vectors, one lane per pair of particles."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from jax.extend import core as jex
from llvmlite import ir

from jaxsph.core.native.vectors import Builder, UntranslatableError, Value, Vectors, scalar

Rule = Callable[..., Value]
"""Function of the writer of instructions and of vectors that returns a vector."""

FUSED = ("contract",)
"""Products and sums may become fused multiply-add instructions, as in XLA's code for a CPU."""


def translated(
    vectors: Vectors, jaxpr: Any, constants: Sequence[Value], inputs: Sequence[Value], fixed: set[Value]
) -> list[Value]:
    """Results of a jaxpr of scalar operations, for vectors as inputs.

    `constants`: values of the jaxpr's constants; `fixed`: values that do not change in the innermost loop, to
    which such results are added. **Raises** UntranslatableError.
    """
    known: dict[Any, Value] = dict(zip(jaxpr.constvars, constants, strict=True))
    known.update(zip(jaxpr.invars, inputs, strict=True))

    def value(atom: Any) -> Value:
        if isinstance(atom, jex.Literal):
            return vectors.constant(atom.val, atom.aval.dtype)  # pyright: ignore[reportAttributeAccessIssue]
        return known[atom]

    divisors = _divisors(jaxpr)
    repeated = {a for a, count in Counter(divisors).items() if a and count > 1}
    inverses: dict[Any, Value] = {}
    for equation, divisor in zip(jaxpr.eqns, divisors, strict=True):
        _check(equation)
        given = [value(atom) for atom in equation.invars]
        if divisor in repeated and divisor not in inverses:
            a = value(divisor)
            inverses[divisor] = vectors.builder.fdiv(vectors.like(a, 1.0), a)
        found = _results(vectors, equation, given, fixed, inverses.get(divisor))
        if all(isinstance(one, ir.Constant) or one in fixed for one in given):
            fixed.update(found)
        known.update(zip(equation.outvars, found, strict=True))
    return [value(atom) for atom in jaxpr.outvars]


def _divisors(jaxpr: Any) -> list[Any]:
    """Variable by which each equation divides, or None.

    A division takes as long as many other operations, and derivatives divide by one variable several times.
    Then its inverse is computed once.
    """
    found, same = [], {}
    for equation in jaxpr.eqns:
        name, inputs = equation.primitive.name, equation.invars
        if name in UNCHANGED:
            same[equation.outvars[0]] = inputs[0]
        divisor = None
        if name == "integer_pow" and equation.params["y"] < 0:
            divisor = inputs[0]
        elif name == "div" and np.dtype(inputs[1].aval.dtype).kind == "f":
            divisor = inputs[1]
        while not isinstance(divisor, jex.Literal) and divisor in same:
            divisor = same[divisor]
        found.append(None if isinstance(divisor, jex.Literal) else divisor)
    return found


def _check(equation: Any) -> None:
    """**Raises** UntranslatableError for operations on arrays, and for types that vectors do not have."""
    for atom in (*equation.invars, *equation.outvars):
        scalar(atom.aval.dtype)
        if atom.aval.shape:
            raise UntranslatableError(f"{equation.primitive} of an array")


def _results(
    vectors: Vectors, equation: Any, inputs: list[Value], fixed: set[Value], inverse: Value | None
) -> list[Value]:
    """Results of one equation of a jaxpr; `inverse`: inverse of its divisor, if it has been computed."""
    name, params = equation.primitive.name, equation.params
    inner = params.get("jaxpr", params.get("call_jaxpr"))
    if inner:  # a function within the function
        inner, constants = getattr(inner, "jaxpr", inner), getattr(inner, "consts", ())
        held = [vectors.constant(a, np.asarray(a).dtype) for a in constants]
        return translated(vectors, inner, held, inputs, fixed)
    dtype = np.dtype(equation.invars[0].aval.dtype)
    if name in UNCHANGED:
        return inputs[:1]
    if name in COMPARISONS:
        return [_compared(vectors.builder, COMPARISONS[name], dtype, *inputs)]
    if name == "convert_element_type":
        return [_converted(vectors, inputs[0], dtype, np.dtype(params["new_dtype"]))]
    if name == "integer_pow":
        return [_power(vectors, inputs[0], dtype, params["y"], inverse)]
    if name == "div" and inverse:
        return [vectors.builder.fmul(inputs[0], inverse, flags=FUSED)]
    if name == "div" and dtype.kind == "f" and (isinstance(inputs[1], ir.Constant) or inputs[1] in fixed):
        # the inverse is computed outside the loop
        inverse = vectors.builder.fdiv(vectors.like(inputs[1], 1.0), inputs[1])
        return [vectors.builder.fmul(inputs[0], inverse, flags=FUSED)]
    rule = RULES.get((name, dtype.kind)) or RULES.get((name, ""))
    if not rule:
        raise UntranslatableError(f"{name} of {dtype}")
    return [rule(vectors, *inputs)]


UNCHANGED = ("copy", "copy_p", "stop_gradient", "name", "broadcast_in_dim", "reshape", "squeeze", "reshard")
"""Operations that do not change a scalar."""
COMPARISONS = {"lt": "<", "le": "<=", "gt": ">", "ge": ">=", "eq": "==", "ne": "!="}


def _compared(builder: Builder, sign: str, dtype: np.dtype, a: Value, b: Value) -> Value:
    """Comparison of two vectors; with a NaN only != is true."""
    if dtype.kind == "f":
        return (builder.fcmp_unordered if sign == "!=" else builder.fcmp_ordered)(sign, a, b)
    return (builder.icmp_unsigned if dtype.kind == "b" else builder.icmp_signed)(sign, a, b)


def _converted(vectors: Vectors, a: Value, old: np.dtype, new: np.dtype) -> Value:
    """Vector converted to another type of elements."""
    builder, kind = vectors.builder, vectors.type(new)
    if old == new:
        return a
    if new.kind == "b":
        return _compared(builder, "!=", old, a, vectors.constant(0, old))
    if old.kind == "b":
        return (builder.uitofp if new.kind == "f" else builder.zext)(a, kind)
    if old.kind == "i" and new.kind == "f":
        return builder.sitofp(a, kind)
    if old.kind == new.kind == "f":
        return (builder.fpext if new.itemsize > old.itemsize else builder.fptrunc)(a, kind)
    raise UntranslatableError(f"conversion of {old} to {new}")


def _power(vectors: Vectors, a: Value, dtype: np.dtype, exponent: int, inverse: Value | None) -> Value:
    """Power of a vector with a constant integer exponent, by repeated squaring of it or of its `inverse`."""
    if dtype.kind != "f":
        raise UntranslatableError(f"integer_pow of {dtype}")
    builder, left, found = vectors.builder, abs(exponent), vectors.constant(1, dtype)
    a = inverse or a
    while left:
        if left & 1:
            found = builder.fmul(found, a)
        a, left = builder.fmul(a, a), left >> 1
    return builder.fdiv(vectors.constant(1, dtype), found) if exponent < 0 and not inverse else found


def _fused(name: str) -> Rule:
    """Rule for an instruction that may be fused with another one."""
    return lambda vectors, *inputs: getattr(vectors.builder, name)(*inputs, flags=FUSED)


def _plain(name: str) -> Rule:
    """Rule for an instruction."""
    return lambda vectors, *inputs: getattr(vectors.builder, name)(*inputs)


def _intrinsic(name: str) -> Rule:
    """Rule for an operation that one of LLVM's intrinsic functions computes."""
    return lambda vectors, *inputs: vectors.intrinsic(name, *inputs)


def _extreme(name: str, sign: str) -> Rule:
    """Rule for the larger or smaller of two numbers, which is a NaN if either is a NaN."""

    def rule(vectors: Vectors, a: Value, b: Value) -> Value:
        if isinstance(b, ir.Constant):
            a, b = b, a
        if not isinstance(a, ir.Constant):
            return vectors.intrinsic(name, a, b)
        # a processor has one instruction for this; the constant is not a NaN
        return vectors.builder.select(vectors.builder.fcmp_ordered(sign, a, b), a, b)

    return rule


def _inverse_root(vectors: Vectors, a: Value) -> Value:
    """Inverse of the square root of a vector."""
    return vectors.builder.fdiv(vectors.like(a, 1.0), vectors.intrinsic("sqrt", a))


RULES: dict[tuple[str, str], Rule] = {
    ("add", "f"): _fused("fadd"),
    ("add_any", "f"): _fused("fadd"),
    ("sub", "f"): _fused("fsub"),
    ("mul", "f"): _fused("fmul"),
    ("div", "f"): _plain("fdiv"),
    ("neg", "f"): _plain("fneg"),
    ("square", "f"): lambda vectors, a: vectors.builder.fmul(a, a, flags=FUSED),
    ("exp", "f"): lambda vectors, a: vectors.exponential(a),
    ("rsqrt", "f"): _inverse_root,
    ("sqrt", "f"): _intrinsic("sqrt"),
    ("abs", "f"): _intrinsic("fabs"),
    ("max", "f"): _extreme("maximum", ">"),
    ("min", "f"): _extreme("minimum", "<"),
    ("floor", "f"): _intrinsic("floor"),
    ("ceil", "f"): _intrinsic("ceil"),
    ("add", "i"): _plain("add"),
    ("sub", "i"): _plain("sub"),
    ("mul", "i"): _plain("mul"),
    ("and", ""): _plain("and_"),
    ("or", ""): _plain("or_"),
    ("xor", ""): _plain("xor"),
    ("not", ""): _plain("not_"),
    ("select_n", "b"): lambda vectors, which, no, yes: vectors.builder.select(which, yes, no),
}
"""Instructions for JAX's operations, by the name and the kind of the first input; "" stands for any kind."""
