"""Speed-up of a step, searches included, by several cores and by several devices.

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
from jaxsph.core.native.forms import switched
from jaxsph.run.devices import share
from jaxsph.run.simulate import UNSPLIT

BAR = 1.8
"""Least speed-up by two cores (-)."""


def main(
    dx: float = 0.01,
    devices: int = 2,
    case: str = "owc",
    weakly_compressible: bool = False,
    jax_loops: bool = False,
    turns: int = 5,
) -> None:
    """Times steps with their searches on one core, on one device with all cores, and on several devices.

    The cores share the native loops of one device; with `jax_loops` they share only few operations of one
    device, and the speed-up that counts is that of several devices.
    """
    changes = {"dx": dx} | ({"scheme.kind": "weakly_compressible"} if weakly_compressible else {})
    kind = "weakly compressible" if weakly_compressible else "incompressible"
    loops = "JAX's loops" if jax_loops else "native loops"
    suffix = "_weakly" * weakly_compressible + "_jax" * jax_loops
    measure = cost_by_jax if jax_loops else cost
    with Report(
        f"bench_devices_{case}_{dx:g}_{devices}{suffix}", f"Several cores: {case}, {kind}, {loops}", dx
    ) as report:
        alone, whole, shared = (
            apart(measure, changes, count, turns, one_core, case)["seconds"]
            for count, one_core in ((1, True), (1, False), (devices, False))
        )
        report.row("time per step on one core", 1e3 * alone, "ms")
        report.row("time per step on one device with all cores", 1e3 * whole, "ms")
        report.row(f"time per step on {devices} devices", 1e3 * shared, "ms")
        for title, seconds, counts in (
            ("one device with all cores", whole, not jax_loops),
            (f"{devices} devices", shared, jax_loops),
        ):
            gain = alone / seconds
            bar = {"bar": f"{BAR:g}", "passes": gain >= BAR} if counts else {}
            report.row(f"speed-up over one core, {title}", gain, **bar)


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


def cost_by_jax(case: js.Case, devices: int, turns: int) -> dict[str, float]:
    """Result of `cost` with JAX's loops."""
    with switched(False):
        return cost(case, devices, turns)


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
