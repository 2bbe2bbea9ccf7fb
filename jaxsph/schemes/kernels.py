"""Kernels of the incompressible scheme, their lengths, and their sums on a lattice."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from jaxsph.core.kernels import AbstractKernel, Semicircle, WendlandC2
from jaxsph.core.pairs import Pair
from jaxsph.model import laws

KERNEL = {2: Semicircle.of(2, 14.0), 3: Semicircle.of(3, 13.5)}
"""Kernel by number of dimensions, of least stress on a square or cubic lattice for its `SUPPORT`.

The stress with which a lattice resists its deformation is set by the kernel's Fourier transform at the
wavelength of the spacing. With half the neighbours of a Gaussian of 1.2 dx, and as many as the paper's kernel
in three dimensions, Wendland's of 1.5 dx (section 2), waves lose less than with either (`quiet_water`).
"""

SUPPORT = {2: 3.05, 3: 3.0}
"""Radius of the semicircle's support over the spacing, by number of dimensions."""

STEP_LENGTH = {2: 1.2, 3: 1.5}
"""Length over the spacing of which a step may cross the share `cfl` (-), whatever the kernel's own."""


def usual_length(kernel: AbstractKernel, dim: int) -> float:
    """Smoothing length over the spacing that a kernel has by default, in `dim` dimensions.

    Wendland's: a square lattice is quiet at rest with 2, and 1.5 is the paper's (section 2).
    """
    if isinstance(kernel, WendlandC2):
        return {2: 2.0, 3: 1.5}[dim]
    if isinstance(kernel, Semicircle):
        return SUPPORT[dim] / kernel.reach
    return 1.2 * kernel.width


def lattice_sums(kernel: AbstractKernel, h_over_dx: float, dim: int) -> tuple[float, float]:
    """Kernel's sum V W, the particle itself included, and h^2 times the Laplacian's weights, on a lattice."""
    reach = int(np.ceil(kernel.reach * h_over_dx))
    axes = np.meshgrid(*(np.arange(-reach, reach + 1.0),) * dim)
    r2 = np.sum([a**2 for a in axes], axis=0)
    r2 = jnp.asarray(r2[r2 < (kernel.reach * h_over_dx) ** 2])
    pair = Pair((), r2, kernel.slope(r2, h_over_dx, dim), kernel.value(r2, h_over_dx, dim))
    weights = laws.laplacian_weight(pair, {"V": 1.0}, (0.1 * h_over_dx) ** 2)
    return float(jnp.sum(pair.W)), float(jnp.sum(weights)) * h_over_dx**2
