"""Criteria for a kernel: stress with which a particle lattice resists deformation, and lattice stability."""

from __future__ import annotations

from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy  # which imports its subpackages on first use
from numpy.typing import NDArray

from jaxsph.core.kernels import AbstractKernel

__all__ = ["LatticeStress", "lattice_points", "lattice_stress", "surface_stiffness"]

Lattice = Literal["cubic", "close"]
"""Lattice with one particle per dx^D: "cubic", or "close" (triangular in 2-D, body-centred in 3-D)."""

STRAIN = 0.25
"""Largest logarithmic strain of the lattices under pure strain (-)."""
DISTORTION = 0.12
"""Standard deviation (-) of the components of the random logarithmic deformations, before their trace is
removed."""
SAMPLES = 1000
"""Number of random deformations."""


class LatticeStress(NamedTuple):
    """Properties of a kernel on a lattice, which determine the noise of the particles."""

    strained: float
    """Largest ratio of the spurious stress to the pressure under a pure strain from 0 to `STRAIN` (-)."""
    distorted: float
    """RMS of the ratio of the spurious stress to the pressure, for random deformations without volume change
    (-)."""
    neighbours: int
    """Number of neighbours of a particle on the undeformed lattice."""
    width: float
    """Smoothing length of the Gaussian with the same second moment, divided by the spacing (-)."""
    transform: float
    """Ratio of the Fourier transform's minimum to its value at zero (-); particles pair if the ratio is far
    below 0."""
    stiffness: float
    """Smallest stiffness of the undeformed lattice against transverse displacement waves (-).

    The stiffness times 2 p/(rho dx^2) is the square of the waves' angular frequency. If the stiffness is
    negative, waves grow under pressure and the lattice buckles. The growth rate increases with the ratio of
    the water depth to the spacing.
    """


def lattice_stress(
    kernel: AbstractKernel, h_over_dx: float, dim: int, lattice: Lattice = "cubic"
) -> LatticeStress:
    """Spurious stress (-) with which a lattice under pressure resists deformation, and related properties.

    Particles under a uniform pressure p are subject to the stress p T, T_ab = -sum_j V r_a r_b (dW/dr)/r. T
    is the unit tensor for a perfect kernel. The spurious stress is the eigenvalue of T - (tr T / D) 1 with
    the largest magnitude. Waves do work against the spurious stress, and this work becomes noise.
    **Arguments**: `h_over_dx`: ratio of the smoothing length to the spacing; `dim`: number of dimensions.
    """
    reach = kernel.reach * h_over_dx
    points = lattice_points(lattice, dim, reach)
    of_strains, of_distortions = (
        np.abs(np.linalg.eigvalsh(false_stress(kernel, h_over_dx, each))).max(axis=1)
        for each in deformed(points, SAMPLES)
    )
    r = np.sqrt(np.sum(points**2, axis=1))
    width, least = _transform(kernel, h_over_dx, dim)
    waves = shear_waves(lattice, dim)
    # `shear_stiffness` is zero along a wave: a large stiffness keeps this direction out of the minimum
    along = np.eye(dim) - transverse(waves)
    stiffness = shear_stiffness(kernel, h_over_dx, points, waves) + 1e9 * along
    return LatticeStress(
        float(of_strains.max()),
        float(np.sqrt(np.mean(of_distortions**2))),
        int(np.sum(r < reach - 1e-9)),
        width,
        least,
        float(np.linalg.eigvalsh(stiffness).min()),
    )


def lattice_points(lattice: Lattice, dim: int, radius: float) -> NDArray[np.float64]:
    """Points `[M, D]` of a lattice of unit density around the origin, in spacings, without the origin.

    The points include all those that a deformation of up to twice `STRAIN` can bring within `radius`.
    """
    basis = _basis(lattice, dim)
    far = np.exp(2.0 * STRAIN) * radius
    # a cell is at least as wide as the inverse length of its longest reciprocal vector
    most = int(np.ceil(far * np.linalg.norm(np.linalg.inv(basis), axis=0).max())) + 1
    steps = np.stack(np.meshgrid(*[np.arange(-most, most + 1)] * dim, indexing="ij"), -1).reshape(-1, dim)
    points = steps @ basis
    r2 = np.sum(points**2, axis=1)
    return points[(r2 > 1e-12) & (r2 < far**2)]


def _basis(lattice: Lattice, dim: int) -> NDArray[np.float64]:
    """Vectors that span a lattice of unit density, `[D, D]`, in spacings."""
    if lattice == "cubic":
        return np.eye(dim)
    basis = {
        2: np.array([[1.0, 0.0], [0.5, np.sqrt(0.75)]]),
        3: np.array([[-0.5, 0.5, 0.5], [0.5, -0.5, 0.5], [0.5, 0.5, -0.5]]),
    }[dim]
    return basis / abs(np.linalg.det(basis)) ** (1.0 / dim)


def deformed(points: NDArray[np.float64], samples: int) -> tuple[NDArray[np.float64], ...]:
    """Positions `[S, M, D]` of the points under pure strains up to `STRAIN`, and under random
    deformations."""
    dim = points.shape[1]
    pure = np.linspace(0.0, STRAIN, 26)[:, None, None] * np.diag([1.0, -1.0, 0.0][:dim])
    random = np.random.default_rng(0).normal(scale=DISTORTION, size=(samples, dim, dim))
    random -= np.trace(random, axis1=1, axis2=2)[:, None, None] / dim * np.eye(dim)
    return tuple(points @ scipy.linalg.expm(each).swapaxes(1, 2) for each in (pure, random))


