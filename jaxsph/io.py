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
import importlib.metadata
import os
import shutil
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np

from jaxsph.errors import FileError

__all__ = ["SCHEMA", "RunFile", "SweepFile", "Variable", "export_vtkhdf", "gathered"]

SCHEMA = 1
"""Version of the layout; files of a newer one are refused."""

Coordinates = dict[str, tuple[str, np.ndarray, str, str]]

_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_SNAPSHOT_UNITS = {"x": "m", "u": "m s-1", "p": "Pa", "id": "1"}
# What netCDF calls a dimension that has no coordinate values of its own.
_BARE_DIMENSION = "This is a netCDF dimension but not a netCDF variable. {:10d}"


@dataclass
class Variable:
    """What a series is: for axes' labels and for readers of the file."""

    units: str
    long_name: str
    dim: str | None = None
    """Name of the second dimension, e.g. "gauge"; None for a series `[T]`."""


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


# --------------------------------------------------------------------------- a sweep's file


class StoredSweep(NamedTuple):
    """What a sweep's file holds; see `SweepFile.write`."""

    case_toml: str
    axes: dict[str, np.ndarray]
    shape: tuple[int, ...]
    members: dict[int, dict[str, Any]]
    variables: dict[str, Variable]


class SweepFile:
    """One HDF5 file of a sweep: scalar results and series of its members over the swept parameters.

    Every parameter is a dimension with its values (of a list of members that is no grid: a variable over
    the dimension `member`), so that netCDF tools open the file itself for the scalar results and the
    group `series` for the series, padded with NaN where a member's is shorter or missing.
    """

    path: Path

    def __init__(self, path: str | Path) -> None:
        """A sweep's file, there or not."""
        self.path = Path(path)

    def is_one(self) -> bool:
        """Whether the file is a sweep's, and not a run's. **Raises** FileError where it is neither."""
        _check_signature(self.path)
        with _reading(self.path) as file:
            return file.attrs.get("kind") == "sweep"

    def write(
        self,
        case_toml: str,
        axes: Mapping[str, np.ndarray],
        shape: tuple[int, ...],
        members: Mapping[int, Mapping[str, Any]],
        variables: Mapping[str, Variable],
    ) -> None:
        """Puts a whole sweep in the file's place.

        **Arguments**: `axes`: values of every parameter, in the order of the dimensions of `shape` (of a
        list: all of them over one dimension); `members`: by flat index, "results" (scalars), "series"
        (arrays `[T]` or `[T, k]` by name, "time" among them) and "failure" (text, empty where it went
        well); `variables`: what each series is. **Raises** FileError where it cannot be written.
        """
        with _writing(self.path):
            self.path.parent.mkdir(parents=True, exist_ok=True)
        with _replacing(self.path, "w") as file:
            file.attrs.update(schema=SCHEMA, jaxsph_version=_version(), case=case_toml, kind="sweep")
            dims = _write_axes(file, axes, shape)
            for name, values in gathered(members, shape).items():
                _over(file, name, values, dims)
            failure = np.full(shape, "waiting", h5py.string_dtype())
            for index, member in members.items():
                failure.flat[index] = member["failure"]
            _over(file, "failure", failure, dims)
            group = file.create_group("series")
            dims = _write_axes(group, axes, shape)
            with_series = {i: m["series"] for i, m in members.items() if "time" in m["series"]}
            if with_series:
                _write_padded(group, with_series, variables, dims, shape)

    def read(self) -> StoredSweep:
        """What was written, without the padding.

        **Raises** FileError where the file is missing, damaged or not a sweep's.
        """
        _check_signature(self.path)
        with _reading(self.path) as file:
            if file.attrs.get("kind") != "sweep":
                raise FileError(f"{self.path}: is not the file of a sweep; give another name")
            case = str(file.attrs["case"])
            order = [str(name) for name in file.attrs["parameters"]]
            axes = {name: file[name][()] for name in order}
            failure = file["failure"].asstr()[()]
            shape = failure.shape
            known = {*axes, "failure", "member"}
            scalars = {name: data[()] for name, data in file.items() if name not in known | {"series"}}
            stored = {n: d for n, d in file["series"].items() if "long_name" in d.attrs}
            series = {n: d[()] for n, d in stored.items()}
            variables = {
                n: Variable(d.attrs["units"], d.attrs["long_name"], _last_dimension(d, len(shape) + 1))
                for n, d in stored.items()
            }
            time = file["series/time"][()] if "time" in file["series"] else np.zeros(0)
        members = {}
        for index, text in enumerate(failure.flat):
            if text == "waiting":
                continue
            at = np.unravel_index(index, shape)
            results = {n: float(v[at]) for n, v in scalars.items() if np.isfinite(v[at])}
            own = {n: v[at] for n, v in series.items()}
            there = np.zeros(len(time), bool)
            for values in own.values():
                there |= np.isfinite(values.reshape(len(values), -1)).any(axis=1)
            own = {n: v[there] for n, v in own.items()} | {"time": time[there]} if there.any() else {}
            members[index] = {"results": results, "series": own, "failure": text}
        return StoredSweep(case, axes, shape, members, variables)


