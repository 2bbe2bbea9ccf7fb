"""Power matrix: mean power at each significant height and peak period, and its mean over a scatter table."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy  # which imports its subpackages on first use
from numpy.typing import ArrayLike, NDArray

from jaxsph.analysis import Mean
from jaxsph.case.case import Case
from jaxsph.case.data_files import read_columns
from jaxsph.case.linear import linear_sea, sea_is_linear
from jaxsph.case.results import mean_of_power
from jaxsph.errors import CaseError
from jaxsph.study.sweep import MOST_MEMBERS, Sweep, sweep

SEA_AXES = ["waves.Hs", "waves.Tp", "waves.seed"]
"""Parameters of the sweep of a power matrix, in order."""
HOURS = 8766.0
"""Number of hours in a mean year of 365.25 days."""
MOST_NAMED = 10
"""Largest number of sea states that an error message names."""


@dataclass(frozen=True)
class ScatterTable:
    """Scatter table: sea states at a site, and their shares of the year."""

    Hs: NDArray[np.float64]
    """Significant wave heights, m."""
    Tp: NDArray[np.float64]
    """Peak periods, s."""
    share: NDArray[np.float64]
    """Shares of the year (-), which sum to 1."""
    hours: float | None = None
    """Hours that the table covers, h; None if the table gives shares."""

    @classmethod
    def read(cls, path: str | Path) -> ScatterTable:
        """Reads a table from a CSV file with the columns Hs (m), Tp (s), and share (-) or hours (h).

        **Raises** CaseError for other columns, and for shares that are negative or do not sum to 1.
        """
        units = {"Hs": "m", "Tp": "s", "share": "-", "hours": "h"}
        found = read_columns(path, units, [{"Hs", "Tp", "share"}, {"Hs", "Tp", "hours"}])
        columns = {name: np.array(values) for name, values in found.items()}
        kind = "share" if "share" in columns else "hours"
        weight = columns[kind]
        if np.any(weight < 0.0) or not np.sum(weight) > 0.0:
            raise CaseError(
                f"{path}: values of {kind} must not be negative, and at least one must be positive"
            )
        if kind == "share" and abs(np.sum(weight) - 1.0) > 1e-3:
            raise CaseError(
                f"{path}: the shares must add up to 1, but add up to {np.sum(weight):.4g}; if the values are "
                "hours, name the column hours"
            )
        hours = float(np.sum(weight)) if kind == "hours" else None
        return cls(columns["Hs"], columns["Tp"], weight / np.sum(weight), hours)

    def check_within(self, Hs: ArrayLike, Tp: ArrayLike) -> None:
        """**Raises** CaseError if a sea state of the table lies outside a matrix over Hs (m) and Tp (s)."""
        used = self.share > 0.0
        for name, unit, axis, values in (("Hs", "m", Hs, self.Hs[used]), ("Tp", "s", Tp, self.Tp[used])):
            outside = (values < np.min(axis) - 1e-9) | (values > np.max(axis) + 1e-9)
            if np.any(outside):
                raise CaseError(
                    f"the table has {name} = {values[outside][0]:g} {unit}, but the matrix covers only "
                    f"{np.min(axis):g} to {np.max(axis):g} {unit}: extend the matrix, or remove this sea "
                    "state from the table"
                )


@dataclass(frozen=True)
class PowerMatrix:
    """Mean absorbed power of a device in each sea state, its standard error, and power by linear theory."""

    Hs: NDArray[np.float64]
    """Significant wave heights, m."""
    Tp: NDArray[np.float64]
    """Peak periods, s."""
    P: NDArray[np.float64]
    """Mean absorbed power, averaged over the seeds, `[Hs, Tp]`, W (W/m in 2-D); NaN if no run has a result.
    The power of a run over a part of its sea is multiplied by the ratio of the incident power of the whole
    sea to that of the part."""
    error: NDArray[np.float64]
    """Standard error of the mean power, `[Hs, Tp]`, W (W/m in 2-D); NaN if it is unknown, for example for a
    single run in a three-dimensional tank."""
    xi: NDArray[np.float64]
    """Hydrodynamic efficiency, `[Hs, Tp]` (-); NaN in a three-dimensional tank, where it is undefined."""
    linear: NDArray[np.float64]
    """Mean power by linear theory, `[Hs, Tp]`, W/m; NaN if the theory does not cover the case."""
    sweep: Sweep
    """Sweep with the runs."""

    @property
    def unit(self) -> str:
        """Unit of the powers: W, or W/m in two dimensions."""
        return "W/m" if self.sweep.case.tank.width is None else "W"

    def annual(self, table: ScatterTable) -> Mean:
        """Mean power over the year of a scatter table, and its standard error, W (W/m in 2-D).

        The power is interpolated linearly between the sea states of the matrix. **Raises** CaseError if the
        table has sea states outside the matrix, or needs a cell whose runs failed.
        """
        weight = self._weights(table)
        missing = np.argwhere(~np.isfinite(self.P) & (weight > 0.0))
        if missing.size:
            named = [f"Hs = {self.Hs[i]:g} m, Tp = {self.Tp[j]:g} s" for i, j in missing]
            more = [f"{len(named) - MOST_NAMED} more"] if len(named) > MOST_NAMED else []
            raise CaseError(
                "the matrix has no mean power for some sea states of the table, because it has none at "
                f"{'; '.join([*named[:MOST_NAMED], *more])}: run the matrix again (with a larger t1 if no "
                "run failed), or remove the sea states at and next to these from the table"
            )
        P, error = (np.where(weight > 0.0, a, 0.0) for a in (self.P, self.error))
        return Mean(float(np.sum(weight * P)), float(np.sqrt(np.sum((weight * error) ** 2))))

    def annual_linear(self, table: ScatterTable) -> float:
        """Mean power over the year of a scatter table by linear theory, W/m; NaN if the theory does not cover
        the case."""
        weight = self._weights(table)
        return float(np.sum(weight * np.where(weight > 0.0, self.linear, 0.0)))

    def _weights(self, table: ScatterTable) -> NDArray[np.float64]:
        """Weight of every cell in the mean over a scatter table, `[Hs, Tp]`."""
        table.check_within(self.Hs, self.Tp)
        used = table.share > 0.0
        places = np.stack([table.Hs[used], table.Tp[used]], axis=1)
        weights = np.zeros((len(self.Hs), len(self.Tp)))
        for cell in np.ndindex(weights.shape):
            one = np.zeros(weights.shape)
            one[cell] = 1.0
            weights[cell] = np.sum(table.share[used] * _interpolated(self.Hs, self.Tp, one, places))
        return weights


def _interpolated(Hs: NDArray, Tp: NDArray, values: NDArray, places: NDArray) -> NDArray[np.float64]:
    """Values interpolated linearly between sea states; along an axis with one value they are constant."""
    axes, at, kept = [], [], values
    for axis, points in enumerate((Hs, Tp)):
        if len(points) > 1:
            axes.append(points)
            at.append(np.clip(places[:, axis], points[0], points[-1]))
        else:
            kept = np.take(kept, 0, axis=axis - (values.ndim - kept.ndim))
    if not axes:
        return np.full(len(places), float(kept))
    return scipy.interpolate.RegularGridInterpolator(axes, kept)(np.stack(at, axis=1))


def power_matrix(
    case: Case,
    Hs: Sequence[float],
    Tp: Sequence[float],
    out: str | Path,
    *,
    seeds: int = 1,
    workers: int | None = None,
    executor: Executor | None = None,
    progress: bool = True,
) -> PowerMatrix:
    """Mean power of a case's device in every sea state of a grid, averaged over `seeds` runs per sea state.

    **Arguments**: significant heights `Hs` (m) and peak periods `Tp` (s), ascending; `out`: the sweep file of
    the runs, from which an interrupted matrix continues; `workers`, `executor`: see `sweep`. The error of a
    cell is the larger of two standard errors: one from the scatter between seeds, and one from the errors of
    the runs' means. **Raises** CaseError if the case has no irregular waves or no power take-off, or if a sea
    state is not possible in the tank.
    """
    if not isinstance(case, Case) or case.waves is None or case.waves.kind != "irregular":
        raise CaseError(
            "a power matrix varies waves.Hs, waves.Tp and waves.seed: give a case with "
            'waves.kind = "irregular", or change the waves with --set waves.kind=irregular '
            "--set waves.Hs=0.04 --set waves.Tp=1.4"
        )
    if not 1 <= seeds <= MOST_MEMBERS:
        raise CaseError(f"seeds = {seeds}: must be from 1 to {MOST_MEMBERS}")
    axes = {"Hs": np.asarray(Hs, float), "Tp": np.asarray(Tp, float)}
    for name, values in axes.items():
        if values.ndim != 1 or not values.size or np.any(np.diff(values) <= 0.0):
            raise CaseError(
                f"{name} = {list(values)}: must be one or more values in ascending order, each given once"
            )
    for height, period in itertools.product(axes["Hs"].tolist(), axes["Tp"].tolist()):
        mean_of_power(case.replace({"waves.Hs": height, "waves.Tp": period}), "P_owc")
    first = case.waves.seed
    over = {
        "waves.Hs": axes["Hs"],
        "waves.Tp": axes["Tp"],
        "waves.seed": np.arange(first, first + seeds),
    }
    done = sweep(case, over, out, workers=workers, executor=executor, progress=progress)
    return matrix_of(done)


def of_the_sea(results: Mapping[str, Any]) -> dict[str, Any]:
    """Results in which the powers of runs over a part of a sea are scaled to the power of the whole sea.

    The values are numbers, or arrays over the members of a sweep.
    """
    part, whole = (np.asarray(results.get(name, np.nan), float) for name in ("P_inc", "P_inc_sea"))
    ratio = np.where(np.isfinite(whole), whole / part, 1.0)
    powers = {name: results[name] * ratio for name in ("P_inc", "P_owc", "P_pto") if name in results}
    return {**results, **powers}


def _first_failure(done: Sweep) -> str:
    """End of an error message: the number of failed runs, and why the first failed; empty if none failed."""
    if not done.failures:
        return ""
    place = min(done.failures)
    Hs, Tp, seed = (values[k] for values, k in zip(done.axes.values(), place, strict=True))
    return (
        f"; {len(done.failures)} of {len(done.members)} runs failed, first the one with Hs = {Hs:g} m, "
        f"Tp = {Tp:g} s and seed = {seed:g}: {done.failures[place].splitlines()[0]}"
    )


def matrix_of(done: Sweep) -> PowerMatrix:
    """Power matrix of a sweep over waves.Hs, Tp and seed. **Raises** CaseError for other sweeps."""
    if [*done.axes] != SEA_AXES:
        raise CaseError(
            "a power matrix needs a sweep over waves.Hs, waves.Tp and waves.seed, and not over "
            f"{', '.join(done.axes)}"
        )
    named = [name for name in ("P_owc", "P_pto") if name in done.results]
    if not named:
        raise CaseError(
            "no run gave an absorbed power: check that the runs have not failed, that a device has a "
            f"damping, and that t1 is long enough{_first_failure(done)}"
        )
    results = of_the_sea(done.results)
    powers = results[named[0]]
    # in three dimensions there is neither an efficiency nor its error
    unknown = np.full(powers.shape, np.nan)
    efficiency, xi_error = (results.get(name, unknown) for name in ("xi", "xi_error"))
    within = xi_error * results["P_inc"]
    count = np.sum(np.isfinite(powers), axis=2)
    known = np.maximum(count, 1)
    P = np.where(count > 0, np.nansum(powers, axis=2) / known, np.nan)
    between = np.sqrt(np.nansum((powers - P[..., None]) ** 2, axis=2) / np.maximum(count - 1, 1) / known)
    between = np.where(count > 1, between, np.nan)
    of_runs = np.where(
        np.any(np.isfinite(within), axis=2), np.sqrt(np.nansum(within**2, axis=2)) / known, np.nan
    )
    Hs, Tp = (np.asarray(done.axes[name], float) for name in ("waves.Hs", "waves.Tp"))
    linear = np.full(P.shape, np.nan)
    if sea_is_linear(done.case):
        for i, j in np.ndindex(P.shape):
            linear[i, j] = linear_sea(done.case.replace({"waves.Hs": Hs[i], "waves.Tp": Tp[j]})).P_owc
    xi = np.where(np.any(np.isfinite(efficiency), axis=2), np.nansum(efficiency, axis=2) / known, np.nan)
    error = np.where(count > 0, np.fmax(between, of_runs), np.nan)
    return PowerMatrix(Hs, Tp, P, error, xi, linear, done)
