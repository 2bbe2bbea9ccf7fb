"""File of a run in HDF5, and its writer: series, snapshots, checkpoint and results.

Layout (`SCHEMA`):

    attributes             schema, jaxsph_version, case (the whole case as TOML text), machine; run, stage
                           (`journal.Owner`); read (byte up to which the journal's samples are in this file);
                           since (s), if the case was changed during the run
    settings               attributes: settings that determine the shapes of arrays
    numbers                JSON: numbers that determine the run, such as the time step of the case
    scene                  JSON: outlines of the solids, drawn around the particles
    series, energy         samples over the dimension `time`, readable by netCDF tools; each
                           variable with `units` and `long_name`; positions of gauges, sensors
    snapshots/000012       x [N, D], u [N, D], p [N], id [N]; attributes time, step, ...
    checkpoint             the complete state at the end of the series, bit for bit
    progress, results      attributes: progress of the run, and results of the finished run
    notices, labels        JSON: messages of the finished run, and labels of its results

During the run each chunk is appended to the journal next to the file (`output.journal`). From time to time
the new samples are also copied into this file, so that netCDF tools can read them. The total amount copied is
limited to a few times the amount appended. At the end of the run the journal is merged into the file and
removed. Readers see file and journal as one (`output.run_view`).
"""

from __future__ import annotations

import contextlib
import json
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
    plain,
    replace_file,
    tell_write_errors,
    version,
)
from jaxsph.output.journal import Owner
from jaxsph.output.run_groups import (
    Labels,
    describe,
    put_text,
    replace_arrays,
    replace_results,
    take_series,
    write_snapshot,
)
from jaxsph.output.run_reader import RunReader
from jaxsph.output.run_view import View, owner_of, part_of
from jaxsph.output.series_group import over_time, write_coordinates

COPIES = 4
"""Largest number of bytes copied to update the series in the file, per byte appended to the journal."""
SMALL = 1 << 17
"""Size (bytes) below which a file is copied after every chunk to update its series; a copy is then cheap."""


