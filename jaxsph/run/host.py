"""Host driver: `run`, `resume` and `march` call the pure `simulate`; `restore` reads a checkpoint.

The driver advances in chunks. After each chunk it checks the status and records series, snapshot and
checkpoint in one step. If a neighbour table overflowed, it is enlarged; if it went stale, it is rebuilt more
often; in both cases the chunk is replayed. Any other failure stops the run with the last good checkpoint in
the file.
"""

from __future__ import annotations

import contextlib
import functools
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np
from tqdm import tqdm

from jaxsph.errors import CaseError, FileError
from jaxsph.model.interfaces import Model
from jaxsph.model.probe import AbstractProbe
from jaxsph.model.solution import Solution
from jaxsph.model.state import State
from jaxsph.output.hdf5 import SCHEMA
from jaxsph.output.run_file import RunFile
from jaxsph.probes.joined import described
from jaxsph.problem.sources import source_of
from jaxsph.run.amend import amend
from jaxsph.run.chunks import advance_chunk, sample_times, with_settings, with_settings_of
from jaxsph.run.devices import everywhere, find_devices, gather, share, unshare, usual_devices
from jaxsph.run.interrupt import hear_interrupts
from jaxsph.run.lowered import key_of
from jaxsph.run.processes import Processes, whole
from jaxsph.run.recorder import (
    Recorder,
    Start,
    check_end,
    deciding_numbers,
    differences,
    new_file,
    restored_state,
)
from jaxsph.run.remembered import remember, with_remembered, with_shared
from jaxsph.run.simulate import simulate_chunk
from jaxsph.run.stored import stored_source


def run(
    given: Any,
    t1: float | None = None,
    out: str | Path | None = None,
    overwrite: bool = False,
    progress: bool = True,
    devices: int | None = None,
) -> Solution:
    """Runs a case, a `Problem` or a function that returns a `Problem` to t1 (s), by default the problem's t1.

    The run is recorded in the file `out`, if given.

    An interrupt (Ctrl-C) stops the run at the end of a chunk; a second interrupt stops it at once. `devices`:
    number of accelerators, or of CPU cores used as devices, among which the particles are divided (see
    `docs/cluster.md`); by default the largest number that makes the run faster.
    **Returns** the series as numpy arrays with the last state and scalar results.
    **Raises** CaseError, FileError (the output exists), SimulationError (kind, place and time of the failure,
    and what to change; the file then holds the last good checkpoint).
    """
    find_devices(devices)  # before JAX is first used
    source = source_of(given)
    problem, processes = source.problem(), Processes()
    start = Start(source, problem, with_remembered(source, problem.model))
    t1 = problem.t1 if t1 is None else t1
    check_end(start, t1)

    def take(shared_by: int) -> RunFile | None:
        if out is None:
            return None
        return new_file(out, start, overwrite, shared_by) if processes.is_first else RunFile(out)

    return _drive(start, t1, take, progress, devices, processes)


def resume(
    path: str | Path,
    t1: float | None = None,
    progress: bool = True,
    changes: Mapping[str, Any] | None = None,
    devices: int | None = None,
    given: Any = None,
) -> Solution:
    """Continues a run from the last checkpoint in its file, to t1 (s) or the problem's end.

    On one device the series are bit for bit those of an uninterrupted run. `devices`: as for `run`; the
    number may differ from the previous number. `changes`: new values of the case from the checkpoint on, by
    dotted name, such as {"tank.height": 1.5}, for keys in `run.amend.CHANGEABLE`; the case in the file then
    records the time of each change. `given`: the function or the problem that was run; needed unless a case
    was run, because jaxsph never imports code that is only named in a file. **Raises** FileError, as
    `restore`; CaseError for a change that is not possible during a run.
    """
    file = RunFile.open(path)
    find_devices(devices)
    start, processes = load_start(path, given), Processes()
    if changes:
        if processes.count > 1:
            raise CaseError(
                f"changes of {', '.join(changes)} are not possible while several processes share the run; "
                "first resume the run with one process and these changes, then with several processes"
            )
        start, change = amend(file, start, changes)
    t1 = start.problem.t1 if t1 is None else t1
    check_end(start, t1, ended=bool(file.results()))

    def take(_: int) -> RunFile:
        if changes:
            file.amend(change.case_toml, change.settings, change.numbers, change.since, change.checkpoint)
        return file

    return _drive(start, t1, take, progress, devices, processes)


def restore(path: str | Path, given: Any = None) -> tuple[Any, Model, State]:
    """Source (a `Case`, `Program` or `Assembled` problem), model and state of a file's last checkpoint.

    `given`: see `resume`. **Raises** FileError if the file is not from a run, holds no checkpoint or belongs
    to another case or program than `given`, or if this version of jaxsph builds another model from the case.
    """
    start = load_start(path, given)
    return start.source, start.model, start.state


