"""Built-in OWCs in three dimensions in regular waves: energy balance, capture width, pressure and level.

There are no theoretical values for these devices. Energies are divided by the work done by the paddle, which
absorbs the waves that return to it.
"""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import BUDGET, Report, of_paddle, solved
from experiments.validation.floating_devices import ENERGIES
from jaxsph.output.plot.style import in_style

DEVICES = ("owc_3d", "owc_spar")
"""Built-in cases with a chamber in three dimensions."""


def main(dx: float = 0.04) -> None:
    """Runs or continues the cases at the spacing dx (m)."""
    with Report(f"owcs_3d_{dx:g}", "OWCs in three dimensions in regular waves", dx) as report:
        report.seconds, records = 0.0, {}
        for name in DEVICES:
            file = solved(js.load_case(name).replace({"dx": dx}), f"owcs_3d_{dx:g}_{name}")
            results, records[name] = file.results(), file.series()
            report.seconds += results["wall_seconds"]
            report.row(f"{name}: capture width", results["capture_width"], "m")
            pressure, level = (results[f"amplitude_{key}_main"] for key in ("P_a", "chamber_level"))
            report.row(f"{name}: amplitude of the air's pressure", pressure, "Pa")
            report.row(f"{name}: amplitude of the chamber's level", level, "m")
            for energy, most in ENERGIES.items():
                share, bounded = of_paddle(results, energy), bool(np.isfinite(most))
                report.row(
                    f"{name}: {BUDGET[energy]}, over the paddle's work",
                    share,
                    "%",
                    bar=f"within {most:g} %" if bounded else "",
                    passes=abs(share) < most if bounded else None,
                )
        report.picture(_picture(records))


@in_style
def _picture(records: dict[str, dict[str, np.ndarray]]) -> Figure:
    """Figure of the air's pressure and the chamber's level over time."""
    figure = Figure(figsize=(8.0, 4.0), layout="constrained")
    axes = figure.subplots(2, len(records), sharex=True, squeeze=False)
    for column, (name, series) in zip(axes.T, records.items(), strict=True):
        for ax, key, words in zip(
            column, ("P_a_main", "chamber_level_main"), ("pressure (Pa)", "level (m)"), strict=True
        ):
            ax.plot(series["time"], series[key])
            ax.set_ylabel(words)
        column[0].set_title(name)
        column[-1].set_xlabel("time (s)")
    return figure
