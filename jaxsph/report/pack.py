"""Contents of a page as bytes: text and arrays in one compressed record.

uint32          length of the text, little-endian
text            JSON, in which an array is {"at": offset, "n": count, "type": "f4"}
arrays          one after another, each padded to a multiple of eight bytes
"""

from __future__ import annotations

import gzip
import json
from typing import Any

import numpy as np

KINDS = {"f4": np.float32, "f8": np.float64, "u1": np.uint8, "u4": np.uint32}
"""Types of arrays that a page can read, by their names in the text."""
UNSEEN = 65535
"""Level that marks a value that is not shown."""


class Pack:
    """Arrays of a page, collected while its contents are made."""

    def __init__(self) -> None:
        """Begins without arrays."""
        self._parts: list[bytes] = []
        self._size = 0

    def array(self, values: np.ndarray, kind: str = "f4") -> dict[str, Any]:
        """Adds an array, and returns the reference to it that is put in the text."""
        data = np.ascontiguousarray(values, KINDS[kind]).tobytes()
        found = {"at": self._size, "n": int(np.size(values)), "type": kind}
        data += bytes(-len(data) % 8)
        self._parts.append(data)
        self._size += len(data)
        return found

    def compress(self, content: Any) -> bytes:
        """Record of `content` and of the arrays in this pack, compressed by gzip."""
        text = json.dumps(content, allow_nan=False).encode()
        text += b" " * (-(len(text) + 4) % 8)
        whole = len(text).to_bytes(4, "little") + text + b"".join(self._parts)
        return gzip.compress(whole, 6, mtime=0)


def steps_in_bytes(levels: np.ndarray) -> np.ndarray:
    """Differences between frames of levels `[frame, K, N]` (uint16) as bytes `[frame, K, 2, N]`.

    The differences are zigzag-coded, so that small differences of both signs are small numbers. The low
    bytes come before the high bytes.
    """
    step = np.diff(levels, axis=0, prepend=np.zeros_like(levels[:1])).astype(np.int16)
    small = ((step << 1) ^ (step >> 15)).astype(np.uint16)
    return np.stack([small & 0xFF, small >> 8], axis=2).astype(np.uint8)
