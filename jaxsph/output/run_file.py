"""The file of a run: series, snapshots, checkpoint and results in HDF5.

Layout (`SCHEMA`):

    attributes             schema, jaxsph_version, case (the whole case as TOML text), machine, run, stage,
                           read; since (s), of a run whose case was changed
    settings               attributes: what fixed the arrays' shapes
    numbers                JSON: numbers that decide the run, such as the time step made of the case
    series, energy         samples over the dimension `time`, readable by netCDF tools; each
                           variable with `units` and `long_name`; positions of gauges, sensors
    snapshots/000012       x [N, D], u [N, D], p [N], id [N]; attributes time, step, ...
    checkpoint             all that evolves, bit for bit, at the end of the series
    progress, results      attributes: numbers of the run so far, and of the finished run
    notices                JSON: messages of the finished run

While the run goes on, a chunk is appended to the journal beside the file (`output.journal`), and the series
are brought up to date here from time to time, for netCDF tools: never is more copied than a few times what
was appended. The end of the run folds the journal into the file, which then is the only one. Readers see
file and journal as one (`output.run_view`).
"""

from __future__ import annotations

import contextlib
import tomllib
import uuid
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from jaxsph.errors import FileError
from jaxsph.output import journal
from jaxsph.output.hdf5 import (
    SCHEMA,
    Coordinates,
    Variable,
    attributes,
    check_signature,
    dimension,
    open_file,
    plain,
    read,
    replace_file,
    tell_write_errors,
    version,
)
from jaxsph.output.journal import Owner
from jaxsph.output.records import Head
from jaxsph.output.run_groups import (
    describe,
    replace_arrays,
    replace_results,
    snapshot_name,
    take_series,
    text_of,
    write_snapshot,
)
from jaxsph.output.run_view import View, owner_of, part_of
from jaxsph.output.series_group import over_time, write_coordinates

COPIES = 4
"""Bytes that may be copied to keep the file's series up to date, over the bytes that were appended."""
SMALL = 1 << 17
"""Size up to which a file is copied at every chunk, bytes: a copy takes as long as opening it."""


