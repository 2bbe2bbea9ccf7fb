"""Meaning of what a run records: of the energies of the ledger, and of the readings of probes."""

from __future__ import annotations

import enum
from typing import NamedTuple

__all__ = [
    "Entry",
    "Exchange",
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
