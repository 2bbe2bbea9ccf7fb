"""Variance spectra of recorded seas: heights and periods from moments, confidence bands, individual waves.

For elevations in m, the density S(f) is in m2/Hz and the frequency f in Hz. For other series, the unit of S
is the square of the unit of the series, per Hz.
"""

from __future__ import annotations

import itertools
from typing import Any, NamedTuple

import numpy as np
import scipy  # which imports its subpackages on first use
from numpy.typing import ArrayLike, NDArray

from jaxsph.analysis.periods import Series, checked
from jaxsph.waves import theory

BANDS = 8
"""Number of neighbouring frequencies averaged into a value of a spectrum."""
TAPER = 0.1
"""Fraction of a record that is tapered, at both ends together (-), because the values at the ends differ."""


class Spectrum(NamedTuple):
    """Variance spectrum of a record."""

    f: Series
    """Frequencies, Hz, evenly spaced."""
    S: Series
    """Variance density, m2/Hz."""
    freedom: float
    """Degrees of freedom of every value (-): two for each averaged frequency."""

    def moment(self, n: float) -> float:
        """Moment of order n of the spectrum, excluding zero frequency, m2 Hz^n."""
        above = self.f > 0.0
        return float(np.sum(self.f[above] ** n * self.S[above]) * (self.f[1] - self.f[0]))

    @property
    def Hm0(self) -> float:
        """Significant wave height, four standard deviations, m."""
        return 4.0 * float(np.sqrt(self.moment(0)))

    @property
    def Tp(self) -> float:
        """Peak period, s, from the mean frequency weighted by S^4 (Young 1995).

        The frequency of the highest value would jump between bins, by 5 % for 100 waves of a JONSWAP sea.
        """
        weight = self.S**4
        return float(np.sum(weight) / np.sum(weight * self.f))

    @property
    def Te(self) -> float:
        """Energy period m_-1 / m_0, s."""
        return self.moment(-1) / self.moment(0)

    @property
    def T02(self) -> float:
        """Mean zero-crossing period sqrt(m_0 / m_2), s."""
        return float(np.sqrt(self.moment(0) / self.moment(2)))

    def band(self, share: float = 0.9) -> tuple[Series, Series]:
        """Lower and upper bounds of the band that contains the true density with probability `share`, m2/Hz.

        For Gaussian waves, `freedom` times the ratio of the estimated to the true density has a chi-square
        distribution with `freedom` degrees of freedom.
        """
        tail = 0.5 * (1.0 - share)
        low, high = (self.freedom / scipy.stats.chi2.ppf(q, self.freedom) for q in (1.0 - tail, tail))
        return low * self.S, high * self.S

    def power(self, d: float, rho0: float = 1000.0, g: float = theory.GRAVITY) -> float:
        """Incident power in water of depth d (m), W per metre of crest: rho0 g times the sum of S c_g df."""
        above = self.f > 0.0
        speed = np.asarray(theory.group_velocity(2.0 * np.pi * self.f[above], d, g), float)
        return float(rho0 * g * np.sum(self.S[above] * speed) * (self.f[1] - self.f[0]))


def spectrum(t: ArrayLike, y: ArrayLike, bands: int = BANDS) -> Spectrum:
    """Variance spectrum of a series y at times t (s): a periodogram averaged over `bands` frequencies.

    **Raises** ValueError for times that are not evenly spaced, or fewer than 8 * `bands` samples.
    """
    t, y = checked(t, y)
    step = even_step(t)
    if y.ndim != 1 or t.size < 8 * bands:
        raise ValueError(
            f"a spectrum needs a one-dimensional series of at least {8 * bands} samples, not an array of "
            f"shape {y.shape}"
        )
    fade: Any = ("tukey", TAPER)  # the type stubs only have windows without parameters
    f, S = scipy.signal.periodogram(y, 1.0 / step, window=fade, detrend="constant")
    return banded(f, S, bands)


