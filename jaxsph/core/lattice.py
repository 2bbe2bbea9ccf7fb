"""Stress with which a lattice of particles resists its deformation: what a kernel is chosen by."""

from __future__ import annotations

from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy import linalg, special

from jaxsph.core.kernels import AbstractKernel

__all__ = ["LatticeStress", "lattice_points", "lattice_stress", "surface_stiffness"]

Lattice = Literal["cubic", "close"]
"""Square or cubic, or triangular in two and body-centred in three dimensions; of one particle per dx^D."""

STRAIN = 0.25
"""Largest logarithmic strain of the pure strain."""
DISTORTION = 0.12
"""Standard deviation of the components of the random deformations, logarithmic and without volume change."""
SAMPLES = 1000
"""Number of random deformations."""


class LatticeStress(NamedTuple):
    """Properties of a kernel on a lattice, from which the noise of its particles follows."""

    strained: float
    """Largest false stress under a pure strain from 0 to `STRAIN`, over the pressure (-)."""
    distorted: float
    """RMS of the false stress over random deformations without change of volume, over the pressure (-)."""
    neighbours: int
    """Neighbours of a particle on the undeformed lattice."""
    width: float
    """Smoothing length of the Gaussian with the same second moment, over the spacing (-)."""
    transform: float
    """Least value of the kernel's Fourier transform over that at zero (-); well below zero particles pair."""
    stiffness: float
    """Least stiffness of the undeformed lattice against transverse waves of displacements (-).

    Times 2 p/(rho dx^2) it is the square of their frequency. Where it is negative, pressure makes them grow
    and the lattice buckles, the faster the deeper the water is in spacings.
    """


def lattice_stress(
    kernel: AbstractKernel, h_over_dx: float, dim: int, lattice: Lattice = "cubic"
) -> LatticeStress:
    """False stress with which a lattice under pressure resists its deformation (-), and what goes with it.

    Particles under a uniform pressure p feel the stress p T, T_ab = -sum_j V r_a r_b (dW/dr)/r, the unit
    tensor for a perfect kernel. What differs from a multiple of it is false: the largest eigenvalue of
    T - (tr T / D) 1, by magnitude. Waves do work against it, which comes back as noise.
    **Arguments**: the kernel and its smoothing length over the spacing; the number of dimensions.
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
    # along a wave the stiffness is left out, which is no mode: it is made larger than all others
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
    """Points of a lattice of unit density about the origin, which is left out, `[M, D]`, in spacings.

    All those that any deformation of twice `STRAIN` brings within the radius are among them.
    """
    basis = _basis(lattice, dim)
    far = np.exp(2.0 * STRAIN) * radius
    # a cell is at least as wide as the inverse of its reciprocal's longest side
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
    """Lattices of the points under pure strain up to `STRAIN`, and under random deformations, `[S, M, D]`."""
    dim = points.shape[1]
    pure = np.linspace(0.0, STRAIN, 26)[:, None, None] * np.diag([1.0, -1.0, 0.0][:dim])
    random = np.random.default_rng(0).normal(scale=DISTORTION, size=(samples, dim, dim))
    random -= np.trace(random, axis1=1, axis2=2)[:, None, None] / dim * np.eye(dim)
    return tuple(points @ linalg.expm(each).swapaxes(1, 2) for each in (pure, random))


def false_stress(
    kernel: AbstractKernel, h_over_dx: float, points: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Deviator of the stress of each of several deformed lattices over the pressure, `[S, D, D]` (-).

    **Arguments**: the kernel and its smoothing length over the spacing; the neighbours' places, `[S, M, D]`.
    """
    dim, r2 = points.shape[-1], np.sum(points**2, axis=-1)
    inside = r2 < (kernel.reach * h_over_dx) ** 2
    slope = np.where(inside, kernel.slope(jnp.asarray(r2), h_over_dx, dim), 0.0)
    stress = -np.einsum("sn,sna,snb->sab", np.float64(slope), points, points, optimize=True)
    return stress - np.trace(stress, axis1=1, axis2=2)[:, None, None] / dim * np.eye(dim)


