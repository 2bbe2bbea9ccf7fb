"""Functions that XLA calls, by the interface of its typed custom calls (`xla/ffi/api/c_api.h`)."""

from __future__ import annotations

import functools
import re
from pathlib import Path
from typing import Any

import jax
from llvmlite import ir

from jaxsph.core.native.vectors import INDEX, POINTER, Builder, Value, scalar

_FRAME = {"extension": 8, "interface": 16, "context": 24, "arguments": 72, "results": 112}
"""Offsets in the frame of a call (XLA_FFI_CallFrame), bytes: extension, functions that the call may use, its
context, arguments and results."""
_FUNCTIONS = 48
"""Offset of the first function in the interface (XLA_FFI_Api), bytes."""
_DATA, _SIZES = 24, 40
"""Offsets of the data and the sizes in an array (XLA_FFI_Buffer), bytes."""
_METADATA = 24
"""Offset of the metadata in the extension by which XLA asks for the version (XLA_FFI_Metadata_Extension)."""
_VERSION, _TRAITS = (24, 28), 32
"""Offsets of the version's two numbers and of the traits in the metadata (XLA_FFI_Metadata), bytes."""


class Call:
    """Writer of the code of a call; reads its arguments and results."""

    def __init__(self, builder: Builder, frame: Value) -> None:
        """Writer that appends to the `builder`; `frame`: address of the call's frame."""
        self.builder = builder
        self.frame = frame

    def interface(self) -> Value:
        """Address of the functions that the call may use."""
        return loaded_pointer(self.builder, self.frame, _FRAME["interface"])

    def context(self) -> Value:
        """Context of the call, an argument of these functions."""
        return loaded_pointer(self.builder, self.frame, _FRAME["context"])

    def argument(self, k: int) -> Value:
        """Address of the data of an argument."""
        return loaded_pointer(self.builder, self._array("arguments", k), _DATA)

    def result(self, k: int) -> Value:
        """Address of the data of a result."""
        return loaded_pointer(self.builder, self._array("results", k), _DATA)

    def scalar(self, k: int, dtype: Any) -> Value:
        """Value of an argument that is a scalar."""
        return self.builder.load(self.argument(k), typ=scalar(dtype))

    def sizes(self, k: int, ndim: int, of: str = "arguments") -> list[Value]:
        """Sizes along its axes of one of the `arguments` or `results`."""
        sizes = loaded_pointer(self.builder, self._array(of, k), _SIZES)
        return [
            self.builder.load(at_offset(self.builder, sizes, 8 * axis), typ=INDEX) for axis in range(ndim)
        ]

    def finish(self) -> None:
        """Ends the call without an error."""
        self.builder.ret(POINTER(None))

    def _array(self, which: str, k: int) -> Value:
        """Address of the description of an argument or a result."""
        return loaded_pointer(self.builder, loaded_pointer(self.builder, self.frame, _FRAME[which]), 8 * k)


def begin_call(name: str) -> tuple[ir.Module, Call]:
    """Module with a function that XLA can call, and the writer of the function's code."""
    module = ir.Module(name)
    function = ir.Function(module, ir.FunctionType(POINTER, [POINTER]), name)
    (frame,) = function.args
    builder = ir.IRBuilder(function.append_basic_block())
    extension = loaded_pointer(builder, frame, _FRAME["extension"])
    with builder.if_then(builder.icmp_unsigned("!=", extension, POINTER(None)), likely=False):
        # XLA asks for the version of the interface when the function is registered
        metadata = loaded_pointer(builder, extension, _METADATA)
        for offset, value in zip((*_VERSION, _TRAITS), (*_version(), 0), strict=True):
            builder.store(ir.IntType(32)(value), at_offset(builder, metadata, offset))
        builder.ret(POINTER(None))
    return module, Call(builder, frame)


def _version() -> list[int]:
    """Version of the interface, from the header that belongs to the installed jaxlib."""
    return [
        int(re.findall(rf"#define XLA_FFI_API_{part} (\d+)", _header())[0]) for part in ("MAJOR", "MINOR")
    ]


def position_of(function: str) -> int:
    """Offset of a function in the interface, bytes."""
    return _FUNCTIONS + 8 * re.findall(r"_XLA_FFI_API_STRUCT_FIELD\((XLA_FFI_\w+)\)", _header()).index(
        function
    )


@functools.cache
def _header() -> str:
    """Text of the interface's header."""
    return (Path(jax.ffi.include_dir()) / "xla/ffi/api/c_api.h").read_text(encoding="utf-8")


def at_offset(builder: Builder, start: Value, offset: int) -> Value:
    """Address `offset` bytes after another one."""
    return builder.gep(start, [INDEX(offset)], source_etype=ir.IntType(8))


def loaded_pointer(builder: Builder, start: Value, offset: int) -> Value:
    """Address that is stored `offset` bytes after another one."""
    return builder.load(at_offset(builder, start, offset), typ=POINTER)
