"""Decay, noise and energy of a standing wave with time steps from half to four times the default step.

The tank is 1 m long; the amplitude of the wave is two spacings. The steps are multiples of the default step,
whatever limits the default: the expected speed, gravity or the sound speed (`schemes.time_step.stable_dt`).
"""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import Report
from jaxsph import analysis

FACTORS = (0.5, 1.0, 1.5, 2.0, 3.0, 4.0)
"""Time steps, as multiples of the default step."""
KINDS = ("incompressible", "weakly_compressible")
GAUGES = (0.1, 0.9)
"""Positions of the gauges (m)."""
LOSSES = ("hyperviscosity", "projection", "viscous", "contact", "separation", "diffusive")
"""Losses in either scheme, by their names in the energy budget; those below a thousandth are not reported."""


def main(dx: float = 0.04, t1: float = 6.0) -> None:
    """Runs the wave to t1 (s) in both schemes with every step."""
    title = "Standing wave with multiples of the default time step"
    with Report(f"largest_step_{dx:g}", title, dx) as report:
        figure = Figure(figsize=(9.0, 3.6), layout="constrained")
        for kind, axis in zip(KINDS, figure.subplots(1, 2), strict=True):
            words = kind.replace("_", " ")
            for factor in FACTORS:
                label = f"{words}, {factor:g} times the default step"
                try:
                    found = solved(kind, dx, factor, t1)
                except js.SimulationError as error:
                    report.row(f"{label}: result", f"stops at t = {error.time:.2f} s")
                    continue
                _rows(report, label, found)
                axis.plot(found.t, found["eta"][:, 0], label=f"{factor:g}")
            axis.set(xlabel="t, s", ylabel="elevation at 0.1 m, m", title=words)
            axis.legend(title="step over the default", fontsize="small")
        report.picture(figure)


def solved(kind: str, dx: float, factor: float, t1: float) -> js.Solution:
    """Runs the wave to t1 (s) with `factor` times the default step. **Raises** SimulationError."""
    changes = {"dx": dx, "scheme.kind": kind, "start.amplitude": 2.0 * dx, "probes.gauges": list(GAUGES)}
    changes |= {"probes.pressure": None, "output.sample_dt": 0.01}
    case = js.load_case("hydrostatic").replace(changes)
    model, state = js.build(case)
    sample_dt = case.output.sample_dt * factor
    model = eqx.tree_at(lambda m: m.dt, model, model.dt * factor)
    first, *others = js.make_probes(case, model, state)
    probes = (eqx.tree_at(lambda p: p.sample_dt, first, jnp.asarray(sample_dt, jnp.float32)), *others)
    whole = round(t1 / sample_dt) * sample_dt
    return js.march(model, state, whole, sample_dt, probes)


def _rows(report: Report, label: str, run: js.Solution) -> None:
    """Rows of one run."""
    swing = analysis.fit_damped_oscillation(run.t, run["eta"][:, 0] - run["eta"][:, 1])
    budget = analysis.energy_budget(dict(run.series))
    scale = float(np.max(run["kinetic"]))
    late = run.t > 0.5 * run.t[-1]
    report.row(f"{label}: time step", 1e3 * float(run.model.dt), "ms")
    report.row(f"{label}: decay of the amplitude", swing.decay_rate, "1/s", theory=0.0)
    report.row(f"{label}: period", 2.0 * np.pi / swing.omega, "s")
    noise = float(np.mean(run["noise"][late]) / np.mean(run["rms_speed"][late]))
    report.row(f"{label}: noise over the speed, second half of the run", noise, theory=0.0)
    for name in LOSSES:
        if name in budget and abs(budget[name]) > 1e-3 * scale:
            report.row(f"{label}: energy ({name}), over the largest kinetic energy", budget[name] / scale)
    report.row(f"{label}: energy not accounted for, over the same", budget["residual"] / scale, theory=0.0)
