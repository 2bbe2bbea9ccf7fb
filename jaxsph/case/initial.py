"""Initial water of a case: positions, volumes, velocities and pressures of the particles."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from jaxsph.case.geometry import Geometry
from jaxsph.case.sections import Sections
from jaxsph.core.kernels import AbstractKernel, Gaussian, Polynomial, Semicircle, WendlandC2
from jaxsph.core.points import at_points
from jaxsph.solids.packing import packed
from jaxsph.solids.placement import lattice
from jaxsph.solids.shapes import AbstractShape
from jaxsph.solids.walls import Ghosts
from jaxsph.waves.theory import standing_velocity

SURFACE_ROWS: dict[tuple[type[AbstractKernel], int], tuple[float, ...]] = {
    (Polynomial, 2): (0.0108, 0.0064, -0.0013, 0.0006),
    (Polynomial, 3): (0.0122, 0.0033, -0.0008, 0.0003),
    (Semicircle, 2): (0.0113, 0.0043, -0.0013, 0.0003),
    (Semicircle, 3): (0.0138, 0.0017, 0.0002, 0.0002),
    (Gaussian, 2): (0.0003, 0.0186, -0.0058, 0.0018, -0.0008),
    (WendlandC2, 3): (0.0117, 0.0116, -0.0026, 0.0014),
}
"""Upward displacements, in spacings, at which the horizontal rows of a lattice are at rest in incompressible
water: values for the rows from the surface down, by kernel and number of dimensions. Measured in tanks 0.48 m
deep at dx = 0.04 m, with the kernels' default smoothing lengths (`python -m experiments run still_tank`)."""


def at_rest(x: np.ndarray, level: float, dx: float, kernel: AbstractKernel) -> np.ndarray:
    """Positions `[N, D]` (m) of a lattice below `level` (m), moved to where incompressible water is at rest.

    The surface truncates the kernel. The rows of particles near the surface are therefore in equilibrium up
    to two hundredths of a spacing above or below the rows of the lattice. With kernels that are not in
    `SURFACE_ROWS` the rows start on the lattice; they then rise or sink, and the projection does work.
    """
    rise = (*SURFACE_ROWS.get((type(kernel), x.shape[1]), ()), 0.0)
    moved = np.array(x)
    moved[:, -1] += dx * np.interp((level - x[:, -1]) / dx - 0.5, np.arange(len(rise)), rise)
    return moved


def initial_velocity(case: Sections, geometry: Geometry, x: np.ndarray) -> np.ndarray:
    """Initial velocities `[N, D]` (m/s) of particles at x (m): zero, or as in a linear standing wave at a
    time when the surface is flat."""
    if case.start is None:
        return np.zeros_like(x)
    k = case.start.mode * np.pi / geometry.length
    return standing_velocity(x, case.start.amplitude, k, geometry.depth, case.g)


def water(geometry: Geometry, dx: float, low: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """Positions `[N, D]` (m) and volumes `[N]` (m3; m2 in 2-D) of the particles in the column and the
    layer of water. `low`: low ends of the water, m."""
    across = () if geometry.width is None else (geometry.width,)
    x, volume = lattice(
        low,
        (geometry.column, *across, geometry.depth),
        dx,
        () if geometry.plate is None else (geometry.plate,),
        () if geometry.platform is None else (geometry.platform,),
    )
    if not geometry.layer:
        return x, volume
    rest, more = lattice((geometry.column, *low[1:]), (geometry.length, *across, geometry.layer), dx)
    return np.concatenate([x, rest]), np.concatenate([volume, more])


def outside_body(away: np.ndarray) -> np.ndarray:
    """Mask `[N]` of the particles outside a body. `away` `[N]`: distances from the body's surface, in
    spacings, negative inside.

    The number of particles inside is chosen so that they have the body's submerged volume, which is the sum,
    over all cells, of the part of the cell that the body covers. A threshold on the distance alone would
    lower or raise the surface if the body cuts the lattice irregularly. Particles at equal distances, for
    example at two symmetric faces, are treated alike.
    """
    away = np.round(away, 4)
    levels, count = np.unique(away, return_counts=True)
    nearer = np.concatenate([[0], np.cumsum(count)])
    cut = int(np.argmin(np.abs(nearer - np.sum(np.clip(0.5 - away, 0.0, 1.0)))))
    most = levels[cut - 1] if cut else -np.inf
    return away > min(max(most, -0.3), 0.45)


def initial_head(geometry: Geometry, x: np.ndarray) -> np.ndarray:
    """Initial pressure head p/(rho0 g) of particles at x, m: hydrostatic, or as at the release of a column.

    Removing the gate sets p = 0 on the released face at once. In incompressible water the pressure then
    solves lap p = 0 with p = 0 on this face and at the surface, dp/dx = 0 at the back wall, and
    dp/dz = -rho0 g on the bed. Weakly compressible water started from the hydrostatic pressure would reach
    this state by sound waves from the face, and would oscillate. In a column of 15 x 30 particles the
    pressure oscillated by rho0 g H until the column had collapsed.

    With k_n = (n + 1/2) pi/H and L the column's length,
        p/(rho0 g) = H - z - sum_n 2/(H k_n^2) cos(k_n z) cosh(k_n x)/cosh(k_n L).
    """
    H, L, z = geometry.depth, geometry.column, x[:, -1]
    if L >= geometry.length:
        return H - z
    # the omitted terms are below exp(-10 pi), because all particles are half a spacing or more from the face
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
    """Positions `[N, D]` (m) and volumes `[N]` (m3; m2 in 2-D) of the particles of water that fills a tank to
    `level` (m), around its plates, above its platform and around solids of the given shapes."""
    regions = walls.regions
    x, volume = lattice(walls.low, (*walls.high[:-1], level), dx, regions.plates, regions.platforms)
    away = [at_points(shape.distance, x) for shape in shapes]
    return around_solids(x, volume, away, walls, level, dx)


def around_solids(
    x: np.ndarray,
    volume: np.ndarray,
    away: Sequence[np.ndarray],
    walls: Ghosts,
    level: float | None,
    dx: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Positions `[N, D]` (m) and volumes `[N]` (m3; m2 in 2-D) of still water around solids.

    Particles inside the solids are removed, so that the remaining particles have the volume of the water
    outside. The remaining particles are then packed.

    **Arguments**: positions `x` and volumes of water; `away`: distances `[N]` (m) from the surface of every
    solid, negative inside; `walls`: ghosts of the tank and of the solids; `level` (m) of water that fills the
    tank, or None for a released column, which is not packed.
    """
    if not len(away):
        return x, volume
    outside = np.all([outside_body(one / dx) for one in away], axis=0)
    x, volume, nearest = x[outside], volume[outside], np.min(away, axis=0)[outside]
    return (x, volume) if level is None else packed(x, volume, nearest, walls, level, dx)
