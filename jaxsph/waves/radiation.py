"""Radiation and scattering of regular waves by the chamber of an onshore oscillating water column.

A chamber of length b in water of depth h is closed by a vertical back wall at x = 0 and by a front wall of
draught a at x = b; waves come from x = +inf. Incompressible air of uniform gauge pressure p acts on the
chamber's surface. The module uses numpy on the host in double precision; no function is traced.

The time factor is exp(-i omega t), z = 0 is the still water level and K = omega^2 / g. The potential is
phi_S + (i omega p / (rho g)) phi_R. Here phi_S is the incident wave and its scattering by the open chamber,
and phi_R, the radiation, satisfies phi_z - K phi = 1 on the chamber's surface. q is the flow of AIR OUT of
the chamber per unit width, b times the rate at which the column rises:

    q = q_S - Z p,    Z = B - iA = -(i omega / (rho g)) q_R

mu = Re q_R / b and nu = Im q_R / b are the dimensionless added mass and damping. Two identities hold: the
open chamber reflects all energy, |R| = 1; and Im q_R = |q_S|^2 / (4 K k h), where q_S is the flow caused by
the incident potential exp(-ikx) psi_0(z), of unit coefficient and with (1/h) int psi_0^2 dz = 1. This module
gives q_S for a unit amplitude of the elevation instead. The potential's coefficient is then
-i g / (omega psi_0(0)), and the identity becomes Im q_R = |q_S|^2 / (4 omega c_g); c_g is the group velocity.

Source for the thin wall: D. V. Evans and R. Porter, Hydrodynamic characteristics of an oscillating water
column device, Applied Ocean Research 17 (1995) 155-164. The thick wall is solved by the same matching, with
modes under the wall and the weaker singularity of right-angled edges. The horizontal velocity u(z) in the
gap is found by Galerkin's method:

- On both sides of the gap the potential is a sum over the vertical modes psi_n = cos k_n(z + h) / sqrt(N_n)
  of the whole depth, (1/h) int psi_n^2 dz = 1, with k_0 = -ik for the progressive wave. Continuity of the
  potential in the gap gives an integral equation for u with a logarithmically singular kernel.
- u is expanded in v_m = (1 - s^2)^(L - 1/2) C_2m^(L)(s), s = (z + h) / (h - a), which have the singularity
  of the edge: L = 0 (Chebyshev, u ~ r^-1/2) for a thin wall, L = 1/6 (Gegenbauer, u ~ r^-1/3) for a right
  angle. The cosine transform of v_m is, up to a factor, the Bessel function J_{2m+L}(kappa) / kappa^L.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy  # which imports its subpackages on first use
from numpy.typing import NDArray

from jaxsph.waves import theory

Matrix = NDArray[np.floating]
"""Matrix of real numbers."""


_FUNCTIONS = 16
"""Number of edge functions v_m at each edge of the gap."""


_FAR = 4000.0
"""Argument kappa (-) beyond which sums over modes replace the Bessel functions by their asymptotic forms."""


@dataclass(frozen=True)
class ChamberGeometry:
    """Section of an onshore oscillating water column; all lengths in m.

    **Raises** ValueError for lengths that are out of range.
    """

    depth: float
    """Still water depth h over a flat bed, m."""
    length: float
    """Inner length b of the chamber, from the back wall to the front wall's inner face, m."""
    draught: float
    """Draught a: depth of the front wall's tip, m."""
    thickness: float = 0.0
    """Thickness t of the front wall, m; 0 is a thin wall."""

    def __post_init__(self) -> None:
        """**Raises** ValueError for lengths that are out of range."""
        if not (self.depth > 0.0 and self.length > 0.0 and self.thickness >= 0.0):
            raise ValueError(f"{self}: depth and length must be positive, thickness not negative")
        if not 0.0 < self.draught < self.depth:
            raise ValueError(f"draught = {self.draught:g} m must be between 0 and {self.depth:g} m")

    @property
    def gap(self) -> float:
        """Height of the opening under the front wall, m."""
        return self.depth - self.draught


