"""`calibrate` and `FastModel`: a model of a case's device in waves that answers in a millisecond.

The model is linear theory with what the theory lacks: a loss at the lip and inertia of an oscillating water
column (`waves.fast_owc`), or drag and inertia of bodies (`waves.fast_bodies`). These are found from a few
runs of the water. The model's error is that of its predictions for runs that were left out of the fit.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import jax.flatten_util
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

from jaxsph.case.case import Case
from jaxsph.case.settling import averages_from, settled_periods
from jaxsph.core.chebyshev import Series
from jaxsph.errors import CaseError, FileError
from jaxsph.study.fast_bodies import BodyTheory
from jaxsph.study.fast_column import ColumnTheory
from jaxsph.study.fast_column_motion import ColumnMotionTheory
from jaxsph.study.fast_fit import Fit, Predicted
from jaxsph.study.fast_motion import MotionTheory
from jaxsph.study.fast_theory import AbstractFastTheory
from jaxsph.study.optimise import best_evaluation
from jaxsph.study.scatter import ScatterTable
from jaxsph.study.sweep import Sweep, sweep
from jaxsph.waves.fast_owc import Incident
from jaxsph.waves.spectra import JONSWAP

REGULAR, SEA = {"waves.H": "H", "waves.T": "T"}, {"waves.Hs": "Hs", "waves.Tp": "Tp"}
"""Parameters of regular waves and of a sea, with their names in `Incident`."""
VARIED = {"waves.H": (1.0, 1.0, 1.5, 0.75, 1.25), "waves.T": (1.0, 5 / 6, 7 / 6, 4 / 3, 11 / 12)}
"""Factors of the case's height and period in the runs of a calibration (-)."""
DAMPED = (1.0, 0.5, 0.5, 2.0, 0.75)
"""Factors of the dampings in the same runs (-). Short waves and small dampings, at which losses and inertia
change the response most, occur more than once."""
MODELS = "models"
"""End of the name of the folder of a search's models."""
LEAST = 4
"""Least number of runs, so that each can be left out of a fit of two values."""
PERIODS = (0.25, 0.6, 2.2)
"""Range of wave periods of a model, relative to the shortest and the longest period of interest (-): regular
waves lie between the second and the third value, and all waves of a sea between the first and the third."""


