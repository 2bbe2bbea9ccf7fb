"""What several devices gain: a step of one run shared by them, searches included, against one device.

Every number is from a process of its own: cores become devices before JAX is first used.
"""

from __future__ import annotations

import multiprocessing
import os
import time
from concurrent.futures import ProcessPoolExecutor

import jax
import numpy as np

import jaxsph as js
from experiments.common import Report
from jaxsph.run.devices import share
from jaxsph.run.simulate import simulate_chunk


def main(
    dx: float = 0.01, devices: int = 2, case: str = "owc", weakly_compressible: bool = False, turns: int = 5
) -> None:
    """Times blocks of steps and searches on one core, on one device with every core, and on devices."""
    changes = {"dx": dx} | ({"scheme.kind": "weakly_compressible"} if weakly_compressible else {})
    kind = "weakly compressible" if weakly_compressible else "incompressible"
    suffix = "_weakly" if weakly_compressible else ""
    name = f"bench_devices_{case}_{dx:g}_{devices}{suffix}"
    with Report(name, f"{case}, {kind}, on {devices} devices", dx) as report:
        alone = _apart(case, changes, 1, turns, True)
        whole = _apart(case, changes, 1, turns, False)
        shared = _apart(case, changes, devices, turns, False)
        report.row("particles", alone[1])
        report.row("a step on one core", 1e3 * alone[0], "ms")
        report.row("a step on one device, with every core", 1e3 * whole[0], "ms")
        report.row(f"a step on {devices} devices", 1e3 * shared[0], "ms")
        bar = 1.6 if not weakly_compressible else 1.7
        gain = alone[0] / shared[0]
        report.row("one core over devices", gain, bar=f"{bar:g}", passes=gain >= bar)
        report.row("one device with every core over devices", whole[0] / shared[0])


def _apart(case: str, changes: dict, devices: int, turns: int, one_core: bool) -> tuple[float, float]:
    """Seconds of a step, and the number of particles, from a process of its own."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        return pool.submit(_seconds, case, changes, devices, turns, one_core).result()


def _seconds(case: str, changes: dict, devices: int, turns: int, one_core: bool) -> tuple[float, float]:
    if one_core and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    jax.config.update("jax_num_cpu_devices", devices)
    model, state = js.build(js.load_case(case).replace(changes))
    count = float(len(state.particles.id))
    model, state = share(model, state, devices)
    steps = 2 * model.search.rebuild_every

    def advance(model, state):
        return simulate_chunk(model, state, (), steps, steps)[0]

    state = jax.block_until_ready(advance(model, state))
    taken = []
    for _ in range(turns):
        began = time.perf_counter()
        jax.block_until_ready(advance(model, state))
        taken.append(time.perf_counter() - began)
    return float(np.min(taken)) / steps, count
