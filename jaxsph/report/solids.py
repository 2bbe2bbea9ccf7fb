"""Solids of a run in three dimensions for its page: surfaces of triangles at rest, and their poses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from jaxsph.case.case import Case
from jaxsph.case.extras import library
from jaxsph.case.geometry import Geometry
from jaxsph.case.meshes import Triangles
from jaxsph.case.shape_sections import ShapeSection
from jaxsph.core.points import at_points
from jaxsph.solids.shapes import AbstractShape, box_corners
from jaxsph.solids.swept import Extrusion

CELLS = 48
"""Number of grid intervals along the longest side of a shape, for computing the surface of the shape."""
CREASE = 0.6
"""Angle between two triangles (rad) above which the edge between them is drawn sharp."""
MOST_TRIANGLES = 4000
"""Largest number of triangles of a solid in a page; a larger surface is simplified."""


@dataclass(frozen=True)
class Solid:
    """Solid of a picture in three dimensions, in its position at rest."""

    name: str
    """Name of the solid's pose in the snapshots; empty for a solid that does not move."""
    shape: AbstractShape
    """Shape at rest."""
    surface: Triangles
    """Surface at rest, m."""
    pivot: np.ndarray
    """Point (x, y, z) at rest about which the solid turns, m."""
    floats: bool = False
    """Whether the solid is a rigid body; other solids have another colour."""

    def distance(self, x: np.ndarray, pose: np.ndarray) -> np.ndarray:
        """Distance (m) of points x `[N, 3]` (m) from the solid in a `full_pose`; negative inside."""
        back = (x - self.pivot - pose[:3]) @ rotation(pose[3:]) + self.pivot
        return np.asarray(at_points(self.shape.distance, back))


def full_pose(pose: Any) -> np.ndarray:
    """Displacement of the pivot (x, y, z) (m) and rotation vector (rad) `[6]`, from a pose of a snapshot.

    A snapshot has either these six numbers or surge (m), heave (m) and pitch (rad, from z towards x, which
    is right-handed about y).
    """
    found = np.asarray(pose, float)
    if found.shape == (6,):
        return found
    surge, heave, pitch = found
    return np.array([surge, 0.0, heave, 0.0, pitch, 0.0])


def full_pivot(pivot: Any) -> np.ndarray:
    """Point (x, y, z) `[3]` (m) about which a solid turns, from (x, y, z) or (x, z).

    A solid with the pivot (x, z) turns about the y-axis only, so that y is arbitrary.
    """
    found = np.asarray(pivot, float)
    return found if found.shape == (3,) else np.array([found[0], 0.0, found[1]])


def rotation(vector: np.ndarray) -> np.ndarray:
    """Rotation matrix `[3, 3]` (-) of a rotation vector (rad), right-handed."""
    angle = float(np.linalg.norm(vector))
    x, y, z = vector / angle if angle else vector
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross


def surface_of(shape: AbstractShape, cells: int = CELLS) -> Triangles:
    """Closed surface of a three-dimensional shape, by marching cubes on its distance function; lengths in m.

    **Arguments**: `cells`: number of grid intervals along the longest side. A shape thinner than a grid
    interval has no triangles. **Raises** CaseError without the extra `geometry`.
    """
    igl = library("igl", "geometry", "the view in three dimensions")
    low, high = (np.asarray(end, float) for end in shape.bounds())
    side = float(np.max(high - low)) / cells
    # the surface does not reach the boundary of the grid, so that it is closed
    counts = np.ceil((high - low) / side).astype(int) + 5
    first = 0.5 * (low + high) - 0.5 * side * (counts - 1)
    axes = [a + side * np.arange(count) for a, count in zip(first, counts, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), -1).transpose(2, 1, 0, 3).reshape(-1, 3)
    away = np.asarray(at_points(shape.distance, points), float)
    vertices, faces, _ = igl.marching_cubes(away, points, *map(int, counts), 0.0)
    return simplified(Triangles(np.asarray(vertices), np.asarray(faces)))


