"""Linear theory of the onshore oscillating water column in small regular waves.

`waves.radiation` solves the potential flow and defines the symbols and signs: q = q_S - Z p, with the flow q
of air out of the chamber per unit width and the gauge pressure p of the chamber. This module couples the
water to the compressible air of the chamber and to a turbine. The module uses numpy on the host in double
precision; no function is traced.

Potential flow passes the lip of the front wall without loss; a real flow separates there. The loss can be
included as a head loss Delta p = zeta rho |v| v / 2 with the column's mean velocity v = q / b. Referred to
the mean velocity q / gap under the lip, the same loss has the coefficient zeta (gap / b)^2. The loss acts on
the column like additional air pressure: a quadratic resistance rho zeta / (2 b^2) in series with the
turbine's K_dm^2. The theory does not provide zeta; its value is an assumption.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jaxsph.waves.radiation import RadiationAndScattering


@dataclass(frozen=True)
class LinearAir:
    """Linear resistance of a turbine, and compliance of the air in the chamber; both are 0 by default."""

    resistance: float = 0.0
    """Resistance of a linear turbine, Pa s/m2: P_a = resistance q + K_dm^2 |q| q."""
    give: float = 0.0
    """Compliance of the air, volume over gamma p0, m2/Pa; 0 for incompressible air."""

    def __post_init__(self) -> None:
        """**Raises** ValueError for a value below zero."""
        if not (self.resistance >= 0.0 and self.give >= 0.0):
            raise ValueError(f"resistance = {self.resistance} and give = {self.give} must not be negative")


IDEAL_AIR = LinearAir()
"""Incompressible air, and a turbine without linear resistance."""


@dataclass(frozen=True)
class LinearOWC:
    """Linear response of a chamber to regular waves, with a turbine of the quadratic law P_a = K_dm^2 |q| q.

    Incident power is absorbed by the turbine, lost at the lip or reflected: 1 = xi + P_lip / P_inc + |R|^2.
    A complex amplitude a stands for Re(a exp(-i omega t)); see `RadiationAndScattering` for the
    phase. If `linear_response` was given arrays of H and K_dm, the results have their broadcast shape.
    """

    water: RadiationAndScattering
    """Radiation and scattering at the waves' frequency."""
    H: NDArray
    """Incident wave height, m; the amplitude is half of the height."""
    K_dm: NDArray
    """Damping coefficient K_dm of the quadratic law, kg^0.5 m^-2.5."""
    Lambda: NDArray
    """Admittance of the linear turbine q = Lambda p with the same mean power, m2/(s Pa); infinite for an
    open chamber."""
    q: NDArray
    """Complex amplitude of the flow of air out of the chamber per unit width, m2/s."""
    P_a: NDArray
    """Complex amplitude of the gauge pressure of the air at the waves' frequency, Pa."""
    level: NDArray
    """Complex amplitude of the elevation, averaged over the chamber's surface, m."""
    P_owc: NDArray
    """Mean absorbed power, W/m."""
    P_inc: NDArray
    """Mean incident power, W/m."""
    R: NDArray
    """Complex reflection coefficient of the device at the back wall (-)."""
    K_dm_best: NDArray
    """Damping coefficient for the largest efficiency `eta_max` in waves of height H, without lip loss,
    kg^0.5 m^-2.5."""
    lip_loss: NDArray
    """Loss coefficient zeta of the lip, referred to the column's mean velocity (-)."""
    P_lip: NDArray
    """Mean power lost at the lip, W/m."""
    air: LinearAir
    """Linear part of the turbine, and compliance of the air."""
    q_pto: NDArray
    """Flow through the turbine per unit width, complex, m2/s; equal to q in incompressible air."""
    eta_max: NDArray
    """Largest efficiency that any linear turbine reaches with this air at this period, without lip loss
    (-)."""

    @property
    def omega(self) -> float:
        """Angular frequency of the waves, rad/s."""
        return self.water.omega

    @property
    def T(self) -> float:
        """Wave period, s."""
        return 2.0 * np.pi / self.omega

    @property
    def Kh(self) -> float:
        """Depth h times the wavenumber K = omega^2 / g of deep water (-)."""
        return self.water.Kh

    @property
    def mu(self) -> float:
        """Added mass mu of `water` (-)."""
        return self.water.mu

    @property
    def nu(self) -> float:
        """Radiation damping nu of `water` (-)."""
        return self.water.nu

    @property
    def xi(self) -> NDArray:
        """Hydrodynamic efficiency xi (-).

        Without lip loss and in incompressible air xi is 1 - |Lambda - Z|^2 / |Lambda + Z|^2.
        """
        return self.P_owc / self.P_inc

    @property
    def P_a_peak(self) -> NDArray:
        """Peak air pressure by the turbine's law in sinusoidal flow, Pa; 3 pi/8 |P_a| for a quadratic law."""
        size = np.abs(self.q_pto)
        return (self.K_dm**2 * size + self.air.resistance) * size


