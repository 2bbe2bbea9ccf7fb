"""Writers for the groups of a run's file: case, series, snapshots, checkpoint and results."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import h5py
import numpy as np

from jaxsph.output.hdf5 import read
from jaxsph.output.run_view import View, part_of
from jaxsph.output.series_group import extend_series

Labels = Mapping[str, Sequence[str]]
"""Text, unit, meaning and group of results, by name."""
_SNAPSHOT_UNITS = {"x": "m", "u": "m s-1", "p": "Pa", "id": "1"}


def describe(
    file: h5py.File, case_toml: str, settings: Mapping[str, int | float], numbers: Mapping[str, list[float]]
) -> None:
    """Writes the case, its settings and its numbers, and replaces an earlier case."""
    file.attrs["case"] = case_toml
    file.require_group("settings").attrs.update(settings)
    put_text(file, "numbers", json.dumps(dict(numbers)))


def replace_results(
    file: h5py.File, results: Mapping[str, float], notices: tuple[str, ...], labels: Labels
) -> None:
    """Replaces all results, notices and labels in the file."""
    attributes = file["results"].attrs
    for name in list(attributes):
        del attributes[name]
    attributes.update({name: float(value) for name, value in results.items()})
    put_text(file, "notices", json.dumps(list(notices)))
    put_text(file, "labels", json.dumps(dict(labels)))


def text_of(file: h5py.File, name: str, default: Any) -> Any:
    """Value of a JSON dataset; `default` if the file does not have the dataset."""
    return json.loads(read(file[name])) if name in file else default


def put_text(file: h5py.File, name: str, text: str) -> None:
    """Writes a text as a dataset, and replaces an existing dataset of this name."""
    if name in file:
        del file[name]
    file.create_dataset(name, data=text, dtype=h5py.string_dtype())


def take_series(file: h5py.File, view: View) -> None:
    """Appends the journal's new samples to a file that is open for writing."""
    chunks = [part_of(view.journal, head, "series") for head in view.news()]
    if chunks:
        joined = {name: np.concatenate([chunk[name] for chunk in chunks]) for name in chunks[0]}
        extend_series(file, joined, view.variables())


def snapshot_name(i: int) -> str:
    """Name of the group of snapshot i."""
    return f"{i:06d}"


def write_snapshot(snapshots: h5py.Group, snapshot: Mapping[str, np.ndarray]) -> None:
    """Adds a snapshot: its arrays as datasets, its scalars as attributes."""
    group = snapshots.create_group(snapshot_name(len(snapshots)))
    for name, values in snapshot.items():
        if values.ndim == 0:
            group.attrs[name] = values[()]
            continue
        data = group.create_dataset(name, data=values, compression="gzip", compression_opts=1, shuffle=True)
        if name in _SNAPSHOT_UNITS:
            data.attrs["units"] = _SNAPSHOT_UNITS[name]


def replace_arrays(group: h5py.Group, arrays: Mapping[str, np.ndarray]) -> None:
    """Replaces the arrays in a group by these arrays."""
    for name in set(group) - set(arrays):
        del group[name]
    for name, value in arrays.items():
        stored = group.get(name)
        if stored is not None and (stored.shape, stored.dtype) == (value.shape, value.dtype):
            stored[...] = value  # in place, because HDF5 does not free the space of a deleted array
        else:
            if stored is not None:
                del group[name]
            group.create_dataset(name, data=value)
