"""`search`: the best parameters of a device by a fast model, which runs of the water correct.

The model proposes the device with the largest result. This device is run in a few waves, and the model is
fitted again to these runs, until it promises no more than they have shown.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy  # which imports its subpackages on first use
from numpy.typing import NDArray

from jaxsph.case.case import Case
from jaxsph.errors import CaseError
from jaxsph.study.fast_column import LENGTHS
from jaxsph.study.fast_model import (
    DAMPED,
    LEAST,
    MODELS,
    FastModel,
    calibrate,
    check,
    kind_of,
    members_around,
    model_of_search,
)
from jaxsph.study.optimise import Maximum, Record, check_bounds
from jaxsph.study.ownership import only_study
from jaxsph.study.scatter import ScatterTable
from jaxsph.waves.fast_owc import SHARE

FIRST = len(DAMPED)
"""Number of runs of the first device; each other device has `LEAST`."""
GAIN = 0.01
"""Gain that the model must promise for another set of runs, relative to the best value (-)."""
FACTOR = 2.0
"""Largest ratio of a damping to that of the case around which a model was fitted, or its inverse (-)."""
REACH = 1.99 * SHARE
"""Largest change of a length for which the response of the water is known, relative to the length (-)."""
STARTS = {True: 256, False: 96}
"""Number of random points at which the model is evaluated, by whether its results are smooth functions of the
parameters. A gradient search from the best point follows if they are."""
CLOSER = (0.4, 0.15, 0.05, 0.02)
"""Parts of the bounds in which other random points follow around the best one if they are not (-)."""
UNUSED = ("pressure", "velocity")
"""Probes that the runs do not have: the plate might stand on them."""
BETWEEN = 30
"""Number of values of each parameter with which the case is checked before the search."""
MOVES = 20
"""Largest number of moves of the model to other lengths in one proposal."""

Vector = NDArray[np.float64]
"""Parameters in the coordinates of a search."""


class PerCost(NamedTuple):
    """A result over the cost of the device, in any unit: a fixed part, and prices of parameters."""

    of: str = "xi"
    """Result that is divided by the cost."""
    fixed: float = 0.0
    prices: Mapping[str, float] = MappingProxyType({})
    """Price per unit of each parameter, by the parameter's name."""

    def cost(self, values: Mapping[str, Any]) -> Any:
        """Cost with these values of the parameters."""
        return sum((price * values[name] for name, price in self.prices.items()), self.fixed)


class _Aim(NamedTuple):
    """What is maximised, and over which parameters."""

    over: Mapping[str, tuple[float, float]]
    of: str
    table: ScatterTable | None
    cost: PerCost | None = None

    @property
    def name(self) -> str:
        """Name of what is maximised."""
        return self.of if self.cost is None else f"{self.of} per cost"

    def worth(self, value: Any, at: Mapping[str, Any]) -> Any:
        """What is maximised, from the result and the parameters."""
        return value if self.cost is None else value / self.cost.cost(at)


class _Axes:
    """Coordinates of a search: logarithms of the parameters; of a parameter that may be zero or negative, its
    ratio to the larger bound."""

    def __init__(self, over: Mapping[str, tuple[float, float]], signed: Collection[str]) -> None:
        """Coordinates of parameters within their bounds."""
        self.names = [*over]
        self.signed = np.array([name in signed for name in over])
        self._size = np.array([max(map(abs, pair)) for pair in over.values()])
        self.bounds = np.stack([self.of(pair) for pair in zip(*over.values(), strict=True)], axis=1)

    def of(self, values: Sequence[float]) -> Vector:
        """Coordinates of values of the parameters."""
        given = np.asarray(values, float)
        return np.where(self.signed, given / self._size, np.log(np.where(self.signed, 1.0, given)))

    def parameters(self, x: Any) -> dict[str, Any]:
        """Values of the parameters by name; may be traced."""
        exp = jnp.exp if isinstance(x, jax.Array) else np.exp
        each = zip(self.names, x, self.signed, self._size, strict=True)
        return {name: a * size if signed else exp(a) for name, a, signed, size in each}


