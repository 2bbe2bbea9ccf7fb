"""Shapes swept by an outline in three dimensions: prism and solid of revolution."""

from __future__ import annotations

from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxsph.core.arrays import Array, Float
from jaxsph.solids.shapes import (
    AbstractShape,
    box_distance,
    inertia_tensor,
    outline_distance,
    plain_numbers,
)
from jaxsph.solids.volumes import RIM

NODES, WEIGHTS = np.polynomial.legendre.leggauss(3)
"""Gauss points between -1 and 1 and their weights, exact for polynomials of fifth degree."""


class Extrusion(AbstractShape):
    """Prism: an outline that is swept along a coordinate axis."""

    outline: Float[Array, "K 2"] = eqx.field(converter=plain_numbers)
    """Corners of the cross-section in order along its outline, m. A corner is given by the two coordinates
    normal to the prism's axis, in the order x, y, z."""
    ends: Float[Array, "2"] = eqx.field(converter=plain_numbers)
    """Lowest and highest coordinate along the prism, m."""
    axis: int = eqx.field(static=True, default=1)
    """Number of the axis along which the outline is swept: 0 for x, 1 for y, 2 for z."""

    def distance(self, x):
        """See `AbstractShape`."""
        low, high = jnp.asarray(self.ends, x.dtype)
        along = x[:, self.axis]
        across = outline_distance(jnp.delete(x, self.axis, axis=1), jnp.asarray(self.outline, x.dtype))
        return box_distance(jnp.stack([across, jnp.maximum(low - along, along - high)], axis=1))

    def bounds(self):
        """See `AbstractShape`."""
        outline, ends = np.asarray(self.outline), np.asarray(self.ends)
        return tuple(
            np.insert(corner, self.axis, end)
            for corner, end in ((outline.min(axis=0), ends[0]), (outline.max(axis=0), ends[1]))
        )

    def moments(self):
        """See `AbstractShape`."""
        outline, (low, high) = np.asarray(self.outline), np.asarray(self.ends)
        area = _integral(outline, lambda a, _: a)
        first = [_integral(outline, lambda a, _: a**2 / 2), _integral(outline, lambda a, b: a * b)]
        middle = np.array(first) / area
        second = [
            _integral(outline, lambda a, _: (a - middle[0]) ** 3 / 3),
            _integral(outline, lambda a, b: a * (b - middle[1]) ** 2),
        ]
        mixed = _integral(outline, lambda a, b: (a - middle[0]) ** 2 / 2 * (b - middle[1]))
        length, volume = high - low, abs(area) * (high - low)
        centre = np.insert(middle, self.axis, 0.5 * (low + high))
        # mean squared distances from the centroid along x, y and z, and the mean product in the plane
        mean = np.diag(np.insert(np.array(second) / area, self.axis, length**2 / 12))
        a, b = (axis for axis in range(3) if axis != self.axis)
        mean[a, b] = mean[b, a] = mixed / area
        return float(volume), tuple(map(float, centre)), inertia_tensor(volume * mean)


class Revolution(AbstractShape):
    """Solid of revolution about a vertical axis."""

    profile: Float[Array, "K 2"] = eqx.field(converter=plain_numbers)
    """Corners (r, z) of the profile, m, in order along its outline: distance from the axis, and height."""
    axis: Float[Array, "2"] = eqx.field(converter=plain_numbers)
    """Position (x, y) of the axis, m."""

    def distance(self, x):
        """See `AbstractShape`."""
        from_axis = x[:, :2] - jnp.asarray(self.axis, x.dtype)
        # the guard keeps the derivative finite on the axis
        r = jnp.sqrt(jnp.sum(from_axis**2, axis=1) + 1e-20)
        profile = jnp.asarray(self.profile, x.dtype)
        # a side along the axis is inside the solid
        on_axis = (profile[:, 0] <= 0.0) & (jnp.roll(profile[:, 0], -1) <= 0.0)
        return outline_distance(jnp.stack([r, x[:, 2]], axis=1), profile, ~on_axis)

    def bounds(self):
        """See `AbstractShape`."""
        (_, low), (r, high) = np.min(self.profile, axis=0), np.max(self.profile, axis=0)
        x, y = np.asarray(self.axis)
        return np.array([x - r, y - r, low]), np.array([x + r, y + r, high])

    def moments(self):
        """See `AbstractShape`."""
        profile = np.asarray(self.profile)
        ring = _integral(profile, lambda r, _: r**2 / 2)  # the integral of r dr dz
        height = _integral(profile, lambda r, z: r**2 / 2 * z) / ring
        # the mean of x^2 around a ring is r^2 / 2
        across = _integral(profile, lambda r, _: r**4 / 8)
        upright = _integral(profile, lambda r, z: r**2 / 2 * (z - height) ** 2)
        second = 2.0 * np.pi * np.diag(np.abs([across, across, upright]))
        centre = (*map(float, np.asarray(self.axis)), float(height))
        return float(abs(2.0 * np.pi * ring)), centre, inertia_tensor(second)

    def rims(self) -> np.ndarray:
        """Points `[K, 3]` (m) around the circles that the corners of the profile describe."""
        angle = np.linspace(0.0, 2.0 * np.pi, RIM, endpoint=False)
        ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(RIM)], axis=1)
        middle = np.array([*np.asarray(self.axis), 0.0])
        return np.concatenate([middle + r * ring + [0.0, 0.0, z] for r, z in np.asarray(self.profile)])


def _integral(corners: np.ndarray, primitive: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> float:
    """Integral over the area (a, b) inside an outline, positive for corners that turn from a towards b.

    `primitive(a, b)`, a polynomial of at most fourth degree, is the integral of the integrand with respect
    to a (Green's theorem).
    """
    ends = np.roll(corners, -1, axis=0)
    middle, half = 0.5 * (ends + corners), 0.5 * (ends - corners)
    a, b = (middle[:, None] + NODES[:, None] * half[:, None]).transpose(2, 0, 1)
    return float(np.sum(primitive(a, b) * WEIGHTS * half[:, None, 1]))
