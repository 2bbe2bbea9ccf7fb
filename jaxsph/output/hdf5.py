"""HDF5 for all files of jaxsph: writes that are whole or nothing, reads with errors in words, dimensions.

Every write goes to a copy that then takes the file's place, so a kill at any moment leaves the old file or
the new one, whole.
"""

from __future__ import annotations

import contextlib
import importlib.metadata
import os
import shutil
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from jaxsph.errors import FileError

SCHEMA = 3
"""Version of the layout. Files of a newer one are refused; of those of an older one series and snapshots are
read, and checkpoints refused: 1 did not say what the run's rules made of its case, 2 had no readings of the
noise."""


Coordinates = dict[str, tuple[str, np.ndarray, str, str]]
"""Positions of gauges and sensors: name -> (dimension, values `[k]`, units, long name)."""


_SIGNATURE = b"\x89HDF\r\n\x1a\n"


# What netCDF calls a dimension that has no coordinate values of its own.
_BARE_DIMENSION = "This is a netCDF dimension but not a netCDF variable. {:10d}"


@dataclass
class Variable:
    """Meaning of a series: its units and name, for the labels of axes and for readers of the file."""

    units: str
    long_name: str
    dim: str | None = None
    """Name of the second dimension, e.g. "gauge"; None for a series `[T]`."""
    group: str = "series"
    """Group of a run's file that keeps the series: "series" or "energy"."""


@contextlib.contextmanager
def replace_file(path: Path, mode: str) -> Iterator[h5py.File]:
    """HDF5 file to write, a copy ("r+") or a new one ("w"), that takes the place of `path` if all goes well.

    **Raises** FileError where it cannot be written; the file before is then unchanged.
    """
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    with tell_write_errors(path):
        try:
            remove_leftovers(path)
            if mode == "r+":
                shutil.copyfile(path, part)
            with h5py.File(part, mode) as file:
                yield file
                file.flush()
            sync(part)
            os.replace(part, path)
        finally:
            part.unlink(missing_ok=True)
        if os.name == "posix":  # elsewhere a folder cannot be opened to sync its entries
            sync(path.parent)


@contextlib.contextmanager
def open_file(path: Path) -> Iterator[h5py.File]:
    """HDF5 file, open for reading. **Raises** FileError where it is missing, cut short or damaged."""
    try:
        with h5py.File(path, "r") as file:
            yield file
    except FileNotFoundError:
        raise FileError(_no_such_file(path)) from None
    except PermissionError as error:
        raise FileError(f"{path}: cannot be read ({error.strerror})") from None
    except (OSError, KeyError, RuntimeError) as error:
        raise FileError(
            f"{path}: is cut short or damaged ({error}). Restore it from a copy, or run "
            "the case again with --overwrite"
        ) from error


@contextlib.contextmanager
def tell_write_errors(path: Path) -> Iterator[None]:
    """Context that raises FileError for whatever goes wrong while the file is written."""
    try:
        yield
    except (OSError, RuntimeError) as error:  # HDF5 reports a full disk as either
        raise FileError(
            f"{path}: could not be written ({error}); what was there before is unchanged. Look at "
            "the space and the permissions of its folder"
        ) from error


def remove_leftovers(path: Path) -> None:
    """Removes unfinished copies that a killed run left: a write takes seconds, not an hour."""
    for part in path.parent.glob(f".{path.name}.*.part"):
        with contextlib.suppress(OSError):
            if time.time() - part.stat().st_mtime > 3600.0:
                part.unlink()


def sync(path: Path) -> None:
    """Waits until a file's bytes, or a folder's entries, are on the disk."""
    handle = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _no_such_file(path: Path) -> str:
    return f"{path}: no such file; `jaxsph run CASE --out {path}` makes one"


def check_signature(path: Path) -> None:
    """**Raises** FileError for a path without an HDF5 file: missing, a folder, cut short, or of another kind.

    h5py does not tell these from each other.
    """
    if path.is_dir():
        raise FileError(f"{path}: is a folder; give a run's file (.h5)")
    try:
        with path.open("rb") as file:
            start = file.read(len(_SIGNATURE))
    except FileNotFoundError:
        raise FileError(_no_such_file(path)) from None
    except OSError as error:
        raise FileError(f"{path}: cannot be read ({error.strerror})") from None
    if start == _SIGNATURE:
        return
    if _SIGNATURE.startswith(start):
        raise FileError(f"{path}: is cut short or empty; run the case again with --overwrite")
    raise FileError(f"{path}: is not an HDF5 file; give a file that `jaxsph run` wrote")


def version() -> str:
    """Version of the installed jaxsph."""
    try:
        return importlib.metadata.version("jaxsph")
    except importlib.metadata.PackageNotFoundError:
        return "0+unknown"


def plain(value: Any) -> Any:
    """Python number of a numpy scalar; anything else as it is."""
    return value.item() if isinstance(value, np.generic) else value


def scale(group: h5py.Group, dim: str, size: int) -> h5py.Dataset:
    """Dimension called `dim` of a group, made where it is missing. **Raises** ValueError for another size."""
    if dim not in group:
        bare = group.create_dataset(dim, (size,), "f4")
        bare.make_scale(_BARE_DIMENSION.format(size))
    found = group[dim]
    if not isinstance(found, h5py.Dataset) or found.shape != (size,):
        raise ValueError(f"dimension {dim!r} is not one of size {size}")
    return found


def dimension(data: h5py.Dataset, axis: int) -> str:
    """Name of the dimension along an axis of a dataset."""
    return str(data.dims[axis][0].name).rsplit("/", 1)[-1]


def exact(data: h5py.Dataset) -> np.ndarray:
    """Array of a dataset with its own shape; indexing would turn 0-d arrays into scalars."""
    found = np.empty(data.shape, data.dtype)
    if found.size:
        data.read_direct(found)
    return found
