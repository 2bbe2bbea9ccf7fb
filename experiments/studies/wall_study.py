"""Section 5.1: efficiency by wave period, for front walls of four thicknesses, up to 24 runs."""

from __future__ import annotations

from typing import Annotated

import numpy as np
import typer

from experiments.common import Report
from experiments.owc_tank import over_periods, study_case

THICKNESS = (0.01, 0.02, 0.03, 0.04)
PERIODS = (0.8, 1.0, 1.2, 1.4, 1.6, 1.8)


def main(
    dx: float = 0.02,
    thickness: Annotated[
        list[float] | None, typer.Option(help="Thickness, m; repeatable; default: four.")
    ] = None,
    period: Annotated[list[float] | None, typer.Option(help="Period, s; repeatable; default: six.")] = None,
) -> None:
    """Runs or continues the study at the spacing dx (m)."""
    title = "Efficiency over period and wall thickness (section 5.1), assumed draught of 0.16 m, no platform"
    with Report(f"wall_study_{dx:g}", title, dx) as report:
        case = study_case(dx, 13.0)
        walls, periods = tuple(sorted(thickness or THICKNESS)), tuple(sorted(period or PERIODS))
        xi, error, theory = over_periods(
            report, case, "device.wall_thickness", "wall thickness", walls, periods
        )
        mean, expected = (float(np.nanmean(a[-1] - a[0])) for a in (xi, theory))
        # standard error of a mean of differences
        own = float(np.sqrt(np.nansum(error[0] ** 2 + error[-1] ** 2)) / len(periods))
        # in the paper the efficiency falls with growing thickness of the wall
        report.row(
            "mean change of xi from the thinnest to the thickest wall",
            mean,
            theory=expected,
            paper="below zero",
            bar="below zero by two standard errors",
            passes=mean < -2.0 * own,
        )
        report.row("standard error of the mean change of xi", own)
