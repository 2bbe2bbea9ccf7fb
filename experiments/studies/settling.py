"""Efficiency of the OWC from a run and from a run twice as long.

The OWC reflects half of the wave height. The part that the paddle does not absorb reaches the OWC again
after three lengths of the tank, and from then on the waves are slightly higher. The efficiency based on the
specified waves changes with them; the efficiency based on the measured waves changes less.
"""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from experiments.common import Report
from experiments.owc_tank import damped, results_until
from jaxsph import analysis
from jaxsph.case.geometry import Geometry
from jaxsph.case.linear import incident_power
from jaxsph.case.settling import travel_time


def main(dx: float = 0.02, k_dm: float = 150.0) -> None:
    """Runs the OWC with damping k_dm (kg^0.5 m^-2.5) to twice its t1, and averages over the settled periods
    up to t1 and up to the end."""
    case, file = damped(dx, k_dm, 2.0)
    t1, T, series = case.t1, case.waves.T, file.series()
    echo = case.waves.ramp_periods * T + 3.0 * travel_time(case, Geometry.of(case).length)
    every = case.replace({"output.periods": 1000, "t1": 2.0 * t1})
    whole, _ = results_until(every, series)
    part, notices = results_until(case, {k: v[series["time"] < t1 - 1e-6] for k, v in series.items()})
    title = f"The OWC with K_dm = {k_dm:g}: means of a run and of a run twice as long"
    late = series["time"] > echo
    steady = float(np.mean(series["power_pto"][late])) / incident_power(case)
    with Report(f"settling_{dx:g}_{k_dm:g}", title, dx) as report:
        report.seconds = file.results()["wall_seconds"]
        for name, what in (
            ("xi", "xi based on the specified incident power"),
            ("xi_measured", "xi based on the measured incident power"),
        ):
            off = 100 * (part[name] / whole[name] - 1.0)
            report.row(f"{what}, to {2 * t1:g} s", whole[name])
            report.row(f"{what}, to {t1:g} s", part[name], theory=whole[name])
            label = f"{what}: mean to {t1:g} s, relative difference from the mean to {2 * t1:g} s"
            report.row(label, off, "%", theory=0.0, bar="within 1 %", passes=abs(off) < 1.0)
        for name, found in ((f"to {t1:g} s", part), (f"to {2 * t1:g} s", whole)):
            report.row(f"{name}: periods averaged", found["periods"])
            report.row(f"{name}: periods left out", found["periods_left_out"])
            report.row(f"{name}: reflection", found["reflection"])
        report.row("arrival of the waves reflected by the OWC and then by the paddle", echo, "s")
        report.row(
            "xi based on the specified incident power, after the arrival of these reflected waves", steady
        )
        t, periods = series["time"], int(series["time"][-1] / T)
        xi = analysis.per_period(t, series["power_pto"], T, periods) / incident_power(case)
        figure = Figure(figsize=(8, 4), layout="constrained")
        axis = figure.subplots()
        axis.plot(t[-1] - T * (np.arange(periods, 0, -1) - 0.5), xi, "o-", ms=4)
        axis.axhline(whole["xi"], color="C1", lw=1, label=f"mean to {2 * t1:g} s")
        axis.axvline(t1, color="0.6", lw=1, label=f"{t1:g} s")
        axis.axvline(echo, color="C3", lw=1, ls="--", label="second reflection arrives")
        axis.set(xlabel="t, s", ylabel="xi, each period", ylim=(0.6 * steady, 1.4 * steady))
        axis.legend()
        report.picture(figure)
    print(*notices, sep="\n")
