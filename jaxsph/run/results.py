"""Running: `simulate`, pure and of fixed length, and `run`, the host driver around it.

The driver goes in chunks: after each it looks at the status, writes series, snapshot and checkpoint in
one atomic step, and goes on. A table that overflowed or went stale is regrown and the chunk replayed;
what cannot be mended stops the run with the last good checkpoint in the file.
"""

from __future__ import annotations

import numpy as np

from jaxsph import analysis
from jaxsph.case.case import Case
from jaxsph.model.solution import Solution
from jaxsph.waves import theory


def _results(case: Case, solution: Solution, seconds: float, steps: int) -> dict[str, float]:
    """Scalars of a run: speed, energy balance, and the device's powers where there is one."""
    results = {
        "t_end": int(solution.state.step) * float(solution.model.dt),
        "steps": float(int(solution.state.step)),
        "wall_seconds": seconds,
        "particle_steps_per_second": steps * solution.state.particles.x.shape[0] / seconds,
    }
    if case.waves is None:
        budget = analysis.energy_budget(solution.series)
        return results | {f"energy_{k}": v for k, v in budget.items()}
    T, d = case.waves.T, float(solution.model.depth)
    t = solution.t
    periods = settled_periods(case, float(t[-1]))
    # Over whole periods: the paddle gives and takes back far more than the waves keep.
    over = analysis.whole_periods(t, T, periods) if periods >= 1 else slice(None)
    budget = analysis.energy_budget({k: v[over] for k, v in solution.series.items()})
    results |= {f"energy_{k}": v for k, v in budget.items()}
    if periods < 1:
        return results
    P_inc = float(theory.incident_power(case.waves.H, T, d, case.fluid.rho0, case.g))
    results |= {"periods": float(periods), "P_inc": P_inc}
    chamber = case.pto is not None and case.pto.K_dm is not None
    body = case.body is not None and case.body.pto is not None
    if "power_pto" in solution.series and (chamber or body):
        efficiency = analysis.efficiency(t, solution["power_pto"], T, P_inc, periods)
        results["P_owc" if chamber else "P_pto"] = efficiency.xi * P_inc
        if case.tank.width is None:
            results |= {"xi": efficiency.xi, "xi_scatter": float(np.std(efficiency.per_period))}
        else:  # power over power per width
            results["capture_width"] = efficiency.xi
    if "eta" in solution.series and len(case.probes.gauges) >= 4:
        x = np.asarray(case.probes.gauges)[1:4]
        found = analysis.reflection(solution["eta"][:, 1:4].T, x, t, T, d, periods=periods)
        results |= {
            "reflection": found.coefficient,
            "incident_height": 2 * found.incident,
        }
    return results


def settled_periods(case: Case, t1: float) -> int:
    """Whole periods at the end of a run to t1 (s) over which its results are averaged; below 1: none."""
    whole = int((t1 - _transient(case)) / case.waves.T + 1e-6)
    return min(case.output.periods, whole)


def _transient(case: Case) -> float:
    """Time for the ramp and for the wave's energy to reach the far end, s."""
    omega = 2 * np.pi / case.waves.T
    speed = float(theory.group_velocity(omega, case.tank.depth, case.g))
    return case.waves.ramp_periods * case.waves.T + case.tank.length / speed
