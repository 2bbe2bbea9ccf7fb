"""HDF5 functions for all files of jaxsph: atomic writes, reads with clear error messages, dimensions.

Every write goes to a copy that then replaces the file, so a kill at any moment leaves either the old file or
the new file intact.

Files of runs and sweeps end with the CRC-32 of all their bytes, stored after the end of the HDF5 data. The
checksum is verified before HDF5 opens the file, because some kinds of damage make HDF5 crash the program.
"""

from __future__ import annotations

import contextlib
import importlib.metadata
import os
import shutil
import time
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import h5py
import numpy as np

from jaxsph.errors import FileError, JaxsphError
from jaxsph.output.records import Damage

SCHEMA = 5
"""Version of the file layout. Files with a newer layout are refused. In older layouts, series and
snapshots can be read, but not the checkpoint: layout 1 lacks the numbers derived from the case, 2 lacks
the readings `noise` and `rms_speed`, 3 has no checksums, and 4 has checksums only of its parts."""

SEALED = 5
"""First version of the layout whose files end with a checksum."""


Coordinates = dict[str, tuple[str, np.ndarray, str, str]]
"""Positions of gauges and sensors: name -> (dimension, values `[k]`, units, long name)."""


_SEAL = b"jaxsph CRC-32 of the bytes before: "
"""Marker between the HDF5 data of a file and the checksum of these data."""


_SIGNATURE = b"\x89HDF\r\n\x1a\n"


# netCDF's name for a dimension without coordinate values
_BARE_DIMENSION = "This is a netCDF dimension but not a netCDF variable. {:10d}"


@dataclass
class Variable:
    """Meaning of a series: units and long name, for axis labels and for readers of the file."""

    units: str
    long_name: str
    dim: str | None = None
    """Name of the second dimension, e.g. "gauge"; None for a series `[T]`."""
    group: str = "series"
    """Group of a run's file that contains the series: "series" or "energy"."""


@contextlib.contextmanager
def replace_file(path: Path, mode: str, sealed: bool = True) -> Iterator[h5py.File]:
    """Context with an HDF5 file to write: a copy of `path` ("r+") or a new file ("w").

    If no error occurs, the written file replaces `path`.

    `sealed`: whether to append the checksum that `open_file` verifies.
    **Raises** FileError if the file cannot be written; an existing file is then unchanged.
    """
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    with tell_write_errors(path):
        try:
            remove_leftovers(path)
            if mode == "r+":
                shutil.copyfile(path, part)
            with h5py.File(part, mode) as file:
                yield file  # HDF5 truncates the old checksum
            if sealed:
                with part.open("r+b") as whole:
                    checksum = _crc_of_bytes(whole, whole.seek(0, os.SEEK_END))
                    whole.write(_SEAL + checksum.to_bytes(4, "little"))
            sync(part)
            os.replace(part, path)
        finally:
            part.unlink(missing_ok=True)
        if os.name == "posix":  # elsewhere a folder cannot be opened to sync its entries
            sync(path.parent)


def put_file(path: Path, content: bytes) -> None:
    """Writes this content to the file and replaces its earlier content, atomically."""
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with part.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)
    if os.name == "posix":  # elsewhere a folder cannot be opened to sync its entries
        sync(path.parent)


@contextlib.contextmanager
def open_file(path: Path) -> Iterator[h5py.File]:
    """Context with an HDF5 file open for reading. **Raises** FileError if it is missing or damaged."""
    try:
        sealed = _check_seal(path)
        with h5py.File(path, "r") as file:
            if not sealed and SEALED <= int(file.attrs.get("schema", 0)) <= SCHEMA:
                raise Damage("the checksum at the end is missing: another program may have changed the file")
            yield file
    except FileNotFoundError:
        raise FileError(_no_such_file(path)) from None
    except PermissionError as error:
        raise FileError(f"{path} cannot be read ({error.strerror})") from None
    except JaxsphError:
        raise
    except Exception as error:  # HDF5, h5py and numpy raise many kinds of errors for damaged bytes
        what = str(error) if isinstance(error, Damage | OSError) else f"{type(error).__name__}: {error}"
        raise FileError(
            f"{path} is cut short or damaged ({what}). Restore the file from a copy, or remove the file and "
            "compute its contents again"
        ) from error


