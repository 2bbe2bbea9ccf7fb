"""Results of a case's run: absorbed and incident power, efficiency, reflection, and the averaging window."""

from __future__ import annotations

import functools

import equinox as eqx
import numpy as np
from numpy.typing import NDArray

from jaxsph import analysis
from jaxsph.case.geometry import Geometry
from jaxsph.case.linear import incident_energy, incident_power, linear_owc, linear_sea, why_no_theory
from jaxsph.case.linear_bodies import has_free_bodies, linear_motions, why_no_motions
from jaxsph.case.sections import Sections
from jaxsph.case.settling import (
    averages_from,
    given_waves,
    most_periods,
    run_until,
    settled_periods,
    settled_window,
    too_few,
    travel_time,
)
from jaxsph.errors import CaseError
from jaxsph.model.meaning import Label
from jaxsph.problem.problem import energy_of_power
from jaxsph.problem.record import (
    AbstractAveraging,
    MeanOfRecord,
    PowerMean,
    Record,
    RegularWave,
    Result,
    Scalars,
    harvested,
)
from jaxsph.problem.results import amplitude, linear
from jaxsph.waves import theory

UNLIKE = 0.1
"""Relative difference between the power of a part of a sea and that of the whole, above which a notice
appears."""
REFLECTING = 0.2
"""Reflection coefficient above which waves reflected by a device affect the device when they return. An
absorbing paddle reflects a twentieth of the amplitude of these waves, and the relative change of the power is
then a tenth of the coefficient."""
WHOLE = 0.95
"""Fraction of a focused group's energy that must have reached the device before an efficiency is given."""


class SettledPeriods(AbstractAveraging):
    """Averages over whole settled periods of a case's waves, or over the whole record of a focused group."""

    case: Sections = eqx.field(static=True)
    """Case of the run."""

    def regular_wave(self):
        """See `AbstractAveraging.regular_wave`."""
        waves = self.case.waves
        return RegularWave(waves.T, waves.H) if waves is not None and waves.kind == "regular" else None

    def window(self, t, powers, since):
        """See `AbstractAveraging.window`."""
        return settled_window(self.case, t, powers, since)

    def notices(self, record, results):
        """See `AbstractAveraging.notices`."""
        case, window, since = self.case, record.window, record.since
        if case.waves is None or case.waves.kind == "focused":
            return []
        if not window.periods:
            if since == 0.0:
                return []
            end = since + travel_time(case, Geometry.of(case).length) + case.waves.cycle
            return [
                f"no means over periods: the case was changed at t = {since:g} s, and no whole period has "
                f"settled since; continue to t1 = {end:.4g} s or longer"
            ]
        found = part_of_a_sea(case, float(record.t[-1]), window.periods, since)
        if window.left_out and too_few(window.periods):
            periods = "periods" if window.periods > 1 else "period"
            found.append(
                f"results are averaged over {window.periods} {periods} only, because the {window.left_out} "
                "before them had not settled: raise t1"
            )
        if "xi" in results and results.get("reflection", 0.0) > REFLECTING:
            found += _before_the_echo(case, record)
        return found


def _before_the_echo(case: Sections, record: Record) -> list[str]:
    """Notice if averaging begins before the waves that the device has reflected return from the paddle."""
    begin = float(record.t[record.window.over][0])
    echo = echo_after(case, begin)
    if echo is None:
        return []
    end = echo + case.output.periods * given_waves(case).cycle
    return [
        f"averaging starts at t = {begin:.3g} s, before the waves that the device reflects return from "
        f"the paddle, at t = {echo:.3g} s: xi may then change by a few per cent; for the final xi raise "
        f"t1 to {end:.4g} s"
    ]


def echo_after(case: Sections, begin: float) -> float | None:
    """Time (s) at which waves reflected by the device return to it from the paddle; None if averaging
    starts later, at `begin` (s), or if the waves are a sea."""
    waves = given_waves(case)
    echo = waves.ramp_periods * waves.period + 3.0 * travel_time(case, _device_x(case))
    return None if waves.repeats is not None or begin > echo - waves.period else echo


def part_of_a_sea(case: Sections, t_end: float, periods: int, since: float = 0.0) -> list[str]:
    """Notice if the last `periods` periods up to `t_end` (s) are a part of a sea with another power than the
    whole. `since`: time (s) of the run's last change."""
    if periods < 1 or not _is_part(case, periods):
        return []
    ratio = incident_over(case, t_end, periods) / incident_power(case)
    if abs(ratio - 1.0) <= UNLIKE:
        return []
    sea, peak = ("series", "") if given_waves(case).kind == "recorded" else ("sea", "peak ")
    t1 = f"{run_until(case, averages_from(case, since), most_periods(case)):g} s"
    advice = f": raise t1 to {t1} for averages over the whole {sea}"
    if case.turbines or case.has_take_off:
        ratios = "efficiencies" if case.tank.width is None else "capture widths"
        advice = f", so absorbed powers are not those of the {sea}: compare {ratios}, or raise t1 to {t1}"
    return [
        f"the averages cover {periods} of {most_periods(case)} {peak}periods of the {sea}; the waves of this "
        f"part carry {ratio:.2f} times the power of the whole {sea}{advice}"
    ]


