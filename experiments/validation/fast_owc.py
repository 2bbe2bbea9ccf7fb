"""A fast model of the OWC, fitted to five runs, against twelve runs that it has not seen."""

from __future__ import annotations

import time

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import RUNS, Report
from experiments.owc_tank import study_case, swept
from jaxsph.study.fast_model import runs_of
from jaxsph.waves.fast_owc import Response

UNSEEN = {
    "waves.H": [0.02, 0.06, 0.04, 0.02, 0.06, 0.04, 0.02, 0.04, 0.06, 0.02, 0.04, 0.06],
    "waves.T": [1.0, 1.0, 1.1, 1.2, 1.2, 1.3, 1.3, 1.4, 1.4, 1.5, 1.6, 1.6],
    "pto.K_dm": [1000.0, 2000.0, 400.0, 300.0, 700.0, 150.0, 1500.0, 600.0, 150.0, 800.0, 2000.0, 400.0],
}
"""Height (m) and period (s) of the waves and damping K_dm of the runs that the model predicts."""
LABELS = {"xi": "xi over the measured incident wave", "P_a": "amplitude of the pressure", "flow": "flow"}
BAR = 5.0
"""Largest mean error of the model's predictions, %."""
CALLS = 200
"""Number of answers whose time is measured."""


def main(dx: float = 0.01) -> None:
    """Calibrates the model, or continues, and compares its predictions with the unseen runs."""
    RUNS.mkdir(exist_ok=True)
    case = study_case(dx)
    with Report(f"fast_owc_{dx:g}", "Fast model of the OWC against runs that it has not seen", dx) as report:
        file = RUNS / f"fast_owc_{dx:g}.json"
        model = js.calibrate(case, file)
        unseen = swept(case, UNSEEN, f"fast_owc_unseen_{dx:g}", grid=False)
        spent = float(np.sum(js.read_sweep(runs_of(file))["wall_seconds"]))
        report.seconds = spent + float(np.sum(unseen["wall_seconds"]))
        minutes = spent / 60.0
        report.row(
            "wall time of the runs of the calibration", minutes, "min", bar="20", passes=minutes <= 20.0
        )
        added, error = model.added, model.added_error
        report.row("loss coefficient of the lip", added.lip)
        report.row("loss coefficient of the lip: standard error", error.lip)
        report.row("additional length of the column, in draughts", added.length)
        report.row("additional length of the column: standard error", error.length)
        changes = {key: jnp.asarray(values) for key, values in UNSEEN.items()}
        changes |= {"waves.H": jnp.asarray(unseen["incident_height"])}
        found = jax.vmap(model.response)(changes)
        theory = jax.vmap(js.FastModel.of_theory(case, (1.0, 1.6)).response)(changes)
        for name, of in model.theory.read.items():
            off, without = (np.asarray(getattr(a, name)) / unseen[of] - 1.0 for a in (found, theory))
            report.predictions(LABELS[name], off, without, model.error[name], BAR)
        answer = _time_of_an_answer(model)
        report.row("time of an answer", answer, "ms", bar="at most 5", passes=answer <= 5.0)
        report.picture(_picture(unseen, model.theory.read, found, theory))


def _time_of_an_answer(model: js.FastModel) -> float:
    """Wall time of one response, ms, after the first."""
    answer = jax.jit(lambda K_dm: model.response({"pto.K_dm": K_dm}).xi)
    jax.block_until_ready(answer(500.0))
    began = time.perf_counter()
    for k in range(CALLS):
        jax.block_until_ready(answer(500.0 + k))
    return 1e3 * (time.perf_counter() - began) / CALLS


def _picture(unseen: js.Sweep, read: dict[str, str], found: Response, theory: Response) -> Figure:
    figure = Figure(figsize=(9, 3.2), layout="constrained")
    units = {"xi": "", "P_a": "Pa", "flow": "m2/s"}
    for axis, (name, of) in zip(figure.subplots(1, len(read)), read.items(), strict=True):
        here = unseen[of]
        most = 1.1 * float(np.max(here))
        axis.plot([0.0, most], [0.0, most], color="0.7", lw=1)
        axis.plot(here, np.asarray(getattr(theory, name)), "x", color="tab:orange", label="linear theory")
        axis.plot(here, np.asarray(getattr(found, name)), "o", color="tab:blue", label="fast model", ms=4)
        unit = f", {units[name]}" if units[name] else ""
        axis.set(title=LABELS[name] + unit, xlabel="run", ylabel="prediction")
        axis.title.set_fontsize("small")
    axis.legend(fontsize="small")
    return figure
