"""Water at rest: its pressure against rho g d and how quiet it stays, in 2-D and 3-D, in both precisions."""

from __future__ import annotations

import jax
import numpy as np
import typer

import jaxsph as js
from experiments.common import row

DEPTH, G, RHO = 1.0, 9.81, 1000.0


def main(layers: int = 40, layers_3d: int = 20, t1: float = 5.0) -> None:
    """Runs a square tank of `layers` spacings' depth, and in 3-D a column of 10 x 5 x `layers_3d`."""
    jax.config.update("jax_enable_x64", True)
    flat = {"dx": DEPTH / layers, "output.sample_dt": 0.05}
    deep = {
        "dx": DEPTH / layers_3d,
        "tank.length": 10 * DEPTH / layers_3d,
        "tank.width": 5 * DEPTH / layers_3d,
        "probes.pressure": None,
        "output.sample_dt": 0.05,
    }
    for name, changes in (("2-D", flat), ("3-D", deep)):
        for precision in ("float32", "float64"):
            case = js.load_case("hydrostatic").replace(changes | {"precision": precision})
            solution = js.run(case, t1=t1, progress=False)
            label = f"hydrostatic {name}, dx = d/{round(DEPTH / case.dx)}, {precision}, {t1:g} s"
            error, speed = errors(solution)
            row(f"{label}: RMS pressure error / rho g d", f"{100 * error:.3f} %", "< 1 %", error < 0.01)
            row(f"{label}: max |u| / sqrt(g d) after 3 s", f"{100 * speed:.3f} %", "< 1 %", speed < 0.01)


def errors(solution: js.Solution) -> tuple[float, float]:
    """RMS error of the last pressure over rho g d, largest speed after 3 s over sqrt(g d)."""
    p = solution.state.particles
    pressure = np.asarray(p.rho, np.float64) * float(solution.model.scheme.c0) ** 2
    error = pressure - RHO * G * (DEPTH - np.asarray(p.x, np.float64)[:, -1])
    late = solution["max_speed"][solution.t >= min(3.0, 0.6 * solution.t[-1])]
    return float(np.sqrt(np.mean(error**2)) / (RHO * G * DEPTH)), float(np.max(late) / np.sqrt(G * DEPTH))


if __name__ == "__main__":
    typer.run(main)