@contextlib.contextmanager
def tell_write_errors(path: Path) -> Iterator[None]:
    """Context that turns errors during the writing of a file into FileError."""
    try:
        yield
    except (OSError, RuntimeError) as error:  # HDF5 reports a full disk as one of these
        raise FileError(
            f"{path} could not be written ({error}); an existing file is unchanged. Check the free "
            "space and the permissions of its folder"
        ) from error


_intact: dict[Path, tuple[int, ...]] = {}
"""Files whose checksum this process has verified: device, inode, size and modification time."""


def _check_seal(path: Path) -> bool:
    """Whether a file ends with a checksum; files written by older versions do not.

    **Raises** Damage if the checksum does not match.
    """
    # one handle, as a run in progress replaces its file
    with path.open("rb") as file:
        found = os.fstat(file.fileno())
        stamp = (found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns)
        if _intact.get(path) == stamp:
            return True
        length = max(found.st_size - len(_SEAL) - 4, 0)
        file.seek(length)
        end = file.read()
        if not end.startswith(_SEAL):
            return False
        if _crc_of_bytes(file, length) != int.from_bytes(end[len(_SEAL) :], "little"):
            raise Damage("the checksum does not match the content")
    if time.time_ns() - found.st_mtime_ns > 10**8:  # a change within 0.1 s could have the same time
        _intact[path] = stamp
    return True


def _crc_of_bytes(file: BinaryIO, length: int) -> int:
    """CRC-32 of the first `length` bytes of an open file, which is then at their end."""
    found = 0
    file.seek(0)
    while length > 0 and (part := file.read(min(length, 1 << 20))):
        found, length = zlib.crc32(part, found), length - len(part)
    return found


def remove_leftovers(path: Path) -> None:
    """Removes unfinished copies of killed runs; copies younger than an hour may be in use and are kept."""
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
    return f"{path}: no such file; give an existing file, or create one with `jaxsph run CASE --out {path}`"


def check_signature(path: Path) -> None:
    """**Raises** FileError if a path is missing, a folder, cut short, or not an HDF5 file.

    h5py does not distinguish these errors.
    """
    if path.is_dir():
        raise FileError(f"{path} is a folder; give the file of a run or a sweep (.h5)")
    try:
        with path.open("rb") as file:
            start = file.read(len(_SIGNATURE))
    except FileNotFoundError:
        raise FileError(_no_such_file(path)) from None
    except OSError as error:
        raise FileError(f"{path} cannot be read ({error.strerror})") from None
    if start == _SIGNATURE:
        return
    if _SIGNATURE.startswith(start):
        raise FileError(f"{path} is cut short or empty; remove the file and compute its contents again")
    raise FileError(f"{path} is not an HDF5 file; give a file that jaxsph wrote")


def version() -> str:
    """Version of the installed jaxsph."""
    try:
        return importlib.metadata.version("jaxsph")
    except importlib.metadata.PackageNotFoundError:
        return "0+unknown"


def plain(value: Any) -> Any:
    """Python number for a numpy scalar; any other value unchanged."""
    return value.item() if isinstance(value, np.generic) else value


def scale(group: h5py.Group, dim: str, size: int) -> h5py.Dataset:
    """Dimension `dim` of a group, created if missing. **Raises** ValueError if its size is different."""
    if dim not in group:
        bare = group.create_dataset(dim, (size,), "f4")
        bare.make_scale(_BARE_DIMENSION.format(size))
    found = group[dim]
    if not isinstance(found, h5py.Dataset) or found.shape != (size,):
        raise ValueError(f"dimension {dim!r} exists, but not with size {size}")
    return found


def dimension(data: h5py.Dataset, axis: int) -> str:
    """Name of the dimension along an axis of a dataset."""
    return str(data.dims[axis][0].name).rsplit("/", 1)[-1]


def attributes(node: h5py.Group | h5py.Dataset) -> dict[str, Any]:
    """Attributes of a group or a dataset, as Python numbers and strings."""
    return {name: plain(value) for name, value in node.attrs.items()}


def read(data: h5py.Dataset) -> Any:
    """Values of a dataset, text as str. 0-d arrays stay arrays, whereas indexing would give scalars."""
    if h5py.check_string_dtype(data.dtype) is not None:
        return data.asstr()[()]
    found = np.empty(data.shape, data.dtype)
    if found.size:
        data.read_direct(found)
    return found


def extend(data: h5py.Dataset, values: np.ndarray) -> None:
    """Appends rows to a dataset."""
    old = len(data)
    data.resize(old + len(values), axis=0)
    data[old:] = values
