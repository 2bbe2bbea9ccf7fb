"""Body forces in addition to uniform gravity."""

from __future__ import annotations

import abc

import equinox as eqx
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Float, Scalar

FORCES = "forces"
"""Name of the work of body forces in the ledger."""


class AbstractForce(eqx.Module):
    """A body force in addition to uniform gravity: an acceleration field, which may change in time."""

    @abc.abstractmethod
    def acceleration(self, x: Float[Array, "N D"], t: Scalar) -> Float[Array, "N D"]:
        """Acceleration due to the body force at x (m) and the time t (s), m/s2."""

    def potential(self, x: Float[Array, "N D"]) -> Float[Array, " N"]:
        """Potential energy per unit mass at x (m), J/kg: zero, since the ledger contains the force's work."""
        return jnp.zeros_like(x[:, 0])

    def given(self, m: Float[Array, " N"], x: Array, u: Array, t: Scalar, dt: Scalar) -> Scalar:
        """Work of the force on the water over a step of dt (s), J (J/m in 2-D).

        **Arguments**: masses (kg; kg/m in 2-D), positions (m) and velocities (m/s) of the water in the middle
        of the step, at the time t (s).
        """
        return dt * jnp.sum(m * jnp.sum(self.acceleration(x, t) * u, axis=1))


class AbstractConservativeForce(AbstractForce):
    """A steady body force, whose work is stored as potential energy."""

    @abc.abstractmethod
    def potential(self, x: Float[Array, "N D"]) -> Float[Array, " N"]:
        """Potential energy per unit mass at x (m), J/kg: the acceleration is minus the gradient of the
        potential."""

    def given(self, m, x, u, t, dt):
        """See `AbstractForce.given`; zero, since the potential energy contains the work."""
        del m, x, u, t
        return jnp.zeros_like(dt)


class CentralForce(AbstractConservativeForce):
    """Central body force: an acceleration -omega^2 (x - centre) towards a centre.

    This force holds a drop together in Monaghan and Rafiee 2013, section 5.1.
    """

    omega: Scalar
    """Angular frequency of a free particle in the force field, rad/s."""
    centre: Float[Array, " D"]
    """Centre of the force, m."""

    def acceleration(self, x, t):
        """See `AbstractForce.acceleration`."""
        del t
        return -(self.omega**2) * (x - self.centre)

    def potential(self, x):
        """See `AbstractForce.potential`."""
        return 0.5 * self.omega**2 * jnp.sum((x - self.centre) ** 2, axis=1)
