"""`calibrate` and `FastModel`: a model of a case's oscillating water column that answers in a millisecond.

The model is linear theory with what the theory lacks, a loss at the lip and inertia of the column
(`waves.fast_owc`). Both are found from a few runs of the water. The model's error is that of its predictions
for runs that were left out of the fit.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy  # which imports its subpackages on first use
from jaxtyping import ArrayLike
from numpy.typing import NDArray

from jaxsph.case.case import Case
from jaxsph.case.linear import chamber_geometry, linear_air, why_no_theory
from jaxsph.case.settling import averages_from, settled_periods
from jaxsph.errors import CaseError, FileError
from jaxsph.problem.results import amplitude
from jaxsph.study.matrix import ScatterTable
from jaxsph.study.sweep import Sweep, sweep
from jaxsph.waves.fast_owc import (
    SHARE,
    Additions,
    Air,
    Incident,
    Response,
    WaterSeries,
    fast_response,
)
from jaxsph.waves.spectra import JONSWAP

KEYS = {
    "waves.H": "H",
    "waves.T": "T",
    "waves.Hs": "Hs",
    "waves.Tp": "Tp",
    "pto.K_dm": "K_dm",
    "device.draught": "draught",
    "device.chamber_length": "length",
    "device.wall_thickness": "thickness",
}
"""Parameters of a case that a model can change, with their names in `waves.fast_owc`."""
REGULAR, SEA = ("waves.H", "waves.T"), ("waves.Hs", "waves.Tp")
"""Parameters of regular waves and of a sea."""
VARIED = {
    "waves.H": (1.0, 1.0, 1.5, 0.75, 1.25),
    "waves.T": (1.0, 5 / 6, 7 / 6, 4 / 3, 11 / 12),
    "pto.K_dm": (1.0, 0.5, 0.5, 2.0, 0.75),
}
"""Factors of the case's height, period and damping in the runs of a calibration (-). Short waves and small
dampings, at which the loss and the inertia change the response most, occur more than once."""
READ = {"xi": "xi_measured", "P_a": amplitude("P_a"), "flow": amplitude("flow")}
"""Results of a run that a model predicts, by the names in `Response`."""
LEAST = 4
"""Least number of runs, so that each can be left out of a fit of two values."""
PERIODS = (0.25, 0.6, 2.2)
"""Range of wave periods of a model, relative to the shortest and the longest period of interest (-): regular
waves lie between the second and the third value, and all waves of a sea between the first and the third."""


class Predicted(NamedTuple):
    """A run and the model's predictions for it."""

    changes: dict[str, float]
    """Parameters of the run."""
    H: float
    """Measured height of the incident waves, m."""
    results: dict[str, float]
    """Results of the run, by the names in `READ`."""
    left_out: dict[str, float]
    """The same results by a model that was fitted to the other runs."""


