"""Closed air as a spring: frequency of communicating vessels with closed air and at constant pressure."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import Report
from jaxsph import analysis

VOLUME = 1.0
"""Volume of the air, m2 per metre of width."""
SQUEEZED, PRESSED = 800.0, 400.0
"""Excess pressures that start the oscillation, Pa: initial pressure of the closed air, and a constant
pressure."""
T1 = 4.0


def main(dx: float = 0.01) -> None:
    """Runs the vessels of section 4.2 of the paper with closed air, and with a constant air pressure."""
    base = js.load_case("vessel").replace({"dx": dx, "probes.gauges": [], "t1": T1})
    if dx > 0.01:
        base = base.replace({"device.wall_thickness": dx, "tank.length": 0.64 + dx})
    constant = swing(base.replace({"pto.P_a": PRESSED}))
    case = base.replace({"pto.resistance": 1e12, "air.volume": VOLUME})
    closed = swing(case, SQUEEZED)
    # the air adds the stiffness gamma p0 b^2 / V to the hydrostatic stiffness 2 rho g b
    spring = case.device.chamber_length / case.air.give / (2.0 * case.fluid.rho0 * case.g)
    exact = np.sqrt(1.0 + spring)
    with Report(f"air_spring_{dx:g}", "Air of a closed chamber as a spring", dx) as report:
        omegas = [_omega(run) for run in (constant, closed)]
        ratio = omegas[1] / omegas[0]
        report.row("period under a constant pressure", 2.0 * np.pi / omegas[0], "s")
        report.row("period with closed air", 2.0 * np.pi / omegas[1], "s")
        apart = ratio / exact - 1.0
        report.row(
            "frequency with closed air over that under a constant pressure",
            ratio,
            theory=exact,
            bar="1 %",
            passes=abs(apart) < 0.01,
        )
        leak = float(np.abs(closed["flow_pto"]).max() / np.abs(closed["flow"]).max())
        report.row("largest flow through the closed turbine over the largest flow of the water", leak)
        report.row(
            "energy recorded for the air over the change of its stored energy",
            closed["booked"] / closed["stored"],
            theory=1.0,
            bar="1 %",
            passes=abs(closed["booked"] / closed["stored"] - 1.0) < 0.01,
        )
        report.picture(_picture(constant, closed))


def swing(case: js.Case, squeezed: float = 0.0) -> dict[str, np.ndarray]:
    """Readings of a run from rest, with the initial excess air pressure `squeezed` (Pa)."""
    model, state = js.build(case)
    chamber = model.chambers[0]
    if squeezed:
        excess = jnp.asarray(squeezed * case.air.give, model.dt.dtype)
        state = eqx.tree_at(lambda s: s.parts[chamber.name].confined.excess.settled, state, excess)
    probes = js.make_probes(case, model, state)
    done = js.march(model, state, case.t1, case.output.sample_dt, probes)
    found = {name: np.float64(done[name]) for name in ("P_a", "flow", "chamber_level")}
    found |= {"t": np.float64(done.t)}
    if squeezed:
        before, after = (chamber.air.stored(s.parts[chamber.name]) for s in (state, done.state))
        found |= {
            "flow_pto": np.float64(done["flow_pto"]),
            "stored": float(after) - float(before),
            "booked": float(done.state.ledger["air"].total),
        }
    return found


def _omega(run: dict[str, np.ndarray]) -> float:
    """Angular frequency of the level's oscillation, rad/s."""
    return analysis.fit_damped_oscillation(run["t"], run["chamber_level"]).omega


def _picture(constant: dict[str, np.ndarray], closed: dict[str, np.ndarray]) -> Figure:
    figure = Figure(figsize=(9, 6), layout="constrained")
    level, pressure = figure.subplots(2, 1, sharex=True)
    for name, run in (("constant pressure", constant), ("closed air", closed)):
        level.plot(run["t"], 1e3 * run["chamber_level"], label=name)
        pressure.plot(run["t"][1:], run["P_a"][1:], label=name)
    level.set(ylabel="level, mm")
    pressure.set(xlabel="t, s", ylabel="P_a, Pa")
    level.legend()
    return figure
