"""Searches for the best damping, started far below and far above it, against a fit through thirteen runs."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import RUNS, Report
from experiments.owc_tank import study_case
from experiments.studies.filter_study import RANGE, fitted

STARTS = (150.0, 2400.0)
BOUNDS = (100.0, 2500.0)
METHOD = js.Ensemble(members=5)
"""Five runs per slope: two more than a parabola needs, to estimate the error."""


def main(dx: float = 0.02) -> None:
    """Runs both searches and the sweep of `filter_study`; finished runs are read from their files."""
    case = study_case(dx)
    study, fit = fitted(case)
    fine = np.geomspace(*RANGE, 500)
    best = float(fine[np.argmax(fit.value(fine))])
    highest = float(fit.value(best)[0])
    ways = {
        start: js.maximise(
            case.replace({"pto.K_dm": start}),
            {"pto.K_dm": BOUNDS},
            RUNS / f"best_damping_{dx:g}_{start:g}.h5",
            method=METHOD,
        )
        for start in STARTS
    }
    with Report(
        f"best_damping_{dx:g}", "Search for the best damping from below and from above", dx
    ) as report:
        # the searches do not store the times of their members: times of the sweep of the same case are used
        each = float(np.nanmedian(study["wall_seconds"]))
        report.seconds = each * METHOD.members * sum(len(way.history) for way in ways.values())
        report.row("best K_dm of the fitted sweep", best, "kg^0.5 m^-2.5")
        report.row("largest xi of the fitted sweep", highest)
        for start, way in ways.items():
            found = way.case.pto.K_dm
            there = float(fit.value(found)[0])
            report.row(f"from K_dm = {start:g}: best K_dm", found, "kg^0.5 m^-2.5", theory=best)
            report.row(
                f"from K_dm = {start:g}: fitted xi at the best K_dm of the search over the largest fitted xi",
                there / highest,
                bar="at least 0.95",
                passes=there >= 0.95 * highest,
            )
            count = len(way.history)
            report.row(f"from K_dm = {start:g}: evaluations", count, bar="at most 10", passes=count <= 10)
            report.row(f"from K_dm = {start:g}: reason for stopping", way.reason)
        figure = Figure(figsize=(6, 4), layout="constrained")
        axis = figure.subplots()
        axis.plot(fit.K, fit.xi, "k.", label="runs of the sweep")
        axis.plot(fine, fit.value(fine), "k-", lw=0.8)
        for colour, (start, way) in zip(("C0", "C1"), ways.items(), strict=True):
            at = np.array([one["pto.K_dm"] for one in way.history])
            xi = np.array([one["xi"] for one in way.history])
            axis.plot(at, xi, "o-", color=colour, ms=4, lw=0.8, label=f"from {start:g}")
        axis.set(xscale="log", xlabel="K_dm, kg^0.5 m^-2.5", ylabel="xi")
        axis.legend()
        report.picture(figure)
