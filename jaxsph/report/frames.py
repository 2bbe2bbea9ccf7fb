"""Particles of a run for playback: positions and fields of its snapshots, in a compact form.

Positions are integers from 0 to 65534 over the tank and a margin around it, or 65535 for a particle that is
not shown. Fields are integers from 0 to 255 over their range. Differences between frames are stored, because
they compress well.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import matplotlib
import numpy as np
import scipy  # which imports its subpackages on first use

from jaxsph.analysis.fields import linear_fit, vorticity
from jaxsph.case.case import Case
from jaxsph.output.plot.tank import Tank, line_of, pick_snapshots
from jaxsph.output.run_file import RunFile
from jaxsph.report.pack import UNSEEN, Pack, steps_in_bytes
from jaxsph.report.space import MISSING, MOST_FRAMES, Space

MOST = 950_000
"""Largest product of the numbers of particles and frames in a page, with which a page has less than 8 MB."""
LEAST_FRAMES = 24
"""Smallest number of frames to which a page is reduced; if that is not enough, fewer particles are shown."""
SECTIONS = (5, 3, 1)
"""Possible numbers of sections across a three-dimensional tank on a page, in order of preference."""
HALF = 0.75
"""Half the thickness of a section, in spacings."""


class LocalFlow(NamedTuple):
    """Flow around each particle, from a linear fit to the velocities of its neighbours."""

    vorticity: np.ndarray
    """Vorticity normal to the picture, du/dz - dw/dx, 1/s, positive clockwise with x to the right."""
    noise: np.ndarray
    """Magnitude of the difference between the particle's velocity and the fit, m/s."""


