"""Sphere released in heave, in three dimensions: turning points against experiments and other codes.

The sphere of Kramer et al. 2021 (Energies 14, 269; diameter 0.3 m) is half immersed at its equilibrium and is
released from a position a tenth of its diameter higher. The basin here is smaller than that of the
experiments. Waves of the sphere's natural period return from the walls after the record has ended, but long
waves reach the walls within a period, so that the mean level rises as the sphere sinks; this rise is
reported. The four turning points are also compared with those that Reynolds-averaged Navier-Stokes codes
found for a sphere of radius 5 m in the sphere task of IEA OES, scaled by Froude's law.
"""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import curve_fit

import jaxsph as js
from experiments.common import Report, solved
from experiments.validation.heave import extremes

PERIOD = 0.7561
"""Natural period of the small sphere in the experiments, s."""
MEASURED = {"first trough": (0.5105, -0.8535), "first peak": (None, 0.630)}
"""Turning points of the experiments: time from the release over `PERIOD` (-), height over that at the
release (-)."""
CODES = ((2.23, -0.8686), (4.45, 0.6368), (6.63, -0.4694), (8.81, 0.3490))
"""Times (s) and heights (m) of the turning points of the sphere of radius 5 m, released 1 m above
equilibrium."""
SCALE = 5.0 / 0.15
"""Ratio of the two spheres' radii (-)."""
BARS = {"first trough": 0.03, "first peak": 0.05}
"""Largest allowed relative errors of the heights (-)."""


def main(dx: float = 0.025) -> None:
    """Runs the built-in case and compares the turning points of the sphere."""
    with Report(f"sphere_decay_{dx:g}", "Sphere released in heave, 3-D", dx) as report:
        case = js.load_case("sphere_decay").replace({"dx": dx})
        file = solved(case, f"sphere_decay_{dx:g}")
        report.seconds = file.results()["wall_seconds"]
        series = file.series()
        lift = case.body.sphere.centre[2] - case.tank.depth
        free = series["time"] >= case.body.release - 1e-6
        t, z = series["time"][free] - case.body.release, lift + series["heave"][free]
        times, heights = extremes(t, z, count=len(CODES))
        _measured(report, times, heights / lift)
        _swings(report, heights / lift)
        _codes(report, times, heights / lift)
        level = oscillation_level(t[t > times[1]], z[t > times[1]])
        report.row(
            "level about which the sphere oscillates after the first trough", level / dx, "dx", theory=0.0
        )
        sunk = np.pi * case.body.sphere.radius**2 * lift
        plan = case.tank.length * case.tank.width - np.pi * case.body.sphere.radius**2
        report.row("rise of the basin's mean level between release and equilibrium", sunk / plan / dx, "dx")
        still = float(np.max(series["max_speed"][~free]))
        report.row("largest speed while the water settles", still, "m/s", theory=0.0)
        report.picture(_picture(t, z / lift))


def oscillation_level(t: np.ndarray, z: np.ndarray) -> float:
    """Level (m) about which a record z (m) at times t (s) oscillates, by a fit of a damped oscillation."""

    def damped(t, level, c, s, decay, omega):
        return level + np.exp(-decay * t) * (c * np.cos(omega * t) + s * np.sin(omega * t))

    start = t - t[0]
    guess = (0.0, z[0], 0.0, 0.5, 2.0 * np.pi / PERIOD)
    return float(curve_fit(damped, start, z, guess)[0][0])


def _measured(report: Report, times: np.ndarray, heights: np.ndarray) -> None:
    """Reports the first trough and peak against the experiments."""
    for n, (name, (at, height)) in enumerate(MEASURED.items(), 1):
        off = heights[n] / height - 1.0
        report.row(
            f"{name}: height over that at the release",
            heights[n],
            paper=height,
            bar=f"within {100 * BARS[name]:g} %",
            passes=abs(off) < BARS[name],
        )
        report.row("the same: relative error", 100 * off, "%")
        if at is not None:
            late = times[n] / PERIOD / at - 1.0
            report.row(
                "the same: time over the natural period",
                times[n] / PERIOD,
                paper=at,
                bar="within 2 %",
                passes=abs(late) < 0.02,
            )


def _swings(report: Report, heights: np.ndarray) -> None:
    """Reports the ratio of the second swing to the first, which does not depend on the equilibrium level."""
    swings = np.abs(np.diff(heights))
    trough, peak = (height for _, height in MEASURED.values())
    there = (peak - trough) / (1.0 - trough)
    off = swings[1] / swings[0] / there - 1.0
    report.row(
        "displacement during the second swing over that during the first",
        float(swings[1] / swings[0]),
        paper=there,
        bar="within 3 %",
        passes=abs(off) < 0.03,
    )
    report.row("the same: relative error", 100 * off, "%")


def _codes(report: Report, times: np.ndarray, heights: np.ndarray) -> None:
    """Reports all turning points against those of the other codes, as shares of the height at the release."""
    for n, (at, height) in enumerate(CODES, 1):
        off = heights[n] - height
        report.row(
            f"turning point {n}: difference of the height from other codes, over that at the release",
            100 * off,
            "%",
            bar="5 %",
            passes=abs(off) < 0.05,
        )
        report.row(
            "the same: time, over that of other codes", float(times[n] * np.sqrt(SCALE) / at), theory=1.0
        )


def _picture(t: np.ndarray, z: np.ndarray) -> Figure:
    """Draws the height of the sphere over time, with the turning points of experiments and other codes."""
    figure = Figure(figsize=(7, 4), layout="constrained")
    ax = figure.subplots()
    ax.plot(t / PERIOD, z, label="here")
    at, height = np.array(CODES).T
    ax.plot(at / np.sqrt(SCALE) / PERIOD, height, "kx", label="Navier-Stokes codes, IEA OES")
    ax.plot(*MEASURED["first trough"], "o", mfc="none", color="C3", label="experiments, Kramer et al. 2021")
    ax.axhline(MEASURED["first peak"][1], color="C3", lw=0.8, ls=":")
    ax.set(xlabel="time from the release, in natural periods", ylabel="height over that at the release")
    ax.legend(fontsize="small")
    return figure
