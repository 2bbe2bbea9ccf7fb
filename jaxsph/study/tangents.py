"""Slope of a result by forward mode through every step: exact, or filtered."""

from __future__ import annotations

import abc
import dataclasses
import functools
from typing import Any

import equinox as eqx
import jax
import numpy as np
from tqdm import tqdm

from jaxsph.case.build import build
from jaxsph.case.case import Case
from jaxsph.case.report import make_probes, steps_per_sample
from jaxsph.errors import CaseError, DerivativeError
from jaxsph.model.interfaces import Model
from jaxsph.model.state import State
from jaxsph.model.tangents import TangentFilter
from jaxsph.probes.devices import BodyProbe, ChamberProbe
from jaxsph.run.chunks import advance_chunk, search_settings, steps_per_chunk
from jaxsph.run.results import harvested
from jaxsph.run.simulate import simulate
from jaxsph.study.base import (
    SMOOTH,
    AbstractMethod,
    Derivative,
    parameter_value,
    result_of_power,
)


class _ThroughLoop(AbstractMethod):
    """Forward mode through every step."""

    @abc.abstractmethod
    def _model_to_differentiate(self, model: Model) -> Model:
        """The model to differentiate."""

    @abc.abstractmethod
    def _check(self, parameter: str, value: float, t: float, reach: float) -> None:
        """Raises DerivativeError where at the time t the slopes are not worth going on."""

    @abc.abstractmethod
    def _error(self, parameter: str, case: Case, value: float, slope: float) -> float | None:
        """What is known of the slope's error."""

    def derivative(self, case, parameter, of, progress):
        """See `AbstractMethod`."""
        if parameter not in SMOOTH:
            raise CaseError(
                f"{parameter}: the loop does not depend smoothly on it (on {', '.join(SMOOTH)} it does); "
                "take method=js.Ensemble(), which builds every member anew"
            )
        result = result_of_power(case, of)
        model, state = build(case)
        d_model, d_state = _seed(case, parameter, model, state)
        model = self._model_to_differentiate(model)
        probes = tuple(p for p in make_probes(case, model, state) if isinstance(p, ChamberProbe | BodyProbe))
        sample_every = steps_per_sample(case, model)
        last = round(case.t1 / case.output.sample_dt) * sample_every
        chunk = steps_per_chunk(case, sample_every)
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
                model, state, (d_state, read, slope) = advance_chunk(case.name, model, advance, bar.write)
                readings.append({k: np.asarray(v) for k, v in read.items()})
                slopes.append({k: np.asarray(v) for k, v in slope.items()})
                t = float(model.time(state))
                unlike = grain(np.asarray(state.particles.x), np.asarray(d_state.particles.x), case.dx)
                grains.append(np.full(len(slopes[-1]["time"]), unlike))
                reach = 0.1 * case.dx / unlike if unlike > 0 else np.inf if unlike == 0 else 0.0
                self._check(parameter, parameter_value(case, parameter), t, reach)
                bar.update(n_steps)
        series = {k: np.concatenate([r[k] for r in readings]) for k in readings[0]}
        series["time"] = np.arange(len(series["time"])) * case.output.sample_dt
        slope = {k: np.concatenate([s[k] for s in slopes]) for k in slopes[0] if k != "time"}
        slope["grain"] = np.concatenate(grains)
        powers = [name for name in harvested(model) if name in series]
        mean = result(series["time"], np.sum([series[name] for name in powers], axis=0))
        value, total = (sum(mean.of_power(of_all[name]) for name in powers) for of_all in (series, slope))
        if of == "xi":
            ahead, behind, step = _beside(case, parameter)
            change = (mean.incident(ahead) - mean.incident(behind)) / (2 * step)
            total -= value * change / mean.incident(case)
        error = self._error(parameter, case, value, total)
        return Derivative(parameter, of, value, total, error, reach, self, series, slope)


class Exact(_ThroughLoop):
    """Exact derivative of the discrete program, carried through every step.

    While neighbouring particles agree it is the derivative of the flow. Then, within a fraction of a second,
    it becomes that of the particles' own chaotic paths, and holds for smaller and smaller changes: the run
    stops when a change of the parameter by the share `least` would, by these slopes, move neighbours a tenth
    of a spacing against each other.
    """

    least: float = eqx.field(static=True, default=0.01)
    """Smallest change for which a slope is worth having, as a share of the parameter."""

    def _model_to_differentiate(self, model):
        return model

    def _check(self, parameter, value, t, reach):
        if not reach > self.least * abs(value):  # NaN too
            raise DerivativeError(
                f"the exact derivative over {parameter} is lost to the paths of single particles: at "
                f"t = {t:.2f} s it speaks of changes below {reach:.1g} only.\n"
                "What to change: an earlier t1, method=js.Filtered() or js.Ensemble()"
            )

    def _error(self, parameter, case, value, slope):
        return None


