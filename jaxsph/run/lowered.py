"""Stores the lowered time steps of cases on disk, so that a later run of a case is not traced again.

Tracing and lowering the steps of a run takes longer than loading their compiled form from the cache. A stored
program is identified by the case, the source code of jaxsph and the versions of its libraries, and is stored
next to the compiled programs. Only the command line stores programs: in a Python session any function of
jaxsph may have been replaced, and the key would not change.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import json
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import jax
from jax import export

from jaxsph.case.case import Case
from jaxsph.core.native.forms import available, restored, used
from jaxsph.core.programs import OPTIONS, program_folder
from jaxsph.model.interfaces import Model
from jaxsph.model.probe import AbstractProbe
from jaxsph.model.state import State
from jaxsph.output.hdf5 import put_file
from jaxsph.problem.source import Source

LIBRARIES = ("jax", "jaxlib", "equinox")
"""Libraries on whose versions a lowered program depends."""

Steps = Callable[..., tuple[State, dict[str, jax.Array]]]
"""Function of (model, state, probes, most, sample_every, n_steps) that advances a state: see
`simulate_chunk`."""

_kept: dict[str, Lowered | None] = {}
"""Programs that this process has stored or loaded, by their keys; None if a program cannot be stored."""
_switch = {"on": False}


class Lowered(NamedTuple):
    """A lowered program for one structure of its arguments."""

    call: Callable[..., Any]
    """Function of `n_steps` and of the leaves of model, state and probes."""
    readings: tuple[str, ...]
    """Names of the readings, whose arrays follow the leaves of the state in the result."""


def store_programs() -> None:
    """Makes later runs of cases in this process store their lowered steps, and load stored ones."""
    _switch["on"] = True


def key_of(source: Source) -> str:
    """Text that determines the program of a source's steps, together with the structure of the program's
    arguments; empty if the program is not to be stored."""
    stored = _switch["on"] and isinstance(source, Case) and program_folder() is not None
    return f"{source.to_toml()} {_surroundings()}" if stored else ""


def advance(
    steps: Steps,
    key: str,
    model: Model,
    state: State,
    probes: Sequence[AbstractProbe],
    most: int,
    sample_every: int,
    n_steps: jax.Array,
) -> tuple[State, dict[str, jax.Array]] | None:
    """Result of `steps(model, state, ...)` from a stored program; a missing program is made and stored.

    `key`: see `key_of`. **Returns** None if such a program cannot be stored.
    """
    leaves, tree = jax.tree.flatten((model, state, tuple(probes)))
    avals = [jax.typeof(leaf) for leaf in leaves]
    text = f"{key} {tree} {avals} {most} {sample_every}"
    name = hashlib.sha256(text.encode()).hexdigest()[:32]
    if name not in _kept:
        shapes = [jax.ShapeDtypeStruct(a.shape, a.dtype, weak_type=a.weak_type) for a in avals]
        arguments = (jax.ShapeDtypeStruct((), "int32"), *shapes)
        found = _loaded(name) or _made(name, steps, tree, arguments, (most, sample_every))
        # `jax.jit` would compile the program again for the second chunk: results of an exported program are
        # bound to their device, and the first state of a run is not
        _kept[name] = found and found._replace(
            call=jax.jit(found.call, compiler_options=OPTIONS).lower(*arguments).compile()
        )
    program = _kept[name]
    if program is None:
        return None
    found = program.call(n_steps, *leaves)
    count = len(found) - len(program.readings)
    return (
        jax.tree.unflatten(jax.tree.structure(state), found[:count]),
        dict(zip(program.readings, found[count:], strict=True)),
    )


def _loaded(name: str) -> Lowered | None:
    """Program stored under a name; None if there is no file or the file is damaged."""
    try:
        first, _, data = _path(name).read_bytes().partition(b"\n")
        names, functions = json.loads(first)
        if not restored(functions):
            return None
        return Lowered(export.deserialize(bytearray(data)).call, tuple(names))
    except Exception:  # a damaged file raises errors of many types
        return None


def _made(
    name: str, steps: Steps, tree: Any, arguments: Sequence[jax.ShapeDtypeStruct], static: tuple[int, int]
) -> Lowered | None:
    """Lowered form of `steps`, which is stored; None if JAX cannot store it."""
    found: dict[str, Any] = {}

    def flat(n_steps, *leaves):
        model, state, probes = jax.tree.unflatten(tree, leaves)
        new, readings = steps(model, state, probes, *static, n_steps)
        found["alike"] = jax.tree.structure(new) == jax.tree.structure(state)
        found["names"] = sorted(readings)
        return [*jax.tree.leaves(new), *(readings[key] for key in found["names"])]

    program = jax.jit(flat)
    try:
        program.trace(*arguments)  # afterwards the native functions that the program calls are known
        functions = used()
        known = [export.DisabledSafetyCheck.custom_call(function) for function in functions]
        lowered = export.export(program, disabled_checks=known)(*arguments)
        data = lowered.serialize()
    except (ImportError, NotImplementedError, ValueError):
        return None  # JAX cannot export one of the operations
    if not found["alike"]:
        return None
    with contextlib.suppress(OSError):  # the next run traces its steps again
        put_file(_path(name), json.dumps([found["names"], functions]).encode() + b"\n" + data)
    return Lowered(lowered.call, tuple(found["names"]))


def _path(name: str) -> Path:
    """File in which the program of this name is stored."""
    folder = program_folder()
    assert folder is not None, "`key_of` has found a folder"
    return folder / f"steps-{name}.bin"


@functools.cache
def _surroundings() -> str:
    """Text with a hash of jaxsph's source code, the libraries' versions, JAX's settings and the device."""
    code = hashlib.sha256()
    for file in sorted(Path(__file__).parents[1].rglob("*.py")):
        code.update(file.read_bytes())
    settings = sorted(
        (name, value) for name, value in jax.config.values.items() if isinstance(value, bool | int | str)
    )
    device = jax.devices()[0]
    versions = [version(name) for name in LIBRARIES]
    return f"{code.hexdigest()} {versions} {settings} {device.platform} {device.device_kind} {available()}"
