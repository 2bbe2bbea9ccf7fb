"""Storage of samples over time in HDF5 groups, with dimensions and positions that netCDF tools can read."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import h5py
import numpy as np

from jaxsph.output.hdf5 import Coordinates, Variable, dimension, extend, scale

GROUPS = ("series", "energy")
"""Groups of a run's file that hold series."""


def write_coordinates(group: h5py.Group, coordinates: Coordinates) -> None:
    """Writes positions along dimensions other than time. **Raises** ValueError if they are not 1-D."""
    for name, (dim, values, units, long_name) in coordinates.items():
        values = np.asarray(values)
        if values.ndim != 1 or dim in (name, "time"):
            raise ValueError(
                f"coordinate {name!r} must be 1-D, along a dimension that is not called {name!r} or 'time'"
            )
        data = group.create_dataset(name, data=values)
        data.attrs["units"], data.attrs["long_name"] = units, long_name
        data.dims[0].attach_scale(scale(group, dim, len(values)))


def time_of(file: h5py.File) -> h5py.Dataset | None:
    """Times of the samples (s); None before the first sample."""
    return file["series"].get("time")


def over_time(file: h5py.File) -> Iterator[tuple[str, h5py.Dataset]]:
    """Names and datasets of all series: "time" once, then the series of every group."""
    groups = [file[name] for name in GROUPS if name in file and "time" in file[name]]
    if groups:
        yield "time", groups[0]["time"]
    for group in groups:
        yield from ((name, data) for name, data in group.items() if _is_series(data))


def extend_series(
    file: h5py.File, series: Mapping[str, np.ndarray], variables: Mapping[str, Variable]
) -> None:
    """Appends samples to the groups named by their variables; creates the groups with the first samples."""
    t = series["time"]
    for name in GROUPS:
        chosen = {k: series[k] for k in sorted(series) if k != "time" and variables[k].group == name}
        if not chosen and name != "series":
            continue
        group = file.require_group(name)
        if "time" not in group:
            _create(group, t, chosen, variables)
        for key, values in (chosen | {"time": t}).items():
            extend(group[key], values)


def _create(
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
            data.dims[1].attach_scale(scale(group, dim, row[0]))
            # CF convention: names of the variables that hold positions along a dimension
            along = [n for n, d in group.items() if _is_coordinate(d, dim)]
            if along:
                data.attrs["coordinates"] = " ".join(along)


def _is_series(data: h5py.Dataset) -> bool:
    return data.is_scale is False and dimension(data, 0) == "time"


def _is_coordinate(data: h5py.Dataset, dim: str) -> bool:
    return not data.is_scale and len(data.dims[0]) > 0 and dimension(data, 0) == dim
