"""Smoothing kernels W and their slope factors F = (dW/dr)/r; the gradient is grad W = F (x_i - x_j).

W and F are functions of r^2, so that a kernel that depends only on r^2 needs no square root. F is finite at
r = 0.
"""

from __future__ import annotations

import abc
import functools
import math
from collections.abc import Sequence
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

from jaxsph.core.arrays import Array, Float


class AbstractKernel(eqx.Module):
    """A radial smoothing kernel of smoothing length h (m) that vanishes for r >= `reach` * h."""

    width: eqx.AbstractClassVar[float]
    """Ratio of the kernel's smoothing length to the smoothing length of the Gaussian that the kernel replaces
    (-)."""
    reach: eqx.AbstractVar[float]
    """Ratio of the support radius to h (-)."""

    @abc.abstractmethod
    def value(self, r2: Float[Array, "..."], h: ArrayLike, dim: int) -> Float[Array, "..."]:
        """Kernel W(r), m^-dim, from r2 = r^2 (m2). The caller sets W to zero for r >= reach * h."""

    @abc.abstractmethod
    def slope(self, r2: Float[Array, "..."], h: ArrayLike, dim: int) -> Float[Array, "..."]:
        """Slope factor F = (dW/dr)/r <= 0, m^-(dim+2), from r2 = r^2 (m2).

        The caller sets F to zero for r >= reach * h.
        """


class Gaussian(AbstractKernel):
    """Gaussian kernel exp(-r^2/h^2) / (pi^(dim/2) h^dim), truncated at `reach` * h.

    The truncated kernel is not renormalised. Truncation at 3.5h reduces its integral by 5e-6 in two
    dimensions and by 2e-5 in three dimensions.

    The truncation leaves a step of exp(-reach^2) times W(0). Because of this step a lattice under pressure
    resists deformation, which causes noise. With the truncation at 3.5h a standing wave loses less than
    0.1 % of its amplitude in a second (`python -m experiments run standing_wave`); with a truncation at 3h
    the wave lost 1.9 %.
    """

    width: ClassVar[float] = 1.0
    reach: float = eqx.field(static=True, default=3.5)

    def value(self, r2, h, dim):
        """See `AbstractKernel.value`."""
        return jnp.exp(-r2 / (h * h)) / (math.pi ** (dim / 2) * h**dim)

    def slope(self, r2, h, dim):
        """See `AbstractKernel.slope`."""
        return self.value(r2, h, dim) * (-2.0 / (h * h))


class WendlandC2(AbstractKernel):
    """Wendland's C2 kernel (1 - q/2)^4 (1 + 2q), q = r/h, with support 2h, in two and three dimensions.

    Source: Wendland (1995). The kernel is normalised to an integral of 1.
    """

    width: ClassVar[float] = 1.5
    reach: float = eqx.field(static=True, default=2.0)

    def value(self, r2, h, dim):
        """See `AbstractKernel.value`."""
        # The square root needs r > 0 for a finite derivative; the guard changes W by about 1e-12 of W(0).
        q = jnp.sqrt(r2 / (h * h) + 1e-12)
        return _wendland_constant(dim) / h**dim * (1.0 - 0.5 * q) ** 4 * (1.0 + 2.0 * q)

    def slope(self, r2, h, dim):
        """See `AbstractKernel.slope`."""
        q = jnp.sqrt(r2 / (h * h) + 1e-12)
        return -5.0 * _wendland_constant(dim) / h ** (dim + 2) * (1.0 - 0.5 * q) ** 3


def _wendland_constant(dim: int) -> float:
    return {2: 7.0 / (4.0 * math.pi), 3: 21.0 / (16.0 * math.pi)}[dim]


