"""Ratio of a step's time to that of its native loops, with the wall time and the memory of a run."""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import jaxsph as js
from experiments.common import Report, use_threads

CASES: dict[str, tuple[str, dict[str, Any], float]] = {
    "OWC": ("owc", {"dx": 0.01}, 0.5),
    "OWC, weakly compressible": ("owc", {"dx": 0.01, "scheme.kind": "weakly_compressible"}, 0.5),
    "dam break on the column": ("dam_break_column", {"dx": 0.01}, 0.02),
}
"""Name, changes, and time (s) to which each case runs before its steps are measured."""
LENGTH = 21.0
"""Simulated time of the paper's run of the OWC, s; it took 36.1 h on four cores of an i5-7500T."""
BAR = 1.4
"""Largest ratio of a step's time to that of its loops (-)."""


def main(threads: int = 1) -> None:
    """Measures steps, searches and probes included, on `threads` cores."""
    use_threads(threads)
    with Report(f"bench_step_{threads}", f"A whole step and its native loops, {threads} core(s)") as report:
        for name, (case, changes, t1) in CASES.items():
            dt = float(js.load_case(case).replace(changes).problem().model.dt)
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / "run.h5"
                _run(case, changes, t1, path)
                found = js.profile(path, devices=1)
            report.row(f"{name}, {found.particles} particles: time per step", 1e3 * found.step, "ms")
            report.row(f"{name}: native loops per step", 1e3 * found.loops, "ms")
            ratio = found.step / found.loops
            report.row(f"{name}: step over its loops", ratio, bar=f"at most {BAR}", passes=ratio <= BAR)
            if case == "owc":
                whole = (found.step + found.recording) * LENGTH / dt / 60
                title = f"{name}: wall time for {LENGTH:g} s of simulated time, from these steps"
                report.row(title, whole, "min", paper=36.1 * 60, bar="< 60 min", passes=whole < 60)
                peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024**2
                report.row(f"{name}: peak memory of a run", peak, "GiB", bar="< 2 GB", passes=peak < 1.86)


def _run(case: str, changes: dict[str, Any], t1: float, out: Path) -> None:
    """Runs a case to t1 (s) in its own process."""
    command = [sys.executable, "-m", "jaxsph", "run", case, "--t1", str(t1), "--out", str(out)]
    command += [word for key, value in changes.items() for word in ("--set", f"{key}={value}")]
    subprocess.run([*command, "--quiet", "--no-plot", "--no-report"], check=True)
