"""Still water over a slope, beside a leaning wall, around a caisson, a cylinder and a thin plate.

Nothing drives the water, so any motion is noise. The exact force on each solid is that of the hydrostatic
pressure. Each run lasts ten seconds and uses the incompressible scheme.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

import jaxsph as js
from experiments.common import Report, solved
from jaxsph.output.run_file import RunFile

DEPTH, G, RHO = 0.4, 9.81, 1000.0
"""Depth (m), acceleration of gravity (m/s2) and density (kg/m3) of the still water."""
TILT = np.pi / 6
"""Angle of the plate from the horizontal, rad."""


class Rest(NamedTuple):
    """A solid in still water, and the hydrostatic force on it."""

    label: str
    length: float
    """Length of the tank, m."""
    shape: dict[str, Any]
    """Section of the solid."""
    force: tuple[float, float] | None
    """Hydrostatic force along x and z, N/m; None if the force is not compared."""


def main(dx: float = 0.02, t1: float = 10.0) -> None:
    """Runs or continues the five tanks at the spacing dx (m) to t1 (s)."""
    with Report(f"fixed_solids_{dx:g}", "Still water beside fixed solids", dx) as report:
        for name, rest in solids(dx).items():
            file = solved(at_rest(name, rest, dx, t1), f"fixed_solids_{name}_{dx:g}", t1)
            speed = 100 * largest_speed(file) / np.sqrt(G * DEPTH)
            label = f"{rest.label}: largest speed after 1 s over sqrt(g d)"
            report.row(label, speed, "%", theory=0.0, bar="< 0.5 %", passes=speed < 0.5)
            series = file.series()
            rest_of_it = file.results()["energy_residual"]
            report.row("the same: energy not accounted for", rest_of_it, "J/m", theory=0.0)
            if rest.force is not None:
                found = np.mean(series[f"force_mean_{name}"][series["time"] > 1.0], axis=0)
                for axis, here, expected in zip(("along x", "upwards"), found, rest.force, strict=False):
                    if expected:
                        report.row(f"the same: force {axis}", here, "N/m", theory=expected)


def solids(dx: float) -> dict[str, Rest]:
    """The solids by name."""
    c, s, foot, length = np.cos(TILT), np.sin(TILT), (0.6, 0.2), 0.5
    head = [float(a + length * b) for a, b in zip(foot, (c, s), strict=True)]
    weight, push = RHO * G, 0.5 * RHO * G
    return {
        "bed": Rest(
            "bed with a slope of 1:10",
            2.6,
            {"polygon": [(0.6, 0.0), (2.6, 0.2), (2.6, 0.0)]},
            (push * (DEPTH**2 - (DEPTH - 0.2) ** 2), -weight * (2.0 * DEPTH - 0.2)),
        ),
        "leaning": Rest(
            "wall at 45 degrees",
            1.6,
            {"polygon": [(1.0, 0.0), (1.6, 0.6), (1.6, 0.0)]},
            (push * DEPTH**2, -push * DEPTH**2),
        ),
        "caisson": Rest("caisson", 1.6, {"block": {"low": (0.7, 0.0), "high": (1.0, 0.6)}}, None),
        "cylinder": Rest(
            "submerged cylinder",
            1.6,
            {"disc": {"centre": (0.8, 0.2), "radius": 0.1}},
            (0.0, weight * np.pi * 0.1**2),
        ),
        "plate": Rest(
            "surface-piercing plate at 30 degrees, two spacings thick",
            1.6,
            {"plate": {"foot": foot, "head": head, "thickness": 2.0 * dx}},
            None,
        ),
    }


def at_rest(name: str, rest: Rest, dx: float, t1: float) -> js.Case:
    """Case of still water beside the solid `name`."""
    return js.Case.from_dict(
        {
            "name": f"still_beside_{name}",
            "dx": dx,
            "t1": t1,
            "scheme": {"kind": "incompressible"},
            "tank": {"length": rest.length, "depth": DEPTH},
            "solid": {name: rest.shape},
        }
    )


def largest_speed(file: RunFile) -> float:
    """Largest speed of a particle after the first second, m/s."""
    series = file.series()
    return float(np.max(series["max_speed"][series["time"] > 1.0]))