def search(
    case: Case,
    over: Mapping[str, tuple[float, float]],
    out: str | Path,
    *,
    of: str | PerCost = "xi",
    table: ScatterTable | None = None,
    evaluations: int = 4,
    workers: int | None = None,
    progress: bool = True,
) -> Maximum:
    """Maximises the efficiency or power of a case's device by a fast model of it.

    The first device is that of the case. A fast model is fitted to five runs of it (`calibrate`), and
    proposes the parameters with the largest result. Four runs of the proposed device follow, to which the
    model is fitted again. The search ends when a proposal, with lengths rounded to spacings, promises less
    than 1 % more than the best device so far, if the runs of a proposed device fail, and after `evaluations`
    devices.

    **Arguments**: `over`: bounds (lowest, highest) of dampings and lengths that a fast model can change;
    `of`: "xi", or the absorbed power in the case's waves; `table`: scatter table for the mean power over its
    seas instead. `PerCost` as `of` maximises such a result over the cost of the device. The runs have regular
    waves with the mean energy and the mean period of the table, and no probes of pressure and velocity.
    `out`: the file of the devices; models and runs are stored in `<out>.models`, from which a repeated call
    continues. `workers`: see `sweep`.
    **Returns** the best device, whose value is the prediction of the model that was fitted to its runs.
    "error RESULT" in the `history` is the standard error of this prediction, and "promised RESULT" is the
    prediction before the device was run.
    **Raises** CaseError, before any run, for parameters, results and cases that a fast model does not cover,
    and if a device at the bounds cannot be built; FileError if `out` belongs to another search, or if another
    process runs a study with this output.
    """
    if evaluations < 1:
        raise CaseError(f"evaluations = {evaluations}: must be 1 or more")
    aim, case = checked(case, over, of, table)
    about = {"of": aim.name, "method": "model", "bounds": [[*map(float, pair)] for pair in over.values()]}
    periods = None
    if aim.cost is not None:
        about["cost"] = {"fixed": float(aim.cost.fixed), **aim.cost.prices}
    if table is not None:
        about["table"] = np.stack([table.Hs, table.Tp, table.share]).tolist()
        used = table.used
        periods = float(used.Tp.min()), float(used.Tp.max())
    with only_study(Path(out)):
        record = Record(Path(out), case, [*over], about, MODELS)
        record.begin()

        def fit(here: Case, k: int) -> FastModel:
            runs = {key: values[: None if k == 0 else LEAST] for key, values in members_around(here).items()}
            return calibrate(
                here,
                model_of_search(record.path, k),
                over=runs,
                periods=periods,
                workers=workers,
                progress=progress,
            )

        return _improve(case, aim, record, evaluations, fit)


def _improve(
    case: Case, aim: _Aim, record: Record, evaluations: int, fit: Callable[[Case, int], FastModel]
) -> Maximum:
    """The search itself: `fit` runs a device and fits a model to the runs."""
    history: list[dict[str, float]] = []
    here, reason = case, f"the limit of {evaluations} devices was reached"
    proposer, promise = None, {}
    for k in range(evaluations):
        try:
            model = fit(here, k)
        except CaseError as error:
            if not history:
                raise
            reason = f"the runs of the proposed device give no model: {error}"
            break
        proposer = _Proposer(aim, model) if proposer is None else proposer
        value, at = proposer.of_device(model)
        error = model.error[model.theory.predictable[aim.of].like] * value
        history.append({**at, aim.name: value, f"error {aim.name}": error, **promise})
        record.write(history)
        best = max(one[aim.name] for one in history)
        here = proposer.best(model)
        promised, _ = proposer.of_device(model.moved(here))
        promise = {f"promised {aim.name}": promised}
        if promised < (1.0 + GAIN) * best:
            reason = f"the model promises less than {GAIN:.0%} more within the bounds"
            break
    return Maximum.of_best(case, [*aim.over], aim.name, reason, history)


