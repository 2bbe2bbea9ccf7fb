"""Water waves on constant depth: theory, the piston that makes them, and their absorption.

Linear and second-order Stokes waves, the transfer function of a piston wavemaker with
its second-order correction, active absorption at the paddle and a sponge layer at the
far end. Equation numbers are those of Zhu et al. (2020) unless another source is named.

Conventions: SI units; x from the paddle's rest position, positive into the tank; z from
the BED, so that z = d is the still water level; a crest passes x = 0 at t = 0. The
paddle's displacement X is positive into the tank, and a paddle velocity
U = (omega / Phi) eta makes the progressive elevation eta (Phi: `biesel`).
"""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from jaxsph.core.arrays import Scalar, real
from jaxsph.model.interfaces import AbstractDamper, Entry


class Sponge(AbstractDamper):
    """Layer that takes velocity out of the particles at the far end, Eqs 27 and 28."""

    x0: Scalar = eqx.field(converter=real)
    """Start of the layer, m."""
    x1: Scalar = eqx.field(converter=real)
    """End of the layer, m; greater than x0."""
    strength: Scalar = eqx.field(converter=real, default=10.0)
    """Damping rate at the end of the layer, 1/s."""

    name: str = eqx.field(static=True, default="sponge", kw_only=True)

    def entries(self):
        """See `AbstractDamper`."""
        return {self.name: Entry(f"energy taken by the {self.name}")}

    def factor(self, x: Float[Array, "N D"], dt: ArrayLike) -> Float[Array, " N"]:
        """See `AbstractDamper`: Eq. 28; 1 outside x0..x1."""
        s = (x[:, 0] - self.x0) / (self.x1 - self.x0)
        inside = (s >= 0.0) & (s <= 1.0)
        damped = jnp.clip(1.0 - dt * self.strength * s**2, 0.0, 1.0)
        return jnp.where(inside, damped, 1.0)
