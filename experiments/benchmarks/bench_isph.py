"""Speed of the incompressible scheme in 3-D: a step of a dam break on a column, and the Poisson operator."""

from __future__ import annotations

import resource
import time

import jax
import jax.numpy as jnp
import numpy as np

import jaxsph as js
from experiments.common import Report, use_threads
from jaxsph.core.pairs import weighted_sum
from jaxsph.run.devices import find_devices, share
from jaxsph.run.simulate import UNSPLIT

PAPER_SIZE, PAPER_STEP = 4_222_746, 5341.0 / 200
"""Number of particles of the paper's largest run, and time (s) of its step on 16 threads (Yeylaghi et al.
2016, table 1)."""
PAPER = PAPER_SIZE / PAPER_STEP
"""Particle steps per second of the paper's largest run, 1/s."""


def main(dx: float = 0.01, steps: int = 10, turns: int = 3, threads: int = 1, devices: int = 1) -> None:
    """Times steps after the water's release, searches included, on `threads` cores or on an accelerator.

    Each of the `steps` blocks contains the steps between two searches. The timing follows a first run of as
    many blocks.
    """
    use_threads(threads)
    find_devices(devices)
    model, state = js.build(js.load_case("dam_break_column").replace({"dx": dx}))
    water, walls = state.particles.x.shape[0], model.walls.count
    model, state = share(model, state, devices)
    every = model.search.rebuild_every
    options = UNSPLIT if devices > 1 else None
    run = jax.jit(lambda m, s: js.simulate(m, s, n_steps=steps * every)[0], compiler_options=options)
    advance = run.lower(model, state).compile()
    size = advance.memory_analysis()
    memory = devices * (size.temp_size_in_bytes + size.argument_size_in_bytes + size.output_size_in_bytes)
    state = jax.block_until_ready(advance(model, state))
    seconds = min(_seconds(advance, model, state) for _ in range(turns)) / (steps * every)
    if int(state.status.bits):
        raise SystemExit(f"a step failed: flags {int(state.status.bits)} of jaxsph.model.state.Failure")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    many = f", {devices} devices" if devices > 1 else ""
    name = f"bench_isph_{dx:g}_{threads}" + (f"_{devices}" if many else "")
    title = f"Incompressible scheme in 3-D: speed, {threads} thread(s){many}"
    with Report(name, title, dx) as report:
        report.row("particles of water", float(water))
        report.row("particles of water, walls and column", float(water + walls))
        report.row(
            "time per step, searches included", seconds, "s", paper=PAPER_STEP * (water + walls) / PAPER_SIZE
        )
        rate = (water + walls) / seconds
        report.row(
            "particle steps per second, all particles",
            rate,
            "1/s",
            paper=PAPER,
            bar="160,000",
            passes=rate > 1.6e5,
        )
        report.row("particle steps per second, particles of water", water / seconds, "1/s")
        report.row("time of 500 steps", 500 * seconds, "s")
        report.row("memory of the compiled steps", memory / 1e9, "GB")
        report.row("peak resident memory", peak / 1e9, "GB", bar="16 GB", passes=peak < 16e9)
        report.row(
            f"memory at {PAPER_SIZE} particles, extrapolated",
            memory / 1e9 * PAPER_SIZE / (water + walls),
            "GB",
        )
        if devices == 1:
            report.row("time of the Poisson operator per pair", 1e9 * _operator(model, state, turns), "ns")


def _operator(model: js.Model, state: js.State, turns: int) -> float:
    """Time per pair (s) of a sum over the water's neighbours with given weights."""
    sources = len(state.particles.id) + model.walls.count
    _, tables = jax.jit(lambda m, s: m.scheme.prepare(m, s))(model, state)
    table = tables.fluid.table
    weights = table.stored(jnp.ones(table.indices.shape, state.particles.p.dtype))
    field = jnp.zeros(sources + 1, weights.dtype)
    operator = jax.jit(weighted_sum).lower(weights, field, table).compile()
    operator(weights, field, table)
    once = min(_seconds(operator, weights, field, table) for _ in range(turns))
    return once / int(np.sum(np.asarray(table.indices) != sources))


def _seconds(function, *arguments) -> float:
    began = time.perf_counter()
    jax.block_until_ready(function(*arguments))
    return time.perf_counter() - began
