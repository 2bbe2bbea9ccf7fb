"""Ratio of the time of a step of the incompressible OWC to the time with the earlier kernel and walls."""

from __future__ import annotations

import statistics

import jax

import jaxsph as js
from experiments.common import Report, timed, use_threads
from jaxsph.model.state import Failure

BEFORE = {"scheme.kernel": "gaussian", "tank.walls": "mirror"}
"""Earlier settings: the Gaussian kernel, and walls `mirror` instead of `images`."""


def main(dx: float = 0.01, steps: int = 50, warm: int = 200, turns: int = 7) -> None:
    """Runs `steps` steps `turns` times, alternately with both settings, on one thread, after `warm` steps."""
    use_threads(1)
    case = js.load_case("owc").replace({"dx": dx})
    every = case.problem().sample_every
    steps = -(-steps // every) * every  # the same number in both runs, as the time step depends on dx only
    runs = [started(case.replace(changes), steps, every, warm) for changes in ({}, BEFORE)]
    times: list[list[float]] = [[], []]
    for _ in range(turns):
        for kept, run in zip(times, runs, strict=True):
            kept.append(timed(run))
    ratio = statistics.median(a / b for a, b in zip(*times, strict=True))
    with Report(
        f"bench_kernel_{dx:g}", "A step of the OWC with the present and the earlier kernel and walls", dx
    ) as report:
        report.seconds = sum(map(sum, times))
        for label, kept in zip(("present", "earlier"), times, strict=True):
            report.row(f"time per step, {label}", 1e3 * statistics.median(kept) / steps, "ms")
        report.row(
            "time per step over that with the earlier kernel and walls, median of the measurements",
            ratio,
            bar="at most 0.7",
            passes=ratio <= 0.7,
        )


def started(case: js.Case, steps: int, every: int, warm: int):
    """Function that runs the next `steps` steps of a case; the first `warm` steps are already done."""
    model, state = js.build(case)
    advance = jax.jit(js.simulate, static_argnames=("n_steps", "sample_every"))
    for _ in range(-(-warm // steps)):
        state, _ = advance(model, state, n_steps=steps, sample_every=every)

    def run():
        nonlocal state
        state, _ = advance(model, state, n_steps=steps, sample_every=every)
        jax.block_until_ready(state)
        if failure := Failure(int(state.status.bits)):
            raise SystemExit(f"the run failed: {failure.name}")

    run()
    return run
