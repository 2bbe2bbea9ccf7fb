"""Slope of a result with respect to one parameter of a case or a program."""

from __future__ import annotations

from typing import Any

from jaxsph.problem.sources import source_of
from jaxsph.study.base import AbstractMethod, Derivative, parameter_value
from jaxsph.study.ensemble import Ensemble


def derivative(
    given: Any,
    parameter: str,
    of: str = "xi",
    method: AbstractMethod | None = None,
    progress: bool = True,
) -> Derivative:
    """Value of a result at the end of a run, and its slope with respect to one parameter.

    **Arguments**: `given`: a case, or a function that returns a `Problem`. `parameter`: the dotted name of a
    number in the case, or an argument of the function; for `Exact` and `Filtered` the model must depend
    smoothly on this value. `of`: "xi", "P_owc" (W; W/m in 2-D) or "energy_pto" (from the start to t1, J; J/m
    in 2-D); for an ensemble also any result that the problem itself defines. `method`: `Exact()`, for runs of
    a fraction of a second; `Filtered()`, for one run over whole wave periods, with a bias; `Ensemble()` (the
    default), for many runs, with a standard error.
    **Raises** CaseError if the case lacks the parameter or the method cannot give this slope; DerivativeError
    if the slope would not describe the flow; SimulationError under the same conditions as `run`.
    """
    source = source_of(given)
    parameter_value(source, parameter)
    return (Ensemble() if method is None else method).derivative(source, parameter, of, progress)
