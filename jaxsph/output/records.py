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
    """What a record says of itself, and where its arrays are."""

    about: dict[str, Any]
    arrays: dict[str, tuple[str, tuple[int, ...], int]]
    """(type, shape, place in the body) by name."""
    body: int
    """Place of the body in its file."""
    end: int
    """Place of what follows in its file."""
    checksum: int
    """Of the body (CRC-32)."""


def pack(about: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> bytes:
    """A record's bytes. `about`: anything that JSON can say."""
    named, parts, place = {}, [], 0
    for name, array in arrays.items():
        array = np.asarray(array)
        named[name] = (array.dtype.str, array.shape, place)
        parts.append(array.tobytes())
        place += len(parts[-1])
    head, body = json.dumps({"about": about, "arrays": named}).encode(), b"".join(parts)
    return _PREFIX.pack(_MAGIC, len(head), len(body), zlib.crc32(head), zlib.crc32(body)) + head + body


def read_head(file: BinaryIO, place: int) -> Head:
    """The head of the record that begins at `place`. **Raises** ValueError where there is no whole one."""
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
    """Arrays of a record, by default all. **Raises** ValueError where the body is cut short."""
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
    """**Raises** ValueError where the body is not what was written."""
    file.seek(head.body)
    body = file.read(head.end - head.body)
    if len(body) < head.end - head.body or zlib.crc32(body) != head.checksum:
        raise ValueError("the arrays are damaged")