@dataclass(frozen=True)
class FastModel:
    """Model of a case's oscillating water column in waves, in JAX: linear theory with a loss at the lip and
    inertia of the column, which were found from runs."""

    case: Case
    water: WaterSeries
    """Response of the water in linear theory."""
    added: Additions
    """Loss and inertia that were found."""
    added_error: Additions
    """Their standard errors."""
    runs: tuple[Predicted, ...]
    """Runs to which the model was fitted."""

    @classmethod
    def of_theory(cls, case: Case, periods: tuple[float, float] | None = None) -> FastModel:
        """Model of a case without loss and inertia, which is linear theory.

        `periods`: shortest and longest wave period of interest, s; by default that of the case. The range of
        the model is wider by the factors in `PERIODS`. **Raises** CaseError for a case without linear theory
        of an oscillating water column.
        """
        check(case, {})
        low, high = periods or 2 * (case.value("waves.T"),)
        reach = PERIODS[2] * high, PERIODS[1] * low, PERIODS[0] * low
        omega = tuple(2.0 * math.pi / T for T in reach)
        water = WaterSeries.of(chamber_geometry(case), omega, case.g)
        return cls(case, water, Additions(), Additions(), ())

    def response(self, changes: Mapping[str, ArrayLike] = {}) -> Response:
        """Efficiency, powers, flow, pressure and level in regular waves or in a sea, per metre of width.

        `changes`: parameters that differ from those of the case, by the names in `KEYS`. waves.Hs and
        waves.Tp, which are given together, choose a sea with a JONSWAP spectrum in the place of the case's
        regular waves. The values may be traced: a response can be vectorised by `jax.vmap` and differentiated
        by `jax.grad`. Results are NaN for periods, and for lengths of the device, outside the range of the
        model. **Raises** CaseError for another parameter, and for a sea whose height or period is missing.
        """
        for key in changes:
            if key not in KEYS:
                raise CaseError(
                    f"{key}: a fast model cannot change this parameter; use one of {', '.join(KEYS)}"
                )
        values = {KEYS[key]: jnp.asarray(value, float) for key, value in changes.items()}
        waves = self._incident(values)
        (pto,), linear = self.case.turbines, linear_air(self.case)
        air = Air(values.pop("K_dm", pto.quadratic or 0.0), linear.resistance, linear.give)
        found = fast_response(self.water, self.added, air, waves, values, self.case.fluid.rho0)
        within = self._within(waves, values)
        return jax.tree.map(lambda a: jnp.where(within, a, jnp.nan), found)

    def annual(self, table: ScatterTable, changes: Mapping[str, ArrayLike] = {}) -> jax.Array:
        """Mean power absorbed in the seas of a scatter table, weighted by their shares, W per metre of width.

        `changes`: parameters of the device, as in `response`. NaN if a sea is outside the range of the model.
        **Raises** CaseError for a parameter of the waves, which are those of the table.
        """
        for key in changes:
            if key in REGULAR + SEA:
                raise CaseError(f"{key}: the waves are those of the scatter table; vary the device only")
        used = table.share > 0.0

        def power(Hs: jax.Array, Tp: jax.Array) -> jax.Array:
            return self.response({**changes, "waves.Hs": Hs, "waves.Tp": Tp}).P_owc

        found = jax.vmap(power)(jnp.asarray(table.Hs[used]), jnp.asarray(table.Tp[used]))
        return jnp.asarray(table.share[used]) @ found

    def moved(self, case: Case) -> FastModel:
        """The model of a case with other lengths of the device; loss and inertia stay."""
        water = WaterSeries.of(chamber_geometry(case), self.water.omega, case.g)
        return dataclasses.replace(self, case=case, water=water)

    def _incident(self, values: dict[str, jax.Array]) -> Incident:
        """Incident waves with the case's or with changed values, which are removed from `values`."""
        of_sea, of_regular = ({key for key in keys if KEYS[key] in values} for keys in (SEA, REGULAR))
        if not of_sea:
            return Incident.regular(
                *(values.pop(name, getattr(self.case.waves, name)) for name in ("H", "T"))
            )
        if of_regular or len(of_sea) < len(SEA):
            raise CaseError(
                f"{', '.join(sorted(of_sea | of_regular))}: give {' and '.join(SEA)} together for a sea, or "
                f"{' and '.join(REGULAR)} for regular waves"
            )
        return Incident.sea(values.pop("Hs"), values.pop("Tp"), JONSWAP(1.0, 1.0))

    def _within(self, waves: Incident, lengths: Mapping[str, ArrayLike]) -> jax.Array:
        """Whether waves and lengths are in the range of the model."""
        low, middle, high = self.water.omega
        # seas contain waves of little power, which may be shorter than regular waves
        most = middle if len(waves.omega) == 1 else high
        found = (jnp.min(waves.omega) >= low) & (jnp.max(waves.omega) <= most)
        for name, value in lengths.items():
            usual = self.water.lengths[name]
            found &= jnp.abs(jnp.asarray(value) - usual) <= 2.0 * SHARE * usual
        return found

    @property
    def error(self) -> dict[str, float]:
        """Relative error of the model's predictions for runs that were left out (root of the mean square),
        by the names of the results in a `Response` (-); NaN without runs."""
        if not self.runs:
            return dict.fromkeys(READ, float("nan"))
        return {
            name: float(
                np.sqrt(np.mean([(one.left_out[name] / one.results[name] - 1.0) ** 2 for one in self.runs]))
            )
            for name in READ
        }

    def write(self, path: str | Path) -> None:
        """Writes the model to a file (JSON). **Raises** FileError if it cannot be written."""
        content = {
            "case": self.case.given(),
            "added": self.added._asdict(),
            "added_error": self.added_error._asdict(),
            "error": self.error,
            "runs": [one._asdict() for one in self.runs],
            "omega": self.water.omega,
            "water": np.asarray(self.water.coefficients, float).tolist(),
        }
        try:
            Path(path).write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
        except OSError as error:
            raise FileError(f"{path}: the model cannot be written: {error.strerror}") from None

    @classmethod
    def read(cls, path: str | Path) -> FastModel:
        """Model from its file. **Raises** FileError if the file is none of a model."""
        try:
            content = json.loads(Path(path).read_text(encoding="utf-8"))
            case = Case.from_dict(content["case"])
            if len(content["omega"]) != len(PERIODS):
                raise ValueError("it was written by an earlier version; run jaxsph calibrate again")
            found = np.asarray(content["water"]), tuple(content["omega"])
            water = WaterSeries.restored(*found, chamber_geometry(case), case.g)
            added, error = (Additions(**content[name]) for name in ("added", "added_error"))
            return cls(case, water, added, error, tuple(Predicted(**one) for one in content["runs"]))
        except OSError as error:
            raise FileError(f"{path}: {error.strerror}") from None
        except (ValueError, KeyError, TypeError) as error:
            raise FileError(f"{path} is no file of a fast model ({type(error).__name__}: {error})") from None


