"""Body forces beside the uniform gravity."""

from __future__ import annotations

import jax.numpy as jnp

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.model.interfaces import AbstractForce


class CentralForce(AbstractForce):
    """Central body force: an acceleration -omega^2 (x - centre) towards a centre.

    It holds a drop together in Monaghan and Rafiee 2013, section 5.1.
    """

    omega: Scalar
    """Angular frequency of a free particle in the force, rad/s."""
    centre: Float[Array, " D"]
    """Centre of the force, m."""

    def acceleration(self, x):
        """See `AbstractForce`."""
        return -(self.omega**2) * (x - self.centre)

    def potential(self, x):
        """See `AbstractForce`."""
        return 0.5 * self.omega**2 * jnp.sum((x - self.centre) ** 2, axis=1)
