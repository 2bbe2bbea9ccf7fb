"""Shapes made of other shapes: joined, cut out of one another, translated and rotated."""

from __future__ import annotations

from types import ModuleType
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import shapely

from jaxsph.core.arrays import Array, Float
from jaxsph.solids.shapes import AbstractShape, box_corners_of, plain_numbers


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
    """A shape that is rotated and then translated."""

    shape: AbstractShape
    """Shape before it is rotated and translated."""
    by: Float[Array, "*D"] = eqx.field(converter=plain_numbers, default=0.0)
    """Displacement along the axes, m."""
    angle: Float[Array, "*A"] = eqx.field(converter=plain_numbers, default=0.0)
    """Rotation angle, rad, positive from z towards x. In three dimensions the angles about the x-, y- and
    z-axis, in this order; a single angle is the angle about the y-axis."""
    about: Float[Array, "*D"] = eqx.field(converter=plain_numbers, default=0.0)
    """Centre of the rotation, m."""

    @classmethod
    def about_middle(cls, shape: AbstractShape, angle: Any) -> Placed:
        """The shape, rotated about the middle of its bounds."""
        low, high = shape.bounds()
        return cls(shape, angle=angle, about=tuple(0.5 * (low + high)))

    def distance(self, x):
        """See `AbstractShape`."""
        by, about = (jnp.asarray(a, x.dtype) for a in (self.by, self.about))
        back = (x - by - about) @ _rotation(jnp.asarray(self.angle, x.dtype), x.shape[1])
        return self.shape.distance(back + about)

    def bounds(self):
        """See `AbstractShape`."""
        low, high = self.shape.bounds()
        if len(low) == 3:
            corners = self.moved(box_corners_of(low, high))
            return corners.min(axis=0), corners.max(axis=0)
        x0, z0, x1, z1 = self.region().bounds
        return np.array([x0, z0]), np.array([x1, z1])

    def region(self):
        """See `AbstractShape`."""
        if len(self.shape.bounds()[0]) == 3:
            return super().region()
        return shapely.transform(self.shape.region(), self.moved)

    def moved(self, points: np.ndarray) -> np.ndarray:
        """Positions `[K, D]` (m), after rotation and translation, of points (m) of the shape."""
        return rotated(points, self.angle, self.about) + np.asarray(self.by, float)


def rotated(points: np.ndarray, angle: Any, about: Any) -> np.ndarray:
    """Positions `[K, D]` (m) of points (m) after a rotation; `angle` (rad) and `about` (m) as in `Placed`."""
    centre = np.asarray(about, float)
    rotation = np.asarray(_rotation(np.asarray(angle, float), points.shape[1], np))
    return (points - centre) @ rotation.T + centre


def _rotation(angle: Any, dim: int, np: ModuleType = jnp) -> Any:
    """Rotation matrix `[D, D]` of the angles of `Placed` (rad), computed by the array library `np`."""
    about_y = angle if angle.ndim == 0 else angle[1]
    c, s, one, zero = np.cos(about_y), np.sin(about_y), np.ones_like(about_y), np.zeros_like(about_y)
    if dim == 2:
        return np.stack([np.stack([c, s]), np.stack([-s, c])])
    found = np.stack([np.stack([c, zero, s]), np.stack([zero, one, zero]), np.stack([-s, zero, c])])
    if angle.ndim == 0:
        return found
    (cx, sx), (cz, sz) = ((np.cos(a), np.sin(a)) for a in (angle[0], angle[2]))
    about_x = np.stack([np.stack([one, zero, zero]), np.stack([zero, cx, -sx]), np.stack([zero, sx, cx])])
    about_z = np.stack([np.stack([cz, -sz, zero]), np.stack([sz, cz, zero]), np.stack([zero, zero, one])])
    return about_z @ found @ about_x
