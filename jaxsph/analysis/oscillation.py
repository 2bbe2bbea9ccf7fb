"""Period and decay of oscillations in time, and decay of waves along a tank."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy  # which imports its subpackages on first use
from numpy.typing import ArrayLike, NDArray

from jaxsph.analysis.periods import Series, checked


class DampedOscillation(NamedTuple):
    """Damped oscillation y = offset + amplitude exp(-decay_rate s) cos(omega s + phase), s = t - t[0]."""

    offset: float
    """Final value, in the unit of y."""
    amplitude: float
    """Amplitude at t[0], positive, in the unit of y."""
    decay_rate: float
    """Decay rate, 1/s; negative where the oscillation grows."""
    omega: float
    """Damped angular frequency, rad/s."""
    phase: float
    """Phase at t[0], rad, in (-pi, pi]."""


def oscillation_period(t: ArrayLike, y: ArrayLike) -> float:
    """Period of an oscillation, s: mean interval between upward crossings of the mean of y.

    Use this function for a series of several periods without noise. Use `fit_damped_oscillation` if
    the oscillation is noisy or decays to another level. **Raises** ValueError for fewer than two
    upward crossings.
    """
    t, y = checked(t, y)
    y = y - np.mean(y)
    i = np.flatnonzero((y[:-1] < 0.0) & (y[1:] >= 0.0))
    if i.size < 2:
        raise ValueError(
            f"a period needs at least two upward crossings of the mean, not {i.size}: use a longer record"
        )
    crossings = t[i] - y[i] * (t[i + 1] - t[i]) / (y[i + 1] - y[i])
    return float((crossings[-1] - crossings[0]) / (i.size - 1))


def _damped_basis(s: Series, decay_rate: float, omega: float) -> Series:
    """Columns 1, exp(-decay_rate s) cos(omega s) and exp(-decay_rate s) sin(omega s) (-)."""
    envelope = np.exp(np.clip(-decay_rate * s, -700.0, 700.0))
    return np.stack([np.ones_like(s), envelope * np.cos(omega * s), envelope * np.sin(omega * s)], axis=-1)


def fit_damped_oscillation(t: ArrayLike, y: ArrayLike) -> DampedOscillation:
    """Damped oscillation about a final value, fitted to a series by least squares.

    The search varies only the decay rate and omega. For each pair of values, a linear fit gives offset,
    amplitude and phase (variable projection, Golub and Pereyra 1973). The search starts from the best point
    of a grid with 0.5 to 60 cycles in the record. **Raises** ValueError for fewer than 8 samples, for a
    constant series, and if a damped cosine describes less than half of the variance.
    """
    t, y = checked(t, y)
    variance = np.var(y)
    if t.size < 8:
        raise ValueError(f"a damped oscillation needs at least 8 samples, not {t.size}: use a longer record")
    if variance <= (1e-12 * np.max(np.abs(y))) ** 2:
        raise ValueError("the series is constant: give the record of an oscillation")
    s, duration = t - t[0], t[-1] - t[0]

    def solve(
        p: Sequence[float] | Series, s: Series, y: Series
    ) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
        basis = _damped_basis(s, p[0], p[1])
        solution = np.linalg.lstsq(basis, y, rcond=None)[0]
        return solution, basis @ solution - y

    # The grid has steps of a third of a cycle and at least four samples per cycle. Its best point is inside
    # the main lobe of the spectrum, and the descent from there reaches the minimum.
    cycles = np.arange(0.5, max(1.0, min(60.0, t.size / 4.0)), 1.0 / 3.0)
    stride = max(1, t.size // 1000)
    grid = [(b / duration, 2.0 * np.pi * c / duration) for c in cycles for b in (0.0, 1.0, 4.0)]
    start = min(grid, key=lambda p: np.sum(solve(p, s[::stride], y[::stride])[1] ** 2))
    scale = np.array([1.0, 2.0 * np.pi]) / duration
    result = scipy.optimize.least_squares(lambda q: solve(q * scale, s, y)[1], np.array(start) / scale)
    decay_rate, omega = result.x * scale
    (offset, c, sn), residual = solve((decay_rate, omega), s, y)
    if np.mean(residual**2) > 0.5 * variance:
        raise ValueError(
            "a damped cosine describes less than half of the series' variance: give only the part of the "
            "record with the decaying oscillation"
        )
    phase = np.arctan2(-np.sign(omega) * sn, c)
    return DampedOscillation(
        float(offset), float(np.hypot(c, sn)), float(decay_rate), float(abs(omega)), float(phase)
    )


def decay_per_wavelength(x: ArrayLike, amplitude: ArrayLike, wavelength: float) -> float:
    """Fraction of a wave's amplitude lost over one wavelength (-), allowing for a reflected wave.

    `amplitude`: complex amplitude a of the elevation Re a exp(i omega t) (m) at every position `x` (m). A
    least-squares fit finds a wave that decays along x and a reflected wave. The wavenumber of the decaying
    wave may differ by a few per cent from 2 pi / `wavelength` (rad/m; `wavelength` in m). In a fit without
    the reflected wave, the nodes and antinodes due to a reflection would appear as decay or growth. The
    fraction is negative if the wave grows. **Raises** ValueError for fewer than four positions, for positions
    that span less than half a wavelength, and if all amplitudes are zero.
    """
    x, found = np.asarray(x, np.float64), np.asarray(amplitude, np.complex128)
    if x.ndim != 1 or x.size < 4 or x.shape != found.shape or np.ptp(x) < 0.5 * wavelength:
        raise ValueError(
            f"x has the shape {x.shape} and amplitude the shape {found.shape}: give one amplitude at each of "
            f"four or more positions that span at least half a wavelength, {0.5 * wavelength:.3g} m"
        )
    size = float(np.max(np.abs(found)))
    if not size > 0.0:
        raise ValueError(f"the largest amplitude is {size:g} m: give finite amplitudes, not all zero")
    k, along = 2.0 * np.pi / wavelength, x - x[0]

    def rest(parameters):
        *parts, decay, shift = parameters
        incident, reflected = complex(*parts[:2]), complex(*parts[2:])
        there = incident * np.exp(-(1j * k * (1.0 + shift) + decay) * along)
        off = there + reflected * np.exp(1j * k * along) - found / size
        return np.concatenate([off.real, off.imag])

    first = found[0] / size
    decay = scipy.optimize.least_squares(rest, [first.real, first.imag, 0.0, 0.0, 0.0, 0.0]).x[4]
    return float(-np.expm1(-decay * wavelength))
