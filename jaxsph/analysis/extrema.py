"""Crests and troughs of a series, and the errors of their heights and times.

Equation numbers refer to Zhu et al. (2020).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy  # which imports its subpackages on first use
from numpy.typing import ArrayLike, NDArray

from jaxsph.analysis.periods import Series, checked


class Extrema(NamedTuple):
    """Crests and troughs of a series, in time order."""

    t: Series
    """Times of the extrema, s."""
    y: Series
    """Values of the extrema, in the unit of the series."""
    sign: NDArray[np.int_]
    """Kinds of the extrema: +1 for a crest, -1 for a trough."""


def extrema(t: ArrayLike, y: ArrayLike, window: int = 1, prominence: float = 0.1) -> Extrema:
    """Crests and troughs of a series y at times t (s), each located by a parabola through three points.

    `window` samples (odd, 5 or more) smooth a noisy, uniformly sampled series by local parabolas
    (Savitzky-Golay), which preserve the height of a crest; 1 means no smoothing. `prominence` is the smallest
    height by which an extremum must stand out, as a fraction of the range of the series. **Raises**
    ValueError if there is no extremum.
    """
    t, y = checked(t, y)
    if window > 1:
        y = scipy.signal.savgol_filter(y, window, 2)
    threshold = prominence * np.ptp(y)
    found = [(i, s) for s in (1, -1) for i in scipy.signal.find_peaks(s * y, prominence=threshold)[0]]
    if not found:
        raise ValueError(
            f"the series has no extremum: no crest or trough stands out by prominence = {prominence:g} of "
            "the range of the series; use a smaller prominence or a longer series"
        )
    index, sign = np.array(sorted(found)).T
    h0, h1 = t[index] - t[index - 1], t[index + 1] - t[index]
    s0, s1 = (y[index] - y[index - 1]) / h0, (y[index + 1] - y[index]) / h1
    curvature = (s1 - s0) / (h0 + h1)
    slope = (s0 * h1 + s1 * h0) / (h0 + h1)
    # A flat top has neither slope nor curvature: leave the extremum at its sample.
    safe = np.where(curvature == 0.0, 1.0, curvature)
    shift = np.where(curvature == 0.0, 0.0, -0.5 * slope / safe)
    return Extrema(t[index] + shift, y[index] + 0.5 * slope * shift, sign)


def matched_extrema(
    t: ArrayLike,
    eta: ArrayLike,
    t_ref: ArrayLike,
    eta_ref: ArrayLike,
    T: float,
    window: int = 1,
    prominence: float = 0.1,
) -> tuple[Series, Series]:
    """Matched extrema (reference, series) of two elevations: times [pairs, 2] (s), values [pairs, 2] (m).

    Each reference extremum is paired with the nearest extremum of the same kind within T / 2. A reference
    extremum without a partner is left out if it lies within T / 2 of the start or end of the common time
    range. **Raises** ValueError if a partner is missing elsewhere (leaving the extremum out would understate
    the error), and if no reference extremum has a partner.
    """
    found = extrema(t, eta, window, prominence)
    reference = extrema(t_ref, eta_ref, 1, prominence)
    start = max(np.min(t), np.min(t_ref)) + 0.5 * T
    end = min(np.max(t), np.max(t_ref)) - 0.5 * T
    times, values = [], []
    for t_r, y_r, sign in zip(*reference, strict=True):
        distance = np.where(found.sign == sign, np.abs(found.t - t_r), np.inf)
        j = int(np.argmin(distance))
        if distance[j] <= 0.5 * T:
            times.append((t_r, found.t[j]))
            values.append((y_r, found.y[j]))
        elif start <= t_r <= end:
            kind = "crest" if sign > 0 else "trough"
            raise ValueError(
                f"the series has no {kind} within T/2 = {0.5 * T:.4g} s of the reference {kind} at "
                f"t = {t_r:.6g} s; use a smaller prominence, or compare another interval"
            )
    if not times:
        raise ValueError(
            f"no extremum of the series is within T/2 = {0.5 * T:.4g} s of an extremum of the reference; "
            "give series that cover the same times"
        )
    return np.array(times), np.array(values)


def mae_amplitude(
    t: ArrayLike,
    eta: ArrayLike,
    t_ref: ArrayLike,
    eta_ref: ArrayLike,
    A: float,
    T: float,
    window: int = 1,
    prominence: float = 0.1,
) -> float:
    """Ratio of the mean absolute error of crests and troughs to the amplitude A (m), Eq. 29 (-).

    Crests and troughs have equal weight. Pairing, options and exceptions are as in `matched_extrema`.
    """
    _, values = matched_extrema(t, eta, t_ref, eta_ref, T, window, prominence)
    return float(np.mean(np.abs(values[:, 0] - values[:, 1])) / A)


def mae_phase(
    t: ArrayLike,
    eta: ArrayLike,
    t_ref: ArrayLike,
    eta_ref: ArrayLike,
    T: float,
    window: int = 1,
    prominence: float = 0.1,
) -> float:
    """Ratio of the mean absolute error of the times of crests and troughs to the period T (s), Eq. 30 (-).

    Pairing, options and exceptions are as in `matched_extrema`.
    """
    times, _ = matched_extrema(t, eta, t_ref, eta_ref, T, window, prominence)
    return float(np.mean(np.abs(times[:, 0] - times[:, 1])) / T)
