"""Record of a run, the part of it that means are taken over, and the scalars made from it."""

from __future__ import annotations

import abc
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import equinox as eqx
import numpy as np
from numpy.typing import NDArray

from jaxsph.model.interfaces import Model
from jaxsph.model.meaning import Exchange, Label
from jaxsph.model.solution import Solution

Scalars = Mapping[str, float]
"""Results by name."""


class Window(NamedTuple):
    """Part of a record over which every mean of a run is taken."""

    over: NDArray[np.bool_]
    """Mask of its samples; the first begins the window, and the means before it are not in it."""
    periods: int = 0
    """Whole periods in the window; 0 where none has settled, and the window is all of the record."""
    left_out: int = 0
    """Periods before the window that the waves had reached, and in which the record still had a trend."""


class Record(NamedTuple):
    """Record of a run: what its results are made from."""

    solution: Solution
    """Series of the whole run, its model and its last state."""
    window: Window
    """Part of the series over which means are taken."""
    since: float
    """Time of the last change of the problem in the course of its run, s."""
    results: Scalars = MappingProxyType({})
    """Results that were made before this one."""

    @property
    def t(self) -> NDArray[np.float64]:
        """Times of the samples, s."""
        return self.solution.t

    def __getitem__(self, name: str) -> np.ndarray:
        """Series of the reading called `name`, over the whole run."""
        return self.solution[name]


class Result(NamedTuple):
    """Scalars made from a run's record, such as a period or an efficiency."""

    make: Callable[[Record], Scalars]
    """Results by name. What it raises is told in a notice, and costs no other result."""
    labels: Mapping[str, Label] = MappingProxyType({})
    """Label of each result: its words, unit and meaning."""
    what: str = "result"
    """What is made, in the words of the notice that says why it could not be."""


class RegularWave(NamedTuple):
    """Regular waves that were asked for."""

    T: float
    """Period, s."""
    H: float
    """Height, m."""


class AbstractAveraging(eqx.Module):
    """Choice of the part of a record over which means are taken."""

    def regular_wave(self) -> RegularWave | None:
        """Regular waves whose whole periods the window holds; None for a sea, or no waves."""
        return None

    @abc.abstractmethod
    def window(self, t: NDArray[np.float64], powers: Sequence[np.ndarray], since: float) -> Window:
        """Window of a record; `powers`: series that must have settled in it; `since`: see `Record`."""

    def notices(self, record: Record, results: Scalars) -> list[str]:
        """What a reader of the means should know."""
        del record, results
        return []


class WholeRecord(AbstractAveraging):
    """Means over the whole record, from the run's last change on."""

    def window(self, t, powers, since):
        """See `AbstractAveraging`."""
        # a sample is a mean over the interval before it: `since` is a sample
        return Window(t >= since - 1e-9)


class PowerMean(NamedTuple):
    """A result that is linear in the power, over a part of a record that does not depend on the slope."""

    of_power: Callable[[np.ndarray], float]
    """The result of the power take-offs' power (W; W/m in 2-D) at the record's times."""
    incident: Callable[..., float] = lambda _: 1.0
    """Incident power (W/m) over the same time of what is run, changed; an efficiency is over it."""


MeanOfRecord = Callable[[np.ndarray, np.ndarray], PowerMean]
"""Mean of a record's power, by its times (s) and its power (W; W/m in 2-D)."""


def harvested(model: Model) -> list[str]:
    """Names of the series of the powers that power take-offs take, by the model's ledger."""
    return [f"power_{n}" for n, entry in model.entries().items() if entry.exchange is Exchange.HARVESTED]
