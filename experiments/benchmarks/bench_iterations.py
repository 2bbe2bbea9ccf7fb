"""Iterations of the pressure solver per step over a factor of 64 in the number of particles."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import jaxsph as js
from experiments.common import Report, use_threads
from experiments.studies.convergence import study_case
from jaxsph.core.parts import Part


class _Series(NamedTuple):
    """Runs of one case at several spacings."""

    name: str
    """Name in the rows."""
    case: js.Case
    spacings: tuple[float, ...]
    """From the coarsest to the finest, m; the finest has 64 times as many particles as the coarsest."""
    t0: float
    """Time of the first count, s."""
    counts: int
    """Number of counts, at intervals of a quarter of the wave period."""


FLUME: dict[str, Any] = {"tank.length": 3.3, "sponge.length": 1.0, "probes.gauges": [1.0, 1.5, 2.0]}
"""A shorter tank than the built-in one, in which the waves reach the sponge in the time of the run."""
SERIES = {
    "owc": _Series("OWC", study_case("incompressible", 0.02), (0.04, 0.02, 0.01, 0.005), 2.4, 4),
    "wave_tank_3d": _Series(
        "3-D wave tank", js.load_case("wave_tank_3d").replace(FLUME), (0.05, 0.025, 0.0125), 1.2, 2
    ),
}
MOST = 2.0
"""Largest allowed ratio of the iterations on the finest lattice to those on the coarsest (-)."""


def main(case: str = "owc") -> None:
    """Counts the iterations of a case, owc or wave_tank_3d, on one core."""
    use_threads(1)
    title = "Iterations of the pressure solver per step, at several spacings"
    with Report(f"bench_iterations_{case}", title) as report:
        _measure(report, SERIES[case])


def _measure(report: Report, series: _Series) -> None:
    """Rows of one case."""
    name = series.name
    found, particles = [], []
    for dx in series.spacings:
        case = series.case.replace({"dx": dx})
        counts, size = _iterations(case, [series.t0 + 0.25 * k * case.waves.T for k in range(series.counts)])
        found.append(np.mean(counts))
        particles.append(size)
        report.row(f"{name}, dx = {dx:g} m, {size} particles: iterations per step", found[-1])
        report.row("the same: range of the counts", f"{min(counts):.1f} to {max(counts):.1f}")
    ratio = found[-1] / found[0]
    report.row(
        f"{name}: ratio of the numbers of particles, finest over coarsest", particles[-1] / particles[0]
    )
    report.row(
        f"{name}: ratio of the iterations, finest over coarsest",
        ratio,
        bar=f"at most {MOST:g}",
        passes=bool(ratio <= MOST),
    )


def _iterations(case: js.Case, times: list[float]) -> tuple[list[float], int]:
    """Iterations per step of a run of the case after each of the `times` (s), and the number of particles."""
    counts = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.h5"
        for t in times:
            if path.exists():
                js.resume(path, t1=t)
            else:
                js.run(case, t1=t, out=path, devices=1)
            measured = js.profile(path, devices=1)
            counts.append(measured.parts[Part.SOLVER.value].iterations)
    return counts, measured.particles
