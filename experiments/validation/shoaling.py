"""Waves that travel up a slope of 1:10 onto a shelf with a sponge: wave heights against linear shoaling.

The energy flux is the same at every depth, so that H/H0 = sqrt(c_g0/c_g). Wave heights are computed from the
variance of the elevation as for a sine wave.
"""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import BUDGET, Report, of_paddle, solved
from jaxsph.output.plot.style import BLUE, RED, in_style
from jaxsph.waves import theory

DEPTH, SHELF, FOOT, SLOPE = 0.4, 0.2, 3.0, 0.1
"""Depths in front of the slope and over the shelf, position of the slope's foot (m), and slope (-)."""
PLACES = (4.0, 5.2)
"""Positions where heights are compared, m: half-way up the slope, and on the shelf."""


def shelf_case(dx: float, H: float, T: float) -> js.Case:
    """Case of waves of height H (m) and period T (s) that travel onto the shelf."""
    top, end = DEPTH - SHELF, 9.0
    bed = [(FOOT, 0.0), (FOOT + top / SLOPE, top), (end, top), (end, 0.0)]
    return js.Case.from_dict(
        {
            "name": "shoaling",
            "dx": dx,
            "t1": 18.0,
            "scheme": {"kind": "incompressible"},
            "tank": {"length": end, "depth": DEPTH},
            "waves": {"H": H, "T": T},
            "sponge": {"length": 3.0},
            "solid": {"bed": {"polygon": bed}},
            "probes": {"gauges": [0.9, 1.3, 1.8, 2.4, *PLACES]},
            "output": {"sample_dt": 0.02, "periods": 5},
        }
    )


def main(dx: float = 0.02, H: float = 0.04, T: float = 1.2) -> None:
    """Runs or continues waves of height H (m) and period T (s) at the spacing dx (m)."""
    case = shelf_case(dx, H, T)
    file = solved(case, f"shoaling_{dx:g}_{H:g}")
    series, results = file.series(), file.results()
    over = series["time"] > series["time"][-1] - results["periods"] * T + 1e-9
    heights = 2.0 * np.sqrt(2.0) * np.std(np.float64(series["eta"][over]), axis=0)
    incident = results["incident_height"]
    with Report(f"shoaling_{dx:g}_{H:g}", "Shoaling of waves on a slope of 1:10", dx) as report:
        for x, height in zip(PLACES, heights[-len(PLACES) :], strict=True):
            depth = depth_at(x)
            expected = float(np.sqrt(_energy_speed(T, DEPTH, case.g) / _energy_speed(T, depth, case.g)))
            off = 100.0 * (height / incident / expected - 1.0)
            report.row(
                f"depth {depth:g} m: wave height over the incident height", height / incident, theory=expected
            )
            report.row(
                "the same: deviation from linear shoaling theory", off, "%", bar="3 %", passes=abs(off) < 3.0
            )
        report.row("incident height", incident, "m", theory=H)
        report.row("reflection", results["reflection"])
        report.row("periods averaged", results["periods"])
        for energy in ("hyperviscosity", "projection", "residual"):
            what = f"{BUDGET[energy]}, over the paddle's work"
            report.row(what, of_paddle(results, energy), "%", theory=0.0)
        report.picture(_heights(case, heights, incident, T))


def depth_at(x: float) -> float:
    """Depth (m) at the position x (m)."""
    return round(DEPTH - SLOPE * max(x - FOOT, 0.0) if x < FOOT + (DEPTH - SHELF) / SLOPE else SHELF, 6)


def _energy_speed(T: float, depth: float, g: float) -> float:
    """Power (W/m) of waves one metre high, which is proportional to their group velocity."""
    return float(theory.incident_power(1.0, T, depth, 1000.0, g))


@in_style
def _heights(case: js.Case, heights: np.ndarray, incident: float, T: float) -> Figure:
    """Figure of the heights along the tank and of linear shoaling."""
    figure = Figure(figsize=(9.0, 3.0), layout="constrained")
    ax = figure.subplots()
    x = np.linspace(0.5, 6.0, 56)
    speeds = np.array([_energy_speed(T, depth_at(float(a)), case.g) for a in x])
    ax.plot(x, incident * np.sqrt(_energy_speed(T, DEPTH, case.g) / speeds), "--", color=RED, label="linear")
    ax.plot(case.probes.gauges, heights, "o", color=BLUE, label="simulation")
    ax.set_xlabel("x (m)")
    ax.set_ylabel("wave height (m)")
    ax.legend()
    return figure
