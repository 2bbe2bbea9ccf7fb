"""Relaxation zone at the tank's near end, which generates given waves and absorbs reflected ones."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.model.interfaces import AbstractDamper
from jaxsph.model.meaning import Entry, Exchange
from jaxsph.parts.paddle import AbstractGivenMotion
from jaxsph.waves.base import AbstractWaves

__all__ = ["FlowMotion", "RelaxationZone"]


class FlowMotion(AbstractGivenMotion):
    """Motion of the wall behind a relaxation zone, which follows the waves' depth-averaged flow."""

    waves: AbstractWaves
    """Waves that the zone generates."""

    def displacement(self, t):
        """See `AbstractGivenMotion`."""
        return self.waves.mean_displacement(t)


class RelaxationZone(AbstractDamper):
    """Relaxation zone, in which the water's velocities are relaxed towards the velocities of given waves.

    The rate falls smoothly from the near end to zero at the zone's end. Reflected waves are a deviation from
    the given waves, and the zone damps them as a sponge does. The method follows Jacobsen, Fuhrman and
    Fredsoe (2012) and Altomare et al. (2018), with two differences: a rate replaces the mixing of velocities,
    so that the result does not depend on the time step, and the wall behind the zone moves with the waves'
    mean flow.
    """

    waves: AbstractWaves
    """Waves that the zone generates."""
    length: Scalar
    """Length of the zone from the wall at rest, m."""
    strength: Scalar
    """Rate at the near end at which velocities are relaxed towards the waves' velocities, 1/s."""
    x: Float[Array, " X"]
    """Positions along the tank of the grid on which the waves' velocities are evaluated, m, evenly spaced."""
    z: Float[Array, " Z"]
    """Heights of this grid above the bed, m, evenly spaced."""
    name: str = eqx.field(static=True, default="zone", kw_only=True)

    def entries(self):
        """See `AbstractPart`."""
        return {self.name: Entry("energy given by the relaxation zone", Exchange.GIVEN)}

    def weight(self, x: Float[Array, " N"]) -> Float[Array, " N"]:
        """Ratio of the rate at x (m) to `strength`, from 1 at the near end to 0 at the zone's end (-)."""
        s = jnp.clip(1.0 - x / self.length, 0.0, 1.0)
        return s * s * (3.0 - 2.0 * s)

    def asked(self, x: Float[Array, "N D"], t: Scalar) -> Float[Array, "N D"]:
        """Velocities of the given waves at x (m) and the time t (s), m/s."""
        found = self.waves.velocity(self.x, self.z, t)
        at = [(x[:, axis] - nodes[0]) / (nodes[1] - nodes[0]) for axis, nodes in ((0, self.x), (-1, self.z))]
        u, w = (jax.scipy.ndimage.map_coordinates(a, at, order=1, mode="nearest") for a in found)
        return jnp.zeros_like(x).at[:, 0].set(u).at[:, -1].set(w)

    def damp(self, x, u, t, dt):
        """See `AbstractDamper`."""
        share = -jnp.expm1(-dt * self.strength * self.weight(x[:, 0]))
        return u + share[:, None] * (self.asked(x, t) - u)