def _is_part(case: Sections, periods: int) -> bool:
    """Whether `periods` periods are only a part of a sea."""
    return given_waves(case).repeats is not None and periods < most_periods(case)


def case_results(case: Sections) -> tuple[Result, ...]:
    """Results of a case's run, in addition to its energy balance and noise."""
    if case.waves is None:
        return ()
    focused = case.waves.kind == "focused"
    reflection = Result(functools.partial(_reflection, case), what="reflection")
    if focused:
        return Result(functools.partial(_energy_of_a_group, case), what="absorbed energy"), reflection
    power = Result(functools.partial(_power, case), what="absorbed power")
    measured = Result(_over_measured, what="efficiency")
    theory_of = Result(functools.partial(_linear, case), what="linear theory")
    return Result(_periods, what="periods"), power, reflection, measured, theory_of, *_coast(case)


def _coast(case: Sections) -> tuple[Result, ...]:
    """Results of overtopping and run-up at the solids that a case's probes name."""
    makers = {
        "overtopping": (
            _overtopping,
            Label("mean overtopping", "m2/s", "flow of water over the crest, per metre of crest"),
        ),
        "run_up": (
            _run_up,
            Label("run-up", "m", "mean over the periods of the highest level on the face, above still water"),
        ),
    }
    found = []
    for key, (make, label) in makers.items():
        for name in getattr(case.probes, key):
            words = label._replace(text=f"{label.text} of the {name}")
            found.append(Result(functools.partial(make, name), {f"{key}_{name}": words}, label.text))
    return tuple(found)


def _overtopping(name: str, record: Record) -> Scalars:
    """Mean flow over the crest of a solid, m2/s: rise of the water volume behind the crest in the window."""
    window = record.window
    if not window.periods:
        return {}
    behind, t = record[f"overtopped_{name}"][window.over], record.t[window.over]
    return {f"overtopping_{name}": float((behind[-1] - behind[0]) / (t[-1] - t[0]))}


def _run_up(name: str, record: Record) -> Scalars:
    """Highest level above still water on the face of a solid in each period, m, averaged over the window's
    periods."""
    window = record.window
    if not window.periods:
        return {}
    each = np.array_split(np.float64(record[f"run_up_{name}"][window.over]), window.periods)
    return {f"run_up_{name}": float(np.mean([level.max() for level in each]))}


def _periods(record: Record) -> Scalars:
    """Number of averaged periods, and number of earlier periods left out; empty if nothing is averaged."""
    window = record.window
    if not window.periods:
        return {}
    return {"periods": float(window.periods), "periods_left_out": float(window.left_out)}


def _absorbed(case: Sections, record: Record) -> NDArray[np.floating] | None:
    """Total power (W; W/m in 2-D) of all power take-offs, averaged over the time since the previous sample.
    None if there is no power take-off, or if all chambers have a prescribed pressure."""
    if case.prescribed and not case.turbines and not case.every_body:
        return None
    names = [name for name in harvested(record.solution.model) if name in record.solution.series]
    return np.sum([record[name] for name in names], axis=0) if names else None


def _share(case: Sections, share: float) -> dict[str, float]:
    """Result for the ratio `share` of absorbed to incident energy: efficiency, or in 3-D capture width, m."""
    return {"xi": share} if case.tank.width is None else {"capture_width": share}


def _power(case: Sections, record: Record) -> dict[str, float]:
    """Incident power (W/m) and absorbed power (W; W/m in 2-D), averaged over the window, and their ratio (in
    3-D the capture width, m). If the window is a part of a sea, also the whole sea's incident power."""
    window, waves = record.window, given_waves(case)
    if not window.periods:
        return {}
    t, T = record.t, waves.cycle
    P_inc = incident_over(case, float(t[-1]), window.periods)
    results = {"P_inc": P_inc}
    if _is_part(case, window.periods):
        results["P_inc_sea"] = incident_power(case)
    power = _absorbed(case, record)
    if power is None:
        return results
    efficiency = analysis.efficiency(t, power, T, P_inc, window.periods)
    absorbed = "P_owc" if case.turbines else "P_pto"
    results[absorbed] = efficiency.xi * P_inc
    if "P_inc_sea" in results:
        results[f"{absorbed}_sea"] = efficiency.xi * results["P_inc_sea"]
    results |= _share(case, efficiency.xi)
    if case.tank.width is not None:
        return results
    if window.periods > 1:
        results["xi_scatter"] = float(np.std(efficiency.per_period, ddof=1))
        results["xi_error"] = results["xi_scatter"] / window.periods**0.5
    if waves.repeats is not None:
        results["xi_error"] = analysis.mean_with_error(power[window.over][1:]).error / P_inc
    return results


