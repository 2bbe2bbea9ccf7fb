"""A run's file and its journal, opened together and read as one."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import h5py
import numpy as np

from jaxsph.output.hdf5 import Variable, dimension, read
from jaxsph.output.journal import Journal, Owner
from jaxsph.output.records import Head, read_arrays
from jaxsph.output.series_group import over_time, time_of


class View(NamedTuple):
    """A run's file and its journal, open for reading."""

    file: h5py.File
    journal: Journal | None

    @property
    def owner(self) -> Owner:
        """Owner that the journal of this file must have."""
        return owner_of(self.file)

    def news(self) -> Iterator[Head]:
        """Heads of the journal's chunks whose samples are not in the file yet."""
        return self.journal.heads(int(self.file.attrs["read"])) if self.journal else iter(())

    def last_time(self) -> float | None:
        """Time of the last sample, s; None before the first sample."""
        if self.journal is not None:
            return self.journal.about["time"]
        times = time_of(self.file)
        return None if times is None or not len(times) else float(read(times)[-1])

    def variables(self) -> dict[str, Variable]:
        """Meaning of each series, by name."""
        if self.journal is not None:
            return {name: Variable(*what) for name, what in self.journal.variables.items()}
        found = {}
        for name, data in over_time(self.file):
            dim = dimension(data, 1) if data.ndim == 2 else None
            group = data.parent.name.strip("/")
            found[name] = Variable(data.attrs["units"], data.attrs["long_name"], dim, group)
        return found

    def series(self) -> dict[str, np.ndarray]:
        """Series by name: samples from the file, followed by newer samples from the journal."""
        found = {name: [read(data)] for name, data in over_time(self.file)}
        for head in self.news():
            for name, values in part_of(self.journal, head, "series").items():
                found.setdefault(name, []).append(values)
        return {name: np.concatenate(parts) for name, parts in found.items()}


def owner_of(file: h5py.File) -> Owner:
    """Owner recorded in a run's file."""
    return Owner(str(file.attrs.get("run", "")), int(file.attrs.get("stage", 0)))


def part_of(beside: Journal, head: Head, part: str, only: str = "") -> dict[str, np.ndarray]:
    """Arrays of one part of a chunk, "series" or "snapshot", by name; `only`: prefix of the names to read."""
    names = [name for name in head.arrays if name.startswith(f"{part}/{only}")]
    found = read_arrays(beside.chunks, head, names)
    return {name.removeprefix(f"{part}/"): values for name, values in found.items()}
