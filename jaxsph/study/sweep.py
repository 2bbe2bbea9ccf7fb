"""Many runs of one case: `sweep` over parameters, one member per core or many in one call, in one file that
resumes."""

from __future__ import annotations

import contextlib
import itertools
import os
import shutil
import subprocess
import sys
import threading
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import jax
import numpy as np
from tqdm import tqdm

from jaxsph.case.case import Case
from jaxsph.errors import CaseError, FileError, JaxsphError
from jaxsph.output.hdf5 import Variable
from jaxsph.output.run_file import RunFile
from jaxsph.output.sweep_file import SweepFile, over_members
from jaxsph.run.together import run_together, shape

FORWARD_FLAGS = "--xla_backend_extra_options=xla_cpu_use_multi_output_fusion=true"
"""Flags of the compiler (XLA) for members: a step takes 0.83 of its time. With them a checkpointed reverse
pass cannot be compiled, so they are no default of the package; a member only runs forward."""


BATCH = 8
"""Number of members in one vmapped call on an accelerator, by default."""


Ended = tuple[dict[str, Any], dict[str, Variable]]
"""Results, series and failure of a member that has ended, and the meaning of each series."""


@dataclass(frozen=True)
class Sweep:
    """Results of every member over the swept parameters."""

    case: Case
    """Case that all members share."""
    axes: dict[str, np.ndarray]
    """Values of each parameter by dotted name."""
    results: dict[str, np.ndarray]
    """Scalar results over the grid (or list) of members; NaN where a member has none."""
    failures: dict[tuple[int, ...], str]
    """Error messages of the members that failed, by their place; empty where all went well."""
    members: dict[tuple[int, ...], dict[str, np.ndarray]] = field(repr=False)
    """Series of each member by its place, "time" (s) among them."""

    def __getitem__(self, name: str) -> np.ndarray:
        """Scalar result called `name`, over the members."""
        if name not in self.results:
            raise KeyError(f"no result {name!r}; there are {', '.join(sorted(self.results))}")
        return self.results[name]


def sweep(
    case: Case,
    over: Mapping[str, Sequence[float]],
    out: str | Path,
    *,
    grid: bool = True,
    workers: int | None = None,
    batch: int | None = None,
    progress: bool = True,
) -> Sweep:
    """Runs a case for every combination of values: on a CPU each member in a process of its own on one core,
    on an accelerator in vmapped batches.

    **Arguments**: `over`: values by dotted name, `{"pto.K_dm": [300, 500], "waves.H": [0.02, 0.04]}`,
    geometry and `t1` included; `grid`: every combination, or one member for each place in lists of equal
    length; `out`: the file. Called again it goes on where it was interrupted: a member's checkpoints lie
    beside the file, in `<out>.members`, until the member has ended. `workers`: members at a time (by
    default one per core). `batch`: in its place, so many members in one vmapped call in this process, as far
    as their arrays have the same shapes. On a CPU a member of a batch takes 1.3 times as long as alone
    (`python -m experiments run bench_batch`), so batches are the default on an accelerator only.
    **Returns** all results. A member that fails does not stop the others: see `Sweep.failures`.
    **Raises** CaseError for a member that cannot be built, before any runs; FileError where `out` is of
    another sweep.
    """
    if batch is None and workers is None and jax.default_backend() != "cpu":
        batch = BATCH
    if batch is not None and batch < 1:
        raise CaseError(f"batch = {batch}: must be 1 or more")
    if batch is not None and workers is not None:
        raise CaseError(f"batch = {batch}: goes without workers (here {workers}); give one of the two")
    axes = {name: np.asarray(values) for name, values in over.items()}
    cases, shape = _cases(case, axes, grid)
    file = SweepFile(out)
    members, variables = _ended_before(file, case, axes, shape) if file.path.exists() else ({}, {})
    folder = file.path.with_name(f"{file.path.name}.members")
    folder.mkdir(parents=True, exist_ok=True)
    missing = {i: member for i, member in enumerate(cases) if i not in members}
    bar = tqdm(total=len(cases), initial=len(members), unit="run", disable=not progress, dynamic_ncols=True)
    ended = (
        _in_processes(missing, folder, workers)
        if batch is None
        else _in_batches(missing, folder, batch, progress)
    )
    with bar, contextlib.closing(ended):
        for i, (members[i], described) in ended:
            variables = variables | described
            file.write(case.to_toml(), axes, shape, members, variables)
            for part in folder.glob(f"{i:04d}.*"):
                part.unlink()
            bar.update()
            if members[i]["failure"]:
                bar.write(f"member {i}: {members[i]['failure'].splitlines()[0]}")
    shutil.rmtree(folder)
    return _make_sweep(case, axes, shape, members)


