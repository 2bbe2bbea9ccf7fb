"""Particles of a run for playback: positions and fields of its snapshots, in a compact form.

Positions are integers from 0 to 65534 over the tank and a margin around it, or 65535 for a particle that is
not shown. Fields are integers from 0 to 255 over their range. Differences between frames are stored, because
they compress well.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import matplotlib
import numpy as np
from scipy.spatial import KDTree

from jaxsph.analysis.fields import linear_fit, vorticity
from jaxsph.output.plot.tank import Tank, cut_in_plane, line_of, pick_snapshots
from jaxsph.output.run_file import RunFile
from jaxsph.report.pack import Pack

MOST = 1_200_000
"""Largest product of the numbers of particles and frames in a page, which takes up about 5 MB."""
LEAST_FRAMES = 24
"""Smallest number of frames to which a page is reduced; if that is not enough, fewer particles are shown."""
UNSEEN = 65535


class LocalFlow(NamedTuple):
    """Flow around each particle, from a linear fit to the velocities of its neighbours."""

    vorticity: np.ndarray
    """Vorticity normal to the picture, du/dz - dw/dx, 1/s, positive clockwise with x to the right."""
    noise: np.ndarray
    """Difference between the particle's velocity and the fit, m/s."""


def local_flow(x: np.ndarray, u: np.ndarray, rows: np.ndarray | None = None) -> LocalFlow:
    """Vorticity and noise around the particles at x `[N, D]` (m) with the velocities u `[N, D]` (m/s).

    **Arguments**: `rows`: indices of the particles around which the flow is computed; by default all.
    """
    at, own = (x, u) if rows is None else (x[rows], u[rows])
    if len(x) < x.shape[1] + 2:
        return LocalFlow(np.zeros(len(at)), np.zeros(len(at)))
    fit = linear_fit(KDTree(x), u, at)
    return LocalFlow(vorticity(fit.gradient), np.linalg.norm(own - fit.value, axis=1))


@dataclass(frozen=True)
class Field:
    """Quantity by which a page colours particles: label with unit, and matplotlib colour map."""

    label: str
    colours: str
    values: Callable[[dict[str, Any]], np.ndarray]
    signed: bool = False

    def limits(self, values: list[np.ndarray]) -> tuple[float, float]:
        """Range of the colours up to the 99.5th percentile, from zero, or symmetric about zero if signed."""
        joined = np.abs(np.concatenate([v[np.isfinite(v)] for v in values]))
        high = float(np.percentile(joined, 99.5)) if joined.size else 0.0
        high = high or 1.0
        return (-high if self.signed else 0.0), high


FIELDS = {
    "pressure": Field("pressure (Pa)", "viridis", lambda s: s["p"]),
    "speed": Field("speed (m/s)", "plasma", lambda s: np.linalg.norm(s["u"], axis=1)),
    "vorticity": Field("vorticity (1/s)", "RdBu_r", lambda s: s["flow"].vorticity, signed=True),
    "noise": Field("noise of the velocity (m/s)", "magma", lambda s: s["flow"].noise),
}


