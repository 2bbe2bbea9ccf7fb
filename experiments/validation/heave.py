"""Half-immersed cylinder released in heave: period (s) and damping ratio (-), against linear theory.

The runs are two-dimensional, in both schemes. The cylinder is held a quarter of its radius above equilibrium
until the water has settled, and then released. The theory is Cummins' equation with the added mass and
damping of the cylinder at the tank's depth (`experiments/heaving_cylinder.py`); in deep water the damping
ratio would be a tenth higher. The theory is linear: displaced by a quarter of its radius, the cylinder is 3 %
narrower at the surface, and the restoring force is 1 % smaller. The tank is so long that no wave returns from
its ends before the third turning point, the last that is used, even at the speed of the longest waves.
"""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import Report, solved
from experiments.heaving_cylinder import Cylinder, Release, strip_of_a_long_cylinder

CYLINDER = Cylinder(radius=0.1, depth=0.5)
LENGTH = 3.2
"""Length of the tank, m; the cylinder is in its middle."""
LIFT = 0.25 * CYLINDER.radius
"""Height of the cylinder above equilibrium at the release, m."""
HELD = 1.0
"""Time for which the cylinder is held while the water settles, s."""
AFTER = 1.5
"""Duration of the free motion, s."""
BACK = (LENGTH - 2.0 * CYLINDER.radius) / float(np.sqrt(CYLINDER.g * CYLINDER.depth))
"""Travel time of the longest waves to the ends of the tank and back, s."""
SCHEMES = ("incompressible", "weakly_compressible")


def let_go(kind: str, dx: float) -> js.Case:
    """The cylinder in its tank, with the scheme `kind`."""
    return js.Case.from_dict(
        {
            "name": f"heave_{kind}",
            "description": "a half-immersed cylinder let go in heave",
            "dx": dx,
            "t1": HELD + AFTER,
            "scheme": {"kind": kind},
            "tank": {"length": LENGTH, "depth": CYLINDER.depth},
            "body": {
                "disc": {"centre": [0.5 * LENGTH, CYLINDER.depth + LIFT], "radius": CYLINDER.radius},
                "mass": CYLINDER.mass,
                "free": ["heave"],
                "release": HELD,
            },
            "output": {"sample_dt": 0.005, "snapshot_dt": 0.1},
        }
    )


def extremes(t: np.ndarray, z: np.ndarray, count: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """Times (s) and heights (m) of the release and of the first `count` turning points after it.

    z is the height above equilibrium. A turning point is the vertex of a parabola fitted to the readings
    around it, over a quarter of the preceding swing's duration, so that scatter of single readings does not
    move it.

    **Raises** ValueError if the record has fewer turning points.
    """
    times, heights = [float(t[0])], [float(z[0])]
    start = 0
    for n in range(count):
        sign = -1.0 if n % 2 == 0 else 1.0
        crossed = np.flatnonzero(sign * z[start:] > 0)
        if not crossed.size:
            raise ValueError(
                f"the record of {t[-1] - t[0]:.3g} s has {n} turning points, not {count}: increase t1"
            )
        first = start + int(crossed[0])
        back = np.flatnonzero(sign * z[first:] < 0)
        last = first + int(back[0]) if back.size else t.size
        at = first + int(np.argmax(sign * z[first:last]))
        near = np.abs(t - t[at]) <= 0.125 * (t[at] - times[-1])
        bend, slope, height = np.polyfit(t[near] - t[at], z[near], 2)
        times.append(float(t[at] - 0.5 * slope / bend))
        heights.append(float(height - 0.25 * slope**2 / bend))
        start = last
    return np.array(times), np.array(heights)


def period_and_damping(t: np.ndarray, z: np.ndarray) -> tuple[float, float]:
    """Period (s), from the release to the next maximum, and damping ratio (-) over the first two swings.

    A swing goes from one turning point to the next. Its height difference, unlike the height of a turning
    point, does not depend on the equilibrium position. Over two swings it falls by the factor exp(-2 delta),
    and the damping ratio is delta / sqrt(pi^2 + delta^2).
    """
    times, heights = extremes(t, z)
    swings = np.abs(np.diff(heights))
    delta = 0.5 * float(np.log(swings[0] / swings[2]))
    return float(times[2] - times[0]), delta / float(np.hypot(np.pi, delta))


def main(dx: float = 0.01) -> None:
    """Runs both schemes and compares them with theory."""
    with Report(f"heave_{dx:g}", "Half-immersed cylinder released in heave, both schemes, 2-D", dx) as report:
        figure = Figure(figsize=(7, 4), layout="constrained")
        ax = figure.subplots()
        t, z = _theory(report)
        expected = period_and_damping(t, z)
        ax.plot(t, z / LIFT, "k--", lw=1, label="linear theory")
        report.seconds = 0.0
        for kind in SCHEMES:
            file = solved(let_go(kind, dx), f"heave_{kind}_{dx:g}")
            report.seconds += file.results()["wall_seconds"]
            series = file.series()
            free = series["time"] >= HELD - 1e-6
            t, z = series["time"][free] - HELD, LIFT + series["heave"][free]
            name = kind.replace("_", " ")
            _compare(report, name, period_and_damping(t, z), expected)
            still = float(np.max(series["max_speed"][~free]))
            report.row("the same: largest speed while the water settles", still, "m/s", theory=0.0)
            ax.plot(t, z / LIFT, label=name)
        ax.axvline(BACK, color="0.8", lw=1, zorder=0, label="waves return from the ends")
        ax.set(xlabel="t from the release, s", ylabel="height over that at the release")
        ax.legend(fontsize="small")
        report.picture(figure)


def _theory(report: Report) -> tuple[np.ndarray, np.ndarray]:
    """Times (s) and heights (m) of the theory; reports first how accurate the theory is."""
    release = Release(CYLINDER)
    t, z = release.path(LIFT, AFTER)
    times, _ = extremes(t, z)
    omega = 2.0 * np.pi / float(times[2])
    mine, strip = CYLINDER.coefficients(omega), strip_of_a_long_cylinder(CYLINDER, omega, 3.0)
    for name, here, beside in zip(("added mass", "damping"), mine, strip, strict=True):
        off = here / beside - 1.0
        check = f"theory: {name} at {omega:.3g} rad/s, difference from a 3-D boundary-element code"
        report.row(check, 100 * off, "%", bar="2 %", passes=abs(off) < 0.02)
    off = CYLINDER.damping_of_the_waves(omega) / mine[1] - 1.0
    report.row(
        "theory: damping, difference from the value computed from the radiated energy flux",
        100 * off,
        "%",
        bar="0.1 %",
        passes=abs(off) < 1e-3,
    )
    off = release.added_mass_off_the_memory()
    report.row(
        "theory: added mass, largest difference from the value computed from the memory function",
        100 * off,
        "%",
        bar="0.1 %",
        passes=off < 1e-3,
    )
    report.row(
        "earliest return of a wave from the tank's ends",
        BACK,
        "s",
        bar=f"after the third turning point, {times[3]:.3f} s",
        passes=BACK > times[3] + 0.125 * (times[3] - times[2]),
    )
    return t, z


def _compare(report: Report, name: str, here: tuple[float, float], theory: tuple[float, float]) -> None:
    """Reports period and damping ratio."""
    for what, unit, bar, found, expected in zip(
        ("period", "damping ratio over the first two swings"),
        ("s", ""),
        (0.02, 0.1),
        here,
        theory,
        strict=True,
    ):
        report.against(f"{name}: {what}", found, expected, unit, bar=bar)
