"""Second-order wavemaker theory of a piston for any number of waves, after Schaeffer (1996).

The module uses numpy on the host in double precision. Source: H. A. Schaeffer, Second-order wavemaker theory
for irregular waves, Ocean Engineering 23 (1996) 47-88. The equations are solved here for a piston by
projection on the free wave. Two first-order modes p and q (each progressive or evanescent, of the same wave
or of two waves) force a bound wave of frequency Omega = omega_p + omega_q or omega_p - omega_q and wavenumber
K. The bound wave, and the second-order term X1 phi1_xx of the condition at the displaced wall, would generate
a free wave of that frequency. The second-order displacement generates the same free wave with opposite sign,
so that no free wave remains.

Waves have the factor exp(i (omega t - k x)), z = 0 is the still water level, and an evanescent mode has an
imaginary wavenumber k = -i kappa. For a difference frequency the second mode is replaced by its conjugate:
frequency, wavenumber and amplitude become -omega, -conj(k), conj(B). The free wave's k0 satisfies
Omega^2 = g k0 tanh(k0 h), so that the projection of a bound wave cancels the denominator of the
bound wave's amplitude, and no term is near-resonant.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jaxsph.waves import theory

Complex = NDArray[np.complexfloating]
"""Complex amplitudes."""
Real = NDArray[np.floating]
"""Real numbers in double precision."""

MODES = 16
"""Number of evanescent modes of every wave.

Because of the corner between the free surface and the piston, the sum over J modes converges only as 1/J.
For T = 1.2 s and a depth of 0.5 m the error of the second-order displacement with 16 modes is 7 %.
Extrapolation from the sums of 8 and 16 modes reduces this error to 0.5 %.
"""
MANY = 100
"""Number of waves above which only half as many modes are used. In a sea of 160 waves with a peak period of
1.4 s, in water 0.5 m deep, the error of the second-order displacement is then 0.4 %, and the sum takes a
quarter of the time."""


class Harmonics(NamedTuple):
    """Sum of waves at one position: Re sum_n amplitude_n exp(i omega_n t)."""

    amplitude: Complex
    """Complex amplitudes, in the unit of the sum."""
    omega: Real
    """Angular frequencies, rad/s."""
    k: Real
    """Wavenumbers of the phase along the tank, rad/m; a weighted mean where several pairs of waves have the
    same frequency."""

    def at(self, t: Real) -> Real:
        """Value of the sum at the times t (s)."""
        t = np.asarray(t, float)
        return np.real(np.exp(1j * np.multiply.outer(t, self.omega)) @ self.amplitude)


class _Modes(NamedTuple):
    """First-order modes of waves, `[N, J]`: wavenumber (rad/m), angular frequency (rad/s) and amplitude of
    the potential at z = 0 (m2/s)."""

    k: Complex
    omega: Complex
    B: Complex

    def conjugate(self) -> _Modes:
        return _Modes(-np.conj(self.k), -self.omega, np.conj(self.B))

    def __getitem__(self, where) -> _Modes:
        return _Modes(self.k[where], self.omega[where], self.B[where])


def wavenumbers(omega: Real, d: float, g: float) -> Real:
    """Wavenumbers of linear waves in water of depth d (m), rad/m, always in double precision."""
    y = np.asarray(omega, float) ** 2 * d / g
    kd = y / (-np.expm1(-(y**1.25))) ** 0.4  # Guo (2002)
    for _ in range(4):
        sigma = np.tanh(kd)
        kd = kd - (kd * sigma - y) / (sigma + kd * (1.0 - sigma**2))
    return np.asarray(kd / d)


def evanescent_wavenumbers(omega: Real, d: float, g: float, modes: int) -> Real:
    """Decay rates of a piston's evanescent modes, `[N, modes]`, 1/m: omega^2 = -g kappa tan(kappa d)."""
    y = (np.asarray(omega, float) ** 2 * d / g)[..., None]
    n = np.arange(1, modes + 1) * np.pi
    kd = n * np.ones_like(y)
    for _ in range(60):  # a contraction: the slope y / (y^2 + kd^2) is less than 1 / pi
        kd = n - np.arctan(y / kd)
    return np.asarray(kd / d)