def _over_measured(record: Record) -> Scalars:
    """Efficiency relative to the power of the waves that the gauges measured."""
    made = record.results
    if not {"xi", "P_inc_measured"} <= set(made):
        return {}
    return {"xi_measured": made["xi"] * made["P_inc"] / made["P_inc_measured"]}


def _linear(case: Sections, record: Record) -> Scalars:
    """Efficiency and amplitudes by linear theory, named after the corresponding results."""
    made = record.results
    if has_free_bodies(case):
        if "P_inc" not in made or why_no_motions(case):
            return {}
        found, means = linear_motions(case).results, {"xi", "P_pto", "P_owc"}
        return {linear(name): value for name, value in found.items() if name in made or name not in means}
    if "xi" not in made or not case.turbines or why_no_theory(case):
        return {}
    if case.waves.kind != "regular":
        return {linear("xi"): linear_sea(case).xi}
    found = linear_owc(case)
    amplitudes = {"P_a": found.P_a, "flow": found.q, "chamber_level": found.level}
    swings = {linear(amplitude(name)): float(abs(value)) for name, value in amplitudes.items()}
    return {linear("xi"): float(found.xi)} | swings


def incident_over(case: Sections, t_end: float, periods: int) -> float:
    """Mean power (W per metre of crest) of the waves that meet the device in the last `periods` whole periods
    up to `t_end` (s).

    A part of a sea may have higher or lower waves than the whole; therefore the energy of this part is used.
    """
    waves = case.waves
    if not _is_part(case, periods):
        return incident_power(case)
    span = periods * waves.cycle
    return incident_energy(case, _device_x(case), t_end - span, t_end) / span


def _energy_of_a_group(case: Sections, record: Record) -> dict[str, float]:
    """Energy of a focused group (J/m), and the fraction absorbed by the end of the run (in 3-D the capture
    width, m).

    A group has no mean power, because device and waves would need different averaging times.
    """
    whole = incident_power(case) * case.waves.repeats
    results, power = {"E_inc": whole}, _absorbed(case, record)
    if power is None:
        return results
    if not np.all(record.window.over):
        raise ValueError(
            "the run was changed while the group was passing; start a new run with the changed values"
        )
    t, x = record.t, _device_x(case)
    come = incident_energy(case, x, travel_time(case, x), float(t[-1])) / whole if t[-1] > 0.0 else 0.0
    if come < WHOLE:
        raise ValueError(f"only {come:.0%} of the group's energy has reached x = {x:.3g} m; raise t1")
    return results | _share(case, float(np.sum(power[1:] * np.diff(t))) / whole)


def _device_x(case: Sections) -> float:
    """Position at which waves meet a case's device, m from the paddle: the nearest of the plate, the front
    walls of chambers and the bodies, or the end of the tank if the case has no device."""
    geometry = Geometry.of(case)
    fronts = [stretch.nearest for stretch in geometry.stretches.values()]
    if geometry.plate is not None:
        fronts.append(geometry.plate.x0)
    fronts += [shape.bounds()[0][0] for shape in geometry.bodies.values()]
    return float(min(fronts, default=geometry.length))


def _reflection(case: Sections, record: Record) -> dict[str, float]:
    """Incident and reflected waves, and the incident power, from the gauges of `flume_gauges`."""
    solution, waves = record.solution, given_waves(case)
    if "eta" not in solution.series or (waves.kind != "focused" and not record.window.periods):
        return {}
    chosen, x = _enough_gauges(case)
    t, over, depth = record.t, record.window.over, float(solution.model.depth)
    if waves.kind == "regular":
        eta = record["eta"][:, chosen].T
        found = analysis.reflection(eta, x, t, waves.T, depth, g=case.g, periods=record.window.periods)
        height = 2 * found.incident
        power = float(theory.incident_power(height, waves.T, depth, case.fluid.rho0, case.g))
        return {"reflection": found.coefficient, "incident_height": height, "P_inc_measured": power}
    sea = two_way_sea(case, t[over], record["eta"][over], depth)
    if waves.kind == "focused":
        return {"reflection": sea.coefficient}  # a group's mean power depends on the duration
    return {
        "reflection": sea.coefficient,
        "Hm0": sea.incident.Hm0,
        "Te": sea.incident.Te,
        "P_inc_measured": sea.incident.power(depth, case.fluid.rho0, case.g),
    }


