"""Variance spectra of sea states, and seas drawn from the spectra, by numpy on the host in double precision.

The density S(f) is in m2/Hz and the frequency f in Hz. Hs is four times the standard deviation of the
elevation.
"""

from __future__ import annotations

import abc
from dataclasses import dataclass

import numpy as np
import scipy  # which imports its subpackages on first use
from numpy.typing import ArrayLike, NDArray

Real = NDArray[np.floating]
"""Real numbers in double precision."""

LOWEST, HIGHEST = 0.5, 2.8
"""Lowest and highest frequency of a drawn sea, in multiples of the peak frequency.

Frequencies outside this range contain 1.3 % of the variance of a JONSWAP spectrum and 2 % of Bretschneider's.
The amplitudes inside the range are scaled up so that the sea has the full variance.
"""


@dataclass(frozen=True)
class AbstractSpectrum(abc.ABC):
    """Variance spectrum of a sea state with significant wave height Hs and peak period Tp."""

    Hs: float
    """Significant wave height, m."""
    Tp: float
    """Peak period, s."""

    @abc.abstractmethod
    def shape(self, ratio: Real) -> Real:
        """Shape of the spectrum at a `ratio` of frequency to peak frequency (-), up to a constant factor."""

    def density(self, f: ArrayLike) -> Real:
        """Variance density S at the frequencies f (Hz), m2/Hz."""
        f = np.asarray(f, float)
        whole = scipy.integrate.quad(lambda r: float(self.shape(np.array(r))), 0.05, 1.0)[0]
        whole += scipy.integrate.quad(lambda r: float(self.shape(np.array(r))), 1.0, 30.0, limit=200)[0]
        some = np.where(f > 0.0, f, 1.0) * self.Tp
        return np.where(f > 0.0, self.shape(some), 0.0) * self.Tp * (self.Hs / 4.0) ** 2 / whole


@dataclass(frozen=True)
class JONSWAP(AbstractSpectrum):
    """JONSWAP spectrum of a growing sea (Hasselmann et al. 1973), scaled to the significant wave height."""

    gamma: float = 3.3
    """Peak enhancement (-); 1 gives the spectrum of a fully developed sea."""

    def shape(self, ratio):
        """See `AbstractSpectrum`."""
        width = np.where(ratio <= 1.0, 0.07, 0.09)
        peak = self.gamma ** np.exp(-((ratio - 1.0) ** 2) / (2.0 * width**2))
        return ratio**-5.0 * np.exp(-1.25 * ratio**-4.0) * peak


@dataclass(frozen=True)
class Bretschneider(AbstractSpectrum):
    """Spectrum of a developed sea of any height and period (Bretschneider 1959; two-parameter ITTC)."""

    def shape(self, ratio):
        """See `AbstractSpectrum`."""
        return ratio**-5.0 * np.exp(-1.25 * ratio**-4.0)


def pierson_moskowitz_height(Tp: float, g: float = 9.81) -> float:
    """Significant wave height (m) of a fully developed sea of peak period Tp (s).

    Pierson and Moskowitz (1964): Hs = 4 sqrt(alpha / 5) g (Tp / 2 pi)^2 with alpha = 0.0081. The
    spectrum of this sea is a Bretschneider spectrum with this height and Tp.
    """
    return float(4.0 * np.sqrt(0.0081 / 5.0) * g * (Tp / (2.0 * np.pi)) ** 2)


def draw_sea(
    spectrum: AbstractSpectrum, duration: float, seed: int
) -> tuple[NDArray[np.complexfloating], Real]:
    """Complex amplitudes (m) and angular frequencies (rad/s) of a sea that repeats after `duration` (s).

    Amplitudes follow the spectrum, sqrt(2 S df), and only the phases are random. Every sea therefore has the
    same variance; wave groups arise from the superposition of the waves.
    """
    f = _frequencies(spectrum, duration)
    phase = 2.0 * np.pi * np.random.default_rng(seed).random(len(f))
    return np.asarray(_amplitudes(spectrum, f) * np.exp(1j * phase), complex), 2.0 * np.pi * f


def draw_group(
    spectrum: AbstractSpectrum, duration: float, crest: float
) -> tuple[NDArray[np.complexfloating], Real]:
    """Complex amplitudes (m) and angular frequencies (rad/s) of a group whose crest is at x = 0, t = 0.

    The group is a NewWave (Tromans, Anaturk and Hagemeijer 1991), the mean shape of a sea about its highest
    crests. Amplitudes are proportional to S df, and their sum is the elevation `crest` (m). The group repeats
    after `duration` (s).
    """
    f = _frequencies(spectrum, duration)
    share = spectrum.density(f)
    return crest * share / np.sum(share) + 0j, 2.0 * np.pi * f


def spread_directions(count: int, exponent: float, seed: int, within: tuple[float, float]) -> Real:
    """Directions (rad) of `count` waves about their mean direction, in random order.

    The density of the directions is proportional to cos^2s(theta/2) with the `exponent` s (Longuet-Higgins,
    Cartwright and Smith 1963), between the two limits `within`. The directions are the quantiles of this
    distribution, and only their order is random, so that even a sea of few waves has the correct mean and
    spread.
    """
    theta, share = _spread(exponent, within)
    found = np.interp((np.arange(count) + 0.5) / count, share / share[-1], theta)
    # a separate random stream, so that the phases of the sea do not depend on its directions
    return np.random.default_rng([seed, 1]).permutation(found)


def spread_beyond(exponent: float, within: tuple[float, float]) -> float:
    """Fraction (-) of the energy of a spread sea whose direction (rad from the mean) is outside two
    limits."""
    return 1.0 - float(_spread(exponent, within)[1][-1] / _spread(exponent, (-np.pi, np.pi))[1][-1])


def _spread(exponent: float, within: tuple[float, float]) -> tuple[Real, Real]:
    """Directions (rad) between two limits; integral of cos^2s(theta/2) from the lower limit to each."""
    theta = np.linspace(*within, 20_001)
    density = np.cos(0.5 * theta) ** (2.0 * exponent)
    return theta, scipy.integrate.cumulative_trapezoid(density, theta, initial=0.0)


def _frequencies(spectrum: AbstractSpectrum, duration: float) -> Real:
    """Frequencies of the waves, multiples of 1 / duration, Hz."""
    first, last = (np.ceil(ratio * duration / spectrum.Tp) for ratio in (LOWEST, HIGHEST))
    return np.arange(first, last + 1) / duration


def _amplitudes(spectrum: AbstractSpectrum, f: Real) -> Real:
    """Amplitudes (m) of waves at evenly spaced frequencies f (Hz), scaled to the spectrum's variance."""
    a = np.sqrt(2.0 * spectrum.density(f))
    return a * spectrum.Hs / 4.0 / np.sqrt(0.5 * np.sum(a**2))
