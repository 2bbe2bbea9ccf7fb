"""Recorded series and their whole periods: masks, phase averages, efficiency.

Equation numbers are those of Zhu et al. (2020) unless another source is named. Times in s.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Series = NDArray[np.float64]
"""Array of samples in double precision."""


class Efficiency(NamedTuple):
    """Hydrodynamic efficiency, mean and by period: the result of `efficiency`."""

    xi: float
    """Mean efficiency over the periods (-)."""
    per_period: Series
    """Efficiency in each period, oldest first (-)."""


def checked(t: ArrayLike, y: ArrayLike) -> tuple[Series, Series]:
    """Times and values as float64, checked: one time per sample, times increasing, values finite."""
    t, y = np.asarray(t, np.float64), np.asarray(y, np.float64)
    if t.ndim != 1 or t.size < 2 or y.shape[-1:] != t.shape:
        raise ValueError(f"series of shape {y.shape} does not go with times of shape {t.shape}")
    if not np.all(np.diff(t) > 0.0):
        raise ValueError("times are not strictly increasing")
    if not np.all(np.isfinite(y)):
        raise ValueError("the series has values that are not finite")
    return t, y


def whole_periods(t: ArrayLike, T: float, periods: int) -> NDArray[np.bool_]:
    """Mask of the samples in the last `periods` whole periods, both ends included.

    `t`: times (s); `T`: period (s). **Raises** ValueError if the record is shorter by more than a hundredth
    of a sampling interval, which times accumulated or rounded to float32 may lack.
    """
    t = np.asarray(t, np.float64)
    if periods < 1 or T <= 0.0:
        raise ValueError(f"periods = {periods} and T = {T} must be positive")
    if t.size < 2:
        raise ValueError(f"a record of {t.size} samples has no period")
    start = t[-1] - periods * T
    slack = 0.01 * (t[-1] - t[0]) / (t.size - 1)
    if start < t[0] - slack:
        raise ValueError(f"the record of {t[-1] - t[0]:.6g} s is shorter than {periods} periods of {T:.6g} s")
    return t >= start - slack


def phase_average(t: ArrayLike, y: ArrayLike, T: float, n_bins: int = 40) -> tuple[Series, Series, Series]:
    """Phases t / T of bins (-), and the mean and standard deviation of y in each, in the unit of y.

    The phases are in [0, 1). Bins are centred on j / n_bins, so that sampling at those phases
    does not fall on an edge. All samples count: choose whole periods first. **Raises**
    ValueError for an empty bin.
    """
    t, y = checked(t, y)
    index = np.round(t / T * n_bins).astype(int) % n_bins
    count = np.bincount(index, minlength=n_bins)
    if np.any(count == 0):
        raise ValueError(f"{np.sum(count == 0)} of {n_bins} phase bins are empty: use fewer")
    mean = np.bincount(index, y, n_bins) / count
    deviation = np.sqrt(np.bincount(index, (y - mean[index]) ** 2, n_bins) / count)
    return np.arange(n_bins) / n_bins, mean, deviation


def efficiency(t: ArrayLike, power: ArrayLike, T: float, P_inc: float, periods: int) -> Efficiency:
    """Hydrodynamic efficiency xi over the last whole periods (-), Eqs 24 and 25.

    `power`: absorbed by the device at times `t` (s), in the unit of the incident power
    `P_inc` (W, or W/m per unit width as `theory.incident_power`). The integral is
    trapezoidal, with the power interpolated at the ends of the periods. **Raises** ValueError
    for a short record.
    """
    t, power = checked(t, power)
    if not P_inc > 0.0:
        raise ValueError(f"incident power P_inc = {P_inc} must be positive")
    whole_periods(t, T, periods)
    energy = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1]) * np.diff(t))])
    # The integral of a linear interpolant is quadratic between samples.
    ends = np.maximum(t[-1] - T * np.arange(periods, -1, -1), t[0])
    j = np.clip(np.searchsorted(t, ends, side="right") - 1, 0, t.size - 2)
    step = ends - t[j]
    at_ends = energy[j] + 0.5 * step * (power[j] + np.interp(ends, t, power))
    per_period = np.diff(at_ends) / (T * P_inc)
    return Efficiency(float(np.mean(per_period)), per_period)