@dataclass(frozen=True)
class RadiationAndScattering:
    """Radiation and scattering of waves by a chamber at one frequency, for any turbine and wave height.

    Phases refer to an incident wave whose undisturbed crest is at the back wall at t = 0.
    """

    geometry: ChamberGeometry
    omega: float
    """Angular frequency, rad/s."""
    g: float
    """Acceleration of gravity, m/s2."""
    k: float
    """Wavenumber, rad/m."""
    q_R: complex
    """Flow q_R of the radiation potential phi_R, m."""
    q_S: complex
    """Flow of air q_S out of the open chamber per unit width and per metre of incident amplitude, m/s."""
    R: complex
    """Reflection coefficient of the open chamber, at the back wall (-); its modulus is 1."""

    @property
    def group_velocity(self) -> float:
        """Group velocity c_g, m/s."""
        return group_velocity(self.omega, self.k, self.geometry.depth)

    @property
    def Kh(self) -> float:
        """Depth h times the wavenumber K = omega^2 / g of deep water (-)."""
        return self.omega**2 * self.geometry.depth / self.g

    @property
    def mu(self) -> float:
        """Added mass mu = rho g A / (omega b) (-)."""
        return self.q_R.real / self.geometry.length

    @property
    def nu(self) -> float:
        """Radiation damping nu = rho g B / (omega b) (-)."""
        return self.q_R.imag / self.geometry.length

    @property
    def eta_max(self) -> float:
        """Largest efficiency of any linear turbine (-): 2 / (1 + sqrt(1 + (mu/nu)^2))."""
        nu = max(self.nu, 0.0)  # rounding can make nu negative if no wave reaches the chamber
        return float(2.0 * nu / (nu + np.hypot(self.mu, nu)))

    def Z(self, rho0: float = 1000.0) -> complex:
        """Radiation admittance Z = B - iA: flow of air into the chamber per unit air pressure, m2/(s Pa)."""
        return -1j * self.omega / (rho0 * self.g) * self.q_R


def group_velocity(omega: float, k: float, depth: float) -> float:
    """Group velocity (m/s) of waves of angular frequency omega (rad/s) and wavenumber k (rad/m), in double
    precision."""
    kd = k * depth
    return float(0.5 * omega / k * (1.0 - 4.0 * kd * np.exp(-2.0 * kd) / np.expm1(-4.0 * kd)))


@lru_cache(maxsize=256)
def radiation_and_scattering(
    geometry: ChamberGeometry, omega: float, g: float = theory.GRAVITY
) -> RadiationAndScattering:
    """Radiation and scattering by a chamber at the angular frequency `omega` (rad/s, > 0).

    A call takes a few milliseconds, or some tens of milliseconds for the first frequency of a geometry;
    results are cached. Up to Kh = 3 the error is below 1e-6 of |q_R| for a thin wall and for a thickness of
    at least 1/50 of the gap under the wall. The error grows to 3e-5 at 1/300, and to 4e-4 for walls so
    thin that the thickness has no effect.
    **Raises** ValueError if omega or g (m/s2) is not positive.
    """
    if not (omega > 0.0 and g > 0.0):
        raise ValueError(f"omega = {omega} and g = {g} must be positive")
    return _solve(geometry, float(omega), float(g), _FUNCTIONS)


def _solve(geometry: ChamberGeometry, omega: float, g: float, functions: int) -> RadiationAndScattering:
    """Radiation and scattering as in `radiation_and_scattering`, with `functions` functions at each edge.

    Without the propagating mode the equations are real: A a = rhs. `_thin` and `_thick` give S = V^T A^-1 V
    for V = (e, f1, f2): e integrates the velocity at the chamber's edge; f1 and f2 project the velocities at
    the chamber's and at the outer edge on the propagating mode (h U_0). The propagating mode is then
    added as a correction of rank two, A + alpha1 f1 f1^T + alpha2 f2 f2^T with alpha1 = -cot(kb) / (kh) and
    alpha2 = i / (kh).
    """
    h, b, t = geometry.depth, geometry.length, geometry.thickness
    K = omega**2 / g
    kh = propagating(K * h)
    k, kb = kh / h, kh * b / h
    # norm: N_0 without its factor exp(2kh), which overflows in deep water; surface: the mode's value at z = 0
    norm = 0.5 * (np.exp(-2.0 * kh) - np.expm1(-4.0 * kh) / (4.0 * kh))
    surface = 0.5 * (1.0 + np.exp(-2.0 * kh)) / np.sqrt(norm)
    S = (_thick if t > 0.0 else _thin)(geometry, K * h, kh, norm, functions)

    # h U_0 = (sin(kb) y1, y2); without the sine in y1, a standing wave in the chamber causes no singularity
    matrix = np.array(
        [
            [np.sin(kb) - S[1, 1] * np.cos(kb) / kh, 1j * S[1, 2] / kh],
            [-S[1, 2] * np.cos(kb) / kh, 1.0 + 1j * S[2, 2] / kh],
        ]
    )
    facing = np.exp(-1j * k * (b + t))
    # Radiation: pressure 1/K at the inner edge. Scattering: the incident wave and its mirror image.
    rhs = np.stack([S[:, 0] / K, 2.0 * facing * S[:, 2]], axis=-1)
    y = np.linalg.solve(matrix, rhs[1:])
    back = np.stack([-np.cos(kb) * y[0], 1j * y[1]]) / kh
    q_R, q_S = -(rhs[0] - S[0, 1:] @ back)
    return RadiationAndScattering(
        geometry,
        omega,
        g,
        k,
        q_R=complex(q_R),
        q_S=complex(q_S * -1j * g / (omega * surface)),
        R=complex(facing * (facing - back[1, 1])),
    )


