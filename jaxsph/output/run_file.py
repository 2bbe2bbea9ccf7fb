"""Files: one HDF5 file for each run or sweep, and a run's export for ParaView.

Layout of a run's file (`SCHEMA`):

    attributes             schema, jaxsph_version, case (the whole case as TOML text)
    settings               attributes: what fixed the arrays' shapes
    series, energy         samples over the dimension `time`, readable by netCDF tools; each
                           variable with `units` and `long_name`; positions of gauges, sensors
    snapshots/000012       x [N, D], u [N, D], p [N], id [N]; attributes time, step, ...
    checkpoint             all that evolves, bit for bit, at the end of the series
    progress, results      attributes: numbers of the run so far, and of the finished run

Every write goes to a copy that then takes the file's place, so a kill at any moment leaves the old
file or the new one, whole.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from jaxsph.errors import FileError
from jaxsph.output.hdf5 import (
    SCHEMA,
    Coordinates,
    Variable,
    _check_signature,
    _dimension,
    _exact,
    _plain,
    _reading,
    _replacing,
    _scale,
    _version,
    _writing,
)

_SNAPSHOT_UNITS = {"x": "m", "u": "m s-1", "p": "Pa", "id": "1"}


class RunFile:
    """One HDF5 file of a run. Holds only the path: no handle stays open between calls."""

    path: Path

    def __init__(self, path: str | Path) -> None:
        """Use `create` or `open`: they check the file."""
        self.path = Path(path)

    def __repr__(self) -> str:
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
        version: str | None = None,
    ) -> RunFile:
        """A new file without samples; folders are made as needed.

        **Arguments**: `coordinates`: name -> (dimension, values `[k]`, units, long name), such as
        "gauge_x": ("gauge", [...], "m", "..."); `version`: of jaxsph, by default the installed one.
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
        with _writing(run.path):
            run.path.parent.mkdir(parents=True, exist_ok=True)
        with _replacing(run.path, "w") as file:
            file.attrs["schema"] = SCHEMA
            file.attrs["jaxsph_version"] = version or _version()
            file.attrs["case"] = case_toml
            file.create_group("settings").attrs.update(settings)
            _write_coordinates(file.create_group("series"), coordinates)
            for name in ("snapshots", "checkpoint", "progress", "results"):
                file.create_group(name)
        return run

    @classmethod
    def open(cls, path: str | Path) -> RunFile:
        """An existing file. **Raises** FileError where it is missing, cut short, or not a run's."""
        run = cls(path)
        _check_signature(run.path)
        with run._reading() as file:
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
        return run

    # --- writing

    def append(
        self,
        series: Mapping[str, np.ndarray],
        variables: Mapping[str, Variable],
        energy: set[str],
        snapshot: Mapping[str, Any] | None,
        checkpoint: Mapping[str, np.ndarray],
        progress: Mapping[str, float],
    ) -> None:
        """Adds samples and a snapshot and replaces the checkpoint, all in one atomic write.

        **Arguments**: `series`: arrays `[T]` or `[T, k]` with "time" (s) among them, the same names
        at every call; `energy`: names that go to the group `energy`; `snapshot`: arrays "x", "u"
        `[N, D]` (m, m/s), "p" `[N]` (Pa), "id" `[N]`, and scalars such as "time" (s), "step";
        `checkpoint`: arrays by name (dots allowed, slashes not), kept bit for bit.
        **Raises** FileError where the file cannot be written or has gone on without this run, and
        ValueError for series that do not belong together.
        """
        series = {name: np.asarray(values) for name, values in series.items()}
        _check_series(series, variables)
        with _replacing(self.path, "r+") as file:
            _check_continues(self.path, file, series["time"])
            groups = {"series": set(series) - energy - {"time"}, "energy": set(series) & energy}
            for group, names in groups.items():
                if names or group == "series":
                    chosen = {name: series[name] for name in sorted(names)}
                    _extend(file.require_group(group), series["time"], chosen, variables)
            if snapshot is not None:
                _write_snapshot(file["snapshots"], snapshot)
            _replace_arrays(file["checkpoint"], checkpoint)
            file["progress"].attrs.update(progress)

    def finish(self, results: Mapping[str, float]) -> None:
        """Records scalar results, in the place of those of an earlier end."""
        with _replacing(self.path, "r+") as file:
            attributes = file["results"].attrs
            for name in list(attributes):
                del attributes[name]
            attributes.update({name: float(value) for name, value in results.items()})

    # --- reading

    def _reading(self) -> contextlib.AbstractContextManager[h5py.File]:
        return _reading(self.path)

    def _attributes(self, group: str) -> dict[str, Any]:
        with self._reading() as file:
            return {name: _plain(value) for name, value in file[group].attrs.items()}

    @property
    def case_toml(self) -> str:
        """The whole case as TOML text."""
        with self._reading() as file:
            return str(file.attrs["case"])

    @property
    def settings(self) -> dict[str, int | float]:
        """What `create` was given."""
        return self._attributes("settings")

    def progress(self) -> dict[str, float]:
        """What the last `append` was given."""
        return self._attributes("progress")

    def results(self) -> dict[str, float]:
        """Scalar results; empty for a run that has not finished."""
        return self._attributes("results")

    def series(self) -> dict[str, np.ndarray]:
        """Every series, `[T]` or `[T, k]`, of both groups, with "time" (s); empty at first."""
        with self._reading() as file:
            return {name: data[()] for name, data in _over_time(file)}

    def variables(self) -> dict[str, Variable]:
        """What each series is."""
        found = {}
        with self._reading() as file:
            for name, data in _over_time(file):
                dim = _dimension(data, 1) if data.ndim == 2 else None
                found[name] = Variable(data.attrs["units"], data.attrs["long_name"], dim)
        return found

    def coordinates(self) -> Coordinates:
        """Gauge and sensor positions, in the form that `create` takes."""
        found = {}
        with self._reading() as file:
            for name, data in file["series"].items():
                if not data.is_scale and _dimension(data, 0) != "time":
                    units, long_name = data.attrs["units"], data.attrs["long_name"]
                    found[name] = (_dimension(data, 0), data[()], units, long_name)
        return found

    def checkpoint(self) -> dict[str, np.ndarray]:
        """The arrays of the last checkpoint, bit for bit; empty before the first."""
        with self._reading() as file:
            return {name: _exact(data) for name, data in file["checkpoint"].items()}

    @property
    def snapshot_count(self) -> int:
        """Number of snapshots."""
        with self._reading() as file:
            return len(file["snapshots"])

    def snapshot(self, i: int) -> dict[str, Any]:
        """Arrays and scalars of snapshot i, in order of writing; negative i counts from the end.

        **Raises** IndexError where there is none.
        """
        with self._reading() as file:
            count = len(file["snapshots"])
            if not -count <= i < count:
                raise IndexError(f"snapshot {i}: {self.path} holds {count}")
            group = file["snapshots"][_snapshot_name(i % count)]
            found = {name: _plain(value) for name, value in group.attrs.items()}
            return found | {name: data[()] for name, data in group.items()}

    def snapshot_times(self) -> np.ndarray:
        """Times of the snapshots, s."""
        with self._reading() as file:
            times = [group.attrs["time"] for group in file["snapshots"].values()]
            return np.asarray(times, np.float64)


