"""Shapes of solids: distance from the surface, moments of the volume, and dummy particles."""

from __future__ import annotations

import abc
import itertools
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import scipy  # which imports its subpackages on first use
import shapely
from shapely.validation import explain_validity

from jaxsph.core.arrays import Array, Bool, Float
from jaxsph.core.points import at_points
from jaxsph.solids.box import LeaningPlate
from jaxsph.solids.cells import SLIVER, area_inside, cell_dummies, cells_of, silhouette, solid_moments

SHARP = 0.3
"""Turning angle of an outline (rad) above which a corner gets a particle; a regular polygon with 21
sides turns by 0.3 at each corner."""

PARTS = 4
"""Number of subdivisions of a spacing in the search for parts of a shape without dummy particles."""

ALONE = 0.8
"""Distance from the nearest particle of the layers, in spacings, beyond which a part of a shape gets another
dummy particle; the corner of a cell is 0.71 spacings from the cell's centre."""


def plain_numbers(given: Any) -> Any:
    """Converts plain numbers to a double-precision array that a model may cast; keeps JAX arrays."""
    return np.asarray(given, float) if isinstance(given, (float, int, tuple, list)) else given


FINE = 240
"""Number of grid intervals along each axis for finding the outline of a shape."""


class AbstractShape(eqx.Module):
    """Shape of a solid in its position at rest.

    To define a shape, implement `distance` and `bounds`. All other quantities follow from the surface, where
    the distance is zero: in the x-z plane from the outline, in three dimensions from sums over a grid. The
    numbers of a shape are leaves of the model.
    """

    @abc.abstractmethod
    def distance(self, x: Float[Array, "N D"]) -> Float[Array, " N"]:
        """Distance of points x (m) from the surface, m; negative inside."""

    @abc.abstractmethod
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest corner (m) of a box that encloses the shape."""

    def region(self) -> Any:
        """Area of the shape in the x-z plane, as a geometry of `shapely` with lengths in m.

        In three dimensions the area is the projection of the shape along y.
        """
        low, high = self.bounds()
        if len(low) == 3:
            return silhouette(self.distance, low, high)
        margin = 0.02 * np.max(high - low)
        ends = [np.linspace(a - margin, b + margin, FINE + 1) for a, b in zip(low, high, strict=True)]
        points = np.stack(np.meshgrid(*ends, indexing="ij"), -1)
        away = at_points(self.distance, points.reshape(-1, 2), float).reshape(points.shape[:2])
        return area_inside(ends[0], ends[1], away)

    def moments(self) -> tuple[float, tuple[float, ...], Any]:
        """Volume, centre and inertia per unit density of the shape.

        **Returns** the volume (m3; area, m2, in 2-D), the centre `[D]` (m), and the second moment about the
        centre: a number (m4) in 2-D, the inertia tensor `[3, 3]` (m5) in 3-D.
        """
        low, high = self.bounds()
        if len(low) == 3:
            volume, centre, second = solid_moments(self.distance, low, high)
            return volume, centre, inertia_tensor(second)
        whole = self.region()
        centre = np.array([whole.centroid.x, whole.centroid.y])
        second = 0.0
        for part in _parts(whole):
            second += _second_moment(part.exterior, centre)
            second -= sum(_second_moment(hole, centre) for hole in part.interiors)
        return whole.area, (float(centre[0]), float(centre[1])), second

    def dummies(self, dx: float, layers: int) -> tuple[np.ndarray, np.ndarray]:
        """Positions `[B, D]` (m) and volumes `[B]` (m^D) of the dummy particles behind the surface.

        The dummy particles form layers a spacing dx (m) apart and are about dx apart within a layer. Further
        dummy particles fill parts that the layers do not reach, for example sharp edges. Each dummy particle
        represents the part of the shape, down to the last layer, that is nearer to it than to the others. The
        particle has the volume of this part and lies at the part's centroid. In three dimensions the dummy
        particles are cells of the lattice (`jaxsph.solids.cells`).
        """
        if len(self.bounds()[0]) == 3:
            return cell_dummies(self.distance, self.bounds(), self.moments()[0], dx, layers)
        whole, found = self.region(), [np.zeros((0, 2))]
        for layer in range(layers):
            for part in _parts(_inset(whole, (layer + 0.5) * dx)):
                found += [_along(ring, dx) for ring in (part.exterior, *part.interiors)]
        x = _apart(np.concatenate(found), 0.6 * dx)
        behind = whole.difference(_inset(whole, layers * dx))
        at = _small_parts(behind, dx)
        alone = at[scipy.spatial.KDTree(x).query(at)[0] > ALONE * dx] if len(x) else at
        x = np.concatenate([x, dx * (np.unique(np.floor(alone / dx), axis=0) + 0.5)])
        cells = _nearest(x, behind)
        volume = shapely.area(cells)
        kept = volume > SLIVER * dx**2
        return shapely.get_coordinates(shapely.centroid(cells[kept])), volume[kept]

    def dividers(self) -> tuple[LeaningPlate, ...]:
        """Thin plates that keep the water on their two sides apart; empty for a thick shape."""
        return ()

    def outline(self) -> np.ndarray:
        """Corners (x, z) `[K, 2]` of the outline that is drawn in pictures, m."""
        largest = max(_parts(self.region()), key=lambda part: part.area, default=shapely.Polygon())
        return np.asarray(largest.exterior.coords).reshape(-1, 2)[:-1]


class Block(AbstractShape):
    """Box with faces normal to the axes, in two or three dimensions."""

    low: Float[Array, " D"] = eqx.field(converter=plain_numbers)
    """Lowest coordinates along the axes, m."""
    high: Float[Array, " D"] = eqx.field(converter=plain_numbers)
    """Highest coordinates along the axes, m."""

    def distance(self, x):
        """See `AbstractShape`."""
        low, high = jnp.asarray(self.low, x.dtype), jnp.asarray(self.high, x.dtype)
        beyond = jnp.maximum(low - x, x - high)
        return box_distance(beyond)

    def bounds(self):
        """See `AbstractShape`."""
        return np.asarray(self.low), np.asarray(self.high)

    def region(self):
        """See `AbstractShape`. The area is the section in the x-z plane."""
        return shapely.Polygon(self.outline())

    def moments(self):
        """See `AbstractShape`."""
        low, high = self.bounds()
        volume, middle, squares = float(np.prod(high - low)), 0.5 * (low + high), (high - low) ** 2 / 12
        centre = tuple(map(float, middle))
        if len(low) == 2:
            return volume, centre, volume * float(squares.sum())
        return volume, centre, inertia_tensor(volume * np.diag(squares))

    def dummies(self, dx, layers):
        """See `AbstractShape`."""
        low, high = self.bounds()
        parts = []
        for a, b, start in zip(low, high, cells_of(low, high, dx), strict=True):
            parts.append((np.maximum(start, a), np.minimum(start + dx, b)))
        starts, ends = (np.stack(np.meshgrid(*e, indexing="ij"), -1) for e in zip(*parts, strict=True))
        x, volume = 0.5 * (starts + ends), np.prod(ends - starts, axis=-1)
        depth = np.min(np.minimum(x - low, high - x), axis=-1)
        kept = (volume > SLIVER * dx ** len(low)) & (depth < layers * dx)
        return x[kept], volume[kept]

    def outline(self):
        """See `AbstractShape`."""
        low, high = self.bounds()
        return box_corners((low[0], low[-1]), (high[0], high[-1]))


class Polygon(AbstractShape):
    """Polygon in the x-z plane."""

    vertices: Float[Array, "K 2"] = eqx.field(converter=plain_numbers)
    """Corners (x, z) in order around the polygon, m."""

    def __check_init__(self) -> None:
        """Checks the corners. **Raises** ValueError if the sides cross or touch each other."""
        if isinstance(self.vertices, np.ndarray):
            whole = shapely.Polygon(self.vertices)
            if not whole.is_valid:
                raise ValueError(
                    f"vertices: the sides must not cross or touch each other ({explain_validity(whole)})"
                )

    def distance(self, x):
        """See `AbstractShape`."""
        return outline_distance(x, jnp.asarray(self.vertices, x.dtype))

    def bounds(self):
        """See `AbstractShape`."""
        vertices = np.asarray(self.vertices)
        return vertices.min(axis=0), vertices.max(axis=0)

    def region(self):
        """See `AbstractShape`."""
        return shapely.Polygon(np.asarray(self.vertices))


def inertia_tensor(second: np.ndarray) -> np.ndarray:
    """Inertia tensor `[3, 3]` (m5) from the integrals of x x^T about the centre, `[3, 3]` (m5)."""
    return np.trace(second) * np.eye(3) - second


class AbstractBall(AbstractShape):
    """All points up to a distance from a centre: a disc in the x-z plane, a sphere in three dimensions."""

    centre: Float[Array, " D"] = eqx.field(converter=plain_numbers)
    """Centre, (x, z) or (x, y, z), m."""
    radius: Float[Array, ""] = eqx.field(converter=plain_numbers)
    """Radius, m."""

    def distance(self, x):
        """See `AbstractShape`."""
        away = x - jnp.asarray(self.centre, x.dtype)
        # the guard keeps the derivative finite at the centre
        return jnp.sqrt(jnp.sum(away**2, axis=1) + 1e-20) - jnp.asarray(self.radius, x.dtype)

    def bounds(self):
        """See `AbstractShape`."""
        return np.asarray(self.centre) - float(self.radius), np.asarray(self.centre) + float(self.radius)


class Disc(AbstractBall):
    """Disc in the x-z plane, the cross-section of a circular cylinder."""

    def region(self):
        """See `AbstractShape`.

        The region is approximated by a polygon with 1000 corners, because unions and differences need
        polygons.
        """
        angle = np.linspace(0.0, 2.0 * np.pi, 1000, endpoint=False)
        return shapely.Polygon(np.asarray(self.centre) + float(self.radius) * _circle(angle))

    def moments(self):
        """See `AbstractShape`."""
        area = float(np.pi * float(self.radius) ** 2)
        x, z = np.asarray(self.centre)
        return area, (float(x), float(z)), 0.5 * area * float(self.radius) ** 2


def outline_distance(
    x: Float[Array, "N 2"], corners: Float[Array, "K 2"], counted: Bool[Array, " K"] | bool = True
) -> Float[Array, " N"]:
    """Distance of points x (m) in a plane from an outline, m; negative inside.

    `corners`: corners of the outline in order, m; `counted`: which of its sides, each from one corner to the
    next, belong to the surface. The distance is to the nearest of these sides; its sign follows from all
    sides.
    """
    b = jnp.roll(corners, -1, axis=0)
    edge, there = b - corners, x[:, None, :] - corners
    along = jnp.clip(jnp.sum(there * edge, -1) / jnp.sum(edge**2, -1), 0.0, 1.0)
    squares = jnp.sum((there - along[..., None] * edge) ** 2, -1)
    nearest = jnp.min(jnp.where(counted, squares, jnp.inf), axis=1)
    above = corners[:, 1] > x[:, None, 1]
    across = above != (b[:, 1] > x[:, None, 1])
    rise = jnp.where(edge[:, 1] == 0, 1.0, edge[:, 1])
    crossing = corners[:, 0] + (x[:, None, 1] - corners[:, 1]) / rise * edge[:, 0]
    inside = jnp.sum(across & (x[:, None, 0] < crossing), axis=1) % 2 == 1
    return jnp.where(inside, -1.0, 1.0) * jnp.sqrt(nearest + 1e-20)


def box_distance(beyond: Float[Array, "N D"]) -> Float[Array, " N"]:
    """Distance of points from a box's surface, m, negative inside.

    `beyond`: distances of the points beyond the box's faces along each axis, m; negative inside.
    """
    # the guard keeps the derivative finite where the root is zero
    outside = jnp.sqrt(jnp.sum(jnp.maximum(beyond, 0.0) ** 2, axis=1) + 1e-20)
    return outside + jnp.minimum(jnp.max(beyond, axis=1), 0.0)


def box_corners(low: tuple[float, float], high: tuple[float, float]) -> np.ndarray:
    """Corners `[4, 2]` (m) of a box in the x-z plane."""
    (x0, z0), (x1, z1) = low, high
    return np.array([[x0, z0], [x1, z0], [x1, z1], [x0, z1]])


def box_corners_of(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Corners `[2^D, D]` (m) of the box between two opposite corners (m)."""
    return np.stack(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), -1).reshape(-1, len(low))


