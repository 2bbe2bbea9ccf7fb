"""Kernels of the incompressible scheme, their smoothing lengths, and their sums over a lattice."""

from __future__ import annotations

from functools import partial
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxsph.core.arrays import Scalar
from jaxsph.core.kernels import AbstractKernel, Gaussian, Polynomial, Semicircle, WendlandC2
from jaxsph.core.pairs import Pair
from jaxsph.model import laws

SEMICIRCLE = {2: Semicircle.of(2, 14.0), 3: Semicircle.of(3, 13.5)}
"""Semicircle kernel by number of dimensions, with the value of beta, a multiple of 0.5, that minimises the
spurious stress of a square or cubic lattice in pure strain (`lattice_stress`) for the kernel's `SUPPORT`."""

POLYNOMIAL = {
    2: Polynomial.of(2, (0.105, -0.263, 1.275, -1.800, 2.533, -1.482, 0.632), 3),
    3: Polynomial.of(3, (0.351, -1.609, 5.447, -8.853, 9.339, -4.994, 1.319), 3),
}
"""Polynomial kernel by number of dimensions, with the coefficients of `least_stress(dim, support)` rounded to
three decimals."""

KERNEL = {2: POLYNOMIAL[2], 3: SEMICIRCLE[3]}
"""Default kernel by number of dimensions.

In two dimensions the default kernel has half as many neighbours as a Gaussian with a smoothing length of
1.2 dx. In three dimensions it has as many neighbours as Wendland's kernel with h = 1.5 dx (Yeylaghi et al.
2016, section 2). Hyperviscosity dissipates less of a wave's energy with the default kernel than with the
Gaussian in two dimensions and with Wendland's kernel in three (`python -m experiments run quiet_water`).

Well below the surface the lattice buckles with the semicircle (`lattice_stress`), but not with the
polynomial. In still water in three dimensions the particles at the surface are almost at rest with the
semicircle, but not with the polynomial.
"""

KernelName = Literal["gaussian", "wendland", "semicircle", "polynomial"]
"""Name of a kernel in a case."""

NAMED: dict[int, dict[KernelName, AbstractKernel]] = {
    dim: {
        "gaussian": Gaussian(),
        "wendland": WendlandC2(),
        "semicircle": SEMICIRCLE[dim],
        "polynomial": POLYNOMIAL[dim],
    }
    for dim in (2, 3)
}
"""Kernels by number of dimensions and name."""

SUPPORT = {Semicircle: {2: 3.05, 3: 3.0}, Polynomial: {2: 3.05, 3: 3.025}}
"""Ratio of support radius to spacing (-), by kernel and number of dimensions."""

STEP_LENGTH = {2: 1.2, 3: 1.5}
"""Ratio of the length in the Courant condition to the spacing (-), by number of dimensions, for any kernel.

In a time step a particle may move by `cfl` times this length.
"""


def usual_length(kernel: AbstractKernel, dim: int) -> float:
    """Ratio of the default smoothing length of a kernel to the spacing (-), in `dim` dimensions.

    For Wendland's kernel the ratio is 2 in two dimensions, so that a square lattice stays at rest. In three
    dimensions the ratio is 1.5 (Yeylaghi et al. 2016, section 2).
    """
    if isinstance(kernel, WendlandC2):
        return {2: 2.0, 3: 1.5}[dim]
    if type(kernel) in SUPPORT:
        return SUPPORT[type(kernel)][dim] / kernel.reach
    return 1.2 * kernel.width


class LatticeSums(NamedTuple):
    """Sums of a kernel over a full lattice, and over a lattice below a flat surface."""

    full: Scalar
    """Sum V W of the kernel over a full lattice, including the particle itself (-)."""
    weights: Scalar
    """Sum of the Laplacian's weights over a full lattice, times h^2 (-)."""
    lacks: Scalar
    """Share of the kernel's sum that is missing at the second row below a surface (-)."""
    edges: tuple[Scalar, Scalar]
    """Sum V grad W, times dx, at the first and the second row below a surface (-); 0 in a full lattice."""


def lattice_sums(kernel: AbstractKernel, h_over_dx: float, dim: int) -> LatticeSums:
    """Sums of a kernel over a square or cubic lattice."""
    reach = int(np.ceil(kernel.reach * h_over_dx))
    axes = np.meshgrid(*(np.arange(-reach, reach + 1.0),) * dim)
    r2 = np.sum([a**2 for a in axes], axis=0)
    near = r2 < (kernel.reach * h_over_dx) ** 2
    return jax.tree.map(float, _summed(kernel, h_over_dx, dim, axes[-1][near], r2[near]))


@partial(jax.jit, static_argnums=2)
def _summed(kernel: AbstractKernel, h_over_dx: Scalar, dim: int, up: Array, r2: Array) -> LatticeSums:
    """Sums over the particles `up` spacings above the central particle, at the squared distances r2 (-)."""
    pair = Pair((), r2, kernel.slope(r2, h_over_dx, dim), kernel.value(r2, h_over_dx, dim))
    weights = laws.laplacian_weight(pair, {"V": 1.0}, (0.1 * h_over_dx) ** 2)
    full = jnp.sum(pair.W)
    first, second = (jnp.sum(jnp.where(up < above, pair.F * up, 0.0)) for above in (0.5, 1.5))
    lacks = jnp.sum(jnp.where(up > 1.5, pair.W, 0.0)) / full
    return LatticeSums(full, jnp.sum(weights) * h_over_dx**2, lacks, (first, second))
