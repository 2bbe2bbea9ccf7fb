"""Bottom-hinged flap in regular waves, 3-D and incompressible, in a tank of reduced width and length.

`jaxsph/cases/flap_3d.toml` states the assumptions on the depth, the mass of the flap and the tank. The
experiment of the source (Yeylaghi et al. 2016, section 4.3), where the flap swings about 30 degrees to either
side, used another tank and another water level, so its results are not compared here.
"""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import BUDGET, Report, of_paddle, solved
from jaxsph.analysis import fundamental, whole_periods


def main(dx: float = 0.04) -> None:
    """Runs the built-in flap."""
    case = js.load_case("flap_3d").replace({"dx": dx})
    file = solved(case, f"flap_3d_{dx:g}")
    series, results, T = file.series(), file.results(), case.waves.T
    t = series["time"]
    last = whole_periods(t, T, int(results["periods"]))
    pitch, eta = (
        fundamental(t[last], a[last], T) for a in (series["pitch"], series["eta_interpolated"][:, 0])
    )
    with Report(f"flap_3d_{dx:g}", "Bottom-hinged flap in waves, incompressible, 3-D", dx) as report:
        report.seconds = results["wall_seconds"]
        report.row("amplitude of the pitch", float(np.degrees(abs(pitch))), "degrees")
        report.row("mean pitch", float(np.degrees(np.mean(series["pitch"][last]))), "degrees")
        lag = float(np.degrees(np.angle(eta / pitch)))
        report.row("lag of the pitch behind the elevation beside the flap", lag, "degrees")
        report.row("wave height beside the flap", 2 * abs(eta), "m", theory=case.waves.H)
        both = series["eta_wire"][last, 0] - series["eta_interpolated"][last, 0]
        report.row(
            "RMS difference between the elevations by wire and by density, over dx",
            float(np.sqrt(np.mean(both**2))) / dx,
        )
        front, behind = (
            2 * abs(fundamental(t[last], series["body_pressure"][last, k], T)) / (1000 * 9.81 * case.waves.H)
            for k in (0, 1)
        )
        report.row("range of the pressure in front of the flap over rho g H", front)
        report.row("range of the pressure behind the flap over rho g H", behind)
        report.row("reflection", results["reflection"])
        share = results["energy_residual_share"]
        report.row(
            "energy not accounted for, over the paddle's work",
            100 * share,
            "%",
            bar="within 2 %",
            passes=abs(share) < 0.02,
        )
        for name in ("projection", "hyperviscosity"):
            report.row(f"{BUDGET[name]}, over the paddle's work", of_paddle(results, name), "%", theory=0.0)
        figure = Figure(figsize=(9, 4.6), layout="constrained")
        upper, lower = figure.subplots(2, 1, sharex=True)
        upper.plot(t, np.degrees(series["pitch"]))
        upper.set(ylabel="pitch, degrees")
        for name, label in (("eta_wire", "by a wire"), ("eta_interpolated", "by density")):
            lower.plot(t, series[name][:, 0], lw=1, label=label)
        lower.set(xlabel="t, s", ylabel="elevation beside the flap, m")
        lower.legend(fontsize="small", ncols=2)
        report.picture(figure)
