"""Records: named arrays with a few words about them, as bytes that tell whether they are whole.

    prefix   magic, length of the head, length of the body, checksum of the head, checksum of the body
    head     JSON: "about", and (type, shape, place in the body) of every array
    body     the arrays' bytes, one after another

A record is read array by array, without its other arrays, and bit for bit.
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


class Head(NamedTuple):
    """Head of a record: its description, and the places of its arrays."""

    about: dict[str, Any]
    arrays: dict[str, tuple[str, tuple[int, ...], int]]
    """Type, shape and place in the body (bytes) of every array, by name."""
    body: int
    """Byte of the file at which the body begins."""
    end: int
    """Byte of the file at which the record ends."""
    checksum: int
    """Checksum of the body (CRC-32)."""


def pack(about: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> bytes:
    """Bytes of a record of named arrays. `about`: a description, of whatever JSON can hold."""
    named, parts, place = {}, [], 0
    for name, array in arrays.items():
        array = np.asarray(array)
        named[name] = (array.dtype.str, array.shape, place)
        parts.append(array.tobytes())
        place += len(parts[-1])
    head, body = json.dumps({"about": about, "arrays": named}).encode(), b"".join(parts)
    return _PREFIX.pack(_MAGIC, len(head), len(body), zlib.crc32(head), zlib.crc32(body)) + head + body


def read_head(file: BinaryIO, place: int) -> Head:
    """Head of the record at the byte `place`. **Raises** ValueError where it is cut short or damaged."""
    file.seek(place)
    prefix = file.read(_PREFIX.size)
    if len(prefix) < _PREFIX.size:
        raise ValueError(f"a record is cut short at byte {place}")
    magic, head_size, body_size, head_sum, body_sum = _PREFIX.unpack(prefix)
    head = file.read(head_size)
    if magic != _MAGIC or len(head) < head_size or zlib.crc32(head) != head_sum:
        raise ValueError(f"the record at byte {place} is damaged")
    told = json.loads(head)
    arrays = {name: (kind, tuple(shape), at) for name, (kind, shape, at) in told["arrays"].items()}
    body = place + _PREFIX.size + head_size
    return Head(told["about"], arrays, body, body + body_size, body_sum)


def read_arrays(file: BinaryIO, head: Head, names: Iterable[str] | None = None) -> dict[str, np.ndarray]:
    """Arrays of a record by name, by default all. **Raises** ValueError where the body is cut short."""
    found = {}
    for name in head.arrays if names is None else names:
        kind, shape, at = head.arrays[name]
        size = math.prod(shape) * np.dtype(kind).itemsize
        file.seek(head.body + at)
        raw = file.read(size)
        if len(raw) < size:
            raise ValueError(f"{name} is cut short")
        found[name] = np.frombuffer(bytearray(raw), kind).reshape(shape)
    return found


def check_body(file: BinaryIO, head: Head) -> None:
    """**Raises** ValueError where the body of a record is not what was written."""
    file.seek(head.body)
    body = file.read(head.end - head.body)
    if len(body) < head.end - head.body or zlib.crc32(body) != head.checksum:
        raise ValueError("the arrays are damaged")
