"""A fast model that was fitted to five runs in regular waves, against runs in irregular seas."""

from __future__ import annotations

import dataclasses
import time

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import RUNS, Report
from experiments.owc_tank import study_case
from experiments.studies import annual_power

YEAR = 60
"""Number of seas of the scatter table whose time is measured."""


def main(dx: float = 0.02, workers: int = 1) -> None:
    """Calibrates the model and computes the power matrix, or continues, and compares powers."""
    case = study_case(dx)
    RUNS.mkdir(exist_ok=True)
    model = js.calibrate(case, RUNS / f"fast_owc_{dx:g}.json", workers=workers)
    done = annual_power.matrix(dx, workers)
    table = annual_power.table()
    theory = js.FastModel.of_theory(case, (min(annual_power.TP), max(annual_power.TP)))
    seas = {"waves.Hs": jnp.asarray(table.Hs), "waves.Tp": jnp.asarray(table.Tp)}
    found, linear = (np.asarray(jax.vmap(one.response)(seas).P_owc) for one in (model, theory))
    water, error = done.P.ravel(), done.error.ravel()
    with Report(f"fast_seas_{dx:g}", "Fast model of the OWC against runs in irregular seas", dx) as report:
        report.seconds = float(np.nansum(done.sweep["wall_seconds"]))
        for Hs, Tp, here, there, without in zip(table.Hs, table.Tp, found, water, linear, strict=True):
            name = f"Hs = {Hs:g} m, Tp = {Tp:g} s: error of the"
            report.row(f"{name} model's power", 100.0 * (here / there - 1.0), "%")
            report.row(f"{name} power by linear theory", 100.0 * (without / there - 1.0), "%")
        mean, by_model = done.annual(table), float(model.annual(table))
        report.row("annual mean power of the runs", mean.value, "W/m")
        report.row("annual mean power of the runs: standard error", mean.error, "W/m")
        report.row("annual mean power of the model", by_model, "W/m", theory=float(theory.annual(table)))
        report.row("annual mean power: error of the model", 100.0 * (by_model / mean.value - 1.0), "%")
        report.row(
            "error of the power that the model states, in regular waves", 100.0 * model.error["xi"], "%"
        )
        corners = _corners(done)
        for words, year in (
            ("with the model", corners.annual(table, model)),
            ("interpolated linearly", corners.annual(table)),
        ):
            label = f"annual mean power from runs in four of the seas, {words}"
            report.row(f"{label}: deviation from nine", 100.0 * (year.value / mean.value - 1.0), "%")
            if np.isfinite(year.between):
                stated = 100.0 * year.between / year.value
                report.row(f"{label}: stated error of the other five seas", stated, "%")
        spent = _time_of_a_year(model)
        report.row(f"time of {YEAR} seas", spent, "s", bar="at most 1", passes=spent <= 1.0)
        report.picture(_picture(table, water, error, found, linear))


def _corners(done: js.PowerMatrix) -> js.PowerMatrix:
    """Power matrix of the lowest and the highest seas with the shortest and the longest period."""
    kept = np.ix_([0, -1], [0, -1])
    cells = {name: getattr(done, name)[kept] for name in ("P", "error", "xi", "linear")}
    return dataclasses.replace(done, Hs=done.Hs[[0, -1]], Tp=done.Tp[[0, -1]], **cells)


def _time_of_a_year(model: js.FastModel) -> float:
    """Wall time of the mean power over a scatter table of `YEAR` seas, s, after the first."""
    share = np.full(YEAR, 1.0 / YEAR)
    seas = np.linspace(0.02, 0.06, YEAR), np.linspace(min(annual_power.TP), max(annual_power.TP), YEAR)
    year = js.ScatterTable(*seas, share)
    answer = jax.jit(lambda K_dm: model.annual(year, {"pto.K_dm": K_dm}))
    jax.block_until_ready(answer(500.0))
    began = time.perf_counter()
    jax.block_until_ready(answer(600.0))
    return time.perf_counter() - began


def _picture(
    table: js.ScatterTable, water: np.ndarray, error: np.ndarray, found: np.ndarray, linear: np.ndarray
) -> Figure:
    figure = Figure(figsize=(9, 3.2), layout="constrained")
    heights = np.unique(table.Hs)
    for axis, Hs in zip(figure.subplots(1, len(heights), sharey=True), heights, strict=True):
        here = table.Hs == Hs
        axis.errorbar(table.Tp[here], water[here], error[here], fmt="k.", capsize=3, label="runs")
        axis.plot(table.Tp[here], linear[here], "x--", color="tab:orange", label="linear theory")
        axis.plot(table.Tp[here], found[here], "o-", color="tab:blue", label="fast model", ms=4)
        axis.set(title=f"Hs = {Hs:g} m", xlabel="peak period, s")
    figure.axes[0].set_ylabel("mean power, W/m")
    figure.axes[0].set_ylim(0.0)
    figure.axes[0].legend(fontsize="small")
    return figure
