"""Slope dP/dK_dm of the mean power in an irregular sea: from an ensemble, against a fit to other runs."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import RUNS, Report
from experiments.studies.annual_power import study_case

K_DM = 300.0
"""K_dm (kg^0.5 m^-2.5) at which the slope is computed: below the best, where the mean power increases with
K_dm."""
OTHERS = np.round(np.geomspace(100.0, 900.0, 7), 1)
"""Values of K_dm (kg^0.5 m^-2.5) of the runs for the fit; only 300 is also a value of the ensemble."""
DURATION = 28.0
"""Repeat period of the sea, s: twenty waves."""


def main(dx: float = 0.02, members: int = 5, workers: int = 1) -> None:
    """Runs the ensemble and the runs for the fit; finished runs are read from their files."""
    case = study_case(dx).replace(
        {"name": "sea_slope", "waves.duration": DURATION, "t1": 40.0, "pto.K_dm": K_DM}
    )
    way = js.Ensemble(members=members, out=RUNS / f"sea_slope_{dx:g}.h5", workers=workers)
    found = js.derivative(case, "pto.K_dm", "P_owc", way)
    others = RUNS / f"sea_slope_{dx:g}_fit.h5"
    runs = js.sweep(case, {"pto.K_dm": list(OTHERS)}, others, workers=workers)
    y, x = runs["P_owc"], np.log(OTHERS / K_DM)
    fit, covariance = np.polyfit(x, y, 3, cov=True)
    slope, error = fit[2] / K_DM, float(np.sqrt(covariance[2, 2])) / K_DM
    with Report(
        f"sea_slope_{dx:g}", "Slope of the mean power with respect to K_dm in an irregular sea", dx
    ) as report:
        report.row("mean power", found.value, "W/m", theory=js.linear_sea(case).P_owc)
        report.row("1e4 times the slope of a cubic in ln K_dm through seven runs", 1e4 * slope)
        report.row("1e4 times the standard error of the cubic's slope", 1e4 * error)
        report.row("1e4 times the slope by linear theory", 1e4 * _linear_slope(case))
        apart = abs(found.slope - slope) / np.hypot(found.error, error)
        report.row(
            "1e4 times the ensemble's slope",
            1e4 * found.slope,
            bar="within two standard errors of the fit, same sign",
            passes=bool(apart < 2.0 and found.slope * slope > 0.0),
        )
        report.row("1e4 times the standard error of the ensemble's slope", 1e4 * found.error)
        report.row("difference of the two slopes over their combined standard error", apart)
        report.picture(_picture(found, (OTHERS, y, fit)))


def _linear_slope(case: js.Case) -> float:
    low, high = (js.linear_sea(case.replace({"pto.K_dm": K_DM * f})).P_owc for f in (0.99, 1.01))
    return (high - low) / (0.02 * K_DM)


def _picture(found: js.Derivative, fitted: tuple[np.ndarray, np.ndarray, np.ndarray]) -> Figure:
    K, y, fit = fitted
    figure = Figure(figsize=(8, 4.5), layout="constrained")
    ax = figure.subplots()
    fine = np.geomspace(K[0], K[-1], 200)
    ax.plot(K, y, "ko", label="runs of the fit")
    ax.plot(fine, np.polyval(fit, np.log(fine / K_DM)), "k-", lw=0.8, label="cubic in ln K_dm")
    ax.plot(found.members["pto.K_dm"], found.members["P_owc"], "C1o", label="ensemble")
    beside = K_DM * np.array([0.7, 1.3])
    ax.plot(beside, found.value + found.slope * (beside - K_DM), "C1-", label="its slope")
    ax.set(xscale="log", xlabel="K_dm", ylabel="mean power, W/m")
    ax.legend()
    return figure
