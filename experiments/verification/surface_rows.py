"""Growth of disturbances in the rows of particles below the surface of incompressible water at rest.

A row under a free surface lacks neighbours on one side. Pressure pushes the second row away from its
position, and only the relaxation of crowding keeps it in place. If the row is not kept in place, single
particles of this row rise to the surface of still water after a few seconds.
"""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import jaxsph as js
from experiments.common import Report
from jaxsph.core.lattice import surface_stiffness
from jaxsph.schemes.kernels import NAMED, usual_length

DEPTH, LENGTH = 0.4, 0.8
"""Depth and length of the tank, m."""
DISTURBED = 0.01
"""Largest initial displacement of a particle along each axis, in spacings."""
CHANGES: dict[str, dict[str, Any]] = {
    "default settings": {},
    "half the time step": {"scheme.cfl": 0.2},
    "twice the relaxation": {"scheme.relaxation": 3.0},
    "the Gaussian": {"scheme.kernel": "gaussian"},
}
"""Changes of the scheme by label; with the shorter time step there are twice as many steps per sample."""


def main(dx: float = 0.02, t1: float = 4.0) -> None:
    """Reports the stiffness of rows by kernel, and the growth of disturbances in a tank with spacing dx (m)
    from 1 s to t1 (s)."""
    with Report(f"surface_rows_{dx:g}", "Rows under the surface of still water", dx) as report:
        for name in ("polynomial", "semicircle"):
            kernel = NAMED[2][name]
            for row, stiffness in enumerate(surface_stiffness(kernel, usual_length(kernel, 2), 2, 3), 1):
                report.row(f"{name}, row {row}: stiffness in units of g/dx", stiffness, theory=0.0)
        for label, changes in CHANGES.items():
            dt, rate = growth(dx, t1, changes)
            report.row(f"{label}: time step", 1e3 * dt, "ms")
            bar, passes = ("< 0.1 1/s", rate < 0.1) if not changes else ("", None)
            report.row(
                f"{label}: growth rate of disturbances of the second row",
                rate,
                "1/s",
                theory=0.0,
                bar=bar,
                passes=passes,
            )


def growth(dx: float, t1: float, changes: dict[str, Any]) -> tuple[float, float]:
    """Time step (s), and growth rate (1/s), between 1 s and t1 (s), of the second row's deviations."""
    still = {
        "name": "surface_rows",
        "dx": dx,
        "t1": t1,
        "scheme": {"kind": "incompressible"},
        "tank": {"length": LENGTH, "depth": DEPTH},
    }
    model, state = js.build(js.Case.from_dict(still).replace(changes))
    z = heights(state)
    second = (z < DEPTH - dx) & (z > DEPTH - 2.0 * dx)
    shift = np.random.default_rng(1).uniform(-1.0, 1.0, state.particles.x.shape)
    state = eqx.tree_at(
        lambda s: s.particles.x, state, state.particles.x + jnp.float32(DISTURBED * dx * shift)
    )
    steps = round(0.5 / float(model.dt) / model.search.rebuild_every) * model.search.rebuild_every
    go_on = jax.jit(lambda state: js.simulate(model, state, n_steps=steps, sample_every=steps)[0])
    times, spread = [], []
    while float(state.step) * float(model.dt) < t1 - 0.1:
        state = go_on(state)
        times.append(float(state.step) * float(model.dt))
        spread.append(np.std(heights(state)[second]))
    settled = np.array(times) > 0.9
    return float(model.dt), float(np.polyfit(np.array(times)[settled], np.log(spread)[settled], 1)[0])


def heights(state: js.State) -> np.ndarray:
    """Heights of the particles in order of their ids, m."""
    return np.asarray(state.particles.x)[np.argsort(np.asarray(state.particles.id)), -1]