def linear_response(
    water: RadiationAndScattering,
    H: ArrayLike,
    K_dm: ArrayLike,
    rho0: float = 1000.0,
    lip_loss: ArrayLike = 0.0,
    air: LinearAir = IDEAL_AIR,
) -> LinearOWC:
    """Linear response of a chamber to regular waves of height H (m), with a quadratic turbine.

    The turbine is replaced by the linear turbine that absorbs the same mean power. For a sinusoidal q its
    resistance is 1 / Lambda = (8 / (3 pi)) K_dm^2 |q|, which is solved together with
    q = q_S A Lambda / (Lambda + Z), A = H / 2. The solution is unique because |q| falls as the damping grows.
    K_dm may range from 0 (an open chamber) to values so large that the chamber is practically closed.

    `lip_loss` is the coefficient zeta of a head loss Delta p = zeta rho0 |v| v / 2 at the lip of the front
    wall, with the column's mean velocity v = q / b (see the module docstring). Both laws are quadratic in q:
    K_dm^2 + rho0 zeta / (2 b^2) replaces K_dm^2, and the pressure drop is shared in the ratio of these terms.

    With a linear turbine's resistance r and the air's compliance c in `air`, the turbine's flow is
    q_t = q + i omega c p, and p = (r + 8 / (3 pi) K_dm^2 |q_t|) q_t. Z - i omega c then replaces Z.

    **Arguments**: `H` (m, > 0), `K_dm` (kg^0.5 m^-2.5, >= 0) and `lip_loss` (-, >= 0) broadcast; `rho0`
    density, kg/m3.
    **Raises** ValueError for values out of range, and for a lip loss combined with `air`.
    """
    H, K_dm, lip_loss = np.broadcast_arrays(*(np.asarray(a, float) for a in (H, K_dm, lip_loss)))
    _check_response(H, K_dm, rho0, lip_loss, air)
    Z = water.Z(rho0) - 1j * water.omega * air.give
    q_open = water.q_S * 0.5 * H
    lip = 0.5 * rho0 * lip_loss / water.geometry.length**2
    resistance, total = _resistances(q_open, Z, K_dm**2, lip, air.resistance)
    q_pto = q_open / (1.0 + Z * total)
    q = q_pto * (1.0 - 1j * water.omega * air.give * resistance)
    # Lambda = |Z| gives the largest power, with |q| = |q_S| A / |1 + Z/|Z||.
    best_q = np.abs(q_open) / abs(1.0 + Z / abs(Z))
    weight = rho0 * water.g * water.group_velocity
    P_inc = 0.125 * weight * H**2
    with np.errstate(divide="ignore"):  # an open chamber has no resistance: Lambda is inf
        Lambda = 1.0 / resistance
        K_dm_best = np.sqrt(3.0 * np.pi / 8.0 / (best_q * abs(Z)))
    return LinearOWC(
        water=water,
        H=H[()],
        K_dm=K_dm[()],
        Lambda=Lambda[()],
        q=q[()],
        P_a=(resistance * q_pto)[()],
        level=(1j * q / (water.omega * water.geometry.length))[()],  # d(level)/dt = q / b
        P_owc=(0.5 * resistance * np.abs(q_pto) ** 2)[()],
        P_inc=P_inc[()],
        # Pressure p on the column radiates a wave of amplitude p q_S / (2 rho g c_g), by Haskind's relation.
        R=(water.R + total * q_pto * water.q_S / (weight * H))[()],
        K_dm_best=K_dm_best[()],
        lip_loss=lip_loss[()],
        P_lip=(0.5 * (total - resistance) * np.abs(q) ** 2)[()],
        air=air,
        q_pto=q_pto[()],
        eta_max=(0.5 * best_q**2 / abs(Z) / P_inc)[()],
    )


def _check_response(H: NDArray, K_dm: NDArray, rho0: float, lip_loss: NDArray, air: LinearAir) -> None:
    """Checks the arguments of `linear_response`. **Raises** ValueError if an argument is out of range."""
    if not (np.all(H > 0.0) and np.all(K_dm >= 0.0) and np.all(lip_loss >= 0.0) and rho0 > 0.0):
        raise ValueError(
            f"H = {H} and rho0 = {rho0} must be positive, and K_dm = {K_dm} and lip_loss = {lip_loss} must "
            "not be negative"
        )
    if air != IDEAL_AIR and np.any(lip_loss > 0.0):
        raise ValueError("lip_loss must be 0 with compressible air or a linear resistance (`air`)")


def _resistances(
    q_open: NDArray, Z: complex, turbine: NDArray, lip: NDArray, linear: float
) -> tuple[NDArray, NDArray]:
    """Equivalent linear resistances (Pa s/m2) of the turbine, and of turbine and lip together.

    **Arguments**: flow of the open chamber, m2/s; admittance Z of water and air; coefficients (kg/m5) of the
    quadratic laws of turbine and lip; resistance of the linear turbine.
    """
    series = turbine + lip
    # combine water, air and linear turbine into one source and one admittance for the quadratic laws
    softened = 1.0 + Z * linear
    drive = 8.0 / (3.0 * np.pi) * series * np.abs(q_open / softened)
    quadratic = _resistance(drive, complex(Z / softened))
    share = np.divide(turbine, series, out=np.zeros_like(series), where=series > 0.0)
    return linear + quadratic * share, linear + quadratic


def _resistance(drive: NDArray, Z: complex) -> NDArray:
    """Solution r = 1 / Lambda >= 0 (Pa s/m2) of r |1 + Z r| = `drive`; unique because Re Z >= 0.

    With x = r |Z| the left side times |Z| lies between x max(1, x) and x (1 + x). The first guess, from the
    lower bound, therefore exceeds the root by a factor of at most 1.62. The logarithm of the left side has a
    slope between 1 and 2 in log x, so that Newton's method converges.
    """
    size = abs(Z)
    cosine = Z.real / size
    some = drive * size > 1e-300  # smaller drives give r = 0, because ratios would underflow
    target = np.where(some, drive * size, 1.0)
    x = np.minimum(target, np.sqrt(target))
    for _ in range(8):
        square = 1.0 + x * (2.0 * cosine + x)
        error = np.log(x * np.sqrt(square) / target)
        x = x * np.exp(-error / (1.0 + x * (cosine + x) / square))
    return np.where(some, x / size, 0.0)
