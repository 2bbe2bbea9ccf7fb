"""Sums over neighbours by native code, and their derivatives.

Derivatives of a pair law, in forward mode and in reverse mode, are pair laws of more fields. Their sums are
computed by the same native loops.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxsph.core.arrays import Array
from jaxsph.core.blocks import BLOCK, BlockedTable, block_count
from jaxsph.core.native.derivatives import Form, Function, Halves, replaced
from jaxsph.core.native.forms import available, int32

Law = Callable[..., list[Any]]
"""Pair law on scalars, a function of the arguments in `Groups`."""

Groups = tuple[Any, ...]
"""Arguments of a pair law: pytrees of the target's fields, the source's fields and constants, and in reverse
mode of values for every slot. The leaves are scalars for one pair, or arrays for all pairs."""


class Outcome(NamedTuple):
    """Numbers of results of a pair law, in this order; all other results belong to `scattered`."""

    sums: int = 0
    """Results that are added up over the slots of each target, `[N]`."""
    weights: int = 0
    """Results that are stored for every slot, in blocks (`BlockedTable`)."""


def native_sums(law: Law, groups: Groups, table: Array, outcome: Outcome, by_jax: Function) -> list[Array]:
    """Results of a law for all pairs of a table, by native code; an empty list if there is no native form.

    **Arguments**: `groups`: arrays of the law's arguments; `outcome`: numbers of the law's results, none of
    which is scattered; `by_jax`: the same results by JAX's operations, from the table and the groups.
    """
    form = _pair_form(law, groups, table, outcome, by_jax)
    return form(table, *jax.tree.leaves(groups)) if form else []


def native_weighted_sum(
    weights: Array, f: Array, table: BlockedTable, by_jax: Callable[[Array, Array, BlockedTable], Array]
) -> list[Array]:
    """Weighted sums of the sources' field f, `[N]`, as a list of one array; empty if there is no native form.

    `by_jax`: the sums by JAX's operations, from the same arguments.
    """
    if not available() or not table.in_blocks or weights.dtype != f.dtype:
        return []
    from jaxsph.core.native.functions import register
    from jaxsph.core.native.sums import WeightedLoop

    name = register(WeightedLoop(np.dtype(f.dtype)).module)
    result = jax.ShapeDtypeStruct(table.indices.shape[1:], f.dtype)

    def native(weights: Array, f: Array, indices: Array, blocks: Array) -> list[Array]:
        del indices
        return [jax.ffi.ffi_call(name, result, vmap_method="sequential")(blocks, weights, f)]

    def of_arrays(weights: Array, f: Array, *table: Array) -> list[Array]:
        return [by_jax(weights, f, BlockedTable(*table))]

    arguments = weights, f, *table
    return WeightedForm(native, of_arrays, arguments)(*arguments)


class WeightedForm(Form):
    """Weighted sum over neighbours, a function of the weights, the field and the arrays of the table."""

    def with_tangents(self, arguments, places, tangents):
        """See `Form.with_tangents`; the sum is linear in the weights and in the field."""
        of_each = [self(*replaced(arguments, [k], [a])) for k, a in zip(places, tangents, strict=True)]
        return self(*arguments), functools.reduce(lambda a, b: jax.tree.map(jnp.add, a, b), of_each)

    def native_transpose(self, arguments, places):
        """See `Form.native_transpose`."""
        weights, f, indices, _ = arguments
        total = jax.ShapeDtypeStruct(indices.shape[1:], f.dtype)
        if places == [0]:
            groups, outcome = ([total], [f], [], []), Outcome(weights=1)
        else:
            groups, outcome = ([total], [], [], [weights]), Outcome()

        def product(totals: list[Any], field: list[Any], constants: list[Any], slot: list[Any]) -> list[Any]:
            del constants
            return [totals[0] * (*field, *slot)[0]]

        loop = _pair_loop(product, groups, indices, outcome, len(f))

        def native(a: Array, indices: Array, blocks: Array, total: Array) -> list[Array]:
            del blocks
            return loop(indices, total, a)  # pyright: ignore[reportOptionalCall]

        return native if loop else None


class PairForm(Form):
    """Sums of a pair law, a function of the table and the arrays of the law's arguments."""

    law: Law
    structure: Any
    """Structure of the law's arguments as a pytree."""
    outcome: Outcome
    summed_by_jax: Function
    """The results by JAX's operations, from the table and the pytrees of arguments."""

    def with_tangents(self, arguments, places, tangents):
        """See `Form.with_tangents`."""
        table, *leaves = arguments
        moving = [k - 1 for k in places]
        groups = jax.tree.unflatten(self.structure, leaves)
        of_groups = jax.tree.unflatten(self.structure, replaced([None] * len(leaves), moving, tangents))
        extended = tuple(zip(groups, of_groups, strict=True))
        flat, structure = jax.tree.flatten(extended)

        def form(choose: Callable, outcome: Outcome) -> PairForm | None:
            def by_jax(table: Array, *extended: Any) -> list[Array]:
                return _differentiated(functools.partial(self.summed_by_jax, table), moving, choose)(
                    *extended
                )

            law = _differentiated(self.law, moving, choose)
            return _pair_form(law, extended, table, outcome, by_jax)

        def ordered(values: list[Any], tangents: list[Any]) -> list[Any]:
            sums = self.outcome.sums
            return [*values[:sums], *tangents[:sums], *values[sums:], *tangents[sums:]]

        both = form(ordered, Outcome(*(2 * n for n in self.outcome)))
        if not both:
            return super().with_tangents(arguments, places, tangents)
        numbers = jax.tree.unflatten(structure, range(1, len(flat) + 1))
        count = sum(self.outcome)
        order = ordered(list(range(count)), list(range(count, 2 * count)))
        at = [order.index(k) for k in range(2 * count)]
        both.halves = Halves(
            self,
            [0, *jax.tree.leaves([values for values, _ in numbers])],
            at[:count],
            lambda: form(lambda _, tangents: tangents, self.outcome),  # pyright: ignore[reportArgumentType]
        )
        found = both(table, *flat)
        return [found[k] for k in at[:count]], [found[k] for k in at[count:]]

    def native_transpose(self, arguments, places):
        """See `Form.native_transpose`."""
        table, *leaves = arguments
        linear = [k - 1 for k in places]
        fixed = [k for k in range(len(leaves)) if k not in linear]
        numbers = jax.tree.unflatten(self.structure, range(len(leaves)))
        of_group = [jax.tree.leaves(group) for group in numbers]
        fixed_of = [[k for k in group if k in fixed] for group in of_group]
        targets, sources, constants = [[k for k in group if k in linear] for group in of_group]
        sums = self.outcome.sums

        def apart(fields: Sequence[Any], cotangents: Sequence[Any]) -> Groups:
            """Groups of the fixed arguments; the cotangents of sums are fields of the target."""
            of = dict(zip(fixed, fields, strict=True))
            mine, theirs, others = [[of[k] for k in group] for group in fixed_of]
            return [*mine, *cotangents[:sums]], theirs, others, [*cotangents[sums:]]

        def law(mine: list[Any], theirs: list[Any], others: list[Any], slots: list[Any]) -> list[Any]:
            """Cotangents of the linear arguments of a pair."""
            count = len(fixed_of[0])
            of = dict(zip(fixed, [*mine[:count], *theirs, *others], strict=True))

            def varied(*given: Any) -> list[Any]:
                every = of | dict(zip(linear, given, strict=True))
                return self.law(*jax.tree.unflatten(self.structure, [every[k] for k in range(len(leaves))]))

            types = [jax.ShapeDtypeStruct((), leaves[k].dtype) for k in linear]
            back = jax.linear_transpose(varied, *types)([*mine[count:], *slots])
            found = dict(zip(linear, back, strict=True))
            return [found[k] for k in (*targets, *constants, *sources)]

        groups = apart([leaves[k] for k in fixed], self.native.out_avals)
        outcome, count = Outcome(len(targets) + len(constants)), len(leaves[of_group[1][0]])
        loop = _pair_loop(law, groups, table, outcome, count)
        if not loop:
            return None

        def native(table: Array, *given: Array) -> list[Array]:
            groups = apart(given[: len(fixed)], given[len(fixed) :])
            found = dict(
                zip((*targets, *constants, *sources), loop(table, *jax.tree.leaves(groups)), strict=True)
            )
            return [jnp.sum(found[k]) if k in constants else found[k] for k in linear]

        return native