def piston_transfer(omega: Real, d: float, g: float) -> Real:
    """Transfer function Phi of a piston (-): ratio of the wave's amplitude to the piston's amplitude."""
    kd = wavenumbers(omega, d, g) * d
    return np.asarray(2.0 * np.tanh(kd) / (1.0 + 4.0 * kd * np.exp(-2.0 * kd) / -np.expm1(-4.0 * kd)))


def displacement(a: Complex, omega: Real, d: float, g: float = theory.GRAVITY) -> Harmonics:
    """First-order displacement of a piston for waves with complex amplitudes a (m), m."""
    return Harmonics(-1j * a / piston_transfer(omega, d, g), omega, wavenumbers(omega, d, g))


def second_order_displacement(
    a: Complex, omega: Real, d: float, g: float = theory.GRAVITY, modes: int = MODES
) -> Harmonics:
    """Second-order displacement of a piston that generates no free second-order waves, m.

    **Arguments**: complex amplitudes a (m) of the progressive waves at the piston, their angular frequencies
    (rad/s), depth d (m). The frequencies of the result are the non-zero sums and differences of the waves'
    frequencies.
    """
    if len(omega) > MANY:
        modes = min(modes, MODES // 2)
    coarse, fine = (_with_modes(a, omega, d, g, count) for count in (modes // 2, modes))
    return fine._replace(amplitude=2.0 * fine.amplitude - coarse.amplitude)


def _with_modes(a: Complex, omega: Real, d: float, g: float, modes: int) -> Harmonics:
    """Second-order displacement of a piston, computed with `modes` evanescent modes, m."""
    first = displacement(a, omega, d, g)
    p = _modes(first, d, g, modes)

    def pair(n: int, m: slice, sign: int) -> tuple[Complex, Complex, Real]:
        one, other = p[n, :, None, None], p[m][None]
        X1, X2 = first.amplitude[n], first.amplitude[m]
        if sign < 0:
            other, X2 = other.conjugate(), np.conj(X2)
        Omega = np.real((one.omega + other.omega)[0, :, 0])
        safe = np.where(Omega == 0.0, 1.0, np.abs(Omega))
        k0 = wavenumbers(safe, d, g)
        W0 = safe**2 / g
        # the bound waves, and the wall's displacement, each for both orders of the two modes
        K = one.k + other.k
        k2 = k0[None, :, None] ** 2
        bound = -1j * K * (_forcing(one, other, g) + _forcing(other, one, g)) / (g * (K**2 - k2))
        moved = X1 * _wall(p[m] if sign > 0 else p[m].conjugate(), k0, W0, d, g)
        moved = moved + X2 * _wall(p[n : n + 1], k0, W0, d, g)
        total = np.sum(bound, axis=(0, 2)) + moved
        return total * g * k0**2 / (1j * np.where(Omega == 0.0, 1.0, Omega) * safe**2), K[0, :, 0], Omega

    return _collected(pair, len(omega))


def second_order_elevation(
    a: Complex, omega: Real, d: float, x: float = 0.0, g: float = theory.GRAVITY
) -> Harmonics:
    """Second-order elevation bound to waves at x (m) from the piston, m (Sharma and Dean 1981).

    **Arguments**: complex amplitudes a (m) at x = 0 and angular frequencies (rad/s) of the waves.
    The mean level is the still water level. Bound waves of evanescent modes are not included.
    """
    k = wavenumbers(omega, d, g)
    B = 1j * g / omega * a * np.exp(-1j * k * x)
    p = _Modes(k[:, None] + 0j, omega[:, None] + 0j, B[:, None])

    def pair(n: int, m: slice, sign: int) -> tuple[Complex, Complex, Real]:
        one, other = p[n][None], p[m] if sign > 0 else p[m].conjugate()
        Omega = np.real(one.omega + other.omega)
        K = one.k + other.k
        stiffness = g * K * np.tanh(K * d) - Omega**2
        # zero for the difference of a wave with itself, which is a mean level and is left out
        stiffness = np.where(stiffness == 0.0, 1.0, stiffness)
        total = 0.0
        for f, s in ((one, other), (other, one)):
            C = _forcing(f, s, g) / stiffness
            eta = -1j * f.omega * f.B / g
            total = total - (1j * Omega * C + 0.5 * _speeds(f, s, g) + eta * 1j * s.omega * _rise(s, g)) / g
        return total[:, 0], K[:, 0], Omega[:, 0]

    return _collected(pair, len(omega))


def _modes(first: Harmonics, d: float, g: float, modes: int) -> _Modes:
    """Modes that a piston's first-order displacement generates, the progressive mode first."""
    omega = first.omega
    k = np.concatenate([first.k[:, None] + 0j, -1j * evanescent_wavenumbers(omega, d, g, modes)], axis=1)
    W = (omega**2 / g)[:, None] + 0j
    B = -omega[:, None] / k * first.amplitude[:, None] * W / k**2 / _size(k, W, d)
    return _Modes(k, np.broadcast_to(omega[:, None] + 0j, k.shape), B)


def _rise(p: _Modes, g: float) -> Complex:
    """Vertical velocity of modes at z = 0, m/s."""
    return p.omega**2 / g * p.B


def _speeds(p: _Modes, q: _Modes, g: float) -> Complex:
    """Product of the velocities of two modes at z = 0, m2/s2."""
    return -p.k * q.k * p.B * q.B + _rise(p, g) * _rise(q, g)


def _forcing(p: _Modes, q: _Modes, g: float) -> Complex:
    """Forcing of the second-order free-surface condition by two modes in this order, m2/s3.

    phi2_tt + g phi2_z = -eta1 d/dz (phi1_tt + g phi1_z) - d/dt |grad phi1|^2 at z = 0.
    """
    eta = -1j * p.omega * p.B / g
    W = q.omega**2 / g
    return -eta * g * (q.k**2 - W**2) * q.B - 1j * (p.omega + q.omega) * _speeds(p, q, g)


def _wall(q: _Modes, k0: Real, W0: Real, d: float, g: float) -> Complex:
    """Integral over the depth of phi_xx at the wall times the profile of the free wave, m/s.

    The profile is 1 at z = 0. The result `[M]` is summed over the J modes of every wave in `q` `[M, J]`.
    """
    W, k2, free2 = q.omega**2 / g, q.k**2, k0[:, None] ** 2
    # the free wave of a pair can coincide with a wave of the sea
    same = np.abs(k2 - free2) < 1e-8 * free2
    product = (W - W0[:, None]) / np.where(same, 1.0, k2 - free2)
    product = np.where(same, _size(q.k, W, d), product)
    return np.sum(-k2 * q.B * product, axis=1)


def _size(k: Complex, W: Complex, d: float) -> Complex:
    """Integral over the depth of the square of a mode that is 1 at z = 0, m; W = omega^2 / g."""
    return 0.5 * (d * (1.0 - (W / k) ** 2) + W / k**2)


def _collected(pair, count: int) -> Harmonics:
    """Sum of `pair(n, m, sign)` over all pairs of waves; amplitudes of equal frequencies are added.

    `pair` returns twice the amplitude (summed over both orders of the two waves), the wavenumber and the
    frequency of every pair.
    """
    amplitudes, K, Omega = [], [], []
    for n in range(count):
        for sign, m in ((1, slice(n, count)), (-1, slice(0, n))):
            if m.start == m.stop:
                continue
            found, k, at = pair(n, m, sign)
            half = np.full(len(at), 0.5)
            if sign > 0:
                half[0] = 0.25  # the pair of a wave with itself has only one order
            # if a difference frequency is negative, the conjugate has the positive frequency
            back = at < 0.0
            found = np.where(back, np.conj(found), found) * half
            amplitudes.append(found)
            K.append(np.where(back, -1, 1) * np.real(k))
            Omega.append(np.abs(at))
    every, K, Omega = (np.concatenate(one) for one in (amplitudes, K, Omega))
    moving = Omega > 0.0
    every, K, Omega = every[moving], K[moving], Omega[moving]
    # merge frequencies that differ only by rounding
    rounded, place = np.unique(np.round(Omega / np.max(Omega), 10), return_inverse=True)
    weight = np.abs(every) + 1e-300
    total = np.bincount(place, weight)
    return Harmonics(
        np.bincount(place, np.real(every)) + 1j * np.bincount(place, np.imag(every)),
        rounded * np.max(Omega),
        np.bincount(place, weight * K) / total,
    )
