"""Sponge layers along the tank's walls, which absorb waves before the walls reflect them."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from jaxsph.core.arrays import Scalar, real
from jaxsph.model.interfaces import AbstractDamper
from jaxsph.model.meaning import Entry


class SpongeLayer(eqx.Module):
    """Layer along one wall, in which the damping rises from 0 at `start` to its largest rate at `end`."""

    start: Scalar = eqx.field(converter=real)
    """Coordinate of the layer's start, in the water, m."""
    end: Scalar = eqx.field(converter=real)
    """Coordinate of the layer's end, at the wall or behind the wall, m; may be less than `start`."""
    axis: int = eqx.field(static=True, default=0)
    """Axis of the coordinates: 0 along the tank, 1 across it."""

    def depth(self, x: Float[Array, "N D"]) -> Float[Array, " N"]:
        """Relative distance of points x (m) from the start, 1 at the end (-); 0 outside the layer."""
        s = (x[:, self.axis] - self.start) / (self.end - self.start)
        return jnp.where((s >= 0.0) & (s <= 1.0), s, 0.0)


class Sponge(AbstractDamper):
    """Sponge that damps the water's velocities in one or several layers (Zhu et al. 2020, Eq. 27 and 28).

    Where layers overlap, the higher rate applies.
    """

    layers: tuple[SpongeLayer, ...]
    """Layers along the walls."""
    strength: Scalar = eqx.field(converter=real, default=10.0)
    """Damping rate at the end of every layer, 1/s."""

    name: str = eqx.field(static=True, default="sponge", kw_only=True)

    def entries(self):
        """See `AbstractPart`."""
        return {self.name: Entry(f"energy absorbed by the {self.name}")}

    def damp(self, x, u, t, dt):
        """See `AbstractDamper`."""
        return u * self.factor(x, dt)[:, None]

    def factor(self, x: Float[Array, "N D"], dt: ArrayLike) -> Float[Array, " N"]:
        """Factor by which the velocities at x (m) are multiplied in a step of dt (s), 0 to 1 (-), by Eq. 28;
        1 outside the layers."""
        s = jnp.max(jnp.stack([layer.depth(x) for layer in self.layers]), axis=0)
        return jnp.clip(1.0 - dt * self.strength * s**2, 0.0, 1.0)
