"""Recorder of one run: keeps its readings in memory and writes them to its file after every chunk."""

from __future__ import annotations

import dataclasses
import math
import tempfile
import time
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxsph.errors import CaseError, FileError
from jaxsph.model.interfaces import Model
from jaxsph.model.solution import Solution
from jaxsph.model.state import State
from jaxsph.output.hdf5 import Variable
from jaxsph.output.run_file import RunFile
from jaxsph.parts.border import zones
from jaxsph.problem.problem import Problem
from jaxsph.problem.source import Source
from jaxsph.run.chunks import sample_times, search_settings
from jaxsph.run.devices import describe_machine, gather
from jaxsph.run.scene import places_of, scene_of


class Start:
    """Starting point of a run: problem, source, model and initial state (of a checkpoint if the run is
    resumed)."""

    def __init__(
        self, source: Source, problem: Problem, model: Model | None = None, state: State | None = None
    ) -> None:
        """**Arguments**: `model`: the problem's model with other neighbour tables; `state`: state of a
        checkpoint. Without them the run starts from the beginning."""
        self.source, self.problem = source, problem
        self.model = problem.model if model is None else model
        self.state = problem.state if state is None else state


class Recorder:
    """Readings of one run, kept in memory and written to its file after every chunk."""

    def __init__(self, start: Start, t1: float, file: RunFile | None = None) -> None:
        """**Arguments**: `t1`: end of the run, s; `file`: the run's file, None for a run without a file."""
        self.problem, self._source, self.file = start.problem, start.source, file
        self.sample_every, self.per_chunk = start.problem.sample_every, start.problem.per_chunk
        self.first = int(start.state.step)
        self.last = round(t1 / start.problem.sample_dt) * self.sample_every
        self._chunks: list[dict[str, np.ndarray]] = []
        self._began = time.perf_counter()

    def record(self, model: Model, state: State, readings: dict[str, jax.Array]) -> dict:
        """Records a chunk's readings and the state after the chunk; returns the readings as recorded."""
        series = {k: np.asarray(v) for k, v in readings.items()}
        series["time"] = sample_times(series["time"], self.problem.sample_dt)
        self._chunks.append(series)
        if self.file is not None:
            variables = {name: Variable(*self.problem.units[name]) for name in series}
            progress = search_settings(model) | {"wall_seconds": time.perf_counter() - self._began}
            self.file.append(series, variables, self._snapshot(model, state), saved_state(state), progress)
        return series

    def solution(self, model: Model, state: State, beside: int = 1) -> Solution:
        """Returns series, state and results of the whole run, and writes the results to the run's file.

        `beside`: number of runs that ran side by side and share the wall time.
        """
        if self.file is not None:
            series = self.file.series()
        else:
            series = {k: np.concatenate([r[k] for r in self._chunks]) for k in self._chunks[0]}
        solution = Solution(series, self.problem.units, model, state, self._source)
        seconds = (time.perf_counter() - self._began) / beside
        since = 0.0 if self.file is None else self.file.since
        steps = int(state.step) - self.first
        results, notices = self.problem.summary(solution, seconds, steps, since)
        if self.file is not None:
            self.file.finish(results, notices, self.problem.labels)
        return dataclasses.replace(solution, results=results, notices=notices, labels=self.problem.labels)

    def _snapshot(self, model: Model, state: State) -> dict[str, Any]:
        """Particles in the order of their ids, poses of the solids, and points of the links."""
        snapshot = {
            "time": int(state.step) / self.sample_every * self.problem.sample_dt,
            "step": int(state.step),
        }
        fields, first = [], 0
        for zone, its in zones(model, state):
            fields.append(_fields(zone, its, first))
            first += len(its.particles.id)
        joined = {name: np.concatenate([one[name] for one in fields]) for name in fields[0]}
        return snapshot | joined | places_of(model, state)


def _fields(model: Model, state: State, first: int) -> dict[str, np.ndarray]:
    """Fields of the particles in the order of their ids, which begin with `first`."""
    p = state.particles
    order = np.argsort(np.asarray(p.id))
    pressure = np.asarray(_pressure(model, state))
    found = {"x": p.x, "u": p.u, "p": pressure, "id": np.asarray(p.id) + first}
    return {name: np.asarray(a)[order] for name, a in found.items()}


_pressure = jax.jit(Model.pressure)


def check_end(start: Start, t1: float, ended: bool = True) -> None:
    """Checks the end t1 (s) of a run.

    **Raises** CaseError if t1 is not finite or lies before the present time; also if t1 equals the present
    time, unless `ended` is false (the run stopped there without results).
    """
    dt = start.problem.sample_dt
    now = int(start.state.step) / start.problem.sample_every * dt
    if not math.isfinite(t1):
        raise CaseError(
            f"t1 = {t1:g} s: must be a finite time later than the current time of the run, {now:g} s"
        )
    if round(t1 / dt) < round(now / dt) + ended:
        least = now + ended * dt
        raise CaseError(f"t1 = {t1:g} s: the run is already at {now:g} s; give a t1 of at least {least:g} s")


