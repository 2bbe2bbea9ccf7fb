"""Native functions of this process: compiled by LLVM, kept on disk, and registered with XLA by name."""

from __future__ import annotations

import contextlib
import ctypes
import functools
import hashlib
import os
from collections.abc import Callable, Iterable
from pathlib import Path

import jax
import llvmlite.binding as llvm
from llvmlite import ir

from jaxsph.core.native.threads import provide_symbols
from jaxsph.core.programs import program_folder

PLACEHOLDER = "jaxsph_function"
"""Name of a function before its code is known."""

DIGEST = 32
"""Length of the checksum at the beginning of a file, bytes."""

_engines: dict[str, llvm.ExecutionEngine] = {}
"""Engines that hold the registered functions' code, by the functions' names."""


def register(module_of: Callable[[str], ir.Module]) -> str:
    """Name under which XLA can call the function whose code `module_of` writes for a given name.

    The same code has the same name in every process on the same kind of processor.
    """
    text = str(module_of(PLACEHOLDER))
    name = f"jaxsph_{hashlib.sha256(f'{text}{_machine_name()}'.encode()).hexdigest()[:24]}"
    if name not in _engines and not load([name]):
        code = _compiled(text.replace(PLACEHOLDER, name))
        _store(name, code)
        _register(name, code)
    return name


def registered() -> list[str]:
    """Names of all registered functions."""
    return sorted(_engines)


def load(names: Iterable[str]) -> bool:
    """Registers functions from their files; returns whether all of them are registered now."""
    for name in names:
        if name not in _engines:
            code = _stored(name)
            if not code:
                return False
            _register(name, code)
    return True


def _register(name: str, code: bytes) -> None:
    """Registers the function of this name, from its machine code."""
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), _machine())
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    function = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_void_p)(engine.get_function_address(name))
    jax.ffi.register_ffi_target(name, jax.ffi.pycapsule(function), platform="cpu")
    _engines[name] = engine


def _compiled(text: str) -> bytes:
    """Machine code of a module, in the form of an object file."""
    module, machine = llvm.parse_assembly(text), _machine()
    module.verify()
    passes = llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options(speed_level=3))
    passes.getModulePassManager().run(module, passes)
    return machine.emit_object(module)


@functools.cache
def _machine() -> llvm.TargetMachine:
    """This processor, with all of its instructions."""
    provide_symbols()
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    features = llvm.get_host_cpu_features().flatten() + ",-prefer-256-bit"
    target = llvm.Target.from_default_triple()
    return target.create_target_machine(llvm.get_host_cpu_name(), features, opt=3, reloc="pic", jit=True)


@functools.cache
def _machine_name() -> str:
    """Processor and version of LLVM, on which machine code depends."""
    features = llvm.get_host_cpu_features().flatten()
    return f"{llvm.get_process_triple()} {llvm.get_host_cpu_name()} {features} {llvm.llvm_version_info}"


def _stored(name: str) -> bytes:
    """Machine code in the file of a function; empty if there is no file, or the file is damaged."""
    path = _file(name)
    try:
        content = path.read_bytes() if path else b""
    except OSError:
        return b""
    check, code = content[:DIGEST], content[DIGEST:]
    return code if hashlib.sha256(code).digest() == check else b""


def _store(name: str, code: bytes) -> None:
    """Writes the machine code of a function to its file; if this fails, a later process compiles it again."""
    path = _file(name)
    if not path:
        return
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    with contextlib.suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        part.write_bytes(hashlib.sha256(code).digest() + code)
        os.replace(part, path)


def _file(name: str) -> Path | None:
    """File of a function's machine code; None if programs are not kept on disk."""
    folder = program_folder()
    return folder / f"{name}.o" if folder else None
