"""Tank in the pictures of a run: walls, device and body, and the choice of particles and snapshots."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxsph.output.run_reader import RunReader

ROOF = 1.6
"""Ratio of a solid's highest level to the water's highest level (-), below which pictures show the whole
solid."""


@dataclass(frozen=True)
class Outline:
    """Outline of a solid in a picture, in its rest position."""

    name: str
    """Name of the solid's pose in the snapshots; empty for a fixed solid."""
    corners: np.ndarray
    """Corners `[K, 2]`, m."""
    pivot: np.ndarray
    """Pivot `[2]` about which the solid rotates, m."""

    def at(self, snapshot: Mapping[str, Any]) -> np.ndarray:
        """Corners `[K, 2]` (m) in the pose of a snapshot."""
        return move(self.corners, self.pivot, self.pose(snapshot))

    def pose(self, snapshot: Mapping[str, Any]) -> np.ndarray:
        """Surge (m), heave (m) and pitch (rad) `[3]` in a snapshot, which in 3-D holds all six motions."""
        found = np.asarray(snapshot.get(self.name, np.zeros(3)), float)
        return found if len(found) == 3 else found[[0, 2, 4]]


def outlines_of(scene: dict[str, Any]) -> tuple[Outline, ...]:
    """Outlines of the solids of a scene (`run.scene`)."""
    return tuple(
        Outline(one["name"], np.asarray(one["corners"], float), np.asarray(one["pivot"], float)[[0, -1]])
        for one in scene.get("solids", ())
        if one["corners"]
    )


@dataclass(frozen=True)
class Tank:
    """Tank as drawn around the particles; lengths in m."""

    name: str
    dx: float
    x0: float
    x1: float
    depth: float | None
    """Still water level, m; None if the scene has no level."""
    top: float
    """Upper edge of the view, m."""
    walls: tuple[bool, bool, bool]
    """Whether there is a wall to the left, to the right, and below."""
    solids: tuple[Outline, ...]
    lines: tuple[str, ...] = ()
    """Names of the links to draw, whose points are stored in the snapshots."""

    @classmethod
    def of(cls, run: RunReader) -> Tank:
        """Builds the tank from a run's scene and snapshots, or from snapshots only if there is no scene."""
        scene = run.scene()
        ends = [run.snapshot(i)["x"] for i in pick_snapshots(run, 12)]
        low, high = (f([f(x, axis=0) for x in ends], axis=0) for f in (np.nanmin, np.nanmax))
        spacing = (np.prod(high - low) / len(ends[0])) ** (1.0 / len(low))
        dx, depth = float(scene.get("dx", spacing)), scene.get("level")
        top = float(max(high[-1], depth or high[-1]))
        solids = outlines_of(scene)
        # show a floating body as a whole, but not a wall that extends far above the water
        roofs = [float(one.corners[:, 1].max()) for one in solids]
        top = max([top, *(roof for roof in roofs if roof < ROOF * top)])
        top += 0.12 * max(depth or top - float(low[-1]), 4 * dx)
        return cls(
            name=str(run.case_keys().get("name", run.path.stem)),
            dx=dx,
            x0=min(scene["low"][0] if scene else np.inf, float(low[0]) - 0.5 * dx),
            x1=scene["high"][0] if scene else float(high[0]) + 0.5 * dx,
            depth=depth,
            top=top,
            walls=tuple(scene.get("walls", (False, False, False))),
            solids=solids,
            lines=tuple(scene.get("lines", ())),
        )

    def strips(self) -> list[tuple[float, float]]:
        """x ranges (m) of the strips of a drawn tank, each at most about ten times as long as high."""
        margin = 0.01 * (self.x1 - self.x0) + self.dx
        count = max(1, int(np.ceil((self.x1 - self.x0) / (8.0 * self.top) - 0.3)))
        edges = np.linspace(self.x0 - margin, self.x1 + margin, count + 1)
        return list(itertools.pairwise(edges))

    def zoom(self) -> tuple[float, float] | None:
        """x range (m) around the solids if they are small in a picture of the whole tank; otherwise None."""
        within = [one.corners[:, 0] for one in self.solids if one.corners[:, 0].min() > self.x0 + self.dx]
        if not within or self.x1 - self.x0 < 4.0 * self.top:
            return None
        left, right = min(x.min() for x in within), max(x.max() for x in within)
        half = max(1.3 * self.top, 0.5 * (right - left) + 0.3 * self.top)
        if 2.0 * half > 0.5 * (self.x1 - self.x0):
            return None
        end = min(0.5 * (left + right) + half, self.x1 + 0.05 * self.top)
        return end - 2.0 * half, end


def line_of(snapshot: dict[str, Any], name: str) -> np.ndarray:
    """Points `[K, 2]` (x, z) (m) of a link in a snapshot; none if the snapshot does not have them."""
    found = np.asarray(snapshot.get(name, np.zeros((0, 2))), float)
    return found[:, [0, -1]]


def move(corners: np.ndarray, pivot: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Outline `[K, 2]` (m) of a body moved by `pose`: surge, heave (m) and pitch (rad, from z towards x)."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return (corners - pivot) @ np.array([[c, -s], [s, c]]) + pivot + pose[:2]


@dataclass(frozen=True)
class Cut:
    """Positions `at` of particles in the plane of the picture, and the mask `seen` of the particles drawn."""

    at: np.ndarray
    seen: np.ndarray


def cut_in_plane(x: np.ndarray, dx: float) -> Cut:
    """Positions `[N, 2]` (m) of all particles in the picture, and the mask `[N]` of those in the slice."""
    seen = np.ones(len(x), bool)
    if x.shape[1] == 3:
        middle = 0.5 * (x[:, 1].min() + x[:, 1].max())
        seen = np.abs(x[:, 1] - middle) < 0.75 * dx
    return Cut(x[:, [0, -1]], seen)


def pick_snapshots(run: RunReader, most: int) -> list[int]:
    """Indices of at most `most` snapshots, spread evenly over the run."""
    count = run.snapshot_count
    return sorted(set(np.linspace(0, count - 1, min(count, most)).round().astype(int).tolist()))
