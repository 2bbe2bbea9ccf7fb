"""The time loop: steps, in blocks between two neighbour searches, and the readings taken at each block."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import jax
import jax.numpy as jnp

from jaxsph.core.transforms import keep, rematerialise

S = TypeVar("S")


T = TypeVar("T")


def steps(step: Callable[[S], S], state: S, n: int) -> S:
    """State after `step` is applied n times.

    In reverse mode every step is run again from its state and the arrays marked by `transforms.keep`.
    """
    step = rematerialise(step)
    state, _ = jax.lax.scan(lambda s, _: (step(s), None), state, length=n)
    return state


def every_block(block: Callable[[S, None], tuple[S, Any]], state: S, n_blocks: int) -> tuple[S, Any]:
    """State after n_blocks blocks, and the readings of each."""
    return jax.lax.scan(block, state, length=n_blocks)


def first_blocks(count: jax.Array) -> Callable[..., tuple[Any, Any]]:
    """As `every_block` for the first `count` of them, a number that is known when the loop runs.

    The readings of the others are zero, and there is no reverse mode.
    """

    def over(block, state, n_blocks):
        block = jax.jit(block)  # traced once, for the shapes of its readings and for the loop
        _, shapes = jax.eval_shape(block, state, None)

        def add(k, carry):
            state, readings = carry
            state, reading = block(state, None)
            return state, jax.tree.map(lambda all, one: all.at[k].set(one), readings, reading)

        readings = jax.tree.map(lambda a: jnp.zeros((n_blocks, *a.shape), a.dtype), shapes)
        return jax.lax.fori_loop(0, count, add, (state, readings))

    return over


def blocks(
    prepare: Callable[[S], tuple[S, T]],
    begin: Callable[[S, T], tuple[S, Any]],
    step: Callable[[S, T], S],
    state: S,
    n_blocks: int,
    steps_per_block: int,
    over: Callable[..., tuple[S, Any]] = every_block,
) -> tuple[S, Any]:
    """State after n_blocks blocks of steps_per_block steps, and the readings of each block.

    In each block `prepare` makes the tables, `begin` takes readings with them and does what is done once in a
    block, then come the steps. Readings belong to the start of their block, so that a run cut at any block
    continues exactly. `over`: the loop over them, `every_block` or `first_blocks`.
    Reverse mode stores tables and pair sums and runs the rest again: memory grows with the number of steps,
    by a state and its pair sums for each.
    """

    @rematerialise
    def block(s, _):
        s, tables = keep(prepare(s))
        s, reading = begin(s, tables)
        return steps(lambda a: step(a, tables), s, steps_per_block), reading

    return over(block, state, n_blocks)
