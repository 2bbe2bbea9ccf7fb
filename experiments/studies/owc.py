"""The built-in OWC over ten periods after the transient: energy budget, flow, efficiency, and its limit for
spacing zero."""

from __future__ import annotations

import numpy as np

import jaxsph as js
from experiments.common import RUNS, Report, solved
from jaxsph import analysis


def main(dx: float = 0.02) -> None:
    """Runs the OWC with the spacing dx (m) and reports its settled periods."""
    case = js.load_case("owc").replace({"dx": dx})
    file = solved(case, f"owc_{dx:g}")
    series, results = file.series(), file.results()
    T, t, periods = case.waves.T, series["time"], int(results["periods"])
    last = analysis.whole_periods(t, T, periods)
    over = {name: values[last] for name, values in series.items()}
    title = f"The built-in OWC over {periods} periods from t = {t[last][0]:.1f} s"
    with Report(f"owc_{dx:g}", title, dx) as report:
        report.seconds = results["wall_seconds"]
        _rows(report, case, results, over)
        _limit(report, case)


def _limit(report: Report, case: js.Case) -> None:
    """Reports xi without the error of the spacing, and how far it is from xi at the spacing of the case."""
    found = js.with_error(case, RUNS / f"{report.name}_error.h5")
    minutes = found.runs["wall_seconds"] / 60.0
    for name, label in (("xi", "xi"), ("xi_measured", "xi over the measured incident wave")):
        one = found[name]
        report.row(f"{label} at {found.dx[0]:g} m, mean of three runs", one.coarse)
        report.row(f"{label} at {found.dx[1]:g} m", one.fine)
        report.row(f"{label}, limit for spacing zero", one.value)
        report.row(f"{label}, stated error of this limit", one.error)
        off = one.coarse / one.value - 1.0
        report.row(
            f"{label} at {found.dx[0]:g} m against this limit",
            100.0 * off,
            "%",
            bar="within 3 %",
            passes=abs(off) < 0.03,
        )
    for dx in found.dx:
        report.row(f"wall time of a run at {dx:g} m", np.mean(minutes[found.runs.axes["dx"] == dx]), "min")


def _rows(report: Report, case: js.Case, results: dict[str, float], over: dict[str, np.ndarray]) -> None:
    T = case.waves.T
    energies = [name for name in results if name.startswith("energy_") and not name.endswith("_share")]
    for name in energies:
        report.row(f"energy: {name.removeprefix('energy_')}", results[name], "J/m")
    share = results["energy_residual"] / results["energy_paddle"]
    report.row(
        "energy not accounted for, over the paddle's work",
        100 * share,
        "%",
        theory=0.0,
        bar="within 2 %",
        passes=abs(share) < 0.02,
    )

    # rate of change of the volume over q, at the wave frequency because differences of samples are noisy
    omega = 2 * np.pi / T
    wave = np.exp(-1j * omega * over["time"])
    volume = np.mean(over["chamber_volume"] * wave) * 1j * omega
    flow = np.mean(over["flow"] * wave)
    ratio = volume / flow
    off = abs(ratio - 1)
    report.row(
        "rate of change of the chamber's volume minus the flow, over the flow",
        100 * off,
        "%",
        theory=0.0,
        bar="within 3 %",
        passes=off < 0.03,
    )

    report.row("xi", results["xi"], bar="0 to 1", passes=0 < results["xi"] < 1)
    report.row("scatter of xi from period to period", results["xi_scatter"])
    report.row("P_a amplitude", 2 * abs(np.mean(over["P_a"] * wave)), "Pa")
    report.row("chamber level amplitude", 1e3 * 2 * abs(np.mean(over["chamber_level"] * wave)), "mm")
