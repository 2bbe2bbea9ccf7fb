"""Estimates the wall time of a run on this machine by compiling the run and timing a few of its steps."""

from __future__ import annotations

import time
from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np

from jaxsph.core.arrays import on_device
from jaxsph.model.interfaces import Model
from jaxsph.model.state import State
from jaxsph.problem.sources import source_of
from jaxsph.run.devices import everywhere, find_devices, share, usual_devices
from jaxsph.run.lowered import key_of
from jaxsph.run.recorder import Start, recording_time
from jaxsph.run.simulate import simulate_chunk
from jaxsph.waves.theory import standing_velocity

ENOUGH = 2.0
"""Time (s) for which steps are timed, unless a single sample takes longer."""


class Duration(NamedTuple):
    """Wall time of a run, estimated from a few of its steps."""

    compilation: float
    """Time until the first step, model building included, s; shorter once JAX has cached the compiled
    steps."""
    step: float
    """Wall time per time step, recording included, s."""
    steps: int
    """Number of time steps to the run's end."""
    devices: int
    """Number of devices that share the run."""

    @property
    def total(self) -> float:
        """Wall time of the whole run, s."""
        return self.compilation + self.steps * self.step


def duration(given: Any, devices: int | None = None) -> Duration:
    """Estimates the wall time of a run of a case, a problem or a function on this machine.

    Steps are timed with the same compiled function as in the run; JAX caches it. Water at rest is set in
    motion first, because the pressure solver needs fewer iterations in water at rest than in waves.
    `devices`: as for `run`. **Raises** CaseError, as `run`.
    """
    find_devices(devices)
    began = time.perf_counter()
    source = source_of(given)
    start = Start(source, source.problem())
    problem = start.problem
    most, every = problem.per_chunk, problem.sample_every
    model, state = start.model, _in_motion(start.model, start.state)
    model, state = share(model, state, devices or usual_devices(model, state))
    probes, key = everywhere(model.search.slabs, problem.probes), key_of(source)

    def advance(state: State, n_steps: int) -> tuple[float, tuple[State, dict[str, jax.Array]]]:
        """Wall time (s) of `n_steps` steps, and the state and the readings after them."""
        began = time.perf_counter()
        found = jax.block_until_ready(simulate_chunk(model, state, probes, n_steps, every, most, key))
        return time.perf_counter() - began, found

    _, first = advance(state, every)
    compiled = time.perf_counter()
    samples, (took, later) = 1, advance(first[0], every)
    while took < ENOUGH and samples * every < most:
        samples = min(2 * samples, most // every)
        took, later = advance(first[0], samples * every)
    step = took / (samples * every)
    return Duration(
        max(compiled - began - every * step, 0.0),
        step + recording_time(start, [first, later]),
        round(problem.t1 / problem.sample_dt) * every,
        model.search.slabs.count,
    )


def _in_motion(model: Model, state: State) -> State:
    """State whose water, if it is at rest under gravity, has the velocities of a standing wave.

    The wave is about four depths long, and its height is a tenth of the depth.
    """
    x, g = np.asarray(state.particles.x, float), float(np.linalg.norm(model.g))
    if g == 0.0 or np.any(state.particles.u):
        return state
    low = np.zeros(x.shape[1])
    low[[0, -1]] = x.min(axis=0)[[0, -1]]
    length, depth = (x - low).max(axis=0)[[0, -1]]
    k = max(round(length / (2.0 * depth)), 1) * np.pi / length
    u = standing_velocity(x - low, 0.05 * depth, k, depth, g)
    return eqx.tree_at(lambda s: s.particles.u, state, on_device(u, state.particles.u.dtype))
