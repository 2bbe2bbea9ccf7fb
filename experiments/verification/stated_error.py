"""How often the stated error of the spacing covers a finer run: OWCs over damping, period and height."""

from __future__ import annotations

import itertools

import jaxsph as js
from experiments.common import RUNS, Report, solved
from experiments.owc_tank import study_case

DX, FINEST = 0.04, 0.01
"""Spacing of the cases (their errors are stated from runs at 0.04 and 0.02 m), and of the finer runs, m."""
DAMPINGS, PERIODS, HEIGHTS = (250.0, 1000.0), (1.2, 1.4, 1.6), (0.06, 0.08)
"""Values of K_dm (kg^0.5 m^-2.5), T (s) and H (m)."""
ON_THE_LATTICE = {
    "tank.depth": 0.44,
    "device.chamber_length": 0.24,
    "device.wall_thickness": 0.04,
    "device.draught": 0.16,
}
"""Lengths that are whole spacings of all runs, so that the geometry is the same in all of them."""
BAR = 10
"""Least number of cases in which the stated error covers the finer run."""


def main(t1: float = 14.0, cases: int = 12) -> None:
    """Runs the first `cases` of twelve cases, each four times to state the error and once more finely."""
    with Report("stated_error", "The stated error of the spacing against finer runs, OWC", FINEST) as report:
        covered = 0
        chosen = list(itertools.product(DAMPINGS, PERIODS, HEIGHTS))[:cases]
        for K_dm, T, H in chosen:
            changes = ON_THE_LATTICE | {"pto.K_dm": K_dm, "waves.T": T, "waves.H": H}
            case, name = study_case(DX, t1).replace(changes), f"stated_error_{K_dm:g}_{T:g}_{H:g}"
            RUNS.mkdir(exist_ok=True)
            told = js.with_error(case, RUNS / f"{name}.h5")["xi"]
            finer = solved(case.replace({"dx": FINEST}), f"{name}_finest").results()["xi"]
            covers = abs(finer - told.value) <= told.error
            covered += covers
            label = f"K_dm = {K_dm:g}, T = {T:g} s, H = {H:g} m"
            report.row(f"{label}: xi at 0.04 m, mean of three", told.coarse)
            report.row(f"{label}: xi at 0.02 m", told.fine)
            report.row(f"{label}: xi, limit", told.value)
            report.row(f"{label}: stated error", told.error)
            report.row(f"{label}: xi at {FINEST:g} m", finer, passes=bool(covers))
        enough = covered >= BAR * len(chosen) / 12
        report.row(
            "cases in which the error covers the finer run", covered, bar=f"{BAR} of 12", passes=enough
        )
