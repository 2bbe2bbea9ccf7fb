"""Base of the methods for slopes: parameters, `Derivative`."""

from __future__ import annotations

import abc
import dataclasses
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import equinox as eqx
import numpy as np

from jaxsph.errors import CaseError
from jaxsph.problem.problem import Problem
from jaxsph.problem.source import Source


@dataclass(frozen=True)
class Derivative:
    """A result, its slope over a number of what is run, and how far the slope can be trusted."""

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
    """Method that finds the slope of a result over a number of what is run."""

    @abc.abstractmethod
    def derivative(self, source: Source, parameter: str, of: str, progress: bool) -> Derivative:
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


def parameter_value(source: Source, parameter: str) -> float:
    """Value of a number of what is run, by name. **Raises** CaseError where there is none."""
    value = source.value(parameter)
    if value is None:
        raise CaseError(f"{parameter} is not given in the case: a derivative needs a value to start from")
    if not isinstance(value, float):
        raise CaseError(f"{parameter} = {value!r}: must be a number that can vary a little, such as pto.K_dm")
    return value


def check_result(problem: Problem, of: str) -> None:
    """**Raises** CaseError for a result that the problem's runs do not have."""
    if of not in problem.labels:
        problem.mean_of_power(of)
