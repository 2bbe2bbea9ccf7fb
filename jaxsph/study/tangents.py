"""Slope of a result by forward-mode differentiation through every step: exact, or filtered."""

from __future__ import annotations

import abc
import dataclasses
import functools
from typing import Any, TypeVar

import equinox as eqx
import jax
import numpy as np
from tqdm import tqdm

from jaxsph.case.case import Case
from jaxsph.errors import CaseError, DerivativeError
from jaxsph.model.interfaces import Model
from jaxsph.model.tangents import TangentFilter
from jaxsph.problem.problem import Problem
from jaxsph.problem.program import Program
from jaxsph.problem.record import harvested
from jaxsph.problem.source import Source
from jaxsph.run.chunks import advance_chunk, search_settings, with_settings
from jaxsph.run.simulate import simulate
from jaxsph.study.base import AbstractMethod, Derivative, parameter_value

S = TypeVar("S", bound=Source)


class _ThroughLoop(AbstractMethod):
    """Method of forward-mode differentiation through every step."""

    @abc.abstractmethod
    def _model_to_differentiate(self, model: Model) -> Model:
        """Model to differentiate, made from the given model."""

    @abc.abstractmethod
    def _check(self, parameter: str, value: float, t: float, reach: float) -> None:
        """Raises DerivativeError if the slopes at t (s) are too inaccurate to continue."""

    @abc.abstractmethod
    def _error(self, parameter: str, source: Source, value: float, slope: float) -> float | None:
        """Estimated error of the slope; None if it is not known."""

    def derivative(self, source, parameter, of, progress):
        """See `AbstractMethod.derivative`."""
        if rough := source.roughness(parameter):
            raise CaseError(
                f"{parameter}: the model may change discontinuously with this value ({rough}); use "
                "method=js.Ensemble(), which rebuilds the model for every member"
            )
        problem = source.problem()
        result = problem.mean_of_power(of)
        model, state = problem.model, problem.state
        powers = harvested(model)
        d_model, d_state = _seed(source, parameter, problem)
        model = self._model_to_differentiate(model)
        probes = tuple(probe for probe in problem.probes if {*powers} & {*probe.describe()})
        value, dx = parameter_value(source, parameter), float(model.dx)
        sample_every, chunk = problem.sample_every, problem.per_chunk
        last = round(problem.t1 / problem.sample_dt) * sample_every
        readings, slopes, grains = [], [], []
        bar = tqdm(total=last, unit="step", disable=not progress, dynamic_ncols=True)
        with bar:
            while int(state.step) < last:
                n_steps = min(chunk, last - int(state.step))
                advance = functools.partial(
                    _simulate_tangents,
                    state=state,
                    d_model=d_model,
                    d_state=d_state,
                    probes=probes,
                    n_steps=n_steps,
                    sample_every=sample_every,
                )
                model, state, (d_state, read, slope) = advance_chunk(
                    model, advance, bar.write, problem.name, problem.remedies
                )
                readings.append({k: np.asarray(v) for k, v in read.items()})
                slopes.append({k: np.asarray(v) for k, v in slope.items()})
                t = float(model.time(state))
                unlike = grain(np.asarray(state.particles.x), np.asarray(d_state.particles.x), dx)
                grains.append(np.full(len(slopes[-1]["time"]), unlike))
                reach = 0.1 * dx / unlike if unlike > 0 else np.inf if unlike == 0 else 0.0
                self._check(parameter, value, t, reach)
                bar.update(n_steps)
        series = {k: np.concatenate([r[k] for r in readings]) for k in readings[0]}
        series["time"] = np.arange(len(series["time"])) * problem.sample_dt
        slope = {k: np.concatenate([s[k] for s in slopes]) for k in slopes[0] if k != "time"}
        slope["grain"] = np.concatenate(grains)
        powers = [name for name in powers if name in series]
        mean = result(series["time"], np.sum([series[name] for name in powers], axis=0))
        found, total = (sum(mean.of_power(of_all[name]) for name in powers) for of_all in (series, slope))
        if of == "xi":
            ahead, behind, step = _beside(source, parameter, model)
            change = (mean.incident(ahead) - mean.incident(behind)) / (2 * step)
            total -= found * change / mean.incident(source)
        error = self._error(parameter, source, found, total)
        return Derivative(parameter, of, found, total, error, reach, self, series, slope)


