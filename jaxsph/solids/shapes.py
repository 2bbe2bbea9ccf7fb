"""Shapes of solids: the distance from their surface, their volume's moments, and their dummy particles."""

from __future__ import annotations

import abc
import itertools

import contourpy
import equinox as eqx
import jax.numpy as jnp
import numpy as np
import shapely
from scipy.spatial import KDTree

from jaxsph.core.arrays import Array, Float


class AbstractShape(eqx.Module):
    """Shape of a solid in its place at rest."""

    @abc.abstractmethod
    def distance(self, x: Float[Array, "N D"]) -> Float[Array, " N"]:
        """Distance of points x (m) from the surface, m; negative inside."""

    @abc.abstractmethod
    def moments(self) -> tuple[float, tuple[float, float], float]:
        """Volume, centre and second moment of the shape, for motion in the x-z plane.

        **Returns** the volume (m3; area, m2, in 2-D), the centre's (x, z) (m), and the second moment about
        the centre for turning in the x-z plane (m5; m4 in 2-D).
        """

    @abc.abstractmethod
    def dummies(self, dx: float, layers: int) -> np.ndarray:
        """Positions `[B, D]` (m) of dummy particles behind the surface, in layers a spacing dx (m) apart."""

    def outline(self) -> np.ndarray:
        """Corners `[K, 2]` (x, z) (m) of the shape in pictures, by default along its distance of zero."""
        volume, (x, z), second = self.moments()
        # twice the radius of gyration about the centre reaches around any convex shape
        reach = 3.0 * np.sqrt(second / volume)
        ends = [np.linspace(at - reach, at + reach, 161) for at in (x, z)]
        points = np.stack(np.meshgrid(*ends, indexing="ij"), -1)
        away = np.asarray(self.distance(jnp.asarray(points.reshape(-1, 2)))).reshape(points.shape[:2])
        lines = contourpy.contour_generator(x=ends[0], y=ends[1], z=away.T).lines(0.0)
        return np.asarray(max(lines, key=len, default=np.zeros((0, 2))))


class Block(AbstractShape):
    """Box with faces across the axes, in two or three dimensions."""

    low: tuple[float, ...] = eqx.field(static=True)
    """Low ends along the axes, m."""
    high: tuple[float, ...] = eqx.field(static=True)
    """High ends along the axes, m."""

    def distance(self, x):
        """See `AbstractShape`."""
        low, high = jnp.asarray(self.low, x.dtype), jnp.asarray(self.high, x.dtype)
        beyond = jnp.maximum(low - x, x - high)
        # the guard is for the derivative on an edge
        outside = jnp.sqrt(jnp.sum(jnp.maximum(beyond, 0.0) ** 2, axis=1) + 1e-20)
        return outside + jnp.minimum(jnp.max(beyond, axis=1), 0.0)

    def moments(self):
        """See `AbstractShape`."""
        low, high = np.asarray(self.low), np.asarray(self.high)
        volume, middle = float(np.prod(high - low)), 0.5 * (low + high)
        square = (high - low)[0] ** 2 + (high - low)[-1] ** 2
        return volume, (float(middle[0]), float(middle[-1])), volume * float(square) / 12

    def dummies(self, dx, layers):
        """See `AbstractShape`."""
        axes = []
        for a, b in zip(self.low, self.high, strict=True):
            count = max(1, round((b - a) / dx))
            axes.append(a + (np.arange(count) + 0.5) * (b - a) / count)
        x = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, len(axes))
        depth = np.min(np.minimum(x - self.low, np.asarray(self.high) - x), axis=1)
        return x[depth < layers * dx]

    def outline(self):
        """See `AbstractShape`."""
        return box_corners((self.low[0], self.low[-1]), (self.high[0], self.high[-1]))


