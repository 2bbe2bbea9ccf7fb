"""Incident and reflected waves from a row of gauges."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy  # which imports its subpackages on first use
from numpy.typing import ArrayLike, NDArray

from jaxsph.analysis.periods import Series, checked, whole_periods
from jaxsph.analysis.spectrum import BANDS, TAPER, Spectrum, banded, even_step
from jaxsph.waves import theory


class Reflection(NamedTuple):
    """Amplitudes of an incident and a reflected wave, and their ratio, as returned by `reflection`."""

    incident: float
    """Amplitude of the incident wave, along +x, m."""
    reflected: float
    """Amplitude of the reflected wave, along -x, m."""
    coefficient: float
    """Reflection coefficient, reflected / incident (-)."""


_MIN_SAMPLES_PER_PERIOD = 8
"""Smallest number of samples per period that `reflection` accepts."""


_MAX_CONDITION = 10.0
"""Largest condition number of the gauges' equations that `reflection` accepts (-)."""


def fundamental(t: ArrayLike, y: ArrayLike, T: float) -> NDArray[np.complex128]:
    """Complex amplitudes B of series at the period T (s), in the unit of y, by least squares.

    y ~ mean + Re(B exp(i 2 pi t / T)) + second harmonic. Shapes: `t` [times] (s), `y` [..., times], B [...].
    The angle of B1 / B2 is the phase lead of the first series over the second.
    """
    t, y = checked(t, y)
    solution = np.linalg.lstsq(_harmonics(t, T), y.reshape(-1, t.size).T, rcond=None)[0]
    return (solution[1] - 1j * solution[2]).reshape(y.shape[:-1])


def drift_rate(t: ArrayLike, y: ArrayLike, T: float) -> float:
    """Drift rate of a series that oscillates with the period T (s), in the unit of y per second.

    y ~ mean + rate t + first and second harmonic. All terms are fitted together, because the oscillation
    would tilt a line fitted alone, and the drift would distort harmonics fitted alone.
    """
    t, y = checked(t, y)
    basis = np.column_stack([_harmonics(t, T), t - np.mean(t)])
    return float(np.linalg.lstsq(basis, y, rcond=None)[0][-1])


def _harmonics(t: Series, T: float) -> Series:
    """Columns 1, and cosine and sine of the first and second harmonic at times t (s)."""
    phase = 2.0 * np.pi / T * t
    columns = [np.ones_like(t)]
    # an omitted second harmonic would change B if the record is not exactly a whole number of periods
    for n in (1, 2):
        columns += [np.cos(n * phase), np.sin(n * phase)]
    return np.stack(columns, axis=-1)


def reflection(
    eta: ArrayLike,
    x: ArrayLike,
    t: ArrayLike,
    T: float,
    d: float,
    g: float = theory.GRAVITY,
    periods: int | None = None,
) -> Reflection:
    """Amplitudes of the incident and the reflected wave (m) at the frequency 1 / T, from a row of gauges.

    The method is least squares over the gauges after Mansard and Funke (1980), with linear
    wavenumbers. Place the gauges a wavelength away from the paddle and from the device.

    **Arguments**: `eta`: elevations [gauges, times] (m); `x`: positions of the gauges [gauges] (m); `t`
    [times] (s); period `T` (s); depth `d` (m); `periods`: number of periods to use at the
    end of the record, by default all.

    **Raises** ValueError for fewer than two gauges, a record shorter than one period, fewer than 8 samples
    per period, and for gauge distances that cannot separate the two waves: all within about 0.03 wavelengths
    of a multiple of half a wavelength (condition number over 10).
    """
    t, eta = checked(t, eta)
    x = np.asarray(x, np.float64)
    if eta.ndim != 2 or x.shape != eta.shape[:1]:
        raise ValueError(
            f"eta has the shape {eta.shape} and x the shape {x.shape}: give eta as [gauges, times] and one "
            "position for each gauge"
        )
    if x.size < 2:
        raise ValueError(f"to separate incident and reflected waves, use at least two gauges, not {x.size}")
    periods = periods or int((t[-1] - t[0]) / T * (1.0 + 1e-6))
    mask = whole_periods(t, T, max(periods, 1))
    if np.sum(mask) < _MIN_SAMPLES_PER_PERIOD * max(periods, 1):
        raise ValueError(
            f"the record has fewer than {_MIN_SAMPLES_PER_PERIOD} samples per period of {T:g} s: use a "
            "shorter sampling interval"
        )
    check_separable(x, T, d, g)
    k = float(theory.wavenumber(2.0 * np.pi / T, d, g))
    B = fundamental(t[mask], eta[:, mask], T)
    (incident,), (reflected,), _ = separated(np.array([k]), x, B[None])
    incident, reflected = abs(incident), abs(reflected)
    if incident == 0.0:
        raise ValueError(f"there is no incident wave of the period T = {T:g} s: use the period of the waves")
    return Reflection(float(incident), float(reflected), float(reflected / incident))


