"""Viscosities of a scheme: pair laws of the viscous force, with their coefficients.

Equation numbers refer to Zhu et al. 2020.
"""

from __future__ import annotations

import abc

import equinox as eqx

from jaxsph.core.arrays import Components, Scalar, real
from jaxsph.core.pairs import Fields, Pair
from jaxsph.model import laws


class AbstractViscosity(eqx.Module):
    """Viscosity of a scheme: pair law of the viscous sum (Eq. 4 and 6), and coefficient of this sum."""

    @abc.abstractmethod
    def coefficient(self, h: Scalar | float, c0: Scalar | float, dim: int) -> Scalar:
        """Coefficient of the viscous sum, m2/s."""

    @abc.abstractmethod
    def kinematic(self, h: Scalar | float, c0: Scalar | float, dim: int) -> Scalar:
        """Kinematic viscosity that corresponds to the coefficient, m2/s (Eq. 5)."""

    @abc.abstractmethod
    def shear(self, pair: Pair, i: Fields, j: Fields, guard: Scalar) -> Components:
        """Term of one pair in the viscous sum, 1/(m s), to be multiplied by the coefficient."""


class PhysicalViscosity(AbstractViscosity):
    """Physical viscosity nu in Monaghan's form, with the coefficient 2 (dim + 2) nu (Eq. 6).

    On a square lattice with h = 1.2 dx the effective viscosity differs from nu by up to 9 % at every dx: it
    is too small in shear along the rows, and too large in shear along the diagonals. Where the particles have
    left the lattice the error is smaller, for example 1 % in the decay rate of the Taylor-Green vortex
    (`python -m experiments run taylor_green`). `LaplacianViscosity` does not have this error.
    """

    nu: Scalar = eqx.field(converter=real)
    """Kinematic viscosity, m2/s."""

    def coefficient(self, h, c0, dim):
        """See `AbstractViscosity.coefficient`."""
        return 2 * (dim + 2) * self.nu

    def kinematic(self, h, c0, dim):
        """See `AbstractViscosity.kinematic`."""
        return self.nu

    def shear(self, pair, i, j, guard):
        """See `AbstractViscosity.shear`."""
        return laws.viscous_force(pair, i, j, guard)


class LaplacianViscosity(AbstractViscosity):
    """Physical viscosity nu lap u in Morris's form, 2 nu sum (u_i - u_j) (r.grad W)/r^2 V_j.

    Source: Morris et al. 1997, Eq. 22. Use this form for flows governed by the physical viscosity. The
    weights of Monaghan's form (`PhysicalViscosity`) are not smooth at r = 0, and their sum over a square
    lattice has an error of up to 9 %; Morris's form only needs accurate sums of the kernel's second moments.
    Morris's form does not conserve angular momentum. At a free surface it implies du/dn = 0 instead of zero
    stress. The dissipated power per unit mass is nu |grad u|^2, which in a wave is half of the physical
    dissipation.
    """

    nu: Scalar = eqx.field(converter=real)
    """Kinematic viscosity, m2/s."""

    def coefficient(self, h, c0, dim):
        """See `AbstractViscosity.coefficient`."""
        return 2 * self.nu

    def kinematic(self, h, c0, dim):
        """See `AbstractViscosity.kinematic`."""
        return self.nu

    def shear(self, pair, i, j, guard):
        """See `AbstractViscosity.shear`."""
        return laws.laplacian(pair, i, j)


class ArtificialViscosity(AbstractViscosity):
    """Artificial viscosity with the coefficient alpha h c0 (Eq. 4)."""

    alpha: Scalar = eqx.field(converter=real)
    """Coefficient of the artificial viscosity (-)."""

    def coefficient(self, h, c0, dim):
        """See `AbstractViscosity.coefficient`."""
        return self.alpha * h * c0

    def kinematic(self, h, c0, dim):
        """See `AbstractViscosity.kinematic`."""
        return self.alpha * h * c0 / (2 * (dim + 2))

    def shear(self, pair, i, j, guard):
        """See `AbstractViscosity.shear`."""
        return laws.viscous_force(pair, i, j, guard)
