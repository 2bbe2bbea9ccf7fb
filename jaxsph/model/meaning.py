"""Meaning of the quantities that a run records: energies of the ledger, readings, scalar results."""

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
    """Direction in which an energy of the ledger passes between the water and a part."""

    GIVEN = "given"
    """Energy given to the water, for example by a paddle."""
    TAKEN = "taken"
    """Energy taken from the water and not harvested."""
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
    """Unit of the reading, for example "Pa"."""
    long_name: str
    """Name of the reading in words."""
    dimension: str | None = None
    """Name of the second dimension, for example "gauge"; None if a sample is one number."""
    group: str = "series"
    """Group of a run's file that stores the reading: "series" or "energy"."""


class Oscillation(NamedTuple):
    """Reading of a part that oscillates in regular waves; the amplitude of the reading is a result of a
    run."""

    reading: str
    """Name of the reading."""
    text: str
    """Name of the oscillation in words, for example "heave of the buoy"."""
    unit: str
    """Unit of the reading, for example "m"."""
    component: int | None = None
    """Index of the component that oscillates; None if the reading is one number."""
    has_mean: bool = False
    """Whether the mean is also a result, for example a drift force."""
    over_waves: bool = False
    """Whether the ratio of the amplitude to the amplitude of the incident waves is also a result (an RAO)."""
    drifts: bool = False
    """Whether the mean may change steadily; the change in a period is then also a result."""
    mean_is: str = ""
    """Explanation of the mean, for example "mean drift force"; empty if there is nothing to explain."""


class Group(enum.StrEnum):
    """Group of results in tables; the results of the device come first."""

    DEVICE = "device"
    """Results of the device: power, efficiency, motions, forces."""
    WAVES = "waves"
    """Waves in the run, and the time interval of the means."""
    NUMERICS = "numerics"
    """Quality of the run: energy balance, noise, cost."""


class Label(NamedTuple):
    """Meaning of a scalar result: its name in a table, its unit, and an explanation."""

    text: str
    """Name of the result in words. If the name begins with spaces, the result is a part of the preceding
    result, and a table omits the text up to the last colon, for example "efficiency: "."""
    unit: str = ""
    """Unit, for example "W/m"; labels of the package's own results give the unit for two dimensions."""
    meaning: str = ""
    """Explanation of the result; empty if the name is enough."""
    group: str = Group.DEVICE
    """Group of the result in a table: a `Group`."""
