"""Results: the scalars of a run that has ended, each made by itself from the series.

A result that cannot be made is absent, and a notice says why: nothing here may cost a run its end.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from jaxsph import analysis
from jaxsph.case.case import Case
from jaxsph.case.geometry import Geometry
from jaxsph.case.linear import incident_power
from jaxsph.case.settling import settled_periods
from jaxsph.model.solution import Solution
from jaxsph.waves import theory

Scalars = dict[str, float]


def run_results(
    case: Case, solution: Solution, seconds: float, steps: int
) -> tuple[Scalars, tuple[str, ...]]:
    """Scalars of a run, and notices of those that could not be made.

    **Arguments**: wall time (s) and the steps that it took.
    """
    made: list[tuple[str, Callable[[Case, Solution], Scalars]]] = [
        ("energy balance", _energy),
        ("noise", _noise),
    ]
    if case.waves is not None:
        made += [("absorbed power", _power), ("reflection", _reflection)]
    results = {
        "t_end": float(solution.model.time(solution.state)),
        "steps": float(int(solution.state.step)),
        "wall_seconds": seconds,
        "particle_steps_per_second": steps * solution.state.particles.x.shape[0] / seconds,
    }
    notices = []
    for name, make in made:
        try:
            results |= make(case, solution)
        except Exception as error:  # whatever it is: the series are worth more than any scalar
            kind = "" if isinstance(error, ValueError) else f"{type(error).__name__}: "
            notices.append(f"no result for the {name}: {kind}{error}")
    if {"xi", "P_inc_measured"} <= set(results):
        results["xi_measured"] = results["xi"] * results["P_inc"] / results["P_inc_measured"]
    return results, tuple(notices)


def _energy(case: Case, solution: Solution) -> Scalars:
    """Energy balance, over whole periods where there are waves: the paddle gives and takes back far more
    than the waves keep. That of the whole run, with its start, is beside it."""
    over, series = _settled(case, solution, slice(None)), solution.series
    budget = analysis.energy_budget({name: values[over] for name, values in series.items()})
    results = {f"energy_{name}": value for name, value in budget.items()}
    if case.waves is not None:
        whole = analysis.energy_budget(series)
        results |= {f"whole_energy_{name}": value for name, value in whole.items()}
    return results


def _noise(case: Case, solution: Solution) -> Scalars:
    """Noise of the particles over their speed, both RMS over settled whole periods where there are waves, or
    over the last tenth of the record; none for water that does not move."""
    if "noise" not in solution.series:
        return {}
    over = _settled(case, solution, slice(-max(len(solution.t) // 10, 1), None))
    # in double precision: the squares of small speeds are nothing in single
    noise, speed = (np.linalg.norm(np.float64(solution[name][over])) for name in ("noise", "rms_speed"))
    return {"noise": float(noise / speed)} if speed > 0.0 else {}


def _settled(case: Case, solution: Solution, otherwise: slice) -> slice | NDArray[np.bool_]:
    """Samples of the settled whole periods; without waves, or before they have settled, those `otherwise`."""
    if case.waves is None:
        return otherwise
    periods = settled_periods(case, float(solution.t[-1]))
    return analysis.whole_periods(solution.t, case.waves.cycle, periods) if periods >= 1 else otherwise


def _power(case: Case, solution: Solution) -> Scalars:
    """Incident power, and the share of it that the device absorbs."""
    t, T = solution.t, case.waves.cycle
    periods = settled_periods(case, float(t[-1]))
    if periods < 1:
        return {}
    P_inc = incident_power(case)
    results = {"periods": float(periods), "P_inc": P_inc}
    chamber = case.pto is not None and case.pto.is_turbine
    body = case.body is not None and case.body.pto is not None
    if "power_pto" not in solution.series or not (chamber or body):
        return results
    efficiency = analysis.efficiency(t, solution["power_pto"], T, P_inc, periods)
    results["P_owc" if chamber else "P_pto"] = efficiency.xi * P_inc
    if case.tank.width is not None:
        return results | {"capture_width": efficiency.xi}  # power over power per width
    results |= {"xi": efficiency.xi, "xi_scatter": float(np.std(efficiency.per_period))}
    if case.waves.repeats is not None:
        settled = analysis.whole_periods(t, T, periods)
        results["xi_error"] = analysis.mean_with_error(solution["power_pto"][settled]).error / P_inc
    return results


def _reflection(case: Case, solution: Solution) -> Scalars:
    """Incident and reflected waves, and the power of the incident ones, by the gauges of the free flume."""
    periods = settled_periods(case, float(solution.t[-1]))
    if periods < 1 or "eta" not in solution.series:
        return {}
    chosen = flume_gauges(case)
    x = np.asarray(Geometry.of(case).gauges)[chosen]
    if len(x) < 3:
        first, last = _free_flume(case)
        raise ValueError(
            f"it needs three gauges or more between x = {first:g} and {last:g} m, where the waves are free, "
            f"and there are {len(x)}: see probes.gauges"
        )
    depth, eta, waves = float(solution.model.depth), solution["eta"][:, chosen].T, case.waves
    if waves.kind == "regular":
        found = analysis.reflection(eta, x, solution.t, waves.T, depth, g=case.g, periods=periods)
        height = 2 * found.incident
        power = float(theory.incident_power(height, waves.T, depth, case.fluid.rho0, case.g))
        return {"reflection": found.coefficient, "incident_height": height, "P_inc_measured": power}
    sea = two_way_sea(case, solution.t, solution["eta"], depth)
    return {
        "reflection": sea.coefficient,
        "Hm0": sea.incident.Hm0,
        "Te": sea.incident.Te,
        "P_inc_measured": sea.incident.power(depth, case.fluid.rho0, case.g),
    }


def two_way_sea(
    case: Case, t: NDArray[np.floating], eta: NDArray[np.floating], depth: float
) -> analysis.TwoWaySea:
    """Incident and reflected sea at the gauges of the free flume, over the settled repetition of the sea.

    **Arguments**: times (s); elevations of all gauges `[T, gauge]` (m); depth (m). **Raises** ValueError for
    gauges that cannot tell the two apart, or a record that is too short.
    """
    chosen = flume_gauges(case)
    x = np.asarray(Geometry.of(case).gauges)[chosen]
    _, omega = case.waves.sum_of_waves(depth, case.g)
    f = 0.9 * float(np.min(omega)) / (2 * np.pi), 1.1 * float(np.max(omega)) / (2 * np.pi)
    settled = analysis.whole_periods(t, case.waves.cycle, settled_periods(case, float(t[-1])))
    found = np.float64(eta)[settled][:, chosen].T
    return analysis.two_way_sea(found, x, t[settled], depth, case.g, f=f, bands=4)


def flume_gauges(case: Case) -> list[int]:
    """Indices of gauges that see free waves: a depth or more from paddle, device and body, before the sponge.

    Nearer to a solid the wave is not alone: what is made beside it falls off by exp(-pi/2 x/d) and faster.
    """
    first, last = _free_flume(case)
    return [k for k, x in enumerate(Geometry.of(case).gauges) if first <= x <= last]


def _free_flume(case: Case) -> tuple[float, float]:
    """Where free waves begin and end, m from the paddle."""
    geometry = Geometry.of(case)
    depth, ends = float(geometry.depth), [geometry.length]
    first = depth if case.waves.zone is None else case.waves.zone
    if case.sponge is not None:
        ends.append(geometry.length - case.sponge.length)
    if geometry.plate is not None:
        ends.append(geometry.plate.x0 - depth)
    if geometry.solid is not None:
        ends.append(float(geometry.solid.dummies(case.dx, 1)[:, 0].min()) - depth)
    return first, min(ends)
