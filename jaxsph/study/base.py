"""Base of the methods for slopes: parameters, results as functions of the power, `Derivative`."""

from __future__ import annotations

import abc
import dataclasses
import functools
import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import equinox as eqx
import numpy as np

from jaxsph import analysis
from jaxsph.case.case import Case
from jaxsph.case.linear import incident_power
from jaxsph.case.settling import settled_periods
from jaxsph.errors import CaseError

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


def result_of_power(case: Case, of: str) -> Callable[[np.ndarray, np.ndarray], float]:
    """Result `of` as a function of the times (s) and the PTO's power (W; W/m in 2-D), linear in the power.

    **Raises** CaseError for a result that the case does not have.
    """
    column = case.pto is not None and case.pto.is_turbine
    if not column and (case.body is None or case.body.pto is None):
        raise CaseError(f"of = {of!r} needs a turbine, such as pto.K_dm, or a body with body.pto")
    if of == "energy_pto":
        # a reading is the mean since the one before it: none for the first
        return lambda _, power: float(np.sum(power) * case.output.sample_dt)
    if of not in ("xi", "P_owc"):
        raise CaseError(f"of = {of!r}: must be 'xi', 'P_owc' or 'energy_pto'")
    if of == "xi" and case.tank.width is not None:
        raise CaseError("of = 'xi': a tank with a width has no efficiency; take of = 'P_owc', the mean power")
    waves = case.waves
    periods = settled_periods(case, case.t1 - case.output.sample_dt) if waves is not None else 0
    if waves is None or periods < 1:
        raise CaseError(
            f"of = {of!r} needs a whole wave period after the transient: raise t1 = {case.t1:g} s"
        )
    P = 1.0 if of == "P_owc" else incident_power(case)
    return lambda t, power: analysis.efficiency(t, power, waves.cycle, P, periods).xi
