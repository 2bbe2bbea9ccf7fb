"""Ratio of the time of a run in a vmapped batch to the time of a run alone."""

from __future__ import annotations

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import jaxsph as js
from experiments.common import Report, timed, use_threads


def main(dx: float = 0.02, lanes: int = 8, blocks: int = 8, turns: int = 5, threads: int = 1) -> None:
    """Times blocks of steps of the built-in OWC, alternately for `lanes` dampings at once and for one."""
    use_threads(threads)
    model, state = js.build(js.load_case("owc").replace({"dx": dx, "scheme.kind": "weakly_compressible"}))
    # an initial velocity along the tank, so that air flows in the chamber from the start
    state = eqx.tree_at(lambda s: s.particles.u, state, state.particles.u.at[:, 0].add(0.05))
    n_steps = blocks * model.search.rebuild_every
    K = jnp.geomspace(200.0, 2000.0, lanes)

    def run(K_dm, state):
        changed = eqx.tree_at(lambda m: m.chambers[0].pto.K_dm, model, K_dm)
        return js.simulate(changed, state, n_steps=n_steps)[0]

    alone = jax.jit(run).lower(K[0], state).compile()
    states = jax.tree.map(lambda a: jnp.broadcast_to(a, (lanes, *a.shape)), state)
    together = jax.jit(jax.vmap(run)).lower(K, states).compile()
    last = [together(K, states), [alone(k, state) for k in K]]
    both = functools.partial(together, K, states), functools.partial(alone, K[0], state)
    seconds = np.array([[timed(way) for way in both] for _ in range(turns)]).min(axis=0)
    n = state.particles.x.shape[0]
    with Report("bench_batch", f"Runs of {n} particles: {lanes} in one call, and one alone", dx) as report:
        apart = max(
            float(jnp.abs(last[0].particles.x[k] - one.particles.x).max()) for k, one in enumerate(last[1])
        )
        report.row(f"positions after {n_steps} steps: largest difference over dx", apart / dx)
        report.row("flags raised", int(np.count_nonzero(last[0].status.bits)), theory=0.0)
        ratio = seconds[0] / lanes / seconds[1]
        report.row(
            "time per run in the batch over the time of a single run",
            ratio,
            bar="at most 1.5",
            passes=ratio <= 1.5,
        )
        report.row("single run: steps per second", n_steps / seconds[1])
        report.row("in the batch: members x steps per second", lanes * n_steps / seconds[0])
