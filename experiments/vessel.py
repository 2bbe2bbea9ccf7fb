"""The communicating vessels of section 4.2: one surface suddenly under 1000 Pa of air."""

from __future__ import annotations

import numpy as np
import typer

import jaxsph as js
from experiments.common import row, solved
from jaxsph import analysis

PERIOD = 1.427367
"""s: lowest antisymmetric mode of two vessels 0.32 m wide and 0.56 m deep, joined under a wall of 0.01 m
with 0.33 m in the water; inviscid, linear, by mode matching converged to 1e-6."""
DIFFERENCE = 1000.0 / (1000.0 * 9.81)
"""m: final difference of the levels, P_a/(rho g)."""


def main(dx: float = 0.01, t1: float = 30.0) -> None:
    """Runs the vessels and prints period, final difference and which level went down."""
    file = solved(js.load_case("vessel").replace({"dx": dx}), f"vessel_{dx:g}", t1)
    series = file.series()
    t, difference = series["time"], series["eta"][:, 0] - series["eta"][:, 1]
    late = t > 0.5  # the first half second holds the acoustics of the sudden pressure
    found = analysis.fit_damped_oscillation(t[late], difference[late])
    period = 2 * np.pi / found.omega
    label = f"vessels, dx = {dx:g} m, {t[-1]:.0f} s"
    off = period / PERIOD - 1
    row(f"{label}: period", f"{period:.4f} s ({100 * off:+.2f} %)", "1.4274 s within 2 %", abs(off) < 0.02)
    # the mean over whole periods at the end does not depend on the fit's envelope
    whole = analysis.whole_periods(t, period, max(1, int(0.4 * t[-1] / period)))
    level = float(np.mean(difference[whole]))
    off = level / DIFFERENCE - 1
    row(
        f"{label}: final difference",
        f"{level:.5f} m ({100 * off:+.2f} %)",
        "0.10194 m within 2 %",
        abs(off) < 0.02,
    )
    down = float(np.mean(series["chamber_level"][whole]))
    row(f"{label}: level under the pressure", f"{down:+.4f} m", "below zero", down < 0)
    row(f"{label}: damping", f"{found.decay_rate / found.omega:.4f} of critical")
    row(f"{label}: energy not accounted for", f"{100 * file.results()['energy_residual_share']:+.1f} %")


if __name__ == "__main__":
    typer.run(main)