def gathered(members: Mapping[int, Mapping[str, Any]], shape: tuple[int, ...]) -> dict[str, np.ndarray]:
    """Every scalar result over the members of a sweep; NaN where a member has none."""
    found = {}
    for name in sorted({n for m in members.values() for n in m["results"]}):
        found[name] = np.full(shape, np.nan)
        for index, member in members.items():
            found[name].flat[index] = member["results"].get(name, np.nan)
    return found


def _last_dimension(data: h5py.Dataset, axis: int) -> str | None:
    return _dimension(data, axis) if data.ndim > axis else None


def _write_axes(group: h5py.Group, axes: Mapping[str, np.ndarray], shape: tuple[int, ...]) -> list[str]:
    """Coordinates of a sweep; returns the names of its dimensions."""
    group.attrs["parameters"] = list(axes)
    grid = tuple(len(values) for values in axes.values()) == shape
    for name, values in axes.items():
        data = group.create_dataset(name, data=np.asarray(values))
        if grid:
            data.make_scale(name)
        else:
            data.dims[0].attach_scale(_scale(group, "member", len(values)))
    return list(axes) if grid else ["member"]


def _over(group: h5py.Group, name: str, values: np.ndarray, dims: list[str]) -> h5py.Dataset:
    data = group.create_dataset(name, data=values)
    for axis, dim in enumerate(dims):
        data.dims[axis].attach_scale(group[dim])
    return data


def _write_padded(
    group: h5py.Group,
    members: Mapping[int, Mapping[str, np.ndarray]],
    variables: Mapping[str, Variable],
    dims: list[str],
    shape: tuple[int, ...],
) -> None:
    longest = max((series["time"] for series in members.values()), key=len)
    group.create_dataset("time", data=longest).make_scale("time")
    group["time"].attrs["units"] = "s"
    first = next(iter(members.values()))
    for name in sorted(set(first) - {"time"}):
        row = first[name].shape[1:]
        values = np.full((int(np.prod(shape)), len(longest), *row), np.nan, np.float32)
        for index, series in members.items():
            values[index, : len(series[name])] = series[name]
        values = values.reshape(*shape, len(longest), *row)
        along = [f"{variables[name].dim or name + '_component'}"] if row else []
        for dim in along:
            _scale(group, dim, row[0])
        data = _over(group, name, values, [*dims, "time", *along])
        data.attrs["units"], data.attrs["long_name"] = variables[name].units, variables[name].long_name


# --------------------------------------------------------------------------- safety of files


@contextlib.contextmanager
def _replacing(path: Path, mode: str) -> Iterator[h5py.File]:
    """A copy (mode "r+") or a new file ("w") that takes the file's place if all goes well."""
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    with _writing(path):
        try:
            _remove_abandoned(path)
            if mode == "r+":
                shutil.copyfile(path, part)
            with h5py.File(part, mode) as file:
                yield file
                file.flush()
            _sync(part)
            os.replace(part, path)
        finally:
            part.unlink(missing_ok=True)
        if os.name == "posix":  # elsewhere a folder cannot be opened to sync its entries
            _sync(path.parent)


