"""Oblique waves in a basin: direction and height against the specified values, and wavenumber."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import Report, solved
from jaxsph import analysis

PERIODS = 4
"""Number of periods at the end of the run over which phases and heights are fitted."""
TRIPLES = {
    "near the wavemaker": (0, 1, 4),
    "in the middle": (3, 4, 7),
    "near the far end": (4, 5, 8),
}
"""Indices of the gauges of each triangle, by the triangle's place."""
WIRE = 0.36
"""Fraction of the height (-) by which a wire reads too low, divided by (k dx)^2: see `WireGauge`."""
BARS = (2.0, 0.05)
"""Largest allowed error of the direction, degrees, and of the height (-)."""


def main(dx: float = 0.0625, degrees: float = 20.0) -> None:
    """Runs the built-in basin with spacing dx (m) and waves in a direction (degrees); reports their
    direction, height and wavenumber."""
    case = js.load_case("basin").replace(
        {"dx": dx, "waves.direction": float(np.round(np.radians(degrees), 4))}
    )
    file = solved(case, f"oblique_waves_{dx:g}_{degrees:g}")
    series, results = file.series(), file.results()
    t, T, asked = series["time"], case.waves.T, np.degrees(case.waves.direction)
    last = analysis.whole_periods(t, T, PERIODS)
    eta, at = np.float64(series["eta_wire"][last].T), np.array(case.probes.surface)
    with Report(f"oblique_waves_{dx:g}", f"Waves at {degrees:g} degrees in a basin", dx) as report:
        report.seconds = results["wall_seconds"]
        groups = {
            place: analysis.wave_direction(eta[[*of]], at[[*of]], t[last], T, case.tank.depth)
            for place, of in TRIPLES.items()
        }
        for place, found in groups.items():
            error = np.degrees(found.direction) - asked
            _row(report, f"three gauges {place}: direction, error", error, "degrees", BARS[0])
        k = float(js.RegularWaves(case.waves.H, T, case.tank.depth).k)
        for place, found in groups.items():
            _row(
                report, f"three gauges {place}: height, error", found.height / case.waves.H - 1.0, "", BARS[1]
            )
        every = analysis.wave_direction(eta, at, t[last], T, case.tank.depth)
        report.row("nine gauges: direction, error", np.degrees(every.direction) - asked, "degrees")
        report.row("nine gauges: height, error", every.height / case.waves.H - 1.0)
        read = case.waves.H * (1.0 - WIRE * (k * dx) ** 2)
        report.row("the same, corrected for the width of the wires", every.height / read - 1.0)
        report.row("nine gauges: wavenumber over that of linear theory", every.wavenumber / k, theory=1.0)
        heights = 2.0 * np.abs(analysis.fundamental(t[last], eta, T)) / case.waves.H
        report.row("smallest wave height at a gauge over the specified height", heights.min(), theory=1.0)
        report.row("largest wave height at a gauge over the specified height", heights.max(), theory=1.0)
        share = "energy not accounted for, over the work of the zones or the largest kinetic energy"
        report.row(share, 100.0 * results["energy_residual_share"], "%")
        report.row("wave height in spacings", case.waves.H / dx)
        report.picture(_picture(case, t, series["eta_wire"]))


def _row(report: Report, check: str, error: float, unit: str, bar: float) -> None:
    """Adds the row of an error and of its limit `bar`, which has the same unit."""
    words = f"within {bar:g} {unit}" if unit else f"within {100 * bar:g} %"
    report.row(check, error, unit, theory=0.0, bar=words, passes=abs(error) < bar)


def _picture(case: js.Case, t: np.ndarray, eta: np.ndarray) -> Figure:
    """Figure of the elevations at three gauges across the basin, and of the target waves there."""
    figure = Figure(figsize=(9, 4), layout="constrained")
    axis = figure.subplots()
    model = case.problem().model
    for index, colour in zip((1, 4, 7), ("C0", "C1", "C2"), strict=True):
        x, y = case.probes.surface[index]
        axis.plot(t, eta[:, index], colour, lw=0.9, label=f"y = {y:g} m")
        axis.plot(t, model.moving[0].field.elevation(x, y, t), colour, lw=0.6, ls="--")
    axis.set(xlabel="t, s", ylabel="elevation, m", title="dashed: target waves, without the ramp")
    axis.legend(loc="upper left")
    return figure
