"""Warnings about the results of a run or of the members of a sweep."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from jaxsph.case.settling import FEW, too_few

NOISY, UNBOOKED = 0.15, 0.03
"""Limits beyond which a result is doubtful: largest ratio of the particles' noise to their speed (-), and
largest residual of the energy budget relative to the paddle's work or, if that is larger, to the largest
kinetic energy (-)."""


class Doubt(NamedTuple):
    """Reason to doubt the results of a run."""

    text: str
    """The reason and what to do, for one run."""
    many: str
    """The reason and what to do, for several members of a sweep; their number precedes this text."""


def doubts(results: Mapping[str, float], waves: bool) -> list[Doubt]:
    """Reasons to doubt the results of a completed run; `waves`: whether its case has waves."""
    noise, residual = results.get("noise", 0.0), results.get("energy_residual_share", 0.0)
    periods = results.get("periods", FEW)
    rules = [
        (
            noise > NOISY,
            f"The particles are noisy: their velocities deviate from those of neighbours by {noise:.2g} of "
            f"their speed (limit: {NOISY:g}). Reduce dx, or colour the particles by noise to locate the "
            "cause.",
            f"have noisy particles (limit: {NOISY:g} of their speed): reduce dx.",
        ),
        (
            abs(residual) > UNBOOKED,
            f"The energy budget does not close: {100 * residual:+.1f} % of the paddle's work, or of the "
            f"largest kinetic energy if that is larger, is not accounted for (limit: {100 * UNBOOKED:g} %). "
            "Do not use the results, and report the case.",
            f"have an energy budget that does not close within {100 * UNBOOKED:g} %: do not use their "
            "results, and report the case.",
        ),
        (
            # of periods that were left out, a notice gives this advice
            0 < periods and too_few(periods) and not results.get("periods_left_out"),
            f"Results are averaged over {periods:.0f} period{'s' if periods > 1 else ''} only: raise t1, so "
            "that more settled periods can be averaged.",
            f"are averaged over fewer than {FEW} settled periods: raise t1.",
        ),
        (
            bool(results and waves) and not {"periods", "E_inc"} & set(results),
            "The run is too short for a mean over a settled wave period: raise t1.",
            "are too short for a mean over a settled wave period: raise t1.",
        ),
    ]
    return [Doubt(text, many) for holds, text, many in rules if holds]


def doubts_of_members(members: Sequence[Mapping[str, float]], waves: bool) -> list[str]:
    """Reasons to doubt members of a sweep, each with the number of members that it concerns."""
    found = [doubt.many for results in members for doubt in doubts(results, waves)]
    return [f"{found.count(many)} of {len(members)} members {many}" for many in dict.fromkeys(found)]
