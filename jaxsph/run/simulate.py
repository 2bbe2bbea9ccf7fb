"""`simulate`: a pure run of a fixed number of steps, which may be jitted, vmapped and differentiated."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxsph.core.loop import blocks, every_block, first_blocks
from jaxsph.core.parts import Part
from jaxsph.core.programs import OPTIONS
from jaxsph.core.transforms import any_lane
from jaxsph.model.interfaces import Model
from jaxsph.model.probe import AbstractProbe
from jaxsph.model.state import State, settle
from jaxsph.probes.joined import measured
from jaxsph.run import lowered


def simulate(
    model: Model,
    state: State,
    *,
    n_steps: int,
    probes: Sequence[AbstractProbe] = (),
    sample_every: int | None = None,
) -> tuple[State, dict[str, jax.Array]]:
    """Advances a state by `n_steps` time steps; this function may be jitted, vmapped and differentiated.

    **Arguments**: `sample_every`: steps between samples, a multiple of `model.search.rebuild_every`
    (the default); `n_steps` must be a multiple of `sample_every`.
    **Returns** the new state and every reading at the start of each sample interval, `[n_samples, ...]`,
    with "time" (s); the first sample is the given state, whatever its step. Failures set bits in
    `state.status` and never raise exceptions: check the status.
    **Raises** ValueError if `n_steps` or `sample_every` is not such a multiple.
    """
    every = _check(model, n_steps, sample_every)
    return _advance(model, state, n_steps, tuple(probes), every, every_block)


def _check(model: Model, n_steps: int, sample_every: int | None) -> int:
    """Checked number of steps between samples. **Raises** ValueError, as `simulate`."""
    every = model.search.rebuild_every
    sample_every = every if sample_every is None else sample_every
    if n_steps % sample_every or sample_every % every:
        raise ValueError(
            f"n_steps = {n_steps} and sample_every = {sample_every} do not fit: sample_every must be a "
            f"multiple of {every}, the model's rebuild_every, and n_steps a multiple of sample_every"
        )
    return sample_every


def _advance(
    model: Model,
    state: State,
    n_steps: int,
    probes: tuple[AbstractProbe, ...],
    sample_every: int,
    over: Callable[..., Any],
) -> tuple[State, dict[str, jax.Array]]:
    """Advances a state by at most n_steps steps; `over` loops over the blocks of steps between searches."""
    every = model.search.rebuild_every
    start = state.step

    @jax.jit  # traced once, although its shapes are evaluated first
    @Part.PROBES.scope()
    def read(s, tables):
        return measured(probes, model, s, tables)

    def begin(s, tables):
        due = (s.step - start) % sample_every == 0
        blank = jax.tree.map(lambda a: jnp.zeros(a.shape, a.dtype), jax.eval_shape(read, s, tables))
        readings = jax.lax.cond(any_lane(due), read, lambda *_: blank, s, tables)
        parts, ledger, limits = settle((s.parts, s.ledger, s.limits), due)
        s = eqx.tree_at(lambda a: (a.parts, a.ledger, a.limits), s, (parts, ledger, limits))
        return model.scheme.regularise(model, s, tables), readings

    state, readings = blocks(
        functools.partial(model.scheme.prepare, model),
        begin,
        model.step,
        state,
        n_steps // every,
        every,
        over,
    )
    # the first of every sample_every // every blocks holds a sample
    stride = sample_every // every
    return state, jax.tree.map(lambda a: a[::stride], readings)


UNSPLIT = {key: f"{passes},cpu-parallel-task-assigner" for key, passes in OPTIONS.items()}
"""Compiler options that also keep XLA from splitting an operation over threads.

CPU cores used as devices share one pool of threads. If operations are split, a loop over a table's slots
waits for a thread at every slot: two cores then take twice the time of one core for a weighted sum. Without
splitting, two cores take 0.6 times the time of one core.
"""


def simulate_chunk(
    model: Model,
    state: State,
    probes: Sequence[AbstractProbe],
    n_steps: int,
    sample_every: int,
    most: int | None = None,
    key: str = "",
) -> tuple[State, dict[str, jax.Array]]:
    """Compiled form of `simulate`: advances a state by `n_steps` time steps.

    `most`: the largest number of steps of this run's chunks, by default `n_steps`; all chunks share one
    compiled program. `key`: see `lowered.key_of`; with an empty key the lowered program is not stored.
    """
    most = n_steps if most is None else most
    for steps in (most, n_steps):
        _check(model, steps, sample_every)
    arguments = (model, state, tuple(probes), most, sample_every, jnp.int32(n_steps))
    alone = model.search.slabs.count == 1
    found = lowered.advance(_simulate, key, *arguments) if key and alone else None
    state, readings = found or (_on_one_device if alone else _on_devices)(*arguments)
    if n_steps < most:
        readings = _first(readings, n_steps // sample_every)
    return state, readings


@functools.partial(jax.jit, static_argnums=1)
def _first(readings, count):
    """The first `count` samples of all readings; one program instead of one for every shape."""
    return jax.tree.map(lambda a: a[:count], readings)


def _simulate(model, state, probes, most, sample_every, n_steps):
    over = first_blocks(n_steps // model.search.rebuild_every)
    return _advance(model, state, most, probes, sample_every, over)


_on_one_device = jax.jit(_simulate, static_argnums=(3, 4), compiler_options=OPTIONS)
_on_devices = jax.jit(_simulate, static_argnums=(3, 4), compiler_options=UNSPLIT)


def new_program(model: Model) -> Any:
    """New, uncompiled copy of the function that `simulate_chunk` compiles, with the arguments (model, state,
    probes, most, sample_every, n_steps)."""
    options = OPTIONS if model.search.slabs.count == 1 else UNSPLIT
    return jax.jit(lambda *given: _simulate(*given), static_argnums=(3, 4), compiler_options=options)
