"""Largest stable time step, for any scheme."""

from __future__ import annotations


def stable_dt(h: float, speed: float, nu: float, g: float, cfl: float) -> float:
    """Largest stable time step, s: the smallest of cfl h/speed, h^2/(8 nu) and sqrt(h/g)/4.

    The three limits are Eq. 10 to 12 of Zhu et al. (2020).

    **Arguments**: `h` (m): smoothing length, or for incompressible water the length `kernels.STEP_LENGTH` dx;
    `speed` (m/s): speed of sound of weakly compressible water, or the largest expected speed of
    incompressible water; kinematic viscosity `nu` (m2/s); gravity `g` (m/s2); Courant number `cfl` (-).
    """
    limits = [cfl * h / speed]
    if nu > 0:
        limits.append(0.125 * h * h / nu)
    if g > 0:
        limits.append(0.25 * (h / g) ** 0.5)
    return min(limits)
