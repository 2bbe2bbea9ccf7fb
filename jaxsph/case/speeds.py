"""Expected water speeds of a case, m/s, which determine sound speed, time step and neighbour-search
interval."""

from __future__ import annotations

import functools

import jax.numpy as jnp
import numpy as np

from jaxsph.case.body_sections import spatial
from jaxsph.case.sections import Sections
from jaxsph.waves import theory

LEAST = 1e-3
"""Lower bound of the expected speed, m/s. The interval between neighbour searches is inversely proportional
to the expected speed, which would be zero for water at rest without gravity."""


def wavenumber(T: float, d: float, g: float) -> float:
    """Wavenumber (rad/m) of linear waves of period `T` (s) in water of depth `d` (m), in JAX's precision."""
    return _wavenumber(T, d, g, jnp.result_type(float) == np.float64)


@functools.lru_cache(maxsize=64)
def _wavenumber(T: float, d: float, g: float, x64: bool) -> float:
    return float(theory.wavenumber(2.0 * np.pi / T, d, g))


def speed_scale(case: Sections) -> float:
    """Largest expected speed of the water in a case, m/s; never zero."""
    return max(_speed_scale(case), _driven_speed(case), LEAST)


def _driven_speed(case: Sections) -> float:
    """Largest expected speed of water near bodies with a prescribed motion, m/s: twice that of the bodies."""
    speeds = [0.0]
    for section in case.every_body.values():
        if section.motion is not None:
            corners = section.corners()[:, [0, -1]]
            pivot = corners.mean(axis=0) if section.pivot is None else (section.pivot[0], section.pivot[-1])
            arm = float(np.hypot(*(corners - pivot).T).max())
            speeds.append(2.0 * section.motion.top_speed(arm))
    return max(speeds)


def _speed_scale(case: Sections) -> float:
    shallow = float(np.sqrt(case.g * case.tank.depth))
    if case.tank.column is not None:
        return 2.0 * shallow  # the tip of a dam break in shallow water (Ritter 1892)
    velocities = (spatial(one.velocity)[:3] for one in case.every_body.values())
    falling = max((float(np.linalg.norm(one)) for one in velocities), default=0.0)
    if falling:
        # the spray root of a wedge of 30 degrees has the speed pi/2 V/tan(30 degrees),
        # and the jet is twice as fast
        return 6.0 * falling
    if case.start is not None:
        return 0.1 * shallow
    if case.waves is None:
        pressure = max([0.0, *map(abs, case.prescribed)])
        # a level suddenly pushed down by A = P/(rho g) oscillates at a speed of about sqrt(g A) = sqrt(P/rho)
        return 0.05 * shallow + 0.5 * float(np.sqrt(2.0 * pressure / case.fluid.rho0))
    depth, T = case.tank.depth, case.waves.period
    k = wavenumber(T, depth, case.g)
    height = case.waves.highest(depth, case.g)
    surface = height * np.pi / T / np.tanh(k * depth)
    speed = float(surface * (2.5 if case.device is not None or case.chambers else 1.5))
    if any(solid.corners()[:, -1].max() > depth - 2.0 * height for solid in case.solid.values()):
        # the tips of waves 0.05 m high that break on a slope of 1:10 reach 2.3 sqrt(g H)
        speed = max(speed, 2.5 * float(np.sqrt(case.g * height)))
    return speed


def search_speed(case: Sections) -> float:
    """Largest expected speed (m/s), from which the number of steps between two neighbour searches follows.

    The number of steps between searches is the length of a compiled loop, so it should not change with the
    wave height. In waves the speed is therefore rounded to 0.13 sqrt(g d) times a non-negative integer power
    of sqrt(2). Above 0.13 sqrt(g d) the rounding changes the estimate by at most a fifth. If a neighbour
    table becomes invalid too early, the run detects this and searches more often.
    """
    speed = speed_scale(case)
    if case.waves is None:
        return speed
    least = 0.13 * float(np.sqrt(case.g * case.tank.depth))
    return least * 2.0 ** (0.5 * max(round(2.0 * float(np.log2(speed / least))), 0))


def reference_speed(case: Sections) -> float:
    """Larger of the expected speed and the shallow-water wave speed, m/s; the scale of the sound speed."""
    return max(speed_scale(case), float(np.sqrt(case.g * case.tank.depth)))


def sound_speed(case: Sections) -> float:
    """Numerical speed of sound, m/s: `fluid.c0` if given, otherwise ten times the `reference_speed` (Zhu et
    al. 2020, Eq. 2)."""
    return case.fluid.c0 if case.fluid.c0 is not None else 10.0 * reference_speed(case)


def projection_speed(case: Sections) -> float:
    """Expected largest speed of the water, m/s, from which the incompressible scheme's time step follows."""
    speed = getattr(case.scheme, "speed", None)
    if speed is not None:
        return speed
    if case.tank.column is not None:
        return 1.5 * speed_scale(case)  # the jet where the column's tip meets a wall
    # The projection is stable at any wave speed, and the water is slower than the waves. With half of this
    # lower bound the particles of a standing wave spread, and the potential energy rises by half of the
    # wave's energy.
    return max(speed_scale(case), 0.5 * float(np.sqrt(case.g * case.tank.depth)))
