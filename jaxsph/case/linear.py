"""Linear theory of the onshore oscillating water column: what the simulation tends to for small waves.

A chamber of length b on depth h, closed by a vertical back wall at x = 0 and by a front wall of draught a
at x = b; waves come from x = +inf. Incompressible air of uniform gauge pressure p acts on the chamber's
surface. Host numpy in double precision; nothing here is traced.

Time goes as exp(-i omega t), z = 0 is the still water level and K = omega^2 / g. The potential is
phi_S + (i omega p / (rho g)) phi_R, where phi_S scatters the incident wave in the open chamber and phi_R has
phi_z - K phi = 1 on the chamber's surface. q is the flow of AIR OUT of the chamber per unit width, the rate
at which the column rises times b:

    q = q_S - Z p,    Z = B - iA = -(i omega / (rho g)) q_R

mu = Re q_R / b and nu = Im q_R / b are the dimensionless added mass and damping. Two identities: the open
chamber sends everything back, |R| = 1, and Im q_R = |q_S|^2 / (4 K k h) where q_S belongs to the incident
wave exp(-ikx) psi_0(z), of unit coefficient and (1/h) int psi_0^2 dz = 1. Here q_S is given for a unit
amplitude of the elevation instead: the wave's coefficient is then -i g / (omega psi_0(0)), and the identity
Im q_R = |q_S|^2 / (4 omega c_g), c_g being the group velocity.

Sources: D. V. Evans and R. Porter, Hydrodynamic characteristics of an oscillating water column device,
Applied Ocean Research 17 (1995) 155-164, for the thin wall; the thick one is matched in the same way under
the wall, with the weaker singularity of a right-angled edge. How the horizontal velocity u(z) in the gap
is found (Galerkin):

- On both sides of the gap the potential is a sum over the vertical modes psi_n = cos k_n(z + h) / sqrt(N_n)
  of the whole depth, (1/h) int psi_n^2 dz = 1, with k_0 = -ik for the wave. Its continuity is an equation
  for u, whose kernel is singular as a logarithm.
- u is a series of v_m = (1 - s^2)^(L - 1/2) C_2m^(L)(s), s = (z + h) / (h - a), which has the edge's own
  singularity: L = 0 (Chebyshev, u ~ r^-1/2) for a thin wall, L = 1/6 (Gegenbauer, u ~ r^-1/3) for a right
  angle. Its cosine transform is a Bessel function, J_{2m+L}(kappa) / kappa^L but for a factor.
"""

from __future__ import annotations

import numpy as np

from jaxsph.case.case import Case
from jaxsph.errors import CaseError
from jaxsph.waves.linear_owc import (
    ChamberGeometry,
    LinearOWC,
    linear_response,
    radiation_and_scattering,
)


def linear_owc(case: Case) -> LinearOWC:
    """Linear theory of a case's device in its waves, with the case's own lengths (not snapped to dx).

    The incident wave is the linear one, of amplitude waves.H / 2. The water's part is remembered: to sweep
    the damping or the height, call this for each changed case, or `linear_response` with arrays.
    **Raises** CaseError for a case without a device, waves, pto.K_dm or gravity, or with a platform.
    """
    missing = _missing(case)
    if missing is not None:
        raise CaseError(
            f"{missing}: linear theory of an OWC needs a device in waves with a damping, over a flat bed"
        )
    device = case.device
    geometry = ChamberGeometry(case.tank.depth, device.chamber_length, device.draught, device.wall_thickness)
    water = radiation_and_scattering(geometry, 2.0 * np.pi / case.waves.T, case.g)
    return linear_response(water, case.waves.H, case.pto.K_dm, case.fluid.rho0)


def linear_check(case: Case) -> list[tuple[str, str]]:
    """What linear theory expects of a case: labels and values, for people; empty where it says nothing."""
    if _missing(case) is not None:
        return []
    found = linear_owc(case)
    best = f"at most {found.eta_max:.3g}, at K_dm = {found.K_dm_best:.4g}"
    return [
        ("linear efficiency", f"{found.xi:.3g} ({best})"),
        ("linear pressure", f"{abs(found.P_a):.4g} Pa amplitude, {found.P_a_peak:.4g} Pa at its peaks"),
        ("linear chamber level", f"{abs(found.level):.3g} m amplitude"),
    ]


def _missing(case: Case) -> str | None:
    if case.device is None:
        return "device is not given"
    if case.waves is None:
        return "waves is not given"
    if case.pto is None or case.pto.K_dm is None:
        return "pto.K_dm is not given"
    if case.pto.phase is not None:
        return "pto.phase lets the damping vary over the wave"
    if case.g == 0.0:
        return "g = 0"
    if case.device.platform_height:
        return f"device.platform_height = {case.device.platform_height:g} m"
    return None
