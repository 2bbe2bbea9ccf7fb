"""What acts on the water or is acted on by it: the piston wavemaker, the OWC chamber and its PTO.

Signs (in everything here): `P_a` is the gauge pressure of the chamber's air, positive when compressed;
`q` is the volume flow of air out of the chamber, positive when the water column rises; the PTO takes
P_a q from the water, which is never negative.
"""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Components, Float, Scalar
from jaxsph.waves.absorption import ActiveAbsorption
from jaxsph.waves.regular import RegularWaves


class Wavemaker(eqx.Module):
    """A piston that makes regular waves, with or without active absorption (Eq. 22-23)."""

    waves: RegularWaves
    absorption: ActiveAbsorption | None
    gauge: Scalar
    """Distance (m) from the paddle's face at which the elevation is measured for absorption."""
    still: Scalar
    """Depth (m) that the gauge reads in still water."""

    def move(self, paddle: Float[Array, "4"], t: Scalar, dt: Scalar, elevation: Scalar) -> Float[Array, "4"]:
        """`State.paddle` at t + dt; `elevation` (m) is read at t."""
        if self.absorption is None:
            X, U = self.waves.paddle_displacement(t + dt), self.waves.paddle_velocity(t + dt)
            return jnp.stack([X, U, jnp.zeros_like(X), jnp.zeros_like(X)])
        # The filter makes up for the gauge standing in front of the paddle, and takes out its noise.
        expected = self.absorption.gauge_elevation(self.waves, t)
        lag = self.absorption.filter_time(self.waves)
        error = paddle[2] + dt / (lag + dt) * (expected - elevation - paddle[2])
        # Standing waves lower the mean level by a fraction of a millimetre: nothing to absorb, and the
        # paddle would creep for it.
        mean = paddle[3] + dt * self.absorption.drift_rate * (error - paddle[3])
        eta = self.absorption.gauge_elevation(self.waves, t + dt) - (error - mean)
        U = self.absorption.velocity(self.waves, paddle[0], t + dt, eta)
        return jnp.stack([paddle[0] + dt * U, U, error, mean])

    def elevation(self, x: Components, V: Float[Array, " N"], paddle: jax.Array, width: Scalar):
        """Elevation (m) at the gauge, over still water; V: volumes per metre of the tank's width, m2."""
        return column_depth(x, V, paddle[0] + self.gauge, width) - self.still


def column_depth(x: Components, V: Float[Array, " N"], at: Scalar, width: Scalar) -> Scalar:
    """Depth of water (m) at x = `at`: the volume of a column, averaged over a width.

    A cosine bell of half-width `width` weighs the particles, which is smooth in their positions and
    conserves volume. With a whole number of spacings as `width` a lattice reads the same wherever the
    gauge stands on it. A wave of wavenumber k is damped by 0.065 (k width)^2: 0.1 % at k width = 0.12.
    """
    s = (x[0] - at) / width
    bell = jnp.where(jnp.abs(s) < 1.0, 0.5 * (1.0 + jnp.cos(jnp.pi * s)), 0.0) / width
    return jnp.sum(V * bell)
