"""Pictures of a run, for engineers: gauges, chamber, sensors, energy budget, particles, animation.

Every function of a run takes a `RunFile` and gives a matplotlib `Figure`, or None where the run did not
record what it shows. `plot_run` writes all of them as PNG files, and an animation;
`plot_sweep` draws what a sweep or a search found.
"""

from __future__ import annotations

import shutil
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import shapely
from matplotlib.animation import FFMpegWriter, FuncAnimation, PillowWriter
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.colors import Colormap
from matplotlib.figure import Figure
from matplotlib.patches import Polygon, Rectangle

from jaxsph import analysis
from jaxsph.io import RunFile, SweepFile, gathered
from jaxsph.linear import LinearOWC

__all__ = ["animate", "chamber", "energy", "gauges", "particles", "plot_run", "plot_sweep", "pressures"]

Overlay = Callable[[np.ndarray, float], np.ndarray]
"""Elevation (m) expected at times t (s) and position x (m)."""

# Okabe and Ito's colours, which the colour-blind tell apart.
BLUE, ORANGE, GREEN, RED, PURPLE, SKY = (
    "#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9",
)  # fmt: skip
WALL = "0.3"
STORED = "stored in the water"

STYLE = {
    "font.size": 11,
    "axes.titlesize": 11,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "0.9",
    "grid.linewidth": 0.8,
    "axes.axisbelow": True,
    "lines.linewidth": 1.4,
    "legend.frameon": False,
    "figure.dpi": 100,
    "savefig.dpi": 150,
}
_styled = matplotlib.rc_context(STYLE)

WIDTH = 11.0
"""Of every figure, inches."""
MOST_FRAMES = 200
"""Frames of an animation; longer runs skip snapshots."""


def plot_run(
    run: RunFile | str | Path,
    folder: str | Path | None = None,
    animation: bool = True,
    overlay: Overlay | None = None,
    linear: LinearOWC | None = None,
) -> list[Path]:
    """Writes every picture that the run has data for, and the animation of its snapshots.

    **Arguments**: `folder`: by default the run's path without suffix and with "_plots"; `overlay`:
    theory to draw over the gauges; `linear`: what linear theory expects of the chamber.
    **Returns** the files written: PNG, GIF, and MP4 where ffmpeg is found.
    **Raises** FileError where the run cannot be read.
    """
    run = run if isinstance(run, RunFile) else RunFile.open(run)
    folder = Path(folder) if folder is not None else run.path.with_name(run.path.stem + "_plots")
    figures = {
        "gauges": gauges(run, overlay),
        "chamber": chamber(run, linear),
        "body": body(run),
        "pressure_sensors": pressures(run),
        "energy": energy(run),
        "particles_pressure": particles(run, PRESSURE),
        "particles_speed": particles(run, SPEED),
    }
    written = []
    for name, figure in figures.items():
        if figure is not None:
            folder.mkdir(parents=True, exist_ok=True)
            written.append(folder / f"{name}.png")
            figure.savefig(written[-1], dpi=STYLE["savefig.dpi"])
    if animation:
        written += animate(run, folder / "animation")
    return written


# --------------------------------------------------------------------------- sweeps


def plot_sweep(sweep: SweepFile | str | Path, folder: str | Path | None = None, of: str = "xi") -> list[Path]:
    """Writes the picture of a sweep, an ensemble or a search: the result `of` over what was varied.

    One parameter: the members with their scatter and, of a search, the slopes as short lines and the way.
    Two: contours over a grid, the way of a search. **Returns** the files written; none where there are more
    parameters, or no member has the result. **Raises** FileError where the file cannot be read.
    """
    sweep = sweep if isinstance(sweep, SweepFile) else SweepFile(sweep)
    folder = Path(folder) if folder is not None else sweep.path.with_name(sweep.path.stem + "_plots")
    stored = sweep.read()
    results = gathered(stored.members, stored.shape)
    if of not in results or len(stored.axes) > 2:
        return []
    if len(stored.axes) == 1:
        figure = _over_one(stored.axes, results, of)
    elif len(stored.shape) == 2:
        figure = _over_grid(stored.axes, results[of], of)
    else:
        figure = _over_list(stored.axes, results, of)
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / f"{of}.png", dpi=STYLE["savefig.dpi"])
    return [folder / f"{of}.png"]


