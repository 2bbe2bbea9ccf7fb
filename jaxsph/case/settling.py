"""Time until the waves in a tank have settled, and the later periods over which results are averaged."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from jaxsph import analysis
from jaxsph.case.geometry import Geometry
from jaxsph.case.sections import Sections
from jaxsph.case.wave_section import AbstractWavesSection
from jaxsph.problem.record import Window
from jaxsph.waves import theory

FEW = 5
"""Number of averaged periods below which a longer run is advised."""


def given_waves(case: Sections) -> AbstractWavesSection:
    """Waves of a case; the case must have waves."""
    assert case.waves is not None, "only waves settle"
    return case.waves


def settling_time(case: Sections) -> float:
    """Duration of the waves' ramp, plus the travel time of their energy to the far end of the tank, s."""
    waves = given_waves(case)
    return waves.ramp_periods * waves.period + travel_time(case, Geometry.of(case).length)


def travel_time(case: Sections, x: float) -> float:
    """Travel time of the waves' energy from the paddle to x (m), s."""
    waves = given_waves(case)
    speed = float(theory.group_velocity(2 * np.pi / waves.period, Geometry.of(case).depth, case.g))
    return x / (speed * float(np.cos(waves.direction)))


def too_few(periods: float) -> bool:
    """Whether a longer run is advised, because so few periods are averaged."""
    return periods < FEW


def averages_from(case: Sections, since: float = 0.0) -> float:
    """Time (s) from which periods may be averaged, if the case was last changed at the time `since` (s)."""
    if since > 0.0:
        return max(settling_time(case), since + travel_time(case, Geometry.of(case).length))
    return settling_time(case)


def most_periods(case: Sections) -> int:
    """Largest number of periods that are averaged: `output.periods`, or those of one repetition of a sea."""
    waves = given_waves(case)
    return case.output.periods if waves.repeats is None else round(waves.repeats / waves.cycle)


def settled_periods(case: Sections, t1: float, since: float = 0.0) -> int:
    """Number of whole periods at the end of a run to t1 (s) that may be averaged; 0 or less if none may.

    The periods begin when the waves' energy has reached the far end of the tank. A period is a wave
    period of regular waves, a group of bichromatic waves, or a peak period of a sea; at most one repetition
    of a sea is averaged. `since`: time (s) of the run's last change, after which the energy has to reach the
    far end again. `settled_window` finds which of these periods have settled.
    """
    whole = int((t1 - averages_from(case, since)) / given_waves(case).cycle + 1e-6)
    return min(whole, most_periods(case))


def run_until(case: Sections, begin: float, periods: int) -> float:
    """Value of t1 (s) with which `periods` periods after `begin` (s) are averaged, rounded up to 4 digits."""
    end = begin + periods * given_waves(case).cycle + case.output.sample_dt
    unit = 10.0 ** (np.floor(np.log10(end)) - 3.0)
    return float(f"{np.ceil(end / unit) * unit:.4g}")


def settled_window(
    case: Sections, t: NDArray[np.float64], settling: Iterable[NDArray[np.floating]], since: float = 0.0
) -> Window:
    """Window of settled whole periods at the end of a record, found by `analysis.settled_from`.

    **Arguments**: times `t` (s); `settling`: series that must all have settled; their values are means
    since the previous sample; `since`: time (s) before which the record is ignored.

    A sea is averaged over one repetition, because its periods differ and cannot be compared. A
    focused group has no mean power, so its window is the whole record.
    """
    # a sample is the mean over the interval before it, and `since` is the time of a sample
    counts = t >= since - 1e-9
    if case.waves is None or case.waves.kind == "focused":
        return Window(counts, 0, 0)
    whole, left_out = settled_periods(case, float(t[-1]), since), 0
    if whole < 1:
        return Window(counts, 0, 0)
    if case.waves.repeats is None:
        cycle = case.waves.cycle
        starts = [analysis.settled_from(analysis.per_period(t, y, cycle, whole)) for y in settling]
        left_out = max(starts, default=0)
    periods = whole - left_out
    return Window(analysis.whole_periods(t, case.waves.cycle, periods), periods, left_out)
