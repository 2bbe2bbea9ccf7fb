"""Shapes made of other shapes: joined, cut out of one another, translated and rotated."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import shapely.affinity

from jaxsph.core.arrays import Array, Float
from jaxsph.solids.shapes import AbstractShape, plain_numbers


class Union(AbstractShape):
    """Union of several shapes.

    `distance` is exact outside. Inside, near a seam, its magnitude may be too small.
    """

    shapes: tuple[AbstractShape, ...] = eqx.field(converter=tuple)
    """Shapes that are joined."""

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
    """A shape with another shape cut out of it.

    `distance` is exact inside. Outside, near a seam, its magnitude may be too small.
    """

    whole: AbstractShape
    """Shape that is cut."""
    hole: AbstractShape
    """Shape that is cut out of `whole`."""

    def distance(self, x):
        """See `AbstractShape`."""
        return jnp.maximum(self.whole.distance(x), -self.hole.distance(x))

    def bounds(self):
        """See `AbstractShape`."""
        return self.whole.bounds()

    def region(self):
        """See `AbstractShape`."""
        if len(self.bounds()[0]) == 3:  # a hole may end inside
            return super().region()
        return self.whole.region().difference(self.hole.region())


class Placed(AbstractShape):
    """A shape rotated in the x-z plane and then translated."""

    shape: AbstractShape
    """Shape before it is rotated and translated."""
    by: Float[Array, "2"] = eqx.field(converter=plain_numbers, default=(0.0, 0.0))
    """Displacement (x, z), m."""
    angle: Float[Array, ""] = eqx.field(converter=plain_numbers, default=0.0)
    """Rotation angle, rad, positive from z towards x; the rotation comes before the translation."""
    about: Float[Array, "2"] = eqx.field(converter=plain_numbers, default=(0.0, 0.0))
    """Centre (x, z) of the rotation, m."""

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
        # shapely rotates from x towards z (counterclockwise with x to the right)
        turned = shapely.affinity.rotate(
            self.shape.region(), -float(self.angle), origin=(x, z), use_radians=True
        )
        return shapely.affinity.translate(turned, *(float(a) for a in self.by))
