"""Run-up of non-breaking waves on a slope of 1:2, and their reflection, against linear long-wave theory.

The foot of the plane slope is at a distance x0 from the still shoreline. Linear long-wave theory gives
R/H = (J0(2 k x0)^2 + J1(2 k x0)^2)^(-1/2), with H the height of the incident waves and k = omega/sqrt(g d)
(Keller and Keller 1964); the waves are reflected completely. R is the amplitude of the first harmonic of the
level on the slope: such long waves also have a second harmonic, which raises their crests.
"""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from scipy.special import j0, j1

import jaxsph as js
from experiments.common import BUDGET, Report, of_paddle, solved
from jaxsph.output.plot.style import BLUE, in_style

DEPTH, SLOPE, FOOT, T = 0.3, 0.5, 5.0, 2.5
"""Depth of the water (m), slope (-), position of the slope's foot (m) and wave period (s)."""


def slope_case(dx: float, H: float) -> js.Case:
    """Case of waves of height H (m) on the slope, which rises 0.2 m above the still water level."""
    top = DEPTH + 0.2
    end = FOOT + top / SLOPE
    return js.Case.from_dict(
        {
            "name": "run_up",
            "dx": dx,
            "t1": 30.0,
            "scheme": {"kind": "incompressible"},
            "tank": {"length": end + 0.2, "depth": DEPTH},
            "waves": {"H": H, "T": T},
            "solid": {"slope": {"polygon": [(FOOT, 0.0), (end, top), (end + 0.2, top), (end + 0.2, 0.0)]}},
            "probes": {"gauges": [0.8, 1.4, 2.2, 3.2], "run_up": ["slope"]},
            "output": {"sample_dt": 0.02, "periods": 5},
        }
    )


def main(dx: float = 0.02, H: float = 0.04) -> None:
    """Runs or continues waves of height H (m) at the spacing dx (m)."""
    case = slope_case(dx, H)
    file = solved(case, f"run_up_{dx:g}_{H:g}")
    results, series = file.results(), file.series()
    z = 2.0 * (2.0 * np.pi / T) / np.sqrt(case.g * DEPTH) * DEPTH / SLOPE
    theory = float((j0(z) ** 2 + j1(z) ** 2) ** -0.5)
    with Report(f"run_up_{dx:g}_{H:g}", "Run-up of non-breaking waves on a slope of 1:2", dx) as report:
        still = float(np.mean(series["run_up_slope"][series["time"] < 1.0]))
        height = results["incident_height"]
        first, second = (_harmonic(series, results["periods"], k) / height for k in (1, 2))
        off = 100.0 * (first / theory - 1.0)
        report.row("first harmonic of the level on the slope over the incident height", first, theory=theory)
        report.row("the same: deviation from theory", off, "%", bar="10 %", passes=abs(off) < 10.0)
        report.row("second harmonic over the incident height", second)
        report.row("highest level over the incident height", (results["run_up_slope"] - still) / height)
        back = results["reflection"]
        report.row("reflection", back, theory=1.0, bar="10 %", passes=abs(back - 1.0) < 0.1)
        report.row("incident height", results["incident_height"], "m", theory=H)
        report.row("level on the slope before the waves arrive", 1e3 * still, "mm", theory=0.0)
        for energy in ("hyperviscosity", "projection", "residual"):
            share = of_paddle(results, energy, "whole_")
            report.row(f"{BUDGET[energy]}, over the paddle's work, whole run", share, "%", theory=0.0)
        report.picture(_levels(series, still))


def _harmonic(series: dict[str, np.ndarray], periods: float, k: int) -> float:
    """Amplitude (m) of the k-th harmonic of the level on the slope over the last periods."""
    over = series["time"] > series["time"][-1] - periods * T + 1e-9
    level, t = series["run_up_slope"][over], series["time"][over]
    return 2.0 * float(abs(np.mean((level - np.mean(level)) * np.exp(-2j * np.pi * k / T * t))))


@in_style
def _levels(series: dict[str, np.ndarray], still: float) -> Figure:
    """Figure of the level on the slope over time."""
    figure = Figure(figsize=(9.0, 3.0), layout="constrained")
    ax = figure.subplots()
    ax.plot(series["time"], series["run_up_slope"] - still, color=BLUE)
    ax.set_xlabel("time (s)")
    ax.set_ylabel("level on the slope (m)")
    return figure
