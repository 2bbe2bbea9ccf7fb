"""Efficiency of a turbine damped too little, from a run and from one of twice its length."""

from __future__ import annotations

from experiments.common import Report
from experiments.owc_tank import damped, results_until

K_DM = 150.0


def main(dx: float = 0.02) -> None:
    """Runs the OWC with K_dm = 150 for twice its t1, and averages to t1 and over all that has settled."""
    case, file = damped(dx, K_DM, 2.0)
    t1 = case.t1
    series = file.series()
    every = case.replace({"output.periods": 1000, "t1": 2.0 * t1})
    whole, _ = results_until(every, series)
    part, notices = results_until(case, {k: v[series["time"] < t1 - 1e-6] for k, v in series.items()})
    last = file.results()
    title = f"The OWC with K_dm = {K_DM:g}: mean of a run and of one of twice its length"
    with Report(f"settling_{dx:g}", title, dx) as report:
        report.seconds = last["wall_seconds"]
        off = part["xi"] / whole["xi"] - 1.0
        passes = abs(off) < 0.01
        report.row(f"xi to {t1:g} s", part["xi"], theory=whole["xi"], bar="within 1 %", passes=passes)
        report.row("periods averaged", part["periods"])
        report.row("periods left out", part["periods_left_out"])
        report.row(f"xi to {2 * t1:g} s, periods averaged", whole["periods"])
        report.row(f"xi to {2 * t1:g} s, last ten periods", last["xi"])
        for name in sorted({"xi_measured"} & set(part) & set(whole)):
            report.row("xi of the measured waves", part[name], theory=whole[name])
    print(*notices, sep="\n")