class RunFile(RunReader):
    """HDF5 file of one run, for writing and reading. No file handle stays open between calls."""

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
        scene: Mapping[str, Any] | None = None,
    ) -> RunFile:
        """Creates the file of a run, which has no samples yet, and missing folders of its path.

        **Arguments**: `coordinates`: name -> (dimension, values `[k]`, units, long name), such as
        "gauge_x": ("gauge", [...], "m", "..."); `numbers`: numbers that determine the run, by name;
        `machine`: description of the machine; `scene`: solids and walls to draw (`run.scene`).
        **Raises** FileError if the file exists and `overwrite` is not set, or if it cannot be written.
        """
        run = cls(path)
        if run.path.is_dir():
            raise FileError(f"{path} is a folder; give the name of a file, such as {path}/run.h5")
        if run.path.exists() and not overwrite:
            raise FileError(
                f"{path} already exists; nothing was changed. Give another name with --out, replace "
                f"the file with --overwrite, or continue the run with `jaxsph resume {path}`"
            )
        with tell_write_errors(run.path):
            run.path.parent.mkdir(parents=True, exist_ok=True)
        run._own = Owner(uuid.uuid4().hex, 0)
        with replace_file(run.path, "w") as file:
            file.attrs.update(schema=SCHEMA, jaxsph_version=version(), run=run._own.run, stage=0, read=0)
            file.attrs["machine"] = machine
            describe(file, case_toml, settings, numbers or {})
            put_text(file, "scene", json.dumps(dict(scene or {})))
            write_coordinates(file.create_group("series"), coordinates)
            for name in ("snapshots", "checkpoint", "progress", "results"):
                file.create_group(name)
        with tell_write_errors(run.path):
            journal.remove(run.path)
        return run

    def append(
        self,
        series: Mapping[str, np.ndarray],
        variables: Mapping[str, Variable],
        snapshot: Mapping[str, Any] | None,
        checkpoint: Mapping[str, np.ndarray],
        progress: Mapping[str, float],
    ) -> None:
        """Appends samples and a snapshot and replaces the checkpoint; after a kill, all or nothing is stored.

        **Arguments**: `series`: arrays `[T]` or `[T, k]`, including "time" (s), with the same names in
        every call; `snapshot`: arrays "x", "u" `[N, D]` (m, m/s), "p" `[N]` (Pa), "id" `[N]`, and scalars
        such as "time" (s), "step"; `checkpoint`: arrays by name (dots allowed, no slashes), stored exactly.
        **Raises** FileError if the file cannot be written or another program has continued it, and ValueError
        if the series do not match each other or the stored series.
        """
        series = {name: np.asarray(values) for name, values in series.items()}
        variables = {"time": Variable("s", "time")} | {n: variables[n] for n in series if n in variables}
        _check_series(series, variables)
        if any("/" in name or name in ("", ".") for name in checkpoint):
            raise ValueError(
                f"checkpoint names {sorted(checkpoint)}: a name must not be empty, must not be '.', and must "
                "not contain a slash"
            )
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

    def finish(
        self, results: Mapping[str, float], notices: tuple[str, ...] = (), labels: Labels | None = None
    ) -> None:
        """Stores scalar results, replacing earlier ones, and merges the journal into the file.

        `labels`: text, unit, meaning and group of results outside the package's standard list, by name.
        """
        self._fold(lambda file: replace_results(file, results, notices, labels or {}))

    def fold(self) -> None:
        """Merges the journal into the file of a run that stops before its end time."""
        with self._view() as view:
            left = view.journal is not None
        if left:
            self._fold(lambda file: replace_results(file, {}, (), {}))

    def amend(
        self,
        case_toml: str,
        settings: Mapping[str, int | float],
        numbers: Mapping[str, list[float]],
        since: float,
        checkpoint: Mapping[str, np.ndarray],
    ) -> None:
        """Replaces the case for the time after the checkpoint and removes results and notices, atomically.

        **Arguments**: as for `create`; `since`: time from which results are computed, s; `checkpoint`: arrays
        of the changed checkpoint, by name.
        """

        def change(file: h5py.File) -> None:
            describe(file, case_toml, settings, numbers)
            replace_results(file, {}, (), {})
            # a new stage, so that a run that is still in progress cannot continue in the changed file
            file.attrs.update(since=since, stage=int(file.attrs["stage"]) + 1)
            replace_arrays(file["checkpoint"], checkpoint)

        self._fold(change)

    def _fold(self, change: Callable[[h5py.File], None]) -> None:
        """Merges the journal into the file and applies `change` to the file, in one atomic step."""
        with self._rewritten() as (file, view):
            if view.journal is not None:
                take_series(file, view)
                for head in self._snapshots(view):
                    write_snapshot(file["snapshots"], part_of(view.journal, head, "snapshot"))
                replace_arrays(file["checkpoint"], view.journal.checkpoint())
                file["progress"].attrs.update(view.journal.about["progress"])
                # a new stage: the journal no longer has an owner
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
        """Context with a copy of the file and a view of the original, which the copy replaces at the end."""
        with self._view() as view, replace_file(self.path, "r+") as file:
            self._check_own(file)
            yield file, view

    def _check_own(self, file: h5py.File) -> None:
        """**Raises** FileError if another program has replaced or changed the file, or has merged its journal
        into it."""
        if self._own not in (None, owner_of(file)):
            raise FileError(
                f"{self.path} was replaced, changed or continued by another program, which may still write "
                f"to it. Stop one of the two programs; `jaxsph resume {self.path}` continues from the "
                "state in the file"
            )

    def _continues(self, view: View, series: Mapping[str, np.ndarray]) -> str:
        """Reason why samples do not continue the stored samples; empty if they do.

        **Raises** FileError if another run writes to the file.
        """
        stored, t = view.last_time(), series["time"]
        if stored is None:
            return ""
        if not t[0] > stored:
            raise FileError(
                f"{self.path} has samples up to t = {stored:g} s, but this run is at {t[0]:g} s: "
                "another run writes to the same file. Stop one of the two runs, then continue with "
                f"`jaxsph resume {self.path}`"
            )
        names = set(view.variables())
        if names != set(series):
            return f"the file has the series {sorted(names)}, but the new samples have {sorted(series)}"
        rows = {name: data.shape[1:] for name, data in over_time(view.file)}
        for name, values in series.items():
            if name in rows and rows[name] != values.shape[1:]:
                return f"series {name!r}: stored rows have shape {rows[name]}, not {values.shape[1:]}"
        return ""


def _numbers(values: Mapping[str, float]) -> dict[str, float]:
    return {name: plain(value) for name, value in values.items()}


def _check_series(series: Mapping[str, np.ndarray], variables: Mapping[str, Variable]) -> None:
    if "time" not in series:
        raise ValueError(f'series {sorted(series)} lack "time": add the times of the samples')
    for name, values in series.items():
        if values.ndim not in (1, 2) or len(values) != len(series["time"]):
            raise ValueError(
                f"series {name!r} has shape {values.shape}: must be [T] or [T, k] with "
                f"T = {len(series['time'])}, the number of times"
            )
        if name not in variables:
            raise ValueError(f"series {name!r} has no units: describe it in `variables`")
