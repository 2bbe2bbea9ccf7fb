"""Power matrix: mean power at each significant height and peak period, and its mean over a scatter table."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy  # which imports its subpackages on first use
from numpy.typing import NDArray

from jaxsph.case.case import Case
from jaxsph.case.linear import linear_sea, sea_is_linear
from jaxsph.case.results import mean_of_power
from jaxsph.errors import CaseError
from jaxsph.output.sweep_file import LIMIT, LIMIT_ERROR, SCHEME_ERROR
from jaxsph.study.fast_model import FastModel
from jaxsph.study.scatter import ScatterTable
from jaxsph.study.sweep import MOST_MEMBERS, Sweep, sweep

SEA_AXES = ["waves.Hs", "waves.Tp", "waves.seed"]
"""Parameters of the sweep of a power matrix, in order."""
MOST_NAMED = 10
"""Largest number of sea states that an error message names."""


class Year(NamedTuple):
    """Mean power over the seas of a scatter table and its standard errors, W (W/m in 2-D)."""

    value: float
    waves: float
    """Error due to the random seas, in which the runs have a finite length."""
    between: float
    """Error of the power in sea states that differ from those of the runs; NaN if it is unknown."""
    spacing: float
    """Error due to the spacing of the particles; NaN if no run was repeated with half of its spacing."""
    scheme: float
    """Error due to the scheme; NaN if no run was repeated with the other scheme."""

    @property
    def error(self) -> float:
        """Root of the sum of the squares of the known errors; NaN if none is known."""
        known = [error for error in self[1:] if np.isfinite(error)]
        return float(np.linalg.norm(known)) if known else float("nan")


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

    def annual(self, table: ScatterTable, model: FastModel | None = None) -> Year:
        """Mean power over the seas of a scatter table, with its errors by origin.

        Between the sea states of the matrix, the power is interpolated linearly. With a fast `model` of the
        device, the ratio of the power to that of the model is interpolated instead, and is constant outside
        the matrix. The scatter of this ratio over the matrix is then the error of the power in other sea
        states. **Raises** CaseError if the table has sea states outside the matrix, or with a model outside
        the range of the model, or needs a cell whose runs failed.
        """
        used = table.used
        share, seas = used.share, np.stack([used.Hs, used.Tp], axis=1)
        cells = np.stack(np.meshgrid(self.Hs, self.Tp, indexing="ij"), axis=-1).reshape(-1, 2)
        if model is None:
            table.check_within(self.Hs, self.Tp)
            usual, here = np.ones(self.P.shape), np.ones(len(seas))
        else:
            model = model.moved(self.sweep.case)
            usual = powers_of_model(model, *cells.T).reshape(self.P.shape)
            here = powers_of_model(model, used.Hs, used.Tp)
        weight = self._weights(seas, share * here)
        missing = np.argwhere(~np.isfinite(self.P) & (weight > 0.0))
        if missing.size:
            named = [f"Hs = {self.Hs[i]:g} m, Tp = {self.Tp[j]:g} s" for i, j in missing]
            more = [f"{len(named) - MOST_NAMED} more"] if len(named) > MOST_NAMED else []
            raise CaseError(
                "the matrix has no mean power for some sea states of the table, because it has none at "
                f"{'; '.join([*named[:MOST_NAMED], *more])}: run the matrix again (with a larger t1 if no "
                "run failed), or remove the sea states at and next to these from the table"
            )
        ratio, error = (np.where(weight > 0.0, a / usual, 0.0) for a in (self.P, self.error))
        value = float(np.sum(weight * ratio))
        # the seas without runs, and their share of the power
        other = ~np.any(np.all(np.isclose(seas[:, None], cells), axis=2), axis=1)
        part = np.sum((share * here)[other]) / np.sum(share * here)
        between = part * _scatter(self.P / usual, model) if np.any(other) else 0.0
        waves = float(np.linalg.norm(weight * error))
        spacing, scheme = self._error_of_spacing() * value, self._error_of_scheme() * value
        return Year(value, waves, between * value, spacing, scheme)

    def annual_linear(self, table: ScatterTable) -> float:
        """Mean power over the year of a scatter table by linear theory, W/m; NaN if the theory does not cover
        the case."""
        table.check_within(self.Hs, self.Tp)
        used = table.used
        weight = self._weights(np.stack([used.Hs, used.Tp], axis=1), used.share)
        return float(np.sum(weight * np.where(weight > 0.0, self.linear, 0.0)))

    def _weights(self, seas: NDArray, share: NDArray) -> NDArray[np.float64]:
        """Weight of every cell in the sum over seas `[S, 2]` (m, s) with these shares `[S]`, `[Hs, Tp]`."""
        weights = np.zeros((len(self.Hs), len(self.Tp)))
        for cell in np.ndindex(weights.shape):
            one = np.zeros(weights.shape)
            one[cell] = 1.0
            weights[cell] = np.sum(share * _interpolated(self.Hs, self.Tp, one, seas))
        return weights

    def _error_of_spacing(self) -> float:
        """Relative error due to the spacing, from the members whose limits are known (-); NaN without any."""
        power = _name_of_power(self.sweep)
        if LIMIT + power not in self.sweep.results:
            return float("nan")
        of_run, limit, error = (self.sweep[before + power] for before in ("", LIMIT, LIMIT_ERROR))
        off = np.hypot(limit / of_run - 1.0, error / of_run)
        return float(np.sqrt(np.nanmean(off**2)))

    def _error_of_scheme(self) -> float:
        """Relative error due to the scheme, from the members that the other scheme ran too (-); NaN without
        any."""
        power = _name_of_power(self.sweep)
        if SCHEME_ERROR + power not in self.sweep.results:
            return float("nan")
        error, limit = (self.sweep[before + power] for before in (SCHEME_ERROR, LIMIT))
        return float(np.sqrt(np.nanmean((error / limit) ** 2)))


def powers_of_model(model: FastModel, Hs: NDArray, Tp: NDArray) -> NDArray[np.float64]:
    """Powers of a fast model in seas, W/m. **Raises** CaseError outside the model's range of periods."""
    results = jax.jit(jax.vmap(model.results))({"waves.Hs": jnp.asarray(Hs), "waves.Tp": jnp.asarray(Tp)})
    found = np.asarray(results[model.theory.power], float)
    if not np.all(np.isfinite(found)):
        k = np.argmin(np.isfinite(found))
        raise CaseError(
            f"the fast model has no power at Hs = {Hs[k]:g} m, Tp = {Tp[k]:g} s, which is outside its range "
            "of periods: calibrate it with runs of such periods, or remove this sea state from the table"
        )
    return found


