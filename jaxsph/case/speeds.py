"""Speeds to expect in a case, m/s: they set the numerical speed of sound, the time step and the search."""

from __future__ import annotations

import functools

import jax.numpy as jnp
import numpy as np

from jaxsph.case.sections import Sections
from jaxsph.case.shapes import corners_of
from jaxsph.waves import theory

LEAST = 1e-3
"""Least speed to expect, m/s: water without gravity rests, and its search divides by this."""


def wavenumber(T: float, d: float, g: float) -> float:
    """Wavenumber of linear waves of period `T` (s) on the depth `d` (m), rad/m, in JAX's precision."""
    return _wavenumber(T, d, g, jnp.result_type(float) == np.float64)


@functools.lru_cache(maxsize=64)
def _wavenumber(T: float, d: float, g: float, x64: bool) -> float:
    return float(theory.wavenumber(2.0 * np.pi / T, d, g))


def speed_scale(case: Sections) -> float:
    """Largest speed of the water that the case leads to expect, m/s; never zero."""
    return max(_speed_scale(case), LEAST)


def _speed_scale(case: Sections) -> float:
    shallow = float(np.sqrt(case.g * case.tank.depth))
    if case.tank.column is not None:
        return 2.0 * shallow  # the tip of a dam break in shallow water (Ritter 1892)
    if case.body is not None and any(case.body.velocity[:2]):
        # the jet of a wedge of 30 degrees: twice its spray root's speed, pi/2 V/tan(30 degrees)
        return 6.0 * float(np.hypot(*case.body.velocity[:2]))
    if case.start is not None:
        return 0.1 * shallow
    if case.waves is None:
        pressure = max([0.0, *map(abs, case.prescribed)])
        # a level suddenly pushed down by P_a/(rho g) swings with at most g A / omega ~ sqrt(P/rho)
        return 0.05 * shallow + 0.5 * float(np.sqrt(2.0 * pressure / case.fluid.rho0))
    depth, T = case.tank.depth, case.waves.period
    k = wavenumber(T, depth, case.g)
    height = case.waves.highest(depth, case.g)
    surface = height * np.pi / T / np.tanh(k * depth)
    speed = float(surface * (2.5 if case.device is not None or case.chambers else 1.5))
    if any(corners_of(solid)[:, -1].max() > depth - 2.0 * height for solid in case.solid.values()):
        # waves that break on a slope: 0.05 m high on 1:10 their tips reach 2.3 sqrt(g H)
        speed = max(speed, 2.5 * float(np.sqrt(case.g * height)))
    return speed


def search_speed(case: Sections) -> float:
    """Largest speed to expect (m/s), from which the steps between two searches follow.

    Their number is the length of a loop, which waves of another height should not change. Speeds of waves are
    therefore rounded to 0.13 sqrt(g d), or that times a whole power of sqrt(2): by at most a fifth of what is
    an estimate. A table that goes stale for it is noticed and searched more often.
    """
    speed = speed_scale(case)
    if case.waves is None:
        return speed
    least = 0.13 * float(np.sqrt(case.g * case.tank.depth))
    return least * 2.0 ** (0.5 * max(round(2.0 * float(np.log2(speed / least))), 0))


def reference_speed(case: Sections) -> float:
    """Larger of the speed to expect and the speed of shallow-water waves, m/s: the sound speed's scale."""
    return max(speed_scale(case), float(np.sqrt(case.g * case.tank.depth)))


def sound_speed(case: Sections) -> float:
    """Numerical speed of sound, m/s: ten times the largest speed to expect or the shallow-water wave's
    (Zhu et al. 2020, Eq. 2), unless the case gives its own."""
    return case.fluid.c0 if case.fluid.c0 is not None else 10.0 * reference_speed(case)


def projection_speed(case: Sections) -> float:
    """Largest speed that the incompressible scheme's time step allows for, m/s."""
    speed = getattr(case.scheme, "speed", None)
    if speed is not None:
        return speed
    if case.tank.column is not None:
        return 1.5 * speed_scale(case)  # the jet where the column's tip meets a wall
    # The projection holds whatever the speed of the waves, and their water is slower. With half of this floor
    # a standing wave's particles spread, and its potential energy rises by a half of the wave's.
    return max(speed_scale(case), 0.5 * float(np.sqrt(case.g * case.tank.depth)))
