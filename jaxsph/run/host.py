"""Running: `simulate`, pure and of fixed length, and `run`, the host driver around it.

The driver goes in chunks: after each it looks at the status, writes series, snapshot and checkpoint in
one atomic step, and goes on. A table that overflowed or went stale is regrown and the chunk replayed;
what cannot be mended stops the run with the last good checkpoint in the file.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from jaxsph.case.build import build
from jaxsph.case.case import Case
from jaxsph.errors import CaseError, FileError
from jaxsph.model.interfaces import AbstractProbe, Model, Reading
from jaxsph.model.solution import Solution
from jaxsph.model.state import State
from jaxsph.output.run_file import RunFile
from jaxsph.run.chunks import (
    _exact_times,
    replayed,
    search_settings,
)
from jaxsph.run.recorder import (
    _coordinates,
    _Recorder,
    _unflatten,
)
from jaxsph.run.simulate import _chunk


def run(
    case: Case,
    t1: float | None = None,
    out: str | Path | None = None,
    overwrite: bool = False,
    progress: bool = True,
) -> Solution:
    """Builds a case and runs it to t1 (s; by default the case's), recording into the file `out`.

    **Returns** the series as numpy arrays with the last state and scalar results.
    **Raises** CaseError, FileError (the output exists), SimulationError (with what, where, when and
    what to change; the file then holds the last good checkpoint).
    """
    model, state = build(case)
    file = None
    if out is not None:
        file = RunFile.create(
            out, case.to_toml(), search_settings(model), _coordinates(case), overwrite=overwrite
        )
    return _drive(case, model, state, case.t1 if t1 is None else t1, file, progress)


def resume(path: str | Path, t1: float | None = None, progress: bool = True) -> Solution:
    """Goes on with a run's file from its last checkpoint, to t1 or the case's own end.

    The series are then bit for bit those of an uninterrupted run. **Raises** FileError, as `restore`.
    """
    file = RunFile.open(path)
    case, model, state = restore(path)
    return _drive(case, model, state, case.t1 if t1 is None else t1, file, progress)


def restore(path: str | Path, case: Case | None = None) -> tuple[Case, Model, State]:
    """Case, model and state of a file's last checkpoint.

    **Raises** FileError where the file is not a run's, holds no checkpoint, or belongs to another case
    than the one given.
    """
    file = RunFile.open(path)
    stored = Case.from_dict(_parse(file.case_toml))
    if case is not None and case != stored:
        raise FileError(
            f"{path}: was made by another case than the one given ({stored.name!r} against "
            f"{case.name!r}, or other values): resume without a case, or run the new one to a new file"
        )
    # the progress holds the settings of the last chunk, which may have been regrown since the first
    known = file.settings | {k: v for k, v in file.progress().items() if k in file.settings}
    model, state = build(stored, {k: int(v) for k, v in known.items()})
    saved = file.checkpoint()
    if not saved:
        raise FileError(f"{path}: holds no checkpoint yet: run the case again with --overwrite")
    return stored, model, _unflatten(state, saved, path)


def _parse(text: str) -> dict[str, Any]:
    import tomllib

    return tomllib.loads(text)


def _drive(
    case: Case, model: Model, state: State, t1: float, file: RunFile | None, progress: bool
) -> Solution:
    kept = _Recorder(case, model, state, t1, file)
    every, last = kept.sample_every, kept.last
    if last <= kept.start:
        raise CaseError(
            f"t1 = {t1:g} s: the run is already at {kept.start * float(model.dt):g} s; give a larger t1"
        )
    with tqdm(
        total=last, initial=kept.start, unit="step", disable=not progress, dynamic_ncols=True, smoothing=0.1
    ) as bar:
        while int(state.step) < last:
            before = int(state.step)
            n_steps = min(kept.per_chunk, last - before)
            advance = functools.partial(
                _chunk, state=state, probes=kept.probes, n_steps=n_steps, sample_every=every
            )
            model, state, readings = replayed(case.name, model, advance, every, bar.write)
            series = kept.keep(model, before, state, readings)
            bar.update(n_steps)
            t = int(state.step) * float(model.dt)
            speed = float(series["max_speed"][-1]) if "max_speed" in series else float("nan")
            bar.set_postfix_str(f"t = {t:.2f} s, max |u| = {speed:.2f} m/s, ok")
    return kept.finished(model, state)


def march(
    model: Model,
    state: State,
    t1: float,
    sample_dt: float,
    probes: Sequence[AbstractProbe] = (),
    *,
    name: str = "assembled",
    progress: bool = False,
) -> Solution:
    """Runs what `case.assemble` gave to t1 (s) and samples it every `sample_dt` (s, as given there).

    Tables that overflow or go stale are regrown and the run replayed, as in `run`; the model returned holds
    the settings that it needed, and a further call goes on from the state returned. The first sample is
    the state given, the last one sample before t1.
    **Raises** ValueError where t1 is no sample after the state's time, SimulationError as `run`.
    """
    sample_every = int(round(sample_dt / float(model.dt)))
    last = int(round(t1 / sample_dt)) * sample_every
    start = int(state.step)
    if last <= start or start % sample_every:
        raise ValueError(f"t1 = {t1:g} s is not a sample after the state's {start * float(model.dt):g} s")
    bar = tqdm(total=last - start, unit="step", disable=not progress, dynamic_ncols=True)
    advance = functools.partial(
        _chunk, state=state, probes=tuple(probes), n_steps=last - start, sample_every=sample_every
    )
    model, state, readings = replayed(name, model, advance, sample_every, bar.write)
    bar.close()
    series = {k: np.asarray(v) for k, v in readings.items()}
    series["time"] = _exact_times(start, series["time"], sample_dt)
    units = {"time": Reading("s", "time")}
    for probe in probes:
        units |= probe.describe()
    return Solution(series, units, model, state)
