"""Cases: a validated description in SI units, and `build`, which turns it into a model and a state.

Everything that fixes an array's shape is spent here, on the host. Lengths are snapped to the lattice of
spacing dx, and `Case.notices` says what became of each.
"""

from __future__ import annotations

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np

from jaxsph.case.geometry import Geometry
from jaxsph.case.sections import Sections
from jaxsph.solids.placement import lattice
from jaxsph.solids.shapes import AbstractShape
from jaxsph.solids.walls import Ghosts


def initial_velocity(case: Sections, geometry: Geometry, x: np.ndarray) -> np.ndarray:
    """Velocities `[N, D]` (m/s) at the places x (m): at rest, or those of a standing wave."""
    u = np.zeros_like(x)
    if case.start is None:
        return u
    k = case.start.mode * np.pi / geometry.length
    omega = np.sqrt(case.g * k * np.tanh(k * geometry.depth))
    scale = case.start.amplitude * omega / np.sinh(k * geometry.depth)
    u[:, 0] = -scale * np.sin(k * x[:, 0]) * np.cosh(k * x[:, -1])
    u[:, -1] = scale * np.cos(k * x[:, 0]) * np.sinh(k * x[:, -1])
    return u


def water(geometry: Geometry, dx: float) -> tuple[np.ndarray, np.ndarray]:
    """Places (m) and volumes (m3, m2 in 2-D) of the particles at the start."""
    across = () if geometry.width is None else (geometry.width,)
    low = (0.0,) * (2 + len(across))
    x, volume = lattice(
        low,
        (geometry.column, *across, geometry.depth),
        dx,
        () if geometry.plate is None else (geometry.plate,),
        geometry.platform,
    )
    if not geometry.layer:
        return x, volume
    rest, more = lattice((geometry.column, *low[1:]), (geometry.length, *across, geometry.layer), dx)
    return np.concatenate([x, rest]), np.concatenate([volume, more])


def outside_body(away: np.ndarray) -> np.ndarray:
    """Which particles are not in the place of a body, by their distances from its surface over dx.

    The lattice need not fit the body. As much water gives way as the body has volume in it, counted by the
    share of every cell that it covers: with a threshold on the distance the surface would fall, or rise, for
    a lattice cut raggedly. Particles at one distance, as those of two symmetric faces, go together.
    """
    away = np.round(away, 4)
    levels, count = np.unique(away, return_counts=True)
    taken = np.concatenate([[0], np.cumsum(count)])
    cut = int(np.argmin(np.abs(taken - np.sum(np.clip(0.5 - away, 0.0, 1.0)))))
    most = levels[cut - 1] if cut else -np.inf
    return away > min(max(most, -0.3), 0.45)


def initial_head(geometry: Geometry, x: np.ndarray) -> np.ndarray:
    """Pressure at t = 0 over rho0 g, m: hydrostatic, or that of a column in the instant of its release.

    Taking the gate away makes p = 0 on the released face at once: in incompressible water the pressure is
    from then on the solution of lap p = 0 with p = 0 there and at the surface, dp/dx = 0 at the back wall
    and dp/dz = -rho0 g on the bed. Weakly compressible water that started from the hydrostatic pressure
    would get there by sound waves from the face, and ring: in a column of 15 x 30 the pressure then swung by
    rho0 g H until it had run out.
    With k_n = (n + 1/2) pi/H and L the column's length,
        p/(rho0 g) = H - z - sum_n 2/(H k_n^2) cos(k_n z) cosh(k_n x)/cosh(k_n L).
    """
    H, L, z = geometry.depth, geometry.column, x[:, -1]
    if L >= geometry.length:
        return H - z
    # the nearest column of particles is half a spacing from the face: what is left out is below exp(-10 pi)
    k = (np.arange(int(20 * H / geometry.dx)) + 0.5) * np.pi / H
    xs, column = np.unique(x[:, 0], return_inverse=True)
    zs, row = np.unique(z, return_inverse=True)
    a = (
        np.exp(-np.outer(np.maximum(L - xs, 0.0), k))
        * (1 + np.exp(-2 * np.outer(xs, k)))
        / (1 + np.exp(-2 * k * L))
    )
    released = (2 / (H * k**2) * a) @ np.cos(np.outer(k, zs))
    head = H - z - released[column, row]
    return np.where(x[:, 0] < L, head, np.maximum(geometry.layer - z, 0.0))


def still_water(
    walls: Ghosts, level: float, dx: float, shapes: Sequence[AbstractShape] = ()
) -> tuple[np.ndarray, np.ndarray]:
    """Places `[N, D]` (m) and volumes `[N]` (m3; m2 in 2-D) of the particles of water that fills a tank to a
    level (m), around its plates, over its platform and around solids of these shapes."""
    regions = walls.regions
    x, volume = lattice(walls.low, (*walls.high[:-1], level), dx, regions.plates, regions.platform)
    for shape in shapes:
        outside = outside_body(np.asarray(shape.distance(jnp.asarray(x, jnp.float32))) / dx)
        x, volume = x[outside], volume[outside]
    return x, volume
