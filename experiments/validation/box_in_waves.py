"""Freely floating box in regular waves, incompressible, 2-D, against the motions measured by Ren et al. 2015.

All values are taken over whole periods: for the computed motions over the settled periods at the end of the
run, for the measured ones over the whole record, which has not quite settled
(`experiments/reference/README.md`). The box drifts with the waves. Its drift is the slope of a straight line,
fitted to the surge together with two harmonics. Without the harmonics, a line fitted to two periods could
give a drift per period that is wrong by half the surge amplitude.

The position of the gauge in the flume is not known, so the phase of the motions relative to the waves is not
known either. The picture therefore shifts the computed motions, all by the same time, until a maximum of
heave coincides with a measured one.
"""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import BUDGET, Report, of_paddle, reference, solved
from jaxsph import analysis
from jaxsph.output.plot.style import BLUE, in_style

MOTIONS = {"heave": "m", "pitch": "rad", "surge": "m"}
"""Motions that were measured, with their units."""
BAR = {"heave": 10.0, "pitch": 15.0, "surge": 20.0}
"""Largest allowed error of the amplitudes of heave and pitch, and of the drift, %."""
SHOWN = 3
"""Number of periods in the picture."""

Series = tuple[np.ndarray, np.ndarray]
"""Times (s) and values (m or rad) of a motion or elevation."""


def whole(series: Series, T: float, periods: int) -> Series:
    """Samples of a series in its last `periods` whole periods T (s)."""
    t, y = series
    over = t > t[-1] - periods * T + 1e-9
    return t[over], y[over]


def half_range(series: Series, T: float) -> float:
    """Half the difference between the highest and the lowest value in a period T (s), averaged over all
    periods, m or rad."""
    t, y = series
    periods = round((t[-1] - t[0]) / T)
    back = np.minimum((t[-1] - t) / T, periods - 0.5).astype(int)
    return float(np.mean([0.5 * np.ptp(y[back == n]) for n in range(periods)]))


def measured(name: str) -> Series:
    """A measured series, sorted by time."""
    t, y = reference(f"box_in_waves_{name}.csv").T
    order = np.argsort(t)
    return t[order], y[order]


def main(dx: float = 0.01) -> None:
    """Runs or continues the case at the spacing dx (m)."""
    case = js.load_case("box_in_waves").replace({"dx": dx})
    file = solved(case, f"box_in_waves_{dx:g}")
    series, results = file.series(), file.results()
    T, periods = case.waves.T, round(results["periods"])
    here = {name: (series["time"], series[name]) for name in MOTIONS}
    flume = {name: measured(name) for name in (*MOTIONS, "elevation")}
    over = {name: whole(one, T, periods) for name, one in here.items()}
    taken = {name: whole(one, T, _periods(one[0], T)) for name, one in flume.items()}
    with Report(f"box_in_waves_{dx:g}", "Freely floating box in regular waves", dx) as report:
        report.seconds = results["wall_seconds"]
        for name in ("heave", "pitch"):
            found, theory = (half_range(one[name], T) for one in (over, taken))
            _compare(report, f"{name}: amplitude", found, MOTIONS[name], theory, BAR[name])
        found, theory = (T * analysis.drift_rate(*one["surge"], T) for one in (over, taken))
        _compare(report, "surge: drift per period", found, "m", theory, BAR["surge"])
        found, theory = (float(np.mean(one["pitch"][1])) for one in (over, taken))
        report.row("pitch: mean", found, "rad", theory=theory)
        report.row("incident height", results["incident_height"], "m", theory=case.waves.H)
        height = 2.0 * half_range(taken["elevation"], T)
        report.row("measured wave height at the gauge", height, "m", theory=case.waves.H)
        report.row("reflection", results["reflection"])
        report.row("periods averaged", periods)
        for energy, words in BUDGET.items():
            report.row(f"{words}, over the paddle's work", of_paddle(results, energy), "%")
        report.picture(_motions(here, flume, T))


def _periods(t: np.ndarray, T: float) -> int:
    """Number of whole periods T (s) in a record whose times t (s) are inaccurate by a few milliseconds."""
    return int((t[-1] - t[0]) / T + 0.01)


def _compare(report: Report, what: str, found: float, unit: str, theory: float, bar: float) -> None:
    """Reports a value, the measured value, and the relative error."""
    off = 100.0 * (found / theory - 1.0)
    report.row(what, found, unit, theory=theory, bar=f"within {bar:g} %", passes=abs(off) < bar)
    report.row("the same: deviation from the measurement", off, "%")


@in_style
def _motions(here: dict[str, Series], flume: dict[str, Series], T: float) -> Figure:
    """Figure of the last periods, starting at a maximum of heave.

    Surge is shifted so that a straight line fitted to it starts at zero.
    """
    figure = Figure(figsize=(7.0, 6.5), layout="constrained")
    axes = figure.subplots(len(MOTIONS), sharex=True)
    for label, series, style in (
        ("measured", flume, {"color": "k", "ls": "", "marker": "."}),
        ("computed", here, {"color": BLUE}),
    ):
        end = min(series[name][0][-1] for name in MOTIONS)
        heave = analysis.fundamental(*whole(series["heave"], T, SHOWN), T)
        first = -T / (2.0 * np.pi) * float(np.angle(heave))
        start = first + T * np.floor((end + 1e-6 - first) / T - SHOWN)
        for ax, (name, unit) in zip(axes, MOTIONS.items(), strict=True):
            t, y = series[name]
            over = (t >= start - 1e-6) & (t <= start + SHOWN * T + 1e-6)
            if name == "surge":
                rate = analysis.drift_rate(t[over], y[over], T)
                y = y - np.mean(y[over] - rate * (t[over] - start))
            ax.plot(t[over] - start, y[over], label=label, **style)
            ax.set(ylabel=f"{name}, {unit}")
    axes[0].legend()
    axes[-1].set_xlabel("t from a maximum of heave, s")
    return figure
