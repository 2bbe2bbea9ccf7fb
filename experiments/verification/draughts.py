"""Floating bodies of four densities at ten positions relative to the lattice, against hydrostatic draughts.

Boxes, discs and triangles are released in still water at their hydrostatic draughts and are free to heave. In
a second set, boxes are free in all motions. Ten bodies of one shape and density float in one tank. Their
sizes are such that their draughts differ by less than a spacing, and their lowest points have ten different
positions relative to the lattice, a tenth of a spacing apart. The horizontal positions of their middles
differ likewise. The tank is closed: bodies that sink raise its level, which is computed from their motions
and included in the draught.
"""

from __future__ import annotations

import abc
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from matplotlib.figure import Figure
from scipy.optimize import root_scalar

import jaxsph as js
from experiments.common import Report, solved
from jaxsph.output.plot.style import in_style

DEPTH, APART = 0.4, 0.5
"""Depth of the water, and distance between the middles of two bodies, m."""
PLACES = 10
"""Number of bodies; each has a different position relative to the lattice."""
RATIOS = (0.3, 0.5, 0.7, 0.9)
"""Ratios of the bodies' densities to the water's (-)."""
SETTLED, T1 = 5.0, 7.0
"""Start and end of the interval over which the draughts are averaged, s: at least two periods of heave."""
BAR = 0.3
"""Largest allowed error of the mean draught, in spacings."""


class Shape(abc.ABC):
    """A shape of adjustable size; draughts and widths are relative to the size."""

    name: str
    usual: float
    """Approximate size of the bodies, m."""

    @abc.abstractmethod
    def draught(self, ratio: float) -> float:
        """Draught over size (-) at which a body of `ratio` times the water's density floats."""

    @abc.abstractmethod
    def width(self, draught: float) -> float:
        """Width at the waterline over size (-), at the draught over size `draught` (-)."""

    @abc.abstractmethod
    def section(self, x: float, foot: float, size: float) -> dict[str, Any]:
        """Keys of the section of a body in a case.

        `x`: position of its middle, m; `foot`: height of its lowest point, m; `size`: its size, m.
        """

    @abc.abstractmethod
    def outline(self) -> shapely.Polygon:
        """Outline of the shape of size 1, with the middle of its foot at (0, 0)."""


@dataclass(frozen=True)
class Box(Shape):
    """Upright box; its size is its height."""

    name: str = "box"
    usual: float = 0.2
    over: float = 1.0
    """Ratio of width to height (-)."""

    def draught(self, ratio):
        """See `Shape`."""
        return ratio

    def width(self, draught):
        """See `Shape`."""
        return self.over

    def section(self, x, foot, size):
        """See `Shape`."""
        half = 0.5 * self.over * size
        return {"block": {"low": [x - half, foot], "high": [x + half, foot + size]}}

    def outline(self):
        """See `Shape`."""
        return shapely.box(-0.5 * self.over, 0.0, 0.5 * self.over, 1.0)


@dataclass(frozen=True)
class Disc(Shape):
    """Circular cylinder; its size is its diameter."""

    name: str = "disc"
    usual: float = 0.2

    def draught(self, ratio):
        """See `Shape`: a segment of half angle a has the fraction (a - sin a cos a) / pi of the area."""

        def too_much(angle: float) -> float:
            return angle - np.sin(angle) * np.cos(angle) - np.pi * ratio

        return 0.5 * (1.0 - float(np.cos(root_scalar(too_much, bracket=(0.0, np.pi), xtol=1e-14).root)))

    def width(self, draught):
        """See `Shape`."""
        return 2.0 * float(np.sqrt(draught * (1.0 - draught)))

    def section(self, x, foot, size):
        """See `Shape`."""
        return {"disc": {"centre": [x, foot + 0.5 * size], "radius": 0.5 * size}}

    def outline(self):
        """See `Shape`."""
        return shapely.Point(0.0, 0.5).buffer(0.5, quad_segs=2000)


@dataclass(frozen=True)
class Triangle(Shape):
    """Equilateral triangle; its size is its height."""

    name: str
    """Name of the shape, which states whether the point is up or down."""
    down: bool
    """Whether a corner, not a side, is the lowest part."""
    usual: float = 0.2

    def draught(self, ratio):
        """See `Shape`."""
        return float(np.sqrt(ratio) if self.down else 1.0 - np.sqrt(1.0 - ratio))

    def width(self, draught):
        """See `Shape`."""
        return 2.0 / float(np.sqrt(3.0)) * (draught if self.down else 1.0 - draught)

    def section(self, x, foot, size):
        """See `Shape`."""
        corners = size * np.asarray(self.outline().exterior.coords)[:-1] + [x, foot]
        return {"polygon": corners.tolist()}

    def outline(self):
        """See `Shape`."""
        half = 1.0 / float(np.sqrt(3.0))
        if self.down:
            return shapely.Polygon([(0.0, 0.0), (half, 1.0), (-half, 1.0)])
        return shapely.Polygon([(-half, 0.0), (half, 0.0), (0.0, 1.0)])


SHAPES = (Box(), Disc(), Triangle("triangle, point down", True), Triangle("triangle, point up", False))
FLAT = Box("flat box, free in all motions", 0.12, 2.0)
"""A box twice as wide as high; its metacentre is well above its centre of mass at all densities."""


