"""Reader of the file and the journal of a run, finished or in progress. See `output.run_file`."""

from __future__ import annotations

import contextlib
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Self

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
    read,
)
from jaxsph.output.journal import Owner
from jaxsph.output.records import Head
from jaxsph.output.run_groups import Labels, snapshot_name, text_of
from jaxsph.output.run_view import View, owner_of, part_of


class Snapshot(dict[str, Any]):
    """Arrays and scalars of one snapshot by name, with the `scene` of its run (see `run.scene`)."""

    def __init__(self, values: dict[str, Any], scene: dict[str, Any]) -> None:
        """Stores the values, and the solids and walls around the particles."""
        super().__init__(values)
        self.scene = scene


class RunReader:
    """Reader of the file of one run. No file handle stays open between calls."""

    path: Path

    def __init__(self, path: str | Path) -> None:
        """Stores the path of a run's file without checking the file; `open` checks it."""
        self.path = Path(path)
        self._index: tuple[Any, list[Head]] = (None, [])
        self._own: Owner | None = None
        """Owner of the file when it was created or opened. If the owner has changed, nothing is written."""

    def __repr__(self) -> str:
        """Class name and path."""
        return f"{type(self).__name__}({str(self.path)!r})"

    @classmethod
    def open(cls, path: str | Path) -> Self:
        """Opens an existing file. **Raises** FileError if it is missing, cut short, or not from jaxsph."""
        run = cls(path)
        check_signature(run.path)
        with open_file(run.path) as file:
            schema = file.attrs.get("schema")
            if schema is None or "jaxsph_version" not in file.attrs:
                raise FileError(
                    f"{path} is an HDF5 file, but not from jaxsph; give a file that `jaxsph run` wrote"
                )
            if file.attrs.get("kind") == "sweep":
                raise FileError(f"{path} is the file of a sweep; give the file of a run")
            if int(schema) > SCHEMA:
                raise FileError(
                    f"{path} was written by jaxsph {file.attrs['jaxsph_version']} in layout {int(schema)}, "
                    f"but this version reads layouts up to {SCHEMA}: install a newer jaxsph"
                )
            run._own = owner_of(file)
        return run

    @contextlib.contextmanager
    def _view(self) -> Iterator[View]:
        # open the journal first: see `journal.beside`
        with journal.beside(self.path) as beside, open_file(self.path) as file:
            ours = beside is not None and beside.owner == owner_of(file)
            yield View(file, beside if ours else None)

    def _attributes(self, group: str) -> dict[str, Any]:
        """Attributes of a group, or of the file for "/"."""
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
        """Description of the machine on which the run began; empty in files written by older versions."""
        return str(self._attributes("/").get("machine", ""))

    @property
    def case_toml(self) -> str:
        """Whole case of the run as TOML text."""
        return str(self._attributes("/")["case"])

    def case_keys(self) -> dict[str, Any]:
        """Keys and values of the case. **Raises** FileError if its text is damaged."""
        try:
            return tomllib.loads(self.case_toml)
        except tomllib.TOMLDecodeError as error:
            raise FileError(
                f"{self.path}: the text of the case is damaged ({error}); restore the file from a copy"
            ) from None

    @property
    def settings(self) -> dict[str, int | float]:
        """Settings that determine the shapes of arrays, by name, as last passed to `create` or `amend`."""
        return self._attributes("settings")

    def numbers(self) -> dict[str, list[float]]:
        """Numbers that determine the run, such as the time step, as last passed to `create` or `amend`."""
        with open_file(self.path) as file:
            return text_of(file, "numbers", {})

    def scene(self) -> dict[str, Any]:
        """Solids and walls drawn around the particles, see `run.scene`; empty in files written by older
        versions."""
        with open_file(self.path) as file:
            return text_of(file, "scene", {})

    @property
    def since(self) -> float:
        """Time of the last change of the case during the run, s; results are computed from this time on."""
        return float(self._attributes("/").get("since", 0.0))

    def progress(self) -> dict[str, float]:
        """Numbers that describe the progress of the run, by name, as passed to the last `append`."""
        with self._view() as view:
            if view.journal is not None:
                return dict(view.journal.about["progress"])
        return self._attributes("progress")

    def results(self) -> dict[str, float]:
        """Scalar results by name; empty if the run has not finished, or was resumed afterwards."""
        with self._view() as view:
            return attributes(view.file["results"]) if view.journal is None else {}

    def notices(self) -> tuple[str, ...]:
        """Notices of the finished run, for example about results that could not be computed."""
        with self._view() as view:
            return tuple(text_of(view.file, "notices", [])) if view.journal is None else ()

    def labels(self) -> Labels:
        """Text, unit, meaning and group of results outside the package's standard list, by name."""
        with self._view() as view:
            return text_of(view.file, "labels", {})

    def series(self) -> dict[str, np.ndarray]:
        """All series by name, `[T]` or `[T, k]`, and "time" (s); empty before the first chunk."""
        with self._view() as view:
            return view.series()

    def variables(self) -> dict[str, Variable]:
        """Meaning of each series (units, long name), by name."""
        with self._view() as view:
            return view.variables()

    def coordinates(self) -> Coordinates:
        """Positions of gauges and sensors, in the form that `create` expects."""
        found = {}
        with open_file(self.path) as file:
            for name, data in file["series"].items():
                if not data.is_scale and dimension(data, 0) != "time":
                    units, long_name = data.attrs["units"], data.attrs["long_name"]
                    found[name] = (dimension(data, 0), read(data), units, long_name)
        return found

    def has_checkpoint(self) -> bool:
        """Whether there is a checkpoint from which the run can be resumed."""
        with self._view() as view:
            return view.journal is not None or len(view.file["checkpoint"]) > 0

    def checkpoint(self) -> dict[str, np.ndarray]:
        """Arrays of the last checkpoint by name, bit for bit; empty before the first checkpoint."""
        with self._view() as view:
            if view.journal is not None:
                return view.journal.checkpoint()
            return {name: read(data) for name, data in view.file["checkpoint"].items()}

    @property
    def snapshot_count(self) -> int:
        """Number of snapshots."""
        with self._view() as view:
            return len(view.file["snapshots"]) + len(self._snapshots(view))

    def snapshot(self, i: int) -> Snapshot:
        """Arrays and scalars of snapshot i, numbered from 0 in order of time; negative i counts from the end.

        **Raises** IndexError if there is no such snapshot.
        """
        count = self.snapshot_count
        if not -count <= i < count:
            asked = f"; give a number from {-count} to {count - 1}" if count else ""
            raise IndexError(f"snapshot {i}: {self.path} has {count} snapshots{asked}")
        i %= count
        with self._view() as view:
            scene = text_of(view.file, "scene", {})
            folded, more = len(view.file["snapshots"]), self._snapshots(view)
            if i >= folded:
                found = part_of(view.journal, more[i - folded], "snapshot")
                return Snapshot({name: a if a.ndim else a.item() for name, a in found.items()}, scene)
            group = view.file["snapshots"][snapshot_name(i)]
            arrays = {name: read(data) for name, data in group.items()}
            return Snapshot(attributes(group) | arrays, scene)

    def snapshot_times(self) -> np.ndarray:
        """Times of the snapshots, s."""
        with self._view() as view:
            times = [attributes(group)["time"] for group in view.file["snapshots"].values()]
            more = self._snapshots(view)
            times += [part_of(view.journal, head, "snapshot", "time")["time"] for head in more]
            return np.asarray(times, np.float64)

    def _snapshots(self, view: View) -> list[Head]:
        """Heads of the journal's chunks that contain a snapshot."""
        if view.journal is None:
            return []
        key = (view.owner, view.journal.about["end"])
        if self._index[0] != key:
            heads = view.journal.heads()
            self._index = key, [h for h in heads if any(n.startswith("snapshot/") for n in h.arrays)]
        return self._index[1]
