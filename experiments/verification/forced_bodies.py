"""Half-immersed bodies in forced surge, heave and roll: added mass and damping against linear theory.

The bodies move harmonically in water at rest, one motion at a time, at three frequencies. Added mass A and
damping B follow from the first harmonics of the motion x and of the water's force F over whole periods after
the start-up,

    F = (omega^2 A - i omega B - C) x    (time factor exp(i omega t)),

where -C is the first harmonic of the hydrostatic force, divided by the amplitude of the motion. The theory is
the potential flow of `jaxsph.waves.panels` at the tank's depth. Roll is about the lowest point of the body: a
cylinder that rolls about its axis moves no water in theory, and a box of these proportions almost none. In
one further run the cylinder rolls about its axis; its added inertia and damping are given as ratios to the
theoretical values for roll about its lowest point.

The bodies are a cylinder and a box. The bilges of the box are rounded with a radius of half its draught,
because potential flow does not separate. For comparison, the same box with sharp bilges heaves in another
run: energy is lost at its corners, and potential flow neglects this loss.

Waves are absorbed on both sides: by a relaxation zone towards still water, and by a sponge. A wave that
returns with the fraction r of its amplitude changes the damping by a fraction of up to r, because exciting
force and damping are related (Haskind).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import Report, solved
from experiments.floating_body import RHO, G, Points, box_outline, disc_outline
from jaxsph.analysis.coefficients import added_mass_and_damping, harmonics, of_means
from jaxsph.case.hydrostatics import submerged
from jaxsph.output.plot.style import BLUE, RED, in_style
from jaxsph.waves.panels import Hull, Section, hydrodynamics
from jaxsph.waves.theory import wavenumber

DEPTH = 0.4
"""Depth of the water, m."""
PERIODS = {"surge": (0.9, 1.1, 1.4), "heave": (0.6, 0.75, 0.9), "roll": (0.75, 0.9, 1.1)}
"""Periods of each motion, s, at which both coefficients contribute an appreciable part of the force. In
heave with a longer period the force is mainly hydrostatic: at 1 s an error of 1 % in the cylinder's
hydrostatic stiffness changes its added mass by 5 %. In surge with a shorter period the force is mainly
damping: at 0.6 s the damping of a box with sharp bilges is 7 times its added mass times the frequency."""
AMPLITUDE = 0.015
"""Amplitude of surge and heave, and in roll the amplitude of those points that move farthest, m."""
CLEAR = 0.75
"""Distance from the body to zone and sponge, m. Over this distance the slowest-decaying evanescent mode falls
to 5 %."""
ZONE, SPONGE = 1.5, 1.75
"""Lengths of zone and sponge, in wavelengths. By linear long-wave theory with their damping rates they
reflect less than 1 % of a wave's amplitude; a zone of one wavelength would reflect 3 %."""
RAMP, SETTLE, TAKEN = 1, 3, 4
"""Numbers of periods in which the motion is ramped up, the waves settle, and the force is evaluated."""
BARS = {"added mass": 0.03, "damping": 0.05}
SAMPLE = 0.01
"""Time between two samples, s."""
MOTIONS = tuple(PERIODS)
AXIS = "roll about its axis"


@dataclass(frozen=True)
class Body:
    """A half-immersed body about x = 0, with the still water level at z = 0."""

    name: str
    outline: Points
    lowest: float
    """Depth of the lowest point below the still water level, m."""
    radius: float = 0.0
    """Radius of a cylinder, m; 0 for another outline."""

    def section(self, x: float) -> dict[str, Any]:
        """Shape in a case, with the middle at x (m) and the still water level at `DEPTH`."""
        if self.radius:
            return {"disc": {"centre": [x, DEPTH], "radius": self.radius}}
        return {"polygon": np.add(self.outline, (x, DEPTH)).tolist()}


CYLINDER = Body("cylinder", disc_outline(0.12), 0.12, 0.12)
BOX = Body("box with round bilges", box_outline(0.3, 0.1, 0.2, bilge=0.05), 0.1)
SHARP = Body("box with sharp bilges", box_outline(0.3, 0.1, 0.2), 0.1)
BODIES = (CYLINDER, BOX)


