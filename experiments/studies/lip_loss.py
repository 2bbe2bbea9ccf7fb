"""What the lip of the OWC's front wall loses: the scheme's part and the flow's part.

A sharp edge sheds vortices, and loses energy in nature too. This loss grows with the square of the flow, so
that its coefficient zeta depends neither on the height of the waves nor on the spacing. A loss of the scheme
depends on the spacing and on the strength of hyperviscosity, and a rounded lip loses less than a sharp one
only if the loss is the flow's. For every run, zeta is the coefficient with which linear theory
(`waves.linear_owc`) has the flow of the run, in waves of the measured height.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import Report, solved
from experiments.owc_tank import amplitude
from experiments.studies.convergence import study_case

FRONT = (2.83, 2.87, 0.26)
"""Faces of the thick front wall and height of its lip, m."""
TOP = 0.8
"""Height of the thick wall's top, m."""
ZETA = np.linspace(0.0, 40.0, 4001)
"""Loss coefficients of the lip among which that of a run is found (-)."""


class Variant(NamedTuple):
    """Run of the study."""

    label: str
    dx: float
    """Spacing, m."""
    changes: dict[str, Any]
    """Changes to the case."""


def variants() -> list[Variant]:
    """Runs of the study, the fast ones first."""

    def at(dx: float, **changes: Any) -> Variant:
        keys, units = {"strength": "scheme.hyperviscosity", "H": "waves.H"}, {"strength": "", "H": " m"}
        each = (f"{name} = {value:g}{units[name]}" for name, value in changes.items())
        words = [f"{1e3 * dx:g} mm", *each]
        return Variant(", ".join(words), dx, {keys[name]: value for name, value in changes.items()})

    strengths = [at(dx, strength=s) for dx in (0.02, 0.01) for s in (0.3, 3.0)]
    heights = [at(0.01, H=H) for H in (0.02, 0.06)]
    lips = [
        Variant(f"{1e3 * dx:g} mm, thick wall, {name} lip", dx, thick_wall(round_lip))
        for dx in (0.02, 0.01)
        for name, round_lip in (("square", False), ("round", True))
    ]
    return [*(at(dx) for dx in (0.02, 0.01)), *strengths, *heights, *lips, at(0.005)]


def thick_wall(round_lip: bool) -> dict[str, Any]:
    """Changes that replace the front wall by one of 0.04 m with a square lip, or a lip that is a half
    circle."""
    left, right, tip = FRONT
    radius = 0.5 * (right - left)
    angles = np.linspace(np.pi, 2.0 * np.pi, 25) if round_lip else np.zeros(0)
    middle = np.array([left + radius, tip + radius])
    lip = (middle + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)).tolist()
    outline = [[left, TOP], *(lip or [[left, tip], [right, tip]]), [right, TOP]]
    return {
        "device": None,
        "pto": None,
        "solid.front.polygon": outline,
        "chamber.column.between": ["front", "far"],
        "chamber.column.pto.K_dm": study_case("incompressible", 0.02).pto.K_dm,
    }


def main(t1: float = 14.0, finest: float = 0.005) -> None:
    """Runs or continues the variants whose spacing is at least `finest` (m)."""
    chosen = [one for one in variants() if one.dx >= finest - 1e-9]
    with Report("lip_loss", "Loss at the lip of the OWC's front wall") as report:
        found, seconds = {}, 0.0
        for one in chosen:
            case = study_case("incompressible", one.dx).replace(one.changes)
            name = "lip_loss_" + "".join(c if c.isalnum() or c == "." else "_" for c in one.label)
            file = solved(case, name, t1)
            found[one.label] = _read(case, file.series(), file.results(), int(file.results()["periods"]))
            seconds += file.results()["wall_seconds"]
            for key, (label, unit) in ROWS.items():
                report.row(f"{one.label}: {label}", found[one.label][key], unit)
        report.seconds = seconds
        report.picture(_picture(found))


ROWS = {
    "xi": ("xi over the measured incident wave", ""),
    "flow": ("amplitude of the flow", "m2/s"),
    "pressure": ("amplitude of the pressure", "Pa"),
    "zeta": ("loss coefficient of linear theory with this flow", ""),
    "zeta_xi": ("loss coefficient of linear theory with this xi", ""),
    "lost": ("incident power neither absorbed nor reflected", "%"),
    "hyperviscosity": ("lost by hyperviscosity, of the paddle's work", "%"),
    "noise": ("noise", ""),
}
"""Labels and units of the values of a run."""


def _read(
    case: js.Case, series: dict[str, np.ndarray], results: dict[str, float], periods: int
) -> dict[str, float]:
    """Values of a run, see `ROWS`."""
    H, T = results["incident_height"], case.waves.T
    reading = "" if "flow" in series else "_column"
    # like the reflection and the flow of linear theory, in waves of the measured height
    xi = results["xi_measured"]
    flow, pressure = (amplitude(series, f"{name}{reading}", T, periods) for name in ("flow", "P_a"))
    usual = study_case("incompressible", case.dx)
    thickness = usual.device.wall_thickness if case.device is not None else FRONT[1] - FRONT[0]
    water, K_dm = js.linear_owc(usual.replace({"device.wall_thickness": thickness})).water, usual.pto.K_dm
    theory = js.linear_response(water, H, K_dm, case.fluid.rho0, ZETA)
    # flow and efficiency fall with growing loss
    zeta, zeta_xi = (
        float(np.interp(-here, -expected, ZETA))
        for here, expected in ((flow, np.abs(theory.q)), (xi, theory.xi))
    )
    return {
        "xi": xi,
        "flow": flow,
        "pressure": pressure,
        "zeta": zeta,
        "zeta_xi": zeta_xi,
        "lost": 100.0 * (1.0 - xi - results["reflection"] ** 2),
        "hyperviscosity": 100.0 * results["energy_hyperviscosity"] / results["energy_paddle"],
        "noise": results["noise"],
    }


def _picture(found: dict[str, dict[str, float]]) -> Figure:
    figure = Figure(figsize=(9, 4), layout="constrained")
    axis, other = figure.subplots(1, 2, sharey=True)
    places = np.arange(len(found))
    for at, names, title in (
        (axis, ("zeta", "zeta_xi"), "loss coefficient of the lip"),
        (other, ("hyperviscosity", "lost"), "share of the energy, %"),
    ):
        for k, name in enumerate(names):
            width = 0.8 / len(names)
            values = [one[name] for one in found.values()]
            at.barh(places + k * width, values, width, label=ROWS[name][0])
        at.set(title=title)
        at.legend(fontsize="x-small", loc="upper center", bbox_to_anchor=(0.5, -0.08))
    axis.set_yticks(places + 0.2, list(found), fontsize="small")
    axis.invert_yaxis()
    return figure