def _ended_before(
    file: SweepFile, case: Case, axes: Mapping[str, np.ndarray], shape: tuple[int, ...]
) -> tuple[dict[int, Any], dict[str, Variable]]:
    """Members of an earlier call that went well, and what their series are; failed ones are tried again."""
    stored = file.read()
    same = (stored.case_toml, stored.shape, [*stored.axes]) == (case.to_toml(), shape, [*axes])
    if not same or any(np.any(stored.axes[name] != axes[name]) for name in axes):
        raise FileError(
            f"{file.path}: holds a sweep of another case or of other values, and nothing was changed; "
            "give another name, or remove it"
        )
    return {i: m for i, m in stored.members.items() if not m["failure"]}, stored.variables


def read_sweep(path: str | Path) -> Sweep:
    """Results in a sweep's file, whether the sweep has ended or not. **Raises** FileError."""
    stored = SweepFile(path).read()
    case = Case.from_dict(tomllib.loads(stored.case_toml))
    return _make_sweep(case, stored.axes, stored.shape, stored.members)


def _cases(case: Case, axes: Mapping[str, np.ndarray], grid: bool) -> tuple[list[Case], tuple[int, ...]]:
    if not axes or any(values.ndim != 1 or not values.size for values in axes.values()):
        raise CaseError("a sweep needs at least one parameter, and a row of values for each")
    lengths = [values.size for values in axes.values()]
    if not grid and len(set(lengths)) > 1:
        names = ", ".join(axes)
        raise CaseError(f"values of {names} have lengths {lengths}: a list of members needs equal ones")
    combined = itertools.product(*axes.values()) if grid else zip(*axes.values(), strict=True)
    cases = [
        case.replace({name: value.item() for name, value in zip(axes, values, strict=True)})
        for values in combined
    ]
    return cases, tuple(lengths) if grid else (lengths[0],)


def _make_sweep(
    case: Case, axes: dict, shape: tuple[int, ...], members: Mapping[int, Mapping[str, Any]]
) -> Sweep:
    def place(index: int) -> tuple[int, ...]:
        return tuple(int(k) for k in np.unravel_index(index, shape))

    failures = {place(i): m["failure"] for i, m in members.items() if m["failure"]}
    series = {place(i): m["series"] for i, m in members.items()}
    return Sweep(case, dict(axes), over_members(members, shape), failures, series)


def _in_processes(
    cases: Mapping[int, Case], folder: Path, workers: int | None
) -> Iterator[tuple[int, Ended]]:
    """Members as they end, each in a process on a core of its own."""
    cores, workers = _cores(workers)
    children = _Children(folder / "compiled")
    with ThreadPoolExecutor(workers) as pool:
        try:
            jobs = {
                pool.submit(_member, member, folder / f"{i:04d}", cores, children): i
                for i, member in cases.items()
            }
            for job in as_completed(jobs):
                yield jobs[job], job.result()
        except BaseException:
            children.stop()
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _cores(workers: int | None) -> tuple[SimpleQueue[int], int]:
    """Cores to give to members, one after another, and how many members run at a time."""
    here = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else range(os.cpu_count() or 1)
    workers = workers or len(here)
    cores: SimpleQueue[int] = SimpleQueue()
    for k in range(workers):
        cores.put(here[k % len(here)])
    return cores, workers


