"""Water at rest: pressure against rho g d, and largest speed, in 2-D and 3-D and in both precisions."""

from __future__ import annotations

import jax
import numpy as np

import jaxsph as js
from experiments.common import Report

DEPTH, G, RHO = 1.0, 9.81, 1000.0


def main(layers: int = 40, layers_3d: int = 20, t1: float = 5.0) -> None:
    """Runs a square tank `layers` spacings deep, and in 3-D a column of 10 x 5 x `layers_3d` spacings."""
    jax.config.update("jax_enable_x64", True)
    flat = {"dx": DEPTH / layers, "output.sample_dt": 0.05}
    deep = {
        "dx": DEPTH / layers_3d,
        "tank.length": 10 * DEPTH / layers_3d,
        "tank.width": 5 * DEPTH / layers_3d,
        "probes.pressure": None,
        "output.sample_dt": 0.05,
    }
    with Report("hydrostatic", f"Water at rest for {t1:g} s", DEPTH / layers) as report:
        for name, changes in (("2-D", flat), ("3-D", deep)):
            for precision in ("float32", "float64"):
                case = js.load_case("hydrostatic").replace(changes | {"precision": precision})
                error, speed = errors(js.run(case, t1=t1, progress=False))
                label = f"{name}, dx = d/{round(DEPTH / case.dx)}, {precision}"
                report.row(
                    f"{label}: RMS pressure error / rho g d",
                    100 * error,
                    "%",
                    theory=0.0,
                    bar="< 1 %",
                    passes=error < 0.01,
                )
                report.row(
                    f"{label}: max |u| / sqrt(g d) after 3 s",
                    100 * speed,
                    "%",
                    theory=0.0,
                    bar="< 1 %",
                    passes=speed < 0.01,
                )


def errors(solution: js.Solution) -> tuple[float, float]:
    """RMS error of the final pressure divided by rho g d; largest speed after 3 s divided by sqrt(g d)."""
    p = solution.state.particles
    pressure = np.asarray(p.rho, np.float64) * float(solution.model.scheme.c0) ** 2
    error = pressure - RHO * G * (DEPTH - np.asarray(p.x, np.float64)[:, -1])
    late = solution["max_speed"][solution.t >= min(3.0, 0.6 * solution.t[-1])]
    return float(np.sqrt(np.mean(error**2)) / (RHO * G * DEPTH)), float(np.max(late) / np.sqrt(G * DEPTH))
