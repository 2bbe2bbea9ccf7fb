"""Accuracy and processor time of jaxsph and PySPH for a standing wave on the same particles, one core.

The wave is half a wavelength long in a box of 1 m, in water 0.5 m deep, with an amplitude of 0.025 m. It
starts with a flat surface and the velocities of linear theory, on a square lattice of particles. Without
viscosity it oscillates for ever. The horizontal centre of mass of the water shows the wave independently of
how a program finds its surface. A cosine with an exponential decay is fitted to it over ten periods.

PySPH needs an environment of its own (tested: version 1.0b2). Without `--pysph` only jaxsph is measured.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
import typer
from matplotlib.figure import Figure

from experiments.common import Report
from jaxsph import analysis

SCRIPTS = Path(__file__).parent / "peers"
PERIODS = 10
FREQUENCY = float(np.sqrt(9.81 * np.pi * np.tanh(0.5 * np.pi)))
"""Angular frequency of linear theory, rad/s."""
PERIOD = 2.0 * np.pi / FREQUENCY
ROWS = 40
"""Number of recorded centres of mass in a period."""
SPACINGS = (0.04, 0.02, 0.01)
"""Spacings, m; the finest is run by jaxsph only, because one run by PySPH then takes half an hour."""
PROGRAMS = {
    "jaxsph, incompressible": ("jaxsph", "incompressible"),
    "jaxsph, weakly compressible": ("jaxsph", "weakly_compressible"),
    "PySPH, EDAC": ("pysph", "edac"),
    "PySPH, SISPH": ("pysph", "sisph"),
}
"""Program and scheme by the name in the rows. Of PySPH's schemes these two lose least of the wave."""


class Found(NamedTuple):
    """Result of one run."""

    amplitude: float
    """Amplitude after the last period over the initial amplitude (-)."""
    frequency: float
    """Frequency over that of linear theory (-)."""
    seconds: float
    """Processor time of the whole command (s), with programs that were compiled before."""


def main(
    pysph: Annotated[Path | None, typer.Option(help="Python of an environment with PySPH.")] = None,
    dx: Annotated[list[float] | None, typer.Option(help="Spacing, m; repeatable.")] = None,
) -> None:
    """Runs the wave with every program at every spacing dx, after a short run for which it is compiled."""
    pythons = {"jaxsph": sys.executable, "pysph": str(pysph)}
    with Report("bench_peers", f"Standing wave over {PERIODS} periods, one core") as report:
        found: dict[str, dict[float, Found]] = {}
        for spacing in sorted(dx or SPACINGS, reverse=True):
            for name, (program, scheme) in PROGRAMS.items():
                if program == "pysph" and (pysph is None or spacing <= min(SPACINGS)):
                    continue
                one = _measured(pythons[program], program, scheme, spacing)
                found.setdefault(name, {})[spacing] = one
                label = f"{name}, dx = {spacing:g} m"
                report.row(
                    f"{label}: amplitude after {PERIODS} periods over the first", one.amplitude, theory=1.0
                )
                report.row(f"{label}: frequency over that of linear theory", one.frequency, theory=1.0)
                report.row(f"{label}: processor time of the command", one.seconds, "s")
        report.picture(_picture(found))


def _measured(python: str, program: str, scheme: str, dx: float) -> Found:
    """Result of a run, which follows a run over a tenth of a period."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "centre.csv"
        script = str(SCRIPTS / f"standing_wave_{program}.py")
        command = [python, script, "--csv", str(out), "--dx", f"{dx:g}", "--scheme", scheme]
        command += ["--interval", f"{PERIOD / ROWS:.9g}", "--end"]
        for periods in (0.1, PERIODS):
            before = _processor_time()
            done = subprocess.run(
                [*command, f"{periods * PERIOD:.9g}"],
                check=False,
                cwd=folder,
                capture_output=True,
                text=True,
                env=os.environ | {"OMP_NUM_THREADS": "1"},
            )
            if done.returncode:
                raise RuntimeError(f"{' '.join(command)} failed: {done.stderr[-1000:]}")
            seconds = _processor_time() - before
        t, x = np.loadtxt(out, delimiter=",", skiprows=1).T
    fit = analysis.fit_damped_oscillation(t, x)
    left = float(np.exp(-fit.decay_rate * PERIODS * PERIOD))
    return Found(left, float(fit.omega / FREQUENCY), seconds)


def _processor_time() -> float:
    """Processor time of all processes that were started from here and have ended, s."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _picture(found: dict[str, dict[float, Found]]) -> Figure:
    """Figure of the loss of amplitude over the processor time."""
    figure = Figure(figsize=(6, 4), layout="constrained")
    axis = figure.subplots()
    for name, runs in found.items():
        seconds, loss = zip(*((one.seconds, abs(1.0 - one.amplitude)) for one in runs.values()), strict=True)
        axis.loglog(seconds, loss, "o-", label=name)
    axis.set(xlabel="processor time, s", ylabel="relative change of the amplitude")
    axis.set_title(f"{PERIODS} periods of a standing wave")
    axis.legend(fontsize="small")
    return figure