def calibrate(
    case: Case,
    out: str | Path,
    *,
    over: Mapping[str, Sequence[float]] | None = None,
    periods: tuple[float, float] | None = None,
    workers: int | None = None,
    executor: Executor | None = None,
    progress: bool = True,
) -> FastModel:
    """Fast model of a case's oscillating water column, from a few runs of the case.

    **Arguments**: `out`: file of the model; the runs are stored beside it, in `<name>_runs.h5`, from which a
    repeated call continues; `over`: parameters of the runs, lists of equal length by the names in `KEYS` for
    waves and damping; by default five runs around the case (`VARIED`); `periods`: shortest and longest period
    of interest, s, if they are beyond those of the runs; `workers`, `executor`: see `sweep`.
    **Raises** CaseError, before any run, for a case that linear theory of an oscillating water column does
    not cover; CaseError if fewer than four runs succeed; FileError as `sweep`.
    """
    path, over = Path(out).resolve(), over if over is not None else members_around(case)
    check(case, over)
    runs = sweep(case, over, runs_of(path), grid=False, workers=workers, executor=executor, progress=progress)
    model = fitted(case, runs, periods)
    model.write(path)
    return model


def members_around(case: Case) -> dict[str, list[float]]:
    """Parameters of the runs by which a case is calibrated, lists of equal length by name."""
    check(case, {})
    return {key: [case.value(key) * factor for factor in factors] for key, factors in VARIED.items()}


def runs_of(path: Path) -> Path:
    """File of the runs of a model with this file."""
    return path.with_name(f"{path.stem}_runs.h5")


def check(case: Case, over: Mapping[str, Sequence[float]]) -> None:
    """**Raises** CaseError if a case or the parameters of its runs do not suit a calibration."""
    if not isinstance(case, Case):
        raise CaseError("a fast model needs a case, and this is a program")
    if case.device is None or case.waves is None or case.waves.kind != "regular" or not case.turbines:
        raise CaseError("a fast model needs a device with a turbine in regular waves")
    if missing := why_no_theory(case):
        raise CaseError(f"{missing}: a fast model needs linear theory of the oscillating water column")
    for key, values in over.items():
        if key not in VARIED:
            raise CaseError(f"{key}: the runs of a calibration differ in {', '.join(VARIED)} only")
        if len(values) < LEAST:
            raise CaseError(f"{key}: a calibration needs {LEAST} runs or more, not {len(values)}")
    for values in zip(*over.values(), strict=False):
        member = case.replace(dict(zip(over, values, strict=True)))
        if settled_periods(member, member.t1) < 1:
            raise CaseError(
                f"t1 = {case.t1:g} s is too short for a run with waves.T = {member.value('waves.T'):.4g} s: "
                f"its waves settle after {averages_from(member):.3g} s; raise t1"
            )


