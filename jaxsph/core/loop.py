"""The only owner of the time loop: blocks of steps between two searches, and what is kept of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import jax

from jaxsph.core.transforms import kept, rematerialised

S = TypeVar("S")


T = TypeVar("T")


def steps(step: Callable[[S], S], state: S, n: int) -> S:
    """`step` applied n times. In reverse mode a step is rematerialised from its state and what is `kept`."""
    step = rematerialised(step)
    state, _ = jax.lax.scan(lambda s, _: (step(s), None), state, length=n)
    return state


def blocks(
    prepare: Callable[[S], tuple[S, T]],
    measure: Callable[[S, T], tuple[S, Any]],
    step: Callable[[S, T], S],
    state: S,
    n_blocks: int,
    steps_per_block: int,
) -> tuple[S, Any]:
    """n_blocks times: `prepare` tables, `measure` with them, then the steps of the block.

    Readings belong to the start of their block, so that a run cut at any block continues exactly.
    Reverse mode keeps tables and pair sums and makes the rest again: memory grows with the number of steps,
    by a state and its pair sums for each.
    """

    @rematerialised
    def block(s, _):
        s, tables = kept(prepare(s))
        s, reading = measure(s, tables)
        return steps(lambda a: step(a, tables), s, steps_per_block), reading

    return jax.lax.scan(block, state, length=n_blocks)
