"""View of a run in three dimensions for its page: free surface, solids, links and tank."""

from __future__ import annotations

import zipfile
from importlib import resources
from typing import Any

import matplotlib
import numpy as np

from jaxsph.case.case import Case
from jaxsph.case.geometry import Geometry
from jaxsph.errors import CaseError
from jaxsph.output.plot.tank import Tank
from jaxsph.report.pack import Pack, steps_in_bytes
from jaxsph.report.solids import Solid, full_pose, inside_any, shaded, solids_of
from jaxsph.report.surfaces import MOST, MOST_CELLS, HeightGrid, in_levels

MISSING = "The view in three dimensions needs the extra geometry: run pip install 'jaxsph[geometry]'."
"""Sentence on a page in place of the view, if the libraries of the view are not installed."""
MOST_FRAMES = 300
"""Largest number of frames of a run in three dimensions, so that the surface has enough points in a frame."""
COLOURS = "viridis"


def three() -> bytes | None:
    """Text of the library three.js, which the package `trimesh` contains for its viewer; None if missing.

    The library is the first script of the viewer's page. The text begins with the library's licence.
    """
    try:
        packed = resources.files("trimesh") / "resources" / "templates" / "viewer.zip"
        with packed.open("rb") as file, zipfile.ZipFile(file) as folder:
            page = folder.read("viewer.html.template").decode()
    except (ImportError, OSError, KeyError, zipfile.BadZipFile):
        return None
    _, _, script = page.partition("<script>")
    head, mark, rest = script.partition('"__esModule"')
    if "three" not in head[:200].lower() or "WebGLRenderer" not in head:  # another library, or none
        return None
    return (head + mark + rest.split("\n", 1)[0]).encode()


class Space:
    """View of one run in three dimensions, whose frames are read one after another."""

    def __init__(self, tank: Tank, solids: tuple[Solid, ...], grid: HeightGrid, upper: np.ndarray) -> None:
        """**Arguments**: `upper`: upper corner (x, y, z) of the tank that is drawn, m."""
        self.tank, self.solids, self.grid, self.upper = tank, solids, grid, upper

    @classmethod
    def of(
        cls, tank: Tank, case: Case | None, scene: dict[str, Any], first: np.ndarray, frames: int
    ) -> Space | None:
        """View of a run; None without the libraries of the extra `geometry`, or if solids cannot be drawn.

        **Arguments**: `case`: None for a run without a case, whose solids are then not drawn; `first`:
        positions of the particles (m) in the first snapshot; `frames`: number of frames to be shown.
        """
        if three() is None:
            return None
        low, high = np.nanmin(first, axis=0) - 0.5 * tank.dx, np.nanmax(first, axis=0) + 0.5 * tank.dx
        solids: tuple[Solid, ...] = ()
        if case is not None:
            try:
                solids = solids_of(case, scene)
                low[1], high[1] = 0.0, Geometry.of(case).width or high[1]
            except CaseError:
                return None
        most = min(MOST // frames, MOST_CELLS)
        low[0], high[0], high[2] = tank.x0, tank.x1, tank.top
        return cls(tank, solids, HeightGrid.over(low[:2], high[:2], tank.dx, most), high)

    def read(self, snapshot: dict[str, Any]) -> dict[str, Any]:
        """Heights (m) of the surface, and poses and points of links (m), in a snapshot."""
        poses = [full_pose(snapshot.get(one.name, np.zeros(6))) for one in self.solids]
        x = np.asarray(snapshot["x"], float)
        inside = (lambda at: inside_any(self.solids, poses, at)) if self.solids else None
        return {
            "heights": self.grid.heights(x[np.isfinite(x).all(axis=1)], inside),
            "poses": poses,
            "lines": [self._line(snapshot.get(name)) for name in self.tank.lines],
        }

    def _line(self, points: Any) -> np.ndarray:
        """Points `[K, 3]` (m) of a link; a link in the x-z plane is in the middle of the tank's width."""
        found = np.zeros((0, 3)) if points is None else np.asarray(points, float)
        if found.shape[1] == 3:
            return found
        return np.insert(found, 1, 0.5 * (self.grid.low[1] + self.upper[1]), axis=1)

    def content(self, read: list[dict[str, Any]], pack: Pack) -> dict[str, Any]:
        """Data that a page needs for the view. `read`: results of the method `read`, one for each frame."""
        heights = np.stack([one["heights"] for one in read])
        levels, low, step = in_levels(heights, self.tank.dx)
        still = float(np.nanmean(heights[0])) if self.tank.depth is None else self.tank.depth
        far = np.abs(heights[np.isfinite(heights)] - still)
        x, y = self.grid.axes()
        return {
            "x": pack.array(x),
            "y": pack.array(y),
            "heights": pack.array(steps_in_bytes(levels.reshape(len(read), 1, -1)), "u1"),
            "low": low,
            "step": step,
            "still": still,
            "depth": self.tank.depth,
            "range": float(np.percentile(far, 99.5)) if far.size and far.any() else 1.0,
            "colours": pack.array(255 * matplotlib.colormaps[COLOURS](np.arange(256))[:, :3], "u1"),
            "upper": self.upper.tolist(),
            "solids": [
                _solid(one, [frame["poses"][k] for frame in read], pack) for k, one in enumerate(self.solids)
            ],
            "lines": [
                {
                    "count": len(read[0]["lines"][k]),
                    "points": pack.array(np.stack([frame["lines"][k] for frame in read])),
                }
                for k in range(len(self.tank.lines))
            ],
        }


def _solid(solid: Solid, poses: list[np.ndarray], pack: Pack) -> dict[str, Any]:
    """Surface of a solid relative to its pivot (m), and its poses (m, rad) in the frames."""
    surface = shaded(solid.surface)
    return {
        "name": solid.name,
        "floats": solid.floats,
        "vertices": pack.array(surface.vertices - solid.pivot),
        "faces": pack.array(surface.faces, "u4"),
        "pivot": solid.pivot.tolist(),
        "poses": pack.array(np.stack(poses)) if solid.name else None,
    }
