"""The decaying Taylor-Green vortex at Re = 100 in a periodic unit square: decay and order of convergence.

Exact solution: u = -U e^(bt) cos 2 pi x sin 2 pi y, v = U e^(bt) sin 2 pi x cos 2 pi y, b = -8 pi^2/Re,
U = 1 m/s, p = -rho U^2 e^(2bt) (cos 4 pi x + cos 4 pi y)/4 and mean of u^2/2 = U^2 e^(2bt)/4.
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import Report, lattice, observed_order
from jaxsph.model.shifting import Shifting
from jaxsph.model.viscosity import LaplacianViscosity, PhysicalViscosity
from jaxsph.schemes.weakly_compressible import DeltaSPH

U, RE, RHO = 1.0, 100.0, 1000.0
DECAY = -8.0 * np.pi**2 / RE
"""Growth rate of the velocity, 1/s (negative); the rate of the energy is twice as large."""
SAMPLE = 0.05


def exact(x: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
    """Exact velocity `[N, 2]` (m/s) and pressure `[N]` (Pa) at x (m) and t (s)."""
    k = 2.0 * np.pi * x
    u = np.stack([-np.cos(k[:, 0]) * np.sin(k[:, 1]), np.sin(k[:, 0]) * np.cos(k[:, 1])], axis=1)
    p = -0.25 * RHO * (np.cos(2 * k[:, 0]) + np.cos(2 * k[:, 1]))
    return U * np.exp(DECAY * t) * u, U**2 * np.exp(2 * DECAY * t) * p


def built(n: int, c0: float = 10.0, viscosity=LaplacianViscosity, strength: float | None = 12.0):
    """Model and state of n by n particles; `strength` (-) of the shifting, None for no shifting."""
    box = js.Box((0.0, 0.0), (1.0, 1.0), sides=("periodic", "periodic"))
    scheme = DeltaSPH.of(
        1.0 / n,
        c0,
        rho0=RHO,
        viscosity=viscosity(U / RE),
        period=box.period,
        shifting=None if strength is None else Shifting(strength),
    )
    walls = js.Ghosts.build(box, 1.0 / n, scheme.smoothing, js.FreeSlip())
    x = lattice(box.low, box.high, 1.0 / n)
    u, p = exact(x, 0.0)
    given = dict(scheme=scheme, walls=walls, dx=1.0 / n, sample_dt=SAMPLE, p=p)
    # shifting adds to the distance that particles move between two neighbour searches
    return js.assemble(x, u, **given, speed=1.3 * U, skin=0.6)


def solved(n: int, t1: float, **options) -> js.Solution:
    """Runs `built(n, **options)` to t1 (s), with energies."""
    model, state = built(n, **options)
    return js.march(model, state, t1, SAMPLE, (js.EnergyProbe.over(model, state, jnp.float32(SAMPLE)),))


def decay_rate(solution: js.Solution) -> float:
    """Ratio of the growth rate of the kinetic energy to twice `DECAY`; the exact value is 1."""
    return float(np.polyfit(solution.t, np.log(solution["kinetic"]), 1)[0] / (2.0 * DECAY))


def velocity_error(solution: js.Solution) -> float:
    """L2 error of the final velocities of the particles, divided by the L2 norm of the exact velocities."""
    p = solution.state.particles
    u, _ = exact(np.asarray(p.x, float), int(solution.state.step) * float(solution.model.dt))
    return float(np.linalg.norm(np.asarray(p.u) - u) / np.linalg.norm(u))


def main(n: int = 50, t1: float = 1.0, finest: int = 100) -> None:
    """Runs n by n particles to t1 (s), with variants of shifting and viscosity, and two other resolutions."""
    title = f"Taylor-Green vortex at Re = 100, {n} x {n}, to {t1:g} s"
    with Report("taylor_green", title, 1.0 / n) as report:
        good = solved(n, t1)
        rate = decay_rate(good)
        bar = "within 3 %"
        report.row(
            "decay rate of the energy",
            rate * 2 * DECAY,
            "1/s",
            theory=2 * DECAY,
            bar=bar,
            passes=abs(rate - 1) < 0.03,
        )
        report.row("error of the decay rate of the energy", 100 * (rate - 1), "%", theory=0.0)
        curves = {"shifting": good}
        for label, options in (
            ("without shifting", {"strength": None}),
            ("with Monaghan's viscous sum", {"viscosity": PhysicalViscosity}),
        ):
            curves[label] = solved(n, t1, **options)
            report.row(
                f"{label}: error of the decay rate of the energy",
                100 * (decay_rate(curves[label]) - 1),
                "%",
                theory=0.0,
            )
            report.row(
                f"{label}: L2 error of the velocity", 100 * velocity_error(curves[label]), "%", theory=0.0
            )
        resolutions = (n // 2, n, finest)
        errors = [velocity_error(good if m == n else solved(m, t1)) for m in resolutions]
        for m, error in zip(resolutions, errors, strict=True):
            report.row(f"L2 error of the velocity, {m} x {m}", 100 * error, "%", theory=0.0)
        order = observed_order([1.0 / m for m in resolutions], errors)
        report.row("order of convergence of the velocity", order, bar="at least 1", passes=order >= 1.0)
        report.picture(_picture(curves, good))


def _picture(curves: dict[str, js.Solution], good: js.Solution) -> Figure:
    """Figure of the decay of the energy, and of the final particles coloured by speed."""
    figure = Figure(figsize=(10, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    for label, solution in curves.items():
        left.semilogy(solution.t, solution["kinetic"] / RHO, label=label)
    left.semilogy(good.t, 0.25 * U**2 * np.exp(2 * DECAY * good.t), "k--", lw=1, label="exact")
    left.set(xlabel="t, s", ylabel="mean of u²/2, m²/s²")
    left.legend(fontsize="small")
    p = good.state.particles
    speed = np.linalg.norm(np.asarray(p.u), axis=1)
    dots = right.scatter(*np.asarray(p.x).T, c=speed, s=4, cmap="viridis")
    figure.colorbar(dots, ax=right, label="speed, m/s")
    right.set(aspect="equal", xlabel="x, m", ylabel="y, m", title="particles at the end")
    return figure
