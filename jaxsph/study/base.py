"""Base class of the methods for slopes, their result `Derivative`, and checks of their arguments."""

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
    """Value of a result, its slope with respect to a parameter, and the slope's error and range of
    validity."""

    parameter: str
    of: str
    value: float
    slope: float
    """Slope d(of)/d(parameter), in the result's unit divided by the parameter's unit."""
    error: float | None
    """Standard error of the slope, or expected bias of a filter, in the unit of the slope; None if the method
    gives neither."""
    reach: float
    """Largest change of the parameter for which the slope is valid, in the parameter's unit: an ensemble's
    spread, or the change that moves neighbouring particles a tenth of a spacing relative to each other."""
    method: AbstractMethod
    series: dict[str, np.ndarray] = field(repr=False, default_factory=dict)
    """Readings of the parts with a power take-off, and "time" (s), over the run; empty for an ensemble."""
    slopes: dict[str, np.ndarray] = field(repr=False, default_factory=dict)
    """Slopes of the readings, and "grain": RMS deviation of the slopes of the particles' positions from local
    linear fits, m per unit of the parameter."""
    members: dict[str, np.ndarray] = field(repr=False, default_factory=dict)
    """Values of the parameter and of the result over an ensemble's members; empty for other methods."""
    failures: dict[int, str] = field(repr=False, default_factory=dict)
    """Error messages of an ensemble's failed members, by their numbers."""


class AbstractMethod(eqx.Module):
    """Method that computes the slope of a result with respect to a parameter."""

    @abc.abstractmethod
    def derivative(self, source: Source, parameter: str, of: str, progress: bool) -> Derivative:
        """Value and slope of a result; arguments and errors as for `study.derivative`."""

    def identity(self) -> dict[str, Any]:
        """Settings on which the method's slopes depend, by name, as numbers, strings and lists. A search can
        continue only with the method with which it began."""
        return {"method": type(self).__name__} | _told(self, "method.")

    def kept(self, path: Path) -> AbstractMethod:
        """Returns the method, with `path` as the output file if it makes many runs and has no output file
        yet."""
        del path
        return self


def _told(one: Any, before: str) -> dict[str, Any]:
    """Fields of a dataclass by dotted name, except the output file and the number of workers."""
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
    # converted to the types of values that are read from a JSON text
    return json.loads(json.dumps(found, default=str))


def parameter_value(source: Source, parameter: str) -> float:
    """Value of the parameter with this name. **Raises** CaseError if it is missing or not a real number."""
    value = source.value(parameter)
    if value is None:
        raise CaseError(f"{parameter} is not given in the case: give the value at which the slope is wanted")
    if not isinstance(value, float):
        raise CaseError(
            f"{parameter} = {value!r}: must be a number that varies continuously (a float), such as pto.K_dm"
        )
    return value


def check_result(problem: Problem, of: str) -> None:
    """**Raises** CaseError if runs of the problem do not have the result `of`."""
    if of in problem.labels:
        return
    try:
        problem.mean_of_power(of)
    except CaseError as error:
        raise CaseError(f"{error}. Other results of this case: {', '.join(problem.labels)}") from None
