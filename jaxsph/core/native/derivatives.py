"""Derivatives of native functions, which XLA calls without knowing what they compute.

A native function has a second form that consists of JAX's operations. This form yields the derivatives for
which there is no native code.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.extend import core as jex
from jax.interpreters import ad, batching, mlir, partial_eval

from jaxsph.core.arrays import Array

Function = Callable[..., list[Array]]


class Form:
    """Native function of arrays."""

    def __init__(self, native: Function, by_jax: Function, arguments: Sequence[Array]) -> None:
        """Form with this native code and these operations of JAX, for arguments of the given types."""
        self.native = jax.make_jaxpr(native)(*arguments)
        self.by_jax = by_jax
        self.halves: Halves | None = None
        """If the form also computes tangents, the forms that compute one part of its results each."""

    def __call__(self, *arguments: Array) -> list[Array]:
        """Results of the function."""
        return FORM.bind(*arguments, form=self)

    def with_tangents(
        self, arguments: Sequence[Array], places: Sequence[int], tangents: Sequence[Array]
    ) -> tuple[list[Array], list[Array]]:
        """Results and their tangents. The arguments at these `places` have tangents, and the others none."""

        def varied(*given: Array) -> list[Array]:
            return self.by_jax(*replaced(arguments, places, given))

        return self(*arguments), jax.jvp(varied, [arguments[k] for k in places], list(tangents))[1]

    def transposed(
        self, arguments: Sequence[Any], places: Sequence[int], cotangents: Sequence[Array]
    ) -> list[Array]:
        """Cotangents of the arguments at these `places`, in which the function is linear.

        `arguments` contains only the types of these.
        """
        others = [k for k in range(len(arguments)) if k not in places]

        def by_jax(*given: Array) -> list[Array]:
            known = replaced(arguments, others, given[: len(others)])

            def varied(*linear: Array) -> list[Array]:
                return self.by_jax(*replaced(known, places, linear))

            back = jax.linear_transpose(varied, *(arguments[k] for k in places))
            return list(back(list(given[len(others) :])))

        given = [*(arguments[k] for k in others), *cotangents]
        native = self.native_transpose(arguments, places)
        return Form(native, by_jax, given)(*given) if native else by_jax(*given)

    def native_transpose(self, arguments: Sequence[Any], places: Sequence[int]) -> Function | None:
        """Native function that computes the cotangents of the arguments at these `places`.

        Its arguments are the other arguments, followed by the cotangents of the results. Only the types of
        the given `arguments` matter. **Returns** None if there is no native code.
        """
        del arguments, places


class Halves(NamedTuple):
    """Parts of a form that computes the results of another form and their tangents.

    One function for both shares their intermediate values. Reverse mode needs them apart, as it transposes
    only the tangents.
    """

    values: Form
    """Form of the results."""
    arguments: Sequence[int]
    """Places of the arguments of `values` among all arguments."""
    results: Sequence[int]
    """Places of the results of `values` among all results."""
    tangents: Callable[[], Form]
    """Form of the other results, which depends on all arguments."""


FORM = jex.Primitive("native_form")
"""Call of a native function."""
FORM.multiple_results = True


@FORM.def_impl
def _call(*arguments, form):
    return jex.jaxpr_as_fun(form.native)(*arguments)


@FORM.def_abstract_eval
def _types(*_, form):
    return form.native.out_avals


def _jvp(arguments, tangents, *, form):
    """Results and their tangents."""
    places = [k for k, a in enumerate(tangents) if type(a) is not ad.Zero]
    return form.with_tangents(arguments, places, [tangents[k] for k in places])


def _transposed(cotangents, *arguments, form):
    """Cotangents of the arguments in which the function is linear."""
    places = [k for k, a in enumerate(arguments) if ad.is_undefined_primal(a)]
    types = [jax.ShapeDtypeStruct(arguments[k].aval.shape, arguments[k].aval.dtype) for k in places]
    given = [ad.instantiate_zeros(a) for a in cotangents]
    found = form.transposed(replaced(arguments, places, types), places, given)
    return replaced([None] * len(arguments), places, found)


def _batched(arguments, axes, *, form):
    """Results for a batch, one lane after the other."""
    places = [k for k, axis in enumerate(axes) if isinstance(axis, int)]
    lanes = [jnp.moveaxis(arguments[k], axes[k], 0) for k in places]
    found = jax.lax.map(lambda of: FORM.bind(*replaced(arguments, places, of), form=form), lanes)
    return found, [0] * len(found)


def _of_known(trace, *tracers, form):
    """Results for arguments of which only some are known."""
    halves = form.halves
    if not halves or not _apart([not a.is_known() for a in tracers], halves):
        return trace.default_process_primitive(FORM, tracers, {"form": form})
    values = halves.values(*(tracers[k].pval.get_known() for k in halves.arguments))
    tangents = trace.default_process_primitive(FORM, tracers, {"form": halves.tangents()})
    count = len(form.native.out_avals)
    others = [k for k in range(count) if k not in halves.results]
    return replaced(replaced([None] * count, halves.results, values), others, tangents)


def _recomputed(saveable, unknown, instantiated, equation):
    """Equations of the known results and of those that reverse mode recomputes or computes later."""
    del saveable
    form, count = equation.params["form"], len(equation.outvars)
    residuals = [a for a, there in zip(equation.invars, instantiated, strict=True) if not there]
    residuals = [a for a in residuals if not isinstance(a, jex.Literal)]
    if not any(unknown):
        return equation, equation, [False] * count, [True] * count, residuals
    halves = form.halves
    if not halves or not _apart(unknown, halves):
        return None, equation, [True] * count, [True] * count, residuals
    known = equation.replace(
        invars=[equation.invars[k] for k in halves.arguments],
        outvars=[equation.outvars[k] for k in halves.results],
        params={"form": halves.values},
    )
    later = [k not in halves.results for k in range(count)]
    return known, equation, later, [True] * count, residuals


def _apart(unknown: Sequence[bool], halves: Halves) -> bool:
    """Whether the arguments of the values are known and others are not."""
    return any(unknown) and not any(unknown[k] for k in halves.arguments)


ad.primitive_jvps[FORM] = _jvp
ad.primitive_transposes[FORM] = _transposed
batching.primitive_batchers[FORM] = _batched
mlir.register_lowering(FORM, mlir.lower_fun(_call, multiple_results=True))
partial_eval.custom_partial_eval_rules[FORM] = _of_known
partial_eval.partial_eval_jaxpr_custom_rules[FORM] = _recomputed


def replaced(items: Sequence[Any], places: Sequence[int], values: Sequence[Any]) -> list[Any]:
    """The items, with those at the `places` replaced by the values."""
    found = list(items)
    for k, value in zip(places, values, strict=True):
        found[k] = value
    return found