class _Proposer:
    """Best parameters by the fast models of one search, which share compiled functions."""

    def __init__(self, aim: _Aim, model: FastModel) -> None:
        """Best parameters by `model`, and by models that differ in the water, the loss and the inertia."""
        self._axes = _Axes(aim.over, model.theory.signed(model.case))
        self._names, self._bounds = self._axes.names, self._axes.bounds

        def value(x: jax.Array, water: Any, added: Any) -> jax.Array:
            changes = self._axes.parameters(x)
            theory = dataclasses.replace(model.theory, water=water)
            there = dataclasses.replace(model, theory=theory, added=added)
            if aim.table is not None:
                return aim.worth(there.annual(aim.table, changes), changes)
            return aim.worth(there.results(changes)[aim.of], changes)

        self._several = jax.jit(jax.vmap(value, (0, None, None)))
        self._falling = jax.jit(jax.value_and_grad(lambda *given: -jnp.log(value(*given))))

    def of_device(self, model: FastModel) -> tuple[float, dict[str, float]]:
        """Largest result of the device of a model's case, and its parameters.

        Dampings, which differ between the runs, may differ by `FACTOR`; all other parameters are those of the
        case.
        """
        here, varied = self._values(model.case), model.theory.dampings(model.case)
        fixed = np.array([name not in varied for name in self._names])
        low, high = (
            np.where(fixed, here, np.clip(here + change, *self._bounds.T))
            for change in (-np.log(FACTOR), np.log(FACTOR))
        )
        value, x = self._climb(model, low, high, here)
        return value, self._parameters(x)

    def best(self, model: FastModel) -> Case:
        """Case whose device has the largest result by a model, anywhere within the bounds."""
        x, case = np.clip(self._values(model.case), *self._bounds.T), model.case
        for _ in range(MOVES):
            low, high = self._known(model)
            _, x = self._climb(model, low, high, x)
            case = case.replace(self._parameters(x))
            # whether a length stopped where the response of the water is no longer known, not at a bound
            ends = np.stack([low, high])
            if not np.any((ends != self._bounds.T) & (np.abs(ends - x) < 1e-3)):
                break
            model = model.moved(case)
        return case

    def _values(self, case: Case) -> Vector:
        """Parameters of a case as it is built."""
        return self._axes.of([case.built(name) for name in self._names])

    def _parameters(self, x: Vector) -> dict[str, float]:
        return {name: float(value) for name, value in self._axes.parameters(x).items()}

    def _known(self, model: FastModel) -> tuple[Vector, Vector]:
        """Part of the bounds in which the response of the water is known."""
        low, high = self._bounds.T.copy()
        for k, name in enumerate(self._names):
            if name in LENGTHS:
                usual = model.theory.water.lengths[LENGTHS[name]]
                ends = np.log([(1.0 - REACH) * usual, (1.0 + REACH) * usual])
                low[k], high[k] = np.clip(ends, *self._bounds[k])
        return low, high

    def _climb(self, model: FastModel, low: Vector, high: Vector, x: Vector) -> tuple[float, Vector]:
        """Largest result between two bounds, and where it is; begins at the best of random points and x."""
        given, random = (model.theory.water, model.added), np.random.default_rng(0)
        smooth, whole = model.theory.smooth, high - low
        points = low + random.random((STARTS[smooth], len(x))) * whole
        points[0] = np.clip(x, low, high)
        found = np.asarray(self._several(jnp.asarray(points), *given))
        if not np.any(np.isfinite(found)):
            raise CaseError("the fast model has no prediction there: its periods do not cover the waves")
        x, value = points[np.nanargmax(found)], np.nanmax(found)
        if smooth:
            return self._along_slopes(given, low, high, x)
        for share in CLOSER:
            points = np.clip(x + share * whole * (random.random(points.shape) - 0.5), low, high)
            found = np.asarray(self._several(jnp.asarray(points), *given))
            if np.nanmax(found) > value:
                x, value = points[np.nanargmax(found)], np.nanmax(found)
        return float(value), x

    def _along_slopes(self, given: Any, low: Vector, high: Vector, x: Vector) -> tuple[float, Vector]:
        """Largest result between two bounds and where it is, by a gradient search from x."""

        def falling(x: Vector) -> tuple[float, Vector]:
            value, slope = self._falling(jnp.asarray(x), *given)
            return float(value), np.asarray(slope, float)

        best = scipy.optimize.minimize(
            falling, x, method="L-BFGS-B", jac=True, bounds=np.stack([low, high], 1)
        )
        x = np.clip(best.x, low, high)
        return float(np.exp(-falling(x)[0])), x


