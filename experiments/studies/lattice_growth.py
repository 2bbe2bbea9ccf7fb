"""Growth of exact slopes in still water, where rows of the square lattice slide over each other on the bed.

The OWC is in a tank 2 m long, and the waves have not arrived. At first only the small motions of the water in
the chamber depend on K_dm.
"""

from __future__ import annotations

import numpy as np

import jaxsph as js
from experiments.common import Report


def main(dx: float = 0.02, t1: float = 1.8) -> None:
    """Computes the exact slope in nearly still water for two smoothing lengths."""
    with Report(f"lattice_growth_{dx:g}", "Growth of exact slopes in still water", dx) as report:
        for h in (1.2, 1.3):
            case = js.load_case("owc").replace(
                {
                    "dx": dx,
                    "t1": t1,
                    "tank.length": 2.0,
                    "probes.gauges": [0.5],
                    "probes.pressure": None,
                    "scheme.kind": "weakly_compressible",
                    "scheme.h_over_dx": h,
                    "output.snapshot_dt": 0.1,
                }
            )
            found = js.derivative(case, "pto.K_dm", "energy_pto", js.Exact(0.0), progress=False)
            t, grain = found.series["time"], found.slopes["grain"]
            late = t > t1 - 0.8
            rate = np.polyfit(t[late], np.log(grain[late]), 1)[0]
            report.row(
                f"h = {h:g} dx: e-folding time of the difference between neighbours' slopes", 1 / rate, "s"
            )
