"""Bodies that float, sink and fall into water: draught, positions over time, and a swinging flap.

The boxes and the cylinder are free to heave. The flap is hinged at its foot and released at an angle of ten
degrees. `experiments/reference/README.md` has the sources.
"""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import Report, reference, solved

SIDE = 0.4
"""Side of the floating box, m."""
BOX, DIAMETER = 0.02, 0.11
"""Side of the sinking box and diameter of the falling cylinder, m."""
ENTRY = 2.955
"""Speed of the cylinder at the water surface, m/s."""
LEAN = np.radians(10.0)
HELD = 1.0
"""Time for which the flap is held while the water settles, s."""


def at_rest(ratio: float, dx: float) -> js.Case:
    """A box with `ratio` times the water's density, placed at its theoretical draught."""
    low, depth, length = 0.6 - ratio * SIDE, 0.6, 1.2
    return _case(
        f"floating box of {ratio:g} of the water's density",
        dx=dx,
        t1=2.0,
        tank={"length": length, "depth": depth},
        body={
            "block": {"low": [0.4, low], "high": [0.4 + SIDE, low + SIDE]},
            "density": 1000.0 * ratio,
            "free": ["heave"],
        },
    )


def sinking(dx: float) -> js.Case:
    """The box of Qiu et al. 2017, starting with its top at the surface.

    At the first measured point the middle of the box is at the surface; released from there, the box would
    start with twice the measured acceleration.
    """
    depth, half = 0.131, 0.5 * BOX
    return _case(
        "a box sinks",
        dx=dx,
        t1=0.29,
        tank={"length": 0.15, "depth": depth, "height": 0.2},
        scheme={"kind": "incompressible", "cfl": 0.125},
        body={
            "block": {"low": [0.075 - half, depth - BOX], "high": [0.075 + half, depth]},
            "density": 2120.0,
            "free": ["heave"],
        },
        output={"sample_dt": 0.002, "snapshot_dt": 0.05},
    )


def falling(ratio: float, dx: float) -> js.Case:
    """The cylinder of Greenhow and Lin 1983 at the moment when it touches the water."""
    return _case(
        f"a cylinder of {ratio:g} of the water's density falls in",
        dx=dx,
        t1=0.13,
        tank={"length": 1.0, "depth": 0.3, "height": 1.0},
        body={
            "disc": {"centre": [0.5, 0.3 + 0.5 * DIAMETER], "radius": 0.5 * DIAMETER},
            "density": 1000.0 * ratio,
            "free": ["heave"],
            "velocity": [0.0, -ENTRY, 0.0],
        },
        output={"sample_dt": 0.001, "snapshot_dt": 0.01},
    )


def swinging(dx: float) -> js.Case:
    """The built-in flap without waves, released at an angle."""
    base = js.load_case("flap_2d")
    case = {"waves": None, "dx": dx, "t1": HELD + 8.0, "body.pto": None, "probes.gauges": []}
    return base.replace(case | {"body.angle": LEAN, "body.release": HELD})


def _case(what: str, **sections: object) -> js.Case:
    scheme = {"kind": "incompressible"}
    named = {"name": what.replace(" ", "_"), "description": what, "scheme": scheme}
    return js.Case.from_dict(named | sections)


def extremes(t: np.ndarray, angle: np.ndarray) -> tuple[float, float]:
    """Time (s) from the release to the end of the first swing, and magnitude of the angle then, divided by
    the initial angle (-)."""
    far = int(np.argmin(angle))
    return float(t[far]), float(-angle[far] / angle[0])


def main(dx: float = 0.02, flap_dx: float = 0.01) -> None:
    """Runs all bodies."""
    with Report("floating", "Bodies that float, sink and fall into water, incompressible", dx) as report:
        figure = Figure(figsize=(9, 6.4), layout="constrained")
        upper, lower = figure.subplots(2, 2)
        for ratio in (0.5, 0.3):
            file = solved(at_rest(ratio, dx), f"floating_{ratio:g}_{dx:g}")
            series = file.series()
            heave = float(np.mean(series["heave"][series["time"] > 1.0]))
            # if the box sinks, the displaced water raises the level
            draught = ratio * SIDE - heave / (1.0 - SIDE / 1.2)
            off = draught / (ratio * SIDE) - 1.0
            report.row(
                f"box of {ratio:g} times the water's density: error of the draught",
                100 * off,
                "%",
                bar="2 %",
                passes=abs(off) < 0.02,
            )
        _box(report, upper[0], (0.0025, 0.00125))
        _cylinder(report, upper[1], 0.005)
        _flap(report, lower, (2 * flap_dx, flap_dx))
        report.picture(figure)


