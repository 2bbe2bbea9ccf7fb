"""File of a sweep in HDF5: results and series of its members over the swept parameters.

    attributes             schema, jaxsph_version, kind = "sweep", parameters (their names), case (shared by
                           all members, as TOML), about (JSON: further settings that identify the study; for a
                           search its result and method), labels (JSON: labels of non-standard results),
                           answer (JSON: main result of the whole study, which its page shows first)
    one per parameter      its values, a dimension of all other variables
    one per result         over the parameters, NaN if a member does not have it; `failure`: text
    series                 over the parameters and `time`, padded with NaN

The file is rewritten, atomically, whenever a member has ended.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np

from jaxsph.errors import FileError
from jaxsph.output.hdf5 import (
    SCHEMA,
    Variable,
    check_signature,
    dimension,
    open_file,
    replace_file,
    scale,
    tell_write_errors,
    version,
)

LIMIT, LIMIT_ERROR = "limit ", "limit error "
"""Beginnings of the names of results that are limits for spacing zero, and of the names of their errors."""
SCHEME_ERROR = "scheme error "
"""Beginning of the names of results that are errors of results due to the scheme."""
OF_ERRORS = LIMIT, SCHEME_ERROR
"""Beginnings of the names of all results that state the error of others."""


class Meanings(NamedTuple):
    """Meanings of the members' series, and labels of results outside the package's standard list."""

    variables: Mapping[str, Variable] = {}
    """Meaning of each series by name."""
    labels: Mapping[str, Sequence[str]] = {}
    """Text, unit, meaning and group of results, by name."""

    def first(self, results: Collection[str]) -> str | None:
        """Name of the result to show: "xi", else the first labelled result except energies, else None."""
        own = [name for name in self.labels if not name.startswith(("energy_", "whole_"))]
        return next((name for name in ("xi", *own) if name in results), None)

    def joined(self, other: Meanings) -> Meanings:
        """These meanings and the meanings in `other`, which take precedence."""
        return Meanings({**self.variables, **other.variables}, {**self.labels, **other.labels})


class StoredSweep(NamedTuple):
    """Contents of a sweep's file; the fields are named like the arguments of `SweepFile.write`."""

    case_toml: str
    axes: dict[str, np.ndarray]
    shape: tuple[int, ...]
    members: dict[int, dict[str, Any]]
    meanings: Meanings
    about: dict[str, Any]
    version: str
    answer: dict[str, str]

    def place(self, index: int) -> dict[str, float]:
        """Values of the parameters of a member, by name; `index`: flat index of the member."""
        if tuple(len(values) for values in self.axes.values()) == self.shape:
            at = np.unravel_index(index, self.shape)
        else:
            at = (index,) * len(self.axes)
        return {name: float(v[k]) for (name, v), k in zip(self.axes.items(), at, strict=True)}


