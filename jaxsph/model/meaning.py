"""Meaning of what a run records: energies of the ledger, readings of probes, scalar results."""

from __future__ import annotations

import enum
from typing import NamedTuple

__all__ = [
    "Entry",
    "Exchange",
    "Group",
    "Label",
    "Oscillation",
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


class Oscillation(NamedTuple):
    """Reading of a part that swings with regular waves, and whose amplitude is a result of a run."""

    reading: str
    """Name of the reading."""
    text: str
    """What swings, in words, such as "heave of the buoy"."""
    unit: str
    """Unit of the reading, such as "m"."""
    component: int | None = None
    """Index of the component that is meant; None for a reading of one number."""
    has_mean: bool = False
    """Whether its mean is a result too, such as a drift force."""
    over_waves: bool = False
    """Whether its amplitude over that of the incident waves is a result too, such as an RAO."""


class Group(enum.StrEnum):
    """Group of results in tables: those of the device come first."""

    DEVICE = "device"
    """What the device does: power, efficiency, motions, forces."""
    WAVES = "waves"
    """The waves that were there, and over what time means are taken."""
    NUMERICS = "numerics"
    """How far the run can be trusted: its energy balance, its noise, its cost."""


class Label(NamedTuple):
    """Meaning of a scalar result: its name in a table, its unit, and what it says of the run."""

    text: str
    """Name of the result in words. One that begins with spaces is a part of the one before it; a table leaves
    out what it has before a colon, such as "efficiency: "."""
    unit: str = ""
    """Unit, such as "W/m"; in the labels of the package's own results that in two dimensions."""
    meaning: str = ""
    """What the result says, where its name does not."""
    group: str = Group.DEVICE
    """Group of the result in a table: a `Group`."""
