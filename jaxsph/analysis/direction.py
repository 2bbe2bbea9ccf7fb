"""Direction of waves from three gauges or more at points of the water surface."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy  # which imports its subpackages on first use
from numpy.typing import ArrayLike, NDArray

from jaxsph.analysis.periods import Series, checked
from jaxsph.analysis.reflection import fundamental
from jaxsph.analysis.spectrum import TAPER, even_step
from jaxsph.waves import theory

_MAX_CONDITION = 10.0
"""Largest permitted ratio of a group of gauges' longest extent to its shortest extent (-)."""


class WaveDirection(NamedTuple):
    """Direction, height and wavenumber of regular waves, as returned by `wave_direction`."""

    direction: float
    """Direction towards which the waves travel, rad from the x axis towards the y axis."""
    height: float
    """Height of the fundamental from trough to crest, averaged over the gauges, m."""
    wavenumber: float
    """Wavenumber, rad/m."""


class SeaDirection(NamedTuple):
    """Mean direction and spread of a sea, as returned by `sea_direction`."""

    direction: float
    """Mean direction towards which the waves travel, weighted by their energy, rad from the x axis towards
    the y axis."""
    spread: float
    """Circular standard deviation of the directions, rad."""


def wave_direction(
    eta: ArrayLike, x: ArrayLike, t: ArrayLike, T: float, d: float, g: float = theory.GRAVITY
) -> WaveDirection:
    """Direction (rad), height (m) and wavenumber (rad/m) of regular waves of period T (s) from their phases.

    The wavenumbers along x and y follow from the differences of the phases of the fundamental by linear
    least squares, without the dispersion relation. Reflected waves with the reflection coefficient r
    change every phase by up to r rad.

    **Arguments**: `eta`: elevations [gauges, times] (m); `x`: positions of the gauges [gauges, 2] (m); `t`:
    times [times] (s), which must cover whole periods; depth `d` (m). All gauges must be within half a
    wavelength of the most central one.

    **Raises** ValueError for fewer than three gauges, gauges nearly on one line, and gauges too far apart.
    """
    t, eta, x = _checked(eta, x, t)
    middle = _central(x, float(theory.wavenumber(2.0 * np.pi / T, d, g)))
    B = fundamental(t, eta, T)
    if not np.all(np.abs(B) > 0.0):
        raise ValueError(
            f"T = {T:g} s: at least one gauge has no wave of this period; use the period of the waves"
        )
    (k,) = _wavenumbers(x, B[:, None], middle)
    height = 2.0 * float(np.mean(np.abs(B)))
    return WaveDirection(float(np.arctan2(k[1], k[0])), height, float(np.hypot(*k)))


def sea_direction(
    eta: ArrayLike,
    x: ArrayLike,
    t: ArrayLike,
    d: float,
    g: float = theory.GRAVITY,
    *,
    f: tuple[float, float],
) -> SeaDirection:
    """Mean direction and spread (rad) of a sea from the phases at every frequency, weighted by energy.

    The method assumes that the waves of each frequency of the record have one direction. If waves of one
    frequency have several directions, the computed spread is smaller than the true spread.

    **Arguments**: as for `wave_direction`, with evenly spaced times; `f`: lowest and highest frequency of the
    sea (Hz). All gauges must be within half a wavelength, at the highest frequency, of the most central one.

    **Raises** ValueError for unsuitable gauges, and for a record with fewer than 8 frequencies in this range.
    """
    t, eta, x = _checked(eta, x, t)
    middle = _central(x, float(theory.wavenumber(2.0 * np.pi * f[1], d, g)))
    every = np.fft.rfftfreq(t.size, even_step(t))
    use = (every > f[0]) & (every < f[1])
    if np.sum(use) < 8:
        raise ValueError(
            f"only {np.sum(use)} frequencies of the record are between {f[0]:g} and {f[1]:g} Hz, but 8 are "
            "needed: use a longer record"
        )
    fade = scipy.signal.windows.tukey(t.size, TAPER)
    B = np.fft.rfft((eta - eta.mean(axis=1, keepdims=True)) * fade, axis=1)[:, use]
    energy = np.mean(np.abs(B) ** 2, axis=0)
    k = _wavenumbers(x, B, middle)
    theta = np.arctan2(k[:, 1], k[:, 0])
    mean = np.sum(energy * np.exp(1j * theta)) / np.sum(energy)
    return SeaDirection(float(np.angle(mean)), float(np.sqrt(2.0 * max(1.0 - abs(mean), 0.0))))


def _checked(eta: ArrayLike, x: ArrayLike, t: ArrayLike) -> tuple[Series, Series, Series]:
    """Times, elevations and positions in double precision. **Raises** ValueError if the arrays are
    unsuitable."""
    t, eta = checked(t, eta)
    x = np.asarray(x, np.float64)
    if eta.ndim != 2 or x.shape != (len(eta), 2):
        raise ValueError(
            f"eta has the shape {eta.shape} and x the shape {x.shape}: give eta as [gauges, times] and x as "
            "[gauges, 2]"
        )
    if len(x) < 3:
        raise ValueError(f"to find the direction of the waves, use at least three gauges, not {len(x)}")
    condition = np.linalg.cond(x - np.mean(x, axis=0))
    if not condition < _MAX_CONDITION:
        raise ValueError(
            f"gauges at {x.tolist()} m are nearly on one line (condition number {condition:.3g}): "
            "move one gauge away from this line"
        )
    return t, eta, x


def _central(x: NDArray[np.float64], k: float) -> int:
    """Index of the most central gauge. **Raises** ValueError if another gauge is half a wavelength or more
    away, because the phase of waves of wavenumber k (rad/m) is then ambiguous."""
    farthest = np.max(np.linalg.norm(x[:, None] - x, axis=-1), axis=1)
    middle = int(np.argmin(farthest))
    if not k * farthest[middle] < np.pi:
        raise ValueError(
            f"gauges at {x.tolist()} m are up to {farthest[middle]:.4g} m from the most central gauge: use "
            f"distances of less than half of the shortest wavelength, {np.pi / k:.4g} m"
        )
    return middle


def _wavenumbers(x: NDArray[np.float64], B: NDArray[np.complex128], middle: int) -> NDArray[np.float64]:
    """Wavenumbers along x and y `[F, 2]` (rad/m) of waves with the complex amplitudes B `[G, F]` at gauges x
    `[G, 2]` (m), from the phases relative to the gauge `middle`."""
    phase = -np.angle(B * np.conj(B[middle]))  # the phase falls along the direction of the waves
    level = np.column_stack([np.ones(len(x)), x - x[middle]])
    return np.linalg.lstsq(level, phase, rcond=None)[0][1:].T
