"""Whole periods of recorded series: masks, phase averages, efficiency.

Equation numbers refer to Zhu et al. (2020) unless another source is named. Times are in s.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy  # which imports its subpackages on first use
from numpy.typing import ArrayLike, NDArray

Series = NDArray[np.float64]
"""Array of samples in double precision."""


class Efficiency(NamedTuple):
    """Hydrodynamic efficiency as returned by `efficiency`: its mean, and its value in each period."""

    xi: float
    """Mean efficiency over the periods (-)."""
    per_period: Series
    """Efficiency in each period, oldest first (-)."""


def checked(t: ArrayLike, y: ArrayLike) -> tuple[Series, Series]:
    """Times and values as float64.

    **Raises** ValueError unless every value has a time, times increase and values are finite.
    """
    t, y = np.asarray(t, np.float64), np.asarray(y, np.float64)
    if t.ndim != 1 or t.size < 2 or y.shape[-1:] != t.shape:
        raise ValueError(
            f"a series of shape {y.shape} does not match times of shape {t.shape}: give at least two times, "
            "and one value for each along the last axis"
        )
    if not np.all(np.diff(t) > 0.0):
        raise ValueError("times are not strictly increasing: give every time once, in ascending order")
    if not np.all(np.isfinite(y)):
        raise ValueError("the series has values that are not finite: leave out these samples")
    return t, y


def whole_periods(t: ArrayLike, T: float, periods: int) -> NDArray[np.bool_]:
    """Mask of the samples in the last `periods` whole periods, both ends included.

    `t`: times (s); `T`: period (s). **Raises** ValueError if the record is too short by more than a
    hundredth of a sampling interval, the margin for rounding errors of accumulated or float32 times.
    """
    t = np.asarray(t, np.float64)
    if periods < 1 or T <= 0.0:
        raise ValueError(f"periods = {periods} must be 1 or more, and T = {T} s must be positive")
    if t.size < 2:
        raise ValueError(f"a record of {t.size} samples is too short: give at least two samples")
    start = t[-1] - periods * T
    slack = 0.01 * (t[-1] - t[0]) / (t.size - 1)
    if start < t[0] - slack:
        raise ValueError(
            f"the record of {t[-1] - t[0]:.6g} s is shorter than {periods} "
            f"period{'s' if periods > 1 else ''} of {T:.6g} s: use a longer record or fewer periods"
        )
    return t >= start - slack


def phase_average(t: ArrayLike, y: ArrayLike, T: float, n_bins: int = 40) -> tuple[Series, Series, Series]:
    """Phases t / T of bins (-), and mean and standard deviation of y in each bin, in the unit of y.

    The phases are in [0, 1). Bins are centred on j / n_bins, so that samples at these phases
    do not fall on an edge. All samples are used; select whole periods beforehand. **Raises**
    ValueError for an empty bin.
    """
    t, y = checked(t, y)
    index = np.round(t / T * n_bins).astype(int) % n_bins
    count = np.bincount(index, minlength=n_bins)
    if np.any(count == 0):
        raise ValueError(
            f"{np.sum(count == 0)} of the n_bins = {n_bins} phase bins are empty: use fewer bins"
        )
    mean = np.bincount(index, y, n_bins) / count
    deviation = np.sqrt(np.bincount(index, (y - mean[index]) ** 2, n_bins) / count)
    return np.arange(n_bins) / n_bins, mean, deviation


def per_period(t: ArrayLike, y: ArrayLike, T: float, periods: int) -> Series:
    """Mean of `y` in each of the last whole periods, oldest first, in the unit of y.

    Each value of `y` is a mean over the interval before its time `t` (s), like the powers of a run; the first
    sample of a record has no interval and is not used. **Raises** ValueError if the record is too short.
    """
    t, y = checked(t, y)
    whole_periods(t, T, periods)
    integral = np.concatenate([[0.0], np.cumsum(y[1:] * np.diff(t))])
    ends = np.maximum(t[-1] - T * np.arange(periods, -1, -1), t[0])
    return np.diff(np.interp(ends, t, integral)) / T


def efficiency(t: ArrayLike, power: ArrayLike, T: float, P_inc: float, periods: int) -> Efficiency:
    """Hydrodynamic efficiency xi over the last whole periods (-), Eqs 24 and 25.

    `power`: power absorbed by the device, a mean over the interval before each time `t` (s), in the unit of
    the incident power `P_inc` (W, or W/m per unit width as in `theory.incident_power`). **Raises** ValueError
    if the record is too short.
    """
    if not P_inc > 0.0:
        raise ValueError(f"the incident power P_inc = {P_inc} must be positive")
    found = per_period(t, power, T, periods) / P_inc
    return Efficiency(float(np.mean(found)), found)


SIGNIFICANT = 0.05
"""Probability with which `settled_from` leaves out the first period of a record that has settled."""
LEAST_PERIODS = 3
"""Smallest number of periods that `settled_from` keeps."""


def settled_from(values: ArrayLike) -> int:
    """Number of leading periods to leave out of a mean, from the means `values` of all periods, oldest first.

    Leading periods are left out until the remaining periods show neither a linear trend nor a first period
    that differs from the rest. Both criteria use Student's t-test (for the slope of a regression, and for a
    single observation against the rest), each at half of `SIGNIFICANT`. As in White (1997), the end of the
    transient is found from the record itself. Of ten settled periods, White's rule (MSER) leaves out a
    quarter on average, and this rule leaves out 1 %. A transient smaller than the scatter of the periods is
    not detected. At least `LEAST_PERIODS` remain.
    """
    values = np.asarray(values, np.float64)
    least = 1e-6 * np.max(np.abs(values), initial=0.0)  # ignore trends due to rounding of the readings
    for first in range(max(len(values) - LEAST_PERIODS, 0)):
        if not _has_transient(values[first:], least):
            return first
    return max(len(values) - LEAST_PERIODS, 0)


def _has_transient(y: Series, least: float) -> bool:
    """Whether periods have a trend or a first value unlike the rest; `least`: smallest scatter assumed."""
    n, rest = len(y), y[1:]
    scatter = max(float(np.std(rest, ddof=1)), least, 1e-300)
    first = abs(y[0] - np.mean(rest)) / (scatter * np.sqrt(1.0 + 1.0 / (n - 1)))
    place = np.arange(n) - 0.5 * (n - 1)
    slope = float(place @ y / (place @ place))
    residual = np.sqrt(np.sum((y - np.mean(y) - slope * place) ** 2) / (n - 2))
    trend = abs(slope) * np.sqrt(place @ place) / max(residual, least, 1e-300)
    # two two-sided tests, each at half of the level
    return bool(max(first, trend) > scipy.stats.t.isf(0.25 * SIGNIFICANT, n - 2))
