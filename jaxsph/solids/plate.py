"""Thin plate at any inclination, which keeps the water on its two sides apart."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import shapely

from jaxsph.core.arrays import Array, Float
from jaxsph.solids.box import LeaningPlate
from jaxsph.solids.shapes import AbstractShape, box_distance, plain_numbers


class Plate(AbstractShape):
    """Straight plate in the x-z plane; it may be thinner than the kernel's support.

    Each face has a separate set of dummy particles, as deep as the kernel's support (Zhu et al. 2020, section
    2.4.1). Only the water in front of a face sees the dummy particles of that face. The water on one side
    does not see the water on the other side.
    """

    foot: Float[Array, "2"] = eqx.field(converter=plain_numbers)
    """Midpoint (x, z) of one end of the plate, m."""
    head: Float[Array, "2"] = eqx.field(converter=plain_numbers)
    """Midpoint (x, z) of the other end of the plate, m."""
    thickness: Float[Array, ""] = eqx.field(converter=plain_numbers)
    """Thickness, m."""

    def distance(self, x):
        """See `AbstractShape`."""
        foot, head = (jnp.asarray(a, x.dtype) for a in (self.foot, self.head))
        length = jnp.sqrt(jnp.sum((head - foot) ** 2))
        e = (head - foot) / length
        r = x - 0.5 * (foot + head)
        along, across = r @ e, r[:, 0] * e[1] - r[:, 1] * e[0]
        half = jnp.stack([0.5 * length, 0.5 * jnp.asarray(self.thickness, x.dtype)])
        return box_distance(jnp.abs(jnp.stack([along, across], axis=1)) - half)

    def bounds(self):
        """See `AbstractShape`."""
        corners = self.outline()
        return corners.min(axis=0), corners.max(axis=0)

    def region(self):
        """See `AbstractShape`."""
        return shapely.Polygon(self.outline())

    def outline(self):
        """See `AbstractShape`."""
        foot, head, half = np.asarray(self.foot), np.asarray(self.head), 0.5 * float(self.thickness)
        ex, ez = np.asarray(self.straight().along)
        aside = half * np.array([ez, -ex])
        return np.array([foot + aside, head + aside, head - aside, foot - aside])

    def dividers(self):
        """See `AbstractShape`."""
        return (self.straight(),)

    def straight(self) -> LeaningPlate:
        """Geometry of the plate in plain numbers."""
        (x0, z0), (x1, z1) = np.asarray(self.foot).tolist(), np.asarray(self.head).tolist()
        return LeaningPlate((x0, z0), (x1, z1), float(self.thickness))