def new_file(path: str | Path, start: Start, overwrite: bool, devices: int = 1) -> RunFile:
    """Creates the file of a run, without samples. `devices`: number of devices that share the run.

    **Raises** FileError if the file exists and `overwrite` is false.
    """
    coordinates = {}
    for probe in start.problem.probes:
        coordinates |= probe.coordinates()
    return RunFile.create(
        path,
        start.source.to_toml(),
        search_settings(start.model),
        coordinates,
        overwrite=overwrite,
        numbers=deciding_numbers(start.model, start.problem.state),
        scene=scene_of(start.problem),
        machine=describe_machine(devices),
    )


def recording_time(start: Start, chunks: list[tuple[State, dict[str, jax.Array]]]) -> float:
    """Wall time (s per time step) for recording a chunk, from the states and readings after two chunks.

    The first chunk, with which the arrays of the file are created, is not measured. Of the readings one
    sample is recorded, because most of this time is for the snapshot and the checkpoint.
    """
    took, problem = 0.0, start.problem
    with tempfile.TemporaryDirectory() as folder:
        recorder = Recorder(start, problem.t1, new_file(Path(folder) / "timed.h5", start, overwrite=False))
        for state, readings in chunks:
            began = time.perf_counter()
            sample = {name: a[:1] for name, a in readings.items()}
            recorder.record(start.model, gather(state, len(start.state.particles.id)), sample)
            took = time.perf_counter() - began
    return took / problem.per_chunk


def deciding_numbers(model: Model, state: State) -> dict[str, list[float]]:
    """Numbers that determine a run, by name, such as its time step, lengths and number of particles.

    A single number is represented by its value, an array by its size, mean and root mean square. The
    neighbour tables are left out, because their sizes may change during a run.
    """
    found = {"particles": [float(state.particles.x.shape[0])]}
    for path, leaf in jax.tree_util.tree_flatten_with_path(model)[0]:
        values = np.asarray(leaf, np.float64)
        name = jax.tree_util.keystr(path).lstrip(".")
        if name.startswith("search."):
            continue
        if values.ndim == 0:
            found[name] = [float(values)]
        elif values.size:
            found[name] = [float(values.size), float(values.mean()), float(np.sqrt(np.mean(values**2)))]
        else:
            found[name] = [0.0]
    return found


def differences(stored: dict[str, list[float]], now: dict[str, list[float]]) -> list[str]:
    """Descriptions of the differences between a run's stored and current values; empty if there are none."""
    found = []
    for name in [*stored, *(name for name in now if name not in stored)]:
        old, new = stored.get(name), now.get(name)
        if old is None or new is None:
            found.append(f"{name} is {'new' if old is None else 'gone'}")
            continue
        # another machine may round the sums of `build` differently, by 1e-6 in float32
        scale = max(map(abs, [*old, *new]))
        if len(old) != len(new) or not np.allclose(old, new, rtol=1e-5, atol=1e-6 * scale, equal_nan=True):
            what = ("", "size ", "mean ", "rms ") if len(old) > 1 else ("",)
            k = next((k for k, (a, b) in enumerate(zip(old, new, strict=False)) if a != b), 0)
            label = what[k + 1] if len(old) > 1 else ""
            found.append(f"{label}{name} was {old[k]:.6g} and is {new[k]:.6g}")
    return found


def saved_state(state: State) -> dict[str, np.ndarray]:
    """Every array of a state by its name."""
    leaves = jax.tree_util.tree_flatten_with_path(state)[0]
    return {jax.tree_util.keystr(path).lstrip("."): np.asarray(leaf) for path, leaf in leaves}


def restored_state(like: State, saved: dict[str, np.ndarray], path: Any) -> State:
    """State with the arrays of a checkpoint. **Raises** FileError if they do not fit the state `like`."""
    leaves, tree = jax.tree_util.tree_flatten_with_path(like)
    found = []
    for key, leaf in leaves:
        name = jax.tree_util.keystr(key).lstrip(".")
        if name not in saved or saved[name].shape != leaf.shape or saved[name].dtype != leaf.dtype:
            raise FileError(
                f"{path}: the checkpoint does not fit the case ({name} is missing, or its shape or type "
                "differs), because another version made it; run the case again"
            )
        found.append(jnp.asarray(saved[name]))
    return jax.tree_util.tree_unflatten(tree, found)