def _pair_form(law: Law, groups: Groups, table: Array, outcome: Outcome, by_jax: Function) -> PairForm | None:
    """Form of a pair law, see `native_sums`; None if there is no native code."""
    leaves, structure = jax.tree.flatten(groups)
    sources = jax.tree.leaves(groups[1])
    native = _pair_loop(law, groups, table, outcome, len(sources[0]))
    if not native:
        return None

    def of_leaves(table: Array, *leaves: Array) -> list[Array]:
        return by_jax(table, *jax.tree.unflatten(structure, leaves))

    form = PairForm(native, of_leaves, [table, *leaves])
    form.law, form.structure, form.outcome, form.summed_by_jax = law, structure, outcome, by_jax
    return form


def _differentiated(function: Callable, places: Sequence[int], choose: Callable) -> Callable:
    """Results of `choose` from the results of a function and their tangents.

    Each of the function's arguments is followed by the tangents of its leaves; only the leaves at these
    `places` among those of all arguments have tangents.
    """

    def found(*extended: tuple[Any, Any]) -> Any:
        arguments, tangents = zip(*extended, strict=True)
        leaves, structure = jax.tree.flatten(arguments)

        def varied(*given: Array) -> Any:
            return function(*jax.tree.unflatten(structure, replaced(leaves, places, given)))

        return choose(*jax.jvp(varied, [leaves[k] for k in places], jax.tree.leaves(tangents)))

    return found


