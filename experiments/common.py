"""What the experiments share: a run kept in a file, and rows of the README's table of checks."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import numpy as np

import jaxsph as js
from jaxsph.io import RunFile

RUNS = Path("runs")
"""Where runs are kept; a second call reads them, or goes on where they were interrupted."""


def solved(case: js.Case, name: str, t1: float | None = None) -> RunFile:
    """The file of the case's run to t1 (s), made, finished or only read.

    **Raises** ValueError where `runs/<name>.h5` is of another case: remove it or choose another name.
    """
    path = RUNS / f"{name}.h5"
    end = case.t1 if t1 is None else t1
    if not path.exists():
        RUNS.mkdir(exist_ok=True)
        js.run(case, t1=end, out=path)
        return RunFile.open(path)
    file = RunFile.open(path)
    if file.case_toml != case.to_toml():
        raise ValueError(f"{path} holds a run of another case: remove it to run this one")
    times = file.series().get("time", np.zeros(0))
    if not times.size or times[-1] < end - 1.5 * case.output.sample_dt:
        js.resume(path, t1=end)
    return file


def row(check: str, value: str, bar: str = "", passes: bool | None = None) -> None:
    """Prints a line: what was checked, what came out, the bar and whether it is met."""
    verdict = {None: "", True: "ok", False: "MISSED"}[passes]
    print(f"{check:58s} {value:>22s}   {bar:24s} {verdict}", flush=True)


def use_threads(count: int) -> None:
    """Keeps this process to so many cores; call it before JAX first computes, which starts its threads."""
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:count])


def timed(evaluate: Callable[[], Any]) -> float:
    """Seconds of one call, until its arrays are there."""
    began = time.perf_counter()
    jax.block_until_ready(evaluate())
    return time.perf_counter() - began
