"""Many runs of one case: `sweep` over parameters, one member per core or many in one call, in one file that
resumes."""

from __future__ import annotations

import contextlib
import itertools
import math
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
from jaxsph.errors import CaseError, FileError
from jaxsph.output.hdf5 import Variable
from jaxsph.output.sweep_file import StoredSweep, SweepFile, over_members
from jaxsph.study.members import Ended, check_members, one_per_core, run_each, run_in_batches
from jaxsph.study.ownership import case_keys, only_study, refuse_other

BATCH = 8
"""Number of members in one vmapped call on an accelerator, by default."""
MOST_MEMBERS = 100_000
"""Largest number of members of a sweep: each is a run, and its case is checked before any begins."""


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
    executor: Executor | None = None,
    progress: bool = True,
) -> Sweep:
    """Runs a case for every combination of values: on a CPU each member in a process of its own on one core,
    on an accelerator in vmapped batches, on a cluster wherever an executor takes them.

    **Arguments**: `over`: values by dotted name, `{"pto.K_dm": [300, 500], "waves.H": [0.02, 0.04]}`,
    geometry and `t1` included; `grid`: every combination, or one member for each place in lists of equal
    length; `out`: the file. Called again it goes on where it was interrupted: a member's checkpoints lie
    beside the file, in `<out>.members`, until the member has ended. `workers`: members at a time (by
    default one per core). `batch`: in its place, so many members in one vmapped call in this process, as far
    as their arrays have the same shapes. On a CPU a member of a batch takes 1.3 times as long as alone
    (`python -m experiments run bench_batch`), so batches are the default on an accelerator only. `executor`:
    in the place of both, any executor with the interface of `concurrent.futures`, such as Dask's
    `client.get_executor(pure=False)`; its workers must see the folder of `out`. A member whose worker was
    lost goes on from its last checkpoint on the next one. The executor is left open.
    **Returns** all results. A member that fails does not stop the others: see `Sweep.failures`.
    **Raises** CaseError for a member that cannot be built, and for values that are no numbers, before any
    runs; FileError where `out`, or a member in `<out>.members`, is of another sweep, or another process
    runs one with this output.
    """
    batch = _checked_batch(workers, batch, executor)
    axes = {name: _numbers(name, values) for name, values in over.items()}
    cases, shape = _cases(case, axes, grid)
    file = SweepFile(Path(out).resolve())  # workers may be in other folders
    with only_study(file.path):
        members = _run_missing(file, case, axes, shape, cases, _Runner(batch, workers, executor), progress)
    return _make_sweep(case, axes, shape, members)


class _Runner(NamedTuple):
    """Way in which members are run: in batches, by an executor, or each in a process on a core."""

    batch: int | None
    workers: int | None
    executor: Executor | None

    def run(
        self, cases: Mapping[int, Case], folder: Path, stack: contextlib.ExitStack, progress: bool
    ) -> Iterator[tuple[int, Ended]]:
        """Members as they end; what is opened for them closes with the stack."""
        if self.batch is not None:
            return run_in_batches(cases, folder, self.batch, progress)
        executor = self.executor or stack.enter_context(one_per_core(self.workers))
        return run_each(cases, folder, executor)


def _run_missing(
    file: SweepFile,
    case: Case,
    axes: Mapping[str, np.ndarray],
    shape: tuple[int, ...],
    cases: Sequence[Case],
    runner: _Runner,
    progress: bool,
) -> dict[int, Any]:
    """Runs the members that the file does not hold yet, and returns all."""
    members, variables = _ended_before(file, case, axes, shape) if file.path.exists() else ({}, {})
    folder = file.path.with_name(f"{file.path.name}.members")
    check_members(cases, folder)
    folder.mkdir(exist_ok=True)
    missing = {i: member for i, member in enumerate(cases) if i not in members}
    bar = tqdm(total=len(cases), initial=len(members), unit="run", disable=not progress, dynamic_ncols=True)
    with contextlib.ExitStack() as stack:
        ended = runner.run(missing, folder, stack, progress)
        stack.enter_context(contextlib.closing(cast(Any, ended)))
        stack.enter_context(bar)
        for i, (members[i], described) in ended:
            variables = variables | described
            file.write(case.to_toml(), axes, shape, members, variables)
            for part in folder.glob(f"{i:04d}.*"):
                part.unlink()
            bar.update()
            if members[i]["failure"]:
                bar.write(f"member {i}: {members[i]['failure'].splitlines()[0]}")
    shutil.rmtree(folder)
    return members


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
    file: SweepFile, case: Case, axes: Mapping[str, np.ndarray], shape: tuple[int, ...]
) -> tuple[dict[int, Any], dict[str, Variable]]:
    """Members of an earlier call that went well, and what their series are; failed ones are tried again."""
    stored = file.read()
    before = case_keys(stored_case(file.path, stored)) | _told(stored.axes, stored.shape) | stored.about
    now = case_keys(case) | _told(axes, shape)
    refuse_other(file.path, "a sweep of another case or of other values", before, now)
    return {i: m for i, m in stored.members.items() if not m["failure"]}, stored.variables


def _told(axes: Mapping[str, np.ndarray], shape: tuple[int, ...]) -> dict[str, Any]:
    """Axes and shape of a sweep by words of an error."""
    values = {f"values of {name}": values.tolist() for name, values in axes.items()}
    return values | {"parameters in order": [*axes], "members": list(shape)}


def stored_case(path: Path, stored: StoredSweep) -> Case:
    """Case in a sweep's file. **Raises** FileError where it is none of this version."""
    try:
        return Case.from_dict(tomllib.loads(stored.case_toml))
    except (CaseError, tomllib.TOMLDecodeError) as error:
        raise FileError(
            f"{path}: this version does not read its case ({error}); take the version that wrote it, "
            f"{stored.version}"
        ) from None


def read_sweep(path: str | Path) -> Sweep:
    """Results in a sweep's file, whether the sweep has ended or not. **Raises** FileError."""
    stored = SweepFile(path).read()
    return _make_sweep(stored_case(Path(path), stored), stored.axes, stored.shape, stored.members)


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


def _cases(case: Case, axes: Mapping[str, np.ndarray], grid: bool) -> tuple[list[Case], tuple[int, ...]]:
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