LOST = {"weakly_compressible": 0.7, "incompressible": 0.25}
"""Share of the water's response that the filter may take, by scheme.

Measured in the OWC at dx = 0.02 m at three dampings: 0.33 to 0.67 weakly compressible, with artificial
viscosity and for nine periods; 0.11 to 0.20 incompressible (`python -m experiments run filter_study`).
"""


class Filtered(_ThroughLoop):
    """Derivative through every step whose tangents are averaged over neighbours as it goes (`TangentFilter`).

    One run gives slopes for thirty wave periods and more, and a part of the water's response is lost.
    A result changes with K_dm directly, by 2/K_dm of itself, and because the water moves otherwise; near the
    best damping the two nearly cancel. The filter leaves the first alone and takes a share `lost` of the
    second, and that share is the error that a slope over K_dm is given.
    """

    filter: TangentFilter = eqx.field(default_factory=TangentFilter)
    lost: float | None = eqx.field(static=True, default=None)
    """Share of the water's response taken as lost; by default the scheme's own (`LOST`)."""

    def _model_to_differentiate(self, model):
        return dataclasses.replace(model, tangents=self.filter)

    def _check(self, parameter, value, t, reach):
        if not reach > 0.0:
            raise DerivativeError(
                f"the filtered derivative over {parameter} is no longer finite at t = {t:.2f} s.\n"
                "What to change: a filter of lower order or shorter interval"
            )

    def _error(self, parameter, case, value, slope):
        if parameter != "pto.K_dm":
            return None
        assert case.pto is not None and case.pto.K_dm is not None  # the parameter
        lost = LOST[case.scheme.kind] if self.lost is None else self.lost
        return lost * abs(slope - 2.0 * value / case.pto.K_dm)


@functools.partial(jax.jit, static_argnames=("n_steps", "sample_every"))
def _simulate_tangents(model, state, d_model, d_state, probes, n_steps, sample_every):
    """`simulate` and its derivative along (d_model, d_state): (state, (d_state, readings, d_readings))."""
    varying, fixed = eqx.partition((model, state), eqx.is_inexact_array)
    # the structure of a model tells its tables' sizes, which may have grown since the seed
    seeds = jax.tree.unflatten(jax.tree.structure(varying), jax.tree.leaves((d_model, d_state)))

    def advance(varying):
        new, readings = simulate(
            *eqx.combine(varying, fixed), n_steps=n_steps, probes=probes, sample_every=sample_every
        )
        floats, others = eqx.partition(new, eqx.is_inexact_array)
        return (floats, readings), others

    (floats, readings), (d_state, d_readings), others = jax.jvp(advance, (varying,), (seeds,), has_aux=True)
    return eqx.combine(floats, others), (d_state, readings, d_readings)


def _beside(case: Case, parameter: str) -> tuple[Case, Case, float]:
    """The case with a little more and a little less of the parameter, and by how much."""
    value = parameter_value(case, parameter)
    # the error of a central difference: the square of the share, and round-off over the share
    share = 1e-4 if case.precision == "float64" else 1e-2
    step = share * value if value else share
    return case.replace({parameter: value + step}), case.replace({parameter: value - step}), step


def _seed(case: Case, parameter: str, model: Model, state: State) -> tuple[Any, Any]:
    """Slopes of the floats of model and initial state over the parameter, by differences of two builds.

    The time step counts as constant: it only ever jumps, to divide the sampling interval.
    """
    ahead, behind, step = _beside(case, parameter)
    settings = search_settings(model)
    floats = eqx.filter((model, state), eqx.is_inexact_array)
    leaves, structure = jax.tree.flatten(floats)
    beside = [
        jax.tree.leaves(eqx.filter(build(near, settings), eqx.is_inexact_array)) for near in (ahead, behind)
    ]
    shapes = [[leaf.shape for leaf in one] for one in (leaves, *beside)]
    if not shapes[0] == shapes[1] == shapes[2]:
        raise CaseError(f"{parameter} changes the number of ghosts here: compare runs with js.sweep")
    slopes = [(a - b) / (2 * step) for a, b in zip(*beside, strict=True)]
    d_model, d_state = jax.tree.unflatten(structure, slopes)
    return eqx.tree_at(lambda m: m.dt, d_model, 0.0 * d_model.dt), d_state


def grain(x: np.ndarray, dx: np.ndarray, spacing: float) -> float:
    """Root mean square difference (m) of a field `[N, D]` from linear fits in cells of four spacings.

    It is near zero for the field of a flow, and the field's own size where neighbours have nothing in common.
    """
    cells = np.unique(np.floor(x / (4 * spacing)).astype(int), axis=0, return_inverse=True)[1].ravel()
    rest = 0.0
    for cell in range(cells.max() + 1):
        here = cells == cell
        A = np.hstack([np.ones((here.sum(), 1)), x[here]])
        rest += np.sum((dx[here] - A @ np.linalg.lstsq(A, dx[here], rcond=None)[0]) ** 2)
    return float(np.sqrt(rest / len(x)))
