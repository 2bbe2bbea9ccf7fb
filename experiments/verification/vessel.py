"""Communicating vessels of the paper's section 4.2: an air pressure of 1000 Pa suddenly acts on one side."""

from __future__ import annotations

import numpy as np

import jaxsph as js
from experiments.common import Report, solved
from jaxsph import analysis

PERIOD = 1.427367
"""Period of the lowest antisymmetric mode (s) of two vessels 0.32 m wide and 0.56 m deep, which are joined
under a wall 0.01 m thick that reaches 0.33 m into the water. It was computed for inviscid linear waves by
mode matching and has converged to 1e-6."""
DIFFERENCE = 1000.0 / (1000.0 * 9.81)
"""Final difference of the levels P_a/(rho g), m."""


def main(dx: float = 0.01, t1: float = 60.0, weakly_compressible: bool = False) -> None:
    """Runs the vessels and reports the period, the final difference of the levels and its direction, the
    ratio of the energy not accounted for to the work of the air, and the change of the mean level."""
    case, name = js.load_case("vessel").replace({"dx": dx}), f"vessel_{dx:g}"
    if weakly_compressible:
        case, name = case.replace({"scheme.kind": "weakly_compressible"}), f"{name}_weakly_compressible"
    file = solved(case, name, t1)
    series = file.series()
    t, difference = series["time"], series["eta"][:, 0] - series["eta"][:, 1]
    late = t > 0.5  # in the first half second the sudden pressure causes sound waves in compressible water
    found = analysis.fit_damped_oscillation(t[late], difference[late])
    period = 2 * np.pi / found.omega
    # the mean over whole periods at the end does not depend on the envelope of the fit
    whole = analysis.whole_periods(t, period, max(1, int(0.4 * t[-1] / period)))
    level = float(np.mean(difference[whole]))
    down = float(np.mean(series["chamber_level"][whole]))
    results = file.results()
    mean = series["eta"].mean(axis=1)
    sunk = float(np.mean(mean[whole]) - np.mean(mean[(t > 0.5) & (t < 0.5 + period)])) / case.tank.depth
    with Report(name, f"Pneumatic communicating vessels to {t[-1]:.0f} s", dx) as report:
        report.seconds = results["wall_seconds"]
        for name, here, theory, unit in (
            ("period", period, PERIOD, "s"),
            ("final difference of the levels", level, DIFFERENCE, "m"),
        ):
            off = abs(here / theory - 1)
            report.row(name, here, unit, theory=theory, bar="within 2 %", passes=off < 0.02)
        report.row("change of the level under the pressure", down, "m", bar="below zero", passes=down < 0)
        report.row("damping", found.decay_rate / found.omega, "of critical")
        # `energy_pto` is the energy that the air takes from the water; here the air gives energy to the water
        missing = results["energy_residual"] / results["energy_pto"]
        for check, share, bar in (
            ("energy not accounted for / work of the air", missing, 0.05),
            ("change of the mean level / depth", sunk, 0.001),
        ):
            bar_text = f"within {100 * bar:g} %"
            report.row(check, 100 * share, "%", theory=0.0, bar=bar_text, passes=abs(share) < bar)
        report.row("noise over speed", results["noise"])
