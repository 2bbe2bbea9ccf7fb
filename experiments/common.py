"""Shared functions of the experiments: runs kept in files, and reports of the results."""

from __future__ import annotations

import csv
import json
import os
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import jax
import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from jaxsph.output.run_file import RunFile
from jaxsph.solids.placement import lattice as filled

RUNS = Path("runs")
"""Folder of the runs; a second call reads finished runs and continues interrupted runs."""
REFERENCE = Path(__file__).parent / "reference"
"""Folder of measured and computed series from the literature; see the README in it."""
COMMITTED = Path(__file__).parent / "results"
"""Folder of the committed rows and pictures of every experiment; written only with `--commit`."""
OWN = RUNS / "results"
"""Folder of the rows and pictures of your own runs."""


def solved(case: js.Case, name: str, t1: float | None = None) -> RunFile:
    """File of the case's run to t1 (s). The run is computed, continued, or only read if it is complete.

    **Raises** ValueError if `runs/<name>.h5` holds a run of another case: remove the file or choose another
    name.
    """
    path = RUNS / f"{name}.h5"
    end = case.t1 if t1 is None else t1
    if not path.exists():
        RUNS.mkdir(exist_ok=True)
        js.run(case, t1=end, out=path)
        return RunFile.open(path)
    file = RunFile.open(path)
    if file.case_toml != case.to_toml():
        raise ValueError(f"{path} holds a run of another case: remove the file to run this case")
    times = file.series().get("time", np.zeros(0))
    if not times.size or times[-1] < end - 1.5 * case.output.sample_dt:
        js.resume(path, t1=end)
    return file


def reference(name: str) -> np.ndarray:
    """Numbers in the CSV file `name` of the folder `reference/`, one row per line, without the header."""
    return np.loadtxt(REFERENCE / name, delimiter=",", skiprows=1)


class Report:
    """Rows and pictures of one experiment, written into `folder`; a row is printed when it is added.

    Use it as a context manager: leaving the context without an exception writes `<name>.json`.
    `python -m experiments table` gathers these files into the table of all checks, so that rows are always
    measured and never typed in.
    """

    folder: ClassVar[Path] = OWN
    """Folder of the reports: `runs/results`, or with `--commit` the folder of committed results."""
    command: ClassVar[str] = ""
    """The command line with which `python -m experiments run` was called; it repeats the experiment."""

    def __init__(self, name: str, title: str, dx: float | None = None) -> None:
        """Starts the report of the experiment `name` (also the file name), with title and spacing dx (m)."""
        self.name, self.title, self.dx = name, title, dx
        self.rows: list[dict[str, Any]] = []
        self.pictures: list[str] = []
        self.seconds: float | None = None
        """Wall time of the runs (s) if the experiment sets it, otherwise the time spent in the context."""

    def __enter__(self) -> Report:
        self._began = time.perf_counter()
        print(self.title, flush=True)
        return self

    def row(
        self,
        check: str,
        here: float | str,
        unit: str = "",
        *,
        theory: float | str | None = None,
        paper: float | str | None = None,
        bar: str = "",
        passes: bool | None = None,
    ) -> None:
        """Adds a check: value, reference `theory`, value of the paper, limit `bar`, and whether it is met."""
        found = {"check": check, "here": _plain(here), "unit": unit, "theory": _plain(theory)}
        found |= {"paper": _plain(paper), "bar": bar, "passes": None if passes is None else bool(passes)}
        self.rows.append(found)
        print(f"  {check:56s} {shown(here, unit):>20s}   {bar:26s} {VERDICT[found['passes']]}", flush=True)

    def against(self, check: str, here: float, theory: float, unit: str = "", *, bar: float) -> None:
        """Adds the check that `here` is within the fraction `bar` of theory, and the error, %."""
        off = here / theory - 1.0
        words, passes = f"within {100 * bar:g} %", abs(off) < bar
        self.row(check, here, unit, theory=theory, bar=words, passes=passes)
        self.row("the same: deviation from theory", 100 * off, "%")

    def predictions(
        self, what: str, model: np.ndarray, theory: np.ndarray, stated: float, bar: float
    ) -> None:
        """Adds the errors of a fast model in twelve runs that it has not seen, and those of linear theory, %.

        `model`, `theory`: relative errors of both in the runs (-); `stated`: the error that the model states
        (-); `bar`: limit of the mean error of the model, %.
        """
        mean, without = (100.0 * float(np.sqrt(np.mean(off**2))) for off in (model, theory))
        largest, others = (100.0 * float(np.abs(off).max()) for off in (model, theory))
        first = f"{what}: error of the model, root mean square of twelve runs"
        self.row(first, mean, "%", bar=f"at most {bar:g}", passes=mean <= bar)
        self.row(f"{what}: largest error of the model", largest, "%")
        self.row(f"{what}: error that the model states", 100.0 * stated, "%")
        self.row(f"{what}: error of linear theory", without, "%")
        self.row(f"{what}: largest error of linear theory", others, "%")

    def picture(self, figure: Figure, suffix: str = "") -> None:
        """Saves a figure as `<name><suffix>.png` in the folder of the rows."""
        self.folder.mkdir(parents=True, exist_ok=True)
        file = f"{self.name}{suffix}.png"
        figure.savefig(self.folder / file, dpi=100)
        self.pictures.append(file)

    def table(self, columns: Mapping[str, Sequence[float]]) -> None:
        """Saves columns of values as `<name>.csv`; their names include the units, and each row is a run."""
        self.folder.mkdir(parents=True, exist_ok=True)
        rows = zip(*columns.values(), strict=True)
        with (self.folder / f"{self.name}.csv").open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(columns)
            writer.writerows([f"{float(value):.6g}" for value in row] for row in rows)

    def __exit__(self, kind: type | None, value: Any, trace: Any) -> None:
        if kind is not None:
            return
        seconds = time.perf_counter() - self._began if self.seconds is None else self.seconds
        found = {"title": self.title, "command": self.command, "dx": self.dx, "seconds": round(seconds, 1)}
        found |= {"machine": machine(), "rows": self.rows, "pictures": self.pictures}
        self.folder.mkdir(parents=True, exist_ok=True)
        text = json.dumps(found, indent=1, ensure_ascii=False) + "\n"
        (self.folder / f"{self.name}.json").write_text(text, encoding="utf-8")


