"""A square patch of inviscid fluid in rigid rotation, with a free surface all around.

The pressure is negative everywhere, so that the pair forces, proportional to p_i + p_j, attract particles and
make them clump. The patch stretches into arms (Colagrossi 2005). Initially, with m and n odd and
0 < x, y < L,
    p = -rho omega^2 L^2 sum 32 sin(m pi x/L) sin(n pi y/L)/(m n pi^2 ((m pi)^2 + (n pi)^2)).
There is no closed-form solution at later times. Mass, momentum and angular momentum are conserved, and energy
is conserved except for the dissipation of the scheme.
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import Report, lattice
from jaxsph.model import laws
from jaxsph.model.meaning import Reading
from jaxsph.model.probe import AbstractProbe
from jaxsph.model.shifting import Shifting
from jaxsph.model.viscosity import ArtificialViscosity
from jaxsph.schemes.weakly_compressible import DeltaSPH

L, OMEGA, RHO = 1.0, 1.0, 1000.0
SAMPLE = 0.1
HALF = 3.0
"""Half the side of the box that contains the patch, m."""
CENTRE = -0.147343
"""Exact p/(rho omega^2 L^2) at the centre, the limit of the series (torsion of a square bar)."""


def initial_pressure(x: np.ndarray, terms: int = 60) -> np.ndarray:
    """Pressure p (Pa) at x (m, from the centre); the sum of 60 x 60 terms is accurate to 1e-5 of the
    central p."""
    odd = np.pi * (2 * np.arange(terms) + 1)
    sines = [np.sin(odd * (x[:, k : k + 1] / L + 0.5)) for k in (0, 1)]
    weight = 32.0 / (odd[:, None] * odd * (odd[:, None] ** 2 + odd**2))
    return -RHO * OMEGA**2 * L**2 * np.einsum("im,mn,in->i", sines[0], weight, sines[1])


class PatchProbe(AbstractProbe):
    """Probe of the angular momentum about the origin and of the pressure at the centre."""

    def measure(self, model, state, tables):
        """See `AbstractProbe.measure`."""
        p = state.particles
        spin = p.x[:, 0] * p.u[:, 1] - p.x[:, 1] * p.u[:, 0]
        near = p.m * jnp.exp(-jnp.sum(p.x**2, axis=1) / (3.0 * model.dx) ** 2)
        centre = jnp.sum(near * laws.pressure(p.rho, model.scheme.c0)) / jnp.sum(near)
        return {"angular_momentum": jnp.sum(p.m * spin), "p_centre": centre}

    def describe(self):
        """See `AbstractProbe.describe`."""
        return {
            "angular_momentum": Reading("kg m s-1", "angular momentum about the origin"),
            "p_centre": Reading("Pa", "pressure at the centre"),
        }


def built(n: int, strength: float | None = 12.0, c0: float = 10.0):
    """Model and state of n by n particles; `strength` (-) of the shifting, None for no shifting."""
    dx = L / n
    box = js.Box((-HALF, -HALF), (HALF, HALF), sides=("open", "open"))
    scheme = DeltaSPH.of(
        dx,
        c0,
        rho0=RHO,
        viscosity=ArtificialViscosity(0.0),
        shifting=None if strength is None else Shifting(strength),
    )
    walls = js.Ghosts.build(box, dx, scheme.smoothing, js.FreeSlip())
    x = lattice((-L / 2, -L / 2), (L / 2, L / 2), dx)
    u = OMEGA * np.stack([-x[:, 1], x[:, 0]], axis=1)
    given = dict(scheme=scheme, walls=walls, dx=dx, sample_dt=SAMPLE, p=initial_pressure(x))
    return js.assemble(x, u, **given, speed=1.3, skin=0.6)


def solved(n: int, t1: float, **options) -> js.Solution:
    """Runs `built(n, **options)` to t1 (s), with energies, angular momentum and pressure."""
    model, state = built(n, **options)
    energy = js.EnergyProbe.over(model, state, jnp.float32(SAMPLE))
    return js.march(model, state, t1, SAMPLE, (energy, PatchProbe()))


def drift(solution: js.Solution) -> tuple[float, float]:
    """Relative changes of kinetic plus compression energy and of angular momentum since the start."""
    energy = solution["kinetic"] + solution["compression"]
    spin = solution["angular_momentum"]
    return float(energy[-1] / energy[0] - 1.0), float(spin[-1] / spin[0] - 1.0)


def voids(solution: js.Solution) -> float:
    """Fraction of the particles (-) that at the end have fewer than half as many neighbours as in the full
    lattice."""
    p = solution.state.particles
    x = np.asarray(p.x, float)
    count = np.array(
        [np.sum(np.sum((x - at) ** 2, axis=1) < (3 * float(solution.model.dx)) ** 2) for at in x]
    )
    return float(np.mean(count < 0.5 * 9 * np.pi))


def main(n: int = 60, t1: float = 4.0) -> None:
    """Runs n by n particles to omega t = t1, with and without shifting."""
    title = f"Rotating square patch, {n} x {n}, to omega t = {t1:g}"
    with Report("rotating_square", title, L / n) as report:
        shown = {"with shifting": solved(n, t1), "without shifting": solved(n, t1, strength=None)}
        first = shown["with shifting"]["p_centre"][0] / (RHO * OMEGA**2 * L**2)
        # the probe averages over three spacings about the centre
        report.row("initial pressure at the centre / (rho omega² L²)", first, theory=CENTRE)
        for label, run in shown.items():
            energy, spin = drift(run)
            row = report.row
            row(f"{label}: energy lost over the initial energy", -100 * energy, "%", theory=0.0)
            row(f"{label}: relative change of the angular momentum", 100 * spin, "%", theory=0.0)
            row(
                f"{label}: particles with fewer than half the neighbours of a full lattice",
                100 * voids(run),
                "%",
            )
            row(f"{label}: largest speed / (omega L)", np.max(run["max_speed"]) / (OMEGA * L))
        report.picture(_picture(shown))


def _picture(shown: dict[str, js.Solution]) -> Figure:
    """Figure of the final patches coloured by pressure, and of energy and angular momentum over time."""
    figure = Figure(figsize=(14, 4.4), layout="constrained")
    *patches, curves = figure.subplots(1, len(shown) + 1)
    for axis, (label, run) in zip(patches, shown.items(), strict=True):
        p = run.state.particles
        pressure = np.asarray(laws.pressure(p.rho, run.model.scheme.c0)) / (RHO * OMEGA**2 * L**2)
        dots = axis.scatter(*np.asarray(p.x).T, c=pressure, s=2, vmin=-0.15, vmax=0.15, cmap="coolwarm")
        axis.set(aspect="equal", xlabel="x, m", ylabel="y, m", title=label)
        energy = run["kinetic"] + run["compression"]
        curves.plot(run.t, energy / energy[0], label=f"energy, {label}")
        spin = run["angular_momentum"]
        curves.plot(run.t, spin / spin[0], "--", label=f"angular momentum, {label}")
    figure.colorbar(dots, ax=patches[-1], label="p/(rho omega² L²)")
    curves.set(xlabel="omega t", ylabel="ratio to the initial value")
    curves.legend(fontsize="small")
    return figure
