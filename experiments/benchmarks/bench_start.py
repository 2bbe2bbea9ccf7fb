"""Time to a run's second sample, at a first and at a repeated start; predicted and actual wall times."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from experiments.common import Report

CASES = ("owc", "wave_tank", "flap_2d", "section_fixed", "beach")
"""Cases whose wall time is predicted."""
PREDICT = """
import sys
import jaxsph as js
from jaxsph.run.lowered import store_programs
store_programs()
print("predicted", js.duration(js.load_case(sys.argv[1]), devices=1).total)
"""
"""Program that predicts the wall time (s) of a case from stored steps, as `jaxsph check --time` does."""


def main(cases: str = ",".join(CASES)) -> None:
    """Times starts of the built-in OWC, and predicts and measures times of `cases`, in separate processes."""
    with Report("bench_start", "Start of a run, and its predicted wall time") as report:
        with tempfile.TemporaryDirectory() as folder:
            for when, times, bar in (("first", 1, None), ("later", 5, 4.0)):
                start = ["run", "owc", "--t1", "0.02", "--overwrite"]
                took = min(_timed(start, Path(folder)) for _ in range(times))
                report.row(
                    f"built-in OWC, {when} start: time to the second sample"
                    + (f", least of {times}" if times > 1 else ""),
                    took,
                    "s",
                    bar="" if bar is None else f"{bar:g} s",
                    passes=None if bar is None else took < bar,
                )
            for name in cases.split(","):
                command = [sys.executable, "-c", PREDICT, name]
                told = subprocess.run(
                    command, check=True, capture_output=True, text=True, env=_environment(Path(folder))
                )
                predicted = float(re.findall(r"predicted ([\d.]+)", told.stdout)[0])
                took = _timed(["run", name, "--devices", "1", "--overwrite"], Path(folder))
                report.row(
                    f"{name}: predicted over actual wall time",
                    predicted / took,
                    bar="0.7 to 1.3",
                    passes=0.7 < predicted / took < 1.3,
                )
                report.row(f"{name}: wall time", took, "s")


def _timed(arguments: list[str], folder: Path) -> float:
    """Wall time (s) of a command without pictures and page; compiled programs are kept in `folder`."""
    began = time.perf_counter()
    extra = ["--quiet", "--no-plot", "--no-report", "--out", str(folder / "run.h5")]
    subprocess.run([sys.executable, "-m", "jaxsph", *arguments, *extra], check=True, env=_environment(folder))
    return time.perf_counter() - began


def _environment(folder: Path) -> dict[str, str]:
    """Variables with which Python and JAX keep what they compile in `folder`, as they do by default."""
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    return kept | {
        "PYTHONPYCACHEPREFIX": str(folder / "modules"),
        "JAX_COMPILATION_CACHE_DIR": str(folder / "programs"),
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
    }
