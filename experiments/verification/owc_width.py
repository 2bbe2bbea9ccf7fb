"""OWC across the whole width of a narrow flume: three dimensions against two at the same spacing.

The flume is five spacings wide between walls without friction, so that the flow is two-dimensional. The
turbine is linear; its resistance times the width equals the resistance in the two-dimensional run.
"""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import BUDGET, Report, of_paddle, solved

ACROSS = 5
"""Width of the flume, in spacings."""
RESISTANCE = 5000.0
"""Resistance of the turbine times the width of the flume, Pa s/m2."""
FRONT, BACK, LENGTH, TIP, TOP = 2.74, 2.8, 3.0, 0.22, 0.6
"""First and last x of the front wall, length of the tank, and levels of the wall's lower and upper end, m."""


def case_of(dx: float, dim: int) -> js.Case:
    """The flume with a spacing dx (m) in two or three dimensions."""
    width = ACROSS * dx
    low, high = ([FRONT, TIP], [BACK, TOP]) if dim == 2 else ([FRONT, 0.0, TIP], [BACK, width, TOP])
    chamber = {"between": ["wall", "far"]} if dim == 2 else {"at": [0.5 * (BACK + LENGTH), 0.5 * width]}
    resistance = RESISTANCE if dim == 2 else RESISTANCE / width
    return js.Case.from_dict(
        {
            "name": f"owc_width_{dim}d",
            "dx": dx,
            "t1": 9.0,
            "tank": {"length": LENGTH, "depth": 0.3, "height": TOP} | ({} if dim == 2 else {"width": width}),
            "scheme": {"kind": "incompressible"},
            "waves": {"H": 0.06, "T": 1.2},
            "solid": {"wall": {"block": {"low": low, "high": high}}},
            "chamber": {"main": chamber | {"pto": {"resistance": resistance}}},
        }
    )


def main(dx: float = 0.02) -> None:
    """Runs both flumes and compares efficiency, pressure and level."""
    with Report(f"owc_width_{dx:g}", "OWC in a narrow flume, 3-D against 2-D", dx) as report:
        found, records = {}, {}
        for dim in (2, 3):
            file = solved(case_of(dx, dim), f"owc_width_{dx:g}_{dim}d")
            found[dim], records[dim] = file.results(), file.series()
        report.seconds = sum(one["wall_seconds"] for one in found.values())
        width = ACROSS * dx
        _compare(report, "efficiency", found[3]["capture_width"] / width, found[2]["xi"])
        for name, words, unit in (
            ("P_a", "amplitude of the air's pressure", "Pa"),
            ("chamber_level", "amplitude of the chamber's level", "m"),
        ):
            key = f"amplitude_{name}_main"
            _compare(report, words, found[3][key], found[2][key], unit)
        for dim, one in found.items():
            for key in ("residual", "projection", "hyperviscosity"):
                report.row(
                    f"{dim}-D: {BUDGET[key]}, over the paddle's work", of_paddle(one, key, "whole_"), "%"
                )
        report.picture(_picture(records))


def _compare(report: Report, check: str, deep: float, flat: float, unit: str = "") -> None:
    """Reports a value of the run in three dimensions, and its deviation from that in two dimensions."""
    off = deep / flat - 1.0
    report.row(check, deep, unit, theory=flat, bar="within 5 %", passes=abs(off) < 0.05)
    report.row("the same: deviation from the 2-D run", 100 * off, "%")


def _picture(records: dict[int, dict[str, np.ndarray]]) -> Figure:
    """Draws the pressure of the air over time in both runs."""
    figure = Figure(figsize=(7, 3.5), layout="constrained")
    ax = figure.subplots()
    for (dim, series), style in zip(records.items(), ("-", "--"), strict=True):
        ax.plot(series["time"], series["P_a_main"], style, label=f"{dim}-D")
    ax.set(xlabel="time, s", ylabel="pressure of the air, Pa")
    ax.legend()
    return figure
