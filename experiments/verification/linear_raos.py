"""Free and moored boxes in small waves: RAOs of surge, heave and pitch against linear theory.

Three boxes of half the water's density, 0.3 m long and 0.2 m high, float in waves 0.03 m high: the box of Ren
et al. 2015 (the case `box_in_waves`), a box with round bilges and a keel (its centre of mass is lower), and
the box on two springs of the case `box_moored`. The first box has a metacentric height of only 0.025 m, so
that its pitch is sensitive to millimetres in the height of the centre of mass. The second has a metacentric
height of 0.09 m. It has no sharp corners in the water: vortices at such corners dissipate energy, and linear
theory neglects this dissipation. The third has the metacentric height of the first. Below every RAO of pitch
the report gives the change of the theoretical value for a centre of mass 2 mm lower.

The motions are those of the centre of mass. Their first harmonic is fitted over whole periods after the waves
have settled, together with a second harmonic and a linear drift, and is divided by the amplitude of the
incident waves, measured at three gauges. The theory is the potential flow of `jaxsph.waves.panels`.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import Report, solved
from experiments.floating_body import LinearBody, Points, Spring, box_outline, displaced
from jaxsph import analysis
from jaxsph.case.settling import settling_time
from jaxsph.output.plot.style import BLUE, GREEN, RED, in_style

H = 0.03
"""Height of the waves, m."""
PERIODS = (1.0, 1.15, 1.3)
"""Periods of the waves, s. The pitch of the free box vanishes in waves of 0.87 s, and the moored box
resonates in pitch at 1.53 s."""
MIDDLE, LEVEL = 3.15, 0.4
"""Position x of the boxes' middle, and still water level, m."""
BAR = 0.07
"""Largest allowed relative error of an RAO (-)."""
LOWER = 0.002
"""Distance by which the centre of mass is lowered, to report how much the theory changes, m."""
TAKEN = 4
"""Number of periods that are evaluated, after the waves have reached the far end of the tank."""
UNITS = {"surge": "", "heave": "", "pitch": "rad/m"}
"""Motions, and units of their RAOs."""


@dataclass(frozen=True)
class Box:
    """A floating box of a built-in case, and the changes to it."""

    name: str
    case_name: str
    inertia: float
    """Moment of inertia about the centre of mass, kg m."""
    keel: float = 0.0
    """Depth of the centre of mass below the still water level, m."""
    bilge: float = 0.0
    """Radius of the lower corners, m."""

    @property
    def outline(self) -> Points:
        """Outline relative to the middle of the waterline, m."""
        return box_outline(0.3, 0.1, 0.2, self.bilge)

    @property
    def mass(self) -> float:
        """Mass of the displaced water, kg/m."""
        return displaced(self.outline)

    def case(self, T: float, dx: float) -> js.Case:
        """The box in waves of the period T (s), at the spacing dx (m)."""
        base = js.load_case(self.case_name)
        changes = {
            "dx": dx,
            "waves.H": H,
            "waves.T": T,
            "output.periods": TAKEN,
            "body.density": None,
            "body.mass": self.mass,
            "body.inertia": self.inertia,
            "body.centre": [MIDDLE, LEVEL - self.keel],
        }
        if self.bilge:
            corners = np.add(self.outline, (MIDDLE, LEVEL))
            changes |= {"body.block": None, "body.polygon": corners.tolist()}
        case = base.replace(changes)
        end = settling_time(case) + TAKEN * T
        return case.replace({"t1": round(np.ceil(end / 0.02) * 0.02, 2)})

    def theory(self) -> LinearBody:
        """The box in linear theory."""
        springs = [
            Spring((a[0] - MIDDLE, a[1] - LEVEL), (b[0] - MIDDLE, b[1] - LEVEL), one.stiffness)
            for one in js.load_case(self.case_name).link.values()
            for a, b in [one.at]
        ]
        return LinearBody(self.outline, LEVEL, self.mass, self.inertia, (0.0, -self.keel), tuple(springs))


BOXES = (
    Box("free box", "box_in_waves", 0.378),
    Box("free box with a keel", "box_in_waves", 0.2, keel=0.06, bilge=0.05),
    Box("moored box", "box_moored", 0.325),
)


def rao(t: np.ndarray, y: np.ndarray, T: float, a: float) -> float:
    """Amplitude of a drifting motion's first harmonic in the last periods, divided by the waves' amplitude a
    (m)."""
    over = analysis.whole_periods(t, T, TAKEN)
    drift = analysis.drift_rate(t[over], y[over], T)
    return float(abs(analysis.fundamental(t[over], y[over] - drift * t[over], T))) / a


def main(dx: float = 0.01) -> None:
    """Runs the boxes in all waves."""
    title = "Free and moored boxes in small waves: RAOs against linear theory"
    with Report(f"linear_raos_{dx:g}", title, dx) as report:
        report.seconds = 0.0
        found: dict[tuple[str, float], list[float]] = {}
        for box in BOXES:
            theory = box.theory()
            lower = dataclasses.replace(theory, centre=(0.0, theory.centre[1] - LOWER))
            report.row(f"{box.name}: metacentric height", theory.metacentric_height, "m")
            for T in PERIODS:
                file = solved(box.case(T, dx), f"linear_raos_{dx:g}_{box.name.replace(' ', '_')}_{T:g}")
                series, results = file.series(), file.results()
                report.seconds += results["wall_seconds"]
                a = 0.5 * results["incident_height"]
                here = [rao(series["time"], series[name], T, a) for name in UNITS]
                found[box.name, T] = here
                expected, moved = (np.abs(one.raos(T)) for one in (theory, lower))
                for (name, unit), one, there, other in zip(UNITS.items(), here, expected, moved, strict=True):
                    report.against(f"{box.name}, T = {T:g} s: RAO of {name}", one, there, unit, bar=BAR)
                    if name == "pitch":
                        report.row(
                            "the same: change of the theoretical value with a centre of mass 2 mm lower",
                            100.0 * (other / there - 1.0),
                            "%",
                        )
                report.row("the same waves: incident height over the specified height", 2.0 * a / H)
                report.row("the same waves: reflection", results["reflection"])
        report.picture(_picture(found))


@in_style
def _picture(found: dict[tuple[str, float], list[float]]) -> Figure:
    """Figure of the RAOs against the period; lines are linear theory."""
    figure = Figure(figsize=(9.0, 3.4), layout="constrained")
    axes = figure.subplots(1, len(UNITS))
    fine = np.linspace(0.95 * PERIODS[0], 1.05 * PERIODS[-1], 40)
    for box, colour in zip(BOXES, (BLUE, GREEN, RED), strict=True):
        theory = np.abs([box.theory().raos(float(T)) for T in fine]).T
        for k, (ax, (name, unit)) in enumerate(zip(axes, UNITS.items(), strict=True)):
            ax.plot(fine, theory[k], color=colour, lw=1)
            ax.plot(PERIODS, [found[box.name, T][k] for T in PERIODS], "o", color=colour, label=box.name)
            ax.set(xlabel="T, s", ylabel=f"RAO of {name}" + (f", {unit}" if unit else ""))
    for ax in axes:
        ax.set_ylim(bottom=0)  # after all boxes, which set the upper end
    axes[0].legend(title="lines: linear theory", fontsize="small")
    return figure
