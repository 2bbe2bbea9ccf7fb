"""Ratio of an OWC step's time to the time of its pair sums, peak memory, and wall time for 21 simulated s."""

from __future__ import annotations

import resource
import statistics
import time

import jax

import jaxsph as js
from experiments.common import Report, timed, use_threads
from jaxsph.model.state import Failure
from jaxsph.schemes.step import at_rest


def main(dx: float = 0.01, steps: int = 2000, threads: int = 2, turns: int = 5) -> None:
    """Runs `steps` steps of the OWC with spacing dx, alternating with its pair sums alone."""
    use_threads(threads)
    case = js.load_case("owc").replace({"dx": dx, "scheme.kind": "weakly_compressible"})
    model, state = js.build(case)
    probes = js.make_probes(case, model, state)
    every = round(case.output.sample_dt / float(model.dt))
    chunk = max(1, steps // (turns * every)) * every
    advance = jax.jit(js.simulate, static_argnames=("n_steps", "sample_every"))

    def run(state):
        state, series = advance(model, state, n_steps=chunk, probes=probes, sample_every=every)
        return jax.block_until_ready((state, series))[0]

    passes = pair_passes(model, state)
    run(state)  # compiles
    whole, pairs = [], []
    for _ in range(turns + 1):
        began = time.perf_counter()
        state = run(state)
        whole.append((time.perf_counter() - began) / chunk)
        if failure := Failure(int(state.status.bits)):
            raise SystemExit(f"the run failed: {failure.name}")
        pairs += [timed(passes) for _ in range(9)]
    n = state.particles.x.shape[0]
    step, work = statistics.median(whole), statistics.median(pairs)
    ratio = min(whole) / min(pairs)
    total = 21.0 / float(model.dt)
    hours = total * step / 3600
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024**2
    with Report("bench_step", f"A whole step of the OWC, {n} particles, {threads} thread(s)", dx) as report:
        report.row("time per step", 1e3 * step, "ms")
        report.row("time of the pair sums of a step", 1e3 * work, "ms")
        report.row(
            "shortest time of a step over the shortest time of its pair sums",
            ratio,
            bar="at most 1.6",
            passes=ratio <= 1.6,
        )
        label = f"wall time for 21 s of simulated time, extrapolated from {len(whole) * chunk} steps"
        # the paper: 36.1 h at dx = 0.01 m on four cores of an i5-7500T
        report.row(label, 60 * hours, "min", paper=36.1 * 60, bar="< 60 min", passes=hours < 1)
        report.row("peak memory of the process", peak, "GiB", bar="< 2 GB", passes=peak < 1.86)


def pair_passes(model, state):
    """Function that evaluates the two pair sums of one right-hand side on the tables of the model."""
    scheme = model.scheme

    @jax.jit
    def prepared(state):
        state, tables = scheme.prepare(model, state)
        p = state.particles
        ghosts = scheme.ghosts(model, state, tables, at_rest(model, state))
        ghosts = scheme.ghost_velocity(model, state.parts, tables, ghosts)
        return p, scheme.sources(ghosts, ghosts.u), tables

    @jax.jit
    def passes(particles, sources, tables):
        rates = scheme.momentum(model, particles, sources, tables)
        return rates.acceleration, scheme.continuity(particles, sources, rates.grad_rho, tables)

    given = prepared(state)
    jax.block_until_ready(passes(*given))
    return lambda: passes(*given)
