"""What the draught, which the paper's text does not give, changes: efficiency over it and the period."""

from __future__ import annotations

import numpy as np
import typer
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import Report
from experiments.studies import study_case, swept

DRAUGHTS = (0.12, 0.16, 0.20)
PERIODS = (1.0, 1.2, 1.4)


def main(dx: float = 0.02) -> None:
    """Runs or goes on with the nine members at the spacing dx."""
    case = study_case(dx, 12.0)
    over = {"device.draught": list(DRAUGHTS), "waves.T": list(PERIODS)}
    study = swept(case, over, f"draught_study_{dx:g}")
    xi = study["xi"]
    theory = np.array(
        [
            [js.linear_owc(case.replace({"device.draught": a, "waves.T": T})).xi for T in PERIODS]
            for a in DRAUGHTS
        ]
    )
    title = "Efficiency over draught and period: what the geometry's assumption changes"
    with Report(f"draught_study_{dx:g}", title, dx) as report:
        report.seconds = float(np.nansum(study["wall_seconds"]))
        report.row("runs that failed", len(study.failures), theory=0.0, bar="none", passes=not study.failures)
        for i, a in enumerate(DRAUGHTS):
            best, best_linear = PERIODS[int(np.nanargmax(xi[i]))], PERIODS[int(np.argmax(theory[i]))]
            report.row(f"draught {a:g} m: period of the largest xi", best, "s", theory=best_linear)
        for j, T in enumerate(PERIODS):
            change, expected = xi[-1, j] - xi[0, j], theory[-1, j] - theory[0, j]
            report.row(f"T = {T:g} s: change of xi from 0.12 to 0.20 m", change, theory=expected)
        report.table(
            {
                "draught_m": np.repeat(DRAUGHTS, len(PERIODS)),
                "T_s": np.tile(PERIODS, len(DRAUGHTS)),
                "xi": xi.ravel(),
                "xi_scatter": study["xi_scatter"].ravel(),
                "xi_linear": theory.ravel(),
            }
        )
        report.picture(_picture(xi, theory))


def _picture(xi: np.ndarray, theory: np.ndarray) -> Figure:
    figure = Figure(figsize=(8, 4.5), layout="constrained")
    axis = figure.subplots()
    for i, a in enumerate(DRAUGHTS):
        axis.plot(PERIODS, xi[i], "o-", color=f"C{i}", label=f"draught {a:g} m")
        axis.plot(PERIODS, theory[i], "--", color=f"C{i}", lw=1)
    axis.set(xlabel="T, s", ylabel="efficiency xi", ylim=(0, None), title="SPH; linear theory dashed")
    axis.legend()
    return figure


if __name__ == "__main__":
    typer.run(main)