@dataclass(frozen=True)
class Forced:
    """One forced motion of a body."""

    body: Body
    motion: str
    """Name of the motion: one of `MOTIONS`, or `AXIS`."""
    T: float
    """Period, s."""

    @property
    def index(self) -> int:
        """Index of the motion among surge, heave and pitch."""
        return min(MOTIONS.index(self.motion), 2) if self.motion in MOTIONS else 2

    @property
    def pivot(self) -> tuple[float, float]:
        """Position of the pivot relative to the middle of the waterline, m."""
        return (0.0, -self.body.lowest if self.motion == "roll" else 0.0)

    @property
    def amplitude(self) -> float:
        """Amplitude, m or rad."""
        if self.index < 2:
            return AMPLITUDE
        return AMPLITUDE / max(float(np.hypot(*np.subtract(p, self.pivot))) for p in self.body.outline)

    @property
    def omega(self) -> float:
        """Angular frequency, rad/s."""
        return 2.0 * np.pi / self.T

    def case(self, dx: float) -> js.Case:
        """The case with spacing dx (m)."""
        wave = 2.0 * np.pi / float(wavenumber(self.omega, DEPTH, G))
        x = ZONE * wave + CLEAR + max(x for x, _ in self.body.outline)
        x = round((x - 0.01) / 0.02) * 0.02 + 0.01  # the faces of the box are between particles
        end = x + CLEAR + max(x for x, _ in self.body.outline) + SPONGE * wave
        amplitude = [0.0, 0.0, 0.0]
        amplitude[self.index] = self.amplitude
        return js.Case.from_dict(
            {
                "name": "forced_body",
                "description": f"{self.body.name} in forced {self.motion}",
                "dx": dx,
                "t1": (RAMP + SETTLE + TAKEN) * self.T,
                "scheme": {"kind": "incompressible"},
                "tank": {"length": 0.02 * round(end / 0.02), "depth": DEPTH},
                # waves of negligible height: the zone relaxes the water towards rest
                "waves": {"H": 1e-6, "T": self.T, "zone": ZONE * wave},
                "sponge": {"length": SPONGE * wave},
                "body": self.body.section(x)
                | {
                    "pivot": [x + self.pivot[0], DEPTH + self.pivot[1]],
                    "motion": {"amplitude": amplitude, "period": self.T, "ramp": RAMP * self.T},
                },
                "output": {"sample_dt": SAMPLE, "snapshot_dt": self.T, "periods": TAKEN},
            }
        )

    def theory(self) -> tuple[float, float]:
        """Added mass (kg/m, or kg m) and damping (N s/m per metre, or N m s per metre) of linear theory."""
        water = hydrodynamics(Section(DEPTH, (Hull("body", self.body.outline, self.pivot),)), self.omega)
        return float(water.added_mass[self.index, self.index]), float(water.damping[self.index, self.index])

    def stiffness(self, phases: int = 32) -> float:
        """First harmonic of the hydrostatic restoring force over the amplitude, N/m per metre (roll: N m per
        metre).

        At a vanishing amplitude this ratio is the hydrostatic stiffness.
        """
        if self.index == 0:
            return 0.0
        sines = np.sin(2.0 * np.pi * (np.arange(phases) + 0.5) / phases)
        forces = [self._hydrostatic(self.amplitude * s) for s in sines]
        return -2.0 * float(np.mean(sines * forces)) / self.amplitude

    def _hydrostatic(self, moved: float) -> float:
        """Hydrostatic force (N/m) or moment about the pivot (N m per metre) at the displacement `moved` (m or
        rad)."""
        corners = np.asarray(self.body.outline) - self.pivot
        if self.index == 2:
            c, s = np.cos(moved), np.sin(moved)
            corners = np.stack(
                [c * corners[:, 0] + s * corners[:, 1], c * corners[:, 1] - s * corners[:, 0]], 1
            )
        rise = moved if self.index == 1 else 0.0
        wet = submerged(shapely.Polygon(corners), -self.pivot[1] - rise)
        return RHO * G * wet.area * (1.0 if self.index == 1 else -float(wet.centroid.x))

    def measured(self, series: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Added masses and dampings in each of the last periods; see `theory` for the units."""
        name = ("surge", "heave", "pitch")[self.index]
        force = np.asarray(series["body_force_mean"])
        force = force[:, self.index] if force.shape[-1] == 3 else force[self.index]
        return coefficients(series["time"], series[name], force, self.T, self.stiffness())


def coefficients(
    t: np.ndarray, x: np.ndarray, mean_force: np.ndarray, T: float, stiffness: float, periods: int = TAKEN
) -> tuple[np.ndarray, np.ndarray]:
    """Added mass and damping `[periods]` from a forced motion x and the force on the body, period by period.

    `mean_force`: force at the times t (s), each a mean over the interval before; `stiffness`: hydrostatic
    stiffness.
    """
    omega, dt = 2.0 * np.pi / T, float(np.median(np.diff(t)))
    motion, means = harmonics(t, np.stack([x, mean_force]), T, periods)
    return added_mass_and_damping(of_means(means, omega, dt) / motion, omega, stiffness)


def members() -> Iterator[Forced]:
    """All forced motions."""
    for body in BODIES:
        for motion in MOTIONS:
            for T in PERIODS[motion]:
                yield Forced(body, motion, T)
    yield Forced(SHARP, "heave", PERIODS["heave"][1])
    yield Forced(CYLINDER, AXIS, PERIODS["roll"][0])


Found = dict[Forced, tuple[np.ndarray, np.ndarray]]
"""Added masses and dampings in each period, by forced motion."""


def main(dx: float = 0.01) -> None:
    """Runs all motions."""
    title = "Bodies in forced motion: added mass and damping, against linear theory"
    with Report(f"forced_bodies_{dx:g}", title, dx) as report:
        found: Found = {}
        report.seconds = 0.0
        for one in members():
            name = f"forced_{dx:g}_{one.body.name}_{one.motion}_{one.T:g}".replace(" ", "_")
            file = solved(one.case(dx), name)
            report.seconds += file.results()["wall_seconds"]
            found[one] = one.measured(file.series())
            _rows(report, one, found[one])
        report.picture(_picture(found))


def _rows(report: Report, one: Forced, found: tuple[np.ndarray, np.ndarray]) -> None:
    """Reports the coefficients of one motion."""
    on_axis = one.motion == AXIS
    theory = Forced(one.body, "roll", one.T).theory() if on_axis else one.theory()
    units = ("kg/m", "N s/m2") if one.index < 2 else ("kg m", "N s")
    for (what, bar), unit, values, expected in zip(BARS.items(), units, found, theory, strict=True):
        here = float(np.mean(values))
        check = f"{one.body.name}, {one.motion}, T = {one.T:g} s: {what}"
        if on_axis:
            report.row(
                f"{check}, over the theoretical value for roll about its lowest point",
                here / expected,
                theory=0.0,
            )
            continue
        report.against(check, here, expected, unit, bar=bar)
        spread = float(np.std(values, ddof=1) / np.sqrt(len(values)))
        report.row("the same: standard error of the mean over the periods", 100 * spread / expected, "%")


@in_style
def _picture(found: Found) -> Figure:
    """Figure of the coefficients against the period; lines are linear theory."""
    figure = Figure(figsize=(9.0, 5.0), layout="constrained")
    rows = figure.subplots(2, len(MOTIONS))
    for k, (motion, periods) in enumerate(PERIODS.items()):
        fine = np.linspace(0.9 * periods[0], 1.1 * periods[-1], 25)
        for body, colour in zip(BODIES, (BLUE, RED), strict=True):
            of = {one: both for one, both in found.items() if one.body == body and one.motion == motion}
            theory = np.array([Forced(body, motion, float(T)).theory() for T in fine]).T
            for row, values in enumerate(theory):
                ax = rows[row, k]
                ax.plot(fine, values, color=colour, lw=1)
                at = [one.T for one in of]
                ax.errorbar(
                    at,
                    [np.mean(both[row]) for both in of.values()],
                    [np.std(both[row]) for both in of.values()],
                    color=colour,
                    fmt="o",
                    ms=4,
                    label=body.name,
                )
        for ax in rows[:, k]:
            ax.set_ylim(bottom=0)  # after all bodies, which set the upper end
        rows[0, k].set(title=motion if motion != "roll" else "roll about the lowest point")
        rows[1, k].set(xlabel="T, s")
    for row, name in zip(rows, ("added mass, kg/m (kg m)", "damping, N s/m2 (N s)"), strict=True):
        row[0].set(ylabel=name)
    rows[0, 0].legend(title="lines: linear theory", fontsize="small")
    return figure
