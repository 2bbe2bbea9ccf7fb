"""Time per pair of the pair sums of one right-hand side, for given inputs.

    python -m experiments run bench_pairs INPUTS.npz [--beside "COMMAND"]

INPUTS holds float32 arrays x, y, u, v, rho, volume [N], scalars h, radius, dx, c0, rho0, delta, alpha, and
float64 arrays ref_<name> to compare with. COMMAND is a program that computes the same sums and prints one
JSON object with `ns_per_pair_min`; the two programs run alternately.
"""

from __future__ import annotations

import json
import shlex
import statistics
import subprocess
import types
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from experiments.common import Report, timed, use_threads
from jaxsph.case.assemble import SKIN
from jaxsph.core.arrays import columns
from jaxsph.core.kernels import Gaussian
from jaxsph.core.pairs import Smoothing
from jaxsph.core.search.base import needed_capacity
from jaxsph.core.search.cells import cell_order, grid_over, search
from jaxsph.core.slabs import ONE, Chosen, Neighbours, PointNeighbours, Sources
from jaxsph.model.state import Particles, Tables
from jaxsph.model.viscosity import ArtificialViscosity
from jaxsph.schemes.integrators import SymplecticEuler
from jaxsph.schemes.weakly_compressible import DeltaSPH


def main(inputs: Path, beside: str = "", threads: int = 1, turns: int = 5, repeats: int = 9) -> None:
    """Prints the time per pair (ns), and its ratio to the time of COMMAND."""
    use_threads(threads)
    given = dict(np.load(inputs))
    evaluate, reference = right_hand_side(given)
    error = max(
        float(np.max(abs(value - given[f"ref_{name}"]))) / float(np.max(abs(given[f"ref_{name}"])))
        for name, value in reference.items()
    )
    own, native = [], []
    for _ in range(turns):
        own += [timed(evaluate) / int(given["pairs"]) for _ in range(repeats)]
        if beside:
            done = subprocess.run(shlex.split(beside), capture_output=True, text=True, check=True)
            native.append(json.loads(done.stdout)["ns_per_pair_min"])
    title = f"Pair work of one right-hand side, {len(given['x'])} particles, float32, {threads} thread(s)"
    with Report("bench_pairs", title) as report:
        bar = "< 1e-3"
        report.row("largest error against float64", error, theory=0.0, bar=bar, passes=error < 1e-3)
        report.row("time per pair, shortest", 1e9 * min(own), "ns/pair")
        report.row("time per pair, median", 1e9 * statistics.median(own), "ns/pair")
        if native:
            ratio = 1e9 * min(own) / min(native)
            report.row("time per pair of COMMAND, shortest", min(native), "ns/pair")
            report.row("ratio of the shortest times", ratio, bar="at most 1.3", passes=ratio <= 1.3)


def right_hand_side(given: dict[str, np.ndarray]):
    """Function that evaluates the two pair sums of the solver, and their results in the inputs' order."""
    h, dx, c0, rho0 = (float(given[name]) for name in ("h", "dx", "c0", "rho0"))
    smoothing = Smoothing(Gaussian(float(given["radius"]) / float(h)), jnp.float32(h))
    scheme = DeltaSPH(
        smoothing=smoothing,
        c0=jnp.float32(c0),
        rho0=jnp.float32(rho0),
        delta=jnp.float32(given["delta"]),
        viscosity=ArtificialViscosity(jnp.float32(given["alpha"])),
        integrator=SymplecticEuler(),
    )
    x = np.stack([given["x"], given["y"]], axis=1)
    grid = grid_over(x.min(axis=0), x.max(axis=0), float(given["radius"]) + SKIN * dx)
    order = np.asarray(cell_order(jnp.asarray(x), grid))
    field = {k: jnp.asarray(given[k][order]) for k in ("x", "y", "u", "v", "rho", "volume")}
    x, u = jnp.asarray(x[order]), jnp.stack([field["u"], field["v"]], axis=1)
    rho = field["rho"] - jnp.float32(rho0)
    n = len(x)
    p = jnp.float32(c0) ** 2 * rho
    mass = field["volume"] * field["rho"]
    particles = Particles(x, jnp.zeros_like(x), u, rho, m=mass, p=p, p_mean=p, id=jnp.arange(n))
    every = jnp.ones(n, jnp.int32)
    most = int(search(x, x, grid, 1, every, every, True).most)
    table = search(x, x, grid, needed_capacity(most, 1.0), every, every, True)
    water = {
        "x": columns(x),
        "rho": rho,
        "p": p,
        "V": field["volume"],
        "u": columns(u),
    }
    sources = Sources(water, jax.tree.map(lambda a: a[:0], water))  # no walls
    none = PointNeighbours.of(jnp.zeros((0, 0), jnp.int32))
    tables = Tables(Neighbours.of(table.indices), Chosen.of(jnp.zeros(0, jnp.int32), n, ONE), none, {}, {}, x)
    model = types.SimpleNamespace(g=jnp.zeros(2, jnp.float32))

    @jax.jit
    def evaluate(particles, sources, tables):
        rates = scheme.momentum(model, particles, sources, tables)
        rate = scheme.continuity(particles, sources, rates.grad_rho, tables)
        return rates, rate

    rates, rate = jax.block_until_ready(evaluate(particles, sources, tables))
    back = np.argsort(order)
    result = {
        "position_divergence": rates.position_divergence,
        "grad_rho_x": rates.grad_rho[0],
        "grad_rho_y": rates.grad_rho[1],
        "drho_dt": rate,
        "du_dt": rates.acceleration[0],
        "dv_dt": rates.acceleration[1],
    }
    result = {name: np.asarray(a, np.float64)[back] for name, a in result.items()}
    return lambda: evaluate(particles, sources, tables), result
