"""A search with a fast model over a scatter table, against the best device of a grid, both in the water."""

from __future__ import annotations

import itertools

import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import RUNS, Report
from experiments.owc_tank import study_case
from experiments.studies import annual_power

BOUNDS = {
    "pto.K_dm": (100.0, 2500.0),
    "device.draught": (0.1, 0.2),
    "device.chamber_length": (0.12, 0.3),
}
TABLE = js.ScatterTable(np.full(3, 0.04), np.array([1.2, 1.4, 1.6]), np.array([0.3, 0.5, 0.2]))
"""Seas of the table; invented for this experiment."""
GRID = {
    "pto.K_dm": [300.0, 800.0],
    "device.draught": [0.12, 0.18],
    "device.chamber_length": [0.125, 0.16, 0.2, 0.25, 0.3],
}
"""Devices of the grid, each of which is run in every sea of the table: sixty runs."""
WALL = {"device.wall_thickness": 0.025}
"""Thickness of the front wall, m: one spacing."""
SEA = WALL | {"waves.duration": 26.0, "t1": 38.0, "probes.pressure": None}
"""Seas of sixteen to twenty waves, the same for every device; times in s."""
MOST_RUNS = 15
LEAST_SHARE = 0.97


def main(dx: float = 0.025, workers: int = 1) -> None:
    """Searches with the model, runs the best device and the grid in the seas, or continues."""
    RUNS.mkdir(exist_ok=True)
    out = RUNS / f"model_search_{dx:g}.h5"
    first = study_case(dx).replace(WALL)
    found = js.search(first, BOUNDS, out, table=TABLE, workers=workers)
    models = [js.FastModel.read(path) for path in sorted(out.with_name(f"{out.name}.models").glob("??.json"))]
    runs = sum(len(model.runs) for model in models)
    devices = [dict(zip(GRID, values, strict=True)) for values in itertools.product(*GRID.values())]
    best = {name: found.case.value(name) for name in BOUNDS}
    start = {name: first.value(name) for name in BOUNDS}
    powers = [_power(dx, one, f"{dx:g}_{k:02d}", workers) for k, one in enumerate(devices)]
    chosen, before = (
        _power(dx, one, f"{dx:g}_{name}", workers) for one, name in ((best, "best"), (start, "start"))
    )
    with Report(f"model_search_{dx:g}", "Search with a fast model over a scatter table", dx) as report:
        for name, value in best.items():
            report.row(f"best {name}", value)
        report.row("runs of the water", runs, bar=f"at most {MOST_RUNS}", passes=runs <= MOST_RUNS)
        report.row("devices that were run", len(models))
        report.row("reason for the end", found.reason)
        report.row("mean power of the best device, by the model", found.value, "W/m")
        report.row("mean power of the best device, in the water", chosen, "W/m")
        report.row("mean power of the case's device, in the water", before, "W/m")
        highest = int(np.argmax(powers))
        for name, value in devices[highest].items():
            report.row(f"best device of the grid: {name}", value)
        report.row("best device of the grid: mean power in the water", powers[highest], "W/m")
        share = chosen / powers[highest]
        report.row(
            "power of the device found over that of the best of the grid",
            share,
            bar=f"at least {LEAST_SHARE}",
            passes=share >= LEAST_SHARE,
        )
        report.picture(_picture(devices, powers, best, chosen, start, before))


def _power(dx: float, device: dict[str, float], name: str, workers: int) -> float:
    """Mean power of a device over the seas of the table, W/m, in the same sea for every device."""
    case = annual_power.study_case(dx).replace(SEA | device)
    path = RUNS / f"model_search_seas_{name}.h5"
    done = js.power_matrix(case, [0.04], TABLE.Tp.tolist(), path, workers=workers)
    return done.annual(TABLE).value


def _picture(
    devices: list[dict[str, float]],
    powers: list[float],
    best: dict[str, float],
    chosen: float,
    start: dict[str, float],
    first: float,
) -> Figure:
    figure = Figure(figsize=(7, 4), layout="constrained")
    axis = figure.subplots()
    marks = {300.0: "o", 800.0: "s"}
    for K_dm, draught in itertools.product(GRID["pto.K_dm"], GRID["device.draught"]):
        here = [
            (one["device.chamber_length"], power)
            for one, power in zip(devices, powers, strict=True)
            if one["pto.K_dm"] == K_dm and one["device.draught"] == draught
        ]
        colour = "tab:blue" if draught == GRID["device.draught"][0] else "tab:orange"
        label = f"grid: K_dm = {K_dm:g}, draught {draught:g} m"
        axis.plot(*zip(*here, strict=True), f"{marks[K_dm]}-", color=colour, lw=0.8, label=label)
    axis.plot(start["device.chamber_length"], first, "k.", ms=10, label="the case")
    axis.plot(best["device.chamber_length"], chosen, "r*", ms=14, label="found with the model")
    axis.set(xlabel="length of the chamber, m", ylabel="mean power over the seas, W/m", ylim=(0.0, None))
    axis.legend(fontsize="small")
    return figure
