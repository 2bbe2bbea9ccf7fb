"""The slope of a result over one number of what is run."""

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
    """Value of a result at the end of a run, and its slope over one number of what is run.

    **Arguments**: `given`: a case, or a function that returns a `Problem`; `parameter`: the dotted name of a
    number, or an argument of the function, for methods through the loop one on which the model depends
    smoothly; `of`: "xi", "P_owc" (W/m) or "energy_pto" (J/m from the start to t1), or of an ensemble any
    result that a problem brings with it. `method`: `Exact()`, for a fraction of a
    second; `Filtered()`, one run for whole wave periods, with a bias; `Ensemble()`, the default, many runs,
    with a standard error.
    **Raises** CaseError for a parameter or a result that the case or the method does not have,
    DerivativeError where the slope would not be one of the flow, SimulationError as `run`.
    """
    source = source_of(given)
    parameter_value(source, parameter)
    return (Ensemble() if method is None else method).derivative(source, parameter, of, progress)
