"""Efficiency of a turbine damped too little, from a run and from one of twice its length."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

import jaxsph as js
from experiments.common import Report, solved
from jaxsph.case.geometry import Geometry
from jaxsph.model.interfaces import Entry, Exchange
from jaxsph.run.results import run_results

K_DM = 150.0


class _Ledger:
    """What results ask of the model of a run that is only read."""

    def __init__(self, depth: float, t_end: float) -> None:
        self.depth, self._t_end = depth, t_end

    def time(self, state: object) -> float:
        """End of the run, s."""
        del state
        return self._t_end

    def entries(self) -> dict[str, Entry]:
        """The turbine's energy."""
        return {"pto": Entry("power take-off of the chamber", Exchange.HARVESTED)}


def main(dx: float = 0.02, t1: float = 22.8) -> None:
    """Runs the OWC with K_dm = 150 for twice t1 (s), and averages to t1 and over all that has settled."""
    case = js.load_case("owc").replace({"dx": dx, "pto.K_dm": K_DM, "t1": t1})
    file = solved(case, f"settling_{dx:g}", 2.0 * t1)
    series = file.series()
    every = case.replace({"output.periods": 1000, "t1": 2.0 * t1})
    whole, _ = results(every, series)
    part, notices = results(case, {k: v[series["time"] < t1 - 1e-6] for k, v in series.items()})
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


def results(case: js.Case, series: dict[str, np.ndarray]) -> tuple[dict[str, float], tuple[str, ...]]:
    """Results of a record that may be a part of a run's."""
    model = _Ledger(Geometry.of(case).depth, float(series["time"][-1]))
    state = SimpleNamespace(step=1, particles=SimpleNamespace(x=np.zeros((1, 2))))
    return run_results(case, js.Solution(series, {}, model, state, case), 1.0, 1)
