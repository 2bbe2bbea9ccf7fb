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
from jaxsph.case.linear import incident_energy, incident_power
from jaxsph.case.settling import Window, settled_window, travel_time
from jaxsph.model.interfaces import Model
from jaxsph.model.meaning import Exchange
from jaxsph.model.solution import Solution
from jaxsph.waves import theory

Scalars = dict[str, float]


FEW = 5
"""Periods averaged below which a run is asked to be longer, where others have been left out."""
REFLECTING = 0.2
"""Reflection coefficient above which the waves that a device sends back matter to it when they return: a
paddle that absorbs leaves a twentieth of them, and the power moves by twice that times the coefficient."""
WHOLE = 0.95
"""Share of a focused group's energy that has to have come to the device for an efficiency."""


def run_results(
    case: Case, solution: Solution, seconds: float, steps: int, since: float = 0.0
) -> tuple[Scalars, tuple[str, ...]]:
    """Scalars of a run, and notices of those that could not be made.

    **Arguments**: wall time (s) and the steps that it took; `since`: time (s) of the run's last change: means
    begin when its transient is over, too.
    """
    results = {
        "t_end": float(solution.model.time(solution.state)),
        "steps": float(int(solution.state.step)),
        "wall_seconds": seconds,
        "particle_steps_per_second": steps * solution.state.particles.x.shape[0] / seconds,
    }
    notices = []
    window = _window(case, solution, since)
    made: list[tuple[str, Callable[[Case, Solution, Window], Scalars]]] = [
        ("energy balance", _energy),
        ("noise", _noise),
    ]
    if case.waves is not None and case.waves.kind == "focused":
        made += [("absorbed energy", _energy_of_a_group), ("reflection", _reflection)]
    elif window.periods:
        results |= {"periods": float(window.periods), "periods_left_out": float(window.left_out)}
        made += [("absorbed power", _power), ("reflection", _reflection)]
        if window.left_out and window.periods < FEW:
            notices.append(
                f"results are averaged over {window.periods} periods only, as the {window.left_out} before "
                "them had not settled: raise t1"
            )
    elif case.waves is not None and since > 0.0:
        end = since + travel_time(case, Geometry.of(case).length) + case.waves.cycle
        notices.append(
            f"no means over periods: the case was changed at t = {since:g} s, and no whole period has "
            f"settled since; go on to t1 = {end:.4g} s or longer"
        )
    for name, make in made:
        try:
            results |= make(case, solution, window)
        except Exception as error:  # whatever it is: the series are worth more than any scalar
            kind = "" if isinstance(error, ValueError) else f"{type(error).__name__}: "
            notices.append(f"no result for the {name}: {kind}{error}")
    if {"xi", "P_inc_measured"} <= set(results):
        results["xi_measured"] = results["xi"] * results["P_inc"] / results["P_inc_measured"]
    if "xi" in results and results.get("reflection", 0.0) > REFLECTING:
        notices += _before_the_echo(case, solution, window)
    return results, tuple(notices)


def _before_the_echo(case: Case, solution: Solution, window: Window) -> list[str]:
    """Notice of means that begin before the waves that the device sends back return from the paddle."""
    waves = case.waves
    echo = waves.ramp_periods * waves.period + 3.0 * travel_time(case, _device_x(case))
    begin = float(solution.t[window.over][0])
    if waves.repeats is not None or begin > echo - waves.period:
        return []
    end = echo + case.output.periods * waves.cycle
    return [
        f"means begin at t = {begin:.3g} s, before the waves that the device sends back return to it from "
        f"the paddle, at t = {echo:.3g} s: xi may move by some per cent then; for its lasting value raise t1 "
        f"to {end:.4g} s"
    ]


def harvested(model: Model) -> list[str]:
    """Names of the series of the powers that power take-offs take, by the model's ledger."""
    return [f"power_{n}" for n, entry in model.entries().items() if entry.exchange is Exchange.HARVESTED]


def _window(case: Case, solution: Solution, since: float) -> Window:
    """Window over which all means of a run are taken, found once: its devices' powers have settled in it."""
    names = [name for name in harvested(solution.model) if name in solution.series]
    if not names:
        names = [name for name in ("kinetic",) if name in solution.series]
    return settled_window(case, solution.t, [solution[name] for name in names], since)


def _energy(case: Case, solution: Solution, window: Window) -> Scalars:
    """Energy balance, over whole periods where there are waves: the paddle gives and takes back far more
    than the waves keep. That of the whole run, with its start, is beside it."""
    names, series = harvested(solution.model), solution.series
    over = {name: values[window.over] for name, values in series.items()}
    results = {f"energy_{name}": value for name, value in analysis.energy_budget(over, names).items()}
    if case.waves is not None:
        whole = analysis.energy_budget(series, names)
        results |= {f"whole_energy_{name}": value for name, value in whole.items()}
    return results