def runs_of_search(evaluations: int) -> int:
    """Largest number of runs of a search with this number of devices."""
    return FIRST + LEAST * (evaluations - 1)


def checked(
    case: Case,
    over: Mapping[str, tuple[float, float]],
    of: str | PerCost,
    table: ScatterTable | None,
) -> tuple[_Aim, Case]:
    """What is maximised, and the case with the waves of the runs. **Raises** CaseError as `search`."""
    check(case, {})
    kind = kind_of(case)
    keys, results = kind.keys(case), ("xi", kind.power)
    for name in over:
        if name not in keys:
            raise CaseError(f"{name}: a fast model can search in {', '.join(keys)} only")
    check_bounds(case, over, kind.signed(case))
    cost = of if isinstance(of, PerCost) else None
    if isinstance(of, PerCost):
        _check_cost(of, over, kind.signed(case))
        of = of.of
    if table is not None:
        of, case = kind.power, case.replace(_regular_waves(table))
    if of not in results:
        raise CaseError(f"of = {of!r}: a fast model predicts {' and '.join(results)} only")
    case = case.replace({f"probes.{name}": None for name in UNUSED if case.value(f"probes.{name}")})
    for corner in itertools.product(*over.values()):
        case.replace(dict(zip(over, corner, strict=True)))
    for name, (low, high) in over.items():
        for value in np.linspace(low, high, BETWEEN):
            case.replace({name: float(value)})
    check(case, members_around(case))
    if not kind.signed(case).keys().isdisjoint(over):
        # refuses stiffnesses that would move the bodies at rest
        FastModel.of_theory(case).results({name: case.value(name) for name in over})
    return _Aim(over, of, table, cost), case


def _check_cost(cost: PerCost, over: Mapping[str, Any], signed: Collection[str]) -> None:
    """**Raises** CaseError for negative prices, prices of parameters that do not vary, and no cost."""
    for name, price in {"fixed": cost.fixed, **cost.prices}.items():
        if not (math.isfinite(price) and price >= 0.0):
            raise CaseError(f"cost of {name} = {price}: must be a number of at least 0")
        if name in signed:
            raise CaseError(f"cost of {name}: this parameter can be negative and has no price; omit it")
        if name != "fixed" and name not in over:
            raise CaseError(f"cost of {name}: the search does not vary it; use {', '.join(over)} or fixed")
    if not any((cost.fixed, *cost.prices.values())):
        raise CaseError("the cost is zero for every device; give a price above 0")


def _regular_waves(table: ScatterTable) -> dict[str, float]:
    """Height (m) of regular waves with the mean energy of the seas of a table, and their mean period (s)
    weighted by the energy."""
    energy = table.share * table.Hs**2
    T = float(np.sum(energy * table.Tp) / np.sum(energy))
    return {"waves.H": float(np.sqrt(np.sum(energy) / 2.0)), "waves.T": T}
