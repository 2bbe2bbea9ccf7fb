"""What waves high for their depth lose by time step and spacing: those of `flap_3d`, without the flap.

Waves of 0.15 m, T = 1.34 s, on 0.36 m of water, in two dimensions, incompressible.
"""

from __future__ import annotations

import jaxsph as js
from experiments.common import Report, of_paddle

RUNS = ((0.04, 0.25), (0.04, 0.12), (0.04, 0.06), (0.02, 0.25))
"""Spacings (m) and Courant numbers of the runs."""


def main() -> None:
    """Runs the tank with three Courant numbers, and with half the spacing."""
    case = js.load_case("flap_3d").replace({"tank.width": None, "body": None, "probes.surface": None})
    with Report("high_waves", "Waves high for their depth by time step and spacing") as report:
        for dx, cfl in RUNS:
            run = js.run(case.replace({"dx": dx, "scheme.cfl": cfl}), progress=False)
            results, label = run.results, f"dx = {dx:g} m, cfl = {cfl:g}"
            for name in ("projection", "hyperviscosity"):
                report.row(
                    f"{label}: {name}, of the paddle's work", of_paddle(results, name), "%", theory=0.0
                )
            report.row(f"{label}: incident height", results["incident_height"], "m", theory=case.waves.H)
            report.row(f"{label}: noise over speed", results["noise"], theory=0.0)
            report.row(f"{label}: time step", 1e3 * float(run.model.dt), "ms")
