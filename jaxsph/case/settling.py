"""Time in which waves settle in a tank, and the periods after it, over which results are averaged."""

from __future__ import annotations

import numpy as np

from jaxsph.case.geometry import Geometry
from jaxsph.case.sections import Sections
from jaxsph.waves import theory


def settling_time(case: Sections) -> float:
    """Time for the waves' ramp and for their energy to reach the far end of the tank, s."""
    omega = 2 * np.pi / case.waves.period
    geometry = Geometry.of(case)
    speed = float(theory.group_velocity(omega, geometry.depth, case.g))
    return case.waves.ramp_periods * case.waves.period + geometry.length / speed


def settled_periods(case: Sections, t1: float) -> int:
    """Whole periods at the end of a run to t1 (s) over which its results are averaged; below 1: none.

    Periods of regular waves, groups of two waves, and peak periods of a sea, of which all count.
    """
    waves = case.waves
    whole = int((t1 - settling_time(case)) / waves.cycle + 1e-6)
    return min(whole, case.output.periods if waves.repeats is None else round(waves.repeats / waves.cycle))
