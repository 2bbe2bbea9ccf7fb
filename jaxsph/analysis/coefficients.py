"""Added mass, damping and excitation from recorded forces: first harmonics in each period, with their spread.

A motion xi, a force F and an elevation eta are complex amplitudes: the motion in time is
Re(xi exp(i omega t)). On a body that moves in still water, the water's oscillating force is
F = (omega^2 A - i omega B - C) xi (Newman 1977, chapter 6), with the added mass A, the damping B and the
hydrostatic stiffness C.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jaxsph.analysis.periods import checked, whole_periods
from jaxsph.analysis.reflection import drift_rate, fundamental, separated

MOTIONS = ("surge", "heave", "pitch")
"""Names of a body's motions in the x-z plane, positive along the tank (m), upwards (m) and from z towards x
(rad)."""


class Mode(NamedTuple):
    """One motion of one body, with all other motions held fixed."""

    body: str
    """Name of the body."""
    motion: str
    """Name of the motion: "surge", "heave" or "pitch"."""


class BodyAtRest(NamedTuple):
    """Position, inertia and hydrostatic stiffness of a body at rest, per metre of width."""

    pivot: tuple[float, float]
    """Pivot (x, z) of the pitch, relative to the reference position in the still water surface, m."""
    centre: tuple[float, float]
    """Centre of mass (x, z), relative to the reference position, m."""
    buoyancy: tuple[float, float]
    """Centre of buoyancy (x, z), relative to the reference position, m."""
    area: float
    """Displaced volume per metre of width, m2."""
    inertia: NDArray[np.float64]
    """Inertia matrix `[3, 3]` of surge, heave and pitch about the pivot, kg/m, kg, kg m."""
    stiffness: NDArray[np.float64]
    """Hydrostatic stiffness `[3, 3]` of surge, heave and pitch about the pivot, weight included, N/m2, N/m,
    N."""


class LinearCoefficients(NamedTuple):
    """Added mass `A` and damping `B` `[W, n, n]`, and excitation `X` `[W, n]`, from linear potential theory.

    The units and conventions are those of `Coefficients`.
    """

    A: NDArray[np.floating]
    B: NDArray[np.floating]
    X: NDArray[np.complexfloating]


@dataclass(frozen=True, eq=False)
class Coefficients:
    """Added mass, damping and excitation of bodies over frequencies, per metre of width, with their spreads.

    Row i of a matrix is the force along mode i of `modes`, and column j the motion in mode j. A spread is the
    standard deviation of the values of single periods of a run. A value is NaN if its run failed.
    """

    omega: NDArray[np.float64]
    """Angular frequencies `[W]`, ascending, rad/s."""
    modes: tuple[Mode, ...]
    """The n modes, in the order of the matrices."""
    A: NDArray[np.float64]
    """Added mass `[W, n, n]`, kg/m, kg or kg m."""
    A_spread: NDArray[np.float64]
    """Spread of the added mass `[W, n, n]`, in the unit of A."""
    B: NDArray[np.float64]
    """Damping `[W, n, n]`, N s/m2, N s/m or N s. The damping includes losses that a potential flow does not
    have."""
    B_spread: NDArray[np.float64]
    """Spread of the damping `[W, n, n]`, in the unit of B."""
    X: NDArray[np.complex128]
    """Excitation `[W, n]`, N/m or N per metre of wave amplitude: the force is Re(a X exp(i omega t)) in waves
    with the elevation Re(a exp(i omega t)) at the reference position."""
    X_spread: NDArray[np.float64]
    """Spread of the complex excitation about its mean `[W, n]`, in the unit of X."""
    echo: NDArray[np.float64]
    """Ratio of the force of the waves that return from the paddle to the radiation force (-), in the run with
    each prescribed motion `[W, n]`. The force of these waves has been subtracted, unless the ratio is NaN
    (unknown)."""
    bodies: Mapping[str, BodyAtRest]
    """Bodies at rest, by name."""
    x: float
    """Reference position of the waves, m from the paddle: the pivot of the first body."""
    depth: float
    """Depth of the water, m."""
    rho: float
    """Density of the water, kg/m3."""
    g: float
    """Acceleration of gravity, m/s2."""
    failures: Mapping[str, str] = field(default_factory=dict)
    """Error messages of the failed runs, by a description of the run; empty if all runs succeeded."""
    name: str = ""
    """Name of the case."""
    linear: LinearCoefficients | None = None
    """Coefficients from linear potential theory; None if the theory does not cover the case."""

    @property
    def C(self) -> NDArray[np.float64]:
        """Hydrostatic stiffness `[n, n]`, weight included, N/m2, N/m or N."""
        return self._over_modes("stiffness")

    @property
    def M(self) -> NDArray[np.float64]:
        """Inertia matrix `[n, n]`, kg/m, kg or kg m."""
        return self._over_modes("inertia")

    def _over_modes(self, matrix: str) -> NDArray[np.float64]:
        """Matrix `[n, n]` over all modes, from the attribute `matrix` of each body at rest. Motions of
        different bodies are not coupled."""
        found = np.zeros((len(self.modes),) * 2)
        for i, one in enumerate(self.modes):
            for j, other in enumerate(self.modes):
                if one.body == other.body:
                    of_body = getattr(self.bodies[one.body], matrix)
                    found[i, j] = of_body[MOTIONS.index(one.motion), MOTIONS.index(other.motion)]
        return found


def harmonics(t: ArrayLike, y: ArrayLike, T: float, periods: int) -> NDArray[np.complex128]:
    """Complex amplitudes at the period T (s) in each of the last whole periods of series, oldest first.

    Shapes: `t` [times] (s), `y` [..., times], result [..., periods], in the unit of y. A drift, linear over
    all these periods, is removed first: in a single period it would appear as a sine. **Raises** ValueError
    if the record is too short.
    """
    times, values = checked(t, y)
    over = whole_periods(times, T, periods)
    times, values = times[over], values[..., over]
    slopes = [drift_rate(times, one, T) for one in values.reshape(-1, times.size)]
    values = values - np.reshape(slopes, (*values.shape[:-1], 1)) * (times - times[0])
    slack = 0.01 * (times[-1] - times[0]) / (times.size - 1)
    edges = times[-1] - T * np.arange(periods, -1, -1) + slack
    each = [(times > first) & (times <= last) for first, last in itertools.pairwise(edges)]
    return np.stack([fundamental(times[k], values[..., k], T) for k in each], axis=-1)


def of_means(amplitude: NDArray[np.complex128], omega: float, dt: float) -> NDArray[np.complex128]:
    """Complex amplitudes of series whose samples are means over the interval dt (s) before each sample.

    Such a mean of exp(i omega t) is sinc(omega dt / 2) exp(-i omega dt / 2) times exp(i omega t).
    `amplitude`: complex amplitudes of the means, in any unit.
    """
    half = 0.5 * omega * dt
    return amplitude * np.exp(1j * half) * half / np.sin(half)


def incident_at(
    amplitude: NDArray[np.complex128], gauges: ArrayLike, k: float, x: float
) -> NDArray[np.complex128]:
    """Complex amplitudes at x (m) of the wave along +x, in every period, m.

    **Arguments**: complex amplitudes of the elevations `[gauges, periods]` (m); positions of the `gauges`
    (m); wavenumber `k` (rad/m). The wave along -x, which comes back from the bodies, is separated (Mansard
    and Funke 1980).
    """
    places = np.asarray(gauges, np.float64)
    along, _, _ = separated(np.full(amplitude.shape[1], k), places, amplitude.T)
    return along * np.exp(-1j * k * (x - places[0]))


def worst_separation(gauges: ArrayLike, k: float) -> float:
    """Condition number of the equations that separate the waves along +x and -x at `gauges` (m); below 10
    the gauges are suitable. `k`: wavenumber (rad/m)."""
    places = np.asarray(gauges, np.float64)
    return float(separated(np.array([k]), places, np.zeros((1, places.size), complex))[2][0])


def added_mass_and_damping(
    ratio: NDArray[np.complex128], omega: float, stiffness: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Added mass and damping from the ratios of the water's force to the body's motion, for all periods.

    `ratio` `[..., periods]`: complex amplitude of the force divided by the complex amplitude of the motion,
    N/m per metre of width; `omega`: rad/s; `stiffness` `[...]`: hydrostatic stiffness without the
    contribution of the weight.
    **Returns** A `[..., periods]` = Re(ratio + C) / omega^2 and B `[..., periods]` = -Im(ratio) / omega.
    """
    restored = ratio + np.asarray(stiffness)[..., None]
    return restored.real / omega**2, -restored.imag / omega


def with_spread(values: NDArray) -> tuple[NDArray, NDArray[np.float64]]:
    """Mean and standard deviation over the last axis (the periods). For complex values, the deviation is
    computed from the distances to the mean in the complex plane. The deviation is NaN for a single period."""
    mean = np.mean(values, axis=-1)
    count = values.shape[-1]
    if count < 2:
        return mean, np.full(mean.shape, np.nan)
    apart = np.abs(values - mean[..., None])
    return mean, np.sqrt(np.sum(apart**2, axis=-1) / (count - 1))