def _write_coordinates(group: h5py.Group, coordinates: Coordinates) -> None:
    for name, (dim, values, units, long_name) in coordinates.items():
        values = np.asarray(values)
        if values.ndim != 1 or dim in (name, "time"):
            raise ValueError(f"coordinate {name!r} is not a row over another dimension")
        data = group.create_dataset(name, data=values)
        data.attrs["units"], data.attrs["long_name"] = units, long_name
        data.dims[0].attach_scale(_scale(group, dim, len(values)))


def _check_series(series: Mapping[str, np.ndarray], variables: Mapping[str, Variable]) -> None:
    if "time" not in series:
        raise ValueError(f'series {sorted(series)} lack "time"')
    for name, values in series.items():
        if values.ndim not in (1, 2) or len(values) != len(series["time"]):
            raise ValueError(f"series {name!r} of shape {values.shape} does not go with its times")
        if name != "time" and name not in variables:
            raise ValueError(f"series {name!r} has no units: describe it in `variables`")


def _check_continues(path: Path, file: h5py.File, t: np.ndarray) -> None:
    stored = file["series"].get("time")
    if stored is not None and len(stored) and len(t) and not t[0] > stored[-1]:
        raise FileError(
            f"{path}: holds samples up to t = {stored[-1]:g} s, and this run is at {t[0]:g} s: "
            "another run writes to the same file. Stop one of them, then `jaxsph resume` the file"
        )


