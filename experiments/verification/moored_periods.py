"""Moored box released in still water: periods of surge, heave and pitch against linear theory.

The box of the case `box_moored`, which is moored by two springs, is held away from its equilibrium in one
motion until the water has settled, and is then released. The period is the time from the release to the next
turning point on the same side. The theory is the free motion after the same release, with the added mass and
damping of `jaxsph.waves.panels` at all frequencies, and with hydrostatic and spring stiffness. The
undamped natural periods, with the added mass at the natural frequency, are also reported; heave is damped
so much that the time between two turning points differs from its undamped period.

The tank is so long that no wave returns from its ends before the last turning point, even at the speed of the
longest waves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import Report, solved
from experiments.floating_body import G, LinearBody
from experiments.validation.heave import extremes
from experiments.verification.linear_raos import BOXES
from jaxsph.output.plot.style import BLUE, in_style

DEPTH = 0.4
"""Depth of the water, m."""
HELD = 1.0
"""Time for which the box is held while the water settles, s."""
BAR = 0.02
"""Largest allowed relative error of a period (-)."""
SPEED = float(np.sqrt(G * DEPTH))
"""Speed of the longest waves, m/s."""
SWINGS = 2
"""Number of turning points that are needed: half a period and a whole period after the release."""


@dataclass(frozen=True)
class Release:
    """A release from a displacement in one motion."""

    motion: str
    away: float
    """Displacement from equilibrium at the release, m or rad."""
    free: float
    """Duration of the computed free motion, s; it ends after the second turning point."""

    @property
    def start(self) -> list[float]:
        """Displacements in surge (m), heave (m) and pitch (rad) at the release."""
        return [self.away if self.motion == name else 0.0 for name in ("surge", "heave", "pitch")]

    @property
    def length(self) -> float:
        """Length of the tank, m."""
        return 0.1 * float(np.ceil(10.0 * (0.3 + SPEED * self.free)))

    def case(self, dx: float) -> js.Case:
        """The box on its springs in still water, at the spacing dx (m)."""
        base = js.load_case("box_moored")
        # A case takes the given position of a body as its position at rest. The box is displaced from its
        # equilibrium, so the rest lengths of the links must be given.
        middle = 0.5 * self.length
        x, z, angle = self.start
        block = base.body.block
        moved = {"low": [middle - 0.15 + x, block.low[1] + z], "high": [middle + 0.15 + x, block.high[1] + z]}
        links = {}
        for name, one in base.link.items():
            (xb, zb), (xt, zt) = one.at
            ends = [[xb - 3.15 + middle + x, zb + z], [xt - 3.15 + middle, zt]]
            rest = float(np.hypot(xb - xt, zb - zt))
            links[name] = {"between": list(one.between), "at": ends, "rest": rest, "stiffness": one.stiffness}
        changes = {
            "dx": dx,
            "t1": HELD + self.free,
            "waves": None,
            "sponge": None,
            "probes.gauges": [],
            "tank.length": self.length,
            "body.block": moved,
            "body.angle": angle,
            "body.release": HELD,
            "link": links,
            "output": {"sample_dt": 0.01, "snapshot_dt": 0.2},
        }
        return base.replace(changes)

    def free_motion(self, series: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Times from the release (s) and displacements from equilibrium (m or rad) of a run."""
        after = series["time"] >= HELD - 1e-6
        t, y = series["time"][after] - HELD, np.asarray(series[self.motion][after], float)
        # surge and heave are measured from the position at t = 0, the angle from upright
        return t, y if self.motion == "pitch" else y + self.away

    def theory(self, body: LinearBody) -> tuple[np.ndarray, np.ndarray]:
        """Times (s) and displacements (m or rad) of linear theory."""
        t = np.arange(0.0, self.free + 1e-9, 0.01)
        return t, body.decay(self.start, t)[("surge", "heave", "pitch").index(self.motion)]


RELEASES = (Release("surge", 0.04, 5.8), Release("heave", 0.02, 1.3), Release("pitch", 0.08, 2.0))


def main(dx: float = 0.01) -> None:
    """Runs the three releases."""
    body = BOXES[-1].theory()
    title = "Moored box released in still water: periods against linear theory"
    with Report(f"moored_periods_{dx:g}", title, dx) as report:
        report.seconds = 0.0
        figure = Figure(figsize=(9.0, 3.2), layout="constrained")
        for ax, one in zip(figure.subplots(1, len(RELEASES)), RELEASES, strict=True):
            file = solved(one.case(dx), f"moored_periods_{dx:g}_{one.motion}")
            report.seconds += file.results()["wall_seconds"]
            here, there = one.free_motion(file.series()), one.theory(body)
            _rows(report, one, here, there)
            natural = body.natural_period(one.motion)
            report.row(f"theory: undamped natural period of {one.motion}", natural, "s")
            _draw(ax, one, here, there)
        report.picture(figure)


def _rows(report: Report, one: Release, here, there) -> None:
    """Reports the period, and the ratio of the displacements during the second and the first swing."""
    (times, heights), (expected, left) = (extremes(path[0], path[1], SWINGS) for path in (here, there))
    report.against(f"{one.motion}: period", times[2], expected[2], "s", bar=BAR)
    swings, theory = (abs((h[2] - h[1]) / (h[1] - h[0])) for h in (heights, left))
    report.row(
        "the same: displacement during the second swing over that during the first", swings, theory=theory
    )
    back = (one.length - 0.3) / SPEED
    report.row("the same: earliest return of a wave from the tank's ends", back, "s", passes=back > times[2])


@in_style
def _draw(ax, one: Release, here, there) -> None:
    """Draws a free motion over time."""
    ax.plot(there[0], there[1] / one.away, "k--", lw=1, label="linear theory")
    ax.plot(here[0], here[1] / one.away, color=BLUE, label="computed")
    ax.set(xlabel="t from the release, s", title=one.motion)
    if one.motion == "surge":
        ax.set(ylabel="displacement over that at the release")
        ax.legend(fontsize="small")
