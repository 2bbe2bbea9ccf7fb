"""Runs several problems side by side in one vmapped call, each with a separate file."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from tqdm import tqdm

from jaxsph.core.programs import OPTIONS
from jaxsph.errors import SimulationError
from jaxsph.model.interfaces import Model
from jaxsph.model.solution import Solution
from jaxsph.model.state import State
from jaxsph.output.run_file import RunFile
from jaxsph.problem.problem import Problem
from jaxsph.problem.source import Source
from jaxsph.run.chunks import failure_error, replay_chunk, search_settings, with_settings
from jaxsph.run.host import load_start
from jaxsph.run.interrupt import hear_interrupts
from jaxsph.run.recorder import Recorder, Start, new_file
from jaxsph.run.simulate import simulate


@dataclass(eq=False)  # lanes are compared by identity
class _Lane:
    """One of several runs that advance side by side."""

    problem: Problem
    model: Model
    state: State
    recorder: Recorder
    failure: SimulationError | None = None

    @property
    def step(self) -> int:
        """Number of the time step of the last checkpoint."""
        return int(self.state.step)


def shape(source: Source) -> Hashable:
    """Structure, array shapes, sampling and end of a problem; problems for which these agree run together."""
    problem = source.problem()
    model = with_settings(problem.model, dict.fromkeys(search_settings(problem.model), 0))
    everything = (model, problem.state, problem.probes)
    arrays = [(np.shape(a), str(jnp.asarray(a).dtype)) for a in jax.tree.leaves(everything)]
    cadence = (problem.sample_every, problem.per_chunk, problem.sample_dt, problem.t1)
    return jax.tree.structure(everything), tuple(arrays), cadence


def run_together(
    sources: Sequence[Source], outs: Sequence[str | Path], progress: bool = True
) -> list[Solution | SimulationError]:
    """Runs problems of one `shape` side by side, in one vmapped call per chunk, each into a separate file.

    A run whose file has a checkpoint of its problem is continued. **Returns** for each run the solution that
    `run` would return, or the error that it would raise; a run that fails does not stop the others.
    **Raises** FileError, as `run` and `restore`.
    """
    lanes = [_lane(source, out) for source, out in zip(sources, outs, strict=True)]
    every = [search_settings(lane.model) for lane in lanes]
    joint = {k: max(s[k] for s in every) for k in every[0]}
    joint["rebuild_every"] = math.gcd(*(s["rebuild_every"] for s in every))
    like = with_settings(lanes[0].model, joint)
    left = sum(lane.recorder.last - lane.step for lane in lanes)
    bar = tqdm(total=left, unit="step", disable=not progress, dynamic_ncols=True, leave=False)
    with bar, hear_interrupts() as interrupt:
        while waiting := [k for k in lanes if k.failure is None and k.step < k.recorder.last]:
            # after an interruption some lanes may be a chunk ahead, and wait
            now = min(lane.step for lane in waiting)
            active = [lane for lane in waiting if lane.step == now]
            n_steps = min(active[0].recorder.per_chunk, active[0].recorder.last - now)
            like = _advance(lanes, active, like, n_steps, bar.write)
            bar.update(n_steps * len(active))
            bar.set_postfix_str(f"{len(active)} runs, t = {(now + n_steps) * float(like.dt):.2f} s")
            interrupt.chunk_is_saved()
    return [lane.failure or lane.recorder.solution(lane.model, lane.state, len(lanes)) for lane in lanes]


def _advance(
    lanes: Sequence[_Lane], active: Sequence[_Lane], like: Model, n_steps: int, say: Callable[[str], None]
) -> Model:
    """Advances the active lanes by a chunk, and returns the model with the table settings that it needed."""
    # a copy of an active lane replaces every lane that waits or failed, so that array shapes stay the same
    going = [lane if lane in active else active[0] for lane in lanes]
    advance = functools.partial(_simulate_lanes, going, n_steps)
    like, states, readings = replay_chunk(like, advance, say)
    for k, lane in enumerate(lanes):
        if lane not in active:
            continue
        state, read = jax.tree.map(lambda a, k=k: a[k], (states, readings))
        model = eqx.tree_at(lambda m: m.search, lane.model, like.search)
        if int(state.status.bits):
            lane.failure = failure_error(model, state, lane.problem.name, lane.problem.remedies)
            if lane.recorder.file is not None:
                lane.recorder.file.fold()
            continue
        lane.recorder.record(model, state, read)
        lane.model, lane.state = model, state
    return like


def _lane(source: Source, out: str | Path) -> _Lane:
    """Builds a lane that continues the run in the file `out`, or begins the file."""
    if Path(out).exists() and RunFile.open(out).has_checkpoint():
        start, file = load_start(out, source), RunFile.open(out)
    else:
        start = Start(source, source.problem())
        file = new_file(out, start, overwrite=True)
    return _Lane(start.problem, start.model, start.state, Recorder(start, start.problem.t1, file))


def _simulate_lanes(lanes: Sequence[_Lane], n_steps: int, like: Model) -> tuple[State, dict]:
    """Advances all lanes by one chunk, with the neighbour tables of the model `like`."""
    models = [eqx.tree_at(lambda m: m.search, lane.model, like.search) for lane in lanes]
    together = [(model, lane.problem.probes) for model, lane in zip(models, lanes, strict=True)]
    structure = jax.tree.structure(together[0])
    rows = list(zip(*map(jax.tree.leaves, together), strict=True))
    # leaves that all lanes have in common are not batched
    same = [all(np.array_equal(a, row[0]) for a in row[1:]) for row in rows]
    shared = [row[0] if one else None for row, one in zip(rows, same, strict=True)]
    own = [None if one else jnp.stack(row) for row, one in zip(rows, same, strict=True)]
    states = jax.tree.map(lambda *a: jnp.stack(a), *(lane.state for lane in lanes))
    return _simulate_chunks(own, shared, states, structure, n_steps, lanes[0].recorder.sample_every)


@functools.partial(
    jax.jit, static_argnames=("structure", "n_steps", "sample_every"), compiler_options=OPTIONS
)
def _simulate_chunks(own, shared, states, structure, n_steps, sample_every):
    """Advances every lane by a chunk. `own`: leaves that differ between lanes; `shared`: equal leaves."""

    def lane(own, state):
        leaves = [a if b is None else b for a, b in zip(own, shared, strict=True)]
        model, probes = jax.tree.unflatten(structure, leaves)
        return simulate(model, state, n_steps=n_steps, probes=probes, sample_every=sample_every)

    return jax.vmap(lane)(own, states)
