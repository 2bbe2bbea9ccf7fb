"""Many runs of one case: `sweep` over parameters, one member per core or many in one call, in one file that
resumes."""

from __future__ import annotations

import contextlib
import itertools
import math
import os
import shutil
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, cast

import jax
import numpy as np
from tqdm import tqdm

from jaxsph.case.case import Case
from jaxsph.errors import CaseError
from jaxsph.output.sweep_file import Meanings, SweepFile, over_members
from jaxsph.problem.program import Program
from jaxsph.problem.source import Source, identity
from jaxsph.problem.sources import source_of
from jaxsph.run.interrupt import ATTACHED
from jaxsph.run.stored import stored_identity
from jaxsph.study.members import Ended, check_members, one_per_core, run_each, run_in_batches
from jaxsph.study.ownership import only_study, refuse_other

BATCH = 8
"""Number of members in one vmapped call on an accelerator, by default."""
MOST_MEMBERS = 100_000
"""Largest number of members of a sweep: each is a run, and its case is checked before any begins."""


@dataclass(frozen=True)
class Sweep:
    """Results of every member over the swept parameters."""

    case: Any
    """Case that all members share, or program; None for that of a program whose file was read."""
    axes: dict[str, np.ndarray]
    """Values of each parameter by dotted name."""
    results: dict[str, np.ndarray]
    """Scalar results over the grid (or list) of members; NaN where a member has none."""
    failures: dict[tuple[int, ...], str]
    """Error messages of the members that failed, by their place; empty where all went well."""
    members: dict[tuple[int, ...], dict[str, np.ndarray]] = field(repr=False)
    """Series of each member by its place, "time" (s) among them."""
    meanings: Meanings = field(repr=False, default=Meanings())
    """Meanings of the series, and of results that brought labels with them."""

    def __getitem__(self, name: str) -> np.ndarray:
        """Scalar result called `name`, over the members."""
        if name not in self.results:
            raise KeyError(f"no result {name!r}; there are {', '.join(sorted(self.results))}")
        return self.results[name]


def sweep(
    given: Any,
    over: Mapping[str, Sequence[float]],
    out: str | Path,
    *,
    grid: bool = True,
    workers: int | None = None,
    batch: int | None = None,
    executor: Executor | None = None,
    progress: bool = True,
) -> Sweep:
    """Runs a case, or a function that returns a `Problem`, for every combination of values: on a CPU each
    member in a process of its own on one core, on an accelerator in vmapped batches, on a cluster wherever an
    executor takes them.

    **Arguments**: `over`: values by dotted name, `{"pto.K_dm": [300, 500], "waves.H": [0.02, 0.04]}`, of a
    function by argument, geometry and `t1` included; `grid`: every combination, or one member for each place
    in lists of equal length; `out`: the file. Called again it goes on where it was interrupted: a member's
    checkpoints lie beside the file, in `<out>.members`, until the member has ended. `workers`: members at a
    time (by default one per core). `batch`: in its place, so many members in one vmapped call in this
    process, as far as their arrays have the same shapes. On a CPU a member of a batch takes 1.3 times as long
    as alone (`python -m experiments run bench_batch`), so batches are the default on an accelerator only.
    `executor`: in the place of both, any executor with the interface of `concurrent.futures`, such as Dask's
    `client.get_executor(pure=False)`; its workers must see the folder of `out`, and a function's file. A
    member whose worker was lost goes on from its last checkpoint on the next one. The executor is left open.
    **Returns** all results. A member that fails does not stop the others: see `Sweep.failures`.
    **Raises** CaseError for a member that cannot be built, and for values that are no numbers, before any
    runs; FileError where `out`, or a member in `<out>.members`, is of another sweep, or another process
    runs one with this output.
    """
    source = source_of(given)
    if os.environ.get(ATTACHED):
        raise CaseError(
            f"{source.name}: a member of a sweep has begun a sweep when its program was imported: put what "
            'the program does beside defining functions under if __name__ == "__main__":'
        )
    batch = _checked_batch(workers, batch, executor)
    if isinstance(source, Program) and not source.importable:
        batch = batch or 1  # in this process, which alone has the function
    axes = {name: _numbers(name, values) for name, values in over.items()}
    sources, shape = _members(source, axes, grid)
    file = SweepFile(Path(out).resolve())  # workers may be in other folders
    runner = _Runner(batch, workers, executor)
    with only_study(file.path):
        members, meanings = _run_missing(file, source, axes, shape, sources, runner, progress)
    return _make_sweep(source, axes, shape, members, meanings)


class _Runner(NamedTuple):
    """Way in which members are run: in batches, by an executor, or each in a process on a core."""

    batch: int | None
    workers: int | None
    executor: Executor | None

    def run(
        self, sources: Mapping[int, Source], folder: Path, stack: contextlib.ExitStack, progress: bool
    ) -> Iterator[tuple[int, Ended]]:
        """Members as they end; what is opened for them closes with the stack."""
        if self.batch is not None:
            return run_in_batches(sources, folder, self.batch, progress)
        executor = self.executor or stack.enter_context(one_per_core(self.workers))
        return run_each(sources, folder, executor)