def load_start(path: str | Path, given: Any = None) -> Start:
    """Problem and checkpoint of a run's file. **Raises** FileError, as `restore`."""
    file = RunFile.open(path)
    source = stored_source(file, given)
    if file.schema != SCHEMA:
        raise FileError(
            f"{path} holds a checkpoint of layout {file.schema}, but this version resumes checkpoints "
            f"of layout {SCHEMA} only: finish the run with the version with which it began, or run the case "
            "again. The series and snapshots of the file can still be read"
        )
    saved = file.checkpoint()
    if not saved:
        raise FileError(
            f"{path} holds no checkpoint (a killed run keeps its checkpoint next to the file, in "
            f"{Path(path).name}.checkpoint): run the case again with --overwrite"
        )
    # the stored progress contains the settings of the last chunk: tables may have grown since the first chunk
    known = file.settings | {k: v for k, v in file.progress().items() if k in file.settings}
    problem = source.problem()
    model = with_settings(problem.model, {k: int(v) for k, v in known.items()})
    differ = differences(file.numbers(), deciding_numbers(model, problem.state))
    if differ:
        few = "; ".join(differ[:5]) + (f"; and {len(differ) - 5} more" if len(differ) > 5 else "")
        raise FileError(
            f"{path}: the model that is built now differs from the model of the run ({few}). To avoid mixing "
            "two models, finish the run with the version with which it began, or run the case again"
        )
    return Start(source, problem, model, restored_state(problem.state, saved, path))


def _drive(
    start: Start,
    t1: float,
    take: Callable[[int], RunFile | None],
    progress: bool,
    devices: int | None,
    processes: Processes,
) -> Solution:
    """Runs to t1 (s); `take(devices)` creates or changes the run's file once all checks have passed."""
    recorder, count = Recorder(start, t1), len(start.state.particles.id)
    own = start.model
    model, state = share(own, start.state, devices or usual_devices(own, start.state))
    probes = everywhere(model.search.slabs, start.problem.probes)
    model = with_shared(model, state, probes)
    every, last = recorder.sample_every, recorder.last
    key = key_of(start.source)
    file = take(model.search.slabs.count)
    path = None if file is None else file.path
    recorder.file = file = file if processes.is_first else None
    bar = tqdm(
        total=last,
        initial=recorder.first,
        unit="step",
        disable=not (progress and processes.is_first),
        dynamic_ncols=True,
        smoothing=0.1,
    )
    with bar, _one_file(file), processes.hearing_of_losses(path), hear_interrupts() as interrupt:
        while int(state.step) < last:
            before = int(state.step)
            n_steps = min(recorder.per_chunk, last - before)
            advance = functools.partial(
                _called,
                bar,
                state=state,
                probes=probes,
                n_steps=n_steps,
                sample_every=every,
                most=recorder.per_chunk,
                key=key,
            )
            model, state, readings = advance_chunk(
                model, advance, bar.write, start.problem.name, start.problem.remedies
            )
            own = with_settings_of(own, model)
            series = recorder.record(own, gather(state, count), whole(readings))
            bar.update(n_steps)
            speed = float(series["max_speed"][-1]) if "max_speed" in series else float("nan")
            t = int(state.step) * float(model.dt)
            bar.set_postfix_str(f"t = {t:.2f} s, max |u| = {speed:.2f} m/s, ok")
            if processes.any(interrupt.asked):
                interrupt.asked = True
            interrupt.chunk_is_saved()
        remember(start.source, start.problem.model, own)
        return recorder.solution(own, unshare(state, count))


def _called(bar: tqdm, model: Model, **chunk: Any) -> tuple[State, dict[str, jax.Array]]:
    """Starts a chunk; the progress bar's rate excludes the time that JAX takes to compile the chunk.

    A call returns as soon as the chunk is compiled; the chunk itself runs asynchronously.
    """
    began = time.perf_counter()
    if not bar.disable and bar.n == bar.initial:
        bar.set_postfix_str("compiling (once for each kind of case) ...")
    found = simulate_chunk(model, **chunk)
    if not bar.disable:
        passed = time.perf_counter() - began
        bar.start_t, bar.last_print_t = bar.start_t + passed, bar.last_print_t + passed
    return found


@contextlib.contextmanager
def _one_file(file: RunFile | None) -> Iterator[None]:
    """Context that merges the run's journal into its file if an exception stops the run."""
    try:
        yield
    except BaseException:
        if file is not None:
            with contextlib.suppress(FileError):  # the error that stopped the run is raised instead
                file.fold()
        raise


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
    """Runs an assembled model to t1 (s), with a sample every `sample_dt` (s, as given to `assemble`).

    If neighbour tables overflow or go stale, their settings are changed and the run is replayed, as in `run`.
    The returned model holds the settings that the run needed, and a further call continues from the returned
    state. The first sample is the given state; the last sample is one interval before t1.
    **Raises** ValueError if the time of the state is not a multiple of `sample_dt`, or if t1 is less than
    `sample_dt` after this time; SimulationError, as `run`.
    """
    sample_every = round(sample_dt / float(model.dt))
    last = round(t1 / sample_dt) * sample_every
    start = int(state.step)
    now = start * float(model.dt)
    if start % sample_every:
        raise ValueError(
            f"sample_dt = {sample_dt:g} s: the time of the state, {now:g} s, must be a multiple of sample_dt"
        )
    if last <= start:
        raise ValueError(
            f"t1 = {t1:g} s: must be at least sample_dt = {sample_dt:g} s after the state, which is at "
            f"{now:g} s"
        )
    bar = tqdm(total=last - start, unit="step", disable=not progress, dynamic_ncols=True)
    advance = functools.partial(
        simulate_chunk, state=state, probes=tuple(probes), n_steps=last - start, sample_every=sample_every
    )
    model, state, readings = advance_chunk(model, advance, bar.write, name, {})
    bar.close()
    series = {k: np.asarray(v) for k, v in readings.items()}
    series["time"] = sample_times(series["time"], sample_dt)
    return Solution(series, described(probes), model, state)
