"""Linear theory of an oscillating water column in an irregular sea, with a quadratic turbine.

The equations of the water are linear and are solved wave by wave (`waves.radiation`). The laws of
compressible air and of a linear turbine are linear too. The law of a quadratic turbine, P_a = K_dm^2 |q| q,
is not. A quadratic turbine is treated in one of two ways:

- Stochastic linearisation replaces the turbine by a linear resistance that absorbs the same mean power. In a
  Gaussian flow this resistance is K_dm^2 sqrt(8 / pi) sigma_q. The standard deviation sigma_q of the flow in
  turn depends on the resistance.
- Integration, for a sea that repeats, finds the flow that satisfies the equations of the water and the law of
  the turbine at every time.

The module uses numpy on the host in double precision. The time factor is exp(-i omega t), as in
`waves.radiation`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import scipy  # which imports its subpackages on first use
from numpy.typing import NDArray

from jaxsph.waves import theory
from jaxsph.waves.linear_owc import IDEAL_AIR, LinearAir
from jaxsph.waves.radiation import ChamberGeometry, radiation_and_scattering

Complex = NDArray[np.complexfloating]
Real = NDArray[np.floating]

_GAUSSIAN = np.sqrt(8.0 / np.pi)
"""Ratio of E|q|^3 to sigma_q^3 for a Gaussian flow (-)."""
_NODES = 80
"""Largest number of frequencies at which the water's equations are solved. For the built-in OWC,
interpolation between these frequencies changes the flow by up to 4e-4 of its maximum, and the efficiency in a
sea by less than 1e-6."""
_HARMONICS = 4
"""Ratio of the highest frequency kept in the turbine's pressure to the sea's highest frequency (-)."""


@dataclass(frozen=True)
class LinearSea:
    """Response of a chamber to an irregular sea in linear theory."""

    sigma_q: float
    """Standard deviation of the flow of air out of the chamber per unit width, m2/s."""
    sigma_P_a: float
    """Standard deviation of the air's pressure, Pa."""
    sigma_level: float
    """Standard deviation of the mean elevation in the chamber, m."""
    P_owc: float
    """Mean absorbed power, W/m."""
    P_inc: float
    """Mean incident power, W/m."""

    @property
    def xi(self) -> float:
        """Hydrodynamic efficiency (-)."""
        return self.P_owc / self.P_inc


@dataclass(frozen=True)
class _Water:
    """Flow of the open chamber, and the water's admittance, by linear theory at the frequencies of a sea."""

    omega: Real
    q_open: Complex
    Z: Complex
    P_inc: float
    length: float


def linear_sea_response(
    geometry: ChamberGeometry,
    amplitude: Complex,
    omega: Real,
    K_dm: float,
    rho0: float = 1000.0,
    g: float = theory.GRAVITY,
    air: LinearAir = IDEAL_AIR,
) -> LinearSea:
    """Response of a chamber to a sea by stochastic linearisation of its quadratic turbine.

    **Arguments**: complex amplitudes (m) of the sea's waves and their angular frequencies (rad/s); damping
    `K_dm` (kg^0.5 m^-2.5, >= 0); `air`: a linear turbine's resistance, and the compliance of the air.
    **Raises** ValueError for a damping below zero.
    """
    water = _water(geometry, np.abs(amplitude), omega, rho0, g, K_dm)
    softness = 1j * water.omega * air.give  # admittance of the air: flow per pressure

    def passed(quadratic: float) -> Complex:
        return water.q_open / (1.0 + (water.Z - softness) * (air.resistance + quadratic))

    def sigma(quadratic: float) -> float:
        return _deviation(passed(quadratic))

    # A larger resistance lowers the flow, which lowers the equivalent resistance. Hence there is one root,
    # which is at most the equivalent resistance at the flow without a quadratic turbine.
    most = K_dm**2 * _GAUSSIAN * sigma(0.0)
    quadratic = 0.0
    if most > 0.0:
        root = scipy.optimize.brentq(
            lambda r: K_dm**2 * _GAUSSIAN * sigma(r) - r, 0.0, most, xtol=1e-12 * most
        )
        quadratic = cast(float, root)  # brentq returns the root alone without full_output
    found, resistance = sigma(quadratic), air.resistance + quadratic
    q = passed(quadratic) * (1.0 - softness * resistance)
    # P_a = r q + K_dm^2 |q| q of a Gaussian flow: E |q|^3 = sqrt(8/pi) sigma^3, E q^4 = 3 sigma^4
    r, K2 = air.resistance, K_dm**2
    variance = (r * found) ** 2 + 2.0 * r * K2 * _GAUSSIAN * found**3 + 3.0 * (K2 * found**2) ** 2
    return LinearSea(
        sigma_q=_deviation(q),
        sigma_P_a=float(np.sqrt(variance)),
        sigma_level=_deviation(q / (water.omega * water.length)),
        P_owc=resistance * found**2,
        P_inc=water.P_inc,
    )


