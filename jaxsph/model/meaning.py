"""Meaning of what a run records: energies of the ledger, readings of probes, scalar results."""

from __future__ import annotations

import enum
from typing import NamedTuple

__all__ = [
    "Entry",
    "Exchange",
    "Label",
    "Reading",
]


class Exchange(enum.Enum):
    """Direction of an energy in the ledger, between the water and a part."""

    GIVEN = "given"
    """Energy given to the water by a moving part."""
    TAKEN = "taken"
    """Energy taken from the water and lost."""
    HARVESTED = "harvested"
    """Energy taken from the water by a power take-off."""


class Entry(NamedTuple):
    """Meaning of one energy of the ledger: its long name and its direction."""

    long_name: str
    """Name of the energy in words."""
    exchange: Exchange = Exchange.TAKEN
    """Direction of the energy."""


class Reading(NamedTuple):
    """Meaning of one reading of a probe: its unit, long name, dimension and group."""

    units: str
    """Unit of the reading, such as "Pa"."""
    long_name: str
    """Name of the reading in words."""
    dimension: str | None = None
    """Name of the second dimension, such as "gauge"; None for one number a sample."""
    group: str = "series"
    """Group of a run's file that keeps the reading: "series" or "energy"."""


class Label(NamedTuple):
    """Meaning of a scalar result: its name in a table, its unit, and what it says of the run."""

    text: str
    """Name of the result in words; one that begins with spaces is a part of the one before it."""
    unit: str = ""
    """Unit, such as "W/m"; in the labels of the package's own results that in two dimensions."""
    meaning: str = ""
    """What the result says, where its name does not."""