@contextlib.contextmanager
def _reading(path: Path) -> Iterator[h5py.File]:
    try:
        with h5py.File(path, "r") as file:
            yield file
    except FileNotFoundError:
        raise FileError(_missing(path)) from None
    except PermissionError as error:
        raise FileError(f"{path}: cannot be read ({error.strerror})") from None
    except (OSError, KeyError, RuntimeError) as error:
        raise FileError(
            f"{path}: is cut short or damaged ({error}). Restore it from a copy, or run "
            "the case again with --overwrite"
        ) from error


@contextlib.contextmanager
def _writing(path: Path) -> Iterator[None]:
    try:
        yield
    except (OSError, RuntimeError) as error:  # HDF5 reports a full disk as either
        raise FileError(
            f"{path}: could not be written ({error}); what was there before is unchanged. Look at "
            "the space and the permissions of its folder"
        ) from error


def _remove_abandoned(path: Path) -> None:
    """Removes unfinished copies that a killed run left: a write takes seconds, not an hour."""
    for part in path.parent.glob(f".{path.name}.*.part"):
        with contextlib.suppress(OSError):
            if time.time() - part.stat().st_mtime > 3600.0:
                part.unlink()


def _sync(path: Path) -> None:
    """Waits until a file's bytes, or a folder's entries, are on the disk."""
    handle = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _missing(path: Path) -> str:
    return f"{path}: no such file; `jaxsph run CASE --out {path}` makes one"


def _check_signature(path: Path) -> None:
    """Tells a missing or foreign file from a damaged one, which h5py does not."""
    if path.is_dir():
        raise FileError(f"{path}: is a folder; give a run's file (.h5)")
    try:
        with path.open("rb") as file:
            start = file.read(len(_SIGNATURE))
    except FileNotFoundError:
        raise FileError(_missing(path)) from None
    except OSError as error:
        raise FileError(f"{path}: cannot be read ({error.strerror})") from None
    if start == _SIGNATURE:
        return
    if _SIGNATURE.startswith(start):
        raise FileError(f"{path}: is cut short or empty; run the case again with --overwrite")
    raise FileError(f"{path}: is not an HDF5 file; give a file that `jaxsph run` wrote")


def _version() -> str:
    try:
        return importlib.metadata.version("jaxsph")
    except importlib.metadata.PackageNotFoundError:
        return "0+unknown"


def _plain(value: Any) -> Any:
    """A Python number for a numpy scalar; anything else as it is."""
    return value.item() if isinstance(value, np.generic) else value


# --------------------------------------------------------------------------- series


def _write_coordinates(group: h5py.Group, coordinates: Coordinates) -> None:
    for name, (dim, values, units, long_name) in coordinates.items():
        values = np.asarray(values)
        if values.ndim != 1 or dim in (name, "time"):
            raise ValueError(f"coordinate {name!r} is not a row over another dimension")
        data = group.create_dataset(name, data=values)
        data.attrs["units"], data.attrs["long_name"] = units, long_name
        data.dims[0].attach_scale(_scale(group, dim, len(values)))


def _scale(group: h5py.Group, dim: str, size: int) -> h5py.Dataset:
    """The dimension called `dim`, made where it is missing."""
    if dim not in group:
        scale = group.create_dataset(dim, (size,), "f4")
        scale.make_scale(_BARE_DIMENSION.format(size))
    elif group[dim].shape != (size,):
        raise ValueError(f"dimension {dim!r} has size {group[dim].shape[0]}, not {size}")
    return group[dim]


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


def _dimension(data: h5py.Dataset, axis: int) -> str:
    return data.dims[axis][0].name.rsplit("/", 1)[-1]


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


# --------------------------------------------------------------------------- snapshots, checkpoint


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


def _exact(data: h5py.Dataset) -> np.ndarray:
    """A dataset's array as it was; indexing would turn 0-d ones into scalars."""
    found = np.empty(data.shape, data.dtype)
    if found.size:
        data.read_direct(found)
    return found


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


