"""Sponge layer at the tank's far end, which absorbs waves before they are reflected there."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from jaxsph.core.arrays import Scalar, real
from jaxsph.model.interfaces import AbstractDamper
from jaxsph.model.meaning import Entry


class Sponge(AbstractDamper):
    """Sponge layer that damps the water's velocities between x0 and x1 (Zhu et al. 2020, Eq. 27 and 28)."""

    x0: Scalar = eqx.field(converter=real)
    """Start of the layer, m."""
    x1: Scalar = eqx.field(converter=real)
    """End of the layer, m; greater than x0."""
    strength: Scalar = eqx.field(converter=real, default=10.0)
    """Damping rate at the end of the layer, 1/s."""

    name: str = eqx.field(static=True, default="sponge", kw_only=True)

    def entries(self):
        """See `AbstractPart`."""
        return {self.name: Entry(f"energy taken by the {self.name}")}

    def damp(self, x, u, t, dt):
        """See `AbstractDamper`."""
        return u * self.factor(x, dt)[:, None]

    def factor(self, x: Float[Array, "N D"], dt: ArrayLike) -> Float[Array, " N"]:
        """Factor on the velocities at x (m) in a step of dt (s), 0 to 1 (-), by Eq. 28; 1 outside x0..x1."""
        s = (x[:, 0] - self.x0) / (self.x1 - self.x0)
        inside = (s >= 0.0) & (s <= 1.0)
        damped = jnp.clip(1.0 - dt * self.strength * s**2, 0.0, 1.0)
        return jnp.where(inside, damped, 1.0)
