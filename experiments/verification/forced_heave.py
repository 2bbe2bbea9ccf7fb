"""Sphere and upright cylinder in forced heave, 3-D: added mass and damping against linear theory.

The lower edge of the cylinder is rounded, because the flow separates at a sharp edge, which linear theory
neglects. With a sharp edge the added mass is 11 % and the damping 183 % too large at T = 0.7 s (amplitude
0.02 m, dx = 0.025 m).

Added mass A and damping B follow from the first harmonics of the motion and of the water's force in the last
two periods, as in `forced_bodies`. Linear theory is computed by the panel method of capytaine (Ancellin
and Dias 2019) in open water of the same depth. Sponge layers along all four walls absorb the waves; in
addition the record ends at about the time at which waves from the start of the motion, reflected by the
walls, reach the body.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import Report, solved
from experiments.verification.forced_bodies import coefficients
from jaxsph.output.plot.style import BLUE, RED, in_style

RHO, G, DEPTH, RADIUS, DRAUGHT, EDGE = 1000.0, 9.81, 0.4, 0.15, 0.1, 0.05
"""Density (kg/m3), acceleration of gravity (m/s2), depth, radius of both bodies, and draught and radius of
the lower edge of the cylinder (m)."""
PERIODS = {0.7: 1.6, 0.85: 2.0}
"""Periods (s), and for each the length (m) of the tank, equal to its width."""
AMPLITUDE = 0.01
"""Amplitude of the heave, m."""
RAMP, SETTLE, TAKEN = 1, 1, 2
"""Numbers of periods in which the motion is ramped up, the waves settle, and the force is evaluated."""
BARS = {"added mass": 0.05, "damping": 0.1}


@dataclass(frozen=True)
class Forced:
    """A body in forced heave with the period T."""

    body: str
    """Name of the body: "sphere", half immersed, or "cylinder", upright."""
    T: float
    """Period, s."""

    @property
    def omega(self) -> float:
        """Angular frequency, rad/s."""
        return 2.0 * np.pi / self.T

    def case(self, dx: float) -> js.Case:
        """The case with spacing dx (m)."""
        size = PERIODS[self.T]
        middle = 0.5 * size
        if self.body == "sphere":
            shape: dict[str, Any] = {"sphere": {"centre": [middle, middle, DEPTH], "radius": RADIUS}}
        else:
            half = [*self.profile(8), (RADIUS, DRAUGHT), (0.0, DRAUGHT)]
            corners = np.add(half, (0.0, DEPTH)).tolist()
            shape = {"revolution": {"profile": corners, "axis": [middle, middle]}}
        heave = {"amplitude": [0.0, 0.0, AMPLITUDE, 0.0, 0.0, 0.0], "period": self.T, "ramp": RAMP * self.T}
        return js.Case.from_dict(
            {
                "name": "forced_heave",
                "description": f"{self.body} in forced heave, 3-D",
                "dx": dx,
                "t1": (RAMP + SETTLE + TAKEN) * self.T,
                "scheme": {"kind": "incompressible"},
                "tank": {"length": size, "width": size, "depth": DEPTH},
                "sponge": dict.fromkeys(("length", "near", "sides"), 0.25 * size),
                "body": shape | {"motion": heave},
                "output": {"sample_dt": 0.01, "snapshot_dt": self.T, "periods": TAKEN},
            }
        )

    def stiffness(self) -> float:
        """First harmonic of the hydrostatic force over the amplitude, N/m: exact for both bodies."""
        waterplane = np.pi * RADIUS**2
        # the displaced volume of a sphere whose centre is z above the level is pi (2 R^3/3 - R^2 z + z^3/3)
        return RHO * G * (waterplane - (0.25 * np.pi * AMPLITUDE**2 if self.body == "sphere" else 0.0))

    @cached_property
    def theory(self) -> np.ndarray:
        """Added mass (kg) and damping (N s/m) of linear theory.

        Both are extrapolated from two panel sizes. The error of the panels at the waterline is of first
        order: with 32 panels over a quarter of a turn the added mass of the sphere is 0.9 % too large.
        """
        return 2.0 * self._by_panels(32) - self._by_panels(16)

    def profile(self, fine: int) -> np.ndarray:
        """Corners (r, z) of half the cross-section below the waterline, from the axis to the waterline, m.

        `fine`: number of chords over a quarter of a turn.
        """
        turn = 0.5 * np.pi * np.arange(fine + 1) / fine
        arc = np.stack([np.sin(turn), -np.cos(turn)], 1)
        if self.body == "sphere":
            return RADIUS * arc
        inner, side = RADIUS - EDGE, np.arange(1, fine + 1) / fine
        flat = np.stack([inner * np.arange(fine) / fine, np.full(fine, -DRAUGHT)], 1)
        wall = np.stack([np.full(fine, RADIUS), -(DRAUGHT - EDGE) * (1.0 - side)], 1)
        return np.concatenate([flat, (inner, EDGE - DRAUGHT) + EDGE * arc, wall])

    def _by_panels(self, fine: int) -> np.ndarray:
        """Added mass (kg) and damping (N s/m), with `fine` panels over a quarter of a turn."""
        import capytaine

        capytaine.set_logging("ERROR")
        r, z = self.profile(fine).T
        # capytaine sorts the points by height: the flat bottom gets an inclination of 1e-9
        points = np.stack([r, np.zeros_like(r), z + 1e-9 * r], 1)
        mesh = capytaine.RotationSymmetricMesh.from_profile_points(points, n=4 * fine)
        body = capytaine.FloatingBody(mesh=mesh)
        body.add_translation_dof(name="Heave")
        problem = capytaine.RadiationProblem(
            body=body, radiating_dof="Heave", omega=self.omega, water_depth=DEPTH, rho=RHO, g=G
        )
        found: Any = capytaine.BEMSolver().solve(problem)
        return np.array([found.added_masses["Heave"], found.radiation_dampings["Heave"]], float)


BODIES = ("sphere", "cylinder")


def main(dx: float = 0.025, T: float = 0.7) -> None:
    """Runs both bodies with the period T (s), one of `PERIODS`."""
    if T not in PERIODS:
        raise ValueError(
            f"T = {T:g} s must be {' or '.join(map(str, PERIODS))} s: the tanks are defined for these periods"
        )
    title = f"Sphere and cylinder in forced heave, T = {T:g} s, 3-D: added mass and damping"
    with Report(f"forced_heave_{dx:g}_{T:g}", title, dx) as report:
        report.seconds, forces = 0.0, {}
        for one in (Forced(body, T) for body in BODIES):
            file = solved(one.case(dx), f"forced_heave_{dx:g}_{one.body}_{T:g}")
            report.seconds += file.results()["wall_seconds"]
            series = file.series()
            t, z, force = series["time"], series["heave"], series["body_force_mean"][:, 2]
            # the first reading precedes the first step, and has no force
            forces[one] = t[1:], force[1:] - np.mean(force[t > (RAMP + SETTLE) * T])
            found = coefficients(t, z, force, T, one.stiffness(), TAKEN)
            units, theory = ("kg", "N s/m"), one.theory.tolist()
            for (what, bar), unit, values, expected in zip(BARS.items(), units, found, theory, strict=True):
                report.against(f"{one.body}: {what}", float(np.mean(values)), expected, unit, bar=bar)
                apart = float(values[1] - values[0]) / expected
                report.row("the same: value in the second period minus that in the first", 100 * apart, "%")
        report.picture(_picture(forces))


@in_style
def _picture(forces: dict[Forced, tuple[np.ndarray, np.ndarray]]) -> Figure:
    """Figure of the vertical force minus its mean, against time; dotted: linear theory."""
    figure = Figure(figsize=(9.0, 3.0), layout="constrained")
    axes = figure.subplots(1, len(forces), sharey=True)
    for (one, (t, force)), ax in zip(forces.items(), axes.flat, strict=True):
        mass, damping = one.theory
        spring, omega = one.stiffness(), one.omega
        late = t > (RAMP + SETTLE) * one.T
        theory = (omega**2 * mass - spring) * np.sin(omega * t) - omega * damping * np.cos(omega * t)
        ax.plot(t, force, color=BLUE, label="here")
        ax.plot(t[late], AMPLITUDE * theory[late], color=RED, ls=":", label="linear theory")
        ax.set(title=one.body, xlabel="time, s")
    axes[0].set_ylabel("force, N")
    axes[0].legend(fontsize="small")
    return figure