@dataclass(frozen=True)
class FastModel:
    """Model of a case's device in waves, in JAX: linear theory with additions that were found from runs."""

    theory: AbstractFastTheory
    """Linear theory of the case."""
    added: Any
    """What was found: `Additions` of a column, or `BodyAdditions`."""
    added_error: Any
    """The standard errors."""
    runs: tuple[Predicted, ...]
    """Runs to which the model was fitted."""

    @property
    def case(self) -> Case:
        """Case of the model."""
        return self.theory.case

    @classmethod
    def of_theory(cls, case: Case, periods: tuple[float, float] | None = None) -> FastModel:
        """Model of a case without additions, which is linear theory.

        `periods`: shortest and longest wave period of interest, s; by default that of the case. The range of
        the model is wider by the factors in `PERIODS`. **Raises** CaseError for a case without linear theory
        of an oscillating water column, or of bodies with power take-offs.
        """
        check(case, {})
        low, high = periods or 2 * (case.value("waves.T"),)
        reach = PERIODS[2] * high, PERIODS[1] * low, PERIODS[0] * low
        theory = kind_of(case).of(case, tuple(2.0 * math.pi / T for T in reach))
        none = jax.tree.map(lambda _: 0.0, theory.additions.start)
        return cls(theory, none, none, ())

    def response(self, changes: Mapping[str, ArrayLike] = {}) -> Any:
        """Response to regular waves or to a sea, per metre of width: `waves.fast_owc.Response` of a column,
        `waves.fast_bodies.BodyResponse` of bodies. Motions that are found in time are a
        `waves.column_motion.ColumnMotion` or a `waves.body_motion.BodyMotion`.

        `changes`: parameters that differ from those of the case: waves, and those of the device in `keys`.
        waves.Hs and waves.Tp, which are given together, choose a sea with a JONSWAP spectrum in the place of
        the case's regular waves. The values may be traced: a response can be vectorised by `jax.vmap` and
        differentiated by `jax.grad`. Results are NaN for periods, and for lengths of the device, outside the
        range of the model. **Raises** CaseError for another parameter, and for a sea whose height or period
        is missing.
        """
        known = {**REGULAR, **SEA, **self.keys}
        for key in changes:
            if key not in known:
                raise CaseError(
                    f"{key}: a fast model cannot change this parameter; use one of {', '.join(known)}"
                )
        values = {known[key]: jnp.asarray(value, float) for key, value in changes.items()}
        waves = self._incident(values)
        found = self.theory.respond(self.added, values, waves)
        within = self._within(waves) & self.theory.within(values)
        return jax.tree.map(lambda a: jnp.where(within, a, jnp.nan), found)

    def results(self, changes: Mapping[str, ArrayLike] = {}) -> dict[str, jax.Array]:
        """Results of a `response` by name, as `jaxsph predict` prints them."""
        return self.theory.results(self.response(changes))

    @property
    def keys(self) -> dict[str, str]:
        """Parameters of the device that the model can change."""
        return self.theory.keys(self.case)

    def annual(self, table: ScatterTable, changes: Mapping[str, ArrayLike] = {}) -> jax.Array:
        """Mean power absorbed in the seas of a scatter table, weighted by their shares, W per metre of width.

        `changes`: parameters of the device, as in `response`. NaN if a sea is outside the range of the model.
        **Raises** CaseError for a parameter of the waves, which are those of the table.
        """
        for key in changes:
            if key in {**REGULAR, **SEA}:
                raise CaseError(f"{key}: the waves are those of the scatter table; vary the device only")
        used = table.used

        def power(Hs: jax.Array, Tp: jax.Array) -> jax.Array:
            return self.results({**changes, "waves.Hs": Hs, "waves.Tp": Tp})[self.theory.power]

        found = jax.vmap(power)(jnp.asarray(used.Hs), jnp.asarray(used.Tp))
        return jnp.asarray(used.share) @ found

    def moved(self, case: Case) -> FastModel:
        """The model of a case with another device of the same kind; the additions stay, and also the waves if
        those of the case are not regular.

        **Raises** CaseError for another kind of device, or one without linear theory.
        """
        if case.waves is None or case.waves.kind != "regular":
            case = case.model_copy(update={"waves": self.case.waves})
        if case == self.case:
            return self
        kind = kind_of(case)
        if missing := kind.why_not(case):
            raise CaseError(missing)
        theory = kind.of(case, self.theory.series.ends)
        if jax.tree.structure(theory.additions.start) != jax.tree.structure(self.added):
            raise CaseError(f"the fast model of {self.case.name!r} is that of another kind of device")
        found = dataclasses.replace(self, theory=theory)
        return found.with_laws(self._laws) if self._laws else found

    @property
    def _laws(self) -> Mapping[str, Any]:
        """Laws that replace those of the case."""
        return self.theory.laws if isinstance(self.theory, MotionTheory | ColumnMotionTheory) else {}

    def with_laws(self, laws: Mapping[str, Any]) -> FastModel:
        """The model with other laws of links, by the names of the links, or another turbine, named "pto".

        Motions are then found in time. The laws (`AbstractLaw`, of a turbine `AbstractPTO`) may have traced
        parameters, for example a `Controlled` with the weights of a network. **Raises** CaseError for a name
        that is not there.
        """
        theory = self.theory
        if isinstance(theory, BodyTheory):
            return dataclasses.replace(self, theory=MotionTheory.with_laws(theory, laws))
        assert isinstance(theory, ColumnTheory), "there are two kinds of devices"
        return dataclasses.replace(self, theory=ColumnMotionTheory.with_laws(theory, laws))

    @property
    def linear(self) -> FastModel:
        """The model without additions, which is linear theory."""
        none = jax.tree.map(lambda _: 0.0, self.added)
        return dataclasses.replace(self, added=none, added_error=none, runs=())

    def _incident(self, values: dict[str, jax.Array]) -> Incident:
        """Incident waves with the case's or with changed values, which are removed from `values`."""
        of_sea, of_regular = ({key for key in keys if keys[key] in values} for keys in (SEA, REGULAR))
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

    def _within(self, waves: Incident) -> jax.Array:
        """Whether waves are in the range of the model."""
        low, middle, high = self.theory.series.ends
        # seas contain waves of little power, which may be shorter than regular waves
        most = middle if len(waves.omega) == 1 else high
        return (jnp.min(waves.omega) >= low) & (jnp.max(waves.omega) <= most)

    @property
    def error(self) -> dict[str, float]:
        """Relative error of the model's predictions for runs that were left out (root of the mean square),
        by the names of the results in a `Response` (-); NaN without runs."""
        if not self.runs:
            return dict.fromkeys(self.theory.read, float("nan"))
        return {
            name: float(
                np.sqrt(np.mean([(one.left_out[name] / one.results[name] - 1.0) ** 2 for one in self.runs]))
            )
            for name in self.theory.read
        }

    def write(self, path: str | Path) -> None:
        """Writes the model to a file (JSON).

        **Raises** FileError if it cannot be written, CaseError for a model `with_laws`.
        """
        if self._laws:
            raise CaseError("a model with laws of your own cannot be written; write the model without them")
        content = {
            "case": self.case.given(),
            "added": self.added._asdict(),
            "added_error": self.added_error._asdict(),
            "error": self.error,
            "runs": [one._asdict() for one in self.runs],
            "omega": self.theory.series.ends,
            "series": np.asarray(self.theory.series.coefficients, float).tolist(),
        }
        try:
            Path(path).write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
        except OSError as error:
            raise FileError(f"{path}: the model cannot be written: {error.strerror}") from None

    @classmethod
    def read(cls, path: str | Path) -> FastModel:
        """Model from its file, or that of the best device from the file of a `search`.

        **Raises** FileError if the file is none of these.
        """
        try:
            if Path(path).suffix == ".h5":
                path = model_of_search(Path(path), best_evaluation(path)[0])
            content = json.loads(Path(path).read_text(encoding="utf-8"))
            case = Case.from_dict(content["case"])
            if "series" not in content:
                raise ValueError("it was written by an earlier version; run jaxsph calibrate again")
            series = Series(jnp.asarray(content["series"], jnp.float32), tuple(content["omega"]))
            theory = kind_of(case).restored(case, series)
            added, error = (theory.additions_from(content[name]) for name in ("added", "added_error"))
            return cls(theory, added, error, tuple(Predicted(**one) for one in content["runs"]))
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
    """Fast model of a case's oscillating water column or bodies, from a few runs of the case.

    **Arguments**: `out`: file of the model; the runs are stored beside it, in `<name>_runs.h5`, from which a
    repeated call continues; `over`: parameters of the runs, lists of equal length by name, for waves and
    dampings; by default five runs around the case (`VARIED`, `DAMPED`); `periods`: shortest and longest
    period of interest, s, if they are beyond those of the runs; `workers`, `executor`: see `sweep`.
    **Raises** CaseError, before any run, for a case that linear theory of an oscillating water column, or of
    bodies with power take-offs, does not cover; CaseError if fewer than four runs succeed; FileError as
    `sweep`.
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
    return {key: [case.value(key) * factor for factor in factors] for key, factors in _varied(case).items()}


def _varied(case: Case) -> dict[str, tuple[float, ...]]:
    """Parameters that differ between the runs of a calibration, and their factors."""
    return VARIED | dict.fromkeys(kind_of(case).dampings(case), DAMPED)


def kind_of(case: Case) -> type[AbstractFastTheory]:
    """Kind of theory that suits the device of a case."""
    if not any(one.free for one in case.every_body.values()):
        return ColumnMotionTheory if ColumnMotionTheory.suits(case) else ColumnTheory
    return MotionTheory if MotionTheory.suits(case) else BodyTheory


def model_of_search(out: Path, k: int) -> Path:
    """File of the model of device k (from 0) of a search with the file `out`."""
    return out.with_name(f"{out.name}.{MODELS}") / f"{k:02d}.json"


def runs_of(path: Path) -> Path:
    """File of the runs of a model with this file."""
    return path.with_name(f"{path.stem}_runs.h5")


def check(case: Case, over: Mapping[str, Sequence[float]]) -> None:
    """**Raises** CaseError if a case or the parameters of its runs do not suit a calibration."""
    if not isinstance(case, Case):
        raise CaseError("a fast model needs a case, and this is a program")
    if case.waves is None or case.waves.kind != "regular":
        raise CaseError(
            "a fast model needs a device with a turbine, or bodies with power take-offs, in regular waves"
        )
    if missing := kind_of(case).why_not(case):
        raise CaseError(missing)
    varied = _varied(case)
    for key, values in over.items():
        if key not in varied:
            raise CaseError(f"{key}: the runs of a calibration differ in {', '.join(varied)} only")
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
    every = range(len(next(iter(runs.axes.values()))))
    done = [k for k in every if (k,) not in runs.failures]
    if len(done) < LEAST:
        texts = "; ".join(f"{runs.words(k)}: {text}" for k, text in runs.failures.items())
        raise CaseError(f"only {len(done)} runs succeeded, and {LEAST} are needed. {texts}")
    T = [({"waves.T": case.value("waves.T")} | runs.at((k,)))["waves.T"] for k in done]
    T += periods or ()
    linear = FastModel.of_theory(case, (min(T), max(T)))
    found = [_read(runs, linear.theory.read, k) for k in done]
    fit = Fit(linear.theory, lambda added, at: dataclasses.replace(linear, added=added).results(at), found)
    added, error = fit.to(np.ones(len(found)))
    predicted = []
    for k, one in enumerate(found):
        others, _ = fit.to(np.arange(len(found)) != k)
        left_out = {name: float(values[k]) for name, values in fit.results(others).items()}
        predicted.append(one._replace(left_out=left_out))
    return dataclasses.replace(linear, added=added, added_error=error, runs=tuple(predicted))


def _read(runs: Sweep, read: Mapping[str, str], k: int) -> Predicted:
    """Parameters and results of a run, without predictions; `read`: see `AbstractFastTheory.read`.

    **Raises** CaseError if its waves were not measured or have not settled.
    """
    missing = [of for of in ("incident_height", *read.values()) if not np.isfinite(_result(runs, of, k))]
    if missing:
        raise CaseError(
            f"the run with {runs.words((k,))} has no {' and no '.join(missing)}: a fast model needs gauges "
            "(probes.gauges) that measure the incident waves, and t1 long enough for settled periods"
        )
    results = {name: _result(runs, of, k) for name, of in read.items()}
    return Predicted(runs.at((k,)), _result(runs, "incident_height", k), results, {})


def _result(runs: Sweep, name: str, k: int) -> float:
    """Result of a run; NaN if no run has it."""
    return float(runs.results[name][k]) if name in runs.results else np.nan
