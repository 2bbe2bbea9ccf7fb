"""Section 4.3: the OWC with regional ghosts and, on a lattice fine enough for them, with multi-node ghosts.

The waves are the paper's, H = 0.04 m and T = 1.4 s, in a tank 4 m long. The measured series of Fig. 16 are
not available, so the two methods are compared with each other and with linear theory.
"""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import Report, solved
from experiments.owc_tank import amplitude, study_case
from jaxsph import analysis

PERIOD = 1.4
PAPER_COST = 245.2 / 36.1
"""Wall time with multi-node over that with regional ghosts in the paper: 245.2 and 36.1 h for 21 s (table
1)."""


def main(coarse: float = 0.01, fine: float = 0.005, t1: float = 12.8) -> None:
    """Runs both methods to t1 (s) and reports their difference, the order of events and the cost."""
    base = study_case(coarse, t1).replace({"waves.T": PERIOD})
    linear = js.linear_owc(base)
    runs, cost, seconds = {}, {}, 0.0
    for method, dx in (("regional", coarse), ("multi_node", fine)):
        case = base.replace({"dx": dx, "device.thin_wall": method})
        file = solved(case, f"owc_{method}_{dx:g}")
        runs[method] = file.series()
        results = file.results()
        particles = len(file.snapshot(-1)["x"])
        seconds += results["wall_seconds"]
        cost[method] = particles * results["steps"] / results["particle_steps_per_second"]
    title = f"The OWC with regional ghosts (dx = {coarse:g} m) and multi-node ghosts (dx = {fine:g} m)"
    with Report("owc_methods", title, coarse) as report:
        report.seconds = seconds
        periods = int((t1 - 6.0) / PERIOD)
        for name, label, expected in (
            ("chamber_level", "level", abs(linear.level)),
            ("P_a", "pressure", abs(linear.P_a)),
        ):
            a, b = runs["regional"], runs["multi_node"]
            last = analysis.whole_periods(a["time"], PERIOD, periods)
            pair = (a["time"][last], a[name][last], b["time"][last], b[name][last])
            height = amplitude(b, name, PERIOD, periods)
            mae = 100 * analysis.mae_amplitude(*pair, height, PERIOD, window=5)
            phase = 100 * analysis.mae_phase(*pair, PERIOD, window=5)
            report.row(f"MAE_a of the {label} between the two methods", mae, "%", theory=0.0)
            report.row(f"MAE_p of the {label} between the two methods", phase, "%", theory=0.0)
            unit = "m" if name == "chamber_level" else "Pa"
            for method, series in runs.items():
                found = amplitude(series, name, PERIOD, periods)
                report.row(f"{label} amplitude, {method}", found, unit, theory=expected)
        for method, series in runs.items():
            for event, (when, published) in events(series, periods).items():
                report.row(f"time from the lowest level to the {event}, {method}", when, "T", paper=published)
        ratio = cost["multi_node"] / cost["regional"]
        report.row("wall time, multi-node / regional", ratio, paper=PAPER_COST)
        report.picture(_picture(runs, t1, periods))


def events(series: dict[str, np.ndarray], periods: int) -> dict[str, tuple[float, float]]:
    """Times of events in the cycle (periods after the lowest level), here and in the paper's Fig. 17.

    The times are taken from the mean cycle of level and power, represented by four harmonics.
    """
    last = analysis.whole_periods(series["time"], PERIOD, periods)
    t = series["time"][last]
    fine = np.linspace(0.0, 1.0, 1000, endpoint=False)

    def cycle(name: str) -> np.ndarray:
        y = series[name][last]
        total = np.full(fine.shape, np.mean(y))
        for n in range(1, 5):
            c = 2 * np.mean(y * np.exp(-2j * np.pi * n * t / PERIOD))
            total += np.real(c * np.exp(2j * np.pi * n * fine))
        return total

    level, power = cycle("chamber_level"), cycle("power_pto")
    start = int(np.argmin(level))
    level, power = np.roll(level, -start), np.roll(power, -start)
    top = int(np.argmax(level))
    return {
        "largest power at a rising level": (fine[int(np.argmax(power[:top]))], 0.25),
        "highest level": (fine[top], 0.5),
        "largest power at a falling level": (fine[top + int(np.argmax(power[top:]))], 0.75),
    }


def _picture(runs: dict[str, dict[str, np.ndarray]], t1: float, periods: int) -> Figure:
    figure = Figure(figsize=(9, 6), layout="constrained")
    axes = figure.subplots(3, 1, sharex=True)
    for method, series in runs.items():
        t = series["time"]
        shown = t > t1 - min(periods, 3) * PERIOD
        for axis, name, scale, label in (
            (axes[0], "chamber_level", 1e3, "level, mm"),
            (axes[1], "P_a", 1.0, "P_a, Pa"),
            (axes[2], "power_pto", 1.0, "power, W/m"),
        ):
            axis.plot(t[shown] / PERIOD, scale * series[name][shown], label=method)
            axis.set_ylabel(label)
    axes[0].legend()
    axes[2].set_xlabel("t / T")
    return figure
