"""The time loop: blocks of steps from one neighbour search to the next, with readings for every block."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, TypeVar

import jax
import jax.numpy as jnp

from jaxsph.core.transforms import keep, rematerialise

S = TypeVar("S")


T = TypeVar("T")


def steps(step: Callable[[S], S], state: S, n: int) -> S:
    """State after `step` is applied n times.

    Reverse mode recomputes every step from its initial state and the arrays marked by `transforms.keep`.
    """
    step = rematerialise(step)
    state, _ = jax.lax.scan(lambda s, _: (step(s), None), state, length=n)
    return state


def every_block(block: Callable[[S, None], tuple[S, Any]], state: S, n_blocks: int) -> tuple[S, Any]:
    """State after n_blocks blocks, and the readings of each block."""
    return jax.lax.scan(block, state, length=n_blocks)


def first_blocks(count: jax.Array) -> Callable[..., tuple[Any, Any]]:
    """Loop that is called like `every_block` and runs only the first `count` blocks; `count` may be traced.

    The readings of the remaining blocks are zero. Reverse mode is not supported.
    """

    def over(block, state, n_blocks):
        block = jax.jit(block)  # one trace for the shapes of the readings and for the loop
        _, shapes = jax.eval_shape(block, state, None)

        def add(k, carry):
            state, readings = carry
            state, reading = block(state, None)
            put = functools.partial(jax.lax.dynamic_update_index_in_dim, index=k, axis=0)
            return state, jax.tree.map(put, readings, reading)

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

    In each block `prepare` makes the neighbour tables, `begin` takes the readings and makes the changes that
    are due once per block, and then the steps run. Readings are taken at the start of a block, so that an
    interrupted run can be resumed from any block with identical results. `over`: loop over the blocks,
    `every_block` or a result of `first_blocks`. Reverse mode stores the state and the tables of every block
    and the pair sums of every step, and recomputes all other arrays.
    """

    @rematerialise
    def block(s, _):
        s, tables = keep(prepare(s))
        s, reading = begin(s, tables)
        return steps(lambda a: step(a, tables), s, steps_per_block), reading

    return over(block, state, n_blocks)
