"""Record of a run, the window over which means are taken, and the scalar results computed from it."""

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
    """Part of a record over which all means of a run are taken."""

    over: NDArray[np.bool_]
    """Mask of the samples.

    The first sample starts the window. Its power is a mean over the time before the window and is not used.
    """
    periods: int = 0
    """Number of whole periods in the window; 0 if the window is the whole record since the last change."""
    left_out: int = 0
    """Number of periods left out before the window, in which the waves had arrived but the record still had a
    trend."""


class Record(NamedTuple):
    """Record of a run, from which its results are computed."""

    solution: Solution
    """Series of the whole run, its model and its last state."""
    window: Window
    """Part of the series over which means are taken."""
    since: float
    """Time of the last change of the problem during its run, s."""
    results: Scalars = MappingProxyType({})
    """Results computed before this one, by name."""

    @property
    def t(self) -> NDArray[np.float64]:
        """Times of the samples, s."""
        return self.solution.t

    def __getitem__(self, name: str) -> np.ndarray:
        """Series of the reading `name` over the whole run."""
        return self.solution[name]


class Result(NamedTuple):
    """Scalars computed from a run's record, for example a period or an efficiency."""

    make: Callable[[Record], Scalars]
    """Function that returns results by name. If it fails, a notice reports the error."""
    labels: Mapping[str, Label] = MappingProxyType({})
    """Label of each result: text, unit and meaning."""
    what: str = "result"
    """Name of the results in the notice that reports an error."""


class RegularWave(NamedTuple):
    """Period and height of regular waves, as specified."""

    T: float
    """Period, s."""
    H: float
    """Height, m."""


class AbstractAveraging(eqx.Module):
    """Choice of the part of a record over which means are taken."""

    def regular_wave(self) -> RegularWave | None:
        """Regular waves whose whole periods make up the window; None if there are no regular waves."""
        return None

    @abc.abstractmethod
    def window(self, t: NDArray[np.float64], powers: Sequence[np.ndarray], since: float) -> Window:
        """Window of a record with times t (s); `powers`: series that must settle; `since`: see `Record`."""

    def notices(self, record: Record, results: Scalars) -> list[str]:
        """Notices that a reader of the means should see."""
        del record, results
        return []


class WholeRecord(AbstractAveraging):
    """Averaging over the whole record after the last change of the problem during its run."""

    def window(self, t, powers, since):
        """See `AbstractAveraging.window`."""
        # a sample is the mean over the interval before it, so the sample at `since` starts the window
        return Window(t >= since - 1e-9)


class PowerMean(NamedTuple):
    """Result that is linear in the power over a window of the record; derivatives keep the window fixed."""

    of_power: Callable[[np.ndarray], float]
    """Function from the power of the power take-offs (W; W/m in 2-D) at the record's times to the result."""
    incident: Callable[..., float] = lambda _: 1.0
    """Function from a changed source to its incident power (W/m) over the same window, for an efficiency."""


MeanOfRecord = Callable[[np.ndarray, np.ndarray], PowerMean]
"""Function from the times (s) and the power (W; W/m in 2-D) of a record to a `PowerMean`."""


def harvested(model: Model) -> list[str]:
    """Names of the series of power absorbed by power take-offs, from the model's ledger."""
    return [f"power_{n}" for n, entry in model.entries().items() if entry.exchange is Exchange.HARVESTED]
