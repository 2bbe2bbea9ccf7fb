"""Built-in floating devices in regular waves: comparison with linear theory, and energy balance.

The power and the amplitudes of the readings are compared with linear theory; `jaxsph run` prints the
simulated and the theoretical values. Linear theory assumes small waves and no flow separation at corners
(docs/measurements.md). Energies are divided by the work done by the paddle, which absorbs the waves
that return to it.
"""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import BUDGET, Report, of_paddle, solved
from jaxsph.output.plot.style import BLUE, in_style

DEVICES = ("box_moored", "buoy_heave", "raft", "flap_floating", "owc_floating")
"""Built-in cases with floating bodies."""
ENERGIES = {"residual": 2.0, "projection": 5.0, "hyperviscosity": np.inf}
"""Terms of the energy balance, and the largest allowed magnitude of each, % of the paddle's work."""
AMPLITUDE = "linear_amplitude_"
"""Prefix of the names of results that are amplitudes by linear theory."""


def off_theory(results: dict[str, float]) -> dict[str, float]:
    """Deviations of a run's amplitudes and power from linear theory, %, by name.

    Amplitudes are left out if their theoretical value is less than a hundredth of the largest of their
    kind (surge, heave and so on).
    """
    kinds: dict[str, dict[str, float]] = {}
    for key, theory in results.items():
        if key.startswith(AMPLITUDE):
            name = key.removeprefix(AMPLITUDE)
            kinds.setdefault(name.split("_")[0], {})[name] = theory
    found = {}
    for kind in kinds.values():
        for name, theory in kind.items():
            if theory > 0.01 * max(kind.values()):
                found[name] = 100.0 * (results[f"amplitude_{name}"] / theory - 1.0)
    if "linear_xi" in results:
        found["power"] = 100.0 * (results["xi"] / results["linear_xi"] - 1.0)
    return found


def main(dx: float = 0.02) -> None:
    """Runs or continues the cases at the spacing dx (m)."""
    with Report(f"floating_devices_{dx:g}", "Floating devices in regular waves", dx) as report:
        report.seconds, every = 0.0, {}
        for name in DEVICES:
            results = solved(
                js.load_case(name).replace({"dx": dx}), f"floating_devices_{dx:g}_{name}"
            ).results()
            report.seconds += results["wall_seconds"]
            every[name] = off_theory(results)
            for reading, off in every[name].items():
                report.row(f"{name}: {_words(reading)}, deviation from linear theory", off, "%")
            report.row(f"{name}: incident height", results["incident_height"], "m")
            for energy, most in ENERGIES.items():
                share = of_paddle(results, energy)
                bar = f"within {most:g} %" if np.isfinite(most) else ""
                report.row(
                    f"{name}: {BUDGET[energy]}, over the paddle's work",
                    share,
                    "%",
                    bar=bar,
                    passes=abs(share) < most if bar else None,
                )
        report.picture(_picture(every))


def _words(reading: str) -> str:
    """Name of a reading in words; the pressure keeps its symbol P_a."""
    return reading.replace("_", " ").replace("P a", "P_a")


@in_style
def _picture(every: dict[str, dict[str, float]]) -> Figure:
    """Figure of the deviations of all devices from linear theory."""
    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    for ax, (name, off) in zip(figure.subplots(1, len(every), sharex=True), every.items(), strict=True):
        rows = np.arange(len(off))
        ax.barh(rows, list(off.values()), color=BLUE)
        ax.set_yticks(rows, [_words(one) for one in off], fontsize=6)
        ax.axvline(0.0, color="black", lw=0.8)
        ax.set_title(name, fontsize=8)
        ax.set_xlabel("deviation from theory (%)", fontsize=7)
    return figure
