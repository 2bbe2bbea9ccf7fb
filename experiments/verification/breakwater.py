"""Overtopping of a breakwater: volume behind the crest against volume that flowed over it; energy balance."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from scipy.integrate import cumulative_trapezoid

import jaxsph as js
from experiments.common import BUDGET, Report, of_paddle, solved
from jaxsph.output.plot.style import BLUE, RED, in_style


def main(dx: float = 0.02) -> None:
    """Runs or continues the built-in breakwater at the spacing dx (m)."""
    file = solved(js.load_case("breakwater").replace({"dx": dx}), f"breakwater_{dx:g}")
    series, results = file.series(), file.results()
    t, behind = series["time"], np.float64(series["overtopped_breakwater"])
    flow = np.float64(series["overtopping_breakwater"])
    passed = cumulative_trapezoid(flow, t, initial=0.0)
    with Report(f"breakwater_{dx:g}", "Waves that overtop a breakwater", dx) as report:
        ratio = behind[-1] / passed[-1]
        report.row(
            "volume of water behind the crest over the volume that flowed over the crest",
            ratio,
            theory=1.0,
            bar="2 %",
            passes=abs(ratio - 1.0) < 0.02,
        )
        report.row("mean overtopping discharge", 1e3 * results["overtopping_breakwater"], "l/s/m")
        report.row("run-up", results["run_up_breakwater"], "m")
        report.row("reflection", results["reflection"])
        off = of_paddle(results, "residual", "whole_")
        share = "energy not accounted for, over the paddle's work"
        report.row(share, off, "%", theory=0.0, bar="within 2 %", passes=abs(off) < 2.0)
        for energy in ("hyperviscosity", "projection"):
            what = f"{BUDGET[energy]}, over the paddle's work"
            report.row(what, of_paddle(results, energy, "whole_"), "%")
        report.picture(_volumes(t, behind, passed))


@in_style
def _volumes(t: np.ndarray, behind: np.ndarray, passed: np.ndarray) -> Figure:
    """Figure of the volume behind the crest and the volume that flowed over it."""
    figure = Figure(figsize=(9.0, 3.0), layout="constrained")
    ax = figure.subplots()
    ax.plot(t, behind, color=BLUE, label="behind the crest")
    ax.plot(t, passed, "--", color=RED, label="flowed over it")
    ax.set_xlabel("time (s)")
    ax.set_ylabel("volume (m$^2$)")
    ax.legend()
    return figure
