"""Effect of the abrupt switches between a thin wall's regions on exact slopes.

The exact slope is compared with that of a parabola fitted to the energies absorbed in many runs. These
energies include the effect of every switch. The OWC is in a tank 1.2 m long, and the runs last one and a half
wave periods. With a front wall one spacing thick, the ghosts and particles that interact with a particle
change abruptly when the particle passes the level of the tip. With a wall four spacings thick these ghosts
and particles hardly change.

The comparison can reveal only errors of the exact slope that are larger than the standard error of the
parabola's slope. Once the motion is chaotic, the energies of runs whose dampings differ by a thousandth
differ by a few per cent. The scatter of the runs about the parabola is therefore reported, and the slopes
are compared before and after the onset of chaos.
"""

from __future__ import annotations

import numpy as np

import jaxsph as js
from experiments.common import Report
from experiments.owc_tank import short_case
from jaxsph.study.ensemble import parabola

MEMBERS, SPREAD = 31, 0.15
TIMES = (1.5, 1.8)
"""Times up to which the energy absorbed is compared, s."""


def main(dx: float = 0.02) -> None:
    """Computes the slopes, with respect to K_dm, of the energy absorbed in 1.5 and in 1.8 s."""
    with Report(
        f"switch_study_{dx:g}", "Exact slope with respect to K_dm against a fit to runs", dx
    ) as report:
        for layers in (1, 4):
            case = short_case(dx, max(TIMES)).replace({"device.wall_thickness": layers * dx})
            name = f"wall {layers} dx thick"
            offsets = SPREAD * np.linspace(-1.0, 1.0, MEMBERS)
            K = case.pto.K_dm
            energies = [energy(case.replace({"pto.K_dm": K * (1 + a)})) for a in offsets]
            for t1, of_runs in zip(TIMES, np.transpose(energies), strict=True):
                at = case.replace({"t1": t1})
                exact = js.derivative(at, "pto.K_dm", "energy_pto", js.Exact(0.0), progress=False)
                fit = parabola(K * offsets, of_runs)
                until = f"{name}, {t1:g} s"
                excess = 100 * (exact.slope / fit.slope - 1)
                report.row(
                    f"{until}: relative difference of the exact slope from that of {MEMBERS} runs",
                    excess,
                    "%",
                )
                report.row(
                    f"{until}: standard error of the relative difference", 100 * fit.error / fit.slope, "%"
                )
                # the offsets are symmetric, so that the variance of the slope is scatter^2 / sum (K a)^2
                scatter = fit.error * np.linalg.norm(K * offsets)
                report.row(
                    f"{until}: relative scatter of the energies about the parabola",
                    100 * scatter / fit.value,
                    "%",
                )


def energy(case: js.Case) -> list[float]:
    """Energy absorbed until each of `TIMES`, J/m."""
    solution = js.run(case, progress=False)
    absorbed = np.cumsum(solution["power_pto"]) * case.output.sample_dt
    return [float(absorbed[round(t1 / case.output.sample_dt) - 1]) for t1 in TIMES]