def shear_waves(lattice: Lattice, dim: int) -> NDArray[np.float64]:
    """Wavenumbers of a lattice's displacements, `[K, D]`, in radians a spacing.

    Those of its first Brillouin zone, where no other wavenumber of the same displacements is shorter; zero
    and one of each pair k and -k are left out.
    """
    reciprocal = 2.0 * np.pi * np.linalg.inv(_basis(lattice, dim)).T
    steps = np.linspace(-1.0, 1.0, {2: 97, 3: 41}[dim])
    k = np.stack(np.meshgrid(*(steps,) * dim, indexing="ij"), -1).reshape(-1, dim) @ reciprocal
    k = k[(k[:, -1] > -1e-9) & (np.linalg.norm(k, axis=1) > 1e-9)]
    G = np.stack(np.meshgrid(*((-1.0, 0.0, 1.0),) * dim, indexing="ij"), -1).reshape(-1, dim) @ reciprocal
    return k[np.all(k @ G.T <= 0.5 * np.sum(G**2, axis=1) + 1e-9, axis=1)]


def transverse(waves: NDArray[np.float64]) -> NDArray[np.float64]:
    """Projections on what is perpendicular to each wave, `[K, D, D]`."""
    along = waves / np.linalg.norm(waves, axis=1, keepdims=True)
    return np.eye(waves.shape[1]) - along[:, :, None] * along[:, None, :]


def shear_stiffness(
    kernel: AbstractKernel, h_over_dx: float, points: NDArray[np.float64], waves: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Stiffness of a lattice under pressure against transverse waves of displacements, `[K, D, D]` (-).

    sum_j V (1 - cos k r_j) grad grad W(r_j), in spacings, between vectors perpendicular to the wave; what is
    left beside it compresses the lattice, which the pressure itself forbids.
    """
    near, curvature = _curvature(kernel, h_over_dx, points)
    stiffness = np.einsum("kn,nab->kab", 1.0 - np.cos(waves @ near.T), curvature)
    across = transverse(waves)
    return across @ stiffness @ across


def surface_stiffness(
    kernel: AbstractKernel, h_over_dx: float, dim: int, rows: int = 4, k: float = np.pi
) -> NDArray[np.float64]:
    """Stiffness `[rows]` (-) of the rows under a free surface against waves along it that lift and sink them.

    Times g/dx it is the square of the frequency of a row in still water, were the others to move as it does:
    sum_j V (p_i + p_j) (1 - cos k x_j) d2W/dz2 over rho g dx. `k`: wavenumber in spacings, rad. Deep in the
    water it is the lattice's own. What the first row has too much the second has too little, since the rows
    that are missing over the surface would have pressures below zero.
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
    """Points `[K, D]` that a particle at the origin sees, V grad grad W `[K, D, D]` there, in spacings."""
    dim, r2 = points.shape[1], np.sum(points**2, axis=1)
    near, r2 = points[r2 < (kernel.reach * h_over_dx) ** 2], r2[r2 < (kernel.reach * h_over_dx) ** 2]

    def slope(r2):
        return kernel.slope(r2, h_over_dx, dim)

    F, dF = jax.vmap(jax.value_and_grad(slope))(jnp.asarray(r2))  # grad grad W = F 1 + 2 F' r r
    return near, np.einsum("n,ab->nab", F, np.eye(dim)) + 2.0 * np.einsum("n,na,nb->nab", dF, near, near)


def _transform(kernel: AbstractKernel, h: float, dim: int) -> tuple[float, float]:
    """Width of a kernel, and the least value of its Fourier transform over that at zero."""
    R = kernel.reach * h
    nodes, weights = np.polynomial.legendre.leggauss(400)
    r, weights = 0.5 * R * (nodes + 1.0), 0.5 * R * weights
    shell = (
        np.float64(kernel.value(jnp.asarray(r**2), h, dim))
        * weights
        * {2: 2 * np.pi * r, 3: 4 * np.pi * r**2}[dim]
    )
    k = np.linspace(0.0, 20.0, 2001)[:, None]
    waves = special.j0(k * r) if dim == 2 else np.sinc(k * r / np.pi)
    found = waves @ shell
    return float(np.sqrt(2.0 / dim * (shell @ r**2) / shell.sum())), float(found.min() / found[0])
