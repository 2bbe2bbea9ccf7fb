"""Fast models of a heaving buoy and a flap, each fitted to five runs, against twelve that it has not seen."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import RUNS, Report
from experiments.owc_tank import swept
from jaxsph.study.fast_model import runs_of


class Device(NamedTuple):
    """A built-in case and the runs that its model predicts."""

    case: str
    t1: float
    """End of the runs, s."""
    damping: str
    """Name of the damping of the take-off."""
    motion: str
    H: list[float]
    """Heights of the waves, m."""
    T: list[float]
    """Periods of the waves, s."""
    dampings: list[float]
    changes: dict[str, float]
    """Changes of the built-in case."""


DEVICES = {
    "buoy": Device(
        "buoy_heave",
        18.0,
        "link.take_off.damping",
        "heave",
        [0.02, 0.06, 0.04, 0.02, 0.06, 0.04, 0.02, 0.04, 0.06, 0.02, 0.04, 0.06],
        [1.0, 1.0, 1.1, 1.2, 1.2, 1.3, 1.3, 1.4, 1.4, 1.5, 1.6, 1.6],
        [200.0, 400.0, 100.0, 75.0, 150.0, 50.0, 300.0, 150.0, 50.0, 200.0, 400.0, 100.0],
        {},
    ),
    "flap": Device(
        "flap_2d",
        24.0,
        "body.pto.damping",
        "pitch",
        [0.05, 0.12, 0.1, 0.05, 0.15, 0.1, 0.05, 0.1, 0.15, 0.05, 0.1, 0.15],
        [1.6, 1.6, 1.8, 2.0, 2.0, 2.2, 2.2, 2.4, 2.4, 2.6, 2.7, 2.7],
        [20.0, 40.0, 10.0, 7.5, 15.0, 5.0, 30.0, 15.0, 5.0, 20.0, 40.0, 10.0],
        # the sponge of the case is shorter than the longest waves (5.8 m) and reflects them
        {"tank.length": 16.0, "sponge.length": 7.5},
    ),
}
BARS = {"motion": 7.0, "power": 10.0}
"""Largest mean errors of the model's predictions, %."""


def main(device: str = "buoy", dx: float = 0.02) -> None:
    """Calibrates the model of a device (buoy or flap), or continues, and compares it with the unseen runs."""
    RUNS.mkdir(exist_ok=True)
    one = DEVICES[device]
    case = js.load_case(one.case).replace({"dx": dx, "t1": one.t1, **one.changes})
    name = f"fast_{device}_{dx:g}"
    with Report(name, f"Fast model of the {device} against runs that it has not seen", dx) as report:
        file = RUNS / f"{name}.json"
        model = js.calibrate(case, file)
        changes = {"waves.H": one.H, "waves.T": one.T, one.damping: one.dampings}
        unseen = swept(case, changes, f"{name}_unseen", grid=False)
        spent = float(np.sum(js.read_sweep(runs_of(file))["wall_seconds"]))
        report.seconds = spent + float(np.sum(unseen["wall_seconds"]))
        minutes = spent / 60.0
        report.row(
            "wall time of the runs of the calibration", minutes, "min", bar="20", passes=minutes <= 20.0
        )
        for label, value in model.theory.found(model.added, model.added_error):
            report.row(label, value)
        given = {key: jnp.asarray(values) for key, values in changes.items()}
        given |= {"waves.H": jnp.asarray(unseen["incident_height"])}
        found = jax.vmap(model.results)(given)
        theory = jax.vmap(js.FastModel.of_theory(case, (min(one.T), max(one.T))).results)(given)
        names = {"power": model.theory.power, "motion": one.motion}
        for label, result in names.items():
            here = unseen[model.theory.read[result]]
            off, without = (np.asarray(a[result]) / here - 1.0 for a in (found, theory))
            report.predictions(label, off, without, model.error[result], BARS[label])
        report.picture(_picture(model, names, unseen, found, theory))


def _picture(
    model: js.FastModel,
    names: dict[str, str],
    unseen: js.Sweep,
    found: dict[str, jax.Array],
    theory: dict[str, jax.Array],
) -> Figure:
    figure = Figure(figsize=(7, 3.4), layout="constrained")
    for axis, result in zip(figure.subplots(1, len(names)), names.values(), strict=True):
        here, known = unseen[model.theory.read[result]], model.theory.predictable[result]
        most = 1.1 * float(max(np.max(a) for a in (here, found[result], theory[result])))
        axis.plot([0.0, most], [0.0, most], color="0.7", lw=1)
        axis.plot(here, np.asarray(theory[result]), "x", color="tab:orange", label="linear theory")
        axis.plot(here, np.asarray(found[result]), "o", color="tab:blue", label="fast model", ms=4)
        axis.set(title=f"{known.text}, {known.unit}", xlabel="run", ylabel="prediction", ylim=(0.0, most))
        axis.title.set_fontsize("small")
    axis.legend(fontsize="small")
    return figure
