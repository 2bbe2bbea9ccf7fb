"""Slope of a result by an ensemble of runs around the case's value."""

from __future__ import annotations

import dataclasses
import tempfile
from dataclasses import dataclass
from pathlib import Path

import equinox as eqx
import numpy as np

from jaxsph.errors import CaseError, DerivativeError
from jaxsph.study.base import (
    AbstractMethod,
    Derivative,
    check_result,
    parameter_value,
)
from jaxsph.study.sweep import MOST_MEMBERS, sweep


class Ensemble(AbstractMethod):
    """Ensemble of runs around the case's value, whose slope is that of a parabola through their results.

    Each member is a whole run with its own chaotic particles, so the scatter about the parabola is the error
    to reckon with, and a wide enough spread the remedy. `out` keeps the members in a file that resumes.
    """

    spread: float = eqx.field(static=True, default=0.3)
    """Share of the value, to either side, over which the members lie evenly."""
    members: int = eqx.field(static=True, default=9)
    """Number of runs, four or more."""
    out: str | Path | None = eqx.field(static=True, default=None)
    """File that keeps the members; None keeps none."""
    workers: int | None = eqx.field(static=True, default=None)
    """Number of runs at a time; by default one per core."""

    def __check_init__(self) -> None:
        """Refuses what gives no slope, or one without an error."""
        if not 0.0 < self.spread < 1.0 or not 4 <= self.members <= MOST_MEMBERS:
            raise CaseError(
                f"spread = {self.spread:g} must lie between 0 and 1, and members = {self.members} be four "
                f"or more, up to {MOST_MEMBERS}"
            )

    def kept(self, path):
        """See `AbstractMethod`."""
        return self if self.out is not None else dataclasses.replace(self, out=path)

    def derivative(self, source, parameter, of, progress):
        """See `AbstractMethod`."""
        value = parameter_value(source, parameter)
        check_result(source.problem(), of)
        if value == 0.0:
            raise CaseError(f"{parameter} = 0: an ensemble spreads by a share of the value")
        offsets = self.spread * np.linspace(-1.0, 1.0, self.members)
        values = [float(v) for v in value * (1.0 + offsets)]
        with tempfile.TemporaryDirectory() as folder:
            out = Path(folder) / "members.h5" if self.out is None else Path(self.out)
            done = sweep(source, {parameter: values}, out, workers=self.workers, progress=progress)
        # the energy of the whole run, where its budget is beside that of settled periods; of a body the mean
        # power has a name of its own
        names = {"energy_pto": ("whole_energy_pto", "energy_pto"), "P_owc": ("P_owc", "P_pto")}.get(of, (of,))
        nothing = np.full(len(values), np.nan)
        found = next((done[name] for name in names if name in done.results), nothing)
        known = np.isfinite(found)
        if known.sum() < 4:
            first = next(iter(done.failures.values()), "the members have no such result")
            raise DerivativeError(f"only {known.sum()} of {self.members} members gave {of}: {first}")
        fit = parabola(offsets[known], found[known])
        members = {parameter: np.asarray(values), of: found}
        scale = 1.0 / value
        return Derivative(
            parameter,
            of,
            fit.value,
            fit.slope * scale,
            fit.error * abs(scale),
            self.spread * abs(value),
            self,
            members=members,
        )


@dataclass(frozen=True)
class Parabola:
    """y = value + slope x + curvature x^2/2 through points, and the standard error of its slope."""

    value: float
    slope: float
    error: float
    curvature: float


def parabola(x: np.ndarray, y: np.ndarray) -> Parabola:
    """Parabola through points by least squares; four points or more also give the error of its slope."""
    A = np.stack([np.ones_like(x), x, 0.5 * x**2], axis=1)
    found, *_ = np.linalg.lstsq(A, y, rcond=None)
    variance = np.sum((y - A @ found) ** 2) / (len(x) - 3)
    covariance = variance * np.linalg.inv(A.T @ A)
    return Parabola(float(found[0]), float(found[1]), float(np.sqrt(covariance[1, 1])), float(found[2]))