def local_flow(x: np.ndarray, u: np.ndarray, rows: np.ndarray | None = None) -> LocalFlow:
    """Vorticity and noise around the particles at x `[N, D]` (m) with the velocities u `[N, D]` (m/s).

    **Arguments**: `rows`: indices of the particles around which the flow is computed; by default all.
    """
    at, own = (x, u) if rows is None else (x[rows], u[rows])
    if len(x) < x.shape[1] + 2:
        return LocalFlow(np.zeros(len(at)), np.zeros(len(at)))
    fit = linear_fit(scipy.spatial.KDTree(x), u, at)
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
        self._space: Space | None = None
        self._planes: tuple[float | None, ...] | None = None
        self._known: dict[int, dict[str, Any]] = {}

    def content(self, pack: Pack, case: Case | None = None) -> dict[str, Any] | None:
        """Data that a page needs to play back the run; None for a run without snapshots.

        **Arguments**: `case`: the run's case, for the solids in three dimensions; None if it is not known.
        """
        if self.run.snapshot_count == 0:
            return None
        tank = Tank.of(self.run)
        first = self.run.snapshot(0)
        if self._planes is None:
            self._planes = _planes(first["x"], tank.dx, min(self.run.snapshot_count, MOST_FRAMES))
        planes = self._planes
        shown = max(int(np.count_nonzero(_sections(first["x"], planes, tank.dx) >= 0)), 1)
        thinning = max(shown * LEAST_FRAMES // MOST, 1)
        most = max(MOST * thinning // shown, LEAST_FRAMES)
        chosen = pick_snapshots(self.run, most if planes[0] is None else min(most, MOST_FRAMES))
        if planes[0] is not None and self._space is None:
            # a run in progress keeps its grid, which has room for all the frames that a page may get
            most = len(chosen) if self.run.results() else MOST_FRAMES
            self._space = Space.of(tank, case, self.run.scene(), first["x"], most)
        frames = [self._read(i, tank, thinning, planes) for i in chosen]
        low, high = np.array([tank.x0 - 0.5, -0.05]), np.array([tank.x1 + 0.5, 2.0 * tank.top])
        limits = {name: field.limits([f[name] for f in frames]) for name, field in FIELDS.items()}
        sections = [
            {"y": y} | _section([_of_section(f, k) for f in frames], low, high, limits, pack)
            for k, y in enumerate(planes)
        ]
        found = {
            "t": pack.array(np.array([f["time"] for f in frames]), "f8"),
            "low": low.tolist(),
            "high": high.tolist(),
            "dx": tank.dx * thinning**0.5,
            "tank": _scene(tank, frames, pack),
            "thinning": thinning,
            "sections": sections,
            "slice": planes[0] is not None,
        }
        if found["slice"]:
            view = self._space
            found["space"] = None if view is None else view.content([f["space"] for f in frames], pack)
            found["missing"] = MISSING if view is None else ""
        return found | sections[len(sections) // 2]

    def _read(self, index: int, tank: Tank, thinning: int, planes: Sequence[float | None]) -> dict[str, Any]:
        """Particles of a snapshot in the sections, about one in `thinning`, with their fields."""
        if index not in self._known:
            snapshot = self.run.snapshot(index)
            x, u, p = (np.asarray(snapshot[name], np.float64) for name in "xup")
            there = np.isfinite(x).all(axis=1) & np.isfinite(u).all(axis=1)
            section = _sections(x, planes, tank.dx)
            seen = (section >= 0) & there & (_scattered(snapshot["id"]) < 1.0 / thinning)
            flow = local_flow(x[there], u[there], np.flatnonzero(seen[there]))
            kept = {"p": p[seen], "u": u[seen], "flow": flow}
            self._known[index] = {
                "time": float(snapshot["time"]),
                "id": snapshot["id"][seen],
                "at": x[seen][:, [0, -1]],
                "section": section[seen],
                "space": None if self._space is None else self._space.read(snapshot),
                "poses": {one.name: one.pose(snapshot) for one in tank.solids if one.name},
                "lines": {name: line_of(snapshot, name) for name in tank.lines},
                **{name: field.values(kept).astype(np.float32) for name, field in FIELDS.items()},
            }
        return self._known[index]


def _planes(x: np.ndarray, dx: float, frames: int) -> tuple[float | None, ...]:
    """Distances y (m) of the sections from the tank's first side wall, in ascending order; (None,) in 2-D.

    The number of sections is the largest in `SECTIONS` at which the sections do not overlap and fit into a
    page of `frames` frames, and at least one.
    """
    if x.shape[1] == 2:
        return (None,)
    low, high = float(np.nanmin(x[:, 1])), float(np.nanmax(x[:, 1]))
    for count in SECTIONS:
        apart = (high - low) / (count + 1)
        found = tuple(round(low + (k + 1) * apart, 9) for k in range(count))
        shown = np.count_nonzero(_sections(x, found, dx) >= 0)
        if apart > 2 * HALF * dx and shown * frames <= MOST:
            return found
    return found


def _sections(x: np.ndarray, planes: Sequence[float | None], dx: float) -> np.ndarray:
    """Number of the section `[N]` in which each particle at x (m) is shown, -1 for none; 0 for all in 2-D."""
    found = np.full(len(x), 0 if planes[0] is None else -1)
    for k, y in enumerate(planes):
        if y is not None:
            found[np.abs(x[:, 1] - y) < HALF * dx] = k
    return found


def _of_section(frame: dict[str, Any], number: int) -> dict[str, Any]:
    """Particles and fields of a frame in one section."""
    kept = frame["section"] == number
    return {name: frame[name][kept] for name in ("id", "at", *FIELDS)}


def _section(
    frames: list[dict[str, Any]],
    low: np.ndarray,
    high: np.ndarray,
    limits: dict[str, tuple[float, float]],
    pack: Pack,
) -> dict[str, Any]:
    """Positions and fields of a section's particles, coded for a page.

    **Arguments**: `low`, `high`: range of the positions, m; `limits`: ranges of the fields.
    """
    ids = np.unique(np.concatenate([f["id"] for f in frames]))
    rows = [np.searchsorted(ids, f["id"]) for f in frames]
    scale = (UNSEEN - 1) / (high - low)
    places = np.full((len(frames), 2, len(ids)), UNSEEN, np.uint16)
    for place, row, frame in zip(places, rows, frames, strict=True):
        inside = np.isfinite(frame["at"]) & (frame["at"] >= low) & (frame["at"] <= high)
        whole = np.rint((np.where(inside, frame["at"], low) - low) * scale).astype(np.uint16)
        place[:, row] = np.where(inside.all(axis=1), whole.T, UNSEEN)
    levels = {name: np.zeros((len(frames), len(ids)), np.uint8) for name in FIELDS}
    for k, (row, frame) in enumerate(zip(rows, frames, strict=True)):
        for name, (least, most) in limits.items():
            share = (np.nan_to_num(frame[name]) - least) / (most - least)
            levels[name][k, row] = np.rint(255 * share.clip(0.0, 1.0)).astype(np.uint8)
    return {
        "count": len(ids),
        "places": pack.array(steps_in_bytes(places), "u1"),
        "fields": {name: _field(name, levels[name], limits[name], pack) for name in FIELDS},
    }


def _scattered(ids: np.ndarray) -> np.ndarray:
    """Pseudo-random numbers from 0 to 1 by particle id, the same in every frame."""
    return (ids.astype(np.uint64) * np.uint64(2654435761) % np.uint64(2**32)) / 2.0**32


def _field(name: str, levels: np.ndarray, limits: tuple[float, float], pack: Pack) -> dict[str, Any]:
    """Levels `[frame, particle]` of a field, with its limits, label and colours."""
    colours = (255 * matplotlib.colormaps[FIELDS[name].colours](np.arange(256))[:, :3]).round()
    return {
        "label": FIELDS[name].label,
        "low": limits[0],
        "high": limits[1],
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
