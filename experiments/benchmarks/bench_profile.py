"""Share of each part (search, pressure solver, probes and others) in the time of a step, for five cases."""

from __future__ import annotations

import tempfile
from pathlib import Path

import jaxsph as js
from experiments.common import Report, use_threads
from jaxsph.run.profile import REST

CASES = {"owc": 4.0, "flap_2d": 4.0, "wave_tank": 2.0, "dam_break_column": 0.3, "wave_tank_3d": 1.0}
"""Time (s) to which each case runs before its steps are profiled, so that the water moves."""
LEAST = 0.03
"""Smallest share that is reported (-)."""


def main(cases: str = ",".join(CASES)) -> None:
    """Profiles the time steps of built-in cases on one core."""
    use_threads(1)
    with Report("bench_profile", "Shares of the parts of a time step, one core") as report:
        for name in cases.split(","):
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / "run.h5"
                js.run(js.load_case(name), t1=CASES[name], out=path, devices=1)
                found = js.profile(path, devices=1)
            report.row(f"{name}, {found.particles} particles: time per step", 1e3 * found.step, "ms")
            for part, share in found.parts.items():
                if share.seconds >= LEAST * found.step:
                    limited = {"bar": "at most 10 %", "passes": share.seconds < 0.1 * found.step}
                    limit = limited if part == REST else {}
                    report.row(f"{name}: {part}", 100 * share.seconds / found.step, "%", **limit)
                if share.iterations:
                    report.row(f"{name}: {part}, iterations per step", share.iterations)
            report.row(f"{name}: recording, in addition to the step", 100 * found.recording / found.step, "%")
            report.row(f"{name}: compilation without the cache", found.compilation, "s")
