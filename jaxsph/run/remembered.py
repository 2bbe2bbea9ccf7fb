"""Remembers the sizes of neighbour tables that a case has needed, so that its next run is compiled only once.

The sizes are kept next to the programs that JAX has compiled. Larger tables do not change a single bit of the
results. The number of steps between searches can change results, and is not remembered.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
from pathlib import Path

from jaxsph.core.programs import program_folder
from jaxsph.model.interfaces import Model
from jaxsph.problem.source import Source
from jaxsph.run.chunks import search_settings, with_settings

SIZES = ("capacity", "node_capacity", "chamber_capacity")
"""Names of the `search_settings` that are remembered."""


def with_remembered(source: Source, model: Model) -> Model:
    """Returns the model of a source with the table sizes that an earlier run of the source needed."""
    known: dict[str, int] = {}
    with contextlib.suppress(OSError, ValueError):  # nothing is known, or the file is damaged
        path = _path(source, model)
        known = {} if path is None else json.loads(path.read_text())
    now = search_settings(model)
    larger = {
        name: known[name] for name in SIZES if isinstance(known.get(name), int) and known[name] > now[name]
    }
    return with_settings(model, larger) if larger else model


def remember(source: Source, first: Model, model: Model) -> None:
    """Stores the sizes of `model`'s tables, if they are larger than those of the source's `first` model."""
    then, now = search_settings(first), search_settings(model)
    path = _path(source, first)
    if path is not None and any(now[name] > then[name] for name in SIZES):
        with contextlib.suppress(OSError):  # the next run enlarges its tables again
            path.write_text(json.dumps({name: now[name] for name in SIZES}))


def _path(source: Source, model: Model) -> Path | None:
    """File for the table sizes of a source; None if JAX has no cache of compiled programs."""
    folder = program_folder()
    key = hashlib.sha256(f"{source.to_toml()} {search_settings(model)}".encode()).hexdigest()
    return None if folder is None else folder / f"sizes-{key[:32]}.json"
