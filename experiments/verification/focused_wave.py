"""Focused wave: position, time and height of its crest against second-order theory."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import Report, solved
from jaxsph.case.geometry import Geometry
from jaxsph.waves import second_order

CREST, TP, D = 0.06, 1.4, 0.5
X, TIME = 4.0, 14.0
GAUGES = tuple(float(x) for x in np.round(np.arange(3.4, 4.61, 0.05), 3))


def main(dx: float = 0.02) -> None:
    """Runs the wave group and reports position, time and height of its highest crest."""
    case = js.Case.from_dict(
        {
            "name": "focused_wave",
            "dx": dx,
            "t1": TIME + 2.0 * TP,
            "tank": {"length": 9.0, "depth": D},
            "scheme": {"kind": "incompressible"},
            "waves": {"kind": "focused", "crest": CREST, "Tp": TP, "x": X, "t": TIME},
            "sponge": {"length": 3.0},
            "probes": {"gauges": list(GAUGES)},
            "output": {"snapshot_dt": 1.0},
        }
    )
    file = solved(case, f"focused_wave_{dx:g}")
    series = file.series()
    t, eta = series["time"], np.float64(series["eta"])
    expected = asked(case, t)
    near = np.abs(t - TIME) < TP
    # the crest of the envelope moves with the group: take the highest crest at any gauge
    when, where, top = highest(t[near], np.array(GAUGES), eta[near])
    when2, where2, top2 = highest(t[near], np.array(GAUGES), expected[near])
    trough = expected[near][:, np.argmin(np.abs(np.array(GAUGES) - X))].min()
    length = 2.0 * np.pi / second_order.wavenumbers(np.array(2.0 * np.pi / TP), D, 9.81)
    with Report(f"focused_wave_{dx:g}", "Focused wave", dx) as report:
        report.seconds = file.results()["wall_seconds"]
        off = abs(where - X) / length
        report.row(
            "position of the crest",
            where,
            "m",
            theory=where2,
            bar="3 % of a wavelength from 4 m",
            passes=off < 0.03,
        )
        off = abs(when - TIME) / TP
        report.row(
            "time of the crest", when, "s", theory=when2, bar="3 % of a period from 14 s", passes=off < 0.03
        )
        off = abs(top - top2) / (top2 - trough)
        report.row(
            "height of the crest", top, "m", theory=top2, bar="5 % of the wave height", passes=off < 0.05
        )
        report.row("height of the crest by linear theory", CREST, "m")
        report.picture(_picture(t, eta, expected))


def asked(case: js.Case, t: np.ndarray) -> np.ndarray:
    """Elevations (m) of the specified group at the gauges to second order, `[times, gauges]`."""
    depth = Geometry.of(case).depth
    a, omega = case.waves.sum_of_waves(depth, case.g)
    k = second_order.wavenumbers(omega, depth, case.g)
    found = []
    for x in GAUGES:
        first = second_order.Harmonics(a * np.exp(-1j * k * x), omega, k)
        found.append(first.at(t) + second_order.second_order_elevation(a, omega, depth, x, case.g).at(t))
    return np.stack(found, axis=1)


def highest(t: np.ndarray, x: np.ndarray, eta: np.ndarray) -> tuple[float, float, float]:
    """Time (s), position (m) and elevation (m) of the highest crest, by parabolas fitted around it."""
    i, j = np.unravel_index(np.argmax(eta), eta.shape)
    i, j = np.clip(i, 1, len(t) - 2), np.clip(j, 2, len(x) - 3)
    at = np.polyfit(t[i - 5 : i + 6] - t[i], eta[i - 5 : i + 6, j], 2)
    when = t[i] - 0.5 * at[1] / at[0]
    tops = eta[i - 8 : i + 9, max(j - 6, 0) : j + 7].max(axis=0)
    along = np.polyfit(x[max(j - 6, 0) : j + 7] - x[j], tops, 2)
    where = x[j] - 0.5 * along[1] / along[0]
    return float(when), float(where), float(np.polyval(at, when - t[i]))


def _picture(t: np.ndarray, eta: np.ndarray, expected: np.ndarray) -> Figure:
    figure = Figure(figsize=(9, 4), layout="constrained")
    axis = figure.subplots()
    j, near = int(np.argmin(np.abs(np.array(GAUGES) - X))), np.abs(t - TIME) < 2.0 * TP
    axis.plot(t[near], 1e3 * eta[near, j], label="here")
    axis.plot(t[near], 1e3 * expected[near, j], "k--", label="second order")
    axis.set(xlabel="t, s", ylabel=f"eta at x = {X:g} m, mm")
    axis.legend()
    return figure
