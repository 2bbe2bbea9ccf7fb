"""Readings of several probes in one mapping; the names of the readings must differ."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TypeVar

import jax

from jaxsph.model.interfaces import Model
from jaxsph.model.meaning import Reading
from jaxsph.model.probe import AbstractProbe
from jaxsph.model.state import State, Tables

__all__ = ["described", "measured"]

V = TypeVar("V")


def measured(
    probes: Sequence[AbstractProbe], model: Model, state: State, tables: Tables
) -> dict[str, jax.Array]:
    """Readings of all probes, by name, with "time" (s).

    **Raises** ValueError if two names are equal, or if a probe does not describe exactly its readings.
    """
    found = [probe.measure(model, state, tables) for probe in probes]
    for probe, readings in zip(probes, found, strict=True):
        if readings.keys() != probe.describe().keys():
            raise ValueError(
                f"{type(probe).__name__}.measure returns the readings {sorted(readings)}, and describe "
                f"{sorted(probe.describe())}: both must return the same names"
            )
    return _joined({"time": model.time(state)}, probes, found)


def described(probes: Sequence[AbstractProbe]) -> dict[str, Reading]:
    """Unit and meaning of all probes' readings, by name, with "time". **Raises** as `measured` does."""
    return _joined({"time": Reading("s", "time")}, probes, (probe.describe() for probe in probes))


def _joined(
    first: dict[str, V], probes: Sequence[AbstractProbe], found: Iterable[Mapping[str, V]]
) -> dict[str, V]:
    joined, owner = dict(first), dict.fromkeys(first, "the run")
    for probe, readings in zip(probes, found, strict=True):
        for name, value in readings.items():
            if name in joined:
                raise ValueError(
                    f"the reading {name!r} of {type(probe).__name__} has the same name as a reading of "
                    f"{owner[name]}: rename one of the parts that are measured, or leave out one probe"
                )
            joined[name], owner[name] = value, type(probe).__name__
    return joined