@_styled
def _over_one(axes: dict[str, np.ndarray], results: dict[str, np.ndarray], of: str) -> Figure:
    (name, x), y = next(iter(axes.items())), results[of]
    figure = Figure(figsize=(0.7 * WIDTH, 4.5), layout="constrained")
    ax = figure.subplots()
    slopes = results.get(f"slope {name}")
    if slopes is None:
        error = None
        if of == "xi" and "xi_scatter" in results:
            error = results["xi_scatter"] / np.sqrt(results["periods"])
        order = np.argsort(x)
        ax.errorbar(
            x[order], y[order], None if error is None else error[order], fmt="o-", color=BLUE, capsize=2
        )
        ax.set_title(of if error is None else f"{of}, and its scatter between periods over their root")
    else:
        ax.plot(x, y, ":", color="0.6", lw=1.0)
        ax.plot(x, y, "o", color=BLUE)
        reach = 0.04 * (np.nanmax(x) - np.nanmin(x)) or 0.1 * np.nanmax(np.abs(x))
        for k, (a, b, slope) in enumerate(zip(x, y, slopes, strict=True)):
            ends = np.array([-reach, reach])
            ax.plot(a + ends, b + slope * ends, color=ORANGE, lw=2)
            ax.annotate(str(k + 1), (a, b), (4, 5), textcoords="offset points", fontsize=9)
        ax.set_title(f"{of} in the order of the search, and the slopes that led it")
    ax.set(xlabel=name, ylabel=of)
    return figure


@_styled
def _over_grid(axes: dict[str, np.ndarray], values: np.ndarray, of: str) -> Figure:
    (x_name, x), (y_name, y) = axes.items()
    figure = Figure(figsize=(0.7 * WIDTH, 5.0), layout="constrained")
    ax = figure.subplots()
    if min(values.shape) > 1 and np.isfinite(values).sum() > 3:
        drawn = ax.contourf(x, y, np.ma.masked_invalid(values.T), levels=12, cmap="viridis")
        figure.colorbar(drawn, ax=ax, label=of)
    ax.plot(*(a.ravel() for a in np.meshgrid(x, y)), ".", color="k", ms=3)
    best = np.unravel_index(np.nanargmax(values), values.shape)
    ax.plot(x[best[0]], y[best[1]], "*", color=ORANGE, ms=14)
    ax.set(xlabel=x_name, ylabel=y_name, title=f"{of}: the star is the largest, {values[best]:.3g}")
    ax.grid(visible=False)
    return figure


@_styled
def _over_list(axes: dict[str, np.ndarray], results: dict[str, np.ndarray], of: str) -> Figure:
    (x_name, x), (y_name, y) = axes.items()
    figure = Figure(figsize=(0.7 * WIDTH, 5.0), layout="constrained")
    ax = figure.subplots()
    if f"slope {x_name}" in results:
        ax.plot(x, y, ":", color="0.6", lw=1.0)
    drawn = ax.scatter(x, y, c=results[of], cmap="viridis")
    figure.colorbar(drawn, ax=ax, label=of)
    for k, place in enumerate(zip(x, y, strict=True)):
        ax.annotate(str(k + 1), place, (4, 5), textcoords="offset points", fontsize=9)
    ax.set(xlabel=x_name, ylabel=y_name, title=of)
    return figure


# --------------------------------------------------------------------------- series


