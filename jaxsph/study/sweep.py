"""`sweep`: many runs of one case over parameters, one member per core or in batches, recorded in one file. An
interrupted sweep continues from this file."""

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
"""Default number of members in one vmapped call on an accelerator."""
MOST_MEMBERS = 100_000
"""Largest number of members of a sweep; the cases of all members are checked before the first run."""


@dataclass(frozen=True)
class Sweep:
    """Results of every member over the swept parameters."""

    case: Any
    """Case or program that all members share; None for a sweep of a program that was read from a file."""
    axes: dict[str, np.ndarray]
    """Values of each parameter by dotted name."""
    results: dict[str, np.ndarray]
    """Scalar results over the grid (or list) of members; NaN if a member does not have the result."""
    failures: dict[tuple[int, ...], str]
    """Error messages of the failed members, by their indices; empty if all members succeeded."""
    members: dict[tuple[int, ...], dict[str, np.ndarray]] = field(repr=False)
    """Series of each member by its indices, including "time" (s)."""
    meanings: Meanings = field(repr=False, default=Meanings())
    """Meanings of the series, and labels of results outside the package's standard list."""

    def at(self, place: tuple[int, ...]) -> dict[str, Any]:
        """Values of the parameters of the member with these indices, by name."""
        indices = place if len(place) == len(self.axes) else place * len(self.axes)
        return {name: v[k].item() for (name, v), k in zip(self.axes.items(), indices, strict=True)}

    def words(self, place: tuple[int, ...]) -> str:
        """Values of the parameters of the member with these indices, as a text."""
        return ", ".join(f"{name} = {value:g}" for name, value in self.at(place).items())

    def __getitem__(self, name: str) -> np.ndarray:
        """Scalar result `name` over the members."""
        if name not in self.results:
            raise KeyError(f"no result {name!r}; use one of {', '.join(sorted(self.results))}")
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
    """Runs a case, or a function that returns a `Problem`, for every combination of parameter values.

    On a CPU each member runs in its own process on one core, on an accelerator members run in vmapped
    batches, and on a cluster an executor distributes them.

    **Arguments**: `over`: values by dotted name, `{"pto.K_dm": [300, 500], "waves.H": [0.02, 0.04]}`, or by
    argument of a function; geometry and `t1` can vary too; `grid`: whether to run every combination;
    otherwise the n-th values of all lists, which must be equally long, form member n; `out`: the file. A
    repeated call continues an interrupted sweep from the checkpoints of its unfinished members in
    `<out>.members`. `workers`: number of members at a time (by default one per core). `batch`: instead of
    `workers`, number of members in one vmapped call in this process; only members with equal array shapes
    share a call. On a CPU a member needs 1.2 times as much time in a batch as alone (`python -m experiments
    run bench_batch`), so batches are the default on an accelerator only. `executor`: instead of `workers` and
    `batch`, any executor with the interface of `concurrent.futures`, such as Dask's
    `client.get_executor(pure=False)`. Its workers must see the folder of `out` and the file that defines a
    function. If a worker is lost, another worker continues the member from the last checkpoint. The executor
    is not shut down.
    **Returns** all results. A failed member does not stop the others: see `Sweep.failures`.
    **Raises** CaseError if a member cannot be built or values are not numbers, before any member runs;
    FileError if `out`, or a member in `<out>.members`, belongs to another sweep, or if another process runs a
    sweep with this output.
    """
    source = source_of(given)
    if os.environ.get(ATTACHED):
        raise CaseError(
            f"{source.name}: a member of a sweep started a sweep when it imported its program; put "
            'everything except imports and definitions under if __name__ == "__main__":'
        )
    batch = checked_batch(workers, batch, executor)
    if isinstance(source, Program) and not source.importable:
        batch = batch or 1  # only this process has the function
    axes = {name: _numbers(name, values) for name, values in over.items()}
    sources, shape = _members(source, axes, grid)
    file = SweepFile(Path(out).resolve())  # absolute, as workers may run in other folders
    runner = Runner(batch, workers, executor)
    with only_study(file.path):
        members, meanings = run_missing(file, source, axes, shape, sources, runner, progress)
    return _make_sweep(source, axes, shape, members, meanings)


class Runner(NamedTuple):
    """Way in which members are run: in batches, by an executor, or each in a process on a core."""

    batch: int | None
    workers: int | None
    executor: Executor | None

    def run(
        self, sources: Mapping[int, Source], folder: Path, stack: contextlib.ExitStack, progress: bool
    ) -> Iterator[tuple[int, Ended]]:
        """Runs members and yields them as they end; `stack` closes an executor that is opened for them."""
        if self.batch is not None:
            return run_in_batches(sources, folder, self.batch, progress)
        executor = self.executor or stack.enter_context(one_per_core(self.workers))
        return run_each(sources, folder, executor)


