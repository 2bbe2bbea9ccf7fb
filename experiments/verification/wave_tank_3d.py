"""Waves in a narrow 3-D tank and in a 2-D slice of it, against second-order Stokes theory."""

from __future__ import annotations

import numpy as np

import jaxsph as js
from experiments.common import BUDGET, Report, of_paddle, solved
from experiments.verification.wave_tank import against_stokes
from jaxsph.waves import theory

BARS = (3.0, 1.5)
"""Largest allowed MAE_a and MAE_p, %."""


def main(dx: float = 0.025, width: float = 0.2) -> None:
    """Runs a tank of this width (m) with spacing dx (m) and its 2-D slice; reports errors, decay, losses."""
    case = js.load_case("wave_tank_3d").replace({"dx": dx, "tank.width": width})
    wavelength = float(theory.wavelength(case.waves.T, case.tank.depth))
    along = np.round(np.arange(0.5, 2.15, 0.2) * wavelength, 3)
    # besides the gauges for the errors, gauges a fifth of a wavelength apart for the decay
    case = case.replace({"probes.gauges": [1.024, 2.048, 4.096, *map(float, along)]})
    title = "Waves in a narrow tank in 3-D against second-order Stokes theory"
    with Report(f"wave_tank_3d_{dx:g}", title, dx) as report:
        for label, changes in (("3-D", {}), ("2-D", {"tank.width": None})):
            here = case.replace(changes)
            file = solved(here, f"wave_tank_{label[0]}d_{dx:g}_{width:g}")
            deep = label == "3-D"
            figure = against_stokes(report, here, file.series(), 3.2, BARS if deep else None, f"{label}, ")
            results = file.results()
            if deep:
                report.seconds = results["wall_seconds"]
                report.picture(figure)
            for name, bar in (("hyperviscosity", 4.0), ("projection", 1.0)):
                for when, before in (("settled periods", ""), ("whole run", "whole_")):
                    share = of_paddle(results, name, before)
                    judged = deep and not before
                    report.row(
                        f"{label}, {when}: {BUDGET[name]}, over the paddle's work",
                        share,
                        "%",
                        theory=0.0,
                        bar=f"within {bar:g} %" if judged else "",
                        passes=abs(share) < bar if judged else None,
                    )
            report.row(f"{label}, noise over speed", results["noise"], theory=0.0)
            report.row(f"{label}, time steps per simulated second", results["steps"] / results["t_end"])
            report.row(f"{label}, wall time", results["wall_seconds"], "s")
        report.row("wave height in spacings", case.waves.H / dx)
