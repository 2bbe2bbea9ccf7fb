"""Standing wave of `bench_peers` by PySPH: writes time and centre of mass of the water into a CSV file.

    python standing_wave_pysph.py --csv OUT.csv --dx 0.02 --scheme edac --end 11.8 --interval 0.03

The settings of the schemes are those of PySPH's example of a dam break in two dimensions, with as little
viscosity as the runs stay stable with.
"""

import sys

import numpy as np
from pysph.base import kernels
from pysph.base.utils import get_particle_array
from pysph.solver.application import Application
from pysph.sph.isph.sisph import SISPHScheme
from pysph.sph.scheme import SchemeChooser
from pysph.sph.wc.edac import EDACScheme

LENGTH, DEPTH, AMPLITUDE, G, RHO0 = 1.0, 0.5, 0.025, 9.81, 1000.0
K = np.pi / LENGTH
OMEGA = np.sqrt(G * K * np.tanh(K * DEPTH))
C0 = 10.0 * np.sqrt(G * DEPTH)
"""Speed of sound, m/s."""
LAYERS = 4
"""Rows of dummy particles behind each wall."""
SMOOTHING = 1.3
"""Smoothing length over the spacing."""


class StandingWave(Application):
    """Standing wave in a closed box; see `experiments/benchmarks/bench_peers.py`."""

    def add_user_options(self, group):
        group.add_argument("--csv", required=True)
        group.add_argument("--dx", type=float, required=True, help="spacing, m")
        group.add_argument("--end", type=float, required=True, help="duration, s")
        group.add_argument("--interval", type=float, required=True, help="time between two rows, s")

    def create_scheme(self):
        both = {"fluids": ["fluid"], "solids": ["wall"], "dim": 2, "rho0": RHO0, "gy": -G, "nu": 0.0}
        sisph = SISPHScheme(c0=C0, alpha=0.01, pref=1, gtvf=True, symmetric=True, hg_correction=True, **both)
        return SchemeChooser(default="edac", edac=EDACScheme(c0=C0, h=1, clamp_p=True, **both), sisph=sisph)

    def configure_scheme(self):
        h = SMOOTHING * self.options.dx
        if self.options.scheme == "edac":
            self.scheme.configure(h=h)
            dt = 0.25 * h / C0
        else:
            self.scheme.configure(pref=RHO0 * C0**2)
            dt = 0.125 * h / np.sqrt(2.0 * G * DEPTH)
        kernel = kernels.QuinticSpline(dim=2)
        self.scheme.configure_solver(dt=dt, tf=self.options.end, pfreq=10**9, kernel=kernel)

    def create_particles(self):
        dx = self.options.dx
        columns, rows = round(LENGTH / dx), round(DEPTH / dx)
        x, z = _lattice(np.arange(columns), np.arange(rows), dx)
        scale = AMPLITUDE * OMEGA / np.sinh(K * DEPTH)
        size = {"h": SMOOTHING * dx, "m": RHO0 * dx**2, "rho": RHO0}
        fluid = get_particle_array(
            name="fluid",
            x=x,
            y=z,
            u=-scale * np.sin(K * x) * np.cosh(K * z),
            v=scale * np.cos(K * x) * np.sinh(K * z),
            **size,
        )
        around = np.arange(-LAYERS, columns + LAYERS), np.arange(-LAYERS, round((DEPTH + 6 * AMPLITUDE) / dx))
        x, z = _lattice(*around, dx)
        outside = (x < 0) | (x > LENGTH) | (z < 0)
        wall = get_particle_array(name="wall", x=x[outside], y=z[outside], **size)
        self.scheme.setup_properties([fluid, wall])
        for particles in (fluid, wall):
            particles.p[:] = RHO0 * G * np.maximum(DEPTH - particles.y, 0.0)
        self.rows, self.next = [], self.options.interval
        return [fluid, wall]

    def post_step(self, solver):
        if solver.t >= self.next:
            self.rows.append((solver.t, np.mean(solver.particles[0].x)))
            self.next += self.options.interval


def _lattice(i, j, dx):
    """Positions x and z (m) of a lattice of cells with the indices i and j."""
    return (a.ravel() for a in np.meshgrid((i + 0.5) * dx, (j + 0.5) * dx))


if __name__ == "__main__":
    wave = StandingWave()
    wave.run([*sys.argv[1:], "--cache-nnps", "--disable-output"])  # both save time
    np.savetxt(wave.options.csv, wave.rows, delimiter=",", header="t,x_c", comments="")
