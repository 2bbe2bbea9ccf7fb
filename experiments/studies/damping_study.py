"""Section 5.2: efficiency at up to 35 pairs of damping and wave height, compared with linear theory."""

from __future__ import annotations

from typing import Annotated

import numpy as np
import typer
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import Report
from experiments.owc_tank import CHAMBER, damping_coefficient, study_case, swept

B_STAR = (30.51, 67.37, 86.09, 121.96, 162.81, 197.62, 263.20)
H_STAR = (0.16, 0.31, 0.47, 0.63, 0.78)
POINT = (0.16, 121.96, 0.54, 0.30)
"""The only published point: H*, B*, efficiency, and absorbed power in W per metre of width."""


def main(
    dx: float = 0.02,
    damping: Annotated[list[float] | None, typer.Option(help="Damping B*, repeatable; default: 7")] = None,
    height: Annotated[list[float] | None, typer.Option(help="Height H*, repeatable; default: 5")] = None,
) -> None:
    """Runs or continues the study at the spacing dx (m)."""
    case = study_case(dx, 12.0).replace({"device.wall_thickness": 0.01})
    B_star, H_star = sorted(damping or B_STAR), sorted(height or H_STAR)
    K_dm = [round(damping_coefficient(b), 2) for b in B_star]
    H = [round(h * CHAMBER, 5) for h in H_star]
    study = swept(case, {"pto.K_dm": K_dm, "waves.H": H}, f"damping_study_{dx:g}")
    water = js.linear_owc(case).water
    linear = js.linear_response(water, np.array(H)[:, None], np.array(K_dm)[None, :])
    xi, scatter, power_owc, incident = (
        study[name].T for name in ("xi", "xi_scatter", "P_owc", "incident_height")
    )
    theory = linear.xi
    best, best_linear = optimum(K_dm, xi), optimum(K_dm, theory)
    title = "Efficiency over damping and wave height (section 5.2), assumed draught of 0.16 m, no platform"
    with Report(f"damping_study_{dx:g}", title, dx) as report:
        report.seconds = float(np.nansum(study["wall_seconds"]))
        report.row("runs that failed", len(study.failures), theory=0.0, bar="none", passes=not study.failures)
        for i, h in enumerate(H_star):
            report.row(f"H* = {h:g}: largest xi", np.nanmax(xi[i]), theory=np.max(theory[i]))
            report.row(
                f"H* = {h:g}: damping B* of the largest xi",
                best[i] * scale(),
                theory=best_linear[i] * scale(),
            )
        h, b, published, power = POINT
        if h in H_star and b in B_star:
            i, j, where = H_star.index(h), B_star.index(b), f"at H* = {h:g}, B* = {b:g}"
            report.row(f"xi {where}", xi[i, j], theory=theory[i, j], paper=published)
            report.row(f"P_owc {where}", power_owc[i, j], "W/m", theory=linear.P_owc[i, j], paper=power)
        largest = np.nanmax(xi, axis=1)
        falls = np.diff(largest) < 0
        report.row(
            "efficiency rises as the waves get lower", _yes(falls.all()), paper="yes", passes=falls.all()
        )
        # in lower waves the lattice resists the flow, see `python -m experiments run small_waves`
        fine = np.array(H) > 1.5 * dx
        report.row(
            "the same for waves higher than 1.5 spacings",
            _yes(falls[fine[:-1]].all()),
            paper="yes",
            passes=falls[fine[:-1]].all(),
        )
        spread = float(np.max(best) / np.min(best))
        # in linear theory the best damping is proportional to 1/sqrt(H): its largest over its smallest value
        moves = float(np.max(best_linear) / np.min(best_linear))
        report.row("best damping B*, largest over smallest", spread, theory=moves, paper="hardly changes")
        spread, moves = (float(np.max(b[fine]) / np.min(b[fine])) for b in (best, best_linear))
        report.row(
            "the same for waves higher than 1.5 spacings", spread, theory=moves, paper="hardly changes"
        )
        report.row("scatter of xi from period to period, median", np.nanmedian(scatter))
        # the members run at the same time, one per core: these are steps per second of core time
        speed = float(np.nansum(study["steps"]) / np.nansum(study["wall_seconds"]))
        report.row("steps per second of a member on its core", speed)
        report.row("members x steps per second, two cores", 2.0 * speed)
        report.table(
            {
                "H_star": np.repeat(H_star, len(B_star)),
                "B_star": np.tile(B_star, len(H_star)),
                "xi": xi.ravel(),
                "xi_scatter": scatter.ravel(),
                "xi_linear": theory.ravel(),
                "P_owc_W_per_m": power_owc.ravel(),
                "incident_height_m": incident.ravel(),
            }
        )
        report.picture(_picture(H_star, B_star, xi, theory))


def scale() -> float:
    """Ratio of B* to K_dm (Eq. 32), kg^-0.5 m^2.5."""
    return 1.0 / damping_coefficient(1.0)


def optimum(K_dm: list[float], xi: np.ndarray) -> np.ndarray:
    """Damping (kg^0.5 m^-2.5) of the largest efficiency in every row, by a parabola in ln K_dm.

    The parabola passes through the largest value and its two neighbours. If the largest value is at an end
    of the range, that end is returned.
    """
    x, found = np.log(K_dm), []
    for row in np.asarray(xi):
        j = int(np.nanargmax(row))
        if 0 < j < len(x) - 1:
            a, b, _ = np.polyfit(x[j - 1 : j + 2], row[j - 1 : j + 2], 2)
            found.append(np.exp(-0.5 * b / a))
        else:
            found.append(K_dm[j])
    return np.array(found)


def _yes(answer: bool | np.bool_) -> str:
    return "yes" if answer else "no"


def _picture(H_star: list[float], B_star: list[float], xi: np.ndarray, theory: np.ndarray) -> Figure:
    figure = Figure(figsize=(10, 4), layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)
    levels = np.linspace(0.0, 0.8, 17)
    for axis, values, title in zip(axes, (xi, theory), ("SPH", "linear theory"), strict=True):
        drawn = axis.contourf(H_star, B_star, values.T, levels=levels, cmap="viridis")
        axis.plot(*(a.ravel() for a in np.meshgrid(H_star, B_star)), "k.", ms=2)
        axis.set(title=title, xlabel="H* = H / b1")
    axes[0].set_ylabel("B*")
    figure.colorbar(drawn, ax=axes, label="efficiency xi")
    return figure