def _thin(geometry: ChamberGeometry, Kh: float, kh: float, norm: float, functions: int) -> Matrix:
    """Matrix S of `_solve` for a wall without thickness, where both edges coincide."""
    ratio = geometry.gap / geometry.depth
    inner, outer = _modes(ratio, Kh, geometry.length / geometry.depth, 0.0, functions)
    e = _mean(0.0, functions)
    f = _wave(ratio, kh, norm, 0.0, functions)
    V = np.stack([e, f, f], axis=-1)
    return V.T @ np.linalg.solve(inner + outer, V)


def _thick(geometry: ChamberGeometry, Kh: float, kh: float, norm: float, functions: int) -> Matrix:
    """Matrix S of `_solve` for a wall with thickness.

    Modes cos(j pi (z+h) / (h-a)) under the wall are matched at its edges. The last unknown is the
    depth-averaged potential under the wall at its inner edge; its equation is the balance of the flows into
    and out of the gap.
    """
    ratio, order = geometry.gap / geometry.depth, 1.0 / 6.0
    inner, outer = _modes(ratio, Kh, geometry.length / geometry.depth, order, functions)
    e = _mean(order, functions)
    f = _wave(ratio, kh, norm, order, functions)
    slender = geometry.thickness / geometry.gap
    same, across = _under(slender, order, functions)
    zero = np.zeros_like(e)
    A = np.block(
        [
            [inner + same, -across, -e[:, None]],
            [-across, outer + same + slender * np.outer(e, e), e[:, None]],
            [-e[None], e[None], np.zeros((1, 1))],
        ]
    )
    V = np.stack([np.r_[e, zero, 0.0], np.r_[f, zero, 0.0], np.r_[zero, f, 0.0]], axis=-1)
    return V.T @ np.linalg.solve(A, V)


@lru_cache(maxsize=64)
def _under(slender: float, order: float, functions: int) -> tuple[Matrix, Matrix]:
    """Sums over the modes under the wall with coth(x) and with 1 / sinh(x), x = j pi slender.

    The terms are coth(x) or 1 / sinh(x), divided by j pi / 2, times the products of the transforms at
    kappa = j pi; `slender` is t / (h - a). The sums do not depend on the frequency.
    """
    whole, W = _static(1.0, order, functions)
    # coth - 1 and 1 / sinh are below rounding for x > 37. For a wall so thin that 5000 modes do not reach
    # x = 37, the edge functions do not resolve the modes that are left out.
    count = min(int(37.0 / (np.pi * slender)) + 1, 5000)
    j = np.arange(1, count + 1)
    W = W[:count] if count <= len(W) else _transform(j * np.pi, order, functions)
    decay = np.exp(-j * np.pi * slender)
    share = 4.0 / (j * np.pi) * decay / -np.expm1(-2.0 * j * np.pi * slender)
    return whole + W.T @ ((share * decay)[:, None] * W), W.T @ (share[:, None] * W)


def propagating(Kh: float) -> float:
    """Root kh of kh tanh kh = Kh, for the propagating mode (-)."""
    found = scipy.optimize.brentq(
        lambda x: x * np.tanh(x) - Kh, 0.0, Kh + np.sqrt(Kh), xtol=1e-300, rtol=np.float64(1e-15)
    )
    return float(np.asarray(found))


def evanescent(Kh: float, count: int) -> NDArray[np.floating]:
    """Roots k_n h, n = 1 .. count, of k_n h tan k_n h = -Kh, for the evanescent modes (-)."""
    n = np.arange(1, count + 1)
    x = n * np.pi - np.arctan(Kh / (n * np.pi))
    for _ in range(8):  # Newton's method: the function's derivative lies between 1 - 1/pi and 1
        x = x - (x - n * np.pi + np.arctan(Kh / x)) / (1.0 - Kh / (Kh**2 + x**2))
    return x