@dataclass(frozen=True)
class Tank:
    """Bodies of one shape and density in a closed tank."""

    shape: Shape
    ratio: float
    """Ratio of the bodies' density to the water's (-)."""
    dx: float
    """Spacing of the particles, m."""
    free: tuple[str, ...] = ("heave",)
    """Free motions of the bodies."""
    places: int = PLACES
    """Number of bodies."""

    @property
    def length(self) -> float:
        """Length of the tank, m."""
        return APART * self.places

    def offsets(self) -> np.ndarray:
        """Distances `[places, 2]` of each body's middle (in x) and lowest point (in z) from the lattice line
        below, in spacings, from 0 to less than 1."""
        # 3 is coprime to ten: every tenth occurs once along each axis
        place = np.arange(self.places)
        return np.stack([place, 3 * place % self.places], axis=1) / self.places

    def draughts(self) -> np.ndarray:
        """Hydrostatic draughts, m: whole numbers of spacings plus the offsets, near the usual draught."""
        usual, offset = self.shape.draught(self.ratio) * self.shape.usual, self.offsets()[:, 1]
        return self.dx * (np.round(usual / self.dx - offset) + offset)

    def sizes(self) -> np.ndarray:
        """Sizes of the bodies, m."""
        return self.draughts() / self.shape.draught(self.ratio)

    def case(self, t1: float = T1) -> js.Case:
        """The case, to the time t1 (s)."""
        x = APART * (np.arange(self.places) + 0.5)
        x = self.dx * (np.floor(x / self.dx) + self.offsets()[:, 0])
        feet = DEPTH - self.draughts()
        bodies = {
            f"body_{k}": self.shape.section(float(x[k]), float(feet[k]), float(size))
            | {"density": 1000.0 * self.ratio, "free": list(self.free)}
            for k, size in enumerate(self.sizes())
        }
        return js.Case.from_dict(
            {
                "name": "draughts",
                "description": f"floating: {self.shape.name}, {self.ratio:g} of the water's density",
                "dx": self.dx,
                "t1": t1,
                "scheme": {"kind": "incompressible"},
                "tank": {"length": self.length, "depth": DEPTH},
                "bodies": bodies,
                "output": {"sample_dt": 0.02, "snapshot_dt": 1.0},
            }
        )

    def errors(self, series: dict[str, np.ndarray], since: float = SETTLED) -> np.ndarray:
        """Mean draughts after the time `since` (s) minus the hydrostatic draughts, in spacings."""
        over = series["time"] >= since
        heave = np.array([np.mean(series[f"heave_body_{k}"][over]) for k in range(self.places)])
        widths = self.shape.width(self.shape.draught(self.ratio)) * self.sizes()
        # the water displaced by bodies that sink raises the level
        rise = -float(widths @ heave) / (self.length - float(widths.sum()))
        return (rise - heave) / self.dx

    def tilts(self, series: dict[str, np.ndarray], since: float = SETTLED) -> np.ndarray:
        """Mean pitch after the time `since` (s), rad."""
        over = series["time"] >= since
        return np.array([np.mean(series[f"pitch_body_{k}"][over]) for k in range(self.places)])


Found = list[tuple[Tank, np.ndarray]]
"""Tanks, and errors of the draughts of their bodies, in spacings."""


def main(dx: float = 0.02, places: int = PLACES, t1: float = T1) -> None:
    """Runs the tanks of all shapes and densities; averages are over the last two seconds."""
    since = t1 - (T1 - SETTLED)
    free = ("surge", "heave", "pitch")
    tanks = [Tank(shape, ratio, dx, places=places) for shape in SHAPES for ratio in RATIOS]
    tanks += [Tank(FLAT, ratio, dx, free, places) for ratio in RATIOS]
    title = f"Floating bodies at {places} positions relative to the lattice"
    with Report(f"draughts_{dx:g}", title, dx) as report:
        found: Found = []
        report.seconds = 0.0
        for tank in tanks:
            word = tank.shape.name.replace(", ", "_").replace(" ", "_")
            file = solved(tank.case(t1), f"draughts_{dx:g}_{word}_{tank.ratio:g}", t1)
            report.seconds += file.results()["wall_seconds"]
            series = file.series()
            errors = tank.errors(series, since)
            found.append((tank, errors))
            worst = float(errors[np.argmax(np.abs(errors))])
            report.row(
                f"{tank.shape.name}, {tank.ratio:g} times the water's density: largest error of the draught",
                worst,
                "dx",
                theory=0.0,
                bar=f"within {BAR:g} dx",
                passes=abs(worst) < BAR,
            )
            report.row("the same: mean error", float(np.mean(errors)), "dx", theory=0.0)
            if "pitch" in tank.free:
                tilt = float(np.max(np.abs(tank.tilts(series, since))))
                report.row("the same: largest mean pitch", np.degrees(tilt), "degrees", theory=0.0)
        report.picture(_picture(found))


@in_style
def _picture(found: Found) -> Figure:
    """Figure of the errors over the position of the lowest point between two lattice lines, by shape."""
    names: Sequence[str] = list(dict.fromkeys(tank.shape.name for tank, _ in found))
    figure = Figure(figsize=(2.6 * len(names), 3.4), layout="constrained")
    axes = np.atleast_1d(figure.subplots(1, len(names), sharey=True))
    for ax, name in zip(axes, names, strict=True):
        ax.axhspan(-BAR, BAR, color="0.93")
        for tank, errors in found:
            if tank.shape.name == name:
                place = tank.offsets()[:, 1]
                order = np.argsort(place)
                ax.plot(place[order], errors[order], "o-", ms=3, lw=0.8, label=f"{tank.ratio:g}")
        ax.set(title=name, xlabel="lowest point above a lattice line, dx")
        ax.title.set_fontsize("small")
    axes[0].set(ylabel="error of the draught, dx")
    axes[-1].legend(title="density", fontsize="small")
    return figure
