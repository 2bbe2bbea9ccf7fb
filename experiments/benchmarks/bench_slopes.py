"""Cost of a derivative relative to the run, in forward mode (exact and filtered) and reverse mode."""

from __future__ import annotations

import dataclasses
import time

import equinox as eqx
import jax
import jax.numpy as jnp

import jaxsph as js
from experiments.common import Report, use_threads
from jaxsph.model.interfaces import ExactTangents

FORWARD, REVERSE = 2.2, 5.0
"""Largest ratios of the wall time of a run with its slope to that of the run alone (-)."""


def main(
    dx: float = 0.02,
    scheme: str = "weakly_compressible",
    blocks: int = 8,
    turns: int = 3,
    reverse: bool = True,
) -> None:
    """Times blocks of steps of the built-in OWC (best of `turns`), then a wave period in reverse mode.

    The time of the period is the shorter one of two.
    """
    use_threads(1)
    case = js.load_case("owc").replace({"dx": dx, "scheme.kind": scheme})
    model, state = js.build(case)
    # an initial velocity along the tank, so that air flows in the chamber from the start
    state = eqx.tree_at(lambda s: s.particles.u, state, state.particles.u.at[:, 0].add(0.05))
    every = model.search.rebuild_every
    K = model.chambers[0].pto.K_dm
    n = state.particles.x.shape[0]

    def absorbed(n_steps, tangents):
        changed = dataclasses.replace(model, tangents=tangents)

        def of(K_dm, state):
            wider = eqx.tree_at(lambda m: m.chambers[0].pto.K_dm, changed, K_dm)
            new, _ = js.simulate(wider, state, n_steps=n_steps, sample_every=n_steps)
            return new.ledger["pto"].total - state.ledger["pto"].total

        return of

    def forward(function):
        return lambda K, s: jax.jvp(lambda K: function(K, s), (K,), (jnp.ones_like(K),))

    few = blocks * every
    period = round(case.waves.T / float(model.dt) / every) * every
    value = absorbed(few, ExactTangents())
    ways = {"exact": forward(value), "filtered": forward(absorbed(few, js.TangentFilter()))}
    run = Compiled(value, K, state)
    name = "bench_slopes" + ("" if scheme == "weakly_compressible" else f"_{scheme}")
    with Report(name, f"Cost of derivatives, OWC of {n} particles, one thread", dx) as report:
        for name, way in ways.items():
            slope = Compiled(way, K, state)
            best = [min(c.seconds(K, state) for _ in range(turns)) for c in (run, slope)]
            ratio, memory = best[1] / best[0], slope.bytes / run.bytes
            report.row(
                f"value and slope, {name}: time over that of the run",
                ratio,
                bar=f"at most {FORWARD}",
                passes=ratio <= FORWARD,
            )
            report.row(
                f"value and slope, {name}: memory over that of the run",
                memory,
                bar="at most 3",
                passes=memory <= 3,
            )
        if reverse:
            smooth = absorbed(period, js.TangentFilter())
            both = [Compiled(f, K, state) for f in (smooth, forward(smooth), jax.value_and_grad(smooth))]
            seconds = [min(c.seconds(K, state) for _ in range(2)) for c in both]
            by_forward, by_reverse = float(both[1].last[1]), float(both[2].last[1])
            ratio, memory = seconds[2] / seconds[0], both[2].bytes / 1e9
            report.row(
                "reverse mode of one wave period: time over that of the run",
                ratio,
                bar=f"at most {REVERSE}",
                passes=ratio <= REVERSE,
            )
            report.row(
                "reverse mode of one wave period: memory", memory, "GB", bar="at most 4", passes=memory <= 4
            )
            report.row(
                "slope in reverse mode: relative difference from forward mode",
                abs(by_reverse / by_forward - 1),
            )


class Compiled:
    """A compiled function and the memory that it needs (bytes)."""

    def __init__(self, function, *arguments) -> None:
        self.function = jax.jit(function).lower(*arguments).compile()
        memory = self.function.memory_analysis()
        self.bytes = memory.temp_size_in_bytes + memory.argument_size_in_bytes + memory.output_size_in_bytes
        self.last = None

    def seconds(self, *arguments) -> float:
        """Wall time of one call, s."""
        began = time.perf_counter()
        self.last = jax.block_until_ready(self.function(*arguments))
        return time.perf_counter() - began