def _transform(kappa: NDArray[np.floating], order: float, functions: int) -> Matrix:
    """Cosine transforms of the edge functions, J_{2m+L}(kappa) / kappa^L, [kappa, m].

    Only the two highest orders are computed from the function itself, which takes much longer than the
    recurrence to the lower orders, J_{n-1} = (2n / kappa) J_n - J_{n+1}, which is stable in this direction.
    """
    n = 2.0 * (functions - 1) + order
    above, here = scipy.special.jv(n + 1.0, kappa), scipy.special.jv(n, kappa)
    found = [here]
    for _ in range(functions - 1):
        for _ in range(2):
            above, here, n = here, 2.0 * n / kappa * here - above, n - 1.0
        found.append(here)
    return np.stack(found[::-1], axis=-1) / kappa[:, None] ** order


def _mean(order: float, functions: int) -> NDArray[np.floating]:
    """Cosine transforms of the edge functions at kappa = 0: only the first function carries flow."""
    e = np.zeros(functions)
    e[0] = 0.5**order / scipy.special.gamma(1.0 + order)
    return e


def _wave(ratio: float, kh: float, norm: float, order: float, functions: int) -> NDArray[np.floating]:
    """Integrals int v_m psi_0 dz, by transforms at kappa = ikc, where J becomes I; the gap is c = ratio h."""
    m, kc = np.arange(functions), ratio * kh
    return (
        (-1.0) ** m * scipy.special.ive(2.0 * m + order, kc) * np.exp(kc - kh) / (kc**order * np.sqrt(norm))
    )


def _modes(ratio: float, Kh: float, length: float, order: float, functions: int) -> tuple[Matrix, Matrix]:
    """Sums over the evanescent modes of the chamber and of the sea.

    The terms are [coth k_n b or 1] / (k_n h) times int v_m psi_n dz int v_m' psi_n dz; `length` is b / h. The
    terms differ from the terms for K = 0 by a part that decays two orders faster. A few hundred terms of this
    difference are therefore added to the full sum for K = 0, which does not depend on the frequency.
    """
    whole, F0 = _static(ratio, order, functions)
    F0 = F0[: int(150 + 20.0 * Kh + 6.0 / length)]
    n = np.arange(1, len(F0) + 1)
    x = evanescent(Kh, len(F0))
    norm = 0.5 * (1.0 + np.sin(2.0 * x) / (2.0 * x))
    F = _transform(x * ratio, order, functions)
    weight = 1.0 / (x * norm)
    outer = whole - F0.T @ ((2.0 / (n * np.pi))[:, None] * F0)
    inner = outer + F.T @ ((weight / np.tanh(x * length))[:, None] * F)
    return inner, outer + F.T @ (weight[:, None] * F)


@lru_cache(maxsize=64)
def _static(ratio: float, order: float, functions: int) -> tuple[Matrix, Matrix]:
    """Sum over the modes for K = 0 of 2 / (n pi) times the transforms' products, and the transforms [n, m].

    n starts at 1, and kappa = n pi ratio. For kappa above `_FAR` the product is
    (-1)^(m+m') (1 + cos(2 kappa - pi L - pi/2)) / (pi kappa^(1+2L)). The first part sums to Hurwitz's zeta
    function. Under the wall, where 2 kappa is a multiple of 2 pi, the second part sums to the same function;
    elsewhere the second part is summed by parts.
    """
    step = np.pi * ratio
    count = int(_FAR / step) + 1
    n = np.arange(1, count + 1)
    F = _transform(n * step, order, functions)
    near = F.T @ ((2.0 / (n * np.pi))[:, None] * F)
    power = 2.0 + 2.0 * order
    turn = np.exp(2j * step)
    # Summation by parts leaves a remainder of order 1 / |1 - turn|, which is too large for turn near 1.
    steady = float(scipy.special.zeta(power, count + 1))
    if abs(1.0 - turn) * count > 1.0:
        swinging = (count + 1.0) ** -power * turn ** (count + 1) / (1.0 - turn)
    else:
        swinging = steady
    phase = np.exp(-1j * np.pi * (order + 0.5))
    far = 2.0 / np.pi / (np.pi * step ** (1.0 + 2.0 * order)) * (steady + np.real(phase * swinging))
    sign = (-1.0) ** np.arange(functions)
    return near + far * np.outer(sign, sign), F
