"""Short waves radiated by a low standing wave where its surface meets the walls, by kind of wall.

The wave has an amplitude of a quarter of a spacing and stands between two walls. Any effect of the walls on
the surface appears as modes that the wave does not have. A periodic tank shows which of these modes appear
without walls.
"""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import Report
from jaxsph import analysis
from jaxsph.case.geometry import Geometry
from jaxsph.case.initial import initial_velocity
from jaxsph.core.arrays import Array, Bool
from jaxsph.core.pairs import Smoothing
from jaxsph.model.meaning import Reading
from jaxsph.model.probe import AbstractProbe

TIMES = (0.95, 3.05)
"""Times at which the modes are compared, s."""
SAMPLE, WAVE, SHORT, BAR = 0.05, 2, (4, 6, 8, 10, 12), 0.01
"""Sampling interval (s), mode of the wave, modes that it lacks, and the largest allowed excess of these
modes, relative to the wave, over those in the periodic tank (-)."""


class SurfaceModes(AbstractProbe):
    """Probe of the vertical velocity of the top layer in cosine modes of the tank, m/s."""

    top: Bool[Array, " N"]
    """Whether each particle, by its id, is in the top layer at the start."""
    length: float = eqx.field(static=True)
    """Length of the tank, m."""

    def measure(self, model, state, tables):
        """See `AbstractProbe.measure`."""
        p = state.particles
        w = jnp.where(self.top[p.id], p.u[:, -1], 0.0) * 2.0 / jnp.sum(self.top)
        mode = jnp.arange(1, SHORT[-1] + 1)[:, None]
        return {"modes": jnp.cos(mode * jnp.pi * p.x[:, 0] / self.length) @ w}

    def describe(self):
        """See `AbstractProbe.describe`."""
        return {"modes": Reading("m s-1", "vertical speed of the top layer by cosine mode of the tank")}


def main(dx: float = 0.04, amplitude: float = 0.01, weakly_compressible: bool = False) -> None:
    """Runs a standing wave of this amplitude (m), second mode, with each kind of wall and without walls."""
    kind = "weakly_compressible" if weakly_compressible else "incompressible"
    name = f"contact_line_{dx:g}_{amplitude:g}" + "_weakly_compressible" * weakly_compressible
    title = f"Short waves from the contact line of a standing wave, amplitude {amplitude:g} m, {kind}"
    changes = {"dx": dx, "scheme.kind": kind, "start.amplitude": amplitude, "start.mode": WAVE}
    case = js.load_case("hydrostatic").replace(
        changes | {"output.sample_dt": SAMPLE, "probes.pressure": None}
    )
    k, d = WAVE * np.pi / case.tank.length, case.tank.depth
    period = 2 * np.pi / np.sqrt(case.g * k * np.tanh(k * d))
    with Report(name, title.replace("_", " "), dx) as report:
        figure = Figure(figsize=(9, 3.6), layout="constrained")
        axes = figure.subplots(1, len(TIMES), sharey=True)
        without: dict[float, np.ndarray] = {}
        for walls in ("periodic", "images", "mirror", "dummy"):
            run = solved(case, walls)
            t, modes = run.t, np.asarray(run["modes"], float)
            found = analysis.fit_damped_oscillation(t, modes[:, WAVE - 1])
            for time, axis in zip(TIMES, axes, strict=True):
                at = int(np.argmin(abs(t - time)))
                wave = found.amplitude * np.exp(-found.decay_rate * (t[at] - t[0]))
                short = abs(modes[at, np.array(SHORT) - 1]) / wave
                without.setdefault(time, short)
                beyond = float(np.max(short - without[time]))
                shown = "images" in walls
                report.row(
                    f"{walls}: largest of modes 4 to 12 over mode 2 at {time:g} s",
                    100 * short.max(),
                    "%",
                    theory=0.0,
                )
                ratio = f"{walls}: modes 4 to 12 over mode 2 at {time:g} s"
                report.row(
                    f"{ratio}, largest excess over the periodic tank",
                    100 * beyond,
                    "%",
                    theory=0.0,
                    bar=f"{100 * BAR:g} %" if shown else "",
                    passes=beyond < BAR if shown else None,
                )
                axis.plot(SHORT, 100 * short, "o-", label=walls)
                axis.set(xlabel="mode", title=f"t = {time:g} s")
            off = 2 * np.pi / np.hypot(found.omega, found.decay_rate) / period - 1
            report.row(f"{walls}: error of the period against linear theory", 100 * off, "%", theory=0.0)
            report.row(f"{walls}: decay rate", found.decay_rate, "1/s", theory=0.0)
        axes[0].set(ylabel="vertical speed over the wave's, %", ylim=(0, None))
        axes[0].legend(fontsize="small")
        report.picture(figure)


def solved(case: js.Case, walls: str) -> js.Solution:
    """Runs the case with one kind of wall (`tank.walls`), or in a periodic tank of the same length."""
    model, state = js.build(case if walls == "periodic" else case.replace({"tank.walls": walls}))
    if walls == "periodic":
        geometry, x = Geometry.of(case), np.asarray(state.particles.x, float)
        box = js.Box(model.walls.low, model.walls.high, sides=("periodic", "floor"))
        old = model.scheme.smoothing
        smoothing = Smoothing(old.kernel, old.h, box.period)
        scheme = eqx.tree_at(lambda s: s.smoothing, model.scheme, smoothing)
        ghosts = js.Ghosts.build(box, case.dx, smoothing, js.FreeSlip())
        u = initial_velocity(case, geometry, x)
        given = {"dx": case.dx, "sample_dt": SAMPLE, "dt_most": 1.001 * float(model.dt), "g": (0.0, -case.g)}
        p = np.asarray(model.scheme.pressure(state.particles))
        model, state = js.assemble(x, u, scheme=scheme, walls=ghosts, p=p, **given)
    z, by_id = state.particles.x[:, -1], state.particles.id
    top = jnp.zeros(len(z), bool).at[by_id].set(z > case.tank.depth - 0.75 * case.dx)
    modes = SurfaceModes(top, case.tank.length)
    return js.march(model, state, TIMES[-1] + SAMPLE, SAMPLE, (modes,))
