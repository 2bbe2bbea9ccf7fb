"""Volume, silhouette and dummy particles of a three-dimensional shape, from distances on a grid."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import contourpy
import numpy as np
import scipy  # which imports its subpackages on first use
import shapely

from jaxsph.core.points import at_points

FINE = 96
"""Number of grid intervals along the longest side of a shape, for its volume and its silhouette."""

PARTS = 6
"""Number of subdivisions of a lattice cell along every axis, where the surface of a shape cuts the cell."""

LEAST = 0.15
"""Fraction of a lattice cell (-); a smaller part of a shape is added to the nearest larger part."""

SLIVER = 1e-4
"""Fraction of a cell (-); a smaller part of a shape is a rounding error and has no dummy particle."""

Distance = Callable[[Any], Any]
"""Function that returns the distances (m) of points `[N, 3]` (m) from a surface, negative inside."""


def cells_of(low: np.ndarray, high: np.ndarray, dx: float) -> list[np.ndarray]:
    """Low ends (m), along every axis, of the lattice cells of side dx (m) that cover a box."""
    ends = zip(np.floor(low / dx + SLIVER), np.ceil(high / dx - SLIVER), strict=True)
    return [np.arange(first, max(last, first + 1)) * dx for first, last in ends]


def area_inside(x: np.ndarray, z: np.ndarray, away: np.ndarray) -> Any:
    """Region in which `away` `[X, Z]` on the grid of x and z (m) is negative, as a geometry of `shapely`."""
    found: Any = contourpy.contour_generator(x=x, y=z, z=away.T).lines(0.0)
    whole = shapely.Polygon()
    for line in sorted((shapely.Polygon(one) for one in found), key=lambda one: -one.area):
        whole = whole.symmetric_difference(line)  # a line inside another one is the outline of a hole
    return whole


def silhouette(distance: Distance, low: np.ndarray, high: np.ndarray) -> Any:
    """Projection of a shape along y onto the x-z plane, as an area of `shapely` with lengths in m."""
    (x, y, z), away = _grid(distance, low, high)
    return area_inside(x, z, away.reshape(len(x), len(y), len(z)).min(axis=1))


def solid_moments(
    distance: Distance, low: np.ndarray, high: np.ndarray
) -> tuple[float, tuple[float, ...], np.ndarray]:
    """Volume (m3), centre (m) and second moments `[3, 3]` about the centre (m5) of a shape."""
    axes, away = _grid(distance, low, high)
    side = axes[0][1] - axes[0][0]
    volume = side**3 * _inside(away, side)
    points = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    centre = volume @ points / volume.sum()
    arm = points - centre
    return float(volume.sum()), tuple(map(float, centre)), (volume[:, None] * arm).T @ arm


def cell_dummies(
    distance: Distance, bounds: tuple[np.ndarray, np.ndarray], total: float, dx: float, layers: int
) -> tuple[np.ndarray, np.ndarray]:
    """Positions `[B, 3]` (m) and volumes `[B]` (m3) of dummy particles: the lattice cells inside a surface.

    A cell that the surface cuts has the volume of its part inside, and its particle lies at the centroid of
    this part. All cells inside the surface together have exactly the volume `total` (m3); only the cells up
    to `layers` spacings dx (m) deep are returned.
    """
    corners = np.meshgrid(*cells_of(*bounds, dx), indexing="ij")
    middle = np.stack(corners, -1).reshape(-1, 3) + 0.5 * dx
    away, reach = at_points(distance, middle, float), 0.5 * np.sqrt(3.0) * dx
    core = middle[away <= -reach]
    x, volume = _cut(distance, middle[np.abs(away) < reach], dx)
    kept = volume > SLIVER * dx**3
    x, volume = x[kept], volume[kept]
    volume *= (total - len(core) * dx**3) / volume.sum()
    x, volume = _merged(np.concatenate([core, x]), np.append(np.full(len(core), dx**3), volume), dx)
    shallow = at_points(distance, x, float) > -layers * dx
    return x[shallow], volume[shallow]


def _cut(distance: Distance, middle: np.ndarray, dx: float) -> tuple[np.ndarray, np.ndarray]:
    """Centroids (m) and volumes (m3) of the parts inside a surface, for cells with the given middles (m)."""
    fine = (np.arange(PARTS) + 0.5) * dx / PARTS - 0.5 * dx
    within = np.stack(np.meshgrid(fine, fine, fine, indexing="ij"), -1).reshape(-1, 3)
    points = middle[:, None] + within
    away = at_points(distance, points.reshape(-1, 3), float).reshape(len(middle), -1)
    share = _inside(away, dx / PARTS)
    count = share.sum(axis=1)
    centroid = np.einsum("kp,kpd->kd", share, points) / np.maximum(count, 1e-12)[:, None]
    return centroid, count * (dx / PARTS) ** 3


def _grid(distance: Distance, low: np.ndarray, high: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
    """Axes (m) of a grid of cubes around a shape, and the distances (m) of all its points."""
    side = float(np.max(high - low)) / FINE
    counts = np.ceil((high - low) / side) + 3
    axes = [a - side + side * np.arange(count) for a, count in zip(low, counts, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    return axes, at_points(distance, points, float)


def _inside(away: np.ndarray, side: float) -> np.ndarray:
    """Fraction of each cube's volume inside a surface (-).

    **Arguments**: distances `away` of the cubes' centres from the surface, negative inside, m; edge length
    `side` of a cube, m.
    """
    return np.clip(0.5 - away / side, 0.0, 1.0)


def _merged(x: np.ndarray, volume: np.ndarray, dx: float) -> tuple[np.ndarray, np.ndarray]:
    """Positions (m) and volumes (m3) of particles after all particles smaller than `LEAST` are added to the
    nearest larger particles."""
    large = volume >= LEAST * dx**3
    if large.all() or not large.any():
        return x, volume
    nearest = scipy.spatial.KDTree(x[large]).query(x[~large])[1]
    moment = x[large] * volume[large, None]
    total = volume[large].copy()
    np.add.at(moment, nearest, x[~large] * volume[~large, None])
    np.add.at(total, nearest, volume[~large])
    return moment / total[:, None], total
