"""Shapes made of others: joined, cut out of one another, moved and turned."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import shapely.affinity

from jaxsph.core.arrays import Array, Float
from jaxsph.solids.shapes import AbstractShape, plain_numbers


class Union(AbstractShape):
    """Shape of all points that are in one of several, in the x-z plane.

    Its distance is exact outside; inside, beside a seam, it is at most as far as to the surface.
    """

    shapes: tuple[AbstractShape, ...] = eqx.field(converter=tuple)
    """The shapes that are joined."""

    def distance(self, x):
        """See `AbstractShape`."""
        return jnp.min(jnp.stack([shape.distance(x) for shape in self.shapes]), axis=0)

    def bounds(self):
        """See `AbstractShape`."""
        low, high = zip(*(shape.bounds() for shape in self.shapes), strict=True)
        return np.min(low, axis=0), np.max(high, axis=0)

    def region(self):
        """See `AbstractShape`."""
        return shapely.union_all([shape.region() for shape in self.shapes])


class Difference(AbstractShape):
    """Shape of all points that are in one and not in another, in the x-z plane.

    Its distance is exact inside; outside, beside a seam, it is at most as far as to the surface.
    """

    whole: AbstractShape
    """The shape that is cut."""
    hole: AbstractShape
    """What is cut out of it."""

    def distance(self, x):
        """See `AbstractShape`."""
        return jnp.maximum(self.whole.distance(x), -self.hole.distance(x))

    def bounds(self):
        """See `AbstractShape`."""
        return self.whole.bounds()

    def region(self):
        """See `AbstractShape`."""
        return self.whole.region().difference(self.hole.region())


class Placed(AbstractShape):
    """Another shape, turned in the x-z plane and moved."""

    shape: AbstractShape
    """The shape in its own place."""
    by: Float[Array, "2"] = eqx.field(converter=plain_numbers, default=(0.0, 0.0))
    """Displacement (x, z), m."""
    angle: Float[Array, ""] = eqx.field(converter=plain_numbers, default=0.0)
    """Angle by which it is turned first, rad, positive from z towards x."""
    about: Float[Array, "2"] = eqx.field(converter=plain_numbers, default=(0.0, 0.0))
    """Point (x, z) about which it is turned, m."""

    def distance(self, x):
        """See `AbstractShape`."""
        by, angle, about = (jnp.asarray(a, x.dtype) for a in (self.by, self.angle, self.about))
        r = x - by - about
        c, s = jnp.cos(angle), jnp.sin(angle)
        back = jnp.stack([c * r[:, 0] - s * r[:, 1], c * r[:, 1] + s * r[:, 0]], axis=1)
        return self.shape.distance(back + about)

    def bounds(self):
        """See `AbstractShape`."""
        x0, z0, x1, z1 = self.region().bounds
        return np.array([x0, z0]), np.array([x1, z1])

    def region(self):
        """See `AbstractShape`."""
        x, z = np.asarray(self.about, float)
        # shapely turns counterclockwise with x to the right: from x towards z
        turned = shapely.affinity.rotate(
            self.shape.region(), -float(self.angle), origin=(x, z), use_radians=True
        )
        return shapely.affinity.translate(turned, *(float(a) for a in self.by))