class Semicircle(AbstractKernel):
    """Exponential of a semicircle, C exp(beta (sqrt(1 - (r/R)^2) - 1)), with support R = `reach` h.

    Source: Barnett, Magland and af Klinteberg (2019), SIAM J. Sci. Comput. 41, for the non-uniform Fourier
    transform. Beyond a given wavenumber the kernel's Fourier transform is nearly the smallest of all kernels
    with the same support. With this kernel a square or cubic particle lattice therefore resists deformation
    less than with other kernels that have twice as many neighbours (`lattice.lattice_stress`). h is the
    smoothing length of the Gaussian with the same second moment.

    At the edge W is exp(-beta) times W(0), and the slope is infinite. Therefore W and its slope factor are
    constant within 5e-5 R of the edge.
    """

    width: ClassVar[float] = 1.0
    reach: float = eqx.field(static=True)
    beta: float = eqx.field(static=True, default=14.0)
    """Logarithm of the ratio of W at the centre to W at the edge (-)."""

    @classmethod
    def of(cls, dim: int, beta: float = 14.0) -> Semicircle:
        """Kernel in `dim` dimensions with the second moment of the Gaussian, dim h^2/2."""
        second = _semicircle_moment(beta, dim + 2) / _semicircle_moment(beta, dim)
        return cls(math.sqrt(0.5 * dim / second), beta)

    def value(self, r2, h, dim):
        """See `AbstractKernel.value`."""
        R = self.reach * h
        sphere = {2: 2.0 * math.pi, 3: 4.0 * math.pi}[dim]
        scale = 1.0 / (sphere * _semicircle_moment(self.beta, dim))
        return scale / R**dim * jnp.exp(self.beta * (_semicircle(r2, R) - 1.0))

    def slope(self, r2, h, dim):
        """See `AbstractKernel.slope`."""
        R = self.reach * h
        return self.value(r2, h, dim) * (-self.beta / (R * R)) / _semicircle(r2, R)


def _semicircle(r2: Float[Array, "..."], R: ArrayLike) -> Float[Array, "..."]:
    return jnp.sqrt(jnp.maximum(1.0 - r2 / (R * R), 1e-4))


@functools.cache
def _semicircle_moment(beta: float, n: int) -> float:
    """Integral of q^(n-1) exp(beta (sqrt(1 - q^2) - 1)) over q = r/R from 0 to 1."""
    nodes, weights = np.polynomial.legendre.leggauss(64)
    angle = 0.25 * math.pi * (nodes + 1.0)  # q = sin(angle) removes the singularity at q = 1
    q = np.sin(angle)
    return float(
        0.25 * math.pi * np.sum(weights * q ** (n - 1) * np.cos(angle) * np.exp(beta * (np.cos(angle) - 1.0)))
    )


class Polynomial(AbstractKernel):
    """Polynomial kernel, a sum of powers of 1 - (r/R)^2, with support R = `reach` h.

    The coefficients that `least_stress` finds depend on the number of dimensions. With these coefficients a
    square or cubic lattice of particles does not buckle under pressure, and resists deformation less than
    with other kernels that have twice as many neighbours. h is the smoothing length of the Gaussian with the
    same second moment.
    """

    width: ClassVar[float] = 1.0
    reach: float = eqx.field(static=True)
    shares: tuple[float, ...] = eqx.field(static=True)
    """Contribution of each power to the kernel's integral (-); the sum is one."""
    lowest: int = eqx.field(static=True)
    """Exponent of 1 - (r/R)^2 for the first share; the exponent increases by one from share to share."""

    @classmethod
    def of(cls, dim: int, shares: Sequence[float], lowest: int) -> Polynomial:
        """Kernel in `dim` dimensions with the second moment of the Gaussian, dim h^2/2."""
        # the mean of (r/R)^2 with the weight (1 - (r/R)^2)^n is D/(D + 2 n + 2)
        second = sum(share / (dim + 2 * n + 2) for n, share in enumerate(shares, lowest))
        return cls(math.sqrt(0.5 / second), tuple(shares), lowest)

    def value(self, r2, h, dim):
        """See `AbstractKernel.value`."""
        left, factors = self._parts(r2, h, dim)
        return left**self.lowest * _horner(factors, left)

    def slope(self, r2, h, dim):
        """See `AbstractKernel.slope`."""
        left, factors = self._parts(r2, h, dim)
        derived = [n * factor for n, factor in enumerate(factors, self.lowest)]
        return left ** (self.lowest - 1) * _horner(derived, left) * (-2.0 / (self.reach * h) ** 2)

    def _parts(self, r2, h, dim):
        """1 - (r/R)^2 in the support, 0 outside, and the coefficients of its powers (m^-dim)."""
        R = self.reach * h
        return jnp.maximum(1.0 - r2 / (R * R), 0.0), [
            share / power_integral(n, dim) / R**dim for n, share in enumerate(self.shares, self.lowest)
        ]


def power_integral(n: int, dim: int) -> float:
    """Integral of (1 - q^2)^n over the unit ball in `dim` dimensions (-)."""
    return math.pi ** (0.5 * dim) * math.gamma(n + 1.0) / math.gamma(n + 1.0 + 0.5 * dim)


def _horner(factors, x):
    """Value at x of the polynomial whose coefficients are `factors`, from the zeroth power up."""
    total = factors[-1]
    for factor in factors[-2::-1]:
        total = total * x + factor
    return total


def support(kernel: AbstractKernel, h: jax.Array | float) -> jax.Array | float:
    """Radius (m) beyond which a kernel of smoothing length h (m) is zero."""
    return kernel.reach * h
