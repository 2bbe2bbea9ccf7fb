"""Notices before a run about the averages and the reflection coefficient that it will give."""

from __future__ import annotations

from jaxsph.case.results import echo_after, part_of_a_sea, why_no_reflection
from jaxsph.case.sections import Sections
from jaxsph.case.settling import (
    FEW,
    averages_from,
    given_waves,
    most_periods,
    run_until,
    settled_periods,
    too_few,
)


def forecasts(case: Sections) -> list[str]:
    """Notices before a run about its means over settled periods, and about the reflection coefficient."""
    if case.waves is None:
        return []
    notes = []
    if case.waves.kind != "focused":  # a focused group has no mean over periods
        notes += _settled(case)
        notes += part_of_a_sea(case, case.t1, settled_periods(case, case.t1))
    if why := why_no_reflection(case):
        notes.append(f"no result for the reflection: {why}")
    return notes


def _settled(case: Sections) -> list[str]:
    """Notice if t1 leaves too few settled periods, or is before the waves that a device reflects return."""
    waves, begin = given_waves(case), averages_from(case)
    periods = settled_periods(case, case.t1)
    asked, final = case.output.periods, _until_the_echo(case, periods)
    if not too_few(periods):
        if final is None:
            return []
        return [
            f"averaging starts at t = {case.t1 - periods * waves.cycle:.3g} s, before the waves that the "
            "device reflects return from the paddle: if they are more than a fifth as high as the incident "
            f"ones, raise t1 to {final:.4g} s for the final xi"
        ]
    left = max(int((case.t1 - begin) / waves.cycle + 1e-6), 0)
    what = "period" if waves.cycle == waves.period else "wave group"
    text = f"the waves settle at about t = {begin:.4g} s; t1 = {case.t1:g} s leaves "
    text += f"{left or 'no'} whole {what}{'' if left in (0, 1) else 's'}; use "
    ways, sea = [], waves.repeats is not None
    if too_few(left):
        until = run_until(case, begin, most_periods(case) if sea else FEW)
        ways.append(f"t1 = {until:g} s or more{', which averages over a whole repetition' if sea else ''}")
    if not sea and too_few(asked):
        ways.append(f"output.periods = {FEW} instead of {asked}")
    text += " and ".join(ways)
    if final is not None:
        text += f" (t1 = {final:.4g} s or more if the device reflects more than a fifth of the wave height)"
    return [text]


def _until_the_echo(case: Sections, periods: int) -> float | None:
    """Value of t1 (s) for means after the waves that the device reflects have returned to it; None if the
    means over the last `periods` periods are later, or if the case has no efficiency in regular waves."""
    if case.tank.width is not None or not (case.turbines or case.has_take_off):
        return None
    cycle = given_waves(case).cycle
    echo = echo_after(case, case.t1 - max(periods, 0) * cycle)
    return None if echo is None else echo + max(case.output.periods, FEW) * cycle
