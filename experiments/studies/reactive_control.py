"""Reactive control of a heaving buoy in seas: damping and stiffness of the take-off chosen by a fast model.

The law has two coefficients, of the speed and of the position, and is linear. The best damping without a
stiffness is found in the same way, so that the difference is that of the control. Both are then run in three
seas.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import RUNS, Report
from jaxsph import analysis

DAMPING, STIFFNESS = "link.take_off.damping", "link.take_off.stiffness"
BOUNDS = {DAMPING: (30.0, 600.0), STIFFNESS: (-1600.0, 200.0)}
"""Bounds of the damping (N s/m) and the stiffness (N/m) per metre of width."""
HS = 0.05
"""Significant wave height, m."""
TABLE = js.ScatterTable(np.full(3, HS), np.array([1.2, 1.35, 1.5]), np.full(3, 1.0 / 3.0))
"""Seas of equal shares; invented for this experiment."""
SEA = {"waves": {"kind": "irregular", "Hs": HS, "Tp": 1.2, "duration": 48.0}, "t1": 62.0}
"""Each sea repeats after thirty to forty waves, and is the same for every device; times in s."""

BEGIN = SEA["t1"] - SEA["waves"]["duration"]
"""Time from which a sea is averaged, s."""


class _Law(NamedTuple):
    """A law of control, in the model and in the water."""

    found: js.Maximum
    runs: int
    """Number of runs of the calibrations."""
    in_water: js.PowerMatrix


def main(dx: float = 0.02, workers: int = 1) -> None:
    """Searches for both laws, runs them in the seas, or continues."""
    RUNS.mkdir(exist_ok=True)
    laws = {
        "constant damping": _law(dx, "damping", {DAMPING: BOUNDS[DAMPING]}, workers),
        "reactive control": _law(dx, "reactive", BOUNDS, workers),
    }
    with Report(f"reactive_control_{dx:g}", "Reactive control of a heaving buoy in seas", dx) as report:
        for name, law in laws.items():
            report.row(f"{name}: runs of the calibrations", law.runs)
            report.row(f"{name}: damping", law.found.case.value(DAMPING), "N s/m")
            report.row(f"{name}: stiffness", law.found.case.value(STIFFNESS), "N/m")
            report.row(f"{name}: mean power by the model", law.found.value, "W/m")
            year = law.in_water.annual(TABLE)
            report.row(f"{name}: mean power in the water", year.value, "W/m")
            report.row(f"{name}: standard error of this power", year.error, "W/m")
            for Tp, power in zip(TABLE.Tp, law.in_water.P[0], strict=True):
                report.row(f"{name}: mean power in the sea with Tp = {Tp:g} s", power, "W/m")
        ratio = _ratio(*(law.in_water for law in laws.values()))
        report.row(
            "mean power with reactive control over that with constant damping",
            ratio.value,
            bar="above 1 by two errors",
            passes=ratio.value - 2.0 * ratio.error > 1.0,
        )
        report.row("the same: standard error", ratio.error)
        report.picture(_picture(laws))


def _law(dx: float, name: str, bounds: dict[str, tuple[float, float]], workers: int) -> _Law:
    """The best law within the bounds, and its power in the seas."""
    case = js.load_case("buoy_heave").replace({"dx": dx, "t1": 18.0})
    out = RUNS / f"reactive_control_{name}_{dx:g}.h5"
    found = js.search(case, bounds, out, of="P_pto", table=TABLE, workers=workers)
    models = [js.FastModel.read(path) for path in sorted(out.with_name(f"{out.name}.models").glob("??.json"))]
    law = {key: found.case.value(key) for key in BOUNDS}
    path = RUNS / f"reactive_control_{name}_{dx:g}_seas.h5"
    sea = js.load_case("buoy_heave").replace({"dx": dx, **SEA, **law})
    matrix = js.power_matrix(sea, [HS], TABLE.Tp.tolist(), path, workers=workers)
    return _Law(found, sum(len(model.runs) for model in models), matrix)


def _ratio(damped: js.PowerMatrix, reactive: js.PowerMatrix) -> analysis.Mean:
    """Ratio of the mean powers over the seas, and its standard error.

    The seas are the same for both. The error is that of the mean of P_reactive - ratio P_damped, in which
    most of the changes with the groups of waves cancel.
    """
    means, errors = [], []
    for place in damped.sweep.members:
        P, Q = (
            one.sweep.members[place]["power_take_off"][one.sweep.members[place]["time"] > BEGIN]
            for one in (damped, reactive)
        )
        means.append((np.mean(P), np.mean(Q)))
        errors.append(analysis.mean_with_error(Q - np.mean(Q) / np.mean(P) * P).error)
    P, Q = np.sum(means, axis=0)
    return analysis.Mean(Q / P, float(np.linalg.norm(errors)) / P)


def _picture(laws: dict[str, _Law]) -> Figure:
    figure = Figure(figsize=(6, 3.6), layout="constrained")
    axis = figure.subplots()
    for (name, law), shift in zip(laws.items(), (-0.005, 0.005), strict=True):
        P, error = law.in_water.P[0], law.in_water.error[0]
        axis.errorbar(TABLE.Tp + shift, P, error, fmt="o", capsize=3, label=name)
    axis.set(xlabel="peak period, s", ylabel="mean power in the water, W/m", ylim=(0.0, None))
    axis.legend()
    return figure