class Exact(_ThroughLoop):
    """Exact derivative of the discrete program, propagated through every step.

    As long as the slopes of the positions of neighbouring particles agree, this derivative is that of the
    flow. Within a fraction of a second it becomes the derivative of chaotic particle paths, which is valid
    only for ever smaller changes of the parameter. The run stops when, according to these slopes, a relative
    change `least` of the parameter would move neighbours by a tenth of a spacing relative to each other.
    """

    least: float = eqx.field(static=True, default=0.01)
    """Smallest relative change of the parameter for which the slope must be valid."""

    def _model_to_differentiate(self, model):
        return model

    def _check(self, parameter, value, t, reach):
        if not reach > self.least * abs(value):  # also true for NaN
            raise DerivativeError(
                f"the exact derivative with respect to {parameter} no longer describes the flow, because "
                f"particle paths are chaotic: at t = {t:.2f} s it is valid only for changes of the parameter "
                f"below {reach:.1g}.\n"
                "What to change: use a smaller t1, or method=js.Filtered() or js.Ensemble()"
            )

    def _error(self, parameter, source, value, slope):
        return None


LOST = {"weakly_compressible": 0.7, "incompressible": 0.25}
"""Fraction of the water's response that the filter may remove, by scheme.

The fraction was measured in the OWC at dx = 0.02 m with three dampings. It is 0.33 to 0.67 in the weakly
compressible scheme, with artificial viscosity and over nine periods, and 0.10 to 0.17 in the incompressible
scheme (`python -m experiments run filter_study`).
"""


class Filtered(_ThroughLoop):
    """Derivative through every step, with tangents averaged over neighbours during the run (`TangentFilter`).

    One run gives slopes over thirty wave periods or more, but a part of the water's response is lost.
    A result depends on K_dm directly, with the relative slope 2/K_dm, and through the water's response; near
    the best damping the two parts nearly cancel. The filter does not affect the direct part, and removes a
    fraction `lost` of the response. The error of a slope with respect to K_dm is this fraction times the
    response part of the slope.
    """

    filter: TangentFilter = eqx.field(default_factory=TangentFilter)
    lost: float | None = eqx.field(static=True, default=None)
    """Fraction of the water's response that is assumed lost; by default the scheme's value in `LOST`."""

    def _model_to_differentiate(self, model):
        return dataclasses.replace(model, tangents=self.filter)

    def _check(self, parameter, value, t, reach):
        if not reach > 0.0:
            raise DerivativeError(
                f"the filtered derivative with respect to {parameter} is no longer finite at t = {t:.2f} s.\n"
                "What to change: use a filter of lower order or with a shorter interval"
            )

    def _error(self, parameter, source, value, slope):
        if parameter != "pto.K_dm" or not isinstance(source, Case):
            return None
        lost = LOST[source.scheme.kind] if self.lost is None else self.lost
        return lost * abs(slope - 2.0 * value / parameter_value(source, parameter))


@functools.partial(jax.jit, static_argnames=("n_steps", "sample_every"))
def _simulate_tangents(model, state, d_model, d_state, probes, n_steps, sample_every):
    """`simulate` and its derivative along (d_model, d_state): (state, (d_state, readings, d_readings))."""
    varying, fixed = eqx.partition((model, state), eqx.is_inexact_array)
    # the structure of a model includes the sizes of its tables, which may have grown since the seed was made
    seeds = jax.tree.unflatten(jax.tree.structure(varying), jax.tree.leaves((d_model, d_state)))

    def advance(varying):
        new, readings = simulate(
            *eqx.combine(varying, fixed), n_steps=n_steps, probes=probes, sample_every=sample_every
        )
        floats, others = eqx.partition(new, eqx.is_inexact_array)
        return (floats, readings), others

    (floats, readings), (d_state, d_readings), others = jax.jvp(advance, (varying,), (seeds,), has_aux=True)
    return eqx.combine(floats, others), (d_state, readings, d_readings)