@_styled
def gauges(run: RunFile, overlay: Overlay | None = None) -> Figure | None:
    """Elevation at each gauge, one axis for each, on one scale."""
    series = run.series()
    if not _has(series, "eta"):
        return None
    positions = run.coordinates().get("gauge_x")
    x = positions[1] if positions is not None else [None] * series["eta"].shape[1]
    t, figure, axes = series["time"], *_stack(len(x), 1.5)
    for ax, at, eta in zip(axes, x, series["eta"].T, strict=True):
        ax.plot(t, eta, color=BLUE, label="simulation")
        ax.set_title(_name(ax, "gauge") if at is None else f"gauge at x = {at:.4g} m")
        if overlay is not None and at is not None:
            ax.plot(t, overlay(t, float(at)), "--", color=RED, lw=1.2, label="theory")
    if overlay is not None:
        # above the axes, where no line can run through it
        axes[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.1)
    _share_limits(axes)
    figure.supylabel("elevation over still water (m)", fontsize=11)
    return figure


@_styled
def chamber(run: RunFile, linear: LinearOWC | None = None) -> Figure | None:
    """Level, flow, pressure and power of the chamber, on one time axis.

    With `linear` also the extremes that linear theory expects of the first three and the mean of the
    power, dashed, over the periods that the efficiency was averaged over (the last one, if none was).
    """
    panels = [
        ("chamber_level", "level (m)", "mean level over still water, positive when risen", BLUE),
        ("flow", "flow (m$^2$/s)", "air flow per metre width, positive out of the chamber", GREEN),
        ("P_a", "pressure (Pa)", "air pressure over the atmosphere, positive when compressed", RED),
        ("power_pto", "power (W/m)", "power taken by the PTO per metre width", PURPLE),
    ]
    series = run.series()
    panels = [panel for panel in panels if _has(series, panel[0])]
    if not panels or "body_force" in series:
        return None
    t, figure, axes = series["time"], *_stack(len(panels), 2.0)
    for ax, (name, label, title, colour) in zip(axes, panels, strict=True):
        ax.plot(t, series[name], color=colour)
        ax.axhline(0.0, color="0.5", lw=0.8, zorder=1)
        ax.set_ylabel(label)
        ax.set_title(title)
        if name == "power_pto":
            _fill(ax, t, series[name], colour)
        if linear is not None:
            settled = t[-1] - run.results().get("periods", 1.0) * linear.T
            _expect(ax, (max(settled, t[0]), t[-1]), name, linear)
    if linear is not None:
        axes[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.1)
    figure.align_ylabels(axes)
    return figure


@_styled
def body(run: RunFile) -> Figure | None:
    """Motions of the rigid body, the water's force on it and the power of its PTO, on one time axis."""
    series = run.series()
    if not _has(series, "body_force"):
        return None
    force = series["body_force"]
    panels = [
        (series["surge"], "surge (m)", "displacement along the tank", BLUE),
        (series["heave"], "heave (m)", "displacement upwards", BLUE),
        (np.degrees(series["pitch"]), "pitch (deg)", "angle, positive landward", BLUE),
        (force[:, 0], "F$_x$", "the water's force along the tank (N; N/m in two dimensions)", RED),
        (force[:, 1], "F$_z$", "the water's force upwards", RED),
        (force[:, 2], "M", "the water's moment about the pivot (N m; N in two dimensions)", RED),
        (series["power_pto"], "power", "power taken by the PTO (W; W/m in two dimensions)", PURPLE),
    ]
    panels = [panel for panel in panels if np.ptp(panel[0]) > 0.0]
    if not panels:
        return None
    t, figure, axes = series["time"], *_stack(len(panels), 1.7)
    for ax, (values, label, title, colour) in zip(axes, panels, strict=True):
        ax.plot(t, values, color=colour)
        ax.axhline(0.0, color="0.5", lw=0.8, zorder=1)
        ax.set_ylabel(label)
        ax.set_title(title)
    figure.align_ylabels(axes)
    return figure


def _expect(ax: Axes, span: tuple[float, float], name: str, linear: LinearOWC) -> None:
    """Dashed lines of linear theory over a span of time."""
    if name == "power_pto":
        values = [linear.P_owc]
    else:
        # Of the pressure the peaks of the quadratic law: its fundamental would lie 15 % below them.
        peaks = {"chamber_level": abs(linear.level), "flow": abs(linear.q), "P_a": linear.P_a_peak}
        values = [-peaks[name], peaks[name]]
    for value in values:
        (line,) = ax.plot(span, [value, value], "--", color="black", lw=1.2)
    line.set_label("linear theory")


