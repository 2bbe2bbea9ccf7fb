"""Relaxation zone: its waves, its absorption of returning waves, and an OWC in a short tank."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import Report, solved
from jaxsph import analysis

H, T, D = 0.06, 1.2, 0.5
LENGTH = 2.048
"""Length of the zone, m: one wavelength."""
GAUGES = (0.0, 0.3, 0.5, 0.8, 1.0, 1.3, 1.6)
"""Positions of the gauges beyond the end of the zone, m."""


def main(dx: float = 0.02) -> None:
    """Runs a flume with a sponge, a flume with a wall, and the built-in OWC with a paddle and with a zone."""
    flume = {
        "dx": dx,
        "tank": {"length": LENGTH + 4.0, "depth": D},
        "scheme": {"kind": "incompressible"},
        "waves": {"H": H, "T": T, "zone": LENGTH},
        "probes": {"gauges": [round(LENGTH + x, 3) for x in GAUGES]},
        "output": {"snapshot_dt": 4.0},
    }
    free = js.Case.from_dict(flume | {"name": "zone_free", "t1": 16.0, "sponge": {"length": 2.0}})
    wall = js.Case.from_dict(flume | {"name": "zone_wall", "t1": 18.0}).replace({"tank.length": LENGTH + 2.0})
    owc = js.load_case("owc").replace({"dx": dx})
    long = round(2.0 * np.pi / _wavenumber(owc), 2)
    short = owc.replace(
        {
            "tank.length": 1.5 * long,
            "waves.zone": long,
            "probes.gauges": [],
            "probes.pressure": [],
            "name": "zone",
        }
    )
    files = {
        name: solved(case, f"relaxation_zone_{name}_{dx:g}")
        for name, case in (("free", free), ("wall", wall), ("paddle", owc), ("short", short))
    }
    results = {name: file.results() for name, file in files.items()}
    with Report(f"relaxation_zone_{dx:g}", "Relaxation zone", dx) as report:
        report.seconds = sum(one["wall_seconds"] for one in results.values())
        waves = {name: _incident(files[name].series()) for name in ("free", "wall")}
        series = files["free"].series()
        last = analysis.whole_periods(series["time"], T, 4)
        at_end = 2.0 * abs(analysis.fundamental(series["time"][last], series["eta"][last, 0], T))
        report.row(
            "wave height at the end of the zone over the specified height",
            at_end / H,
            theory=1.0,
            bar="2 %",
            passes=abs(at_end / H - 1.0) < 0.02,
        )
        report.row(
            "tank with a sponge: incident height over the specified height", 2.0 * waves["free"].incident / H
        )
        again = abs(waves["wall"].incident - waves["free"].incident) / waves["wall"].reflected
        report.row(
            "tank with a wall: incident amplitude minus that with a sponge, over the reflected amplitude",
            again,
            bar="5 %",
            passes=again < 0.05,
        )
        xi, with_zone = results["paddle"]["xi"], results["short"]["xi"]
        report.row("OWC, paddle, four wavelengths: xi", xi)
        report.row("the same, based on the measured incident power", results["paddle"]["xi_measured"])
        apart = abs(with_zone / xi - 1.0)
        report.row(
            "OWC, zone, 1.5 wavelengths: xi", with_zone, bar="within 3 % of the paddle's", passes=apart < 0.03
        )
        cost = results["short"]["wall_seconds"] / results["paddle"]["wall_seconds"]
        report.row("wall time with the zone over that with the paddle", cost, bar="0.45", passes=cost < 0.45)
        share = results["short"]["energy_residual_share"]
        report.row(
            "OWC with the zone: energy not accounted for, over the zone's work or the largest kinetic energy",
            100.0 * share,
            "%",
            bar="2 %",
            passes=abs(share) < 0.02,
        )
        report.picture(_picture({name: files[name].series() for name in ("paddle", "short")}))


def _wavenumber(case: js.Case) -> float:
    return float(js.RegularWaves(case.waves.H, case.waves.T, case.tank.depth).k)


def _incident(series: dict[str, np.ndarray]) -> analysis.Reflection:
    """Incident and reflected wave beyond the zone over the last four periods."""
    eta, x = np.float64(series["eta"][:, 1:].T), LENGTH + np.array(GAUGES[1:])
    return analysis.reflection(eta, x, series["time"], T, D, periods=4)


def _picture(series: dict[str, dict[str, np.ndarray]]) -> Figure:
    figure = Figure(figsize=(9, 4), layout="constrained")
    axis = figure.subplots()
    for name, label in (("paddle", "paddle, four wavelengths"), ("short", "zone, 1.5 wavelengths")):
        t, power = series[name]["time"], series[name]["power_pto"]
        axis.plot(t, power, lw=0.9, label=label)
    axis.set(xlabel="t, s", ylabel="power of the PTO, W/m")
    axis.legend()
    return figure
