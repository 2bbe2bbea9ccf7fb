"""The built-in OWC over ten periods after the transient: energy budget, flow, efficiency."""

from __future__ import annotations

import numpy as np
import typer

import jaxsph as js
from experiments.common import row, solved
from jaxsph import analysis


def main(dx: float = 0.02) -> None:
    """Runs the OWC with the spacing dx and prints its last ten periods."""
    case = js.load_case("owc").replace({"dx": dx})
    file = solved(case, f"owc_{dx:g}")
    series, results = file.series(), file.results()
    T, t, periods = case.waves.T, series["time"], int(results["periods"])
    last = analysis.whole_periods(t, T, periods)
    over = {name: values[last] for name, values in series.items()}
    label = f"OWC, dx = {dx:g} m, {periods} periods from t = {t[last][0]:.1f} s"

    for name in ("paddle", "stored", "pto", "viscous", "diffusive", "residual"):
        row(f"{label}: {name}", f"{results[f'energy_{name}']:+.3f} J/m")
    share = results["energy_residual"] / results["energy_paddle"]
    row(f"{label}: not accounted for / paddle", f"{100 * share:+.1f} %", "within 5 %", abs(share) < 0.05)

    # q against the rate of the volume, by harmonics: differentiated samples are mostly noise
    omega = 2 * np.pi / T
    wave = np.exp(-1j * omega * over["time"])
    volume = np.mean(over["chamber_volume"] * wave) * 1j * omega
    flow = np.mean(over["flow"] * wave)
    ratio = volume / flow
    off = abs(ratio - 1)
    row(f"{label}: volume rate against q", f"{100 * off:.2f} %", "within 3 %", off < 0.03)

    row(f"{label}: xi", f"{results['xi']:.3f}", "0 to 1", 0 < results["xi"] < 1)
    row(f"{label}: xi from period to period", f"{results['xi_scatter']:.3f}")
    row(f"{label}: P_a amplitude", f"{2 * abs(np.mean(over['P_a'] * wave)):.1f} Pa")
    row(f"{label}: chamber level amplitude", f"{1e3 * 2 * abs(np.mean(over['chamber_level'] * wave)):.1f} mm")


if __name__ == "__main__":
    typer.run(main)
