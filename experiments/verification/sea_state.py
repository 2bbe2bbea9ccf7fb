"""A JONSWAP sea of 100 waves against its spectrum, and a recorded series reproduced at a gauge."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import Report, solved
from jaxsph import analysis
from jaxsph.waves import second_order, spectra

HS, TP, D = 0.04, 1.4, 0.5
WAVES = 100
GAUGES = (2.6, 2.8, 3.1, 3.5, 4.0)
"""Positions of the gauges, m: in the middle of the 7 m of flume in front of the sponge."""
START = 15.0
"""Time at which the shortest relevant waves have reached the gauges, s."""
BANDS = 8
"""Number of neighbouring frequencies averaged for each value of the spectrum."""


def main(dx: float = 0.02) -> None:
    """Runs the irregular sea and the recorded waves; finished runs are read from their files."""
    duration = WAVES * TP
    base = {
        "dx": dx,
        "tank": {"length": 10.0, "depth": D},
        "scheme": {"kind": "incompressible"},
        "sponge": {"length": 3.0},
        "output": {"sample_dt": 0.02, "snapshot_dt": 20.0},
    }
    sea = {"kind": "irregular", "Hs": HS, "Tp": TP, "duration": duration, "seed": 1}
    case = js.Case.from_dict(
        base | {"name": "sea_state", "t1": START + duration, "waves": sea, "probes": {"gauges": list(GAUGES)}}
    )
    t, asked = _series()
    record = {"kind": "recorded", "t": list(t), "eta": list(asked), "x": GAUGES[2]}
    again = js.Case.from_dict(
        base | {"name": "sea_record", "t1": 45.0, "waves": record, "probes": {"gauges": [GAUGES[2]]}}
    )
    file, other = solved(case, f"sea_state_{dx:g}"), solved(again, f"sea_record_{dx:g}")
    with Report(f"sea_state_{dx:g}", "A JONSWAP sea of 100 waves, and a recorded series", dx) as report:
        report.seconds = sum(one.results()["wall_seconds"] for one in (file, other))
        sea = incident_sea(file.series(), duration)
        S = sea.incident
        height = S.Hm0
        report.row(
            "significant wave height", height, "m", theory=HS, bar="5 %", passes=abs(height / HS - 1) < 0.05
        )
        report.row("peak period", S.Tp, "s", theory=TP, bar="3 %", passes=abs(S.Tp / TP - 1) < 0.03)
        # the target is averaged over each band of frequencies, because a band is as wide as the peak
        within = (np.arange(BANDS) - 0.5 * (BANDS - 1)) / duration
        expected = spectra.JONSWAP(HS, TP).density(S.f[:, None] + within).mean(axis=1)
        low, high = S.band(0.9)
        among = (S.f > 0.6 / TP) & (S.f < 2.0 / TP)
        inside = float(np.mean(((low < expected) & (expected < high))[among]))
        report.row(
            "share of the frequency bins from 0.6 to 2 fp in which the 90 % band of the measured spectrum "
            "contains the target",
            inside,
            bar="0.9",
            passes=inside >= 0.9,
        )
        report.row("reflection", sea.coefficient, bar="0.1", passes=sea.coefficient < 0.1)
        series = other.series()
        there = np.interp(series["time"], t, asked)
        later = series["time"] > 12.0
        same = float(np.corrcoef(there[later], series["eta"][later, 0])[0, 1])
        report.row(
            "recorded series: correlation with the specified elevation", same, bar="0.97", passes=same > 0.97
        )
        ratio = float(np.std(series["eta"][later, 0]) / np.std(there[later]))
        report.row("recorded series: standard deviation over the specified value", ratio)
        report.picture(
            _picture((S.f, S.S, low, high, expected), (series["time"], there, series["eta"][:, 0]))
        )


def _series() -> tuple[np.ndarray, np.ndarray]:
    """Times (s) and elevations (m) of a sea with Bretschneider's spectrum, like a record of a gauge."""
    a, omega = spectra.draw_sea(spectra.Bretschneider(0.05, 1.5), 60.0, 7)
    t = np.arange(0.0, 60.0, 0.05)
    return t.round(6), second_order.Harmonics(a, omega, omega).at(t).round(6)


def incident_sea(series: dict[str, np.ndarray], duration: float) -> analysis.TwoWaySea:
    """Incident and reflected sea at the gauges over one repeat period."""
    t = series["time"]
    last = t > t[-1] - duration + 1e-6
    eta, x = np.float64(series["eta"][last]).T, np.array(GAUGES)
    return analysis.two_way_sea(eta, x, t[last], D, f=(0.4 / TP, 3.0 / TP), bands=BANDS)


def _picture(spectrum: tuple, series: tuple) -> Figure:
    f, S, low, high, expected = spectrum
    figure = Figure(figsize=(10, 4), layout="constrained")
    left, right = figure.subplots(1, 2)
    shown = (f > 0.3 / TP) & (f < 3.0 / TP)
    left.fill_between(f[shown], 1e4 * low[shown], 1e4 * high[shown], alpha=0.3, label="90 % band")
    left.plot(f[shown], 1e4 * S[shown], label="incident, here")
    left.plot(f[shown], 1e4 * expected[shown], "k--", label="JONSWAP")
    left.set(xlabel="f, Hz", ylabel="S, cm2/Hz")
    left.legend()
    t, asked, found = series
    some = (t > 20.0) & (t < 32.0)
    right.plot(t[some], 1e3 * asked[some], "k--", label="recorded")
    right.plot(t[some], 1e3 * found[some], label="here")
    right.set(xlabel="t, s", ylabel="eta, mm")
    right.legend()
    return figure
