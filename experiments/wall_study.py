"""Section 5.1: efficiency over the waves' period for front walls of four thicknesses, 24 runs."""

from __future__ import annotations

import numpy as np
import typer
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import Report
from experiments.studies import study_case, swept

THICKNESS = (0.01, 0.02, 0.03, 0.04)
PERIODS = (0.8, 1.0, 1.2, 1.4, 1.6, 1.8)


def main(dx: float = 0.02) -> None:
    """Runs or goes on with the study at the spacing dx."""
    case = study_case(dx, 13.0)
    over = {"device.wall_thickness": list(THICKNESS), "waves.T": list(PERIODS)}
    study = swept(case, over, f"wall_study_{dx:g}")
    xi = study["xi"]
    theory = np.array(
        [
            [js.linear_owc(case.replace({"device.wall_thickness": k, "waves.T": T})).xi for T in PERIODS]
            for k in THICKNESS
        ]
    )
    title = "Efficiency over period and wall thickness (section 5.1), assumed draught of 0.16 m, no platform"
    with Report(f"wall_study_{dx:g}", title, dx) as report:
        report.seconds = float(np.nansum(study["wall_seconds"]))
        report.row("runs that failed", len(study.failures), theory=0.0, bar="none", passes=not study.failures)
        for i, k in enumerate(THICKNESS):
            best, best_linear = PERIODS[int(np.nanargmax(xi[i]))], PERIODS[int(np.argmax(theory[i]))]
            report.row(f"k_s = {k:g} m: largest xi", np.nanmax(xi[i]), theory=np.max(theory[i]))
            report.row(f"k_s = {k:g} m: at T", best, "s", theory=best_linear, paper=1.2)
        for j, T in enumerate(PERIODS):
            change, expected = xi[-1, j] - xi[0, j], theory[-1, j] - theory[0, j]
            name = f"T = {T:g} s: change of xi from k_s = 0.01 to 0.04 m"
            report.row(name, change, theory=expected, paper="below zero")
        mean = float(np.nanmean(xi[-1] - xi[0]))
        expected = float(np.mean(theory[-1] - theory[0]))
        bar = "below zero (paper)"
        report.row(
            "mean of these changes", mean, theory=expected, paper="below zero", bar=bar, passes=mean < 0
        )
        report.row("xi from period to period, median", np.nanmedian(study["xi_scatter"]))
        report.table(
            {
                "k_s_m": np.repeat(THICKNESS, len(PERIODS)),
                "T_s": np.tile(PERIODS, len(THICKNESS)),
                "xi": xi.ravel(),
                "xi_scatter": study["xi_scatter"].ravel(),
                "xi_linear": theory.ravel(),
                "incident_height_m": study["incident_height"].ravel(),
            }
        )
        report.picture(_picture(xi, theory))


def _picture(xi: np.ndarray, theory: np.ndarray) -> Figure:
    figure = Figure(figsize=(8, 4.5), layout="constrained")
    axis = figure.subplots()
    for i, k in enumerate(THICKNESS):
        axis.plot(PERIODS, xi[i], "o-", color=f"C{i}", label=f"k_s = {k:g} m")
        axis.plot(PERIODS, theory[i], "--", color=f"C{i}", lw=1)
    axis.set(xlabel="T, s", ylabel="efficiency xi", ylim=(0, None), title="SPH; linear theory dashed")
    axis.legend()
    return figure


if __name__ == "__main__":
    typer.run(main)
