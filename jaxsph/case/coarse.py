"""`coarsen`: a case with larger particles and a shorter run, for a quick first look."""

from __future__ import annotations

import math

from jaxsph.case.case import Case
from jaxsph.case.settling import settling_time
from jaxsph.errors import CaseError

FACTORS = (2.0, 1.5, 1.25)
"""Factors by which the spacing is multiplied, tried in this order until the case passes its checks."""
PERIODS = 5
"""Number of settled wave periods to which a run is shortened."""
COARSE = "COARSE, for a first look: "
"""Beginning of a coarse case's description."""


def coarsen(case: Case) -> Case:
    """Makes a coarse case for a first look, with up to twice the spacing and up to five settled periods.

    The sampling interval grows by the same factor, so that the time step can grow with the spacing. The plate
    of a device is made at least as thick as the spacing. The name ends in `_quick`. The description begins
    with COARSE, because efficiencies and forces of such a run are rough and not suitable for design.
    **Raises** CaseError if the case does not pass its checks with any of the `FACTORS`.
    """
    if not isinstance(case, Case):
        raise CaseError(
            f"{case!r}: only a case can be made coarse; for a program, change its arguments instead"
        )
    refusal = ""
    for factor in FACTORS:
        try:
            return _shortened(_coarser(case, factor))
        except CaseError as error:
            refusal = refusal or str(error)
    *others, last = (f"{factor:g}" for factor in FACTORS)
    factors = f"{', '.join(others)} or {last}"
    raise CaseError(
        f"this case cannot be run with dx increased from {case.dx:g} m by a factor of {factors} ({refusal}): "
        "run the case unchanged, or with a smaller t1"
    )


def _coarser(case: Case, factor: float) -> Case:
    dx = round(factor * case.dx, 9)
    changes: dict[str, object] = {
        "name": f"{case.name[:90]}_quick",
        "description": COARSE + case.description,
        "dx": dx,
        "output.sample_dt": factor * case.output.sample_dt,
    }
    if case.device is not None:
        changes["device.wall_thickness"] = max(case.device.wall_thickness, dx)
    return case.replace(changes)


def _shortened(case: Case) -> Case:
    if case.waves is None:
        return case
    # One sampling interval is added, because the last sample precedes the end of the run. The time is rounded
    # up to whole snapshot intervals, because a part of an interval would be compiled separately.
    settled = settling_time(case) + PERIODS * case.waves.cycle + case.output.sample_dt
    whole = math.ceil(settled / case.output.snapshot_dt) * case.output.snapshot_dt
    return case.replace({"t1": min(case.t1, round(whole, 6))})
