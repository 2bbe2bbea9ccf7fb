"""Slope of a result from an ensemble of runs with a fast model as control variate."""

from __future__ import annotations

import dataclasses
import tempfile
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import numpy as np

from jaxsph.case.case import Case
from jaxsph.errors import CaseError
from jaxsph.problem.source import Source
from jaxsph.study.base import AbstractMethod, check_result
from jaxsph.study.ensemble import Ensemble, parabola
from jaxsph.study.fast_model import REGULAR, FastModel, calibrate, check

NEAR = 0.02
"""Relative change of a parameter to either side over which a model's slope is taken if it is no function of
JAX (-)."""


class Calibrated(AbstractMethod):
    """Ensemble of runs whose differences from a fast model are fitted by a parabola.

    The slope is that of the model plus that of the parabola. As the differences are small, they are nearly a
    parabola also where the result itself is not, so that the members can be spread more widely. The scatter
    about the parabola gives the standard error.
    """

    ensemble: Ensemble = Ensemble(spread=0.5)
    """The runs."""
    model: str | Path | None = eqx.field(static=True, default=None)
    """File of a fast model, whose additions are used; None calibrates the case by five more runs, which are
    stored beside those of the ensemble."""

    def kept(self, path):
        """See `AbstractMethod.kept`."""
        return dataclasses.replace(self, ensemble=self.ensemble.kept(path))

    def derivative(self, source, parameter, of, progress):
        """See `AbstractMethod.derivative`."""
        case, name = _checked(source, parameter, of)
        model = self._model(case, progress).moved(case)
        found = self.ensemble.members_of(case, parameter, of, progress)
        moves, varies = model.theory.moves(case, parameter), parameter in {**REGULAR, **model.keys}

        def predict(at: FastModel, value: Any) -> jax.Array:
            return at.results({parameter: value} if varies else {})[name]

        def at(value: float) -> FastModel:
            return model.moved(case.replace({parameter: value})) if moves else model

        if varies:
            usual, slope = jax.value_and_grad(lambda value: predict(model, value))(found.value)
        else:
            usual, (low, high) = predict(model, 0.0), (found.value * (1.0 + s) for s in (-NEAR, NEAR))
            slope = (predict(at(high), high) - predict(at(low), low)) / (high - low)
        control = np.array([predict(at(value), value) for value in found.values[found.known]], float)
        if not np.all(np.isfinite([*control, usual, slope])):
            values = ", ".join(f"{value:.4g}" for value in found.values)
            raise CaseError(
                f"{parameter}: the fast model has no prediction for all of {values}, which are outside its "
                "range; reduce the spread, or calibrate it with such runs"
            )
        rest = parabola(found.offsets, found.results[found.known] - control)
        whole = float(slope) * found.value + rest.slope
        return found.derivative(self, float(usual) + rest.value, whole, rest.error)

    def _model(self, case: Case, progress: bool) -> FastModel:
        """Model from its file, or from five runs of the case."""
        if self.model is not None:
            return FastModel.read(self.model)
        with tempfile.TemporaryDirectory() as folder:
            out = Path(folder) / "members.h5" if self.ensemble.out is None else Path(self.ensemble.out)
            path = out.with_name(f"{out.stem}_model.json")
            return calibrate(case, path, workers=self.ensemble.workers, progress=progress)


def _checked(source: Source, parameter: str, of: str) -> tuple[Case, str]:
    """The case, and the name in a fast model of the result `of` of its runs.

    **Raises** CaseError if no model gives this slope.
    """
    if not isinstance(source, Case):
        raise CaseError("method=js.Calibrated() needs a case, and this is a program")
    check(source, {})
    theory = FastModel.of_theory(source).theory
    keys = {**REGULAR, **theory.keys(source)}
    keys |= {parameter: parameter} if theory.moves(source, parameter) else {}
    names = {name: name for name in theory.predictable} | {run: name for name, run in theory.read.items()}
    names["P_owc"] = theory.power  # the mean power of any device, as in `derivative`
    for given, known, what in (
        (parameter, keys, "change this parameter"),
        (of, names, "predict this result"),
    ):
        if given not in known:
            raise CaseError(
                f"{given}: a fast model cannot {what}; use one of {', '.join(known)}, or method=js.Ensemble()"
            )
    check_result(source.problem(), of)
    return source, names[of]
