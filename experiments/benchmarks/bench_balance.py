"""Load balance of several devices after ten seconds of waves: particles, pairs and ghosts of each device."""

from __future__ import annotations

import jax
import numpy as np

import jaxsph as js
from experiments.benchmarks.bench_devices import apart
from experiments.common import Report
from jaxsph.run.devices import share


def main(dx: float = 0.02, slabs: int = 8, t1: float = 10.0) -> None:
    """Runs the built-in OWC to t1 (s) on `slabs` devices, which may be more than the number of cores."""
    with Report(
        f"bench_balance_{dx:g}_{slabs}", f"Load of {slabs} devices after {t1:g} s of waves", dx
    ) as report:
        found = apart(balance, {"dx": dx, "t1": t1}, slabs, 0, False)
        for name, counts in found.items():
            counts = np.array(counts)
            excess = 100 * (counts.max() / counts.mean() - 1.0)
            decides = name != "ghosts"
            report.row(f"{name} per slab, mean", counts.mean())
            report.row(
                f"{name}: excess of the fullest slab over the mean",
                excess,
                "%",
                bar="under 5 %" if decides else "",
                passes=excess < 5.0 if decides else None,
            )


def balance(case: js.Case, devices: int, turns: int) -> dict[str, list[int]]:
    """Numbers of particles, pairs and nearby ghosts of each slab at the end of a run on `devices` devices."""
    del turns
    done = js.run(case, devices=devices, progress=False)
    model, state = share(done.model, done.state, devices)
    _, tables = jax.jit(lambda m, s: m.scheme.prepare(m, s))(model, state)
    slabs, water = model.search.slabs, len(state.particles.id)
    each = water // devices
    sources = each + 2 * slabs.in_halo(each) + model.walls.count
    pairs = np.sum(np.asarray(tables.fluid.indices) != sources, axis=0).reshape(devices, each)
    ghosts = np.asarray(tables.nodes.rows).reshape(devices, -1) != model.walls.count
    mass = np.asarray(state.particles.m).reshape(devices, each) > 0.0
    return {
        "particles": mass.sum(axis=1).tolist(),
        "pairs": pairs.sum(axis=1).tolist(),
        "ghosts": ghosts.sum(axis=1).tolist(),
    }
