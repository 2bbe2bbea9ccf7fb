"""Surface of the hull of the built-in case `hull`: a barge with round bilges and ends, in triangles.

Below the waterline the hull is a superellipsoid, |2x/L|^4 + |2y/B|^4 + |z/T|^4 = 1. Above the waterline the
sides are vertical, and the deck is flat.
"""

from __future__ import annotations

import numpy as np
import trimesh

LENGTH, BREADTH, DRAUGHT, FREEBOARD = 0.8, 0.4, 0.15, 0.05
"""Length, breadth, draught and freeboard, m."""
AROUND, DOWN = 48, 10
"""Number of points around a waterline, and number of waterlines from the bottom to the design waterline."""


def hull() -> trimesh.Trimesh:
    """Closed surface of the hull in mm, with x along its length and z = 0 at the design waterline."""
    angle = 2.0 * np.pi * (np.arange(AROUND) + 0.5) / AROUND
    ring = np.stack([_root(np.cos(angle)) * LENGTH / 2, _root(np.sin(angle)) * BREADTH / 2], axis=1)
    depth = 0.5 * np.pi * np.arange(DOWN) / DOWN
    levels = [(-DRAUGHT * _root(np.cos(a)), _root(np.sin(a))) for a in depth[1:]]
    levels += [(0.0, 1.0), (FREEBOARD, 1.0)]
    points = [[[0.0, 0.0, -DRAUGHT]]]
    points += [np.column_stack([size * ring, np.full(AROUND, z)]) for z, size in levels]
    points += [[[0.0, 0.0, FREEBOARD]]]
    vertices = np.concatenate(points)
    here = np.arange(AROUND)
    after = (here + 1) % AROUND
    faces = [np.column_stack([np.zeros_like(here), 1 + after, 1 + here])]
    for level in range(len(levels) - 1):
        low, high = 1 + level * AROUND, 1 + (level + 1) * AROUND
        faces += [np.column_stack([low + here, low + after, high + after])]
        faces += [np.column_stack([low + here, high + after, high + here])]
    last = 1 + (len(levels) - 1) * AROUND
    faces += [np.column_stack([last + here, last + after, np.full(AROUND, len(vertices) - 1)])]
    return trimesh.Trimesh(1000.0 * vertices, np.concatenate(faces))


def _root(a: np.ndarray | float) -> np.ndarray:
    """Square root of a magnitude, with the sign."""
    return np.sign(a) * np.sqrt(np.abs(a))
