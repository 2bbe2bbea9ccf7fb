"""The built-in OWC over ten periods after the transient: energy budget, flow, efficiency."""

from __future__ import annotations

import numpy as np
import typer

import jaxsph as js
from experiments.common import row, solved
from jaxsph import analysis, waves


def main(dx: float = 0.02) -> None:
    """Runs the OWC with the spacing dx and prints its last ten periods."""
    case = js.load_case("owc").replace({"dx": dx})
    series = solved(case, f"owc_{dx:g}").series()
    T, t = case.waves.T, series["time"]
    last = analysis.whole_periods(t, T, 10)
    over = {name: values[last] for name, values in series.items()}
    label = f"OWC, dx = {dx:g} m, 10 periods from t = {t[last][0]:.1f} s"

    budget = analysis.energy_budget(over)
    for name in ("paddle", "stored", "pto", "viscous", "diffusive", "residual"):
        row(f"{label}: {name}", f"{budget[name]:+.3f} J/m")
    share = budget["residual"] / budget["paddle"]
    row(f"{label}: not accounted for / paddle", f"{100 * share:+.1f} %", "within 5 %", abs(share) < 0.05)

    # q against the rate of the volume, by harmonics: differentiated samples are mostly noise
    omega = 2 * np.pi / T
    wave = np.exp(-1j * omega * over["time"])
    volume = np.mean(over["chamber_volume"] * wave) * 1j * omega
    flow = np.mean(over["flow"] * wave)
    ratio = volume / flow
    off = abs(ratio - 1)
    row(f"{label}: volume rate against q", f"{100 * off:.2f} %", "within 3 %", off < 0.03)

    P_inc = float(waves.incident_power(case.waves.H, T, case.tank.depth, case.fluid.rho0, case.g))
    found = analysis.efficiency(over["time"], over["power_pto"], T, P_inc, 10)
    row(f"{label}: xi", f"{found.xi:.3f}", "0 to 1", 0 < found.xi < 1)
    row(f"{label}: xi from period to period", f"{np.std(found.per_period):.3f}")
    row(f"{label}: P_a amplitude", f"{2 * abs(np.mean(over['P_a'] * wave)):.1f} Pa")
    row(f"{label}: chamber level amplitude", f"{1e3 * 2 * abs(np.mean(over['chamber_level'] * wave)):.1f} mm")


if __name__ == "__main__":
    typer.run(main)
