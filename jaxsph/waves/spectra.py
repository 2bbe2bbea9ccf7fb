"""Variance spectra of sea states, and seas drawn from them; host numpy in double precision.

S(f) in m2/Hz over the frequency f in Hz; Hs is four times the standard deviation of the elevation.
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
"""Frequencies over the peak's between which a sea is made: outside lie 1.3 % of a JONSWAP
spectrum's variance and 2 % of Bretschneider's, which the amplitudes of the rest make up for."""


@dataclass(frozen=True)
class AbstractSpectrum(abc.ABC):
    """Variance spectrum of a sea state, of the significant height Hs and the peak period Tp."""

    Hs: float
    """Significant wave height, m."""
    Tp: float
    """Peak period, s."""

    @abc.abstractmethod
    def shape(self, ratio: Real) -> Real:
        """Shape of the spectrum over the frequency's ratio to the peak's (-); any factor."""

    def density(self, f: ArrayLike) -> Real:
        """Variance density S at the frequencies f (Hz), m2/Hz."""
        f = np.asarray(f, float)
        whole = scipy.integrate.quad(lambda r: float(self.shape(np.array(r))), 0.05, 1.0)[0]
        whole += scipy.integrate.quad(lambda r: float(self.shape(np.array(r))), 1.0, 30.0, limit=200)[0]
        some = np.where(f > 0.0, f, 1.0) * self.Tp
        return np.where(f > 0.0, self.shape(some), 0.0) * self.Tp * (self.Hs / 4.0) ** 2 / whole


@dataclass(frozen=True)
class JONSWAP(AbstractSpectrum):
    """Spectrum of seas that grow (Hasselmann et al. 1973), scaled to its significant height."""

    gamma: float = 3.3
    """Peak enhancement (-); 1 is the spectrum of a grown sea."""

    def shape(self, ratio):
        """See `AbstractSpectrum`."""
        width = np.where(ratio <= 1.0, 0.07, 0.09)
        peak = self.gamma ** np.exp(-((ratio - 1.0) ** 2) / (2.0 * width**2))
        return ratio**-5.0 * np.exp(-1.25 * ratio**-4.0) * peak


@dataclass(frozen=True)
class Bretschneider(AbstractSpectrum):
    """Spectrum of a grown sea of any height and period (Bretschneider 1959; ITTC's of two parameters)."""

    def shape(self, ratio):
        """See `AbstractSpectrum`."""
        return ratio**-5.0 * np.exp(-1.25 * ratio**-4.0)


def pierson_moskowitz_height(Tp: float, g: float = 9.81) -> float:
    """Significant height (m) of a sea that is fully grown at its peak period Tp (s).

    Pierson and Moskowitz (1964): Hs = 4 sqrt(alpha / 5) g (Tp / 2 pi)^2 with alpha = 0.0081. The spectrum is
    Bretschneider's of that height.
    """
    return float(4.0 * np.sqrt(0.0081 / 5.0) * g * (Tp / (2.0 * np.pi)) ** 2)


def draw_sea(
    spectrum: AbstractSpectrum, duration: float, seed: int
) -> tuple[NDArray[np.complexfloating], Real]:
    """Complex amplitudes (m) and angular frequencies (rad/s) of a sea that repeats after `duration` (s).

    Amplitudes are those of the spectrum, sqrt(2 S df), and phases random: every sea has the same variance,
    and its groups are those of a sum of waves.
    """
    f = _frequencies(spectrum, duration)
    phase = 2.0 * np.pi * np.random.default_rng(seed).random(len(f))
    return np.asarray(_amplitudes(spectrum, f) * np.exp(1j * phase), complex), 2.0 * np.pi * f


def draw_group(
    spectrum: AbstractSpectrum, duration: float, crest: float
) -> tuple[NDArray[np.complexfloating], Real]:
    """Complex amplitudes (m) and angular frequencies (rad/s) of the group whose crest is at x = 0, t = 0.

    NewWave (Tromans, Anaturk and Hagemeijer 1991): amplitudes go with S df, and their sum is the crest's
    elevation (m); the mean shape of a sea about its highest crests. It repeats after `duration` (s).
    """
    f = _frequencies(spectrum, duration)
    share = spectrum.density(f)
    return crest * share / np.sum(share) + 0j, 2.0 * np.pi * f


def _frequencies(spectrum: AbstractSpectrum, duration: float) -> Real:
    """Multiples of 1 / duration at which there are waves, Hz."""
    first, last = (np.ceil(ratio * duration / spectrum.Tp) for ratio in (LOWEST, HIGHEST))
    return np.arange(first, last + 1) / duration


def _amplitudes(spectrum: AbstractSpectrum, f: Real) -> Real:
    """Amplitudes (m) of waves at frequencies f (Hz) in equal steps, of the spectrum's whole variance."""
    a = np.sqrt(2.0 * spectrum.density(f))
    return a * spectrum.Hs / 4.0 / np.sqrt(0.5 * np.sum(a**2))
