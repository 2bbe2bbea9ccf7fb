"""Pictures of a run's particles: stills, and the animation of its snapshots.

`particles` returns a matplotlib `Figure`, or None without a snapshot; `animate` writes files.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
from matplotlib.animation import FFMpegWriter, FuncAnimation, PillowWriter
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.colors import Colormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon, Rectangle
from matplotlib.patheffects import withStroke

from jaxsph.output.plot.style import WALL, WIDTH, in_style
from jaxsph.output.plot.tank import Outline, Tank, cut_in_plane, line_of, pick_snapshots
from jaxsph.output.run_file import RunFile

MOST_FRAMES = 200
"""Largest number of frames of an animation; in longer runs snapshots are skipped."""


@dataclass(frozen=True)
class Field:
    """Quantity by which particles are coloured, with its label, which includes the unit."""

    label: str
    colours: str | Colormap
    values: Callable[[dict[str, Any]], np.ndarray]


PRESSURE = Field("pressure (Pa)", "viridis", lambda s: s["p"])


SPEED = Field("speed (m/s)", "plasma", lambda s: np.linalg.norm(s["u"], axis=1))


@in_style
def particles(run: RunFile, field: Field = PRESSURE, index: int = -1) -> Figure | None:
    """Figure of the particles of one snapshot, coloured by a field; None without snapshots.

    A long tank is drawn in several strips, and a small device is also drawn enlarged. A three-dimensional
    run is drawn as a slice at mid-width.
    """
    if run.snapshot_count == 0:
        return None
    snapshot = run.snapshot(index)
    picture = _Picture(Tank.of(run), field, _limits(field, [snapshot]))
    picture.show(snapshot)
    return picture.figure


class _Picture:
    """Figure of particles whose snapshot can be replaced, for stills and for animations."""

    def __init__(self, tank: Tank, field: Field, limits: tuple[float, float]) -> None:
        self.tank, self.field = tank, field
        ranges = tank.strips()
        zoom = tank.zoom()
        if zoom is not None:
            ranges.append(zoom)
        bottom = -max(1.5 * tank.dx, 0.03 * tank.top)
        usable = WIDTH - 2.0  # the width without labels and colour bar
        heights = [usable * (tank.top - bottom) / (b - a) for a, b in ranges]
        # limit the height of the figure for a tank that is higher than long
        shrink = min(1.0, 7.0 / max(heights))
        heights = [h * shrink for h in heights]
        size = (usable * shrink + 2.0, sum(heights) + 0.35 * len(heights) + 0.75)
        self.figure = Figure(figsize=size, layout="constrained")
        self.figure.get_layout_engine().set(w_pad=0.1, h_pad=0.06)
        # set a title now, so that the layout reserves space for it
        self.title = self.figure.suptitle(tank.name, x=0.02, ha="left", fontsize=13)
        grid = self.figure.add_gridspec(len(ranges), 1, height_ratios=heights)
        self.axes = [self.figure.add_subplot(grid[i]) for i in range(len(ranges))]
        self.dots: list[PathCollection] = []
        self.moving: list[tuple[Outline, Polygon]] = []
        self.lines: list[tuple[str, Line2D]] = []
        for ax, (a, b) in zip(self.axes, ranges, strict=True):
            self._prepare(ax, (a, b), (bottom, tank.top))
            self.dots.append(self._scatter(ax, limits))
        if zoom is not None:
            self.axes[-1].set_title("the device, enlarged")
        self.axes[-1].set_xlabel("x (m)")
        bar = self.figure.colorbar(
            self.dots[0],
            ax=self.axes,
            aspect=25,
            pad=0.01,
            shrink=0.8,
            label=field.label,
            extend="max" if field is SPEED else "both",
        )
        bar.outline.set_visible(False)
        self._size_dots()

    def _prepare(self, ax: Axes, x: tuple[float, float], z: tuple[float, float]) -> None:
        ax.set(xlim=x, ylim=z, aspect="equal", ylabel="z (m)")
        ax.grid(False)
        ax.spines[["left", "bottom"]].set_visible(False)
        self._draw_walls(ax, z)

    def _draw_walls(self, ax: Axes, z: tuple[float, float]) -> None:
        tank, solid = self.tank, {"facecolor": WALL, "edgecolor": "none", "zorder": 3}
        thick = -z[0]
        left, right, below = tank.walls
        long = tank.x1 - tank.x0
        if below:
            ax.add_patch(Rectangle((tank.x0 - 1.0, z[0]), long + 2.0, thick, **solid))
        if left:
            ax.add_patch(Rectangle((tank.x0 - long, z[0]), long, z[1] - z[0], **solid))
        if right:
            ax.add_patch(Rectangle((tank.x1, z[0]), long, z[1] - z[0], **solid))
        for outline in tank.solids:
            patch = Polygon(outline.corners, **solid)
            ax.add_patch(patch)
            self.moving += [(outline, patch)] if outline.name else []
        halo = [withStroke(linewidth=2.6, foreground="white")]
        for name in tank.lines:
            (line,) = ax.plot([], [], color=WALL, lw=1.2, zorder=2.5, path_effects=halo)
            self.lines.append((name, line))
        if tank.depth is not None:
            ax.axhline(tank.depth, color="0.5", lw=0.8, ls=(0, (6, 4)), zorder=1)

    def _scatter(self, ax: Axes, limits: tuple[float, float]) -> PathCollection:
        low, high = limits
        return ax.scatter([], [], c=[], cmap=self.field.colours, vmin=low, vmax=high, lw=0, zorder=2)

    def _size_dots(self) -> None:
        """Sets the dots to the size of the particles, after the layout has fixed the size of the axes."""
        self.figure.draw_without_rendering()
        self.figure.set_layout_engine("none")  # axes must not move between frames
        for ax, dots in zip(self.axes, self.dots, strict=True):
            a, b = ax.transData.transform([(0.0, 0.0), (self.tank.dx, 0.0)])
            points = (b[0] - a[0]) * 72.0 / self.figure.dpi
            # slightly more than the diagonal of the spacing, so that no gaps appear within the water
            dots.set_sizes([max(1.45 * points, 0.6) ** 2])

    def show(self, snapshot: dict[str, Any]) -> list[PathCollection]:
        """Shows a snapshot in the figure, and returns the dots."""
        x, values = cut_in_plane(snapshot["x"], self.tank.dx), self.field.values(snapshot)
        for ax, dots in zip(self.axes, self.dots, strict=True):
            a, b = ax.get_xlim()
            near = x.seen & (x.at[:, 0] > a - self.tank.dx) & (x.at[:, 0] < b + self.tank.dx)
            dots.set_offsets(x.at[near])
            dots.set_array(values[near])
        for outline, patch in self.moving:
            patch.set_xy(outline.at(snapshot))
        for name, line in self.lines:
            line.set_data(*line_of(snapshot, name).T)
        self.title.set_text(f"{self.tank.name}, t = {float(snapshot['time']):.2f} s")
        return self.dots


def _limits(field: Field, snapshots: Sequence[dict[str, Any]]) -> tuple[float, float]:
    """Range of the colours, from zero to the 99.5th percentile of the values."""
    values = np.concatenate([field.values(s) for s in snapshots])
    values = values[np.isfinite(values)]
    if values.size == 0:
        return 0.0, 1.0
    high = float(np.percentile(values, 99.5))
    return 0.0, high if high > 0.0 else 1.0


@in_style
def animate(run: RunFile, stem: str | Path, field: Field = PRESSURE) -> list[Path]:
    """Animates the snapshots in real time as STEM.gif, and as STEM.mp4 if ffmpeg is found.

    The frame rate is at least 2 and at most 25 frames per second.

    **Returns** the files written; none for a run with fewer than two snapshots.
    """
    frames = pick_snapshots(run, MOST_FRAMES)
    if len(frames) < 2:
        return []
    stem = Path(stem)
    stem.parent.mkdir(parents=True, exist_ok=True)
    some = [run.snapshot(i) for i in frames[:: max(1, len(frames) // 8)]]
    picture = _Picture(Tank.of(run), field, _limits(field, some))
    movie = FuncAnimation(
        picture.figure, lambda i: picture.show(run.snapshot(i)), frames=frames, init_func=lambda: []
    )
    times = run.snapshot_times()[frames]
    rate = float(np.clip((len(frames) - 1) / max(times[-1] - times[0], 1e-9), 2.0, 25.0))
    written = [stem.with_suffix(".gif")]
    # matplotlib accepts any rate, its type stubs only integers
    movie.save(written[0], writer=PillowWriter(fps=cast(int, rate)), dpi=75)
    if shutil.which("ffmpeg"):
        written.append(stem.with_suffix(".mp4"))
        # the usual encoder needs an even width and height
        even = ["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2"]
        movie.save(written[1], writer=FFMpegWriter(fps=cast(int, rate), extra_args=even), dpi=110)
    return written
