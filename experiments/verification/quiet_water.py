"""Decay, noise and hyperviscosity of a standing wave in the incompressible scheme, by kernel, 2-D and 3-D.

A wave of 0.08 m in a tank of 1 m (and 0.4 m wide in 3-D), two spacings high: what it loses it loses to the
noise that the lattice of particles makes.
"""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import Report
from jaxsph import analysis

BARS = {2: (0.0015, 0.015, 0.15), 3: (0.002, 0.025, 0.08)}
"""Decay (1/s), noise over speed (-) and energy lost by hyperviscosity (J/m, J), by number of dimensions."""
BEFORE = {2: "gaussian", 3: "wendland"}
"""Default kernels before the semicircle, by number of dimensions."""


def main(dx: float = 0.04, amplitude: float = 0.08, t1: float = 3.0) -> None:
    """Runs the wave (m) to t1 (s) with the default kernel and with the one before it, in 2-D and 3-D."""
    title = f"Standing wave of {amplitude:g} m by kernel, incompressible"
    with Report(f"quiet_water_{dx:g}", title, dx) as report:
        figure = Figure(figsize=(9, 3.6), layout="constrained")
        for dim, axis in zip((2, 3), figure.subplots(1, 2), strict=True):
            for kernel in ("semicircle", BEFORE[dim]):
                run = solved(dx, amplitude, t1, dim, kernel)
                measured = (decay(run), run.results["noise"], run.results["energy_hyperviscosity"])
                units = ("1/s", "of the speed", "J/m" if dim == 2 else "J")
                words = ("decay of the amplitude", "noise at the end", "taken by hyperviscosity")
                for what, value, unit, bar in zip(words, measured, units, BARS[dim], strict=True):
                    chosen = kernel == "semicircle"
                    report.row(
                        f"{dim}-D, {kernel}: {what}",
                        value,
                        unit,
                        theory=0.0,
                        bar=f"< {bar:g}" if chosen else "",
                        passes=value < bar if chosen else None,
                    )
                report.row(f"{dim}-D, {kernel}: wall time", run.results["wall_seconds"], "s")
                axis.plot(run.t, run["noise"] / np.maximum(run["rms_speed"], 1e-9), label=kernel)
            axis.set(xlabel="t, s", ylabel="noise over speed", ylim=(0, None), title=f"{dim}-D")
            axis.legend(fontsize="small")
        report.picture(figure)


def solved(dx: float, amplitude: float, t1: float, dim: int, kernel: str) -> js.Solution:
    """A run of the wave to t1 (s) with a kernel."""
    changes = {
        "dx": dx,
        "scheme.kind": "incompressible",
        "start.amplitude": amplitude,
        "probes.gauges": [0.1, 0.9],
        "probes.pressure": None,
        "output.sample_dt": 0.01,
    }
    changes |= {"tank.width": 0.4} if dim == 3 else {}
    changes["scheme.kernel"] = kernel
    return js.run(js.load_case("hydrostatic").replace(changes), t1=t1, progress=False)


def decay(run: js.Solution) -> float:
    """Rate at which the amplitude of the surface's tilt decays, 1/s."""
    return analysis.fit_damped_oscillation(run.t, run["eta"][:, 0] - run["eta"][:, 1]).decay_rate