def _circle(angle: np.ndarray) -> np.ndarray:
    """Points `[K, 2]` of the unit circle."""
    return np.stack([np.cos(angle), np.sin(angle)], -1)


def _parts(region: Any) -> list[shapely.Polygon]:
    """Polygons that make up a region of `shapely`."""
    parts = getattr(region, "geoms", [region])
    return [part for part in parts if isinstance(part, shapely.Polygon) and not part.is_empty]


def _second_moment(ring: shapely.LinearRing, about: np.ndarray) -> float:
    """Second moment (m4) of a ring's area about a point (m), summed over one triangle for every side."""
    a = np.asarray(ring.coords)[:-1] - about
    b = np.roll(a, -1, axis=0)
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return abs(float(np.sum(cross * np.sum(a * a + a * b + b * b, axis=1)) / 12))


def _apart(x: np.ndarray, distance: float) -> np.ndarray:
    """Removes points (m) until all are `distance` (m) or more apart; keeps the first of two close points."""
    keep = np.ones(len(x), bool)
    close = scipy.spatial.KDTree(x).query_pairs(distance, output_type="ndarray")
    for earlier, later in close[np.lexsort((close[:, 0], close[:, 1]))]:
        keep[later] &= not keep[earlier]
    return x[keep]


def _inset(region: Any, depth: float) -> Any:
    """Part of a region of `shapely` that is more than `depth` (m) inside its outline."""
    return region.buffer(-depth, join_style="mitre", mitre_limit=20.0)


