"""Pure pair laws, the equation of state and body forces. A law sees one pair (`pairs.Pair`) and the fields
of its two particles; equation numbers are those of Zhu et al. 2020.

Fields: x (m), u (m/s), rho (kg/m3, the deviation from rho0), p (Pa), V (m3 per m of width in 2-D; a
negative sign marks a wall's source, which takes no part in the density diffusion), grad_rho (kg/m4).
"""

from __future__ import annotations

import jax.numpy as jnp

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.model.interfaces import AbstractForce


class CentralForce(AbstractForce):
    """-omega^2 (x - centre): what holds a drop together in Monaghan and Rafiee 2013, section 5.1."""

    omega: Scalar
    """rad/s."""
    centre: Float[Array, " D"]
    """m."""

    def acceleration(self, x):
        """See `AbstractForce`."""
        return -(self.omega**2) * (x - self.centre)

    def potential(self, x):
        """See `AbstractForce`."""
        return 0.5 * self.omega**2 * jnp.sum((x - self.centre) ** 2, axis=1)