def check_separable(x: ArrayLike, T: float, d: float, g: float = theory.GRAVITY) -> None:
    """Checks that gauges at x (m) can separate incident from reflected waves of period T (s) in the depth
    d (m). **Raises** ValueError if they cannot, see `reflection`."""
    x = np.asarray(x, np.float64)
    k = float(theory.wavenumber(2.0 * np.pi / T, d, g))
    condition = float(np.linalg.cond(_basis(np.array([k]), x))[0])
    if not condition < _MAX_CONDITION:
        raise ValueError(
            f"gauges at {x.tolist()} m cannot separate incident and reflected waves "
            f"(condition number {condition:.3g}) at a wavelength of {2.0 * np.pi / k:.4g} m: "
            "avoid distances near multiples of half a wavelength"
        )


def separated(
    k: NDArray[np.float64], x: NDArray[np.float64], B: NDArray[np.complex128]
) -> tuple[NDArray[np.complex128], NDArray[np.complex128], NDArray[np.float64]]:
    """Complex amplitudes at x[0] of the waves along +x and -x, and condition numbers of the equations.

    The waves are fitted by least squares to the complex amplitudes B `[F, G]` of gauges at `x` (m, `[G]`),
    for every wavenumber k (rad/m, `[F]`), in the unit of B (Mansard and Funke 1980).
    """
    basis = _basis(k, x)
    both = (np.linalg.pinv(basis) @ B[..., None])[..., 0]
    return both[:, 0], both[:, 1], np.linalg.cond(basis)


def _basis(k: NDArray[np.float64], x: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Unit waves along +x and -x at gauges at x (m), for every wavenumber k (rad/m), `[F, G, 2]`."""
    return np.exp(1j * k[:, None, None] * (x - x[0])[None, :, None] * np.array([-1.0, 1.0]))


class TwoWaySea(NamedTuple):
    """Incident and reflected sea in front of a device or a beach, as returned by `two_way_sea`."""

    incident: Spectrum
    """Spectrum of the waves along +x."""
    reflected: Spectrum
    """Spectrum of the waves along -x."""
    coefficient: float
    """Reflection coefficient of the sea, square root of the ratio of reflected to incident variance (-)."""
    left_out: float
    """Fraction of the frequencies (-) at which the gauges cannot separate the waves; averages exclude these
    frequencies."""


def two_way_sea(
    eta: ArrayLike,
    x: ArrayLike,
    t: ArrayLike,
    d: float,
    g: float = theory.GRAVITY,
    *,
    f: tuple[float, float],
    bands: int = BANDS,
) -> TwoWaySea:
    """Incident and reflected spectra of a sea, separated at each frequency from a row of gauges.

    The method is least squares after Mansard and Funke (1980), with linear wavenumbers. With unevenly
    spaced gauges few frequencies are left out.

    **Arguments**: `eta`: elevations [gauges, times] (m); `x`: positions of the gauges (m); `t`: times (s),
    evenly spaced; depth `d` (m); `f`: lowest and highest frequency of the sea (Hz); bound waves and noise lie
    outside this range; `bands`: number of neighbouring frequencies averaged for each value of a spectrum.

    **Raises** ValueError for fewer than three gauges, for a record that is too short, and if the gauges
    cannot separate the waves at more than half of the frequencies.
    """
    t, eta = checked(t, eta)
    x = np.asarray(x, np.float64)
    if eta.ndim != 2 or x.shape != eta.shape[:1] or x.size < 3:
        raise ValueError(
            f"eta has the shape {eta.shape} and x the shape {x.shape}: give eta as [gauges, times] and one "
            "position for each gauge, for at least three gauges"
        )
    step = even_step(t)
    fade = scipy.signal.windows.tukey(t.size, TAPER)
    rest = (eta - eta.mean(axis=1, keepdims=True)) * fade / np.sqrt(np.mean(fade**2))
    B = 2.0 * np.fft.rfft(rest, axis=1) / t.size
    every = np.fft.rfftfreq(t.size, step)
    use = np.flatnonzero((every > f[0]) & (every < f[1]))
    if use.size < 4 * bands:
        raise ValueError(
            f"only {use.size} frequencies of the record are between {f[0]:g} and {f[1]:g} Hz, but "
            f"{4 * bands} are needed: use a longer record"
        )
    k = np.asarray(theory.wavenumber(2.0 * np.pi * every[use], d, g), np.float64)
    incident, reflected, condition = separated(k, x, B[:, use].T)
    sound = condition < _MAX_CONDITION
    if np.mean(sound) < 0.5:
        raise ValueError(
            f"gauges at {x.tolist()} m cannot separate incident and reflected waves "
            f"at {np.mean(~sound):.0%} of the frequencies: place the gauges at uneven distances of "
            "a tenth to a third of a wavelength"
        )
    both = np.zeros((2, every.size))
    # density: half the squared amplitude, divided by the frequency step
    both[:, use] = np.where(sound, 0.5 * np.abs([incident, reflected]) ** 2 * t.size * step, np.nan)
    coefficient = float(np.sqrt(np.nansum(both[1]) / np.nansum(both[0])))
    incident, reflected = (banded(every, S, bands) for S in both)
    return TwoWaySea(incident, reflected, coefficient, float(np.mean(~sound)))
