"""Bottom-hinged flap in regular waves, 2-D and incompressible: absorbed power against damping.

The geometry follows the 1:25 model of Henry et al. 2014 and Wei et al. 2015 as far as it is known, on a flat
bed; `jaxsph/cases/flap_2d.toml` states the assumptions. No measured response is available.
"""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import Report, solved

DAMPINGS = (3.0, 8.0, 20.0, 50.0, 125.0)
"""Damping coefficients, N m s/rad per metre of width."""


def main(dx: float = 0.03) -> None:
    """Runs the built-in flap at five dampings."""
    base = js.load_case("flap_2d").replace({"dx": dx})
    with Report(f"flap_2d_{dx:g}", "Bottom-hinged flap in waves, incompressible, 2-D", dx) as report:
        xi, swing, missing, lost, seconds = [], [], [], [], 0.0
        for damping in DAMPINGS:
            case = base.replace({"body.pto.damping": damping})
            file = solved(case, f"flap_{dx:g}_{damping:g}")
            results, series = file.results(), file.series()
            last = series["time"] > series["time"][-1] - results["periods"] * case.waves.T
            xi.append(results["xi"])
            swing.append(0.5 * np.degrees(np.ptp(series["pitch"][last])))
            missing.append(results["energy_residual_share"])
            lost.append(results["energy_projection"] / results["energy_paddle"])
            seconds += results["wall_seconds"]
            report.row(f"damping {damping:g} N m s/rad/m: absorbed over incident power", xi[-1])
            report.row("the same: amplitude of the pitch", float(swing[-1]), "degrees")
        report.seconds = seconds
        best = int(np.argmax(xi))
        inside = 0 < best < len(xi) - 1
        report.row(
            "damping at which the absorbed power is largest",
            DAMPINGS[best],
            "N m s/rad/m",
            bar="inside the range",
            passes=inside,
        )
        worst = float(np.max(np.abs(missing)))
        report.row(
            "largest energy not accounted for, over the paddle's work",
            100 * worst,
            "%",
            bar="within 2 %",
            passes=worst < 0.02,
        )
        report.row(
            "energy lost in the projection, over the paddle's work, with the smallest and largest damping",
            " and ".join(f"{100 * share:.0f} %" for share in (lost[0], lost[-1])),
        )
        figure = Figure(figsize=(9, 3.6), layout="constrained")
        left, right = figure.subplots(1, 2)
        left.semilogx(DAMPINGS, xi, "o-")
        left.set(xlabel="damping, N m s/rad per metre", ylabel="absorbed over incident power")
        right.semilogx(DAMPINGS, swing, "o-")
        right.set(xlabel="damping, N m s/rad per metre", ylabel="amplitude of the pitch, degrees")
        report.picture(figure)