def _deviation(a: Complex) -> float:
    """Standard deviation of a sum of waves with the complex amplitudes a."""
    return float(np.sqrt(0.5 * np.sum(np.abs(a) ** 2)))


def integrated_sea_response(
    geometry: ChamberGeometry,
    amplitude: Complex,
    omega: Real,
    K_dm: float,
    duration: float,
    rho0: float = 1000.0,
    g: float = theory.GRAVITY,
) -> LinearSea:
    """Response of a chamber to a sea that repeats after `duration` (s), with the exact quadratic turbine.

    The flow q(t) of one repetition satisfies q = q_open - Z P_a at every frequency up to four times the sea's
    highest, and P_a = K_dm^2 |q| q at every time. The flow is found by iteration about the linearised
    turbine. Linear turbines and compressible air are not supported. **Raises** ValueError if a frequency is
    not a multiple of 1/duration, and if the iteration does not converge.
    """
    turns = omega * duration / (2.0 * np.pi)
    index = np.round(turns).astype(int)
    if np.max(np.abs(turns - index)) > 1e-6:
        raise ValueError(
            f"the sea does not repeat after duration = {duration:g} s: use multiples of 1/duration (Hz)"
        )
    linear = linear_sea_response(geometry, amplitude, omega, K_dm, rho0, g)
    last = _HARMONICS * int(index.max())
    every = 2.0 * np.pi * np.arange(last + 1) / duration
    q_open = np.zeros(last + 1, complex)
    water = _water(geometry, amplitude, omega, rho0, g, K_dm)
    q_open[index] = water.q_open
    Z = np.zeros(last + 1, complex)
    Z[1:] = _of_frequency(geometry, every[1:], g)[1] / rho0
    resistance = linear.P_owc / max(linear.sigma_q**2, 1e-300)
    n = 4 * last  # many samples per repetition, because the spectrum of |q| q is unbounded

    def in_time(a: NDArray[Any]) -> Real:
        return np.fft.irfft(np.conj(a), n) * n / 2.0  # for exp(-i omega t); rfft gives n/2 times amplitudes

    def in_frequency(y: Real) -> Complex:
        return np.asarray(2.0 / n * np.conj(np.fft.rfft(y))[: last + 1], complex)

    q = q_open / (1.0 + Z * resistance)
    for _ in range(400):
        there = in_time(q)
        rest = in_frequency(K_dm**2 * np.abs(there) * there) - resistance * q
        new = (q_open - Z * rest) / (1.0 + Z * resistance)
        change = float(np.linalg.norm(new - q) / np.linalg.norm(q))
        q = 0.5 * (q + new)
        if change < 1e-8:
            break
    else:
        raise ValueError(f"the iteration does not converge at K_dm = {K_dm:g}: use linear_sea_response")
    flow = in_time(q)
    pressure = K_dm**2 * np.abs(flow) * flow
    level = np.abs(q[1:]) / (every[1:] * water.length)
    return LinearSea(
        sigma_q=float(np.std(flow)),
        sigma_P_a=float(np.std(pressure)),
        sigma_level=float(np.sqrt(0.5 * np.sum(level**2))),
        P_owc=float(np.mean(pressure * flow)),
        P_inc=water.P_inc,
    )


def _water(
    geometry: ChamberGeometry, amplitude: Complex, omega: Real, rho0: float, g: float, K_dm: float
) -> _Water:
    if not K_dm >= 0.0:
        raise ValueError(f"K_dm = {K_dm} must not be negative")
    q_S, Z = _of_frequency(geometry, omega, g)
    speed = np.asarray(theory.group_velocity(omega, geometry.depth, g), float)
    return _Water(
        omega=np.asarray(omega, float),
        q_open=q_S * amplitude,
        Z=Z / rho0,
        P_inc=float(0.5 * rho0 * g * np.sum(np.abs(amplitude) ** 2 * speed)),
        length=geometry.length,
    )


def _of_frequency(geometry: ChamberGeometry, omega: Real, g: float) -> tuple[Complex, Complex]:
    """Flow of the open chamber per metre of amplitude (m/s), and rho0 times the admittance (s).

    Flow and admittance vary smoothly with frequency. For more than `_NODES` frequencies, both are
    interpolated by splines through `_NODES` frequencies.
    """
    if len(omega) <= _NODES:
        exact = [radiation_and_scattering(geometry, float(w), g) for w in omega]
        return np.array([one.q_S for one in exact]), np.array([one.Z(1.0) for one in exact])
    nodes = np.geomspace(0.999 * np.min(omega), 1.001 * np.max(omega), _NODES)
    at = [radiation_and_scattering(geometry, float(w), g) for w in nodes]
    q_S = scipy.interpolate.CubicSpline(nodes, [one.q_S for one in at])(omega)
    return q_S, scipy.interpolate.CubicSpline(nodes, [one.Z(1.0) for one in at])(omega)
