"""Problem to run: a model with its initial state, probes and results."""

from __future__ import annotations

import copy
import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import numpy as np

from jaxsph.errors import CaseError
from jaxsph.model.consistency import check_parts, part_states
from jaxsph.model.interfaces import Model
from jaxsph.model.meaning import Label
from jaxsph.model.probe import AbstractProbe
from jaxsph.model.solution import Solution
from jaxsph.model.state import State, Tally
from jaxsph.probes.default import DEFAULT, default_probes
from jaxsph.probes.joined import described
from jaxsph.problem.record import (
    AbstractAveraging,
    MeanOfRecord,
    PowerMean,
    Record,
    Result,
    WholeRecord,
    harvested,
)
from jaxsph.problem.results import energy_result, noise_result, oscillation_result
from jaxsph.problem.trouble import Remedies


class Problem:
    """Problem to run: a model, its initial state and probes, the sampling interval, and results to compute.

    A problem is built by `Case.problem()` or by a function of your own. `jaxsph run FILE:FUNCTION` runs the
    function like a case, and writes a file and a page. `resume` and `sweep` accept the function too.
    """

    def __init__(
        self,
        model: Model,
        state: State,
        sample_dt: float,
        t1: float,
        *,
        probes: Sequence[AbstractProbe] | None = None,
        results: Sequence[Result] = (),
        **more: Any,
    ) -> None:
        """**Arguments**: `model` and `state`, from `assemble` with the same `sample_dt`; `sample_dt`: time
        between samples, s; `t1`: end of the run, s; `probes`: by default probes of energies, noise and
        parts; `results`: results to compute in addition to the energy balance and noise. Also, by name:
        `snapshot_dt`, time between snapshots, s, by default five samples; `name`, used for names of files;
        `description`; `averaging`, part of the record over which means are taken; `mean_of_power`, function
        that takes the name of a differentiable result and returns its `MeanOfRecord`; `remedies`, what to
        change if a run fails.
        **Raises** CaseError for a time that is not positive, if `sample_dt` is not a whole number of time
        steps, or if two probes have a reading of the same name.
        """
        self.model, self.state = model, state
        self.sample_dt, self.t1 = float(sample_dt), float(t1)
        self.probes = tuple(default_probes(model, state, sample_dt) if probes is None else probes)
        self.snapshot_dt = float(more.pop("snapshot_dt", 5 * self.sample_dt))
        self.name: str = more.pop("name", "assembled")
        self.description: str = more.pop("description", "")
        self.averaging: AbstractAveraging = more.pop("averaging", WholeRecord())
        self._results = tuple(results)
        self.remedies: Remedies = more.pop("remedies", {})
        self.mean_of_power: Callable[[str], MeanOfRecord] = more.pop("mean_of_power", self._energy_of)
        if more:
            raise TypeError(
                f"Problem has no argument {', '.join(more)}: it has probes, results, snapshot_dt, name, "
                "description, averaging, mean_of_power and remedies"
            )
        self._check()

    def _check(self) -> None:
        for name in ("sample_dt", "t1", "snapshot_dt"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise CaseError(f"{name} = {value!r} s: must be a positive, finite time")
        steps = self.sample_dt / float(self.model.dt)
        if abs(steps - round(steps)) > 1e-3 * steps:
            raise CaseError(
                f"sample_dt = {self.sample_dt:g} s is {steps:.4g} time steps of the model, but must be a "
                "whole number of time steps: give assemble and Problem the same sample_dt"
            )
        try:
            self.units = described(self.probes)
        except ValueError as error:
            raise CaseError(str(error)) from None

    def with_parts(
        self,
        *,
        probes: Sequence[AbstractProbe] = (),
        results: Sequence[Result] = (),
        t1: float | None = None,
        **parts: Any,
    ) -> Problem:
        """Copy of the problem with some parts of its model replaced, and with further probes and results.

        **Arguments**: `parts`: complete new values of fields of `Model`, by name, for example `chambers`,
        `dampers`, `moving` or `scheme`; the water keeps its initial pressures. `t1`: new end of the run, s.
        **Raises** CaseError for an unknown field, parts that do not fit together, or a scheme that is not
        stable at the model's time step.
        """
        changed = copy.copy(self)
        changed.model = _with_parts(self.model, parts)
        changed.state = _begun(changed.model, self.model, self.state)
        kept = (probe for probe in self.probes if not isinstance(probe, DEFAULT))
        changed.probes = (*default_probes(changed.model, changed.state, self.sample_dt), *kept, *probes)
        changed._results = (*self._results, *results)
        changed.t1 = self.t1 if t1 is None else float(t1)
        changed._check()
        return changed

    @property
    def results(self) -> tuple[Result, ...]:
        """Results to compute from the record: the standard results, and those given to this problem."""
        energy = energy_result(self.model, not isinstance(self.averaging, WholeRecord))
        return energy, noise_result, *self._results, oscillation_result(self.model, self.averaging)

    @property
    def sample_every(self) -> int:
        """Number of time steps between two samples, a whole number."""
        return round(self.sample_dt / float(self.model.dt))

    @property
    def per_chunk(self) -> int:
        """Number of time steps between two snapshots, a whole number of samples."""
        return max(1, round(self.snapshot_dt / self.sample_dt)) * self.sample_every

    @property
    def labels(self) -> dict[str, Label]:
        """Labels of the results, by name."""
        return {name: label for one in self.results for name, label in one.labels.items()}

    def summary(
        self, solution: Solution, seconds: float, steps: int, since: float = 0.0
    ) -> tuple[dict[str, float], tuple[str, ...]]:
        """Scalar results and notices of a completed run: see `summary_of`."""
        return summary_of(solution, self.results, self.averaging, seconds, steps, since)

    def _energy_of(self, of: str) -> MeanOfRecord:
        """Function from the power of power take-offs to their energy from the start to t1, J (J/m in 2-D)."""
        known = dict.fromkeys((*self.labels, "energy_pto"))
        if of != "energy_pto" and of in self.labels:
            raise CaseError(
                f"of = {of!r}: derivatives through the time loop are available for energy_pto only; use "
                "method=js.Ensemble()"
            )
        if of != "energy_pto":
            raise CaseError(f"of = {of!r}: must be one of {', '.join(known)}")
        if not harvested(self.model):
            raise CaseError(
                f"of = {of!r}: the model has no power take-off; add one to a chamber or a duct, or add a "
                "link with harvests=True"
            )
        return energy_of_power(self.sample_dt)


def _with_parts(model: Model, parts: dict[str, Any]) -> Model:
    """The model with some of its parts replaced.

    **Raises** CaseError for an unknown field, parts that do not fit together, or an unstable time step.
    """
    fields = [field.name for field in dataclasses.fields(Model)]
    for name in parts:
        if name not in fields:
            raise CaseError(f"{name} is not a field of the model: use one of {', '.join(fields)}")
    given = {name: tuple(value) if isinstance(value, list) else value for name, value in parts.items()}
    changed = dataclasses.replace(model, **given)
    try:
        check_parts(changed)
    except ValueError as error:
        raise CaseError(str(error)) from None
    g, dt = float(np.linalg.norm(changed.g)), float(changed.dt)
    stable = changed.scheme.stable_dt(g, len(changed.g))
    if dt > 1.001 * stable:
        raise CaseError(
            f"the scheme is stable with time steps up to {stable:.3g} s, but the model's step is {dt:.3g} s: "
            "build the problem with shorter time steps"
        )
    return changed


def _begun(model: Model, before: Model, state: State) -> State:
    """Initial state of a changed model, from the state of the model `before` the change."""
    dtype = state.particles.x.dtype
    old, new = part_states(before, dtype), part_states(model, dtype)
    # a part whose own initial state is unchanged keeps the state that the problem gave it
    same = [name for name in new if name in old and eqx.tree_equal(new[name], old[name]) is True]
    parts = new | {name: state.parts[name] for name in same}
    ledger = {name: state.ledger.get(name, Tally.zero(dtype)) for name in model.entries()}
    limits = {name: state.limits.get(name, Tally.zero(dtype)) for name in model.scheme.limiters()}
    particles = state.particles
    if model.scheme is not before.scheme:
        particles = model.scheme.with_pressure(particles, before.scheme.pressure(particles))
    begun = (particles, parts, ledger, limits)
    return eqx.tree_at(lambda s: (s.particles, s.parts, s.ledger, s.limits), state, begun)


def energy_of_power(sample_dt: float) -> MeanOfRecord:
    """Function from a whole record of power, sampled every `sample_dt` (s), to the energy, J (J/m in 2-D)."""
    # a reading of power is the mean since the previous sample; at the first sample it is zero
    total = PowerMean(lambda power: float(np.sum(power)) * sample_dt)
    return lambda *_: total


def summary_of(
    solution: Solution,
    made: Sequence[Result],
    averaging: AbstractAveraging,
    seconds: float,
    steps: int,
    since: float = 0.0,
) -> tuple[dict[str, float], tuple[str, ...]]:
    """Scalar results of a completed run, and notices about their meaning and about results that failed.

    **Arguments**: wall time `seconds` (s) of the last `steps` steps; `since`: see `Record`. A result whose
    computation fails is left out, so that the failure cannot prevent the run from completing.
    """
    series = solution.series
    results = {
        "t_end": float(solution.model.time(solution.state)),
        "steps": float(int(solution.state.step)),
        "wall_seconds": seconds,
        "particle_steps_per_second": steps * solution.state.particles.x.shape[0] / seconds,
    }
    names = [name for name in harvested(solution.model) if name in series]
    names = names or [name for name in ("kinetic",) if name in series]
    window = averaging.window(solution.t, [series[name] for name in names], since)
    record, notices = Record(solution, window, since, results), []
    for one in made:
        try:
            new = {name: float(value) for name, value in one.make(record).items()}
        except Exception as error:  # any error: the series must be kept even if a scalar fails
            kind = "" if isinstance(error, ValueError) else f"{type(error).__name__}: "
            notices.append(f"no result for the {one.what}: {kind}{error}")
        else:
            results |= new
    return results, (*averaging.notices(record, results), *notices)