def _noise(case: Case, solution: Solution, window: Window) -> Scalars:
    """Noise of the particles over their speed, both RMS over settled whole periods where there are waves, or
    over the last tenth of the record; none for water that does not move."""
    if "noise" not in solution.series:
        return {}
    last = slice(-max(int(np.sum(window.over)) // 10, 1), None)
    over = window.over if window.periods else last
    # in double precision: the squares of small speeds are nothing in single
    noise, speed = (np.linalg.norm(np.float64(solution[name][over])) for name in ("noise", "rms_speed"))
    return {"noise": float(noise / speed)} if speed > 0.0 else {}


def _absorbed(case: Case, solution: Solution) -> NDArray[np.floating] | None:
    """Power (W; W/m in 2-D) of all power take-offs, each sample the mean since the one before; None without
    any, and for a pressure that is given."""
    if case.pto is not None and not case.pto.is_turbine and case.body is None:
        return None
    names = [name for name in harvested(solution.model) if name in solution.series]
    return np.sum([solution[name] for name in names], axis=0) if names else None


def _share(case: Case, share: float) -> Scalars:
    """Absorbed over incident energy as a result: an efficiency, or a width of crest (m) in 3-D."""
    return {"xi": share} if case.tank.width is None else {"capture_width": share}


def _power(case: Case, solution: Solution, window: Window) -> Scalars:
    """Incident power, and the share of it that the device absorbs, both over the window."""
    t, T, waves = solution.t, case.waves.cycle, case.waves
    P_inc = incident_over(case, float(t[-1]), window.periods)
    results = {"P_inc": P_inc}
    power = _absorbed(case, solution)
    if power is None:
        return results
    efficiency = analysis.efficiency(t, power, T, P_inc, window.periods)
    chamber = case.pto is not None and case.pto.is_turbine
    results["P_owc" if chamber else "P_pto"] = efficiency.xi * P_inc
    results |= _share(case, efficiency.xi)
    if case.tank.width is not None:
        return results
    results["xi_scatter"] = float(np.std(efficiency.per_period))
    if waves.repeats is not None:
        results["xi_error"] = analysis.mean_with_error(power[window.over][1:]).error / P_inc
    return results


def incident_over(case: Case, t_end: float, periods: int) -> float:
    """Mean power of the waves that meet the device in the last whole periods up to t_end (s), W per metre of
    crest.

    A part of a sea is higher or lower than the whole: the energy of the same waves counts.
    """
    waves = case.waves
    if waves.repeats is None or periods >= round(waves.repeats / waves.cycle):
        return incident_power(case)
    span = periods * waves.cycle
    return incident_energy(case, _device_x(case), t_end - span, t_end) / span


def _energy_of_a_group(case: Case, solution: Solution, window: Window) -> Scalars:
    """Energy of a focused group, and the share of it that the device has absorbed by the end of the run.

    A group has no mean power: its device's would be one over one span and its waves' one over another.
    """
    whole = incident_power(case) * case.waves.repeats
    results, power = {"E_inc": whole}, _absorbed(case, solution)
    if power is None:
        return results
    if not np.all(window.over):
        raise ValueError("the run was changed while the group was on its way: run it anew with --set")
    t, x = solution.t, _device_x(case)
    come = incident_energy(case, x, travel_time(case, x), float(t[-1])) / whole if t[-1] > 0.0 else 0.0
    if come < WHOLE:
        raise ValueError(f"{come:.0%} of the group's energy has come to x = {x:.3g} m: raise t1")
    return results | _share(case, float(np.sum(power[1:] * np.diff(t))) / whole)


def _device_x(case: Case) -> float:
    """Where waves meet a case's device, m from the paddle: its plate, or its body; else the tank's end."""
    geometry = Geometry.of(case)
    if geometry.plate is not None:
        return float(geometry.plate.x0)
    if geometry.solid is not None:
        return float(geometry.solid.dummies(case.dx, 1)[:, 0].min())
    return geometry.length


def _reflection(case: Case, solution: Solution, window: Window) -> Scalars:
    """Incident and reflected waves, and the power of the incident ones, by the gauges of the free flume."""
    if "eta" not in solution.series:
        return {}
    chosen = flume_gauges(case)
    x = np.asarray(Geometry.of(case).gauges)[chosen]
    if len(x) < 3:
        first, last = _free_flume(case)
        raise ValueError(
            f"it needs three gauges or more between x = {first:g} and {last:g} m, where the waves are free, "
            f"and there are {len(x)}: see probes.gauges"
        )
    t, over = solution.t, window.over
    depth, waves = float(solution.model.depth), case.waves
    if waves.kind == "regular":
        eta = solution["eta"][:, chosen].T
        found = analysis.reflection(eta, x, t, waves.T, depth, g=case.g, periods=window.periods)
        height = 2 * found.incident
        power = float(theory.incident_power(height, waves.T, depth, case.fluid.rho0, case.g))
        return {"reflection": found.coefficient, "incident_height": height, "P_inc_measured": power}
    sea = two_way_sea(case, t[over], solution["eta"][over], depth)
    if waves.kind == "focused":
        return {"reflection": sea.coefficient}  # its mean power would depend on how long the record is
    return {
        "reflection": sea.coefficient,
        "Hm0": sea.incident.Hm0,
        "Te": sea.incident.Te,
        "P_inc_measured": sea.incident.power(depth, case.fluid.rho0, case.g),
    }


def two_way_sea(
    case: Case, t: NDArray[np.floating], eta: NDArray[np.floating], depth: float
) -> analysis.TwoWaySea:
    """Incident and reflected sea at the gauges of the free flume, over the record given.

    **Arguments**: times (s); elevations of all gauges `[T, gauge]` (m); depth (m). **Raises** ValueError for
    gauges that cannot tell the two apart, or a record that is too short.
    """
    chosen = flume_gauges(case)
    x = np.asarray(Geometry.of(case).gauges)[chosen]
    _, omega = case.waves.sum_of_waves(depth, case.g)
    f = 0.9 * float(np.min(omega)) / (2 * np.pi), 1.1 * float(np.max(omega)) / (2 * np.pi)
    return analysis.two_way_sea(np.float64(eta)[:, chosen].T, x, t, depth, case.g, f=f, bands=4)


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