def simplified(surface: Triangles, most: int = MOST_TRIANGLES) -> Triangles:
    """The surface (m) with at most about `most` triangles; sharp edges keep their positions."""
    if len(surface.faces) <= most:
        return surface
    igl = library("igl", "geometry", "the view in three dimensions")
    vertices, faces, *_ = igl.qslim(
        np.asfortranarray(surface.vertices), np.asfortranarray(surface.faces, dtype=np.int32), most
    )
    return Triangles(np.asarray(vertices), np.asarray(faces))


def shaded(surface: Triangles) -> Triangles:
    """The surface (m) with the vertices on its sharp edges duplicated, one for each side of the edge."""
    trimesh = library("trimesh", "geometry", "the view in three dimensions")
    mesh = trimesh.Trimesh(*surface, process=False)
    mesh.update_faces(mesh.nondegenerate_faces())
    smooth = trimesh.graph.smooth_shade(mesh, angle=CREASE)
    return Triangles(np.asarray(smooth.vertices), np.asarray(smooth.faces))


def solids_of(case: Case, scene: dict[str, Any]) -> tuple[Solid, ...]:
    """Solids of a case in three dimensions; `scene`: see `run.scene`.

    A scene gives plates, platform and paddle as outlines in the x-z plane; these solids span the tank.
    """
    geometry = Geometry.of(case)
    outlines = list(scene.get("solids", ()))
    pivots = {one["name"]: one["pivot"] for one in outlines if one["name"]}
    found = []
    for name, shape in geometry.bodies.items():
        moves, section = name in pivots, case.every_body[name]
        at = shape if moves else geometry.initial[geometry.keys[name]]
        surface = _surface(section, shape) if moves else surface_of(at)
        pivot = full_pivot(pivots.get(name, np.zeros(3)))
        found.append(Solid(name if moves else "", at, surface, pivot, floats=moves))
    for name, shape in geometry.solids.items():
        found.append(Solid("", shape, _surface(case.solid[name], shape), np.zeros(3)))
    # the outlines of bodies without motions are the last ones of the solids that do not move
    fixed = sum(name not in pivots for name in geometry.shapes)
    still = [one for one in outlines if not one["name"]]
    plates = [one for one in still[: len(still) - fixed] if one["corners"]]
    others = [one for one in outlines if one["name"] and one["name"] not in geometry.bodies]
    found += [_across(one, geometry.upper) for one in (*plates, *others)]
    return tuple(one for one in found if len(one.surface.faces))


def _surface(section: ShapeSection, shape: AbstractShape) -> Triangles:
    """Surface (m) of the shape of a section: the triangles of its mesh file, or else `surface_of`."""
    if section.mesh is not None:
        return simplified(Triangles(section.corners(), Triangles.unpacked(section.mesh.packed).faces))
    return surface_of(shape)


def _across(outline: dict[str, Any], upper: list[float]) -> Solid:
    """Solid that extends an outline of a scene across the tank; `upper`: upper corner of the tank, m."""
    length, width, height = upper
    # what is behind the paddle or above the walls is not drawn
    within = shapely.Polygon(box_corners((-0.02 * length, 0.0), (length, height)))
    cut = shapely.Polygon(outline["corners"]).intersection(within)
    pivot = full_pivot(outline["pivot"])
    if not isinstance(cut, shapely.Polygon) or cut.is_empty:
        corners = np.asarray(outline["corners"], float)
    else:
        corners = np.asarray(cut.exterior.coords)[:-1]
    shape = Extrusion(corners, (0.0, width))
    return Solid(outline["name"], shape, surface_of(shape, 2 * CELLS), pivot)


def inside_any(solids: tuple[Solid, ...], poses: list[np.ndarray], x: np.ndarray) -> np.ndarray:
    """Whether points x `[N, 3]` (m) are inside a solid, `[N]`; `poses`: `full_pose` of each solid."""
    inside = np.zeros(len(x), bool)
    for one, pose in zip(solids, poses, strict=True):
        reach = np.linalg.norm(one.surface.vertices - one.pivot, axis=1).max()
        near = np.linalg.norm(x - one.pivot - pose[:3], axis=1) < reach
        if near.any():
            inside[near] |= one.distance(x[near], pose) < 0.0
    return inside
