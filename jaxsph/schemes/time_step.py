"""The largest stable time step of an explicit step, whatever the scheme."""

from __future__ import annotations


def stable_dt(h: float, speed: float, nu: float, g: float, cfl: float) -> float:
    """Largest stable time step, s: the least of cfl h/speed, an eighth of h^2/nu and a quarter of sqrt(h/g).

    These are Eq. 10 to 12 of Zhu et al. (2020).

    **Arguments**: smoothing length `h` (m); `speed` (m/s) of sound in weakly compressible water, or the
    largest of incompressible water; kinematic viscosity `nu` (m2/s), gravity `g` (m/s2).
    """
    limits = [cfl * h / speed]
    if nu > 0:
        limits.append(0.125 * h * h / nu)
    if g > 0:
        limits.append(0.25 * (h / g) ** 0.5)
    return min(limits)
