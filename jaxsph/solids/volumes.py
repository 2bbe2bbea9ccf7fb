"""Round shapes in three dimensions: sphere, cylinder and capsule."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxsph.core.arrays import Array, Float
from jaxsph.solids.shapes import AbstractBall, AbstractShape, box_distance, plain_numbers

RIM = 64
"""Number of points around an end of a cylinder."""


class Sphere(AbstractBall):
    """Sphere."""

    def moments(self):
        """See `AbstractShape`."""
        r = float(self.radius)
        volume = 4.0 / 3.0 * np.pi * r**3
        return volume, tuple(map(float, np.asarray(self.centre))), 0.4 * volume * r**2 * np.eye(3)


class AbstractBar(AbstractShape):
    """Circular cylinder in any direction; the subclasses define the form of the ends."""

    foot: Float[Array, "3"] = eqx.field(converter=plain_numbers)
    """Middle (x, y, z) of one end of the cylinder, m."""
    head: Float[Array, "3"] = eqx.field(converter=plain_numbers)
    """Middle (x, y, z) of the other end of the cylinder, m."""
    radius: Float[Array, ""] = eqx.field(converter=plain_numbers)
    """Radius, m."""

    def _axis(self) -> tuple[np.ndarray, float]:
        """Unit vector from the foot to the head, and the distance (m) between them."""
        along = np.asarray(self.head) - np.asarray(self.foot)
        length = float(np.linalg.norm(along))
        return along / length, length

    def _moments(self, volume: float, about_axis: float, across: float):
        """Moments as in `AbstractShape.moments`, from the volume (m3) and its second moments (m5) about the
        axis, and about a line through the middle at right angles to the axis."""
        middle = 0.5 * (np.asarray(self.foot) + np.asarray(self.head))
        along = np.outer(self._axis()[0], self._axis()[0])
        return volume, tuple(map(float, middle)), about_axis * along + across * (np.eye(3) - along)


class Cylinder(AbstractBar):
    """Circular cylinder in any direction, with flat ends."""

    def distance(self, x):
        """See `AbstractShape`."""
        foot, head = jnp.asarray(self.foot, x.dtype), jnp.asarray(self.head, x.dtype)
        length = jnp.sqrt(jnp.sum((head - foot) ** 2))
        axis = (head - foot) / length
        along = jnp.sum((x - foot) * axis, axis=1)
        across = jnp.sqrt(jnp.sum((x - foot - along[:, None] * axis) ** 2, axis=1) + 1e-20)
        beyond = jnp.maximum(-along, along - length)
        return box_distance(jnp.stack([across - jnp.asarray(self.radius, x.dtype), beyond], axis=1))

    def bounds(self):
        """See `AbstractShape`."""
        foot, head, (axis, _) = np.asarray(self.foot), np.asarray(self.head), self._axis()
        rim = float(self.radius) * np.sqrt(np.maximum(1.0 - axis**2, 0.0))
        return np.minimum(foot, head) - rim, np.maximum(foot, head) + rim

    def moments(self):
        """See `AbstractShape`."""
        r, (_, length) = float(self.radius), self._axis()
        volume = np.pi * r**2 * length
        return self._moments(volume, 0.5 * volume * r**2, volume * (0.25 * r**2 + length**2 / 12.0))

    def rims(self) -> np.ndarray:
        """Points `[K, 3]` (m) around both ends."""
        axis, _ = self._axis()
        across = np.linalg.svd(axis[None])[2][1:]  # two unit vectors at right angles to the axis
        angle = np.linspace(0.0, 2.0 * np.pi, RIM, endpoint=False)
        ring = float(self.radius) * np.stack([np.cos(angle), np.sin(angle)], -1) @ across
        return np.concatenate([np.asarray(end) + ring for end in (self.foot, self.head)])


class Capsule(AbstractBar):
    """Circular cylinder in any direction, with hemispherical ends centred at its foot and head."""

    def distance(self, x):
        """See `AbstractShape`."""
        foot, head = jnp.asarray(self.foot, x.dtype), jnp.asarray(self.head, x.dtype)
        axis = head - foot
        along = jnp.clip(jnp.sum((x - foot) * axis, axis=1) / jnp.sum(axis**2), 0.0, 1.0)
        away = x - foot - along[:, None] * axis
        return jnp.sqrt(jnp.sum(away**2, axis=1) + 1e-20) - jnp.asarray(self.radius, x.dtype)

    def bounds(self):
        """See `AbstractShape`."""
        ends, r = np.stack([np.asarray(self.foot), np.asarray(self.head)]), float(self.radius)
        return ends.min(axis=0) - r, ends.max(axis=0) + r

    def moments(self):
        """See `AbstractShape`."""
        r, (_, length) = float(self.radius), self._axis()
        side, ends = np.pi * r**2 * length, 4.0 / 3.0 * np.pi * r**3
        about_axis = 0.5 * side * r**2 + 0.4 * ends * r**2
        # the centroid of a hemisphere is 3/8 of the radius beyond its flat face
        beyond = 0.5 * length * (0.5 * length + 0.75 * r)
        across = side * (0.25 * r**2 + length**2 / 12.0) + ends * (0.4 * r**2 + beyond)
        return self._moments(side + ends, about_axis, across)
