"""Closed surfaces of triangles from STL and OBJ files, read by the libraries of the extra `geometry`."""

from __future__ import annotations

import base64
import binascii
import functools
import io
import math
import zlib
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jaxsph.case.data_files import read_bytes
from jaxsph.case.extras import library
from jaxsph.errors import CaseError
from jaxsph.solids.mesh import Mesh

MESHES = (".stl", ".obj")
"""File name endings of meshes."""
MOST_BYTES = 20 * 10**6
"""Largest size of a mesh file, bytes."""
MOST_TRIANGLES = 100_000
"""Largest number of triangles of a surface."""
MOST_POINTS = 8 * 10**6
"""Largest number of points of the grid of distances."""
FINE = 0.5
"""Interval of the distance grid, in particle spacings."""
COARSE = 16
"""Number of grid intervals along the longest side of a mesh of which only the extent and volume matter."""


class Triangles(NamedTuple):
    """Closed surface of triangles."""

    vertices: np.ndarray
    """Positions `[V, 3]` of the corners, m."""
    faces: np.ndarray
    """Vertex indices of each triangle `[F, 3]`, anticlockwise seen from outside."""

    def packed(self) -> str:
        """Text with the numbers of the surface: positions as float32, compressed and in base 64."""
        counts = np.array([len(self.vertices), len(self.faces)], "<u4").tobytes()
        data = counts + self.vertices.astype("<f4").tobytes() + self.faces.astype("<u4").tobytes()
        return base64.b64encode(zlib.compress(data, 9)).decode()

    @classmethod
    @functools.lru_cache(maxsize=16)  # a case is checked again after every change
    def unpacked(cls, text: str) -> Triangles:
        """Surface from a text made by `packed`. **Raises** ValueError for any other text."""
        most = 8 + 12 * 3 * MOST_TRIANGLES + 12 * MOST_TRIANGLES
        try:
            data = zlib.decompressobj().decompress(base64.b64decode(text, validate=True), most)
            counts = np.frombuffer(data[:8], "<u4").astype(int)
            ends = 8 + np.cumsum(12 * counts)
            if len(data) != ends[-1]:
                raise ValueError
        except (ValueError, IndexError, zlib.error, binascii.Error):
            raise ValueError(
                "is not the packed surface of a mesh file; name the mesh file in the key `file`"
            ) from None
        vertices = np.frombuffer(data[8 : ends[0]], "<f4").reshape(-1, 3).astype(float)
        faces = np.frombuffer(data[ends[0] :], "<u4").reshape(-1, 3).astype(int)
        if not len(faces) or faces.max() >= len(vertices) or not np.isfinite(vertices).all():
            raise ValueError("is not the packed surface of a mesh file; name the mesh file in the key `file`")
        return cls(vertices, faces)


def read_mesh(path: Path, scale: float = 1.0) -> Triangles:
    """Closed surface in an STL or OBJ file, whose lengths are multiplied by `scale` (m per unit of the file).

    **Raises** CaseError if the file cannot be read, has too many triangles, or does not bound a volume; the
    message states where the surface is open.
    """
    data = read_bytes(
        path, "mesh", "give the name of an STL or OBJ file, relative to the case's folder", MOST_BYTES
    )
    trimesh = library("trimesh", "geometry", "a mesh")
    try:
        mesh = trimesh.load_mesh(io.BytesIO(data), file_type=path.suffix.lower()[1:], process=True)
        vertices, faces = np.asarray(mesh.vertices, float), np.asarray(mesh.faces, int)
    except Exception:  # the library raises errors of any type for a damaged file
        raise CaseError(
            f"{path} cannot be read as a mesh; save the mesh again as {path.suffix[1:].upper()}"
        ) from None
    if not len(faces):
        raise CaseError(f"{path} contains no triangles; save the mesh again")
    if len(faces) > MOST_TRIANGLES:
        raise CaseError(
            f"{path} has {len(faces)} triangles, but at most {MOST_TRIANGLES} are allowed: simplify the "
            "mesh, because details smaller than a spacing of the particles do not matter"
        )
    mesh = trimesh.Trimesh(vertices, faces, process=True)
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    mesh.update_faces(mesh.nondegenerate_faces())
    if not mesh.is_watertight:
        raise CaseError(f"{path} {_gaps(mesh)}")
    if not mesh.is_winding_consistent:
        raise CaseError(
            f"{path} has triangles that face outwards and others that face inwards: unify the normals in "
            "your CAD program"
        )
    if mesh.volume < 0.0:
        mesh.invert()
    return Triangles(scale * np.asarray(mesh.vertices), np.asarray(mesh.faces))


def _gaps(mesh: Any) -> str:
    """Text that states where a surface is not closed, in the units of its file."""
    edges, count = np.unique(np.asarray(mesh.edges_sorted), axis=0, return_counts=True)
    odd = np.asarray(mesh.vertices)[edges[count != 2]]
    if not len(odd):
        return "does not enclose a volume: close the mesh in your CAD program"
    middle = odd.mean(axis=1)
    place = ", ".join(f"{a:.4g}" for a in middle[np.lexsort(middle.T[::-1])[0]])
    return (
        f"is not watertight: {len(odd)} edges do not belong to exactly two triangles, the first "
        f"at ({place}) in the units of the file; close the mesh in your CAD program"
    )


@functools.lru_cache(maxsize=16)
def mesh_of(packed: str, dx: float) -> Mesh:
    """Shape of a packed surface, with a grid of distances for particles of spacing dx (m).

    With an infinite dx the grid is coarse, and only the extent and the moments are accurate.
    """
    surface = Triangles.unpacked(packed)
    low, high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
    coarse = float(np.max(high - low)) / COARSE
    side = FINE * dx if math.isfinite(dx) else coarse
    return Mesh.on_grid(lambda points: nearest(surface, points)[0], (low, high), moments_of(surface), side)


def nearest(surface: Triangles, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances (m) of points `[N, 3]` (m) from a surface, negative inside, and numbers `[N]` of the nearest
    triangles."""
    igl = library("igl", "geometry", "a mesh")
    kind = igl.SIGNED_DISTANCE_TYPE_PSEUDONORMAL
    distance, triangle, *_ = igl.signed_distance(points, surface.vertices, surface.faces, sign_type=kind)
    return np.asarray(distance), np.asarray(triangle)


def moments_of(surface: Triangles) -> tuple[float, tuple[float, ...], tuple[tuple[float, ...], ...]]:
    """Volume (m3), centre (m) and inertia tensor (m5) of the inside of a surface."""
    mesh = library("trimesh", "geometry", "a mesh").Trimesh(*surface, process=False)
    inertia = tuple(tuple(map(float, row)) for row in mesh.moment_inertia)
    return float(mesh.volume), tuple(map(float, mesh.center_mass)), inertia


@functools.lru_cache(maxsize=16)
def thin_places(packed: str, dx: float) -> np.ndarray:
    """Points `[K, 3]` (m) of a packed surface behind which the solid is thinner than two spacings dx (m)."""
    surface, trimesh = Triangles.unpacked(packed), library("trimesh", "geometry", "a mesh")
    mesh = trimesh.Trimesh(*surface, process=False)
    normals, middles = np.asarray(mesh.face_normals), np.asarray(mesh.triangles_center)
    distance, facing = nearest(surface, middles - dx * normals)
    # the nearest triangle must be on the opposite side of the solid, not beyond an edge
    opposite = np.sum(normals * normals[facing], axis=1) < -0.5
    return middles[opposite & (distance > -0.99 * dx)]
