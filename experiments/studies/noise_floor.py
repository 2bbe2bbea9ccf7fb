"""How much of the noise measured near the OWC is due to the flow, from the finest run.

The noise of a particle is the difference between its velocity and a linear fit to its neighbours within three
spacings. Around the lip of the front wall the flow turns within a few spacings, and no linear fit can follow
it. Here the velocities of the finest run are averaged over the cells of each coarser lattice, which has no
disorder, so that any noise measured there is due to the flow. In both cases particles on opposite sides of
the wall are not neighbours.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
import typer
from scipy.spatial import KDTree

from experiments.common import Report, solved
from experiments.studies.convergence import SPACINGS, study_case
from jaxsph.probes.noise import REACH, WIDTH

NEAR = 0.6
"""Distance from the end wall within which particles are measured, m."""
LIP = 4.0
"""Distance from the lip, in spacings, beyond which a second value is reported."""


def main(
    dx: Annotated[
        list[float] | None, typer.Option(help="Spacing, m; repeatable; default: 0.02, 0.01.")
    ] = None,
    finest: float = SPACINGS[-1],
    t1: float = 14.0,
) -> None:
    """Runs or continues the incompressible OWC at these spacings, and reports the noise at t1 (s)."""
    with Report(
        "noise_floor", f"Noise over the RMS speed within {NEAR:g} m of the OWC's end wall at t = {t1:g} s"
    ) as report:
        report.seconds = 0.0
        flow = _particles(finest, t1, report)
        for spacing in sorted(dx or SPACINGS[:-1], reverse=True):
            ends, lip = _ends(spacing)
            x, u = _particles(spacing, t1, report)
            places = _lattice(flow[0], spacing, finest)
            for what, points, velocities in (
                ("particles of the run", x, u),
                (
                    f"flow of the run at {1e3 * finest:g} mm, averaged onto the lattice",
                    places,
                    _averaged(*flow, places, spacing, lip),
                ),
            ):
                near = points[:, 0] > ends - NEAR
                off = near & (np.hypot(*(points - lip).T) > LIP * spacing)
                where = f"dx = {1e3 * spacing:g} mm, {what}"
                for name, mask in ((where, near), (f"{where}, more than {LIP:g} spacings from the lip", off)):
                    report.row(name, 100.0 * noise(points, velocities, spacing, mask, lip), "%")


def noise(x: np.ndarray, u: np.ndarray, dx: float, mask: np.ndarray, lip: np.ndarray) -> float:
    """RMS difference of velocities from linear fits to neighbours, divided by the RMS speed of these points
    (-).

    **Arguments**: positions x (m) and velocities u (m/s) `[N, 2]`; spacing `dx` (m); `mask` of the points
    to measure; position of the wall's `lip` (m), above which points on the other side are not neighbours.
    """
    tree, total, fitted = KDTree(x), 0.0, []
    for i in np.flatnonzero(mask):
        near = np.array(tree.query_ball_point(x[i], REACH * dx))
        near = near[~_parted(x[i], x[near], lip)]
        if len(near) < 6:  # at least twice as many points as coefficients of the fit
            continue
        r = (x[near] - x[i]) / dx
        weight = np.exp(-0.5 * np.sum(r**2, axis=1) / WIDTH**2)[:, None]  # square root of the weight
        fit = np.linalg.lstsq(weight * np.c_[np.ones(len(r)), r], weight * u[near], rcond=None)[0]
        total += float(np.sum((u[i] - fit[0]) ** 2))
        fitted.append(i)
    return float(np.sqrt(total / np.sum(u[fitted] ** 2)))


def _parted(x: np.ndarray, others: np.ndarray, lip: np.ndarray) -> np.ndarray:
    """Mask of points separated from the point x (m) by the wall above the lip."""
    run = others[:, 0] - x[0]
    across = (x[0] < lip[0]) != (others[:, 0] < lip[0])
    level = x[1] + (others[:, 1] - x[1]) * (lip[0] - x[0]) / np.where(across, run, 1.0)
    return across & (level > lip[1])


def _ends(dx: float) -> tuple[float, np.ndarray]:
    """Position of the end wall (m), and position `[2]` (m) of the middle of the front wall's lip."""
    case = study_case("incompressible", dx)
    device = case.device
    inner = case.tank.length - device.chamber_length
    return case.tank.length, np.array([inner - 0.5 * device.wall_thickness, case.tank.depth - device.draught])


def _particles(dx: float, t1: float, report: Report) -> tuple[np.ndarray, np.ndarray]:
    """Positions (m) and velocities (m/s) of the particles in the last snapshot of the run."""
    file = solved(study_case("incompressible", dx), f"convergence_incompressible_{dx:g}", t1)
    report.seconds = (report.seconds or 0.0) + file.results()["wall_seconds"]
    last = file.snapshot(-1)
    return np.asarray(last["x"], float), np.asarray(last["u"], float)


def _lattice(x: np.ndarray, dx: float, finest: float) -> np.ndarray:
    """Points (m) of a lattice with spacing dx that are within `finest` (m) of a water particle at x (m)."""
    axes = [dx * (np.arange(int(end / dx) + 1) + 0.5) for end in x.max(axis=0)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 2)
    return points[KDTree(x).query(points)[0] < finest]


def _averaged(x: np.ndarray, u: np.ndarray, points: np.ndarray, dx: float, lip: np.ndarray) -> np.ndarray:
    """Mean velocities (m/s) of the particles at x (m) in discs as large as a cell around the points (m)."""
    around = KDTree(x).query_ball_point(points, dx / np.sqrt(np.pi))
    return np.array(
        [u[near][~_parted(p, x[near], lip)].mean(axis=0) for p, near in zip(points, around, strict=True)]
    )