# --------------------------------------------------------------------------- ParaView


def export_vtkhdf(run: RunFile, path: str | Path) -> Path:
    """Writes all snapshots as one VTKHDF file over time, which ParaView opens.

    PolyData of one vertex for each particle, with point data `pressure` (Pa), `velocity` (m/s,
    three components) and `id`; point k is the same particle at all times. Two-dimensional runs lie
    in the x-y plane, z up becoming y, which is how ParaView looks at a new scene.

    **Raises** FileError where the run has no snapshots, or `path` is a file of another kind.
    """
    path = Path(path)
    count = run.snapshot_count
    if count == 0:
        raise FileError(f"{run.path}: holds no snapshots yet; let the run go on, then export again")
    _check_replaceable(path)
    with _writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    with _replacing(path, "w") as file:
        root = file.create_group("VTKHDF")
        root.attrs["Version"] = np.array([2, 2], np.int64)
        # VTK wants a fixed-length string here, and h5py writes variable ones.
        root.attrs.create("Type", np.bytes_("PolyData"))
        sizes = []
        for i in range(count):
            snapshot = run.snapshot(i)
            order = np.argsort(snapshot["id"], kind="stable")
            sizes.append(len(order))
            _append_rows(root, "Points", _three(snapshot["x"][order]))
            _append_rows(root, "PointData/pressure", snapshot["p"][order])
            _append_rows(root, "PointData/velocity", _three(snapshot["u"][order]))
            _append_rows(root, "PointData/id", snapshot["id"][order])
        _write_vertices(root, np.asarray(sizes))
        _write_steps(root, run.snapshot_times(), np.asarray(sizes))
    return path


def _check_replaceable(path: Path) -> None:
    """An export may replace an earlier one, but no other file."""
    if not path.exists():
        return
    with contextlib.suppress(OSError), h5py.File(path, "r") as file:
        if "VTKHDF" in file:
            return
    raise FileError(f"{path}: exists and is not an earlier export; give another name")


def _three(a: np.ndarray) -> np.ndarray:
    """`[N, 2]` or `[N, 3]` as `[N, 3]`."""
    return np.pad(a, ((0, 0), (0, 3 - a.shape[1])))


def _append_rows(root: h5py.Group, name: str, rows: np.ndarray) -> None:
    if name not in root:
        root.create_dataset(
            name,
            (0, *rows.shape[1:]),
            rows.dtype,
            maxshape=(None, *rows.shape[1:]),
            chunks=(max(1, min(len(rows), 65536)), *rows.shape[1:]),
            compression="gzip",
            compression_opts=1,
            shuffle=True,
        )
    data = root[name]
    old = len(data)
    data.resize(old + len(rows), axis=0)
    data[old:] = rows


def _write_vertices(root: h5py.Group, sizes: np.ndarray) -> None:
    """One list of vertices serves every step: a step reads as many as it has points."""
    root["NumberOfPoints"] = sizes
    most = int(sizes.max())
    for kind in ("Vertices", "Lines", "Polygons", "Strips"):
        cells = most if kind == "Vertices" else 0
        group = root.create_group(kind)
        group["NumberOfCells"] = sizes if cells else np.zeros_like(sizes)
        group["NumberOfConnectivityIds"] = group["NumberOfCells"][()]
        group["Connectivity"] = np.arange(cells)
        group["Offsets"] = np.arange(cells + 1)


def _write_steps(root: h5py.Group, times: np.ndarray, sizes: np.ndarray) -> None:
    count = len(times)
    starts = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    steps = root.create_group("Steps")
    steps.attrs["NSteps"] = count
    steps["Values"] = times
    steps["PartOffsets"] = np.arange(count)
    steps["NumberOfParts"] = np.ones(count, np.int64)
    steps["PointOffsets"] = starts
    steps["CellOffsets"] = np.zeros((count, 4), np.int64)
    steps["ConnectivityIdOffsets"] = np.zeros((count, 4), np.int64)
    for name in root["PointData"]:
        steps[f"PointDataOffsets/{name}"] = starts
