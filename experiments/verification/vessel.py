"""The communicating vessels of section 4.2: one surface suddenly under 1000 Pa of air."""

from __future__ import annotations

import numpy as np

import jaxsph as js
from experiments.common import Report, solved
from jaxsph import analysis

PERIOD = 1.427367
"""s: lowest antisymmetric mode of two vessels 0.32 m wide and 0.56 m deep, joined under a wall of 0.01 m
with 0.33 m in the water; inviscid, linear, by mode matching converged to 1e-6."""
DIFFERENCE = 1000.0 / (1000.0 * 9.81)
"""m: final difference of the levels, P_a/(rho g)."""


def main(dx: float = 0.01, t1: float = 60.0, weakly_compressible: bool = False) -> None:
    """Runs the vessels and prints period, final difference, which level went down, and what became of the
    air's work and of the mean level."""
    case, name = js.load_case("vessel").replace({"dx": dx}), f"vessel_{dx:g}"
    if weakly_compressible:
        case, name = case.replace({"scheme.kind": "weakly_compressible"}), f"{name}_weakly_compressible"
    file = solved(case, name, t1)
    series = file.series()
    t, difference = series["time"], series["eta"][:, 0] - series["eta"][:, 1]
    late = t > 0.5  # the first half second holds the acoustics of the sudden pressure
    found = analysis.fit_damped_oscillation(t[late], difference[late])
    period = 2 * np.pi / found.omega
    # the mean over whole periods at the end does not depend on the fit's envelope
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
            ("final difference", level, DIFFERENCE, "m"),
        ):
            off = abs(here / theory - 1)
            report.row(name, here, unit, theory=theory, bar="within 2 %", passes=off < 0.02)
        report.row("level under the pressure", down, "m", bar="below zero", passes=down < 0)
        report.row("damping", found.decay_rate / found.omega, "of critical")
        # the turbine's energy is what the air takes: here it gives
        missing = results["energy_residual"] / results["energy_pto"]
        for check, share, bar in (
            ("energy not accounted for / work of the air", missing, 0.05),
            ("mean level's change / depth", sunk, 0.001),
        ):
            bar_text = f"within {100 * bar:g} %"
            report.row(check, 100 * share, "%", theory=0.0, bar=bar_text, passes=abs(share) < bar)
        report.row("noise", results["noise"])
