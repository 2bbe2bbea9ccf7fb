"""Slopes of the OWC's efficiency over two lengths: a fast model as control variate, against fits to runs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.polynomial import Polynomial

import jaxsph as js
from experiments.common import RUNS, Report
from experiments.owc_tank import study_case

LENGTHS = {"device.draught": 0.48, "device.chamber_length": 0.48}
"""Lengths of the device, and the largest relative change of each in its thirteen runs (-)."""
NARROW = 0.3
"""Largest relative change in the narrow ensemble, the default of `js.Ensemble` (-)."""
MEMBERS = 13
TIMES = 3.0
"""Ratio of the ensemble's error to that of the control variate which is aimed at (-)."""


class _Fit(NamedTuple):
    """Slope at the case's value (1/m), its standard error, and the polynomial over the relative change."""

    slope: float
    error: float
    curve: Polynomial


def main(dx: float = 0.0125) -> None:
    """Calibrates the model and runs the ensembles, or continues, and compares the slopes."""
    RUNS.mkdir(exist_ok=True)
    case = study_case(dx)
    file = RUNS / f"fast_slopes_{dx:g}.json"
    model = js.calibrate(case, file)
    figure = Figure(figsize=(9, 3.6), layout="constrained")
    with Report(f"fast_slopes_{dx:g}", "Slopes over lengths of the OWC by a control variate", dx) as report:
        for axis, (length, spread) in zip(figure.subplots(1, 2, sharey=True), LENGTHS.items(), strict=True):
            runs = js.Ensemble(spread, MEMBERS, RUNS / f"fast_slopes_{dx:g}_{length}.h5")
            found = js.derivative(case, length, "xi", js.Calibrated(runs, file))
            _compare(report, model, found, axis)
        report.picture(figure)


def _compare(report: Report, model: js.FastModel, found: js.Derivative, axis: Axes) -> None:
    """Rows and picture of the slopes over one length."""
    length = found.parameter
    here, xi = found.members[length], found.members["xi"]
    usual = float(model.case.built(length))
    x = here / usual - 1.0
    report.row(f"{length}: runs", len(here))
    report.row(f"{length}: slope by the control variate", found.slope, "1/m")
    report.row(f"{length}: its standard error", float(found.error or 0.0), "1/m")
    narrow = np.abs(x) < NARROW + 1e-6
    fits = {
        "parabola, runs within 30 %": _fitted(x[narrow], xi[narrow], 2, usual),
        "parabola": _fitted(x, xi, 2, usual),
        "cubic": _fitted(x, xi, 3, usual),
        "polynomial of degree five": _fitted(x, xi, 5, usual),
    }
    for name, fit in fits.items():
        report.row(f"{length}: slope of a {name}", fit.slope, "1/m")
        report.row(f"{length}: standard error of a {name}", fit.error, "1/m")
    best = fits["polynomial of degree five"]
    apart = abs(found.slope - best.slope) / float(np.hypot(found.error or 0.0, best.error))
    report.row(
        f"{length}: difference from the polynomial of degree five, in standard errors",
        apart,
        bar="at most 2",
        passes=apart <= 2.0,
    )
    for name in ("parabola, runs within 30 %", "cubic", "polynomial of degree five"):
        ratio = fits[name].error / float(found.error or np.nan)
        report.row(
            f"{length}: error of a {name} over that of the control variate",
            ratio,
            bar=f"at least {TIMES:g}",
            passes=ratio >= TIMES,
        )
    _draw(axis, model, found, fits, x)


def _fitted(x: np.ndarray, y: np.ndarray, degree: int, usual: float) -> _Fit:
    """Least-squares polynomial through results over the relative change of a length."""
    found, covariance = np.polyfit(x, y, degree, cov=True)
    slope, error = float(found[-2]), float(np.sqrt(covariance[-2, -2]))
    return _Fit(slope / usual, error / usual, Polynomial(found[::-1]))


def _draw(
    axis: Axes, model: js.FastModel, found: js.Derivative, fits: dict[str, _Fit], x: np.ndarray
) -> None:
    """Efficiency over a length in the runs, by the fast model, and the fitted polynomials."""
    length, here = found.parameter, found.members[found.parameter]
    usual = here[np.argmin(np.abs(x))]
    every = [float(model.moved(model.case.replace({length: float(a)})).results()["xi"]) for a in here]
    axis.plot(here, found.members["xi"], "ko", ms=4, label="runs")
    axis.plot(here, every, color="tab:blue", label="fast model")
    fine = np.linspace(x.min(), x.max(), 100)
    for (name, fit), style in zip(fits.items(), (":", "--", "-.", "-"), strict=True):
        if "30 %" not in name:
            axis.plot(usual * (1.0 + fine), fit.curve(fine), style, color="0.5", lw=0.8, label=name)
    near = np.array([-0.15, 0.15]) * usual
    axis.plot(usual + near, found.value + found.slope * near, color="tab:red", lw=2, label="control variate")
    axis.set(xlabel=f"{length}, m", ylabel="efficiency xi")
    axis.legend(fontsize="x-small")