def run_missing(
    file: SweepFile,
    source: Source,
    axes: Mapping[str, np.ndarray],
    shape: tuple[int, ...],
    sources: Sequence[Source],
    runner: Runner,
    progress: bool,
    about: Mapping[str, Any] | None = None,
) -> tuple[dict[int, Any], Meanings]:
    """Runs the members that are not in the file yet; returns all members and the meanings of their series.

    **Arguments**: `source`: case or program that all members share; `sources`: sources of the members, in the
    order of the `axes`; `about`: further settings that identify the study. **Raises** FileError if the file,
    or a member in `<file>.members`, belongs to another study.
    """
    members, meanings, about = {}, Meanings(), dict(about or {})
    if file.path.exists():
        members, meanings = _ended_before(file, source, axes, shape, about)
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
            file.write(source.to_toml(), axes, shape, members, meanings, about)
            for part in folder.glob(f"{i:04d}.*"):
                part.unlink()
            bar.update()
            if members[i]["failure"]:
                bar.write(f"member {i}: {members[i]['failure'].splitlines()[0]}")
    shutil.rmtree(folder)
    return members, meanings


def checked_batch(workers: int | None, batch: int | None, executor: Executor | None) -> int | None:
    """Number of members in a batch; None for separate processes.

    **Raises** CaseError if more than one choice is given, or a number is below 1.
    """
    given = {"batch": batch, "workers": workers, "executor": executor}
    both = [f"{name} = {value}" for name, value in given.items() if value is not None]
    if len(both) > 1:
        raise CaseError(f"{' and '.join(both)}: give only one of batch, workers and executor")
    if batch is not None and batch < 1:
        raise CaseError(f"batch = {batch}: must be 1 or more")
    if workers is not None and workers < 1:
        raise CaseError(f"workers = {workers}: must be 1 or more")
    return batch if both or jax.default_backend() == "cpu" else BATCH


def _ended_before(
    file: SweepFile,
    source: Source,
    axes: Mapping[str, np.ndarray],
    shape: tuple[int, ...],
    about: Mapping[str, Any],
) -> tuple[dict[int, Any], Meanings]:
    """Members that succeeded in an earlier call, and the meanings of their series; others are run again."""
    stored = file.read()
    before = stored_identity(file.path, stored.case_toml, stored.version)
    before = before | _told(stored.axes, stored.shape) | stored.about
    now = identity(source.to_toml()) | _told(axes, shape) | dict(about)
    refuse_other(file.path, "the runs of another study", before, now)
    return {i: m for i, m in stored.members.items() if not m["failure"]}, stored.meanings


def _told(axes: Mapping[str, np.ndarray], shape: tuple[int, ...]) -> dict[str, Any]:
    """Axes and shape of a sweep, by their names in an error message."""
    values = {f"values of {name}": values.tolist() for name, values in axes.items()}
    return values | {"parameters in order": [*axes], "members": list(shape)}


def read_sweep(path: str | Path) -> Sweep:
    """Reads the results of a sweep, complete or not, from a file.

    **Raises** FileError if the file cannot be read.
    """
    stored = SweepFile(path).read()
    stored_identity(Path(path), stored.case_toml, stored.version)  # refuses unreadable versions
    keys = tomllib.loads(stored.case_toml)
    case = None if "program" in keys else Case.from_dict(keys)
    return _make_sweep(case, stored.axes, stored.shape, stored.members, stored.meanings)


def _numbers(name: str, values: Sequence[float]) -> np.ndarray:
    """Values of a parameter as an array. **Raises** CaseError if they are not a list of finite numbers."""
    try:
        found = np.asarray(values)
    except ValueError:  # nested lists of different lengths
        found = np.asarray(None)
    if found.ndim != 1 or not found.size or found.dtype.kind not in "iuf" or not np.all(np.isfinite(found)):
        raise CaseError(
            f"{name} = {values!r}: must be a list of one or more finite numbers; to vary a string, a boolean "
            "or the presence of a key, make one case per value with case.replace and run a sweep of each"
        )
    return found


def _members(
    source: Source, axes: Mapping[str, np.ndarray], grid: bool
) -> tuple[list[Source], tuple[int, ...]]:
    """Source of every member, and the shape of the sweep."""
    if not axes:
        raise CaseError("a sweep needs at least one parameter, with a list of values")
    lengths = [values.size for values in axes.values()]
    count = math.prod(lengths) if grid else lengths[0]
    if count > MOST_MEMBERS:
        made = " x ".join(map(str, lengths)) if grid else count
        raise CaseError(f"{made} members: must be at most {MOST_MEMBERS}; give fewer values")
    if not grid and len(set(lengths)) > 1:
        names = ", ".join(axes)
        raise CaseError(
            f"values of {names} have lengths {lengths}: with grid=False, give lists of equal length"
        )
    combined = itertools.product(*axes.values()) if grid else zip(*axes.values(), strict=True)
    sources = [
        source.replace({name: value.item() for name, value in zip(axes, values, strict=True)})
        for values in combined
    ]
    check_different(sources, [*axes])
    return sources, tuple(lengths) if grid else (lengths[0],)


def check_different(sources: Sequence[Source], names: Sequence[str]) -> None:
    """**Raises** CaseError if the lattice rounds two lengths to the same value, which makes runs equal."""
    found: dict[tuple[Any, ...], Source] = {}
    for member in sources:
        other = found.setdefault(tuple(member.built(name) for name in names), member)
        for name in names:
            if (one := other.value(name)) != (value := member.value(name)):
                raise CaseError(
                    f"{name} = {one:g} and {value:g}: the lattice rounds both to {member.built(name):g} m, "
                    "so the two runs would be identical; give values at least a spacing apart, or reduce dx"
                )


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