def _run_missing(
    file: SweepFile,
    source: Source,
    axes: Mapping[str, np.ndarray],
    shape: tuple[int, ...],
    sources: Sequence[Source],
    runner: _Runner,
    progress: bool,
) -> tuple[dict[int, Any], Meanings]:
    """Runs the members that the file does not hold yet; returns all, and their meanings."""
    members, meanings = {}, Meanings()
    if file.path.exists():
        members, meanings = _ended_before(file, source, axes, shape)
    folder = file.path.with_name(f"{file.path.name}.members")
    check_members(sources, folder)
    folder.mkdir(exist_ok=True)
    missing = {i: member for i, member in enumerate(sources) if i not in members}
    bar = tqdm(total=len(sources), initial=len(members), unit="run", disable=not progress, dynamic_ncols=True)
    with contextlib.ExitStack() as stack:
        ended = runner.run(missing, folder, stack, progress)
        stack.enter_context(contextlib.closing(cast(Any, ended)))
        stack.enter_context(bar)
        for i, (members[i], described) in ended:
            meanings = meanings.joined(described)
            file.write(source.to_toml(), axes, shape, members, meanings)
            for part in folder.glob(f"{i:04d}.*"):
                part.unlink()
            bar.update()
            if members[i]["failure"]:
                bar.write(f"member {i}: {members[i]['failure'].splitlines()[0]}")
    shutil.rmtree(folder)
    return members, meanings


def _checked_batch(workers: int | None, batch: int | None, executor: Executor | None) -> int | None:
    """Size of batches, None for members apart. **Raises** CaseError for choices that exclude each other."""
    given = {"batch": batch, "workers": workers, "executor": executor}
    both = [f"{name} = {value}" for name, value in given.items() if value is not None]
    if len(both) > 1:
        raise CaseError(f"{' and '.join(both)}: one of batch, workers and executor goes without the others")
    if batch is not None and batch < 1:
        raise CaseError(f"batch = {batch}: must be 1 or more")
    if workers is not None and workers < 1:
        raise CaseError(f"workers = {workers}: must be 1 or more")
    return batch if both or jax.default_backend() == "cpu" else BATCH


def _ended_before(
    file: SweepFile, source: Source, axes: Mapping[str, np.ndarray], shape: tuple[int, ...]
) -> tuple[dict[int, Any], Meanings]:
    """Members of an earlier call that went well, and their meanings; failed ones are tried again."""
    stored = file.read()
    before = stored_identity(file.path, stored.case_toml, stored.version)
    before = before | _told(stored.axes, stored.shape) | stored.about
    now = identity(source.to_toml()) | _told(axes, shape)
    refuse_other(file.path, "a sweep of another case or of other values", before, now)
    return {i: m for i, m in stored.members.items() if not m["failure"]}, stored.meanings


def _told(axes: Mapping[str, np.ndarray], shape: tuple[int, ...]) -> dict[str, Any]:
    """Axes and shape of a sweep by words of an error."""
    values = {f"values of {name}": values.tolist() for name, values in axes.items()}
    return values | {"parameters in order": [*axes], "members": list(shape)}


def read_sweep(path: str | Path) -> Sweep:
    """Results in a sweep's file, whether the sweep has ended or not. **Raises** FileError."""
    stored = SweepFile(path).read()
    stored_identity(Path(path), stored.case_toml, stored.version)  # refuses what this version does not read
    keys = tomllib.loads(stored.case_toml)
    case = None if "program" in keys else Case.from_dict(keys)
    return _make_sweep(case, stored.axes, stored.shape, stored.members, stored.meanings)


def _numbers(name: str, values: Sequence[float]) -> np.ndarray:
    """Values of a parameter as an array. **Raises** CaseError for what is no row of finite numbers."""
    try:
        found = np.asarray(values)
    except ValueError:  # rows of several lengths
        found = np.asarray(None)
    if found.ndim != 1 or not found.size or found.dtype.kind not in "iuf" or not np.all(np.isfinite(found)):
        raise CaseError(
            f"{name} = {values!r}: a sweep goes over a row of finite numbers; for texts, switches and absent "
            "keys run a sweep of each case, made by case.replace"
        )
    return found


def _members(
    source: Source, axes: Mapping[str, np.ndarray], grid: bool
) -> tuple[list[Source], tuple[int, ...]]:
    """What every member runs, and the shape of the sweep."""
    if not axes:
        raise CaseError("a sweep needs at least one parameter, and a row of values for it")
    lengths = [values.size for values in axes.values()]
    count = math.prod(lengths) if grid else lengths[0]
    if count > MOST_MEMBERS:
        raise CaseError(f"{' x '.join(map(str, lengths))} members: a sweep has at most {MOST_MEMBERS}")
    if not grid and len(set(lengths)) > 1:
        names = ", ".join(axes)
        raise CaseError(f"values of {names} have lengths {lengths}: a list of members needs equal ones")
    combined = itertools.product(*axes.values()) if grid else zip(*axes.values(), strict=True)
    sources = [
        source.replace({name: value.item() for name, value in zip(axes, values, strict=True)})
        for values in combined
    ]
    return sources, tuple(lengths) if grid else (lengths[0],)


def _make_sweep(
    case: Source | None,
    axes: dict,
    shape: tuple[int, ...],
    members: Mapping[int, Mapping[str, Any]],
    meanings: Meanings,
) -> Sweep:
    def place(index: int) -> tuple[int, ...]:
        return tuple(int(k) for k in np.unravel_index(index, shape))

    failures = {place(i): m["failure"] for i, m in members.items() if m["failure"]}
    series = {place(i): m["series"] for i, m in members.items()}
    return Sweep(case, dict(axes), over_members(members, shape), failures, series, meanings)
