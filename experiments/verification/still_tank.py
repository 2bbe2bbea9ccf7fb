"""Undisturbed incompressible water, and the energy of the projection over a whole run.

A tank at rest must keep its level and potential energy from the first step on, in 2-D and 3-D, and in 3-D it
must still be at rest after ten seconds. In a run with waves, the energy exchanged by the projection over the
whole run must be small compared with the paddle's work.
"""

from __future__ import annotations

import numpy as np

import jaxsph as js
from experiments.common import Report, solved
from jaxsph.analysis import energy_budget

DEPTH = 0.48
"""Depth of the still tanks, m."""
PERIOD = 1.2
"""Duration of the runs at rest, s: one period of the built-in waves."""
LONG, LAYERS = 10.0, 20
"""Duration (s) of the long run of a 3-D tank, and its depth in spacings."""


def main(dx: float = 0.02, dx_3d: float = 0.03, waves: bool = True) -> None:
    """Runs a 2-D tank of the length of `wave_tank`, 3-D tanks of 1 x 0.3 x 0.48 m, and `wave_tank` itself."""
    flat = still(dx, js.load_case("wave_tank").tank.length)
    deep = still(dx_3d, 1.0, width=0.3)
    with Report(f"still_tank_{dx:g}", "Incompressible water that starts at rest", dx) as report:
        for name, case in (("2-D", flat), ("3-D", deep)):
            level, energy, speed = disturbance(js.run(case, t1=PERIOD, progress=False), case)
            label = f"{name}, dx = {case.dx:g} m"
            rows = (
                ("largest shift of the mean level", 1e3 * level, "mm", 0.1),
                ("largest potential energy", energy, "J/m", 1.0),
            )
            for what, value, unit, bar in rows:
                report.row(
                    f"{label}: {what}", value, unit, theory=0.0, bar=f"< {bar:g} {unit}", passes=value < bar
                )
            report.row(f"{label}: largest speed at the end", speed, "m/s", theory=0.0)
        long(report)
        if waves:
            case = js.load_case("wave_tank").replace({"dx": dx, "scheme.kind": "incompressible"})
            budget = energy_budget(solved(case, f"still_tank_waves_{dx:g}").series())
            share = 100 * budget["projection"] / budget["paddle"]
            report.row(
                "wave_tank, whole run: energy removed by the projection over the paddle's work",
                share,
                "%",
                theory=0.0,
                bar="within 2 %",
                passes=abs(share) < 2.0,
            )


def long(report: Report) -> None:
    """Reports a 3-D tank over ten seconds."""
    case = still(DEPTH / LAYERS, 1.0, width=0.3)
    run = js.run(case, t1=LONG, progress=False)
    level, _, _ = disturbance(run, case)
    speed = float(np.max(run["max_speed"][run.t > 3.0])) / np.sqrt(case.g * DEPTH)
    for what, value, bar in (
        ("largest speed after 3 s over sqrt(g d)", speed, 0.5),
        ("largest shift of the mean level over d", level / DEPTH, 0.1),
    ):
        label, share = f"3-D, d/dx = {LAYERS}, {LONG:g} s: {what}", 100 * value
        report.row(label, share, "%", theory=0.0, bar=f"< {bar:g} %", passes=share < bar)


def still(dx: float, length: float, width: float | None = None) -> js.Case:
    """A tank of this length and width (m), with incompressible water at rest."""
    changes = {
        "dx": dx,
        "scheme.kind": "incompressible",
        "tank.length": length,
        "tank.depth": DEPTH,
        "tank.height": 0.8,
        "probes.pressure": None,
        "output.sample_dt": 0.05,
    }
    return js.load_case("hydrostatic").replace(changes | ({} if width is None else {"tank.width": width}))


def disturbance(run: js.Solution, case: js.Case) -> tuple[float, float, float]:
    """Largest shift of the mean level (m), largest potential energy (J/m of width), and largest speed at the
    end (m/s).

    The shift of the level is that of the centre of mass: lifting all water by s needs the energy rho g d L s.
    """
    energy = float(np.max(np.abs(np.float64(run["potential"])))) / (case.tank.width or 1.0)
    weight = case.fluid.rho0 * case.g * case.tank.depth * case.tank.length
    return energy / weight, energy, float(run["max_speed"][-1])
