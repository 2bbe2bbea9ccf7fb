"""The slope of a result over one number of a case."""

from __future__ import annotations

from jaxsph.case.case import Case
from jaxsph.study.base import AbstractMethod, Derivative, parameter_value, result_of_power
from jaxsph.study.ensemble import Ensemble


def derivative(
    case: Case,
    parameter: str,
    of: str = "xi",
    method: AbstractMethod | None = None,
    progress: bool = True,
) -> Derivative:
    """Value of a result at the end of a case, and its slope over one number of it.

    **Arguments**: `parameter`: a dotted name of a number, for methods through the loop one of `SMOOTH`; `of`:
    "xi", "P_owc" (W/m) or "energy_pto" (J/m from the start to t1). `method`: `Exact()`, for a fraction of a
    second; `Filtered()`, one run for whole wave periods, with a bias; `Ensemble()`, the default, many runs,
    with a standard error.
    **Raises** CaseError for a parameter or a result that the case or the method does not have,
    DerivativeError where the slope would not be one of the flow, SimulationError as `run`.
    """
    parameter_value(case, parameter)
    result_of_power(case, of)
    return (Ensemble() if method is None else method).derivative(case, parameter, of, progress)
