"""Height of the waves made by a piston, relative to Biesel's transfer function, for several strokes.

Biesel's theory is linear. Waves of finite height are lower than in this theory by a fraction proportional to
the square of their steepness. Therefore the limit at zero steepness is compared with the theory.
"""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import BUDGET, Report, of_paddle
from jaxsph import analysis
from jaxsph.waves import theory

DEPTH, STROKE, SHARES = 0.31, 0.0524, (0.25, 0.5, 1.0)
"""Depth and largest stroke, m; strokes of the runs as fractions of the largest stroke."""
ALONG = np.arange(1.0, 2.5, 0.2)
"""Positions of the gauges, in wavelengths from the paddle."""
RAMP, PERIODS, BAR = 3.0, 4, 0.01


def main(layers: int = 20, T: float = 1.0, strokes: int = 3) -> None:
    """Runs a piston of period T (s) with the `strokes` smallest strokes, in water `layers` spacings deep."""
    dx, k = DEPTH / layers, 2 * np.pi / float(theory.wavelength(T, DEPTH))
    transfer = float(theory.biesel(k, DEPTH))
    with Report(
        f"piston_{layers}_{T:g}", f"Waves of a piston against Biesel's theory, T = {T:g} s", dx
    ) as report:
        ratios, steepness = [], []
        for share in SHARES[:strokes]:
            run, height = made(dx, T, share * STROKE * transfer), share * STROKE * transfer
            first, second = (harmonics(run, T / n) for n in (1, 2))
            ratios.append(np.mean(first) / height)
            steepness.append(k * height / 2)
            where = f"stroke {1e3 * share * STROKE:.3g} mm, ka = {steepness[-1]:.2g}"
            report.row(f"{where}: wave height over that of Biesel's theory", ratios[-1], theory=1.0)
            report.row(f"{where}: spread of this ratio along the tank", np.std(first) / height, theory=0.0)
            report.row(
                f"{where}: height of the second harmonic over Biesel's height, mean along the tank",
                np.mean(second) / height,
            )
            lost = of_paddle(run.results, "hyperviscosity")
            report.row(f"{where}: {BUDGET['hyperviscosity']}, over the paddle's work", lost, "%", theory=0.0)
        slope, limit = np.polyfit(np.square(steepness), ratios, 1)
        off = abs(limit - 1)
        report.row("change of the ratio with the steepness squared", slope)
        report.row(
            "ratio extrapolated to zero steepness",
            limit,
            theory=1.0,
            bar=f"within {100 * BAR:g} %",
            passes=off < BAR,
        )
        figure = Figure(figsize=(5, 3.6), layout="constrained")
        axis = figure.subplots()
        axis.plot(np.square(steepness), ratios, "o")
        axis.plot([0.0, max(steepness) ** 2], [limit, limit + slope * max(steepness) ** 2], "--", lw=1)
        axis.set(xlabel="(ka)^2", ylabel="wave height over Biesel's", xlim=(0, None))
        report.picture(figure)


def made(dx: float, T: float, height: float) -> js.Solution:
    """Runs a tank of five wavelengths until waves of this height (m) have passed all gauges."""
    length = float(theory.wavelength(T, DEPTH))
    speed = float(theory.group_velocity(2 * np.pi / T, DEPTH))
    changes = {
        "dx": dx,
        "scheme.kind": "incompressible",
        "tank.depth": DEPTH,
        "tank.length": round(5 * length / dx) * dx,
        "sponge.length": length,
        "waves.T": T,
        "waves.H": height,
        "waves.second_order": False,
        "waves.absorption": False,
        "waves.ramp_periods": RAMP,
        "probes.gauges": [float(at) for at in np.round(ALONG * length, 3)],
        "t1": round((RAMP + PERIODS + 2) * T + ALONG[-1] * length / speed, 1),
    }
    return js.run(js.load_case("wave_tank").replace(changes), progress=False)


def harmonics(run: js.Solution, T: float) -> np.ndarray:
    """Heights (m) of waves of period T (s) at all gauges, over the last periods."""
    t, eta = run.t, run["eta"]
    last = t > t[-1] - PERIODS * run.case.waves.T + 1e-6
    return np.array([2 * abs(analysis.fundamental(t[last], at[last], T)) for at in eta.T])
