"""Speed-up of a step, searches included, by sharing one run between several devices.

Every number is measured in a separate process, because the number of devices must be set before JAX is used.
"""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor

import jax
import numpy as np

import jaxsph as js
from experiments.common import Report
from jaxsph.run.devices import share
from jaxsph.run.simulate import UNSPLIT


def main(
    dx: float = 0.01, devices: int = 2, case: str = "owc", weakly_compressible: bool = False, turns: int = 5
) -> None:
    """Times steps with their searches on one core, on one device with all cores, and on several devices."""
    changes = {"dx": dx} | ({"scheme.kind": "weakly_compressible"} if weakly_compressible else {})
    kind = "weakly compressible" if weakly_compressible else "incompressible"
    suffix = "_weakly" if weakly_compressible else ""
    name = f"bench_devices_{case}_{dx:g}_{devices}{suffix}"
    with Report(name, f"Speed-up of {case}, {kind}, on {devices} devices", dx) as report:
        alone, whole, shared = (
            apart(cost, changes, count, turns, one_core, case)["seconds"]
            for count, one_core in ((1, True), (1, False), (devices, False))
        )
        report.row("time per step on one core", 1e3 * alone, "ms")
        report.row("time per step on one device with all cores", 1e3 * whole, "ms")
        report.row(f"time per step on {devices} devices", 1e3 * shared, "ms")
        bar = 1.6 if not weakly_compressible else 1.7
        gain = alone / shared
        report.row("speed-up over one core", gain, bar=f"{bar:g}", passes=gain >= bar)
        report.row("speed-up over one device with all cores", whole / shared)


def apart(
    measure: Callable,
    changes: dict,
    devices: int,
    turns: int,
    one_core: bool,
    name: str = "owc",
) -> dict:
    """Result of `measure(case, devices, turns)` for a built-in case with changes, in a separate process."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        return pool.submit(_measured, measure, changes, devices, turns, one_core, name).result()


def _measured(measure, changes, devices, turns, one_core, name):
    if one_core and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    jax.config.update("jax_num_cpu_devices", devices)
    return measure(js.load_case(name).replace(changes), devices, turns)


def cost(case: js.Case, devices: int, turns: int) -> dict[str, float]:
    """Time of a step (s), searches included, and memory of a chunk (bytes) on `devices` devices."""
    model, state = js.build(case)
    found = {"water": len(state.particles.id), "ghosts": model.walls.count}
    model, state = share(model, state, devices)
    steps = 2 * model.search.rebuild_every
    options = UNSPLIT if devices > 1 else None
    run = jax.jit(lambda m, s: js.simulate(m, s, n_steps=steps)[0], compiler_options=options)
    advance = run.lower(model, state).compile()
    size = advance.memory_analysis()
    found["memory"] = size.temp_size_in_bytes + size.argument_size_in_bytes + size.output_size_in_bytes
    state = jax.block_until_ready(advance(model, state))
    taken = []
    for _ in range(turns):
        began = time.perf_counter()
        jax.block_until_ready(advance(model, state))
        taken.append(time.perf_counter() - began)
    return found | {"seconds": float(np.min(taken)) / steps}
