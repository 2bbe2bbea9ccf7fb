"""Hull from an STL file, released heeled in still water: draught and period of roll against hydrostatics.

The hull of the built-in case `hull` lies across the tank, so that it rolls in the x-z plane. Its hydrostatics
and its added inertia are computed by capytaine (Ancellin and Dias 2019) for the same triangles, in open
water of the same depth. The period of small free roll is 2 pi sqrt((I + A) / C), with the moment of inertia
I, the hydrostatic stiffness C, and the added inertia A at this period.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import Report, solved
from experiments.hull import hull
from experiments.validation.heave import extremes

RHO, G, DEPTH = 1000.0, 9.81, 0.5


def main(dx: float = 0.025) -> None:
    """Runs the built-in case and compares draught and period."""
    with Report(f"hull_{dx:g}", "Heeled hull from an STL file, released in still water, 3-D", dx) as report:
        case = js.load_case("hull").replace({"dx": dx})
        file = solved(case, f"hull_{dx:g}")
        report.seconds = file.results()["wall_seconds"]
        series = file.series()
        released = case.body.release
        free = series["time"] >= released - 1e-6
        t, roll = series["time"][free] - released, series["pitch"][free]
        times, angles = extremes(t, roll, count=4)
        period = float(2.0 * np.mean(np.diff(times[1:])))
        body = Hydrostatics(case.body.density)
        late = series["time"] >= case.t1 - period
        # the level of the water falls if the body rises, and the draught is relative to this level
        heave = float(np.mean(series["heave"][late]))
        rise = -heave * body.waterplane / (case.tank.length * case.tank.width - body.waterplane)
        draught = body.draught - (heave - rise)
        report.against("mean draught over the last period", draught, body.draught, "m", bar=0.01)
        report.against("period of roll", period, body.period(), "s", bar=0.03)
        report.row("angle of roll at the release", float(np.degrees(angles[0])), "degrees")
        for n in (1, 2, 3):
            report.row(f"angle of roll at turning point {n}", float(np.degrees(angles[n])), "degrees")
        settled = float(np.max(series["max_speed"][~free]))
        report.row("largest speed while the water settles", settled, "m/s", theory=0.0)
        report.picture(_picture(t, np.degrees(roll), body.period()))


class Hydrostatics:
    """Hydrostatics and added inertia of the hull with a uniform density (kg/m3), computed by capytaine."""

    def __init__(self, density: float) -> None:
        import capytaine

        self.library: Any = capytaine
        capytaine.set_logging("ERROR")
        surface = hull()
        surface.apply_scale(0.001)
        triangles = np.column_stack([surface.faces, surface.faces[:, 2]])
        mesh = capytaine.Mesh(np.asarray(surface.vertices), triangles).immersed_part()
        self.mass, inertia = density * surface.volume, density * surface.moment_inertia
        self.centre, self.inertia = surface.center_mass, float(inertia[0, 0])
        motions = capytaine.rigid_body_dofs(rotation_center=self.centre)
        self.body = capytaine.FloatingBody(
            mesh=mesh, dofs=motions, center_of_mass=self.centre, mass=self.mass
        )
        stiffness = self.body.compute_hydrostatic_stiffness(rho=RHO, g=G)
        self.stiffness = float(stiffness.sel(influenced_dof="Roll", radiating_dof="Roll"))
        heave = float(stiffness.sel(influenced_dof="Heave", radiating_dof="Heave"))
        self.waterplane = heave / (RHO * G)
        """Area of the waterplane, m2."""
        # the density is rounded: the difference from the displaced mass sinks the hull a little
        extra = (self.mass - RHO * mesh.volume) / (RHO * self.waterplane)
        self.draught = -float(np.min(surface.vertices[:, 2])) + extra
        """Draught at rest, m."""

    def added_inertia(self, omega: float) -> float:
        """Added moment of inertia in roll at the angular frequency omega (rad/s), kg m2."""
        problem = self.library.RadiationProblem(
            body=self.body, radiating_dof="Roll", omega=omega, water_depth=DEPTH, rho=RHO, g=G
        )
        return float(self.library.BEMSolver().solve(problem).added_masses["Roll"])

    def period(self) -> float:
        """Period of small free roll, s."""
        omega = float(np.sqrt(self.stiffness / self.inertia))
        for _ in range(8):
            omega = float(np.sqrt(self.stiffness / (self.inertia + self.added_inertia(omega))))
        return 2.0 * np.pi / omega


def _picture(t: np.ndarray, roll: np.ndarray, period: float) -> Figure:
    """Draws the angle of roll (degrees) over time (s), with turning points of free roll of `period` (s)."""
    figure = Figure(figsize=(7, 3.5), layout="constrained")
    ax = figure.subplots()
    ax.plot(t, roll)
    for n in range(1, int(2 * t[-1] / period) + 1):
        ax.axvline(0.5 * n * period, color="C3", lw=0.8, ls=":")
    ax.set(xlabel="time from the release, s", ylabel="roll, degrees", title="dotted: half periods of theory")
    return figure