def _extend(
    group: h5py.Group,
    t: np.ndarray,
    series: Mapping[str, np.ndarray],
    variables: Mapping[str, Variable],
) -> None:
    if "time" not in group:
        _create_series(group, t, series, variables)
    stored = {name for name, data in group.items() if name != "time" and _is_series(data)}
    if stored != set(series):
        raise ValueError(f"the file has series {sorted(stored)}, not {sorted(series)}")
    old = len(group["time"])
    for name, values in (series | {"time": t}).items():
        data = group[name]
        if data.shape[1:] != values.shape[1:]:
            raise ValueError(f"series {name!r}: rows of {data.shape[1:]}, not {values.shape[1:]}")
        data.resize(old + len(t), axis=0)
        data[old:] = values


def _create_series(
    group: h5py.Group,
    t: np.ndarray,
    series: Mapping[str, np.ndarray],
    variables: Mapping[str, Variable],
) -> None:
    described = {"time": Variable("s", "time")} | dict(variables)
    for name, values in ({"time": t} | series).items():
        row = values.shape[1:]
        chunks = (512, *(max(1, k) for k in row))
        data = group.create_dataset(name, (0, *row), values.dtype, maxshape=(None, *row), chunks=chunks)
        data.attrs["units"] = described[name].units
        data.attrs["long_name"] = described[name].long_name
        if name == "time":
            data.make_scale("time")
            continue
        data.dims[0].attach_scale(group["time"])
        if row:
            dim = described[name].dim or f"{name}_component"
            data.dims[1].attach_scale(_scale(group, dim, row[0]))
            # CF's way to say which variables are positions along a dimension.
            along = [n for n, d in group.items() if _is_coordinate(d, dim)]
            if along:
                data.attrs["coordinates"] = " ".join(along)


def _is_series(data: h5py.Dataset) -> bool:
    return data.is_scale is False and _dimension(data, 0) == "time"


def _is_coordinate(data: h5py.Dataset, dim: str) -> bool:
    return not data.is_scale and len(data.dims[0]) > 0 and _dimension(data, 0) == dim


def _over_time(file: h5py.File) -> Iterator[tuple[str, h5py.Dataset]]:
    """ "time" once, then the series of both groups."""
    groups = [file[name] for name in ("series", "energy") if name in file and "time" in file[name]]
    if groups:
        yield "time", groups[0]["time"]
    for group in groups:
        yield from ((name, data) for name, data in group.items() if _is_series(data))


def _snapshot_name(i: int) -> str:
    return f"{i:06d}"


def _write_snapshot(snapshots: h5py.Group, snapshot: Mapping[str, Any]) -> None:
    group = snapshots.create_group(_snapshot_name(len(snapshots)))
    for name, value in snapshot.items():
        values = np.asarray(value)
        if values.ndim == 0:
            group.attrs[name] = values[()]
            continue
        data = group.create_dataset(name, data=values, compression="gzip", compression_opts=1, shuffle=True)
        if name in _SNAPSHOT_UNITS:
            data.attrs["units"] = _SNAPSHOT_UNITS[name]


def _replace_arrays(group: h5py.Group, arrays: Mapping[str, np.ndarray]) -> None:
    """Makes the group hold these arrays and no others."""
    for name in set(group) - set(arrays):
        del group[name]
    for name, value in arrays.items():
        value = np.asarray(value)
        if "/" in name or name in ("", "."):
            raise ValueError(f"checkpoint name {name!r}: must not be empty, '.' or hold a slash")
        stored = group.get(name)
        if stored is not None and (stored.shape, stored.dtype) == (value.shape, value.dtype):
            stored[...] = value  # in place: HDF5 does not give back the room of a deleted array
            continue
        if stored is not None:
            del group[name]
        group.create_dataset(name, data=value)