def _box(report: Report, ax, spacings: tuple[float, ...]) -> None:
    measured = reference("falling_box.csv")
    for dx in spacings:
        series = solved(sinking(dx), f"sinking_{dx:g}").series()
        within = measured[:, 0] <= series["time"][-1]
        t, sunk = measured[within, 0], measured[0, 1] - measured[within, 1]
        off = float(np.max(np.abs(-np.interp(t, series["time"], series["heave"]) - sunk))) / BOX
        finest = dx == min(spacings)
        report.row(
            f"sinking box, dx = {dx:g} m, to a depth of {sunk[-1] / BOX:.1f} sides: largest error of the "
            "depth, over a side",
            100 * off,
            "%",
            bar="10 %" if finest else "",
            passes=off < 0.1 if finest else None,
        )
        ax.plot(series["time"], -series["heave"], label=f"dx = {1000 * dx:g} mm")
    ax.plot(t, sunk, "k.", label="measured")
    ax.set(xlabel="t, s", ylabel="sinkage, m", title="sinking box")
    ax.legend(fontsize="small")


def _cylinder(report: Report, ax, dx: float) -> None:
    scale = np.sqrt(9.81 / DIAMETER)
    for ratio, colour in ((0.5, "C0"), (1.0, "C1")):
        series = solved(falling(ratio, dx), f"cylinder_{ratio:g}_{dx:g}").series()
        t, depth = series["time"] * scale, -series["heave"] / DIAMETER
        for kind, style in (("_bem", "--"), ("", ".")):
            theory = reference(f"cylinder_entry_{1000 * ratio:g}{kind}.csv")
            theory = theory[theory[:, 0] <= t[-1]]
            ax.plot(*theory.T, style, color=colour, lw=1)
            off = float(np.max(np.abs(np.interp(theory[:, 0], t, depth) - theory[:, 1])))
            if kind or ratio < 1.0:
                report.row(
                    f"cylinder of {ratio:g} times the water's density, dx = {dx:g} m: largest deviation "
                    f"of the penetration from {'potential flow' if kind else 'the measurement'}, over "
                    "the diameter",
                    100 * off,
                    "%",
                    bar="10 %" if kind else "",
                    passes=off < 0.1 if kind else None,
                )
        ax.plot(t, depth, color=colour, label=f"density {ratio:g}, here")
    ax.set(xlabel="t sqrt(g/D)", ylabel="penetration/D", title="cylinders falling into water")
    ax.legend(fontsize="small")


def _flap(report: Report, axes, spacings: tuple[float, ...]) -> None:
    for dx in spacings:
        series = solved(swinging(dx), f"swinging_{dx:g}").series()
        t, angle = series["time"] - HELD, series["pitch"]
        energy = series["kinetic"] + series["potential"]
        free = t >= 0
        time, share = extremes(t[free], angle[free])
        report.row(f"flap released, dx = {dx:g} m: duration of the first swing", time, "s")
        report.row("the same: angle after the first swing over the initial angle", share)
        lost = energy[free] - energy[free][0]
        whole = float(lost[0] - lost.min())
        # single values scatter by 0.02 to 0.08 J/m; the energy of the water is 17 kJ/m
        second = round(1.0 / (t[1] - t[0]))
        mean = np.convolve(lost, np.ones(second) / second, mode="valid")
        grown = float(np.max(mean - np.minimum.accumulate(mean)))
        report.row("the same: energy lost", whole, "J/m")
        report.row(
            "the same: largest rise of the energy averaged over one second",
            grown,
            "J/m",
            bar="< 1 % of the energy lost",
            passes=grown < 0.01 * whole,
        )
        axes[0].plot(t, np.degrees(angle), label=f"dx = {dx:g} m")
        axes[1].plot(t[free], lost, label=f"dx = {dx:g} m")
    axes[0].set(xlabel="t from the release, s", ylabel="angle, degrees", title="a flap in still water")
    axes[1].set(xlabel="t from the release, s", ylabel="energy since the release, J/m")
    for ax in axes:
        ax.legend(fontsize="small")
