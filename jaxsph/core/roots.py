"""Roots of increasing functions of one variable, with exact derivatives, and fixed points."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar

import jax
import jax.numpy as jnp

from jaxsph.core.arrays import Scalar

__all__ = ["fixed_point", "increasing_root"]

STEPS = 48
"""Number of steps. Every second step halves the interval, so that a root is found to 6e-8 of the interval's
length where Newton's steps do not converge."""


Values = TypeVar("Values")


def fixed_point(step: Callable[[Values], Values], start: Values, iterations: int) -> Values:
    """Values that `step` leaves as they are, found by repeating it from `start` a fixed number of times.

    Derivatives are those of the repetitions, which converge like the values.
    """
    return jax.lax.fori_loop(0, iterations, lambda _, values: step(values), start)


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def increasing_root(
    function: Callable[[Scalar, Any], Scalar], low: Scalar, high: Scalar, parameters: Any
) -> Scalar:
    """Zero between `low` and `high` of an increasing function; if there is no zero, the end at which the
    function is closer to zero.

    The method is Newton's. Bisection replaces every Newton step that leaves the interval of the root, and
    every second Newton step until the iteration has nearly converged. The number of steps is fixed, so that
    `increasing_root` can be vectorised. `function` is called with the unknown and the
    `parameters`. The derivative of the root with respect to the parameters follows from the implicit function
    theorem. The derivative is zero where there is no root.
    """
    value_and_slope = jax.value_and_grad(function)

    def step(k, carry):
        low, high, at = carry
        value, slope = value_and_slope(at, parameters)
        low, high = jnp.where(value < 0.0, at, low), jnp.where(value < 0.0, high, at)
        newton, middle = at - value / slope, 0.5 * (low + high)
        # the comparison is also false for NaN
        inside = (newton >= low) & (newton <= high)
        # near the root, bisection would discard an iterate of Newton's method that has already converged
        take = inside & ((k % 2 == 0) | (jnp.abs(newton - at) < 1e-3 * (high - low)))
        return low, high, jnp.where(take, newton, middle)

    return jax.lax.fori_loop(0, STEPS, step, (low, high, 0.5 * (low + high)))[2]


@increasing_root.defjvp
def _increasing_root_jvp(function, primals, tangents):
    low, high, parameters = primals
    at = increasing_root(function, low, high, parameters)
    change = jax.jvp(lambda p: function(at, p), (parameters,), (tangents[2],))[1]
    slope = jax.grad(function)(at, parameters)
    inside = (function(low, parameters) < 0.0) & (function(high, parameters) > 0.0)
    return at, jnp.where(inside, -change / jnp.where(inside, slope, 1.0), 0.0)
