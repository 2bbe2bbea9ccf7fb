"""Energy losses of waves that are high for their depth, by time step, relaxation and spacing.

The case is `flap_3d` without its flap. The waves are 0.15 m high with T = 1.34 s in 0.36 m of water, in
two dimensions, incompressible.
"""

from __future__ import annotations

import jaxsph as js
from experiments.common import BUDGET, Report, of_paddle
from jaxsph.schemes.projection import RELAXATION

RUNS = (
    (0.04, 0.25, RELAXATION),
    (0.04, 0.12, RELAXATION),
    (0.04, 0.06, RELAXATION),
    (0.04, 0.06, RELAXATION / 2),
    (0.04, 0.12, 2 * RELAXATION),
    (0.02, 0.25, RELAXATION),
)
"""Spacing (m), Courant number, and rate of spreading crowded particles (over sqrt(g/h)), of each run."""


def main() -> None:
    """Runs the tank with three Courant numbers, two other relaxation rates, and half the spacing."""
    case = js.load_case("flap_3d").replace({"tank.width": None, "body": None, "probes.surface": None})
    with Report("high_waves", "High waves in shallow water by time step, relaxation and spacing") as report:
        for dx, cfl, relaxation in RUNS:
            changes = {"dx": dx, "scheme.cfl": cfl, "scheme.relaxation": relaxation}
            run = js.run(case.replace(changes), progress=False)
            results, label = run.results, f"dx = {dx:g} m, cfl = {cfl:g}, relaxation = {relaxation:g}"
            for name in ("projection", "hyperviscosity"):
                report.row(
                    f"{label}: {BUDGET[name]}, over the paddle's work",
                    of_paddle(results, name),
                    "%",
                    theory=0.0,
                )
            report.row(f"{label}: incident height", results["incident_height"], "m", theory=case.waves.H)
            report.row(f"{label}: noise over speed", results["noise"], theory=0.0)
            report.row(f"{label}: time step", 1e3 * float(run.model.dt), "ms")
