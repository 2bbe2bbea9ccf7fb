"""Remembers the sizes of neighbour tables that runs have needed, so that fewer programs are compiled.

A case remembers the sizes that its last run needed. Cases whose programs differ in these sizes only, for
example OWCs of different draughts, use the sizes of the first of them. The sizes are kept next to the
programs that JAX has compiled. Larger tables do not change a single bit of the results. The number of steps
between searches can change results, and is not remembered.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax

from jaxsph.core.programs import program_folder
from jaxsph.core.search.cells import Cells
from jaxsph.model.interfaces import Model
from jaxsph.model.probe import AbstractProbe
from jaxsph.model.state import State
from jaxsph.problem.source import Source
from jaxsph.run.chunks import search_settings, with_settings

SIZES = {"capacity": (1.0, 1.1), "node_capacity": (1.0, 1.25), "chamber_capacity": (0.75, 2.0)}
"""Names of the `search_settings` that are remembered, with the range of ratios to a case's own size in which
the size of another case's program is used (-).

With a tenth more slots for the neighbours of particles a time step takes 4 % longer, which in a run of four
minutes is as long as the compilation of another program. The table of a chamber is small, and half of it is
spare.
"""

_programs: dict[str, dict[str, int]] = {}
"""Sizes of the programs of this process, by the key of their structure."""


def with_remembered(source: Source, model: Model) -> Model:
    """Returns the model of a source with the table sizes that an earlier run of the source needed."""
    now = search_settings(model)
    larger = {name: size for name, size in _read(_path(source, model)).items() if size > now[name]}
    return with_settings(model, larger) if larger else model


def remember(source: Source, first: Model, model: Model) -> None:
    """Stores the sizes of `model`'s tables, if they are larger than those of the source's `first` model."""
    then, now = search_settings(first), search_settings(model)
    if any(now[name] > then[name] for name in SIZES):
        _write(_path(source, first), {name: now[name] for name in SIZES})


def with_shared(model: Model, state: State, probes: Sequence[AbstractProbe]) -> Model:
    """Returns the model with the table sizes of an earlier run, of any case, if the run's program then serves
    this model; otherwise the model itself, whose sizes later runs may use."""
    if not isinstance(model.search.method, Cells):  # other searches have sizes of their own
        return model
    blank = with_settings(model, dict.fromkeys(SIZES, 0))
    leaves, structure = jax.tree.flatten((blank, state, tuple(probes)))
    key = f"{structure} {[jax.typeof(leaf) for leaf in leaves]}"
    path, now = _file("shared", key), search_settings(model)
    known, sizes = _programs.get(key) or _read(path), {}
    for name, (least, most) in SIZES.items():
        of_other = known.get(name, 0)
        sizes[name] = of_other if least * now[name] <= of_other <= most * now[name] else now[name]
    _programs[key] = sizes
    if sizes != known:
        _write(path, sizes)
    return with_settings(model, sizes)


def _path(source: Source, model: Model) -> Path | None:
    """File for the table sizes of a source; None if JAX has no cache of compiled programs."""
    return _file("sizes", f"{source.to_toml()} {search_settings(model)}")


def _file(kind: str, key: str) -> Path | None:
    """File of a kind for the table sizes with a key; None if JAX has no cache of compiled programs."""
    folder = program_folder()
    return folder and folder / f"{kind}-{hashlib.sha256(key.encode()).hexdigest()[:32]}.json"


def _read(path: Path | None) -> dict[str, int]:
    """Table sizes in a file; empty if nothing is known or the file is damaged."""
    found: Any = {}
    with contextlib.suppress(OSError, ValueError):
        found = json.loads(path.read_text()) if path else {}
    known = found if isinstance(found, dict) else {}
    return {name: known[name] for name in SIZES if isinstance(known.get(name), int)}


def _write(path: Path | None, sizes: dict[str, int]) -> None:
    """Stores table sizes; without a file, later runs find them out again."""
    with contextlib.suppress(OSError):
        if path:
            path.write_text(json.dumps(sizes))
