"""Analysis of recorded series on the host: reflection, efficiency, errors, decay, the energy budget.

numpy in, numpy out; nothing here is traced. Equation numbers are those of Zhu et al.
(2020) unless another source is named. Times in s, elevations in m.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares
from scipy.signal import find_peaks, savgol_filter

from jaxsph.waves import theory

Series = NDArray[np.float64]
"""Array of samples in double precision."""


class Reflection(NamedTuple):
    """Amplitudes of an incident and a reflected wave, and their ratio: the result of `reflection`."""

    incident: float
    """Amplitude of the incident wave, along +x, m."""
    reflected: float
    """Amplitude of the reflected wave, along -x, m."""
    coefficient: float
    """Reflection coefficient, reflected / incident (-)."""


class Efficiency(NamedTuple):
    """Hydrodynamic efficiency, mean and by period: the result of `efficiency`."""

    xi: float
    """Mean efficiency over the periods (-)."""
    per_period: Series
    """Efficiency in each period, oldest first (-)."""


class Extrema(NamedTuple):
    """Crests and troughs of a series, in time order."""

    t: Series
    """Times of the extrema, s."""
    y: Series
    """Values of the extrema, in the unit of the series."""
    sign: NDArray[np.int_]
    """Kinds of the extrema: +1 for a crest, -1 for a trough."""


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


def _series(t: ArrayLike, y: ArrayLike) -> tuple[Series, Series]:
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
    t, y = _series(t, y)
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
    t, power = _series(t, power)
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


_MIN_SAMPLES_PER_PERIOD = 8
"""Least number of samples per period for `reflection`."""


_MAX_CONDITION = 10.0
"""Largest condition number of the gauges' equations for `reflection` (-)."""


def fundamental(t: ArrayLike, y: ArrayLike, T: float) -> NDArray[np.complex128]:
    """Complex amplitudes B of series at the period T (s), in the unit of y, by least squares.

    y ~ mean + Re(B exp(i 2 pi t / T)) + second harmonic. Shapes: `t` [times] (s), `y` [..., times], B [...].
    The angle of B1 / B2 is the lead in phase of the first series over the second.
    """
    t, y = _series(t, y)
    phase = 2.0 * np.pi / T * t
    columns = [np.ones_like(t)]
    for n in (1, 2):  # over near-whole periods, a fitted harmonic cannot leak into B
        columns += [np.cos(n * phase), np.sin(n * phase)]
    solution = np.linalg.lstsq(np.stack(columns, axis=-1), y.reshape(-1, t.size).T, rcond=None)[0]
    return (solution[1] - 1j * solution[2]).reshape(y.shape[:-1])


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

    Least squares over the gauges after Mansard and Funke (1980), with linear wavenumbers; the gauges should
    stand a wavelength from paddle and device.

    **Arguments**: `eta`: elevations [gauges, times] (m); `x`: positions of the gauges [gauges] (m); `t`
    [times] (s); period `T` (s); depth `d` (m); `periods`: number of last periods to use, all by default.

    **Raises** ValueError for fewer than two gauges, a record under one period, fewer than 8
    samples per period, and for distances that cannot tell the waves apart (all near a
    multiple of half a wavelength: condition number over 10, a distance within about
    0.03 wavelengths of it).
    """
    t, eta = _series(t, eta)
    x = np.asarray(x, np.float64)
    if eta.ndim != 2 or x.shape != eta.shape[:1]:
        raise ValueError(f"eta of shape {eta.shape} is not [gauges, times] for x of {x.shape}")
    if x.size < 2:
        raise ValueError(f"{x.size} gauges: two at least tell incident from reflected waves")
    periods = periods or int((t[-1] - t[0]) / T * (1.0 + 1e-6))
    mask = whole_periods(t, T, max(periods, 1))
    if np.sum(mask) < _MIN_SAMPLES_PER_PERIOD * max(periods, 1):
        raise ValueError(f"fewer than {_MIN_SAMPLES_PER_PERIOD} samples per period")
    k = float(theory.wavenumber(2.0 * np.pi / T, d, g))
    basis = np.exp(1j * k * (x - x[0])[:, None] * np.array([-1.0, 1.0]))
    condition = np.linalg.cond(basis)
    if not condition < _MAX_CONDITION:
        raise ValueError(
            f"gauges at {x.tolist()} m are singular (condition {condition:.3g}) for a wavelength "
            f"of {2.0 * np.pi / k:.4g} m: keep a distance from multiples of half of it"
        )
    B = fundamental(t[mask], eta[:, mask], T)
    incident, reflected = np.abs(np.linalg.lstsq(basis, B, rcond=None)[0])
    if incident == 0.0:
        raise ValueError("there is no incident wave at this period")
    return Reflection(float(incident), float(reflected), float(reflected / incident))


def extrema(t: ArrayLike, y: ArrayLike, window: int = 1, prominence: float = 0.1) -> Extrema:
    """Crests and troughs of a series y at times t (s), each located by a parabola through three points.

    `window` samples (odd, 5 or more) smooth a noisy, uniformly sampled series by local
    parabolas (Savitzky-Golay), which keep the height of a crest; 1 is none.
    `prominence` is the least height by which an extremum must stand out, as a fraction of the
    series' range. **Raises** ValueError where there is no extremum.
    """
    t, y = _series(t, y)
    if window > 1:
        y = savgol_filter(y, window, 2)
    threshold = prominence * np.ptp(y)
    found = [(i, s) for s in (1, -1) for i in find_peaks(s * y, prominence=threshold)[0]]
    if not found:
        raise ValueError("the series has no extremum")
    index, sign = np.array(sorted(found)).T
    h0, h1 = t[index] - t[index - 1], t[index + 1] - t[index]
    s0, s1 = (y[index] - y[index - 1]) / h0, (y[index + 1] - y[index]) / h1
    curvature = (s1 - s0) / (h0 + h1)
    slope = (s0 * h1 + s1 * h0) / (h0 + h1)
    # A flat top has neither slope nor curvature: leave it at its sample.
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

    Each reference extremum goes with the nearest of its kind within T / 2. An extremum without a partner is
    left out within T / 2 of the ends of the common time. **Raises** ValueError for one without a partner
    elsewhere, since leaving it out would flatter the error, and where there is no pair.
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
            raise ValueError(f"no {kind} within T/2 of the reference's at t = {t_r:.6g} s")
    if not times:
        raise ValueError("no extremum of the series is within T/2 of one of the reference")
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
    """Mean absolute error of the values of crests and troughs over the amplitude A (m), Eq. 29 (-).

    Crests and troughs count alike; pairing, options and errors are those of `matched_extrema`.
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
    """Mean absolute error of the times of crests and troughs over the period T (s), Eq. 30 (-).

    Pairing, options and errors are those of `matched_extrema`.
    """
    times, _ = matched_extrema(t, eta, t_ref, eta_ref, T, window, prominence)
    return float(np.mean(np.abs(times[:, 0] - times[:, 1])) / T)


