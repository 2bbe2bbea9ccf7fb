"""Start-up of plane Poiseuille and Couette flow between no-slip walls, against the exact series.

Poiseuille, from rest under a body force F = 8 nu U/L^2, with y and t in units of L and L^2/nu:
    u/U = 4 y (1 - y) - sum over odd n of 32/(n pi)^3 sin(n pi y) exp(-(n pi)^2 t)
Couette, with the upper wall suddenly moving at U:
    u/U = y + sum over n of 2 (-1)^n/(n pi) sin(n pi y) exp(-(n pi)^2 t)

Re = U L/nu = 1 (nu = 0.01 m2/s, L = 0.5 m, U = 0.02 m/s). The flow is fast enough that rows of particles pass
each other by many spacings while it develops, and slow enough that viscosity limits the time step, so that a
high speed of sound costs no computing time.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import Report, lattice, observed_order
from jaxsph.model.shifting import Shifting
from jaxsph.model.viscosity import LaplacianViscosity
from jaxsph.schemes.weakly_compressible import DeltaSPH

L, NU, U = 0.5, 0.01, 0.02
SCALE = L**2 / NU
"""Viscous time scale of the channel L^2/nu, s."""
TIMES = (0.02, 0.1, 1.0)
"""Times at which profiles are compared, in units of `SCALE`."""
TERMS = 200
"""Number of terms of the series: at t = 0.02 the factor exp(-(200 pi)^2 0.02) of the last is negligible."""


class Flow(NamedTuple):
    """Body force and wall speed that drive a flow, and its exact velocity profile."""

    force: float
    """Body force per mass, m/s2."""
    lid: float
    """Speed of the upper wall, m/s."""

    def profile(self, y: np.ndarray, t: float) -> np.ndarray:
        """Exact velocity u (m/s) at y (m) and t (s)."""
        y, t = np.asarray(y)[..., None] / L, t / SCALE
        n = np.arange(1, TERMS + 1)
        q = n * np.pi
        waves = np.sin(q * y) * np.exp(-(q**2) * t)
        couette = y[..., 0] + np.sum(2.0 * (-1.0) ** n / q * waves, axis=-1)
        poiseuille = 4.0 * (y * (1.0 - y))[..., 0] - np.sum(32.0 / q**3 * (n % 2) * waves, axis=-1)
        return self.force * L**2 / (8.0 * NU) * poiseuille + self.lid * couette


FLOWS = {"Poiseuille": Flow(8.0 * NU * U / L**2, 0.0), "Couette": Flow(0.0, U)}


def built(flow: Flow, n: int, viscosity=LaplacianViscosity, strength: float | None = 12.0):
    """Model and state with n spacings between the walls and 16 along them."""
    dx = L / n
    box = js.Box((0.0, 0.0), (16 * dx, L), sides=("periodic", "walls"))
    # with the viscous time step h^2/(8 nu), this speed of sound gives a Courant number of 1/4
    c0 = max(10.0 * U, 2.0 * NU / (1.2 * dx))
    shifting = None if strength is None else Shifting(strength)
    scheme = DeltaSPH.of(dx, c0, viscosity=viscosity(NU), period=box.period, shifting=shifting)
    walls = js.Ghosts.build(box, dx, scheme.smoothing, js.NoSlip(), sliding={(1, 1): (flow.lid, 0.0)})
    x = lattice(box.low, box.high, dx)
    given = dict(scheme=scheme, walls=walls, dx=dx, sample_dt=0.02 * SCALE, g=(flow.force, 0.0))
    return js.assemble(x, np.zeros_like(x), **given, speed=1.3 * U)


def solved(flow: Flow, n: int, times: tuple[float, ...] = TIMES, **options) -> list[tuple]:
    """Time t (s), positions y (m) and velocities u (m/s) of particles at each of `times` (in `SCALE`)."""
    model, state = built(flow, n, **options)
    found = []
    for time in times:
        solution = js.march(model, state, time * SCALE, 0.02 * SCALE)
        model, state = solution.model, solution.state
        p = state.particles
        found.append((time * SCALE, np.asarray(p.x, float)[:, 1], np.asarray(p.u, float)))
    return found


def errors(flow: Flow, profiles: list[tuple]) -> list[tuple[float, float]]:
    """L2 error and largest error of the velocity at each time, divided by U."""
    found = []
    for t, y, u in profiles:
        off = np.hypot(u[:, 0] - flow.profile(y, t), u[:, 1]) / U
        found.append((float(np.sqrt(np.mean(off**2))), float(np.max(off))))
    return found


def main(n: int = 40) -> None:
    """Runs both flows with n, n/2 and n/4 spacings between the walls, for the errors and their order."""
    with Report("channel", f"Start-up of plane flows at Re = 1, {n} spacings across", L / n) as report:
        shown = {}
        for name, flow in FLOWS.items():
            runs = {m: solved(flow, m) for m in (n // 4, n // 2, n)}
            found = {m: errors(flow, run) for m, run in runs.items()}
            for time, (rms, most) in zip(TIMES, found[n], strict=True):
                where = f"{name}, t = {time:g} L²/nu"
                # the limit of 2 % of U is chosen here; the series themselves are exact
                report.row(
                    f"{where}: L2 error / U", 100 * rms, "%", theory=0.0, bar="< 2 %", passes=rms < 0.02
                )
                report.row(f"{where}: largest error / U", 100 * most, "%", theory=0.0)
            for k, time in ((1, TIMES[1]), (2, TIMES[2])):
                order = observed_order([L / m for m in runs], [found[m][k][0] for m in runs])
                bar = "at least 1" if k == 1 else ""
                passes = order >= 1.0 if k == 1 else None
                report.row(
                    f"{name}: order of convergence of the L2 error at t = {time:g} L²/nu",
                    order,
                    bar=bar,
                    passes=passes,
                )
            shown[name] = (flow, runs[n])
        report.picture(_picture(shown))


def _picture(shown: dict) -> Figure:
    """Figure of the velocity profiles of the particles and of the exact series."""
    figure = Figure(figsize=(9, 4), layout="constrained")
    for axis, (name, (flow, profiles)) in zip(figure.subplots(1, 2), shown.items(), strict=True):
        y = np.linspace(0.0, L, 200)
        for (t, at, u), time in zip(profiles, TIMES, strict=True):
            (line,) = axis.plot(u[:, 0] / U, at / L, ".", ms=2, label=f"t = {time:g} L²/nu")
            axis.plot(flow.profile(y, t) / U, y / L, "-", lw=0.8, color=line.get_color())
        axis.set(xlabel="u/U", ylabel="y/L", title=name)
        axis.legend(fontsize="small")
    return figure