class _Children:
    """The members' processes, to be stopped together; what one has compiled the next need not."""

    def __init__(self, compiled: Path) -> None:
        self._environment = {
            "XLA_FLAGS": FORWARD_FLAGS,
            "JAX_COMPILATION_CACHE_DIR": str(compiled),
            "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
        } | os.environ
        self._running: set[subprocess.Popen] = set()
        self._lock = threading.Lock()
        self._stopped = False

    def run(self, command: list[str], core: int, log: Path) -> int:
        """Runs a command on one core, its messages going to a file, and returns its exit status."""
        with log.open("w") as messages:
            with self._lock:
                if self._stopped:
                    return -1
                child = subprocess.Popen(command, stdout=messages, stderr=messages, env=self._environment)
                self._running.add(child)
            if hasattr(os, "sched_setaffinity"):
                with contextlib.suppress(ProcessLookupError):
                    os.sched_setaffinity(child.pid, {core})  # before it starts threads of its own
            status = child.wait()
        with self._lock:
            self._running.discard(child)
        return status

    def stop(self) -> None:
        """Ends the processes of all members; their last checkpoints stay."""
        with self._lock:
            self._stopped = True
            for child in self._running:
                child.terminate()


def _member(case: Case, stem: Path, cores: SimpleQueue[int], children: _Children) -> Ended:
    """Runs, or finishes, one member beside the sweep's file."""
    run, toml, log = (stem.with_suffix(suffix) for suffix in (".h5", ".toml", ".log"))
    toml.write_text(case.to_toml(), encoding="utf-8")
    command = [sys.executable, "-m", "jaxsph"]
    begun, ended = _stage(run)
    if begun:
        command += ["resume", str(run), "--t1", repr(case.t1)]
    else:
        command += ["run", str(toml), "--out", str(run), "--overwrite"]
    status = 0
    if not ended:
        core = cores.get()
        try:
            status = children.run([*command, "--quiet", "--no-plot"], core, log)
        finally:
            cores.put(core)
    found, variables = _read_member(run)
    if status:
        found["results"] = {}
        found["failure"] = log.read_text(encoding="utf-8").strip() or f"ended with status {status}"
    return found, variables


def _read_member(run: Path) -> Ended:
    """Results, series and failure in a member's file, and the meaning of each series."""
    try:
        file = RunFile.open(run)
        found = {"results": file.results(), "series": file.series(), "failure": ""}
        return found, file.variables()
    except JaxsphError:
        return {"results": {}, "series": {}, "failure": ""}, {}


def _stage(run: Path) -> tuple[bool, bool]:
    """Whether a member has a checkpoint to go on from, and whether it has ended: a sweep that was stopped
    before it recorded such a member has nothing left to run."""
    try:
        file = RunFile.open(run)
        return file.has_checkpoint(), bool(file.results())
    except FileError:
        return False, False


def _in_batches(
    cases: Mapping[int, Case], folder: Path, size: int, progress: bool
) -> Iterator[tuple[int, Ended]]:
    """Members as they end, up to `size` of them side by side in this process."""
    runs = {i: folder / f"{i:04d}.h5" for i in cases}
    alike: dict[Any, list[int]] = {}
    for i, member in cases.items():
        if _stage(runs[i])[1]:
            yield i, _read_member(runs[i])
        else:
            alike.setdefault(shape(member), []).append(i)
    for batch in (group[k : k + size] for group in alike.values() for k in range(0, len(group), size)):
        given = run_together([cases[i] for i in batch], [runs[i] for i in batch], progress)
        for i, one in zip(batch, given, strict=True):
            found, variables = _read_member(runs[i])
            if isinstance(one, JaxsphError):
                found |= {"results": {}, "failure": str(one)}
            yield i, (found, variables)