def oscillation_period(t: ArrayLike, y: ArrayLike) -> float:
    """Period of an oscillation, s, from the upward crossings of its mean over all its periods.

    For a clean series of several periods: use `fit_damped_oscillation` where the oscillation
    decays to another level or carries noise. **Raises** ValueError for fewer than two
    crossings.
    """
    t, y = _series(t, y)
    y = y - np.mean(y)
    i = np.flatnonzero((y[:-1] < 0.0) & (y[1:] >= 0.0))
    if i.size < 2:
        raise ValueError(f"{i.size} upward crossings of the mean do not give a period")
    crossings = t[i] - y[i] * (t[i + 1] - t[i]) / (y[i + 1] - y[i])
    return float((crossings[-1] - crossings[0]) / (i.size - 1))


def _damped_basis(s: Series, decay_rate: float, omega: float) -> Series:
    """Columns 1, exp(-decay_rate s) cos(omega s) and exp(-decay_rate s) sin(omega s) (-)."""
    envelope = np.exp(np.clip(-decay_rate * s, -700.0, 700.0))
    return np.stack([np.ones_like(s), envelope * np.cos(omega * s), envelope * np.sin(omega * s)], axis=-1)


def fit_damped_oscillation(t: ArrayLike, y: ArrayLike) -> DampedOscillation:
    """Damped oscillation fitted to a series by least squares, about its final value.

    The search is over the decay rate and omega alone; offset, amplitude and phase are linear
    and follow (variable projection, Golub and Pereyra 1973). The start is the best of a grid
    of half a cycle to 60 cycles in the record. **Raises** ValueError for under 8 samples, a
    constant series, or one that a damped cosine does not describe (under half of its
    variance).
    """
    t, y = _series(t, y)
    variance = np.var(y)
    if t.size < 8 or variance <= (1e-12 * np.max(np.abs(y))) ** 2:
        raise ValueError("a damped oscillation needs 8 samples that are not constant")
    s, duration = t - t[0], t[-1] - t[0]

    def solve(p: Series, s: Series, y: Series) -> tuple[Series, Series]:
        basis = _damped_basis(s, p[0], p[1])
        solution = np.linalg.lstsq(basis, y, rcond=None)[0]
        return solution, basis @ solution - y

    # Half a cycle to at most a quarter of the samples, a third of a cycle apart: inside
    # the main lobe of the spectrum, from where the descent cannot miss the minimum.
    cycles = np.arange(0.5, max(1.0, min(60.0, t.size / 4.0)), 1.0 / 3.0)
    stride = max(1, t.size // 1000)
    grid = [(b / duration, 2.0 * np.pi * c / duration) for c in cycles for b in (0.0, 1.0, 4.0)]
    start = min(grid, key=lambda p: np.sum(solve(p, s[::stride], y[::stride])[1] ** 2))
    scale = np.array([1.0, 2.0 * np.pi]) / duration
    result = least_squares(lambda q: solve(q * scale, s, y)[1], np.array(start) / scale)
    decay_rate, omega = result.x * scale
    (offset, c, sn), residual = solve((decay_rate, omega), s, y)
    if np.mean(residual**2) > 0.5 * variance:
        raise ValueError("a damped cosine describes under half of the series' variance")
    phase = np.arctan2(-np.sign(omega) * sn, c)
    return DampedOscillation(
        float(offset), float(np.hypot(c, sn)), float(decay_rate), float(abs(omega)), float(phase)
    )


def decay_per_wavelength(x: ArrayLike, amplitude: ArrayLike, wavelength: float) -> float:
    """Share of a wave's amplitude lost over one wavelength (-), beside the wave reflected at the tank's end.

    `amplitude`: complex amplitude a of the elevation Re a exp(i omega t) (m) at every position `x` (m).
    Fitted to them, by least squares: a wave that decays along x, whose wavenumber may be a few per cent off
    that of the `wavelength` (m), and one that comes back. Without the second its nodes look like a decay or a
    growth. The share is negative where the wave grows. **Raises** ValueError for under four positions, less
    than half a wavelength, or no waves.
    """
    x, found = np.asarray(x, np.float64), np.asarray(amplitude, np.complex128)
    if x.ndim != 1 or x.size < 4 or x.shape != found.shape or np.ptp(x) < 0.5 * wavelength:
        raise ValueError("a decay needs amplitudes at four positions at least, over half a wavelength")
    size = float(np.max(np.abs(found)))
    if not size > 0.0:
        raise ValueError("a decay needs waves: all amplitudes are zero")
    k, along = 2.0 * np.pi / wavelength, x - x[0]

    def rest(parameters):
        *parts, decay, shift = parameters
        incident, reflected = complex(*parts[:2]), complex(*parts[2:])
        there = incident * np.exp(-(1j * k * (1.0 + shift) + decay) * along)
        off = there + reflected * np.exp(1j * k * along) - found / size
        return np.concatenate([off.real, off.imag])

    first = found[0] / size
    decay = least_squares(rest, [first.real, first.imag, 0.0, 0.0, 0.0, 0.0]).x[4]
    return float(-np.expm1(-decay * wavelength))


def takers(series: Iterable[str]) -> list[str]:
    """Names of what takes energy from the water besides power take-offs, by the series `power_<name>`."""
    powers = [name for name in series if name.startswith("power_")]
    return [n.removeprefix("power_") for n in powers if not n.startswith(("power_paddle", "power_pto"))]


def energy_budget(series: dict[str, np.ndarray]) -> dict[str, float]:
    """Energy budget of a whole record by name, J (J/m in 2-D): the paddle's work and where it went.

    Keys: `paddle` (work of paddles and driven bodies), `stored` (change of kinetic, potential and compression
    energy), `pto` (taken by all power take-offs), `viscous`, `diffusive`, and the energies of all other
    series `power_`, such as `sponge`, `contact`, `projection` (each taken from the water); `residual` (the
    imbalance) and `residual_share` (its ratio to the paddle's work, or to the largest kinetic energy where
    that is larger).
    Powers called `power_` are means over the interval before their sample; the losses called `loss_` are
    values at their sample, and integrated by the trapezoidal rule.
    """
    t = series["time"]
    dt = np.diff(t)

    def work(name: str) -> float:
        return float(np.sum(series[name][1:] * dt)) if name in series else 0.0

    def loss(name: str) -> float:
        return float(np.trapezoid(series[name], t)) if name in series else 0.0

    total = series["kinetic"] + series["potential"] + series["compression"]
    budget = {
        "paddle": work("power_paddle"),
        "stored": float(total[-1] - total[0]),
        "pto": sum((work(name) for name in series if name.startswith("power_pto")), 0.0),
        "sponge": work("power_sponge"),
        "viscous": loss("loss_viscous"),
        "diffusive": loss("loss_diffusive"),
    }
    budget |= {taker: work(f"power_{taker}") for taker in takers(series)}
    spent = sum(v for k, v in budget.items() if k != "paddle")
    budget["residual"] = budget["paddle"] - spent
    scale = max(abs(budget["paddle"]), float(np.max(np.abs(series["kinetic"]))), 1e-12)
    budget["residual_share"] = budget["residual"] / scale
    return budget
