"""How long an exact derivative describes the flow: growth of the slopes d/dK_dm in the OWC's chamber.

The built-in OWC is in a tank 1.2 m long, where the first waves reach the chamber within a period, at
dx = 0.02 m.
"""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import Report
from experiments.owc_tank import short_case


def main(dx: float = 0.02, t1: float = 4.0) -> None:
    """Runs the exact derivative to t1 (s) and reports how the differences between the slopes of neighbouring
    particles grow."""
    case = short_case(dx, t1).replace({"output.snapshot_dt": 0.1})
    found = js.derivative(case, "pto.K_dm", "energy_pto", js.Exact(least=0.0))
    t, grain = found.series["time"], found.slopes["grain"]
    reach = 0.1 * dx / np.maximum(grain, 1e-300) / case.pto.K_dm
    with Report(f"tangent_growth_{dx:g}", "Growth of an exact derivative with respect to K_dm", dx) as report:
        for share in (0.1, 0.01):
            lost = np.flatnonzero(reach < share)
            report.row(
                f"change of K_dm by {100 * share:g} %: time until the relative shift of neighbours is dx/10",
                t[lost[0]] if lost.size else t1,
                "s",
            )
        grown = (reach < 1.0) & (reach > 1e-6)
        rate = np.polyfit(t[grown], np.log(grain[grown]), 1)[0]
        report.row("e-folding time of the difference between neighbours' slopes", 1 / rate, "s")
        report.row("slope of the energy absorbed to t1", found.slope, "J/m per unit of K_dm")
        figure = Figure(figsize=(7, 4), layout="constrained")
        axis = figure.subplots()
        axis.semilogy(t, case.pto.K_dm * grain / dx)
        axis.axhspan(0.1, 10.0, color="0.9", label="1 to 100 % of K_dm move neighbours by dx/10")
        axis.set(xlabel="t, s", ylabel="K_dm d(place)/d(K_dm), neighbours' difference / dx")
        axis.legend()
        report.picture(figure)
