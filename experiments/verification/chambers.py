"""Chambers between any walls: the built-in cases with such chambers, and one chamber defined in two ways.

Checks the energy budgets and the law of the duct, and that an OWC whose front wall is a solid absorbs the
same power as an OWC whose front wall is a plate with regional ghosts.
"""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import BUDGET, Report, of_paddle, solved
from experiments.owc_tank import study_case
from jaxsph.output.plot.style import BLUE, GREEN, ORANGE, in_style
from jaxsph.output.run_file import RunFile

CASES = ("owc_slope", "owc_two_chambers", "owc_ning")
"""Built-in cases with chambers between any walls."""
THICK = 3
"""Thickness of the front wall in spacings, as a plate and as a solid. A thinner solid does not separate the
water on its two sides."""


def main(dx: float = 0.02) -> None:
    """Runs or continues the built-in cases and three forms of an OWC at the spacing dx (m)."""
    with Report(f"chambers_{dx:g}", "Chambers between arbitrary walls", dx) as report:
        for name in CASES:
            file = solved(js.load_case(name).replace({"dx": dx}), f"{name}_{dx:g}")
            _balance(report, name, file.results())
            if name == "owc_two_chambers":
                _duct(report, file)
        _two_forms(report, dx)


def _balance(report: Report, name: str, results: dict[str, float]) -> None:
    """Reports the efficiency of a case, its energy budget and its hyperviscosity."""
    report.row(f"{name}: absorbed over incident power", results["xi"])
    off = of_paddle(results, "residual", "whole_")
    report.row(
        f"{name}: energy not accounted for, over the paddle's work",
        off,
        "%",
        theory=0.0,
        bar="within 2 %",
        passes=abs(off) < 2.0,
    )
    report.row(
        f"{name}: {BUDGET['hyperviscosity']}, over the paddle's work",
        of_paddle(results, "hyperviscosity"),
        "%",
    )


def _duct(report: Report, file: RunFile) -> None:
    """Reports how closely the duct between two chambers follows its law, and the energy lost in the duct."""
    series = file.series()
    drop, flow = (np.float64(series[f"{name}_cross"])[1:] for name in ("pressure_drop", "duct_flow"))
    between = np.float64(series["P_a_sea"] - series["P_a_land"])[1:]
    law = js.load_case("owc_two_chambers").duct["cross"]
    expected = 0.5 * law.density * np.abs(flow) * flow / (law.discharge * law.area) ** 2
    largest = np.abs(drop).max()
    for label, off in (
        ("largest deviation of the duct's pressure drop from its law", expected - drop),
        (
            "largest deviation of the duct's pressure drop from the chambers' pressure difference",
            between - drop,
        ),
    ):
        share = 100 * np.abs(off).max() / largest
        report.row(f"{label}, over the largest drop", share, "%", bar="within 0.2 %", passes=share < 0.2)
    report.row(
        "energy lost in the duct, over the paddle's work", of_paddle(file.results(), "duct_cross"), "%"
    )


def plate_and_solid(dx: float) -> dict[str, js.Case]:
    """One OWC in three forms: plate with walls of images, plate with dummy walls, solid with dummy walls."""
    plate = study_case(dx).replace({"device.wall_thickness": THICK * dx})
    length, depth = plate.tank.length, plate.tank.depth
    inner = length - plate.device.chamber_length
    tip = depth - plate.device.draught
    solid = plate.replace(
        {
            "device": None,
            "pto": None,
            "solid.front.block": {"low": [inner - THICK * dx, tip], "high": [inner, depth + 0.3]},
            "chamber.column": {"between": ["front", "far"], "pto": {"K_dm": plate.pto.K_dm}},
        }
    )
    return {
        "plate, images": plate,
        "plate, dummies": plate.replace({"tank.walls": "dummy"}),
        "solid, dummies": solid,
    }


def _two_forms(report: Report, dx: float) -> None:
    """Reports efficiency and pressure of one OWC, with a plate and with a solid as its front wall."""
    found = {}
    for label, case in plate_and_solid(dx).items():
        file = solved(case, f"chambers_{label.replace(', ', '_')}_{dx:g}")
        results, series = file.results(), file.series()
        P_a = series["P_a_column" if case.device is None else "P_a"]
        over = series["time"] > case.t1 - 3.0 * case.waves.T
        found[label] = (results["xi"], float(np.ptp(P_a[over])) / 2.0, results["xi_scatter"], series, P_a)
        report.row(f"{label}: absorbed over incident power", results["xi"])
        report.row(f"{label}: scatter of the efficiency from period to period", results["xi_scatter"])
        report.row(f"{label}: pressure amplitude", found[label][1], "Pa")
        report.row(
            f"{label}: {BUDGET['hyperviscosity']}, over the paddle's work",
            of_paddle(results, "hyperviscosity"),
            "%",
        )
    one, other = found["plate, dummies"], found["solid, dummies"]
    off = abs(one[0] - other[0])
    scatter = max(one[2], other[2])
    report.row(
        "solid against plate: difference of the efficiency",
        off,
        bar=f"the scatter, {scatter:.2g}",
        passes=off < scatter,
    )
    report.row(
        "solid against plate: relative difference of the pressure amplitude",
        100 * (other[1] / one[1] - 1.0),
        "%",
    )
    report.picture(_pressures(found))


@in_style
def _pressures(found: dict[str, tuple[float, float, float, dict[str, np.ndarray], np.ndarray]]) -> Figure:
    """Figure of the air pressure over time in every form of the OWC."""
    figure = Figure(figsize=(9.0, 3.5), layout="constrained")
    ax = figure.subplots()
    for (label, (*_, series, P_a)), colour in zip(found.items(), (BLUE, GREEN, ORANGE), strict=True):
        ax.plot(series["time"], P_a, color=colour, label=label)
    ax.set_xlabel("time (s)")
    ax.set_ylabel("pressure of the air (Pa)")
    ax.legend()
    return figure
