"""The tank in a run's pictures: its walls, device and body, and which particles and snapshots are shown."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from jaxsph.output.run_file import RunFile


@dataclass(frozen=True)
class Tank:
    """Solids that are drawn around the particles; lengths in m, None where the case does not say."""

    name: str
    dx: float
    x0: float
    x1: float
    depth: float | None
    top: float
    """Upper edge of the view."""
    plate: tuple[float, float, float] | None
    """Front wall of an OWC: its two faces and the height of its tip."""
    platform: tuple[float, float] | None
    """Raised bed under it: its start and its height."""
    body: tuple[np.ndarray, np.ndarray] | None = None
    """Outline `[K, 2]` and pivot of a rigid body at rest."""

    @classmethod
    def of(cls, run: RunFile) -> Tank:
        """From the case's text and the snapshots, whatever of the case is there."""
        case = run.case_keys()
        ends = [run.snapshot(i)["x"] for i in pick_snapshots(run, 12)]
        low, high = (f([f(x, axis=0) for x in ends], axis=0) for f in (np.nanmin, np.nanmax))
        spacing = (np.prod(high - low) / len(ends[0])) ** (1.0 / len(low))
        dx = float(case.get("dx", spacing))
        tank = case.get("tank", {})
        length, depth = (None if tank.get(k) is None else _snap(tank[k], dx) for k in ("length", "depth"))
        top = float(max(high[-1], depth or high[-1]))
        top += 0.12 * max(depth or top - float(low[-1]), 4 * dx)
        x1 = length if length is not None else float(high[0]) + 0.5 * dx
        return cls(
            name=str(case.get("name", run.path.stem)),
            dx=dx,
            x0=min(0.0, float(low[0]) - 0.5 * dx),
            x1=x1,
            depth=depth,
            top=top,
            plate=_plate(case.get("device", {}), x1, depth, dx),
            platform=_platform(case.get("device", {}), x1, dx),
            body=_outline(case.get("body")),
        )

    def strips(self) -> list[tuple[float, float]]:
        """x ranges that cover the tank, each at most eight times as long as high."""
        margin = 0.01 * (self.x1 - self.x0) + self.dx
        count = max(1, int(np.ceil((self.x1 - self.x0) / (8.0 * self.top) - 0.3)))
        edges = np.linspace(self.x0 - margin, self.x1 + margin, count + 1)
        return list(itertools.pairwise(edges))

    def zoom(self) -> tuple[float, float] | None:
        """x range of the device, where it would be small in the whole picture."""
        if self.plate is None or self.x1 - self.x0 < 4.0 * self.top:
            return None
        right = self.x1 + 0.05 * self.top
        return right - 2.6 * self.top, right


def _snap(value: float, dx: float) -> float:
    """A length on the lattice, as the case is built."""
    return float(np.floor(value / dx + 0.5 + 1e-9)) * dx


def _plate(
    device: dict[str, Any], end: float, depth: float | None, dx: float
) -> tuple[float, float, float] | None:
    names = ("chamber_length", "wall_thickness", "draught")
    if depth is None or not all(name in device for name in names):
        return None
    length, thickness, draught = (device[name] for name in names)
    return end - length - thickness, end - length, depth - _snap(draught, dx)


def _platform(device: dict[str, Any], end: float, dx: float) -> tuple[float, float] | None:
    if not device.get("platform_height"):
        return None
    return end - _snap(device["platform_length"], dx), _snap(device["platform_height"], dx)


def _outline(body: dict[str, Any] | None) -> tuple[np.ndarray, np.ndarray] | None:
    if body is None:
        return None
    if "polygon" in body:
        corners = np.asarray(body["polygon"], float)
    elif "disc" in body:
        angle = np.linspace(0.0, 2.0 * np.pi, 60)
        around = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        corners = np.asarray(body["disc"]["centre"]) + body["disc"]["radius"] * around
    else:
        low, high = body["block"]["low"], body["block"]["high"]
        (x0, z0), (x1, z1) = (low[0], low[-1]), (high[0], high[-1])
        corners = np.array([[x0, z0], [x1, z0], [x1, z1], [x0, z1]])
    centre = shapely.Polygon(corners).centroid
    pivot = body.get("pivot", body.get("centre", (centre.x, centre.y)))
    return corners, np.asarray(pivot, float)


def move(corners: np.ndarray, pivot: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Outline `[K, 2]` (m) of a body in a pose of surge, heave (m) and pitch (rad, from z towards x)."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return (corners - pivot) @ np.array([[c, -s], [s, c]]) + pivot + pose[:2]


@dataclass(frozen=True)
class Cut:
    """Particles in the plane of the picture."""

    at: np.ndarray
    seen: np.ndarray


def cut_in_plane(x: np.ndarray, dx: float) -> Cut:
    """Particles in the middle of the tank's width: their places `[N, 2]` (m), and which are there `[N]`."""
    seen = np.ones(len(x), bool)
    if x.shape[1] == 3:
        middle = 0.5 * (x[:, 1].min() + x[:, 1].max())
        seen = np.abs(x[:, 1] - middle) < 0.75 * dx
    return Cut(x[:, [0, -1]], seen)


def pick_snapshots(run: RunFile, most: int) -> list[int]:
    """Indices of at most `most` snapshots, evenly over the run."""
    count = run.snapshot_count
    return sorted(set(np.linspace(0, count - 1, min(count, most)).round().astype(int).tolist()))
