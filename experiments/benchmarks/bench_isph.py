"""Speed of the incompressible scheme in 3-D: a step of the column's dam break, and the Poisson operator."""

from __future__ import annotations

import resource
import time

import jax
import jax.numpy as jnp
import numpy as np

import jaxsph as js
from experiments.common import Report, use_threads
from jaxsph.core.pairs import weighted_sum
from jaxsph.run.devices import share

PAPER = 158_000.0
"""Particle steps per second: 200 steps of 4,222,746 in 5341 s, 16 threads (Yeylaghi et al. 2016, table 1)."""


def main(dx: float = 0.01, steps: int = 10, turns: int = 3, threads: int = 1) -> None:
    """Times steps after the gate's opening, searches included, on so many cores or the accelerator that jax
    finds: blocks of `steps` steps between searches, one before the clock starts."""
    use_threads(threads)
    model, state = share(*js.build(js.load_case("dam_break_column").replace({"dx": dx})), 1)
    every = model.search.rebuild_every
    advance = jax.jit(lambda m, s: js.simulate(m, s, n_steps=steps * every)[0]).lower(model, state).compile()
    memory = advance.memory_analysis()
    state = jax.block_until_ready(advance(model, state))
    seconds = min(_seconds(advance, model, state) for _ in range(turns)) / (steps * every)
    water, walls = state.particles.x.shape[0], model.walls.count
    if int(state.status.bits):
        raise SystemExit("a step failed: see its status")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9
    state, tables = jax.jit(lambda m, s: m.scheme.prepare(m, s))(model, state)
    pairs = int(np.sum(np.asarray(tables.fluid.indices) != water + walls))
    table = tables.fluid.indices
    weights = jnp.ones(table.shape, state.particles.p.dtype)
    field = jnp.zeros(water + walls + 1, weights.dtype)
    operator = jax.jit(weighted_sum).lower(weights, field, table).compile()
    operator(weights, field, table)
    once = min(_seconds(operator, weights, field, table) for _ in range(turns))
    with Report(
        f"bench_isph_{dx:g}_{threads}", f"Incompressible scheme in 3-D: speed, {threads} thread(s)", dx
    ) as report:
        report.row("particles of water", float(water))
        report.row("with those of walls and column", float(water + walls))
        report.row("a step, searches included", seconds, "s")
        rate = (water + walls) / seconds
        report.row(
            "particle steps per second, all", rate, "1/s", paper=PAPER, bar="160,000", passes=rate > 1.6e5
        )
        report.row("particle steps per second, water alone", water / seconds, "1/s")
        report.row("500 steps", 500 * seconds, "s")
        report.row("Poisson operator, per pair", 1e9 * once / pairs, "ns")
        size = memory.temp_size_in_bytes + memory.argument_size_in_bytes + memory.output_size_in_bytes
        report.row("memory", size / 1e9, "GB")
        report.row("largest resident memory until then", peak, "GB")
        report.row(
            "memory at 4,222,746 particles, by their number", size / 1e9 * 4_222_746 / (water + walls), "GB"
        )


def _seconds(function, *arguments) -> float:
    began = time.perf_counter()
    jax.block_until_ready(function(*arguments))
    return time.perf_counter() - began