def _scatter(ratio: NDArray, model: FastModel | None) -> float:
    """Relative scatter of the ratios of powers to those of a model (-); for one cell the model's own error,
    and NaN without a model."""
    if model is None:
        return float("nan")
    known = ratio[np.isfinite(ratio)]
    if len(known) < 2:
        return model.error[model.theory.predictable[model.theory.power].like]
    return float(np.std(known, ddof=1) / np.mean(known))


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
    over = members_of(case, Hs, Tp, seeds)
    done = sweep(case, over, out, workers=workers, executor=executor, progress=progress)
    return matrix_of(done)


def members_of(case: Case, Hs: Sequence[float], Tp: Sequence[float], seeds: int) -> dict[str, list[Any]]:
    """Parameters of the runs of a power matrix. **Raises** CaseError as `power_matrix`, before any run."""
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
    return {
        "waves.Hs": axes["Hs"].tolist(),
        "waves.Tp": axes["Tp"].tolist(),
        "waves.seed": [*range(first, first + seeds)],
    }


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


def _name_of_power(done: Sweep) -> str:
    """Name of the absorbed power in the results of a sweep. **Raises** CaseError if no run gave one."""
    for name in ("P_owc", "P_pto"):
        if name in done.results:
            return name
    raise CaseError(
        "no run gave an absorbed power: check that the runs have not failed, that a device has a damping, "
        f"and that t1 is long enough{_first_failure(done)}"
    )


def matrix_of(done: Sweep) -> PowerMatrix:
    """Power matrix of a sweep over waves.Hs, Tp and seed. **Raises** CaseError for other sweeps."""
    if [*done.axes] != SEA_AXES:
        raise CaseError(
            "a power matrix needs a sweep over waves.Hs, waves.Tp and waves.seed, and not over "
            f"{', '.join(done.axes)}"
        )
    results = of_the_sea(done.results)
    powers = results[_name_of_power(done)]
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
