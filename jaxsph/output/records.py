"""Records: named arrays with a description, stored as bytes with checksums that reveal damage.

    prefix   magic, length of the head, length of the body, checksum of the head, checksum of the body
    head     JSON: "about", length of the body, and (type, shape, offset in the body, checksum) of every array
    body     the arrays' bytes, one after another

Each array can be read without the others, and bit for bit as it was written. Records written by older
versions have one checksum for all arrays.
"""

from __future__ import annotations

import json
import math
import struct
import zlib
from collections.abc import Iterable, Mapping
from typing import Any, BinaryIO, NamedTuple

import numpy as np

_PREFIX = struct.Struct("<8sIQII")
_MAGIC = b"jaxsph\r\n"


class Damage(ValueError):
    """Stored bytes differ from those that were written. Readers of files turn this error into a FileError."""


class Head(NamedTuple):
    """Head of a record: its description, and the location of each array."""

    about: dict[str, Any]
    arrays: dict[str, tuple[str, tuple[int, ...], int, int | None]]
    """Type, shape, offset in the body (bytes) and checksum of each array.

    The checksum of an array is None in older records, which only have a checksum of the whole body.
    """
    body: int
    """Offset of the body in the file, bytes."""
    end: int
    """Offset of the end of the record in the file, bytes."""
    checksum: int
    """Checksum of the body (CRC-32)."""


def pack(about: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> bytes:
    """Packs named arrays into the bytes of a record. `about`: a description that JSON can encode."""
    named, parts, place = {}, [], 0
    for name, array in arrays.items():
        array = np.asarray(array)
        parts.append(array.tobytes())
        named[name] = (array.dtype.str, array.shape, place, zlib.crc32(parts[-1]))
        place += len(parts[-1])
    told, body = {"about": about, "size": place, "arrays": named}, b"".join(parts)
    head = json.dumps(told).encode()
    return _PREFIX.pack(_MAGIC, len(head), len(body), zlib.crc32(head), zlib.crc32(body)) + head + body


def read_head(file: BinaryIO, place: int) -> Head:
    """Reads the head of the record at byte `place`. **Raises** Damage if the head is cut short or damaged."""
    file.seek(place)
    prefix = file.read(_PREFIX.size)
    if len(prefix) < _PREFIX.size:
        raise Damage(f"a record is cut short at byte {place}")
    magic, head_size, body_size, head_sum, body_sum = _PREFIX.unpack(prefix)
    head = file.read(head_size)
    if magic != _MAGIC or len(head) < head_size or zlib.crc32(head) != head_sum:
        raise Damage(f"the record at byte {place} is damaged")
    told = json.loads(head)
    if told.get("size", body_size) != body_size:
        raise Damage(f"the record at byte {place} is damaged")
    arrays = {
        name: (kind, tuple(shape), at, *(own or [None]))
        for name, (kind, shape, at, *own) in told["arrays"].items()
    }
    body = place + _PREFIX.size + head_size
    return Head(told["about"], arrays, body, body + body_size, body_sum)


def read_arrays(file: BinaryIO, head: Head, names: Iterable[str] | None = None) -> dict[str, np.ndarray]:
    """Reads arrays of a record by name, by default all. **Raises** Damage if a checksum does not match."""
    found = {}
    for name in head.arrays if names is None else names:
        kind, shape, at, checksum = head.arrays[name]
        if checksum is None:
            _check_body(file, head)
        file.seek(head.body + at)
        size = math.prod(shape) * np.dtype(kind).itemsize
        raw = file.read(size)
        if len(raw) < size or checksum not in (None, zlib.crc32(raw)):
            raise Damage(f"{name} is damaged")
        found[name] = np.frombuffer(bytearray(raw), kind).reshape(shape)
    return found


def _check_body(file: BinaryIO, head: Head) -> None:
    """**Raises** Damage if the checksum of the body does not match; for records written by older versions."""
    file.seek(head.body)
    body = file.read(head.end - head.body)
    if len(body) < head.end - head.body or zlib.crc32(body) != head.checksum:
        raise Damage("the arrays are damaged")