def false_stress(
    kernel: AbstractKernel, h_over_dx: float, points: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Deviator of the stress divided by the pressure (-), for each of S deformed lattices, `[S, D, D]`.

    **Arguments**: `h_over_dx`: ratio of the smoothing length to the spacing; `points`: positions of the
    neighbours, `[S, M, D]`, in spacings.
    """
    dim, r2 = points.shape[-1], np.sum(points**2, axis=-1)
    inside = r2 < (kernel.reach * h_over_dx) ** 2
    slope = np.where(inside, kernel.slope(jnp.asarray(r2), h_over_dx, dim), 0.0)
    stress = -np.einsum("sn,sna,snb->sab", np.float64(slope), points, points, optimize=True)
    return stress - np.trace(stress, axis1=1, axis2=2)[:, None, None] / dim * np.eye(dim)


def shear_waves(lattice: Lattice, dim: int) -> NDArray[np.float64]:
    """Wave vectors k of displacement waves on a lattice, `[K, D]`, in radians per spacing.

    The wave vectors sample the first Brillouin zone, in which no shorter wave vector describes the same
    displacements. The zero vector is omitted. Wave vectors with a negative last component are also omitted,
    because k and -k are equivalent.
    """
    reciprocal = 2.0 * np.pi * np.linalg.inv(_basis(lattice, dim)).T
    steps = np.linspace(-1.0, 1.0, {2: 97, 3: 41}[dim])
    k = np.stack(np.meshgrid(*(steps,) * dim, indexing="ij"), -1).reshape(-1, dim) @ reciprocal
    k = k[(k[:, -1] > -1e-9) & (np.linalg.norm(k, axis=1) > 1e-9)]
    G = np.stack(np.meshgrid(*((-1.0, 0.0, 1.0),) * dim, indexing="ij"), -1).reshape(-1, dim) @ reciprocal
    return k[np.all(k @ G.T <= 0.5 * np.sum(G**2, axis=1) + 1e-9, axis=1)]


def transverse(waves: NDArray[np.float64]) -> NDArray[np.float64]:
    """Matrices `[K, D, D]` that project vectors onto the directions perpendicular to each wave vector."""
    along = waves / np.linalg.norm(waves, axis=1, keepdims=True)
    return np.eye(waves.shape[1]) - along[:, :, None] * along[:, None, :]


def shear_stiffness(
    kernel: AbstractKernel, h_over_dx: float, points: NDArray[np.float64], waves: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Stiffness of a lattice under pressure against transverse displacement waves, `[K, D, D]` (-).

    The stiffness is sum_j V (1 - cos k r_j) grad grad W(r_j), in spacings, projected onto the directions
    perpendicular to the wave. The longitudinal part is left out, because the pressure prevents longitudinal
    waves from compressing the lattice.
    """
    near, curvature = _curvature(kernel, h_over_dx, points)
    stiffness = np.einsum("kn,nab->kab", 1.0 - np.cos(waves @ near.T), curvature)
    across = transverse(waves)
    return across @ stiffness @ across


def surface_stiffness(
    kernel: AbstractKernel, h_over_dx: float, dim: int, rows: int = 4, k: float = np.pi
) -> NDArray[np.float64]:
    """Stiffness `[rows]` (-) of particle rows below a free surface against vertical displacement waves.

    The waves run along the surface with the wavenumber `k`, in radians per spacing. The stiffness is
    sum_j V (p_i + p_j) (1 - cos k x_j) d2W/dz2 divided by rho g dx. If all rows move alike, the stiffness
    times g/dx is the square of a row's angular frequency in still water. Far below the surface the stiffness
    is `shear_stiffness` times twice the depth in spacings. The stiffness of the first row is larger, and that
    of the second row smaller, than this product, because the sum lacks the rows above the surface, where the
    pressure p would be negative.
    """
    points = lattice_points("cubic", dim, kernel.reach * h_over_dx)
    near, curvature = _curvature(kernel, h_over_dx, points)
    weight = (1.0 - np.cos(k * near[:, 0])) * curvature[:, -1, -1]
    depth = np.arange(rows)[:, None] + 0.5
    other = depth - near[:, -1]
    return np.sum(np.where(other > 0.0, depth + other, 0.0) * weight, axis=1)


def _curvature(
    kernel: AbstractKernel, h_over_dx: float, points: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points `[K, D]` in the support around the origin, and V grad grad W `[K, D, D]` at these points, in
    spacings."""
    dim, r2 = points.shape[1], np.sum(points**2, axis=1)
    near, r2 = points[r2 < (kernel.reach * h_over_dx) ** 2], r2[r2 < (kernel.reach * h_over_dx) ** 2]

    def slope(r2):
        return kernel.slope(r2, h_over_dx, dim)

    F, dF = jax.vmap(jax.value_and_grad(slope))(jnp.asarray(r2))  # grad grad W = F 1 + 2 F' r r
    return near, np.einsum("n,ab->nab", F, np.eye(dim)) + 2.0 * np.einsum("n,na,nb->nab", dF, near, near)


def _transform(kernel: AbstractKernel, h: float, dim: int) -> tuple[float, float]:
    """Width of a kernel, in spacings, and ratio of its Fourier transform's minimum to the transform at zero
    (-)."""
    R = kernel.reach * h
    nodes, weights = np.polynomial.legendre.leggauss(400)
    r, weights = 0.5 * R * (nodes + 1.0), 0.5 * R * weights
    shell = (
        np.float64(kernel.value(jnp.asarray(r**2), h, dim))
        * weights
        * {2: 2 * np.pi * r, 3: 4 * np.pi * r**2}[dim]
    )
    k = np.linspace(0.0, 20.0, 2001)[:, None]
    waves = scipy.special.j0(k * r) if dim == 2 else np.sinc(k * r / np.pi)
    found = waves @ shell
    return float(np.sqrt(2.0 / dim * (shell @ r**2) / shell.sum())), float(found.min() / found[0])