def _beside(source: S, parameter: str, model: Model) -> tuple[S, S, float]:
    """Sources with the parameter increased and decreased by a small step, and the size of the step."""
    value = parameter_value(source, parameter)
    # the relative error of a central difference is about share**2 + (round-off) / share
    share = 1e-4 if model.dt.dtype == np.float64 else 1e-2
    step = share * value if value else share
    return source.replace({parameter: value + step}), source.replace({parameter: value - step}), step


def _seed(source: Source, parameter: str, problem: Problem) -> tuple[Any, Any]:
    """Slopes of all floats in model and initial state, by central differences between two builds.

    The time step is held constant, because it must divide the sampling interval and can only change in jumps.
    """
    ahead, behind, step = _beside(source, parameter, problem.model)
    settings = search_settings(problem.model)

    def floats(made: Problem) -> Any:
        return eqx.filter((with_settings(made.model, settings), made.state), eqx.is_inexact_array)

    made = [floats(one) for one in (problem, ahead.problem(), behind.problem())]
    (leaves, structure), *others = (jax.tree.flatten(one) for one in made)
    beside = [found for found, _ in others]
    shapes = [[leaf.shape for leaf in one] for one in (leaves, *beside)]
    if not shapes[0] == shapes[1] == shapes[2]:
        less = "" if problem.model.dt.dtype == np.float64 else ", or use float64, where the change is smaller"
        raise CaseError(
            f"{parameter}: a change of {step:.2g} changes the number of particles or ghost particles; "
            f"compare runs with js.sweep{less}"
        )
    if isinstance(source, Program):
        if any(other != structure for _, other in others):
            raise CaseError(
                f"{parameter} changes values that are fixed in the compiled loop, such as the ends of a tank "
                "or a thin plate: use method=js.Ensemble(), which rebuilds the model for every member"
            )
        _check_smooth(parameter, leaves, *beside)
    slopes = [(a - b) / (2 * step) for a, b in zip(*beside, strict=True)]
    d_model, d_state = jax.tree.unflatten(structure, slopes)
    return eqx.tree_at(lambda m: m.dt, d_model, 0.0 * d_model.dt), d_state


CURVED = 0.1
"""Difference of the two one-sided slopes of a number in the model, relative to their sum, above which the
number counts as discontinuous. For a smooth dependence this ratio is about the parameter's relative step."""


def _check_smooth(parameter: str, here: list, ahead: list, behind: list) -> None:
    """**Raises** CaseError if a number in the model, such as a rounded length, is a discontinuous function of
    the parameter."""
    for at, more, less in zip(here, ahead, behind, strict=True):
        at, more, less = (np.asarray(a, np.float64) for a in (at, more, less))
        rounding = 8 * np.finfo(here[0].dtype).eps * (np.max(np.abs(at), initial=0.0) + 1e-30)
        jump = np.max(np.abs((more - at) - (at - less)), initial=0.0)
        if jump > CURVED * np.max(np.abs(more - less), initial=0.0) + rounding:
            raise CaseError(
                f"{parameter}: the model changes discontinuously with this value, for example because a "
                "length is rounded to the lattice; use method=js.Ensemble(), which rebuilds the model for "
                "every member"
            )


def grain(x: np.ndarray, dx: np.ndarray, spacing: float) -> float:
    """Root mean square deviation of a field `dx` `[N, D]` from linear fits, in the unit of the field.

    The fits are made in cells four spacings wide; `x`: positions of the particles (m); `spacing`: m. The
    deviation is near zero for a smooth flow field, and as large as the field itself if neighbours are
    uncorrelated.
    """
    cells = np.unique(np.floor(x / (4 * spacing)).astype(int), axis=0, return_inverse=True)[1].ravel()
    rest = 0.0
    for cell in range(cells.max() + 1):
        here = cells == cell
        A = np.hstack([np.ones((here.sum(), 1)), x[here]])
        rest += np.sum((dx[here] - A @ np.linalg.lstsq(A, dx[here], rcond=None)[0]) ** 2)
    return float(np.sqrt(rest / len(x)))
