"""Forces of regular waves on a fixed ship section, incompressible, 2-D, against a flume and linear theory.

The compared forces are amplitudes of the first harmonic, per metre of the section's length and per metre of
incident wave amplitude. Gauges in front of the section separate incident from reflected waves. In the
experiment the section was 0.586 m long in a flume 0.6 m wide; the flow through the gaps of 7 mm at its ends
is missing in two dimensions. Linear diffraction of the same section (`experiments/fixed_section.py`) shows
how much of the difference from the measurement is due to the flume.
"""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import BUDGET, Report, of_paddle, solved
from experiments.fixed_section import diffraction
from jaxsph.output.plot.style import BLUE, RED, in_style

MEASURED = {1.269: (3086.0, 1939.0), 0.897: (2517.0, 1025.0)}
"""Measured amplitudes of the force along the flume and upwards, N/m per metre of wave amplitude, by wave
period (s); source: repository KRSundsdal1/2D-ship-cross-section-in-regular-waves (CC0)."""
ENDS = {1.269: 16.0, 0.897: 26.0}
"""End of the run by wave period, s: shorter waves travel more slowly and settle later."""
BAR = {0.02: 7.0, 0.01: 5.0}
"""Largest allowed error of a force amplitude, %, by spacing (m)."""
ELEMENT = 0.005
"""Largest boundary element of linear theory on the section, m; with half this size the forces change by less
than 0.1 %."""


def main(dx: float = 0.02) -> None:
    """Runs or continues both waves at the spacing dx (m)."""
    with Report(f"section_fixed_{dx:g}", "Fixed ship section in regular waves", dx) as report:
        kept = {}
        for T, measured in MEASURED.items():
            case = js.load_case("section_fixed").replace({"dx": dx, "waves.T": T})
            file = solved(case, f"section_fixed_{T:g}_{dx:g}", ENDS[T])
            series, results = file.series(), file.results()
            t, force = series["time"], series["force_mean_section"][:, :2]
            over = t > t[-1] - round(results["periods"]) * T + 1e-9
            wave = np.exp(-2j * np.pi / T * t[over])
            amplitude = 0.5 * results["incident_height"]
            label = f"T = {T:g} s"
            linear = np.abs(diffraction(_in_the_water(case), case.tank.depth, T, ELEMENT).force)
            for axis, name in enumerate(("along the flume", "upwards")):
                mean = np.mean(force[over, axis])
                found = 2.0 * abs(np.mean((force[over, axis] - mean) * wave)) / amplitude
                off = 100.0 * (found / measured[axis] - 1.0)
                bar = BAR.get(dx)
                report.row(f"{label}: force {name} over wave amplitude", found, "N/m2", theory=measured[axis])
                report.row(
                    "the same: deviation from the measurement",
                    off,
                    "%",
                    bar="" if bar is None else f"{bar:g} %",
                    passes=None if bar is None else abs(off) < bar,
                )
                report.row(
                    "the same: deviation from linear diffraction theory",
                    100.0 * (found / linear[axis] - 1.0),
                    "%",
                )
                report.row(
                    "linear diffraction theory: deviation from the measurement",
                    100.0 * (linear[axis] / measured[axis] - 1.0),
                    "%",
                )
            report.row(f"{label}: incident height", results["incident_height"], "m", theory=case.waves.H)
            report.row(f"{label}: reflection", results["reflection"])
            report.row(f"{label}: periods averaged", results["periods"])
            for energy in ("hyperviscosity", "projection", "residual"):
                what = f"{label}: {BUDGET[energy]}, over the paddle's work"
                report.row(what, of_paddle(results, energy), "%")
            kept[label] = (t, force)
        report.picture(_forces(kept))


def _in_the_water(case: js.Case) -> list[tuple[float, float]]:
    """Corners of the section (m), from right to left: x from its middle, z from the still water level.

    Corners above this level are moved down to it.
    """
    corners = np.array(case.solid["section"].polygon)[::-1] - [0.0, case.tank.depth]
    corners[:, 0] -= 0.5 * (np.min(corners[:, 0]) + np.max(corners[:, 0]))
    return [(float(x), min(float(z), 0.0)) for x, z in corners]


@in_style
def _forces(kept: dict[str, tuple[np.ndarray, np.ndarray]]) -> Figure:
    """Figure of both forces over time, minus the force at rest."""
    figure = Figure(figsize=(9.0, 5.0), layout="constrained")
    for ax, (label, (t, force)) in zip(figure.subplots(len(kept), sharex=True), kept.items(), strict=True):
        rest = np.mean(force[(t > 0.5) & (t < 1.5)], axis=0)
        for axis, (name, colour) in enumerate((("along the flume", BLUE), ("upwards", RED))):
            ax.plot(t, force[:, axis] - rest[axis], color=colour, label=name)
        ax.set_title(label)
        ax.set_ylabel("force (N/m)")
    ax.set_xlabel("time (s)")
    ax.legend()
    return figure
