"""Slope of a result from an ensemble of runs around the case's value of a parameter."""

from __future__ import annotations

import dataclasses
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import numpy as np

from jaxsph.errors import CaseError, DerivativeError
from jaxsph.problem.source import Source
from jaxsph.study.base import (
    AbstractMethod,
    Derivative,
    check_result,
    parameter_value,
)
from jaxsph.study.sweep import MOST_MEMBERS, sweep


class Members(NamedTuple):
    """Runs of an ensemble that gave a result."""

    parameter: str
    of: str
    value: float
    """The source's value of the parameter, as it is built."""
    values: np.ndarray
    """Values of the parameter in all runs."""
    results: np.ndarray
    """The result of all runs; NaN for runs that have none."""
    failures: dict[int, str]
    """Error messages of failed runs, by their numbers."""

    @property
    def known(self) -> np.ndarray:
        """Whether each run has the result."""
        return np.isfinite(self.results)

    @property
    def offsets(self) -> np.ndarray:
        """Relative changes of the parameter in the runs that have the result (-)."""
        return self.values[self.known] / self.value - 1.0

    def derivative(self, method: AbstractMethod, value: float, slope: float, error: float) -> Derivative:
        """Derivative from its value, and its slope and error over the relative change of the parameter."""
        return Derivative(
            self.parameter,
            self.of,
            value,
            slope / self.value,
            error / abs(self.value),
            float(np.max(np.abs(self.values / self.value - 1.0))) * abs(self.value),
            method,
            members={self.parameter: self.values, self.of: self.results},
            failures=self.failures,
        )


class Ensemble(AbstractMethod):
    """Ensemble of runs around the case's value; a parabola fitted to the runs' results gives the slope.

    Each member is a complete run with its own chaotic particle motion, which scatters the results about the
    parabola. The scatter gives the standard error of the slope, and a wider spread reduces this error.
    """

    spread: float = eqx.field(static=True, default=0.3)
    """Largest relative change of the value to either side (-); the members are spaced evenly."""
    members: int = eqx.field(static=True, default=9)
    """Number of runs, four or more."""
    out: str | Path | None = eqx.field(static=True, default=None)
    """File that stores the members, and from which an interrupted ensemble continues; None stores nothing."""
    workers: int | None = eqx.field(static=True, default=None)
    """Number of runs at a time; by default one per core."""

    def __check_init__(self) -> None:
        """**Raises** CaseError for settings that give no slope, or a slope without an error."""
        if not 0.0 < self.spread < 1.0:
            raise CaseError(f"spread = {self.spread:g}: must lie between 0 and 1")
        if not 4 <= self.members <= MOST_MEMBERS:
            raise CaseError(f"members = {self.members}: must lie between 4 and {MOST_MEMBERS}")

    def kept(self, path):
        """See `AbstractMethod.kept`."""
        return self if self.out is not None else dataclasses.replace(self, out=path)

    def derivative(self, source, parameter, of, progress):
        """See `AbstractMethod.derivative`."""
        found = self.members_of(source, parameter, of, progress)
        fit = parabola(found.offsets, found.results[found.known])
        return found.derivative(self, fit.value, fit.slope, fit.error)

    def members_of(self, source: Source, parameter: str, of: str, progress: bool) -> Members:
        """Runs of the ensemble, of which four or more have the result; arguments and errors as for
        `study.derivative`."""
        value = parameter_value(source, parameter)
        check_result(source.problem(), of)
        if value == 0.0:
            raise CaseError(
                f"{parameter} = 0: must not be 0, as an ensemble varies the value by relative steps"
            )
        shares = self.spread * np.linspace(-1.0, 1.0, self.members)
        values = _as_built(source, parameter, [float(v) for v in value * (1.0 + shares)])
        with tempfile.TemporaryDirectory() as folder:
            out = Path(folder) / "members.h5" if self.out is None else Path(self.out)
            done = sweep(source, {parameter: values}, out, workers=self.workers, progress=progress)
        # a result "energy_pto" may cover settled periods only: prefer the budget of the whole run; the mean
        # power of a body is called P_pto
        names = {"energy_pto": ("whole_energy_pto", "energy_pto"), "P_owc": ("P_owc", "P_pto")}.get(of, (of,))
        nothing = np.full(len(values), np.nan)
        results = next((done[name] for name in names if name in done.results), nothing)
        failures = {place[0]: text for place, text in sorted(done.failures.items())}
        known = np.isfinite(results).sum()
        if known < 4:
            first = next(
                iter(failures.values()),
                "the runs have no such result, for example because t1 is too small",
            )
            raise DerivativeError(
                f"only {known} of {len(values)} members gave {of}, but a slope needs four: {first}"
            )
        return Members(parameter, of, float(source.built(parameter)), np.asarray(values), results, failures)


def _as_built(source: Source, parameter: str, values: list[float]) -> list[float]:
    """Distinct values with which the members are built, after lengths are rounded to whole spacings.

    **Raises** CaseError if fewer than four values remain, because the error of the slope needs four.
    """
    built = [float(source.replace({parameter: value}).built(parameter)) for value in values]
    different = list(dict.fromkeys(built))
    if len(different) < 4:
        shown = ", ".join(f"{value:g}" for value in different)
        raise CaseError(
            f"{parameter}: the lattice rounds the values between {values[0]:g} and {values[-1]:g} m to only "
            f"{shown} m, but a slope needs four values; reduce dx, or increase the spread"
        )
    return different


@dataclass(frozen=True)
class Parabola:
    """Parabola y = value + slope x + curvature x^2/2, and the standard error of its slope."""

    value: float
    slope: float
    error: float
    curvature: float


def parabola(x: np.ndarray, y: np.ndarray) -> Parabola:
    """Least-squares parabola through the points; at least four are needed for the error of its slope."""
    A = np.stack([np.ones_like(x), x, 0.5 * x**2], axis=1)
    found, *_ = np.linalg.lstsq(A, y, rcond=None)
    variance = np.sum((y - A @ found) ** 2) / (len(x) - 3)
    covariance = variance * np.linalg.inv(A.T @ A)
    return Parabola(float(found[0]), float(found[1]), float(np.sqrt(covariance[1, 1])), float(found[2]))
