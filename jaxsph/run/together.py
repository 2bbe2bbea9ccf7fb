"""Running: `simulate`, pure and of fixed length, and `run`, the host driver around it.

The driver goes in chunks: after each it looks at the status, writes series, snapshot and checkpoint in
one atomic step, and goes on. A table that overflowed or went stale is regrown and the chunk replayed;
what cannot be mended stops the run with the last good checkpoint in the file.
"""

from __future__ import annotations

import functools
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from tqdm import tqdm

from jaxsph.case.build import build
from jaxsph.case.case import Case
from jaxsph.case.report import make_probes, steps_per_sample
from jaxsph.errors import SimulationError
from jaxsph.model.interfaces import Model
from jaxsph.model.solution import Solution
from jaxsph.model.state import State
from jaxsph.output.run_file import RunFile
from jaxsph.run.chunks import (
    _explained,
    _replayed,
    _with_settings,
    search_settings,
)
from jaxsph.run.host import restore
from jaxsph.run.recorder import (
    _coordinates,
    _Recorder,
)
from jaxsph.run.simulate import simulate


@dataclass(eq=False)  # a lane is itself, whatever its arrays hold
class _Lane:
    """One of several runs that go side by side."""

    case: Case
    model: Model
    state: State
    kept: _Recorder
    failure: SimulationError | None = None

    @property
    def step(self) -> int:
        """Of the last checkpoint."""
        return int(self.state.step)


def shape(case: Case) -> Hashable:
    """Cases with equal ones can run together: nothing but the values of their arrays differs."""
    model, state = build(case)
    model = _with_settings(model, dict.fromkeys(search_settings(model), 0))
    sample_every = steps_per_sample(case, model)
    everything = (model, state, make_probes(case, model, state))
    arrays = [(np.shape(a), str(jnp.asarray(a).dtype)) for a in jax.tree.leaves(everything)]
    return jax.tree.structure(everything), tuple(arrays), sample_every, case.t1, case.output


def run_together(
    cases: Sequence[Case], outs: Sequence[str | Path], progress: bool = True
) -> list[Solution | SimulationError]:
    """Runs cases of one `shape` side by side, in one vmapped call per chunk, each into a file of its own.

    A file that has a checkpoint of its case is gone on with. **Returns** what `run` would, or what it would
    raise: a run that fails does not stop the others. **Raises** FileError, as `run` and `restore`.
    """
    lanes = [_begun(case, out) for case, out in zip(cases, outs, strict=True)]
    every = [search_settings(lane.model) for lane in lanes]
    joint = {k: (min if k == "rebuild_every" else max)(s[k] for s in every) for k in every[0]}
    like = _with_settings(lanes[0].model, joint)
    left = sum(lane.kept.last - lane.step for lane in lanes)
    bar = tqdm(total=left, unit="step", disable=not progress, dynamic_ncols=True, leave=False)
    with bar:
        while waiting := [k for k in lanes if k.failure is None and k.step < k.kept.last]:
            # after an interruption some may be a chunk ahead: they wait
            now = min(lane.step for lane in waiting)
            active = [lane for lane in waiting if lane.step == now]
            # a lane that waits, or failed, goes as a copy of one that runs: the shapes stay
            going = [lane if lane in active else active[0] for lane in lanes]
            kept = active[0].kept
            n_steps = min(kept.per_chunk, kept.last - now)
            advance = functools.partial(_lanes_advanced, going, n_steps)
            like, states, readings = _replayed(like, advance, kept.sample_every, bar.write)
            for k, lane in enumerate(lanes):
                if lane not in active:
                    continue
                state, read = jax.tree.map(lambda a, k=k: a[k], (states, readings))
                model = eqx.tree_at(lambda m: m.search, lane.model, like.search)
                if int(state.status.bits):
                    lane.failure = _explained(lane.case.name, model, state)
                    continue
                lane.kept.keep(model, now, state, read)
                lane.model, lane.state = model, state
            bar.update(n_steps * len(active))
            bar.set_postfix_str(f"{len(active)} runs, t = {(now + n_steps) * float(like.dt):.2f} s")
    return [lane.failure or lane.kept.finished(lane.model, lane.state, len(lanes)) for lane in lanes]


def _begun(case: Case, out: str | Path) -> _Lane:
    if Path(out).exists() and RunFile.open(out).checkpoint():
        case, model, state = restore(out, case)
        file = RunFile.open(out)
    else:
        model, state = build(case)
        file = RunFile.create(out, case.to_toml(), search_settings(model), _coordinates(case), overwrite=True)
    return _Lane(case, model, state, _Recorder(case, model, state, case.t1, file))


def _lanes_advanced(lanes: Sequence[_Lane], n_steps: int, like: Model) -> tuple[State, dict]:
    """A chunk of all lanes, with the tables of the model `like`."""
    models = [eqx.tree_at(lambda m: m.search, lane.model, like.search) for lane in lanes]
    together = [(model, lane.kept.probes) for model, lane in zip(models, lanes, strict=True)]
    structure = jax.tree.structure(together[0])
    rows = list(zip(*map(jax.tree.leaves, together), strict=True))
    # what all have in common is not made a batch of
    same = [all(np.array_equal(a, row[0]) for a in row[1:]) for row in rows]
    shared = [row[0] if one else None for row, one in zip(rows, same, strict=True)]
    own = [None if one else jnp.stack(row) for row, one in zip(rows, same, strict=True)]
    states = jax.tree.map(lambda *a: jnp.stack(a), *(lane.state for lane in lanes))
    return _chunk_of_lanes(own, shared, states, structure, n_steps, lanes[0].kept.sample_every)


@functools.partial(jax.jit, static_argnames=("structure", "n_steps", "sample_every"))
def _chunk_of_lanes(own, shared, states, structure, n_steps, sample_every):
    def lane(own, state):
        leaves = [a if b is None else b for a, b in zip(own, shared, strict=True)]
        model, probes = jax.tree.unflatten(structure, leaves)
        return simulate(model, state, n_steps=n_steps, probes=probes, sample_every=sample_every)

    return jax.vmap(lane)(own, states)
