"""The time loop: steps, in blocks between two neighbour searches, and the readings taken at each block."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import jax

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


def blocks(
    prepare: Callable[[S], tuple[S, T]],
    begin: Callable[[S, T], tuple[S, Any]],
    step: Callable[[S, T], S],
    state: S,
    n_blocks: int,
    steps_per_block: int,
    until: jax.Array | None = None,
) -> tuple[S, Any]:
    """State after n_blocks blocks of steps_per_block steps, and the readings of each block.

    `until`: number of blocks to end after, known when the loop runs; the readings of later ones are zero. The
    loop then has no reverse mode.

    In each block `prepare` makes the tables, `begin` takes readings with them and does what is done once in a
    block, then come the steps. Readings belong to the start of their block, so that a run cut at any block
    continues exactly.
    Reverse mode stores tables and pair sums and runs the rest again: memory grows with the number of steps,
    by a state and its pair sums for each.
    """

    @rematerialise
    def block(s, _):
        s, tables = keep(prepare(s))
        s, reading = begin(s, tables)
        return steps(lambda a: step(a, tables), s, steps_per_block), reading

    if until is None:
        return jax.lax.scan(block, state, length=n_blocks)
    traced = jax.jit(block)  # once, for the shapes of its readings and for the loop
    _, shapes = jax.eval_shape(traced, state, None)

    def add(k, carry):
        state, readings = carry
        state, reading = traced(state, None)
        return state, jax.tree.map(lambda all, one: all.at[k].set(one), readings, reading)

    readings = jax.tree.map(lambda a: jax.numpy.zeros((n_blocks, *a.shape), a.dtype), shapes)
    return jax.lax.fori_loop(0, until, add, (state, readings))