def of_paddle(results: Mapping[str, float], energy: str, budget: str = "") -> float:
    """An energy of the budget, in % of the paddle's work; with `budget` = "whole_", over the whole run."""
    return 100 * results[f"{budget}energy_{energy}"] / results[f"{budget}energy_paddle"]


def observed_order(dx: Sequence[float], errors: Sequence[float]) -> float:
    """Observed order of convergence: slope of log(error) over log(dx)."""
    return float(np.polyfit(np.log(dx), np.log(errors), 1)[0])


def lattice(low: Sequence[float], high: Sequence[float], dx: float) -> np.ndarray:
    """Positions `[N, D]` (m) of particles of spacing dx that fill a box."""
    return filled(tuple(low), tuple(high), dx)[0]


BUDGET = {
    "residual": "energy not accounted for",
    "projection": "energy lost in the projection",
    "hyperviscosity": "energy lost by hyperviscosity",
}
"""Names of terms of the energy budget in the reports."""
VERDICT = {None: "", True: "ok", False: "MISSED"}


def shown(value: float | str | None, unit: str = "") -> str:
    """Text of a value, with four significant digits and its unit."""
    if value is None:
        return ""
    text = value if isinstance(value, str) else f"{value:.4g}"
    return f"{text} {unit}".rstrip()


def _plain(value: Any) -> float | str | None:
    """A value that can be written as JSON: numbers of any kind become floats of six significant digits."""
    if value is None or isinstance(value, str):
        return value
    return float(f"{float(value):.6g}")


def machine() -> str:
    """Backend and device of this machine, or on a CPU the number of usable cores and JAX's version."""
    device = jax.devices()[0]
    if device.platform != "cpu":
        return f"{device.platform}: {device.device_kind}"
    return f"CPU, {len(os.sched_getaffinity(0))} core(s), jax {jax.__version__}"


def use_threads(count: int) -> None:
    """Limits this process to `count` cores; call it before JAX first computes and starts its threads."""
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:count])


def timed(evaluate: Callable[[], Any]) -> float:
    """Wall time of one call until its arrays are computed, s."""
    began = time.perf_counter()
    jax.block_until_ready(evaluate())
    return time.perf_counter() - began
