"""Steps per second and memory of the built-in cases in three dimensions, on one core and with all cores.

Every number is measured in a separate process, as in `bench_devices`.
"""

from __future__ import annotations

import jaxsph as js
from experiments.benchmarks.bench_devices import apart, cost
from experiments.common import Report


def main(turns: int = 3, cases: str = "") -> None:
    """Times steps with their searches; `cases`: names separated by commas, default: all with a width."""
    names = cases.split(",") if cases else [n for n in js.built_in_cases() if js.load_case(n).dim == 3]
    with Report("bench_cases", "Built-in cases in three dimensions: speed and memory") as report:
        for name in names:
            one = apart(cost, {}, 1, turns, True, name)
            several = apart(cost, {}, 1, turns, False, name)
            count = one["water"] + one["ghosts"]
            report.row(f"{name}: particles of water", one["water"])
            report.row(f"{name}: particles of walls and bodies", one["ghosts"])
            report.row(f"{name}: steps per second on one core", 1.0 / one["seconds"], "1/s")
            report.row(f"{name}: the same with all cores", 1.0 / several["seconds"], "1/s")
            report.row(f"{name}: memory of a step", one["memory"] / 1e6, "MB")
            report.row(f"{name}: the same per particle", one["memory"] / count, "bytes")