def _boxes(low: np.ndarray, side: float) -> Any:
    """Squares as `shapely` polygons, from their low corners `[K, 2]` (m) and their side (m)."""
    (x0, z0), (x1, z1) = low.T, (low + side).T
    return shapely.box(x0, z0, x1, z1)


def _nearest(x: np.ndarray, region: Any) -> np.ndarray:
    """Voronoi cells of the points `[K, 2]` (m), cut to a region of `shapely`."""
    low, high = np.reshape(region.bounds, (2, 2))
    # four points far away make the cells of all others finite
    far = 0.5 * (low + high) + 10.0 * np.max(high - low) * np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]])
    diagram = scipy.spatial.Voronoi(np.concatenate([x, far]))
    corners = (diagram.vertices[diagram.regions[k]] for k in diagram.point_region[: len(x)])
    return shapely.intersection(np.array([shapely.Polygon(one) for one in corners]), region)


def _small_parts(region: Any, dx: float) -> np.ndarray:
    """Centroids `[K, 2]` (m) of the parts into which cells of side dx / `PARTS` (m) divide a region."""
    low, high = np.reshape(region.bounds, (2, 2))
    cells = np.stack(np.meshgrid(*cells_of(low, high, dx), indexing="ij"), -1).reshape(-1, 2)
    shapely.prepare(region)
    cells = cells[shapely.intersects(region, _boxes(cells, dx))]
    fine = np.arange(PARTS) * dx / PARTS
    within = np.stack(np.meshgrid(fine, fine, indexing="ij"), -1).reshape(-1, 2)
    cells = (cells[:, None] + within).reshape(-1, 2)
    part = _boxes(cells, dx / PARTS)
    cut = ~shapely.contains_properly(region, part)
    part[cut] = shapely.intersection(part[cut], region)
    part = part[shapely.area(part) > 0.0]
    return shapely.get_coordinates(shapely.centroid(part))


def _along(line: shapely.LinearRing, dx: float) -> np.ndarray:
    """Points (m) about dx (m) apart along a closed line, with a point at each sharp corner of the line."""
    corners = np.asarray(line.coords)[:-1]
    side = np.roll(corners, -1, axis=0) - corners
    before = np.roll(side, 1, axis=0)
    turn = np.arctan2(before[:, 0] * side[:, 1] - before[:, 1] * side[:, 0], np.sum(before * side, axis=1))
    sharp = np.flatnonzero(np.abs(turn) > SHARP)
    first = int(sharp[0]) if len(sharp) else 0
    ring = np.concatenate([np.roll(corners, -first, axis=0), corners[first : first + 1]])
    ends = [*(sharp - first), len(corners)] if len(sharp) else [0, len(corners)]
    found = []
    for start, end in itertools.pairwise(ends):
        stretch = ring[start : end + 1]
        length = np.append(0.0, np.cumsum(np.hypot(*np.diff(stretch, axis=0).T)))
        count = max(1, round(length[-1] / dx))
        at = np.arange(count) / count * length[-1]
        found.append(np.stack([np.interp(at, length, axis) for axis in stretch.T], axis=1))
    return np.concatenate(found)