def _fill(ax: Axes, t: np.ndarray, power: np.ndarray, colour: str) -> None:
    ax.fill_between(t, power, color=colour, alpha=0.2, lw=0)
    ax.set_ylim(bottom=min(0.0, float(np.min(power))))


@_styled
def pressures(run: RunFile) -> Figure | None:
    """Gauge pressure at each sensor."""
    series = run.series()
    if not _has(series, "pressure"):
        return None
    where = [v for k, v in run.coordinates().items() if k.startswith("sensor_")]
    t, figure, axes = series["time"], *_stack(series["pressure"].shape[1], 1.9)
    for i, ax in enumerate(axes):
        ax.plot(t, series["pressure"][:, i], color=BLUE)
        point = ", ".join(f"{values[i]:.4g}" for _, values, _, _ in where)
        ax.set_title(f"sensor at ({point}) m" if point else f"sensor {i + 1}")
    figure.supylabel("gauge pressure (Pa)", fontsize=11)
    return figure


def _has(series: dict[str, np.ndarray], name: str) -> bool:
    return name in series and series[name].size > 0 and len(series["time"]) > 1


def _name(ax: Axes, kind: str) -> str:
    return f"{kind} {ax.get_subplotspec().rowspan.start + 1}"


def _stack(count: int, height: float) -> tuple[Figure, np.ndarray]:
    """A column of axes over one time axis; each `height` inches high."""
    figure = Figure(figsize=(WIDTH, 0.8 + height * count), layout="constrained")
    figure.get_layout_engine().set(w_pad=0.1, h_pad=0.08)
    axes = figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0]
    axes[-1].set_xlabel("time (s)")
    for ax in axes:
        ax.margins(x=0.0)
    return figure, axes


def _share_limits(axes: Sequence[Axes]) -> None:
    low, high = zip(*(ax.get_ylim() for ax in axes), strict=True)
    for ax in axes:
        ax.set_ylim(min(low), max(high))


# --------------------------------------------------------------------------- energy


@_styled
def energy(run: RunFile) -> Figure | None:
    """Where the paddle's work went: stacked areas under it, and what is missing."""
    series = run.series()
    if not all(_has(series, name) for name in ("kinetic", "potential", "compression")):
        return None
    terms = _energy_terms(series)
    work = _summed(series, "power_paddle")
    t, figure, axes = series["time"], *_stack(1, 5.2)
    ax = axes[0]
    # Areas lie on one another only where each is a gain; else (a prescribed pressure does work on
    # the water) lines tell the truth.
    largest = max(float(np.max(np.abs(values))) for _, values, _ in terms)
    losses = [values for _, values, _ in terms[:-1]]
    if all(float(np.min(values)) >= -0.01 * largest for values in losses):
        _areas(ax, t, terms)
    else:
        for label, values, colour in terms:
            ax.plot(t, values, color=colour, label=label)
    if np.any(work):
        ax.plot(t, work, color="black", lw=1.6, label="work of the paddle")
    ax.axhline(0.0, color="0.5", lw=0.8)
    units = run.variables()["kinetic"].units
    ax.set_ylabel("energy since the start " + ("(J)" if units == "J" else "(J/m)"))
    ax.set_title(_budget_title(series))
    handles, labels = ax.get_legend_handles_labels()
    ax.legend(handles[::-1], labels[::-1], loc="upper left")  # in the order of the areas
    return figure


def _energy_terms(series: dict[str, np.ndarray]) -> list[tuple[str, np.ndarray, str]]:
    """(label, energy since the start, colour), the lasting ones first, the stored one on top."""
    stored = series["kinetic"] + series["potential"] + series["compression"]
    terms = [
        ("taken by the PTO", _summed(series, "power_pto"), GREEN),
        ("taken by the sponge", _summed(series, "power_sponge"), PURPLE),
        ("viscous loss", _integrated(series, "loss_viscous"), ORANGE),
        ("density diffusion", _integrated(series, "loss_diffusive"), RED),
        ("met a solid", _summed(series, "power_contact"), BLUE),
        ("lost in the projection", _summed(series, "power_projection"), RED),
    ]
    shown = [term for term in terms if np.any(term[1])]
    return [*shown, (STORED, stored - stored[0], SKY)]


