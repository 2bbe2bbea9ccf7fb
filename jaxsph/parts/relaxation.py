"""Relaxation zones, which generate given waves and absorb all others: at the near end and along the sides."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.model.interfaces import AbstractDamper
from jaxsph.model.meaning import Entry, Exchange
from jaxsph.parts.paddle import AbstractGivenMotion
from jaxsph.waves.base import AbstractWaves
from jaxsph.waves.fields import AbstractWaveField

__all__ = ["BasinZone", "FlowMotion", "RelaxationZone"]


class FlowMotion(AbstractGivenMotion):
    """Motion of the wall behind a relaxation zone, which follows the waves' depth-averaged flow."""

    waves: AbstractWaves
    """Waves that the zone generates."""

    def displacement(self, t):
        """See `AbstractGivenMotion`."""
        return self.waves.mean_displacement(t)


class RelaxationZone(AbstractDamper):
    """Relaxation zone, in which the water's velocities are relaxed towards the velocities of given waves.

    The relaxation rate falls smoothly from the near end to zero at the zone's end. Reflected waves are a
    deviation from the given waves, and the zone damps them as a sponge does. The method follows Jacobsen,
    Fuhrman and Fredsoe (2012) and Altomare et al. (2018), with two differences. Velocities are relaxed at a
    rate (1/s) instead of with a fixed weight in every step, so that the result does not depend on the time
    step. The wall behind the zone moves with the waves' depth-averaged flow.
    """

    waves: AbstractWaves
    """Waves that the zone generates."""
    length: Scalar
    """Length of the zone from the wall at rest, m."""
    strength: Scalar
    """Rate of relaxation towards the waves' velocities, at the near end, 1/s."""
    x: Float[Array, " X"]
    """Positions x of the grid on which the waves' velocities are evaluated, m, evenly spaced."""
    z: Float[Array, " Z"]
    """Heights of this grid above the bed, m, evenly spaced."""
    name: str = eqx.field(static=True, default="zone", kw_only=True)

    def entries(self):
        """See `AbstractPart`."""
        return {self.name: Entry("energy given by the relaxation zone", Exchange.GIVEN)}

    def weight(self, x: Float[Array, " N"]) -> Float[Array, " N"]:
        """Ratio of the rate at x (m) to `strength`, from 1 at the near end to 0 at the zone's end (-)."""
        return _fall(x, self.length)

    def asked(self, x: Float[Array, "N D"], t: Scalar) -> Float[Array, "N D"]:
        """Velocities of the given waves at x (m) and the time t (s), m/s."""
        u, w = _interpolated(
            self.waves.velocity(self.x, self.z, t), (self.x, self.z), x[:, jnp.array([0, -1])]
        )
        return jnp.zeros_like(x).at[:, 0].set(u).at[:, -1].set(w)

    def damp(self, x, u, t, dt):
        """See `AbstractDamper`."""
        share = -jnp.expm1(-dt * self.strength * self.weight(x[:, 0]))
        return u + share[:, None] * (self.asked(x, t) - u)


class BasinZone(AbstractDamper):
    """Relaxation zone along the near end and both side walls of a basin.

    Waves that bodies radiate sideways are a deviation from the given waves, and are absorbed. The given waves
    pass along the zones undisturbed. The side walls do not move with the flow of the given waves, and would
    reflect these waves; therefore the relaxation rate is highest at the walls. Where two zones overlap, the
    higher rate applies.
    """

    field: AbstractWaveField
    """Waves that the zone generates."""
    length: Scalar
    """Length of the zone at the near end, from the wall at rest, m."""
    sides: Scalar
    """Width of the zone along each side wall, m."""
    width: Scalar
    """Width of the basin, m."""
    strength: Scalar
    """Rate of relaxation towards the waves' velocities, at the near end, 1/s."""
    side_strength: Scalar
    """Rate at the side walls, 1/s; 0 without side zones."""
    x: Float[Array, " X"]
    """Positions x of the grid on which the waves' velocities are evaluated, m, evenly spaced."""
    y: Float[Array, " Y"]
    """Positions y of this grid, m, evenly spaced."""
    z: Float[Array, " Z"]
    """Heights of this grid above the bed, m, evenly spaced."""
    name: str = eqx.field(static=True, default="zone", kw_only=True)

    def entries(self):
        """See `AbstractPart`."""
        return {self.name: Entry("energy given by the relaxation zone", Exchange.GIVEN)}

    def rate(self, x: Float[Array, "N 3"]) -> Float[Array, " N"]:
        """Rate at x (m) at which velocities are relaxed towards the waves' velocities, 1/s."""
        near = self.strength * _fall(x[:, 0], self.length)
        wall = jnp.minimum(x[:, 1], self.width - x[:, 1])
        return jnp.maximum(near, self.side_strength * _fall(wall, self.sides))

    def asked(self, x: Float[Array, "N 3"], t: Scalar) -> Float[Array, "N 3"]:
        """Velocities of the given waves at x (m) and the time t (s), m/s."""
        nodes = (self.x, self.y, self.z)
        return jnp.stack(_interpolated(self.field.velocity(*nodes, t), nodes, x), axis=1)

    def damp(self, x, u, t, dt):
        """See `AbstractDamper`."""
        share = -jnp.expm1(-dt * self.rate(x))
        return u + share[:, None] * (self.asked(x, t) - u)


def _fall(x: Float[Array, " N"], length: Scalar) -> Float[Array, " N"]:
    """Factor (-) that falls smoothly from 1 at x = 0 to 0 at x = `length` (m)."""
    s = jnp.clip(1.0 - x / length, 0.0, 1.0)
    return s * s * (3.0 - 2.0 * s)


def _interpolated(
    fields: Float[Array, "F ..."], nodes: tuple[Array, ...], x: Float[Array, "N D"]
) -> list[Float[Array, " N"]]:
    """Values of each of the `fields` at x (m), interpolated linearly between evenly spaced `nodes` (m)."""
    at = [(x[:, axis] - a[0]) / (a[1] - a[0]) for axis, a in enumerate(nodes)]
    return [jax.scipy.ndimage.map_coordinates(a, at, order=1, mode="nearest") for a in fields]