class Polygon(AbstractShape):
    """Polygon in the x-z plane."""

    vertices: tuple[tuple[float, float], ...] = eqx.field(static=True)
    """Corners (x, z) in their order around it, m."""

    def distance(self, x):
        """See `AbstractShape`."""
        a = jnp.asarray(self.vertices, x.dtype)
        b = jnp.roll(a, -1, axis=0)
        edge, there = b - a, x[:, None, :] - a
        along = jnp.clip(jnp.sum(there * edge, -1) / jnp.sum(edge**2, -1), 0.0, 1.0)
        nearest = jnp.min(jnp.sum((there - along[..., None] * edge) ** 2, -1), axis=1)
        above = a[:, 1] > x[:, None, 1]
        across = above != (b[:, 1] > x[:, None, 1])
        rise = jnp.where(edge[:, 1] == 0, 1.0, edge[:, 1])
        crossing = a[:, 0] + (x[:, None, 1] - a[:, 1]) / rise * edge[:, 0]
        inside = jnp.sum(across & (x[:, None, 0] < crossing), axis=1) % 2 == 1
        return jnp.where(inside, -1.0, 1.0) * jnp.sqrt(nearest + 1e-20)

    def moments(self):
        """See `AbstractShape`: sums over the triangles from the centre to every side."""
        whole = shapely.Polygon(self.vertices)
        centre = np.array([whole.centroid.x, whole.centroid.y])
        a = np.asarray(self.vertices) - centre
        b = np.roll(a, -1, axis=0)
        cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
        second = np.sum(cross * np.sum(a * a + a * b + b * b, axis=1)) / 12
        return whole.area, (float(centre[0]), float(centre[1])), abs(float(second))

    def dummies(self, dx, layers):
        """See `AbstractShape`."""
        whole = shapely.Polygon(self.vertices)
        found = []
        for layer in range(layers):
            inset = whole.buffer(-(layer + 0.5) * dx, join_style="mitre", mitre_limit=20.0)
            for part in getattr(inset, "geoms", [inset]):
                if not part.is_empty:
                    found.append(_along(part.exterior, dx))
        x = np.concatenate(found)
        # where insets come close to each other the points of the later ones are left out
        keep = np.ones(len(x), bool)
        close = KDTree(x).query_pairs(0.6 * dx, output_type="ndarray")
        for earlier, later in close[np.lexsort((close[:, 0], close[:, 1]))]:
            keep[later] &= not keep[earlier]
        return x[keep]

    def outline(self):
        """See `AbstractShape`."""
        return np.asarray(self.vertices, float)


class Disc(AbstractShape):
    """Disc in the x-z plane: the section of a circular cylinder across it."""

    centre: tuple[float, float] = eqx.field(static=True)
    """Centre (x, z), m."""
    radius: float = eqx.field(static=True)
    """Radius, m."""

    def distance(self, x):
        """See `AbstractShape`."""
        away = x - jnp.asarray(self.centre, x.dtype)
        return jnp.sqrt(jnp.sum(away**2, axis=1) + 1e-20) - self.radius

    def moments(self):
        """See `AbstractShape`."""
        area = float(np.pi * self.radius**2)
        return area, self.centre, 0.5 * area * self.radius**2

    def dummies(self, dx, layers):
        """See `AbstractShape`."""
        found = []
        for layer in range(layers):
            r = self.radius - (layer + 0.5) * dx
            if r > 0:
                angle = np.linspace(0.0, 2 * np.pi, max(1, round(2 * np.pi * r / dx)), endpoint=False)
                found.append(np.asarray(self.centre) + r * np.stack([np.cos(angle), np.sin(angle)], -1))
        return np.concatenate(found)


def box_corners(low: tuple[float, float], high: tuple[float, float]) -> np.ndarray:
    """Corners `[4, 2]` (m) of a box in the x-z plane."""
    (x0, z0), (x1, z1) = low, high
    return np.array([[x0, z0], [x1, z0], [x1, z1], [x0, z1]])


def _along(line: shapely.LinearRing, dx: float) -> np.ndarray:
    """Points (m) about dx (m) apart along every side of a closed line, its corners included."""
    corners = np.asarray(line.coords)
    found = []
    for a, b in itertools.pairwise(corners):
        count = max(1, round(float(np.hypot(*(b - a))) / dx))
        found.append(a + (np.arange(count) / count)[:, None] * (b - a))
    return np.concatenate(found)
