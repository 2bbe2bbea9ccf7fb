"""Effect of the abrupt switches between a thin wall's regions on exact slopes.

The exact slope is compared with that of a parabola fitted to several runs, before the flow becomes chaotic.
The OWC stands in a tank of 1.2 m and runs for one and a half wave periods. With a front wall of one spacing,
the ghosts and particles that interact with a particle change abruptly when the particle passes the level of
the tip. With a wall of four spacings they hardly change.
"""

from __future__ import annotations

import numpy as np

import jaxsph as js
from experiments.common import Report
from experiments.owc_tank import short_case
from jaxsph.study.ensemble import parabola

MEMBERS, SPREAD = 7, 0.1


def main(dx: float = 0.02) -> None:
    """Computes the slopes over K_dm of the energy absorbed in 1.8 s."""
    with Report(f"switch_study_{dx:g}", "Exact slope over K_dm against differences, 1.8 s", dx) as report:
        for layers in (1, 4):
            case = short_case(dx, 1.8).replace({"device.wall_thickness": layers * dx})
            exact = js.derivative(case, "pto.K_dm", "energy_pto", js.Exact(0.0), progress=False)
            offsets = SPREAD * np.linspace(-1.0, 1.0, MEMBERS)
            K = case.pto.K_dm
            energies = np.array([energy(case.replace({"pto.K_dm": K * (1 + a)})) for a in offsets])
            fit = parabola(K * offsets, energies)
            name = f"wall of {layers} spacings" if layers > 1 else "wall of one spacing"
            report.row(
                f"{name}: exact slope over that of {MEMBERS} runs, less 1",
                100 * (exact.slope / fit.slope - 1),
                "%",
            )
            report.row(f"{name}: standard error of that", 100 * fit.error / fit.slope, "%")


def energy(case: js.Case) -> float:
    """Energy absorbed until t1, J/m."""
    solution = js.run(case, progress=False)
    last = round(case.t1 / case.output.sample_dt)
    return float(solution["power_pto"][:last].sum() * case.output.sample_dt)
