"""Running: `simulate`, pure and of fixed length, and `run`, the host driver around it.

The driver goes in chunks: after each it looks at the status, writes series, snapshot and checkpoint in
one atomic step, and goes on. A table that overflowed or went stale is regrown and the chunk replayed;
what cannot be mended stops the run with the last good checkpoint in the file.
"""

from __future__ import annotations

import time
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxsph.case.build import build
from jaxsph.case.case import Case
from jaxsph.case.report import make_probes, steps_per_sample
from jaxsph.errors import FileError
from jaxsph.model.interfaces import Model, Reading
from jaxsph.model.solution import Solution
from jaxsph.model.state import State
from jaxsph.output.hdf5 import Variable
from jaxsph.output.run_file import RunFile
from jaxsph.run.chunks import (
    _exact_times,
    search_settings,
    steps_per_chunk,
)
from jaxsph.run.results import _results


def _coordinates(case: Case) -> dict[str, tuple[str, np.ndarray, str, str]]:
    found = {}
    if case.probes.gauges:
        x = np.asarray(case.probes.gauges)
        found["gauge_x"] = ("gauge", x, "m", "distance of the gauge from the paddle at rest")
    axes = "xz" if case.tank.width is None else "xyz"
    for given, what, names in (
        (case.probes.surface, "surface_point", axes[:-1]),
        (case.probes.pressure, "sensor", axes),
        (case.probes.velocity, "point", axes),
    ):
        if given:
            points = np.asarray(given)
            for axis, name in enumerate(names):
                found[f"{what}_{name}"] = (what, points[:, axis], "m", f"{name} of the {what}")
    return found


def _flatten(state: State) -> dict[str, np.ndarray]:
    leaves = jax.tree_util.tree_flatten_with_path(state)[0]
    return {jax.tree_util.keystr(path).lstrip("."): np.asarray(leaf) for path, leaf in leaves}


def _unflatten(like: State, saved: dict[str, np.ndarray], path: Any) -> State:
    leaves, tree = jax.tree_util.tree_flatten_with_path(like)
    found = []
    for key, leaf in leaves:
        name = jax.tree_util.keystr(key).lstrip(".")
        if name not in saved or saved[name].shape != leaf.shape or saved[name].dtype != leaf.dtype:
            raise FileError(
                f"{path}: the checkpoint does not fit the case ({name} is missing or of another "
                "shape): it was made by another version; run the case again"
            )
        found.append(jnp.asarray(saved[name]))
    return jax.tree_util.tree_unflatten(tree, found)


class _Recorder:
    """Keeps what one run reads: in memory, and after every chunk in its file."""

    def __init__(self, case: Case, model: Model, state: State, t1: float, file: RunFile | None) -> None:
        self.case, self.file = case, file
        self.sample_every = steps_per_sample(case, model)
        self.per_chunk = steps_per_chunk(case, self.sample_every)
        self.probes = make_probes(case, model, build(case, search_settings(model))[1])
        self.units = {"time": Reading("s", "time")}
        for probe in self.probes:
            self.units |= probe.describe()
        self.start = int(state.step)
        self.last = int(round(t1 / case.output.sample_dt)) * self.sample_every
        self._chunks: list[dict[str, np.ndarray]] = []
        self._began = time.perf_counter()

    def keep(self, model: Model, before: int, state: State, readings: dict[str, jax.Array]) -> dict:
        """Takes the readings of a chunk that began at the step `before`; returns them as recorded."""
        series = {k: np.asarray(v) for k, v in readings.items()}
        series["time"] = _exact_times(before, series["time"], self.case.output.sample_dt)
        self._chunks.append(series)
        if self.file is not None:
            seconds = time.perf_counter() - self._began
            _save(self.file, self.case, model, state, series, self.units, seconds)
        return series

    def finished(self, model: Model, state: State, beside: int = 1) -> Solution:
        """The whole run, its results written too; its time is shared by so many that ran beside it."""
        if self.file is not None:
            series = self.file.series()
        else:
            series = {k: np.concatenate([r[k] for r in self._chunks]) for k in self._chunks[0]}
        solution = Solution(series, self.units, model, state, self.case)
        seconds = (time.perf_counter() - self._began) / beside
        results = _results(self.case, solution, seconds, int(state.step) - self.start)
        if self.file is not None:
            self.file.finish(results)
        return eqx.tree_at(lambda s: s.results, solution, results, is_leaf=lambda x: x is None)


def _save(file, case, model, state, series, units, seconds) -> None:
    p = state.particles
    order = np.argsort(np.asarray(p.id))
    snapshot = {
        "time": int(state.step) / steps_per_sample(case, model) * case.output.sample_dt,
        "step": int(state.step),
        "paddle": float(state.own["paddle"].X) if "paddle" in state.own else 0.0,
        "x": np.asarray(p.x)[order],
        "u": np.asarray(p.u)[order],
        "p": np.asarray(model.pressure(state))[order],
        "id": np.asarray(p.id)[order],
    }
    for body in model.bodies:
        snapshot[body.name] = np.asarray(state.own[body.name].pose)
    variables = {name: Variable(*units[name][:3]) for name in series}
    file.append(
        series,
        variables,
        {name for name in series if name != "time" and units[name].group == "energy"},
        snapshot,
        _flatten(state),
        search_settings(model) | {"wall_seconds": seconds},
    )
