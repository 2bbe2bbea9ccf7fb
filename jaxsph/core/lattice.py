"""Stress with which a lattice of particles resists its deformation: what a kernel is chosen by."""

from __future__ import annotations

from typing import Literal, NamedTuple

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy import linalg, special

from jaxsph.core.kernels import AbstractKernel

__all__ = ["LatticeStress", "lattice_points", "lattice_stress"]

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
    pure = np.linspace(0.0, STRAIN, 26)[:, None, None] * np.diag([1.0, -1.0, 0.0][:dim])
    random = np.random.default_rng(0).normal(scale=DISTORTION, size=(SAMPLES, dim, dim))
    random -= np.trace(random, axis1=1, axis2=2)[:, None, None] / dim * np.eye(dim)
    of_strains, of_distortions = (
        _false_stress(kernel, h_over_dx, points @ linalg.expm(each).swapaxes(1, 2)) for each in (pure, random)
    )
    r = np.sqrt(np.sum(points**2, axis=1))
    width, least = _transform(kernel, h_over_dx, dim)
    return LatticeStress(
        float(of_strains.max()),
        float(np.sqrt(np.mean(of_distortions**2))),
        int(np.sum(r < reach - 1e-9)),
        width,
        least,
    )


def lattice_points(lattice: Lattice, dim: int, radius: float) -> NDArray[np.float64]:
    """Points of a lattice of unit density about the origin, which is left out, `[M, D]`, in spacings.

    All those that any deformation of twice `STRAIN` brings within the radius are among them.
    """
    basis = np.eye(dim)
    if lattice == "close":
        basis = (
            np.array([[1.0, 0.0], [0.5, np.sqrt(0.75)]])
            if dim == 2
            else np.array([[-0.5, 0.5, 0.5], [0.5, -0.5, 0.5], [0.5, 0.5, -0.5]])
        )
        basis = basis / abs(np.linalg.det(basis)) ** (1.0 / dim)
    far = np.exp(2.0 * STRAIN) * radius
    # a cell is at least as wide as the inverse of its reciprocal's longest side
    most = int(np.ceil(far * np.linalg.norm(np.linalg.inv(basis), axis=0).max())) + 1
    steps = np.stack(np.meshgrid(*[np.arange(-most, most + 1)] * dim, indexing="ij"), -1).reshape(-1, dim)
    points = steps @ basis
    r2 = np.sum(points**2, axis=1)
    return points[(r2 > 1e-12) & (r2 < far**2)]


def _false_stress(kernel: AbstractKernel, h: float, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """False stress of each of several deformed lattices, `points` `[S, M, D]`, over the pressure (-)."""
    dim, r2 = points.shape[-1], np.sum(points**2, axis=-1)
    slope = np.where(r2 < (kernel.reach * h) ** 2, kernel.slope(jnp.asarray(r2), h, dim), 0.0)
    stress = -np.einsum("sn,sna,snb->sab", np.float64(slope), points, points, optimize=True)
    stress -= np.trace(stress, axis1=1, axis2=2)[:, None, None] / dim * np.eye(dim)
    return np.abs(np.linalg.eigvalsh(stress)).max(axis=1)


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
