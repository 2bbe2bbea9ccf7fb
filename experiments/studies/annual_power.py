"""Power matrix of the OWC in irregular seas and annual mean power, compared with linear theory."""

from __future__ import annotations

import numpy as np

import jaxsph as js
from experiments.common import RUNS, Report
from jaxsph.output.plot.matrix import draw_matrix

HS, TP = (0.03, 0.04, 0.05), (1.2, 1.4, 1.6)
SEEDS = 2
DURATION = 42.0
"""Repeat period of a sea, s: thirty waves of 1.4 s."""
SHARES = ((0.10, 0.08, 0.02), (0.15, 0.25, 0.10), (0.05, 0.15, 0.10))
"""Fraction of the year (-) with each sea state, in rows of Hs and columns of Tp; invented for this
experiment."""


def study_case(dx: float = 0.02) -> js.Case:
    """The built-in OWC in a sea of thirty waves, in a tank 4 m long whose first half is a relaxation zone."""
    return js.load_case("owc_irregular").replace(
        {
            "name": "annual_power",
            "dx": dx,
            "tank.length": 4.0,
            "waves.zone": 2.0,
            "waves.duration": DURATION,
            "t1": 54.0,
            "probes.gauges": [2.1, 2.3, 2.6, 3.0, 3.4],
            "output.snapshot_dt": 54.0,
        }
    )


def table() -> js.ScatterTable:
    """Scatter table of the seas of the matrix."""
    Hs, Tp = np.meshgrid(HS, TP, indexing="ij")
    return js.ScatterTable(Hs.ravel(), Tp.ravel(), np.ravel(SHARES))


def matrix(dx: float, workers: int) -> js.PowerMatrix:
    """Power matrix of the OWC; finished runs are read from their file."""
    path = RUNS / f"annual_power_{dx:g}.h5"
    return js.power_matrix(study_case(dx), HS, TP, path, seeds=SEEDS, workers=workers)


def main(dx: float = 0.02, workers: int = 1) -> None:
    """Runs every sea state with two seeds; finished runs are read from their files."""
    done = matrix(dx, workers)
    with Report(f"annual_power_{dx:g}", "Power matrix of the OWC in irregular seas", dx) as report:
        for i, H in enumerate(HS):
            for j, T in enumerate(TP):
                report.row(
                    f"mean power, Hs = {H:g} m, Tp = {T:g} s",
                    done.P[i, j],
                    "W/m",
                    theory=done.linear[i, j],
                )
        error = done.error / done.P
        report.row("smallest standard error of a cell", float(100.0 * error.min()), "%")
        report.row("largest standard error of a cell", float(100.0 * error.max()), "%")
        mean, linear = done.annual(table()), float(np.sum(np.array(SHARES) * done.linear))
        report.row("annual mean power", mean.value, "W/m", theory=linear)
        report.row("standard error of the annual mean power", mean.error, "W/m")
        report.picture(draw_matrix(done))
