"""Time of a step with native loops over neighbours and in searches, compared with JAX's loops."""

from __future__ import annotations

import time
from typing import Any

import jax
import jax.numpy as jnp

import jaxsph as js
from experiments.common import Report, use_threads
from jaxsph.core.native.forms import available, switched
from jaxsph.core.programs import without_cache
from jaxsph.run.devices import everywhere, find_devices, share
from jaxsph.run.simulate import new_program

CASES: list[tuple[str, dict[str, Any], float]] = [
    ("owc", {"dx": 0.01}, 2.0),
    ("owc", {"dx": 0.01, "scheme.kind": "weakly_compressible"}, 1.0),
    ("dam_break_column", {}, 0.2),
]
"""Cases with their changes, and the time (s) to which each runs before its steps are timed, so that the water
moves."""
BAR = 0.62
"""Largest ratio of the times with which a second form of the loops is worth its code (-)."""


def main(turns: int = 5, samples: int = 4) -> None:
    """Measures the time of a step with native and with JAX's loops, alternately, on one core.

    The steps include searches and probes.
    """
    use_threads(1)
    find_devices(1)
    with switched(True):
        if not available():
            raise SystemExit("native loops need a CPU and llvmlite: pip install 'jaxsph[native]'")
    with Report("bench_native", "Native loops over neighbours: time of a step, one core") as report:
        for name, changes, moving in CASES:
            case = js.load_case(name).replace(changes)
            _measure(report, case, moving, turns, samples)


def _measure(report: Report, case: js.Case, moving: float, turns: int, samples: int) -> None:
    """Rows of one case."""
    problem = case.problem()
    model, state = share(problem.model, problem.state, 1)
    probes, every = everywhere(model.search.slabs, problem.probes), problem.sample_every
    programs, seconds = {}, {}
    for native in (False, True):
        with switched(native), without_cache():
            arguments = model, state, probes, problem.per_chunk, every
            lowered = new_program(model).lower(*arguments, jnp.int32(every))
            began = time.perf_counter()
            programs[native] = lowered.compile()
            seconds[native] = time.perf_counter() - began

    def advance(native: bool, state: js.State, count: int) -> js.State:
        return jax.block_until_ready(programs[native](model, state, probes, jnp.int32(count * every))[0])

    for _ in range(round(moving / (every * float(model.dt))) // samples):
        state = advance(True, state, samples)
    if int(state.status.bits):
        raise SystemExit(f"a step failed: flags {int(state.status.bits)} of jaxsph.model.state.Failure")
    took: dict[bool, list[float]] = {False: [], True: []}
    for _ in range(turns):
        for native, times in took.items():
            began = time.perf_counter()
            advance(native, state, samples)
            times.append((time.perf_counter() - began) / (samples * every))
    least = {native: min(times) for native, times in took.items()}
    ratio = least[True] / least[False]
    scheme = case.scheme.kind.replace("_", " ")
    title = f"{case.name}, {scheme}, {len(state.particles.id)} particles"
    report.row(f"{title}: time per step, JAX", 1e3 * least[False], "ms")
    report.row(f"{title}: time per step, native", 1e3 * least[True], "ms")
    report.row(f"{title}: ratio of the times", ratio, bar=f"at most {BAR}", passes=ratio <= BAR)
    report.row(f"{title}: ratio of the compilation times", seconds[True] / seconds[False])
