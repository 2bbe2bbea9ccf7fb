"""Viscosities of a scheme: pair laws of the viscous force with their coefficients. Equation numbers are those
of Zhu et al. 2020."""

from __future__ import annotations

import abc

import equinox as eqx

from jaxsph.core.arrays import Components, Scalar, real
from jaxsph.core.pairs import Fields, Pair
from jaxsph.model import laws


class AbstractViscosity(eqx.Module):
    """A viscosity: the pair law of the viscous sum (Eq. 4 and 6), and its coefficient."""

    @abc.abstractmethod
    def coefficient(self, h: Scalar | float, c0: Scalar | float, dim: int) -> Scalar:
        """Coefficient of the viscous sum, m2/s."""

    @abc.abstractmethod
    def kinematic(self, h: Scalar | float, c0: Scalar | float, dim: int) -> Scalar:
        """Kinematic viscosity that the coefficient stands for, m2/s (Eq. 5)."""

    @abc.abstractmethod
    def shear(self, pair: Pair, i: Fields, j: Fields, guard: Scalar) -> Components:
        """Term of one pair in the viscous sum, 1/(m s), to be multiplied by the coefficient."""


class PhysicalViscosity(AbstractViscosity):
    """Physical viscosity nu in Monaghan's form, of coefficient 2 (dim + 2) nu (Eq. 6).

    On a square lattice with h = 1.2 dx it is up to 9 % too large, whatever dx is
    (`python -m experiments run taylor_green`); `LaplacianViscosity` is not.
    """

    nu: Scalar = eqx.field(converter=real)
    """Kinematic viscosity, m2/s."""

    def coefficient(self, h, c0, dim):
        """See `AbstractViscosity`."""
        return 2 * (dim + 2) * self.nu

    def kinematic(self, h, c0, dim):
        """See `AbstractViscosity`."""
        return self.nu

    def shear(self, pair, i, j, guard):
        """See `AbstractViscosity`."""
        return laws.viscous_force(pair, i, j, guard)


class LaplacianViscosity(AbstractViscosity):
    """Physical viscosity nu lap u in Morris's form, 2 nu sum (u_i - u_j) (r.grad W)/r^2 V_j.

    Source: Morris et al. 1997, Eq. 22. For flows that the physical viscosity governs: the weights of
    Monaghan's form (`PhysicalViscosity`) are not smooth at r = 0, and a square lattice sums them 9 % off;
    here it need only sum the kernel's second moments. Angular momentum is not kept, and at a free surface
    the form stands for du/dn = 0, not for no stress: it dissipates nu |grad u|^2, which in a wave is half of
    what the viscosity should.
    """

    nu: Scalar = eqx.field(converter=real)
    """Kinematic viscosity, m2/s."""

    def coefficient(self, h, c0, dim):
        """See `AbstractViscosity`."""
        return 2 * self.nu

    def kinematic(self, h, c0, dim):
        """See `AbstractViscosity`."""
        return self.nu

    def shear(self, pair, i, j, guard):
        """See `AbstractViscosity`."""
        return laws.laplacian(pair, i, j)


class ArtificialViscosity(AbstractViscosity):
    """Artificial viscosity of coefficient alpha h c0 (Eq. 4)."""

    alpha: Scalar = eqx.field(converter=real)
    """Coefficient of the artificial viscosity (-)."""

    def coefficient(self, h, c0, dim):
        """See `AbstractViscosity`."""
        return self.alpha * h * c0

    def kinematic(self, h, c0, dim):
        """See `AbstractViscosity`."""
        return self.alpha * h * c0 / (2 * (dim + 2))

    def shear(self, pair, i, j, guard):
        """See `AbstractViscosity`."""
        return laws.viscous_force(pair, i, j, guard)