def _areas(ax: Axes, t: np.ndarray, terms: list[tuple[str, np.ndarray, str]]) -> None:
    base = np.zeros_like(t)
    for label, values, colour in terms:
        # The stored energy swings below the losses as the paddle draws back: it lies behind them.
        z = 1.5 if label == STORED else 2.0
        ax.fill_between(t, base, base + values, color=colour, lw=0, label=label, zorder=z)
        base = base + values


def _budget_title(series: dict[str, np.ndarray]) -> str:
    budget = analysis.energy_budget(series)
    paddle = abs(budget["paddle"])
    if paddle > 0.0 and paddle >= float(np.max(np.abs(series["kinetic"]))):
        share, whole = budget["residual"] / paddle, "the paddle's work"
    else:
        share, whole = budget["residual_share"], "the largest kinetic energy"
    return f"energy budget: {100 * share:+.2f} % of {whole} is not accounted for"


def _summed(series: dict[str, np.ndarray], name: str) -> np.ndarray:
    """Energy of a power that is the mean since the last sample (see `analysis.energy_budget`)."""
    if name not in series:
        return np.zeros_like(series["time"])
    work = np.cumsum(series[name][1:] * np.diff(series["time"]))
    return np.concatenate([[0.0], work])


def _integrated(series: dict[str, np.ndarray], name: str) -> np.ndarray:
    """Energy of a power known at the samples, by the trapezoidal rule."""
    if name not in series:
        return np.zeros_like(series["time"])
    power = series[name]
    work = np.cumsum(0.5 * (power[1:] + power[:-1]) * np.diff(series["time"]))
    return np.concatenate([[0.0], work])


# --------------------------------------------------------------------------- particles


@dataclass(frozen=True)
class Field:
    """A quantity of the particles to colour them by."""

    label: str
    colours: str | Colormap
    values: Callable[[dict[str, Any]], np.ndarray]


PRESSURE = Field("pressure (Pa)", "viridis", lambda s: s["p"])
SPEED = Field("speed (m/s)", "plasma", lambda s: np.linalg.norm(s["u"], axis=1))


@dataclass(frozen=True)
class _Tank:
    """What is drawn around the particles; lengths in m, None where the case does not say."""

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
    def of(cls, run: RunFile) -> _Tank:
        """From the case's text and the snapshots, whatever of the case is there."""
        case = tomllib.loads(run.case_toml)
        ends = [run.snapshot(i)["x"] for i in _frames(run, 12)]
        low, high = (f([f(x, axis=0) for x in ends], axis=0) for f in (np.min, np.max))
        spacing = (np.prod(high - low) / len(ends[0])) ** (1.0 / len(low))
        dx = float(case.get("dx", spacing))
        tank = case.get("tank", {})
        length = _snapped(tank.get("length"), dx)
        depth = _snapped(tank.get("depth"), dx)
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
        return list(zip(edges[:-1], edges[1:], strict=True))

    def zoom(self) -> tuple[float, float] | None:
        """x range of the device, where it would be small in the whole picture."""
        if self.plate is None or self.x1 - self.x0 < 4.0 * self.top:
            return None
        right = self.x1 + 0.05 * self.top
        return right - 2.6 * self.top, right


def _snapped(value: float | None, dx: float) -> float | None:
    """A length on the lattice, as the case is built."""
    return None if value is None else float(np.floor(value / dx + 0.5 + 1e-9)) * dx


def _plate(
    device: dict[str, Any], end: float, depth: float | None, dx: float
) -> tuple[float, float, float] | None:
    names = ("chamber_length", "wall_thickness", "draught")
    if depth is None or not all(name in device for name in names):
        return None
    length, thickness, draught = (device[name] for name in names)
    return end - length - thickness, end - length, depth - _snapped(draught, dx)