class SweepFile:
    """HDF5 file of one sweep: scalar results and series of its members over the swept parameters.

    In a grid, every parameter is a dimension with its values; in a list of members, every parameter is a
    variable over the dimension `member`. netCDF tools find the scalar results in the root group of the file
    and the series in the group `series`, padded with NaN where a member's series is shorter or missing.
    """

    path: Path

    def __init__(self, path: str | Path) -> None:
        """Stores the path of a sweep's file, which need not exist yet."""
        self.path = Path(path)

    def is_one(self) -> bool:
        """Whether the file contains a sweep. **Raises** FileError if it is missing, damaged or not HDF5."""
        check_signature(self.path)
        with open_file(self.path) as file:
            return file.attrs.get("kind") == "sweep"

    def write(
        self,
        case_toml: str,
        axes: Mapping[str, np.ndarray],
        shape: tuple[int, ...],
        members: Mapping[int, Mapping[str, Any]],
        meanings: Meanings,
        about: Mapping[str, Any] | None = None,
    ) -> None:
        """Writes a whole sweep, and replaces an existing file.

        **Arguments**: `axes`: values of every parameter, in the order of the dimensions of `shape` (for a
        list of members, each parameter has one value per member); `members`: mappings by flat index,
        with "results" (scalars), "series" (arrays `[T]` or `[T, k]` by name, including "time") and "failure"
        (text, empty after success); `meanings`: meanings of series and results; `about`: further settings
        that identify the study, as numbers, texts and lists by name. **Raises** FileError if the file cannot
        be written.
        """
        with tell_write_errors(self.path):
            self.path.parent.mkdir(parents=True, exist_ok=True)
        with replace_file(self.path, "w") as file:
            file.attrs.update(schema=SCHEMA, jaxsph_version=version(), case=case_toml, kind="sweep")
            file.attrs["about"] = json.dumps(dict(about or {}))
            file.attrs["labels"] = json.dumps(dict(meanings.labels))
            dims = _write_axes(file, axes, shape)
            for name, values in over_members(members, shape).items():
                _over(file, name, values, dims)
            failure = np.full(shape, "waiting", h5py.string_dtype())
            for index, member in members.items():
                failure.flat[index] = member["failure"]
            _over(file, "failure", failure, dims)
            group = file.create_group("series")
            dims = _write_axes(group, axes, shape)
            with_series = {i: m["series"] for i, m in members.items() if "time" in m["series"]}
            if with_series:
                _write_padded(group, with_series, meanings.variables, dims, shape)

    def conclude(self, answer: Mapping[str, str]) -> None:
        """Stores the main result of the whole study in words: label, value, unit, value expected by linear
        theory, and a note, each a text that may be empty.

        When a member is computed again, this result is removed. **Raises** FileError if the file cannot be
        written.
        """
        with replace_file(self.path, "r+") as file:
            file.attrs["answer"] = json.dumps(dict(answer))

    def add_results(self, index: int, results: Mapping[str, float]) -> None:
        """Adds results to a member that has ended, by its flat index.

        **Raises** FileError if the file cannot be read or written.
        """
        old = self.read()
        members = old.members | {index: {**old.members[index]}}
        members[index]["results"] = members[index]["results"] | dict(results)
        self.write(old.case_toml, old.axes, old.shape, members, old.meanings, old.about)

    def read(self) -> StoredSweep:
        """Contents of the file, without the padding.

        **Raises** FileError if the file is missing, damaged or not the file of a sweep.
        """
        check_signature(self.path)
        with open_file(self.path) as file:
            if file.attrs.get("kind") != "sweep":
                raise FileError(
                    f"{self.path} is not the file of a sweep; give the name of a sweep's file, or of a new "
                    "file"
                )
            about = json.loads(file.attrs.get("about", "{}"))
            labels, answer = (json.loads(file.attrs.get(name, "{}")) for name in ("labels", "answer"))
            case, made_by = str(file.attrs["case"]), str(file.attrs["jaxsph_version"])
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
        return StoredSweep(case, axes, shape, members, Meanings(variables, labels), about, made_by, answer)


def over_members(members: Mapping[int, Mapping[str, Any]], shape: tuple[int, ...]) -> dict[str, np.ndarray]:
    """Scalar results over the members of a sweep, by name; NaN if a member does not have the result."""
    found = {}
    for name in sorted({n for m in members.values() for n in m["results"]}):
        found[name] = np.full(shape, np.nan)
        for index, member in members.items():
            found[name].flat[index] = member["results"].get(name, np.nan)
    return found


def _last_dimension(data: h5py.Dataset, axis: int) -> str | None:
    return dimension(data, axis) if data.ndim > axis else None


def _write_axes(group: h5py.Group, axes: Mapping[str, np.ndarray], shape: tuple[int, ...]) -> list[str]:
    """Writes the coordinates of a sweep, and returns the names of its dimensions."""
    group.attrs["parameters"] = list(axes)
    grid = tuple(len(values) for values in axes.values()) == shape
    for name, values in axes.items():
        data = group.create_dataset(name, data=np.asarray(values))
        if grid:
            data.make_scale(name)
        else:
            data.dims[0].attach_scale(scale(group, "member", len(values)))
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
        kind = np.result_type(np.float32, *(series[name].dtype for series in members.values()))
        values = np.full((int(np.prod(shape)), len(longest), *row), np.nan, kind)
        for index, series in members.items():
            values[index, : len(series[name])] = series[name]
        values = values.reshape(*shape, len(longest), *row)
        along = [f"{variables[name].dim or name + '_component'}"] if row else []
        for dim in along:
            scale(group, dim, row[0])
        data = _over(group, name, values, [*dims, "time", *along])
        data.attrs["units"], data.attrs["long_name"] = variables[name].units, variables[name].long_name
