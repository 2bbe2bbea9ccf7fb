"""Base of the methods for slopes: parameters, results as functions of the power, `Derivative`."""

from __future__ import annotations

import abc
import dataclasses
import functools
import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import numpy as np

from jaxsph import analysis
from jaxsph.case.case import Case
from jaxsph.case.settling import settled_periods, settled_window
from jaxsph.errors import CaseError
from jaxsph.run.results import incident_over

SMOOTH = (
    "pto.K_dm",
    "pto.resistance",
    "pto.area",
    "pto.discharge",
    "pto.P_a",
    "pto.relief",
    "pto.suction",
    "air.volume",
    "waves.H",
    "fluid.nu",
    "fluid.rho0",
    "scheme.alpha",
    "scheme.delta",
    "sponge.strength",
    "body.pto.damping",
    "body.pto.coulomb",
    "body.pto.spring",
)
"""Keys of the numbers on which a model depends smoothly, for methods that differentiate through the time
loop. Lengths are not among them: they move the lattice."""


@dataclass(frozen=True)
class Derivative:
    """A result, its slope over a number of the case, and how far the slope can be trusted."""

    parameter: str
    of: str
    value: float
    slope: float
    """Slope d(of)/d(parameter), in the result's unit over the parameter's."""
    error: float | None
    """Standard error of the slope, or a filter's bias; None where the method has none to give."""
    reach: float
    """Largest change of the parameter for which the slope holds, in the parameter's unit: an ensemble's
    spread, or what moves neighbouring particles a tenth of a spacing against each other."""
    method: AbstractMethod
    series: dict[str, np.ndarray] = field(repr=False, default_factory=dict)
    """Readings of the chamber, `[T]`, "time" among them; empty for an ensemble."""
    slopes: dict[str, np.ndarray] = field(repr=False, default_factory=dict)
    """Slopes of the readings, and "grain": how far the particles' slopes of place differ from their
    neighbours', m per unit of the parameter."""
    members: dict[str, np.ndarray] = field(repr=False, default_factory=dict)
    """Values in an ensemble of the parameter and of the result; empty otherwise."""


class AbstractMethod(eqx.Module):
    """Method that finds the slope of a result over a number of a case."""

    @abc.abstractmethod
    def derivative(self, case: Case, parameter: str, of: str, progress: bool) -> Derivative:
        """Value and slope of a result; arguments and errors are those of `study.derivative`."""

    def identity(self) -> dict[str, Any]:
        """All that decides the method's slopes, as numbers, texts and lists by name: a search goes on only
        with the method that it began with."""
        return {"method": type(self).__name__} | _told(self, "method.")

    def kept(self, path: Path) -> AbstractMethod:
        """The method with its runs kept in a file of this path, where it has many and no path yet."""
        del path
        return self


def _told(one: Any, before: str) -> dict[str, Any]:
    """Fields of a dataclass by dotted name, without those that say where to write and how many at a time."""
    found: dict[str, Any] = {}
    for part in dataclasses.fields(one):
        value, name = getattr(one, part.name), before + part.name
        if part.name in ("out", "workers"):
            continue
        if isinstance(value, AbstractMethod):
            found |= {name: type(value).__name__}
        if dataclasses.is_dataclass(value):
            found |= _told(value, f"{name}.")
        else:
            found[name] = value.tolist() if hasattr(value, "tolist") else value
    # as they come back from a file
    return json.loads(json.dumps(found, default=str))


def parameter_value(case: Case, parameter: str) -> float:
    """Value of a number of the case, by dotted name. **Raises** CaseError where there is none."""
    value = functools.reduce(lambda part, name: getattr(part, name, None), parameter.split("."), case)
    if value is None:
        case.replace({parameter: 1.0})  # says what else is meant, where there is no such number
        raise CaseError(f"{parameter} is not given in the case: a derivative needs a value to start from")
    if not isinstance(value, float):
        raise CaseError(f"{parameter} = {value!r}: must be a number that can vary a little, such as pto.K_dm")
    return value


class PowerMean(NamedTuple):
    """A result that is linear in the power, over a part of a record that does not depend on the slope."""

    of_power: Callable[[np.ndarray], float]
    """The result of the power take-offs' power (W; W/m in 2-D) at the record's times."""
    incident: Callable[[Case], float]
    """Incident power (W/m) of a changed case over the same time; the result is over it where it is xi."""


def result_of_power(case: Case, of: str) -> Callable[[np.ndarray, np.ndarray], PowerMean]:
    """Result `of` over the settled periods of a run, by its times (s) and its power (W; W/m in 2-D).

    **Raises** CaseError for a result that the case does not have.
    """
    column = case.pto is not None and case.pto.is_turbine
    if not column and (case.body is None or case.body.pto is None):
        raise CaseError(f"of = {of!r} needs a turbine, such as pto.K_dm, or a body with body.pto")
    if of == "energy_pto":
        # a reading is the mean since the one before it: none for the first
        total = PowerMean(lambda power: float(np.sum(power) * case.output.sample_dt), lambda _: 1.0)
        return lambda *_: total
    if of not in ("xi", "P_owc"):
        raise CaseError(f"of = {of!r}: must be 'xi', 'P_owc' or 'energy_pto'")
    if of == "xi" and case.tank.width is not None:
        raise CaseError("of = 'xi': a tank with a width has no efficiency; take of = 'P_owc', the mean power")
    waves = case.waves
    if waves is None or settled_periods(case, case.t1 - case.output.sample_dt) < 1:
        raise CaseError(
            f"of = {of!r} needs a whole wave period after the transient: raise t1 = {case.t1:g} s"
        )

    def over(t: np.ndarray, power: np.ndarray) -> PowerMean:
        periods = settled_window(case, t, [power]).periods

        def incident(changed: Case) -> float:
            return incident_over(changed, float(t[-1]), periods) if of == "xi" else 1.0

        P_inc = incident(case)
        return PowerMean(lambda y: analysis.efficiency(t, y, waves.cycle, P_inc, periods).xi, incident)

    return over