def _platform(device: dict[str, Any], end: float, dx: float) -> tuple[float, float] | None:
    if not device.get("platform_height"):
        return None
    return end - _snapped(device["platform_length"], dx), _snapped(device["platform_height"], dx)


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


@_styled
def particles(run: RunFile, field: Field = PRESSURE, index: int = -1) -> Figure | None:
    """Particles of one snapshot, coloured by a field; a long tank in strips, and the OWC enlarged.

    A three-dimensional run is cut along the middle of its width.
    """
    if run.snapshot_count == 0:
        return None
    snapshot = run.snapshot(index)
    picture = _Picture(_Tank.of(run), field, _limits(field, [snapshot]))
    picture.show(snapshot)
    return picture.figure


class _Picture:
    """A figure of particles whose snapshot can be exchanged, for stills and for animations."""

    def __init__(self, tank: _Tank, field: Field, limits: tuple[float, float]) -> None:
        self.tank, self.field = tank, field
        ranges = tank.strips()
        zoom = tank.zoom()
        if zoom is not None:
            ranges.append(zoom)
        bottom = -max(1.5 * tank.dx, 0.03 * tank.top)
        usable = WIDTH - 2.0  # beside labels and colour bar
        heights = [usable * (tank.top - bottom) / (b - a) for a, b in ranges]
        # a tank higher than long would give a tower: narrow it instead
        shrink = min(1.0, 7.0 / max(heights))
        heights = [h * shrink for h in heights]
        size = (usable * shrink + 2.0, sum(heights) + 0.35 * len(heights) + 0.75)
        self.figure = Figure(figsize=size, layout="constrained")
        self.figure.get_layout_engine().set(w_pad=0.1, h_pad=0.06)
        # some text at once, for the layout to leave room
        self.title = self.figure.suptitle(tank.name, x=0.02, ha="left", fontsize=13)
        grid = self.figure.add_gridspec(len(ranges), 1, height_ratios=heights)
        self.axes = [self.figure.add_subplot(grid[i]) for i in range(len(ranges))]
        self.dots, self.paddles, self.bodies = [], [], []
        for ax, (a, b) in zip(self.axes, ranges, strict=True):
            self._prepare(ax, (a, b), (bottom, tank.top))
            self.dots.append(self._scatter(ax, limits))
        if zoom is not None:
            self.axes[-1].set_title("the OWC, enlarged")
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
        ax.add_patch(Rectangle((tank.x0 - 1.0, z[0]), tank.x1 - tank.x0 + 2.0, thick, **solid))
        ax.add_patch(Rectangle((tank.x1, z[0]), tank.x1, z[1] - z[0], **solid))
        paddle = Rectangle((-1e3, z[0]), 1e3, z[1] - z[0], **solid)
        ax.add_patch(paddle)
        self.paddles.append(paddle)
        if tank.body is not None:
            self.bodies.append(ax.add_patch(Polygon(tank.body[0], **solid)))
        if tank.plate is not None:
            x0, x1, tip = tank.plate
            ax.add_patch(Rectangle((x0, tip), x1 - x0, z[1] - tip, **solid))
        if tank.platform is not None:
            start, height = tank.platform
            ax.add_patch(Rectangle((start, z[0]), tank.x1 - start, height - z[0], **solid))
        if tank.depth is not None:
            ax.axhline(tank.depth, color="0.5", lw=0.8, ls=(0, (6, 4)), zorder=1)

    def _scatter(self, ax: Axes, limits: tuple[float, float]) -> PathCollection:
        low, high = limits
        return ax.scatter([], [], c=[], cmap=self.field.colours, vmin=low, vmax=high, lw=0, zorder=2)

    def _size_dots(self) -> None:
        """Gives the dots the particles' size, which is known once the axes have theirs."""
        self.figure.draw_without_rendering()
        self.figure.set_layout_engine("none")  # the frames of an animation must not move
        for ax, dots in zip(self.axes, self.dots, strict=True):
            a, b = ax.transData.transform([(0.0, 0.0), (self.tank.dx, 0.0)])
            points = (b[0] - a[0]) * 72.0 / self.figure.dpi
            # The diagonal of the spacing, so that no gaps shine through where the water is full.
            dots.set_sizes([max(1.45 * points, 0.6) ** 2])

    def show(self, snapshot: dict[str, Any]) -> list[PathCollection]:
        """Puts a snapshot into the figure."""
        x, values = _cut(snapshot["x"], self.tank.dx), self.field.values(snapshot)
        for ax, dots, paddle in zip(self.axes, self.dots, self.paddles, strict=True):
            a, b = ax.get_xlim()
            near = x.seen & (x.at[:, 0] > a - self.tank.dx) & (x.at[:, 0] < b + self.tank.dx)
            dots.set_offsets(x.at[near])
            dots.set_array(values[near])
            paddle.set_x(float(snapshot.get("paddle", 0.0)) - 1e3)
        for body in self.bodies:
            body.set_xy(_posed(*self.tank.body, np.asarray(snapshot.get("body", np.zeros(3)), float)))
        self.title.set_text(f"{self.tank.name}, t = {float(snapshot['time']):.2f} s")
        return self.dots


