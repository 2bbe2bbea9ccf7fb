"""A run killed with SIGKILL and resumed: all series equal those of an uninterrupted run bit for bit."""

from __future__ import annotations

import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from experiments.common import Report
from jaxsph.errors import FileError
from jaxsph.output.run_file import RunFile


def main(dx: float = 0.02, t1: float = 2.0) -> None:
    """Kills the run of the OWC once it has written 60 samples."""
    with (
        tempfile.TemporaryDirectory() as folder,
        Report("kill_resume", f"The OWC killed with SIGKILL and resumed, to {t1:g} s", dx) as report,
    ):
        whole, killed = Path(folder) / "whole.h5", Path(folder) / "killed.h5"
        run = ["run", "owc", "--set", f"dx={dx}", "--t1", str(t1), "--no-plot", "--out"]
        _cli(*run, str(whole)).wait()
        victim = _cli(*run, str(killed))
        while victim.poll() is None and _samples(killed) < 60:
            time.sleep(0.05)
        alive = victim.poll() is None
        victim.send_signal(signal.SIGKILL)
        victim.wait()
        kept = _samples(killed)
        _cli("resume", str(killed), "--t1", str(t1), "--no-plot").wait()
        a, b = RunFile.open(whole).series(), RunFile.open(killed).series()
        same = alive and a.keys() == b.keys() and all(np.array_equal(a[k], b[k]) for k in a)
        value = f"{len(a)} series, {kept} of {len(a['time'])} samples kept"
        report.row("series equal bit for bit", value, bar="all", passes=same)


def _cli(*args: str) -> subprocess.Popen:
    quiet = subprocess.DEVNULL
    return subprocess.Popen([sys.executable, "-m", "jaxsph", *args], stdout=quiet, stderr=quiet)


def _samples(path: Path) -> int:
    try:
        return len(RunFile.open(path).series().get("time", ()))
    except FileError:  # the file does not exist yet
        return 0
