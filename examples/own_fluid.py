"""A fluid of your own from arrays: vortices in a periodic box decay by viscosity, compared with theory.

`js.assemble` makes a model from positions, velocities and pressures; `js.march` runs the model.
"""

import numpy as np

import jaxsph as js
from jaxsph.model.shifting import Shifting
from jaxsph.model.viscosity import LaplacianViscosity

n, nu, rho = 25, 0.01, 1000.0  # particles per side of 1 m; viscosity, m2/s; density, kg/m3
dx = 1.0 / n
box = js.Box((0.0, 0.0), (1.0, 1.0), sides=("periodic", "periodic"))
scheme = js.DeltaSPH.of(
    dx, 10.0, rho0=rho, viscosity=LaplacianViscosity(nu), period=box.period, shifting=Shifting(12.0)
)
walls = js.Ghosts.build(box, dx, scheme.smoothing, js.FreeSlip())  # no ghosts, because all sides are periodic

centres = (np.arange(n) + 0.5) * dx
x = np.stack(np.meshgrid(centres, centres, indexing="ij"), axis=-1).reshape(-1, 2)
a, b = 2 * np.pi * x.T
u = np.stack([-np.cos(a) * np.sin(b), np.sin(a) * np.cos(b)], axis=1)
p = -0.25 * rho * (np.cos(2 * a) + np.cos(2 * b))

model, state = js.assemble(x, u, scheme=scheme, walls=walls, dx=dx, sample_dt=0.05, p=p, speed=1.3, skin=0.6)
solution = js.march(model, state, 0.5, 0.05, (js.EnergyProbe.over(model, state, np.float32(0.05)),))
for t, energy in zip(solution.t, solution["kinetic"] / solution["kinetic"][0], strict=True):
    print(f"t = {t:.2f} s   kinetic energy {energy:.3f}   theory {np.exp(-16 * np.pi**2 * nu * t):.3f}")
