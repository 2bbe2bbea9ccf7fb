"""The OWC in waves of small amplitude against linear theory: efficiency and chamber pressure.

The waves have H/d = 0.02 over a flat bed, with four frequencies around resonance; there are two dampings, and
the wall is one spacing thick at dx = 0.01 and 0.02 m. The best K_dm is larger in lower waves: 960 here
corresponds to 440 in waves 0.04 m high.
"""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import Report
from experiments.owc_tank import amplitude, study_case, swept

PERIODS = (1.0, 1.1, 1.2, 1.4)
DAMPINGS = (960.0, 2000.0)
HEIGHT, WALL = 0.0084, 0.01
"""Height of the waves and least thickness of the wall, m: a plate thinner than a spacing has a noisy tip."""


def main(dx: float = 0.01) -> None:
    """Runs or continues the eight members at the spacing dx (m)."""
    case = study_case(dx, 10.0).replace(
        {
            "tank.length": 3.0,
            "probes.gauges": [0.8, 1.2, 1.5, 1.9],
            "waves.H": HEIGHT,
            "device.wall_thickness": max(WALL, dx),
        }
    )
    over = {"pto.K_dm": list(DAMPINGS), "waves.T": list(PERIODS)}
    study = swept(case, over, f"small_waves_{dx:g}")
    theory = [[js.linear_owc(case.replace({"pto.K_dm": K, "waves.T": T})) for T in PERIODS] for K in DAMPINGS]
    title = f"The OWC in waves {1e3 * HEIGHT:g} mm high against linear theory"
    pressure = np.full(study["xi"].shape, np.nan)
    with Report(f"small_waves_{dx:g}", title, dx) as report:
        report.seconds = float(np.nansum(study["wall_seconds"]))
        for i, K in enumerate(DAMPINGS):
            for j, T in enumerate(PERIODS):
                linear = theory[i][j]
                if (i, j) not in study.failures:
                    pressure[i, j] = amplitude(study.members[i, j], "P_a", T)
                where = f"K_dm = {K:g}, Kh = {linear.Kh:.2f}"
                for name, here, expected, unit in (
                    ("xi", study["xi"][i, j], linear.xi, ""),
                    ("P_a amplitude", pressure[i, j], abs(linear.P_a), "Pa"),
                ):
                    off = abs(here / expected - 1)
                    report.row(
                        f"{name} at {where}", here, unit, theory=expected, bar="within 10 %", passes=off < 0.1
                    )
        report.row("largest scatter of xi from period to period", np.nanmax(study["xi_scatter"]))
        share = study["energy_hyperviscosity"] / study["energy_pto"]
        report.row(
            "energy lost by hyperviscosity over the absorbed energy, median", np.nanmedian(share), theory=0.0
        )
        report.picture(_picture(study["xi"], pressure, theory))


def _picture(xi: np.ndarray, pressure: np.ndarray, theory: list) -> Figure:
    figure = Figure(figsize=(9, 4), layout="constrained")
    axes = figure.subplots(1, 2)
    Kh = [linear.Kh for linear in theory[0]]
    for i, K in enumerate(DAMPINGS):
        for axis, values, expected in (
            (axes[0], xi[i], [linear.xi for linear in theory[i]]),
            (axes[1], pressure[i], [abs(linear.P_a) for linear in theory[i]]),
        ):
            axis.plot(Kh, values, "o", color=f"C{i}", label=f"K_dm = {K:g}")
            axis.plot(Kh, expected, "--", color=f"C{i}", lw=1)
    axes[0].set(xlabel="Kh", ylabel="efficiency xi", ylim=(0, 1), title="SPH; linear theory dashed")
    axes[1].set(xlabel="Kh", ylabel="chamber pressure amplitude, Pa", ylim=(0, None))
    axes[0].legend()
    return figure
