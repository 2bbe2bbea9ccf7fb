"""Estimates the wall time of a run on this machine by compiling the run and timing its first steps."""

from __future__ import annotations

import time
from typing import Any, NamedTuple

import jax

from jaxsph.problem.sources import source_of
from jaxsph.run.devices import everywhere, find_devices, share, usual_devices
from jaxsph.run.lowered import key_of
from jaxsph.run.simulate import simulate_chunk

ENOUGH = 2.0
"""Time (s) for which steps are timed, unless a single sample takes longer."""


class Duration(NamedTuple):
    """Wall time of a run, estimated from its first steps."""

    compilation: float
    """Time until the first step, model building included, s; shorter once JAX has cached the compiled
    steps."""
    step: float
    """Wall time per time step, s."""
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

    The first steps are timed with the same compiled function as in the run; JAX caches it. The estimate may
    be too low, because the pressure solver takes fewer iterations in water at rest than in waves.
    `devices`: as for `run`. **Raises** CaseError, as `run`.
    """
    find_devices(devices)
    began = time.perf_counter()
    source = source_of(given)
    problem = source.problem()
    model, state = share(problem.model, problem.state, devices or usual_devices(problem.model, problem.state))
    probes = everywhere(model.search.slabs, problem.probes)
    every, most = problem.sample_every, problem.per_chunk
    key = key_of(source)

    def take(n_steps: int) -> float:
        """Wall time (s) of the first `n_steps` steps."""
        began = time.perf_counter()
        jax.block_until_ready(simulate_chunk(model, state, probes, n_steps, every, most, key))
        return time.perf_counter() - began

    take(every)
    compiled = time.perf_counter()
    samples, took = 1, take(every)
    while took < ENOUGH and samples * every < most:
        samples = min(2 * samples, most // every)
        took = take(samples * every)
    step = took / (samples * every)
    steps = round(problem.t1 / problem.sample_dt) * every
    return Duration(max(compiled - began - every * step, 0.0), step, steps, model.search.slabs.count)