def fitted(case: Case, runs: Sweep, periods: tuple[float, float] | None = None) -> FastModel:
    """Model of a case, fitted to runs; `periods` as in `calibrate`. **Raises** CaseError if fewer than
    `LEAST` runs succeeded."""
    found = [_read(runs, k) for k in range(len(next(iter(runs.axes.values())))) if (k,) not in runs.failures]
    if len(found) < LEAST:
        texts = "; ".join(f"{runs.words(k)}: {text}" for k, text in runs.failures.items())
        raise CaseError(f"only {len(found)} runs succeeded, and {LEAST} are needed. {texts}")
    T = [({"waves.T": case.value("waves.T")} | one.changes)["waves.T"] for one in found]
    T += periods or ()
    theory = FastModel.of_theory(case, (min(T), max(T)))
    fit = _Fit(theory, found)
    added, error = fit.to(np.ones(len(found)))
    predicted = []
    for k, one in enumerate(found):
        others, _ = fit.to(np.arange(len(found)) != k)
        at = fit.responses(others)
        left_out = {name: float(getattr(at, name)[k]) for name in READ}
        predicted.append(one._replace(left_out=left_out))
    return dataclasses.replace(theory, added=added, added_error=error, runs=tuple(predicted))


def _read(runs: Sweep, k: int) -> Predicted:
    """Parameters and results of a run, without predictions.

    **Raises** CaseError if its waves were not measured or have not settled.
    """
    missing = [of for of in ("incident_height", *READ.values()) if not np.isfinite(_result(runs, of, k))]
    if missing:
        raise CaseError(
            f"the run with {runs.words((k,))} has no {' and no '.join(missing)}: a fast model needs gauges "
            "(probes.gauges) that measure the incident waves, and t1 long enough for settled periods"
        )
    results = {name: _result(runs, of, k) for name, of in READ.items()}
    return Predicted(runs.at((k,)), _result(runs, "incident_height", k), results, {})


def _result(runs: Sweep, name: str, k: int) -> float:
    """Result of a run; NaN if no run has it."""
    return float(runs.results[name][k]) if name in runs.results else np.nan


class _Fit:
    """Fits of a model's loss and inertia to some of several runs, which share compiled functions."""

    def __init__(self, model: FastModel, runs: Sequence[Predicted]) -> None:
        """Fits of the loss and inertia of `model`, in which they are zero."""
        changes = _changes(runs)
        usual = jnp.asarray([[one.results[name] for name in READ] for one in runs])

        def responses(added: Additions) -> Response:
            return jax.vmap(dataclasses.replace(model, added=added).response)(changes)

        def residuals(x: jax.Array, weights: jax.Array) -> jax.Array:
            found = responses(Additions(x[0], x[1]))
            off = jnp.stack([getattr(found, name) for name in READ], 1) / usual - 1.0
            return jnp.ravel(off * weights[:, None])

        self.responses = jax.jit(responses)
        """Responses of a model with this loss and inertia in the waves of the runs, `[R]`."""
        self._residuals, self._slopes = jax.jit(residuals), jax.jit(jax.jacfwd(residuals))

    def to(self, weights: NDArray) -> tuple[Additions, Additions]:
        """Loss and inertia that fit the runs with weight 1 best, and their standard errors.

        The sum of the squares of the results' relative errors is the least. The standard errors follow from
        the scatter of these errors. The weights of the other runs are 0.
        """

        def of(function: Callable[..., jax.Array]) -> Callable[[NDArray], NDArray]:
            return lambda x: np.asarray(function(jnp.asarray(x), jnp.asarray(weights, float)), float)

        best = scipy.optimize.least_squares(
            of(self._residuals),
            [1.0, 0.0],
            of(self._slopes),
            bounds=([0.0, -0.5], [np.inf, 2.0]),
            x_scale=[1.0, 0.1],
        )
        freedom = np.count_nonzero(weights) * len(READ) - best.x.size
        covariance = np.linalg.pinv(best.jac.T @ best.jac) * (2.0 * best.cost / freedom)
        return Additions(*map(float, best.x)), Additions(*map(float, np.sqrt(np.diag(covariance))))


def _changes(runs: Sequence[Predicted]) -> dict[str, jax.Array]:
    """Parameters of runs, with the measured heights of their waves."""
    found = {key: jnp.asarray([one.changes[key] for one in runs]) for key in runs[0].changes}
    return found | {"waves.H": jnp.asarray([one.H for one in runs])}