def banded(f: ArrayLike, S: ArrayLike, bands: int = BANDS) -> Spectrum:
    """Spectrum averaged over `bands` neighbouring frequencies (Daniell), excluding zero frequency.

    Unknown densities (NaN) are left out of the average; the average is 0 if all of them are unknown.
    """
    f, S = np.asarray(f, float)[1:], np.asarray(S, float)[1:]
    count = len(f) // bands
    rows = S[: count * bands].reshape(count, bands)
    known = np.isfinite(rows)
    mean = np.sum(np.where(known, rows, 0.0), axis=1) / np.maximum(np.sum(known, axis=1), 1)
    return Spectrum(f[: count * bands].reshape(count, bands).mean(axis=1), mean, 2.0 * bands)


def even_step(t: Series) -> float:
    """Time between samples, s. **Raises** ValueError if this time varies by more than 1 %."""
    step = np.diff(t)
    usual = float((t[-1] - t[0]) / step.size)
    if np.any(np.abs(step - usual) > 0.01 * usual):
        raise ValueError("times are not evenly spaced: resample the series")
    return usual


class ZeroCrossingWaves(NamedTuple):
    """Individual waves of a record, each from one upward crossing of the mean to the next."""

    H: Series
    """Heights from trough to crest, m."""
    T: Series
    """Periods, s."""

    @property
    def significant(self) -> float:
        """Mean height of the highest third, m."""
        return float(np.mean(np.sort(self.H)[-max(len(self.H) // 3, 1) :]))

    def exceedance(self) -> tuple[Series, Series]:
        """Heights (m) in ascending order, and the fraction of waves that are higher than each of them (-)."""
        n = len(self.H)
        return np.sort(self.H), 1.0 - (np.arange(n) + 0.5) / n


def rayleigh_exceedance(H: ArrayLike, Hm0: float) -> NDArray[np.float64]:
    """Fraction (-) of waves higher than H (m) in a narrow-banded sea of significant wave height Hm0 (m)."""
    return np.exp(-2.0 * (np.asarray(H, float) / Hm0) ** 2)


def zero_crossing_waves(t: ArrayLike, eta: ArrayLike) -> ZeroCrossingWaves:
    """Individual waves of an elevation eta (m) at times t (s).

    **Raises** ValueError if the record contains no whole wave.
    """
    t, eta = checked(t, eta)
    y = eta - np.mean(eta)
    up = np.flatnonzero((y[:-1] < 0.0) & (y[1:] >= 0.0))
    if len(up) < 2:
        raise ValueError(
            f"a whole wave needs two upward crossings of the mean, not {len(up)}: use a longer record"
        )
    when = t[up] - y[up] * (t[up + 1] - t[up]) / (y[up + 1] - y[up])
    H = [np.ptp(y[a + 1 : b + 1]) for a, b in itertools.pairwise(up)]
    return ZeroCrossingWaves(np.array(H), np.diff(when))


class Mean(NamedTuple):
    """Mean of a series and its standard error."""

    value: float
    """Mean, in the series' unit."""
    error: float
    """Standard error of the mean, in the series' unit."""


def mean_with_error(y: ArrayLike) -> Mean:
    """Mean of an evenly sampled, correlated series and its standard error, s sqrt(2 tau / n).

    s is the standard deviation of the n samples. The integral time scale tau, in samples, is 0.5 plus the sum
    of the autocorrelation from lag 1 to the first lag beyond six tau (Sokal 1997). For a series shorter than
    about ten tau the computed error is too small. **Raises** ValueError for fewer than 8 samples.
    """
    y = np.asarray(y, np.float64)
    n = y.size
    if y.ndim != 1 or n < 8:
        raise ValueError(
            "the standard error of a mean needs a one-dimensional series of at least 8 samples, not an array "
            f"of shape {y.shape}"
        )
    rest = y - np.mean(y)
    variance = float(np.mean(rest**2))
    if variance <= (1e-12 * np.max(np.abs(y))) ** 2:
        return Mean(float(np.mean(y)), 0.0)
    size = 2 ** int(np.ceil(np.log2(2 * n)))
    transform = np.fft.rfft(rest, size)
    correlation = np.fft.irfft(np.abs(transform) ** 2, size)[:n] / (variance * n)
    tau = np.cumsum(correlation) - 0.5
    window = np.flatnonzero(np.arange(n) >= 6.0 * tau)
    found = max(float(tau[window[0]]) if window.size else float(tau[-1]), 0.5)
    return Mean(float(np.mean(y)), float(np.sqrt(variance * 2.0 * found / n)))