class RunFile:
    """One HDF5 file of a run. Holds only the path: no handle stays open between calls."""

    path: Path

    def __init__(self, path: str | Path) -> None:
        """Names a run's file and does not check it, as `create` and `open` do."""
        self.path = Path(path)
        self._index: tuple[Any, list[Head]] = (None, [])
        self._own: Owner | None = None
        """Owner of the file when it was made or opened; a file that has another by then is left alone."""

    def __repr__(self) -> str:
        """The class and its path."""
        return f"RunFile({str(self.path)!r})"

    # --- making and opening

    @classmethod
    def create(
        cls,
        path: str | Path,
        case_toml: str,
        settings: Mapping[str, int | float],
        coordinates: Coordinates,
        overwrite: bool = False,
        numbers: Mapping[str, list[float]] | None = None,
        machine: str = "",
    ) -> RunFile:
        """New file of a run without samples; folders are made as needed.

        **Arguments**: `coordinates`: name -> (dimension, values `[k]`, units, long name), such as
        "gauge_x": ("gauge", [...], "m", "..."); `numbers`: what decides the run, by name; `machine`: what it
        begins on, in words.
        **Raises** FileError where the file exists (and not `overwrite`) or cannot be written.
        """
        run = cls(path)
        if run.path.is_dir():
            raise FileError(f"{path}: is a folder; give the name of a file, such as {path}/run.h5")
        if run.path.exists() and not overwrite:
            raise FileError(
                f"{path}: exists already, and nothing was changed. Give another name with --out, "
                f"replace it with --overwrite, or go on with it by `jaxsph resume {path}`"
            )
        with tell_write_errors(run.path):
            run.path.parent.mkdir(parents=True, exist_ok=True)
        run._own = Owner(uuid.uuid4().hex, 0)
        with replace_file(run.path, "w") as file:
            file.attrs.update(schema=SCHEMA, jaxsph_version=version(), run=run._own.run, stage=0, read=0)
            file.attrs["machine"] = machine
            describe(file, case_toml, settings, numbers or {})
            write_coordinates(file.create_group("series"), coordinates)
            for name in ("snapshots", "checkpoint", "progress", "results"):
                file.create_group(name)
        with tell_write_errors(run.path):
            journal.remove(run.path)
        return run

    @classmethod
    def open(cls, path: str | Path) -> RunFile:
        """Existing file of a run. **Raises** FileError where it is missing, cut short, or not a run's."""
        run = cls(path)
        check_signature(run.path)
        with open_file(run.path) as file:
            schema = file.attrs.get("schema")
            if schema is None or "jaxsph_version" not in file.attrs:
                raise FileError(
                    f"{path}: is an HDF5 file, but not one of jaxsph; give a file that `jaxsph run` wrote"
                )
            if int(schema) > SCHEMA:
                raise FileError(
                    f"{path}: has layout {int(schema)} of jaxsph {file.attrs['jaxsph_version']}, "
                    f"and this version reads layouts up to {SCHEMA}; install a newer jaxsph"
                )
            run._own = owner_of(file)
        return run

    # --- writing

    def append(
        self,
        series: Mapping[str, np.ndarray],
        variables: Mapping[str, Variable],
        snapshot: Mapping[str, Any] | None,
        checkpoint: Mapping[str, np.ndarray],
        progress: Mapping[str, float],
    ) -> None:
        """Adds samples and a snapshot and replaces the checkpoint: all of it, or after a kill nothing.

        **Arguments**: `series`: arrays `[T]` or `[T, k]` with "time" (s) among them, the same names
        at every call; `snapshot`: arrays "x", "u" `[N, D]` (m, m/s), "p" `[N]` (Pa), "id" `[N]`, and scalars
        such as "time" (s), "step"; `checkpoint`: arrays by name (dots allowed, no slashes), kept to the bit.
        **Raises** FileError where the file cannot be written or has gone on without this run, and
        ValueError for series that do not belong together.
        """
        series = {name: np.asarray(values) for name, values in series.items()}
        variables = {"time": Variable("s", "time")} | {n: variables[n] for n in series if n in variables}
        _check_series(series, variables)
        if any("/" in name or name in ("", ".") for name in checkpoint):
            raise ValueError(f"checkpoint names {sorted(checkpoint)}: none may be empty, '.' or hold a slash")
        parts = {"series": series, "snapshot": snapshot or {}}
        chunk = {f"{part}/{name}": np.asarray(a) for part, all_ in parts.items() for name, a in all_.items()}
        with self._view() as view:
            self._check_own(view.file)
            wrong = self._continues(view, series)
            owner, known = view.owner, view.journal is not None
            end = view.journal.about["end"] if known else 0
            first, read = "time" not in view.file["series"], int(view.file.attrs["read"])
        if wrong:
            raise ValueError(wrong)
        about = {"time": float(series["time"][-1]), "progress": _numbers(progress)}
        with tell_write_errors(self.path):
            if not known:
                described = {n: [v.units, v.long_name, v.dim, v.group] for n, v in variables.items()}
                end = journal.begin(self.path, owner, described)
            end = journal.append(self.path, owner, end, chunk, checkpoint, about)
            size = self.path.stat().st_size
        if first or size < SMALL or COPIES * (end - read) > size:
            self._bring_up_to_date()

    def finish(self, results: Mapping[str, float], notices: tuple[str, ...] = ()) -> None:
        """Records scalar results in the place of any earlier ones, and folds the journal into the file."""
        self._fold(lambda file: replace_results(file, results, notices))

    def fold(self) -> None:
        """Folds the journal into the file of a run that stops before its end."""
        with self._view() as view:
            left = view.journal is not None
        if left:
            self._fold(lambda file: replace_results(file, {}, ()))

    def amend(
        self,
        case_toml: str,
        settings: Mapping[str, int | float],
        numbers: Mapping[str, list[float]],
        since: float,
        checkpoint: Mapping[str, np.ndarray],
    ) -> None:
        """Replaces the case from the checkpoint on, and removes results and notices, all in one write.

        **Arguments**: those of `create`; `since`: time from which results count, s; the changed checkpoint.
        """

        def change(file: h5py.File) -> None:
            describe(file, case_toml, settings, numbers)
            replace_results(file, {}, ())
            # another stage: a run that is still in progress must not go on in the changed file
            file.attrs.update(since=since, stage=int(file.attrs["stage"]) + 1)
            replace_arrays(file["checkpoint"], checkpoint)

        self._fold(change)

    def _fold(self, change: Callable[[h5py.File], None]) -> None:
        """Takes the journal into the file, with a change to it, in one step."""
        with self._rewritten() as (file, view):
            if view.journal is not None:
                take_series(file, view)
                for head in self._snapshots(view):
                    write_snapshot(file["snapshots"], part_of(view.journal, head, "snapshot"))
                replace_arrays(file["checkpoint"], view.journal.checkpoint())
                file["progress"].attrs.update(view.journal.about["progress"])
                # from here on the journal has no owner
                file.attrs.update(stage=int(file.attrs["stage"]) + 1, read=0)
            change(file)
            owner = owner_of(file)
        self._own = self._own and owner
        with tell_write_errors(self.path):
            journal.remove(self.path)

    def _bring_up_to_date(self) -> None:
        with self._rewritten() as (file, view):
            take_series(file, view)
            file.attrs["read"] = view.journal.about["end"]

    @contextlib.contextmanager
    def _rewritten(self) -> Iterator[tuple[h5py.File, View]]:
        """Copy of the file to change, which takes its place, and the view of file and journal as they are."""
        with self._view() as view, replace_file(self.path, "r+") as file:
            self._check_own(file)
            yield file, view

    def _check_own(self, file: h5py.File) -> None:
        """**Raises** FileError where another run has taken the file, or has changed or folded it."""
        if self._own not in (None, owner_of(file)):
            raise FileError(
                f"{self.path}: belongs to another run by now, or has gone on without this one: another "
                f"program writes to it. Stop one of them; `jaxsph resume {self.path}` goes on with what the "
                "file holds"
            )

    def _continues(self, view: View, series: Mapping[str, np.ndarray]) -> str:
        """Why samples do not go on from those that are there; empty where they do.

        **Raises** FileError where another run writes to the file.
        """
        stored, t = view.last_time(), series["time"]
        if stored is None:
            return ""
        if not t[0] > stored:
            raise FileError(
                f"{self.path}: holds samples up to t = {stored:g} s, and this run is at {t[0]:g} s: "
                "another run writes to the same file. Stop one of them, then `jaxsph resume` the file"
            )
        names = set(view.variables())
        if names != set(series):
            return f"the file has series {sorted(names)}, not {sorted(series)}"
        rows = {name: data.shape[1:] for name, data in over_time(view.file)}
        for name, values in series.items():
            if name in rows and rows[name] != values.shape[1:]:
                return f"series {name!r}: rows of {rows[name]}, not {values.shape[1:]}"
        return ""

    # --- reading

    @contextlib.contextmanager
    def _view(self) -> Iterator[View]:
        # the journal first: see `journal.beside`
        with journal.beside(self.path) as beside, open_file(self.path) as file:
            ours = beside is not None and beside.owner == owner_of(file)
            yield View(file, beside if ours else None)

    def _attributes(self, group: str) -> dict[str, Any]:
        """Attributes of a group, "/" for the file's own."""
        with open_file(self.path) as file:
            return attributes(file[group])

    @property
    def schema(self) -> int:
        """Version of the file's layout."""
        return int(self._attributes("/")["schema"])

    @property
    def version(self) -> str:
        """Version of jaxsph that made the file."""
        return str(self._attributes("/")["jaxsph_version"])

    @property
    def machine(self) -> str:
        """What the run began on, in words; empty in files of older versions."""
        return str(self._attributes("/").get("machine", ""))

    @property
    def case_toml(self) -> str:
        """Whole case of the run as TOML text."""
        return str(self._attributes("/")["case"])

    def case_keys(self) -> dict[str, Any]:
        """Keys and values of the case. **Raises** FileError where its text is damaged."""
        try:
            return tomllib.loads(self.case_toml)
        except tomllib.TOMLDecodeError as error:
            raise FileError(f"{self.path}: the text of its case is damaged ({error})") from None

    @property
    def settings(self) -> dict[str, int | float]:
        """Numbers that fixed the arrays' shapes, by name, as given to `create`, or to `amend` after it."""
        return self._attributes("settings")

    def numbers(self) -> dict[str, list[float]]:
        """Numbers that decide the run, such as its time step, by name, as given to `create` or `amend`."""
        with open_file(self.path) as file:
            return text_of(file, "numbers", {})

    @property
    def since(self) -> float:
        """Time of the last change of the case in the course of its run, from which results count, s."""
        return float(self._attributes("/").get("since", 0.0))

    def progress(self) -> dict[str, float]:
        """Numbers of the run so far, by name, as given to the last `append`."""
        with self._view() as view:
            if view.journal is not None:
                return dict(view.journal.about["progress"])
        return self._attributes("progress")

    def results(self) -> dict[str, float]:
        """Scalar results by name; empty for a run that has not finished, or has gone on since."""
        with self._view() as view:
            return attributes(view.file["results"]) if view.journal is None else {}

    def notices(self) -> tuple[str, ...]:
        """Notices of the finished run, such as of results that could not be made."""
        with self._view() as view:
            return tuple(text_of(view.file, "notices", [])) if view.journal is None else ()

    def series(self) -> dict[str, np.ndarray]:
        """Series by name, `[T]` or `[T, k]`, of both groups, with "time" (s); empty at first."""
        with self._view() as view:
            return view.series()

    def variables(self) -> dict[str, Variable]:
        """Meaning of each series (units, long name), by name."""
        with self._view() as view:
            return view.variables()

    def coordinates(self) -> Coordinates:
        """Positions of gauges and sensors, in the form that `create` takes."""
        found = {}
        with open_file(self.path) as file:
            for name, data in file["series"].items():
                if not data.is_scale and dimension(data, 0) != "time":
                    units, long_name = data.attrs["units"], data.attrs["long_name"]
                    found[name] = (dimension(data, 0), read(data), units, long_name)
        return found

    def has_checkpoint(self) -> bool:
        """Whether there is a checkpoint to go on from."""
        with self._view() as view:
            return view.journal is not None or len(view.file["checkpoint"]) > 0

    def checkpoint(self) -> dict[str, np.ndarray]:
        """Arrays of the last checkpoint by name, bit for bit; empty before the first."""
        with self._view() as view:
            if view.journal is not None:
                return view.journal.checkpoint()
            return {name: read(data) for name, data in view.file["checkpoint"].items()}

    @property
    def snapshot_count(self) -> int:
        """Number of snapshots."""
        with self._view() as view:
            return len(view.file["snapshots"]) + len(self._snapshots(view))

    def snapshot(self, i: int) -> dict[str, Any]:
        """Arrays and scalars of snapshot i, in order of writing; negative i counts from the end.

        **Raises** IndexError where there is none.
        """
        count = self.snapshot_count
        if not -count <= i < count:
            raise IndexError(f"snapshot {i}: {self.path} holds {count}")
        i %= count
        with self._view() as view:
            folded, more = len(view.file["snapshots"]), self._snapshots(view)
            if i >= folded:
                found = part_of(view.journal, more[i - folded], "snapshot")
                return {name: a if a.ndim else a.item() for name, a in found.items()}
            group = view.file["snapshots"][snapshot_name(i)]
            return attributes(group) | {name: read(data) for name, data in group.items()}

    def snapshot_times(self) -> np.ndarray:
        """Times of the snapshots, s."""
        with self._view() as view:
            times = [attributes(group)["time"] for group in view.file["snapshots"].values()]
            more = self._snapshots(view)
            times += [part_of(view.journal, head, "snapshot", "time")["time"] for head in more]
            return np.asarray(times, np.float64)

    def _snapshots(self, view: View) -> list[Head]:
        """Chunks of the journal that hold a snapshot."""
        if view.journal is None:
            return []
        key = (view.owner, view.journal.about["end"])
        if self._index[0] != key:
            heads = view.journal.heads()
            self._index = key, [h for h in heads if any(n.startswith("snapshot/") for n in h.arrays)]
        return self._index[1]


def _numbers(values: Mapping[str, float]) -> dict[str, float]:
    return {name: plain(value) for name, value in values.items()}


def _check_series(series: Mapping[str, np.ndarray], variables: Mapping[str, Variable]) -> None:
    if "time" not in series:
        raise ValueError(f'series {sorted(series)} lack "time"')
    for name, values in series.items():
        if values.ndim not in (1, 2) or len(values) != len(series["time"]):
            raise ValueError(f"series {name!r} of shape {values.shape} does not go with its times")
        if name not in variables:
            raise ValueError(f"series {name!r} has no units: describe it in `variables`")
