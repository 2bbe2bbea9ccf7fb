"""HDF5 for all files of jaxsph: writes that are whole or nothing, reads with errors in words, dimensions.

Every write goes to a copy that then takes the file's place, so a kill at any moment leaves the old file or
the new one, whole.

Groups and datasets carry an attribute `checksum`, two CRC-32: of what is said about them (name, type, shape,
dimensions, attributes; of a group the names of its members) and of a dataset's values. `seal` writes it,
`check` and `read` look at it. A dataset that grows goes on with the checksum of what it held.
"""

from __future__ import annotations

import contextlib
import importlib.metadata
import json
import os
import shutil
import time
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from jaxsph.errors import FileError, JaxsphError
from jaxsph.output.records import Damage

SCHEMA = 4
"""Version of the layout. Files of a newer one are refused; of those of an older one series and snapshots are
read, and checkpoints refused: 1 did not say what the run's rules made of its case, 2 had no readings of the
noise, 3 no checksums."""

SEALED = 4
"""First version of the layout whose files have checksums."""


Coordinates = dict[str, tuple[str, np.ndarray, str, str]]
"""Positions of gauges and sensors: name -> (dimension, values `[k]`, units, long name)."""


_WHOLE = b"jaxsph CRC-32 of the bytes before: "
"""What stands between the end of a file as HDF5 knows it and the checksum of all bytes before."""


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
def replace_file(path: Path, mode: str, whole: bool = False) -> Iterator[h5py.File]:
    """HDF5 file to write, a copy ("r+") or a new one ("w"), that takes the place of `path` if all goes well.

    `whole`: appends the checksum of all its bytes, for `check_whole`, to a file that is always written anew.
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
            if whole:
                with part.open("ab") as end:
                    end.write(_WHOLE + _crc_of_bytes(part).to_bytes(4, "little"))
            sync(part)
            os.replace(part, path)
        finally:
            part.unlink(missing_ok=True)
        if os.name == "posix":  # elsewhere a folder cannot be opened to sync its entries
            sync(path.parent)


def put_file(path: Path, content: bytes) -> None:
    """Puts the content in the file's place, whole or not at all."""
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
    """HDF5 file, open for reading. **Raises** FileError where it is missing, cut short or damaged."""
    try:
        with h5py.File(path, "r") as file:
            yield file
    except FileNotFoundError:
        raise FileError(_no_such_file(path)) from None
    except PermissionError as error:
        raise FileError(f"{path}: cannot be read ({error.strerror})") from None
    except JaxsphError:
        raise
    except Exception as error:  # whatever HDF5, h5py and numpy make of bytes that nobody wrote
        what = str(error) if isinstance(error, Damage | OSError) else f"{type(error).__name__}: {error}"
        raise FileError(
            f"{path}: is cut short or damaged ({what}). Restore it from a copy, or run "
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


def check_whole(path: Path) -> None:
    """**Raises** FileError for a file whose bytes are not those written, before HDF5 is given them.

    HDF5 stops the whole program at some damage. A file without such a checksum, of a run or of an older
    version, passes.
    """
    size = len(_WHOLE) + 4
    with path.open("rb") as file:
        file.seek(0, os.SEEK_END)
        length = max(file.tell() - size, 0)
        file.seek(length)
        end = file.read(size)
    if end.startswith(_WHOLE) and _crc_of_bytes(path, length) != int.from_bytes(end[-4:], "little"):
        raise FileError(
            f"{path}: is damaged: its bytes are not those that were written. Restore it from a copy, or "
            "remove it and run the study again"
        )


def _crc_of_bytes(path: Path, length: int | None = None) -> int:
    """CRC-32 of the first bytes of a file, by default of all."""
    found, left = 0, path.stat().st_size if length is None else length
    with path.open("rb") as file:
        while left > 0 and (part := file.read(min(left, 1 << 20))):
            found, left = zlib.crc32(part, found), left - len(part)
    return found


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
        seal(bare)
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


_OF_HDF5 = {"CLASS", "NAME", "DIMENSION_LIST", "REFERENCE_LIST", "DIMENSION_LABELS"}
_CHECKSUM = "checksum"


def seal(node: h5py.Group | h5py.Dataset) -> None:
    """Writes the checksum of a group, or of a dataset with its values."""
    _put(node, 0 if isinstance(node, h5py.Group) else _crc(_values(node)))


def check(node: h5py.Group | h5py.Dataset) -> int | None:
    """Checks what is said about a group or a dataset, and returns the checksum that its values must have.

    None: an older version wrote no checksums. **Raises** Damage.
    """
    if _CHECKSUM not in node.attrs:
        root = node.file.attrs
        if _CHECKSUM in root or int(root.get("schema", 0)) >= SEALED:
            raise Damage(f"{node.name} has no checksum")
        return None
    words, values = (int(one) for one in np.asarray(node.attrs[_CHECKSUM]))
    if words != _crc_of_words(node):
        raise Damage(f"{node.name} is not what was written, or another program has changed it")
    return values


def attributes(node: h5py.Group | h5py.Dataset) -> dict[str, Any]:
    """Attributes of a group or a dataset, its checksum apart. **Raises** Damage."""
    check(node)
    return {name: plain(value) for name, value in node.attrs.items() if name != _CHECKSUM}


def read(data: h5py.Dataset) -> Any:
    """Values of a dataset, text as str; 0-d arrays keep their shape. **Raises** Damage."""
    checksum = check(data)
    values = _values(data)
    if checksum not in (None, _crc(values)):
        raise Damage(f"the values of {data.name} are not those that were written")
    return values


def extend(data: h5py.Dataset, values: np.ndarray) -> None:
    """Adds rows to a dataset, and to its checksum. **Raises** Damage."""
    checksum, old = check(data), len(data)
    data.resize(old + len(values), axis=0)
    data[old:] = values
    if checksum is not None:
        _put(data, _crc(np.asarray(values, data.dtype), checksum))


def _put(node: h5py.Group | h5py.Dataset, values: int) -> None:
    node.attrs[_CHECKSUM] = np.array([_crc_of_words(node), values], np.uint32)


def _values(data: h5py.Dataset) -> Any:
    return data.asstr()[()] if h5py.check_string_dtype(data.dtype) is not None else exact(data)


def _crc(values: Any, start: int = 0) -> int:
    """CRC-32 of an array's bytes, or of text or an array of text; of more values it goes on from `start`."""
    if isinstance(values, np.ndarray) and values.dtype != object:
        return zlib.crc32(np.ascontiguousarray(values).tobytes(), start)
    return zlib.crc32(json.dumps(np.asarray(values, object).tolist()).encode(), start)


def _crc_of_words(node: h5py.Group | h5py.Dataset) -> int:
    told: list[Any] = [node.name]
    for name in sorted(set(node.attrs) - _OF_HDF5 - {_CHECKSUM}):
        value = node.attrs[name]
        if isinstance(value, str):
            told.append([name, value])
        else:
            array = np.asarray(value)
            own = array.astype(str).tolist() if array.dtype == object else array.tobytes().hex()
            told.append([name, array.dtype.str, array.shape, own])
    if isinstance(node, h5py.Group):
        told.append(sorted(node))
    else:
        scales = [dimension(node, k) if len(node.dims[k]) else "" for k in range(node.ndim)]
        told += [node.dtype.str, node.shape, bool(node.is_scale), scales]
    return zlib.crc32(json.dumps(told).encode())