def _pair_loop(law: Law, groups: Groups, table: Array, outcome: Outcome, count: int) -> Function | None:
    """Function of the table and the leaves of the groups that computes a law's results by native code; None
    if there is no native code.

    `count`: number of sources; results that are scattered are added up over the pairs of every source,
    `[count]`. Only the types of the `groups` and the `table` matter.
    """
    arguments = [jax.tree.leaves(group) for group in (*groups, [])[:4]]
    _, sources, constants, _ = arguments
    if not available() or any(np.ndim(a) for a in constants):
        return None
    from jaxsph.core.native.functions import register
    from jaxsph.core.native.sums import PairLoop
    from jaxsph.core.native.vectors import UntranslatableError, vector_bytes

    closed = jax.make_jaxpr(law)(*jax.tree.map(lambda a: jax.ShapeDtypeStruct((), a.dtype), groups))
    types = [a.dtype for a in closed.out_avals]
    first, second = outcome.sums, sum(outcome)
    kinds = {np.dtype(a) for a in (*(a.dtype for a in sources), *types[second:])}
    if closed.consts or len(kinds) != 1 or next(iter(kinds)).kind != "f":
        return None
    (kind,) = kinds
    mine, theirs, fixed, by_slot = ([np.dtype(a.dtype) for a in group] for group in arguments)
    sums, weights, scattered = types[:first], types[first:second], types[second:]
    loop = PairLoop(closed.jaxpr, mine, theirs, fixed, by_slot, sums, weights, scattered, kind)
    lanes = vector_bytes() // kind.itemsize
    slots, n = table.shape
    if n < (BLOCK if loop.in_blocks else lanes) or count < lanes:
        return None
    try:
        name = register(lambda name: loop.module(name, lanes))
    except UntranslatableError:
        return None
    entries = block_count(n) * BLOCK * slots
    shapes = [((n if k < first else entries,), a) for k, a in enumerate(types[:second])]
    rows = [((count, length), kind) for length in (loop.row, loop.scattered_row)]
    results = [jax.ShapeDtypeStruct(*one) for one in (*shapes, *rows)]

    def call(table: Array, *leaves: Array) -> list[Array]:
        found = jax.ffi.ffi_call(name, results, vmap_method="sequential")(int32(table), *leaves)
        return [*found[:second], *(found[-1][:, k] for k in range(len(types) - second))]

    return call