def why_no_reflection(case: Sections) -> str:
    """Reason why a case's gauges cannot give the reflection coefficient; empty if they can, or if there are
    neither gauges nor waves."""
    geometry = Geometry.of(case)
    if case.waves is None or not len(geometry.gauges):
        return ""
    try:
        _, x = _enough_gauges(case)
        if case.waves.kind == "regular":
            analysis.check_separable(x, case.waves.T, float(geometry.depth), case.g)
    except ValueError as error:
        return str(error)
    return ""


def _enough_gauges(case: Sections) -> tuple[list[int], NDArray[np.float64]]:
    """Indices and positions (m) of the gauges of `flume_gauges`. **Raises** ValueError for fewer than
    three."""
    chosen = flume_gauges(case)
    if len(chosen) < 3:
        first, last = _free_flume(case)
        if first >= last:
            raise ValueError(
                "no gauge can be far enough from the paddle, absorbing zones and solids; use a longer tank"
            )
        raise ValueError(
            f"three gauges or more are needed between x = {first:g} and {last:g} m, where evanescent waves "
            f"are negligible, but there are {len(chosen)}; add gauges to probes.gauges"
        )
    return chosen, np.asarray(Geometry.of(case).gauges, np.float64)[chosen]


def two_way_sea(
    case: Sections, t: NDArray[np.floating], eta: NDArray[np.floating], depth: float
) -> analysis.TwoWaySea:
    """Incident and reflected sea from the gauges of `flume_gauges`, over the given record.

    **Arguments**: times (s); elevations of all gauges `[T, gauge]` (m); depth (m). **Raises** ValueError if
    the gauges cannot separate the two seas, or the record is too short.
    """
    chosen = flume_gauges(case)
    x = np.asarray(Geometry.of(case).gauges)[chosen]
    _, omega = case.waves.sum_of_waves(depth, case.g)
    f = 0.9 * float(np.min(omega)) / (2 * np.pi), 1.1 * float(np.max(omega)) / (2 * np.pi)
    return analysis.two_way_sea(np.float64(eta)[:, chosen].T, x, t, depth, case.g, f=f, bands=4)


def flume_gauges(case: Sections) -> list[int]:
    """Indices of the gauges in free waves: a depth or more from solids, outside the sponge and the
    relaxation zone.

    Without a relaxation zone, these gauges are also a depth or more from the paddle. Closer to the paddle or
    a solid there are evanescent waves, which decay with the distance x as exp(-pi/2 x/d) or faster.
    """
    first, last = _free_flume(case)
    return [k for k, x in enumerate(Geometry.of(case).gauges) if first <= x <= last]


def _free_flume(case: Sections) -> tuple[float, float]:
    """First and last x (m from the paddle) of the range in which evanescent waves are negligible."""
    geometry = Geometry.of(case)
    depth, ends = float(geometry.depth), [geometry.length]
    first = depth if case.waves.zone is None else case.waves.zone
    if case.sponge is not None:
        ends.append(geometry.length - case.sponge.length)
    if geometry.plate is not None:
        ends.append(geometry.plate.x0 - depth)
    ends += [float(shape.bounds()[0][0]) - depth for shape in geometry.shapes.values()]
    return first, min(ends)


def mean_of_power(case: Sections, of: str) -> MeanOfRecord:
    """Function that gives the `PowerMean` of the result `of` from the times and power of a record.

    `of` is xi or P_owc (W; W/m in 2-D), which are means over the settled periods, or energy_pto (J; J/m in
    2-D). Derivatives of these results use this function.

    **Raises** CaseError for a result that the case does not have.
    """
    if not case.turbines and not case.has_take_off:
        raise CaseError(
            f"of = {of!r} needs a turbine (for example pto.K_dm), a body with body.pto, or a link with "
            "take_off"
        )
    if of == "energy_pto":
        return energy_of_power(case.output.sample_dt)
    if of not in ("xi", "P_owc"):
        raise CaseError(f"of = {of!r}: must be 'xi', 'P_owc' or 'energy_pto'")
    if of == "xi" and case.tank.width is not None:
        raise CaseError("of = 'xi': a tank with a width has no efficiency; use of = 'P_owc', the mean power")
    waves = case.waves
    if waves is None:
        raise CaseError(f"of = {of!r} needs waves: give [waves], or use of = 'energy_pto'")
    if settled_periods(case, case.t1 - case.output.sample_dt) < 1:
        raise CaseError(
            f"of = {of!r} needs a whole wave period after the transient: raise t1 = {case.t1:g} s"
        )

    def over(t: np.ndarray, power: np.ndarray) -> PowerMean:
        periods = settled_window(case, t, [power]).periods

        def incident(changed: Sections) -> float:
            return incident_over(changed, float(t[-1]), periods) if of == "xi" else 1.0

        P_inc = incident(case)
        return PowerMean(lambda y: analysis.efficiency(t, y, waves.cycle, P_inc, periods).xi, incident)

    return over