class Frames:
    """Snapshots of a run for playback on a page; each snapshot is read only once."""

    def __init__(self, run: RunFile) -> None:
        """**Arguments**: `run`: the run, which may still be in progress."""
        self.run = run
        self._known: dict[int, dict[str, Any]] = {}

    def content(self, pack: Pack) -> dict[str, Any] | None:
        """Data that a page needs to play back the run; None for a run without snapshots."""
        if self.run.snapshot_count == 0:
            return None
        tank = Tank.of(self.run)
        first = self.run.snapshot(0)
        shown = max(int(np.count_nonzero(cut_in_plane(first["x"], tank.dx).seen)), 1)
        thinning = max(shown * LEAST_FRAMES // MOST, 1)
        chosen = pick_snapshots(self.run, max(MOST * thinning // shown, LEAST_FRAMES))
        frames = [self._read(i, tank, thinning) for i in chosen]
        low, high = np.array([tank.x0 - 0.5, -0.05]), np.array([tank.x1 + 0.5, 2.0 * tank.top])
        ids = np.unique(np.concatenate([f["id"] for f in frames]))
        rows = [np.searchsorted(ids, f["id"]) for f in frames]
        scale = (UNSEEN - 1) / (high - low)
        places = np.full((len(frames), 2, len(ids)), UNSEEN, np.uint16)
        for place, row, frame in zip(places, rows, frames, strict=True):
            inside = np.isfinite(frame["at"]) & (frame["at"] >= low) & (frame["at"] <= high)
            whole = np.rint((np.where(inside, frame["at"], low) - low) * scale).astype(np.uint16)
            place[:, row] = np.where(inside.all(axis=1), whole.T, UNSEEN)
        return {
            "t": pack.array(np.array([f["time"] for f in frames]), "f8"),
            "count": len(ids),
            "places": pack.array(_places_in_bytes(places), "u1"),
            "low": low.tolist(),
            "high": high.tolist(),
            "dx": tank.dx * thinning**0.5,
            "fields": {name: _field(field, frames, rows, len(ids), pack) for name, field in FIELDS.items()},
            "tank": _scene(tank, frames, pack),
            "slice": first["x"].shape[1] == 3,
            "thinning": thinning,
        }

    def _read(self, index: int, tank: Tank, thinning: int) -> dict[str, Any]:
        """Particles of a snapshot in the plane of the picture, about one in `thinning`, with their fields."""
        if index not in self._known:
            snapshot = self.run.snapshot(index)
            x, u, p = (np.asarray(snapshot[name], np.float64) for name in "xup")
            there = np.isfinite(x).all(axis=1) & np.isfinite(u).all(axis=1)
            cut = cut_in_plane(x, tank.dx)
            seen = cut.seen & there & (_scattered(snapshot["id"]) < 1.0 / thinning)
            flow = local_flow(x[there], u[there], np.flatnonzero(seen[there]))
            kept = {"p": p[seen], "u": u[seen], "flow": flow}
            self._known[index] = {
                "time": float(snapshot["time"]),
                "id": snapshot["id"][seen],
                "at": cut.at[seen],
                "poses": {one.name: one.pose(snapshot) for one in tank.solids if one.name},
                "lines": {name: line_of(snapshot, name) for name in tank.lines},
                **{name: field.values(kept).astype(np.float32) for name, field in FIELDS.items()},
            }
        return self._known[index]


def _scattered(ids: np.ndarray) -> np.ndarray:
    """Pseudo-random numbers from 0 to 1 by particle id, the same in every frame."""
    return (ids.astype(np.uint64) * np.uint64(2654435761) % np.uint64(2**32)) / 2.0**32


def _places_in_bytes(places: np.ndarray) -> np.ndarray:
    """Zigzag-coded differences between frames, small for both signs; low bytes before high bytes."""
    step = np.diff(places, axis=0, prepend=np.zeros_like(places[:1])).astype(np.int16)
    small = ((step << 1) ^ (step >> 15)).astype(np.uint16)
    return np.stack([small & 0xFF, small >> 8], axis=2).astype(np.uint8)


def _field(
    field: Field, frames: list[dict[str, Any]], rows: list[np.ndarray], count: int, pack: Pack
) -> dict[str, Any]:
    name = next(key for key, other in FIELDS.items() if other is field)
    low, high = field.limits([f[name] for f in frames])
    levels = np.zeros((len(frames), count), np.uint8)
    for level, row, frame in zip(levels, rows, frames, strict=True):
        share = (np.nan_to_num(frame[name]) - low) / (high - low)
        level[row] = np.rint(255 * share.clip(0.0, 1.0)).astype(np.uint8)
    colours = (255 * matplotlib.colormaps[field.colours](np.arange(256))[:, :3]).round()
    return {
        "label": field.label,
        "low": low,
        "high": high,
        "levels": pack.array(np.diff(levels, axis=0, prepend=np.zeros_like(levels[:1])), "u1"),
        "colours": pack.array(colours, "u1"),
    }


def _scene(tank: Tank, frames: list[dict[str, Any]], pack: Pack) -> dict[str, Any]:
    """Walls and solids around the water, and the first view, zoomed to the solids if they are small."""
    zoom = tank.zoom()
    solids = []
    for one in tank.solids:
        poses = [frame["poses"][one.name] for frame in frames] if one.name else []
        solids.append(
            {
                "corners": one.corners.tolist(),
                "pivot": one.pivot.tolist(),
                "poses": pack.array(np.concatenate(poses)) if poses else None,
            }
        )
    lines = [[frame["lines"][name] for frame in frames] for name in tank.lines]
    return {
        "lines": [{"count": len(one[0]), "points": pack.array(np.concatenate(one))} for one in lines],
        "x0": tank.x0,
        "x1": tank.x1,
        "top": tank.top,
        "depth": tank.depth,
        "walls": list(tank.walls),
        "solids": solids,
        "zoom": list(map(float, zoom)) if zoom is not None else None,
    }
