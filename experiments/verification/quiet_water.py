"""Decay, noise and hyperviscosity of a standing wave, by kernel and by density diffusion.

The scheme is incompressible, in 2-D and 3-D, or weakly compressible, in 2-D. The amplitude of the wave is
0.08 m, two spacings; the tank is 1 m long (and 0.4 m wide in 3-D). The viscosity of water damps the amplitude
at only 2 nu k^2 = 2e-5 per second; the rest of the decay is numerical.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import BUDGET, Report
from jaxsph import analysis
from jaxsph.schemes.kernels import KERNEL, NAMED, SEMICIRCLE, KernelName, usual_length

BARS = {2: (0.0015, 0.015, 0.15), 3: (0.002, 0.025, 0.08)}
"""Largest allowed values by number of dimensions: decay rate (1/s), ratio of noise to speed (-), and energy
lost to hyperviscosity during `USUAL` (J/m in 2-D, J in 3-D)."""
USUAL = 3.0
"""Default duration of the run, s."""
BEFORE: dict[int, KernelName] = {2: "gaussian", 3: "wendland"}
"""Earlier default kernels, before semicircle and polynomial, by number of dimensions."""
DIFFUSIONS = (0.1, 0.2, 0.4)
"""Coefficients delta of the density diffusion (-) that are compared; the first is the default."""
ENERGIES = {
    "hyperviscosity": BUDGET["hyperviscosity"],
    "diffusive": "energy lost by density diffusion",
    "residual": BUDGET["residual"],
}
"""Reported terms of the energy budget of weakly compressible water, and their names."""


def main(
    dx: float = 0.04,
    amplitude: float = 0.08,
    t1: float = USUAL,
    weakly_compressible: bool = False,
    flat: bool = False,
) -> None:
    """Runs the wave to t1 (s) with polynomial, semicircle and earlier default kernel, in 2-D and 3-D.

    `amplitude`: in m; `flat`: whether to run in 2-D only.
    """
    if weakly_compressible:
        by_diffusion(dx, amplitude, t1)
        return
    title = f"Standing wave with an amplitude of {amplitude:g} m for {t1:g} s, by kernel, incompressible"
    dims = (2,) if flat else (2, 3)
    name = f"quiet_water_{dx:g}" if t1 == USUAL else f"quiet_water_{dx:g}_{t1:g}"
    with Report(name, title, dx) as report:
        figure = Figure(figsize=(4.5 * len(dims), 3.6), layout="constrained")
        for dim, axis in zip(dims, figure.subplots(1, len(dims), squeeze=False)[0], strict=True):
            for kernel in ("polynomial", "semicircle", BEFORE[dim]):
                run = solved(dx, amplitude, t1, dim, {"scheme.kernel": kernel})
                measured = (decay(run), run.results["noise"], run.results["energy_hyperviscosity"])
                units = ("1/s", "of the speed", "J/m" if dim == 2 else "J")
                words = ("decay of the amplitude", "noise at the end", "energy lost by hyperviscosity")
                bars = (*BARS[dim][:2], BARS[dim][2] * t1 / USUAL)
                for what, value, unit, bar in zip(words, measured, units, bars, strict=True):
                    chosen = NAMED[dim][kernel] == KERNEL[dim]
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


def by_diffusion(dx: float, amplitude: float, t1: float) -> None:
    """Runs the wave in weakly compressible water, with two kernels and several diffusion coefficients."""
    title = (
        f"Standing wave with an amplitude of {amplitude:g} m, by kernel and diffusion, weakly compressible"
    )
    with Report(f"quiet_water_{dx:g}_weakly_compressible", title, dx) as report:
        for kernel in (BEFORE[2], "semicircle"):
            for delta in DIFFUSIONS:
                changes = {
                    "scheme.kind": "weakly_compressible",
                    "scheme.kernel": kernel,
                    "scheme.delta": delta,
                }
                if kernel == "semicircle":
                    changes["scheme.h_over_dx"] = usual_length(SEMICIRCLE[2], 2)
                run = solved(dx, amplitude, t1, 2, changes)
                label = f"{kernel}, delta = {delta:g}"
                report.row(f"{label}: decay of the amplitude", decay(run), "1/s", theory=0.0)
                report.row(f"{label}: noise at the end", run.results["noise"], "of the speed", theory=0.0)
                for name, words in ENERGIES.items():
                    report.row(f"{label}: {words}", run.results[f"energy_{name}"], "J/m", theory=0.0)


def solved(dx: float, amplitude: float, t1: float, dim: int, changes: dict[str, Any]) -> js.Solution:
    """Runs the wave to t1 (s) with these changes to the incompressible case."""
    asked = {
        "dx": dx,
        "scheme.kind": "incompressible",
        "start.amplitude": amplitude,
        "probes.gauges": [0.1, 0.9],
        "probes.pressure": None,
        "output.sample_dt": 0.01,
    }
    asked |= {"tank.width": 0.4} if dim == 3 else {}
    return js.run(js.load_case("hydrostatic").replace(asked | changes), t1=t1, progress=False)


def decay(run: js.Solution) -> float:
    """Decay rate of the amplitude of the surface's tilt, 1/s."""
    return analysis.fit_damped_oscillation(run.t, run["eta"][:, 0] - run["eta"][:, 1]).decay_rate
