"""What every scheme does at a step beside its own equations: tables, walls filled, moving particles without
losing what rounding takes, and flags of what has gone wrong."""

from __future__ import annotations

import abc

import equinox as eqx

from jaxsph.core.arrays import Components, Scalar, real
from jaxsph.core.pairs import Fields, Pair
from jaxsph.model import laws


class AbstractViscosity(eqx.Module):
    """The viscous sum (Eq. 4 and 6): a pair law and its coefficient."""

    @abc.abstractmethod
    def coefficient(self, h: Scalar, c0: Scalar, dim: int) -> Scalar:
        """m2/s."""

    @abc.abstractmethod
    def kinematic(self, h: Scalar, c0: Scalar, dim: int) -> Scalar:
        """The kinematic viscosity it stands for (Eq. 5), m2/s."""

    @abc.abstractmethod
    def shear(self, pair: Pair, i: Fields, j: Fields, guard: Scalar) -> Components:
        """What the coefficient multiplies, per pair, 1/(m s)."""


class PhysicalViscosity(AbstractViscosity):
    """Eq. 6: 2 (dim + 2) nu. On a square lattice with h = 1.2 dx it is up to 9 % too large, whatever dx is
    (`python -m experiments run taylor_green`): see `LaplacianViscosity`."""

    nu: Scalar = eqx.field(converter=real)

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
    """nu lap u as 2 nu sum (u_i - u_j) (r.grad W)/r^2 V_j (Morris et al. 1997, Eq. 22): exact viscosity.

    For flows that the physical viscosity governs. The weights of Monaghan's form are not smooth at r = 0,
    and a square lattice sums them 9 % off; here it need only sum the kernel's second moments. Angular
    momentum is not kept, and at a free surface it stands for du/dn = 0, not for no stress: it dissipates
    nu |grad u|^2, half of what it should in a wave.
    """

    nu: Scalar = eqx.field(converter=real)

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
    """Eq. 4: alpha h c0."""

    alpha: Scalar = eqx.field(converter=real)

    def coefficient(self, h, c0, dim):
        """See `AbstractViscosity`."""
        return self.alpha * h * c0

    def kinematic(self, h, c0, dim):
        """See `AbstractViscosity`."""
        return self.alpha * h * c0 / (2 * (dim + 2))

    def shear(self, pair, i, j, guard):
        """See `AbstractViscosity`."""
        return laws.viscous_force(pair, i, j, guard)