def _posed(corners: np.ndarray, pivot: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """The outline moved by surge, heave and pitch (from z towards x)."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return (corners - pivot) @ np.array([[c, -s], [s, c]]) + pivot + pose[:2]


@dataclass(frozen=True)
class _Cut:
    """Particles in the plane of the picture."""

    at: np.ndarray
    seen: np.ndarray


def _cut(x: np.ndarray, dx: float) -> _Cut:
    seen = np.ones(len(x), bool)
    if x.shape[1] == 3:
        middle = 0.5 * (x[:, 1].min() + x[:, 1].max())
        seen = np.abs(x[:, 1] - middle) < 0.75 * dx
    return _Cut(x[:, [0, -1]], seen)


def _limits(field: Field, snapshots: Sequence[dict[str, Any]]) -> tuple[float, float]:
    """Range of colours: all but the outermost values, from zero."""
    values = np.concatenate([field.values(s) for s in snapshots])
    values = values[np.isfinite(values)]
    if values.size == 0:
        return 0.0, 1.0
    high = float(np.percentile(values, 99.5))
    return 0.0, high if high > 0.0 else 1.0


# --------------------------------------------------------------------------- animation


@_styled
def animate(run: RunFile, stem: str | Path, field: Field = PRESSURE) -> list[Path]:
    """Animates the snapshots at their own speed: STEM.gif, and STEM.mp4 where ffmpeg is found.

    **Returns** the files written; none for a run with fewer than two snapshots.
    """
    frames = _frames(run, MOST_FRAMES)
    if len(frames) < 2:
        return []
    stem = Path(stem)
    stem.parent.mkdir(parents=True, exist_ok=True)
    some = [run.snapshot(i) for i in frames[:: max(1, len(frames) // 8)]]
    picture = _Picture(_Tank.of(run), field, _limits(field, some))
    movie = FuncAnimation(
        picture.figure, lambda i: picture.show(run.snapshot(i)), frames=frames, init_func=lambda: []
    )
    times = run.snapshot_times()[frames]
    rate = float(np.clip((len(frames) - 1) / max(times[-1] - times[0], 1e-9), 2.0, 25.0))
    written = [stem.with_suffix(".gif")]
    movie.save(written[0], writer=PillowWriter(fps=rate), dpi=75)
    if shutil.which("ffmpeg"):
        written.append(stem.with_suffix(".mp4"))
        # even sides, which the usual encoder demands
        even = ["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2"]
        movie.save(written[1], writer=FFMpegWriter(fps=rate, extra_args=even), dpi=110)
    return written


def _frames(run: RunFile, most: int) -> list[int]:
    """Indices of at most `most` snapshots, evenly over the run."""
    count = run.snapshot_count
    return sorted(set(np.linspace(0, count - 1, min(count, most)).round().astype(int).tolist()))
