"""Control of a heaving buoy in seas: laws of the take-off that a fast model chooses, in the water.

The laws are a constant damping; reactive control, with damping and stiffness; latching, with damping and the
time for which the buoy is held at its highest and lowest positions; and a small network of the position and
the speed. The first three are found by `search`; the network is trained by Adam on the fast model that was
fitted to the runs of the second law. All are then run in three seas.
"""

from __future__ import annotations

import dataclasses
import json
import time
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import RUNS, Report
from jaxsph import analysis

DAMPING, STIFFNESS, HOLD = "link.take_off.damping", "link.take_off.stiffness", "link.latch.latch"
BOUNDS = {DAMPING: (30.0, 600.0), STIFFNESS: (-1600.0, 200.0), HOLD: (0.02, 0.5)}
"""Bounds of the damping (N s/m) and the stiffness (N/m) per metre of width, and of the latch's time (s)."""
LAWS = {
    "constant damping": (DAMPING,),
    "reactive control": (DAMPING, STIFFNESS),
    "latching": (DAMPING, HOLD),
}
"""Parameters of the laws that are searched for."""
LATCH = {"body": "body", "motion": "heave", "latch": 0.15, "latch_damping": 1e5}
"""Latch before the search, in the form of a case."""
HS = 0.05
"""Significant wave height, m."""
TABLE = js.ScatterTable(np.full(3, HS), np.array([1.2, 1.35, 1.5]), np.full(3, 1.0 / 3.0))
"""Seas of equal shares; invented for this experiment."""
SEA = {"waves": {"kind": "irregular", "Hs": HS, "Tp": 1.2, "duration": 48.0}, "t1": 62.0}
"""Each sea repeats after thirty to forty waves, and is the same for every device; times in s."""
BEGIN = SEA["t1"] - SEA["waves"]["duration"]
"""Time from which a sea is averaged, s."""

HIDDEN = 6
"""Number of hidden units of the network."""
SIZES = np.array([1.0 / 0.03, 1.0 / 0.15, 40.0])
"""Inverse sizes of the position (1/m) and the speed (s/m), and size of the force (N/m)."""
SEAS = 60
"""Number of seas of a year whose time is measured."""
TRAINING = 80
"""Number of steps of the training."""


def main(dx: float = 0.02, workers: int = 1) -> None:
    """Searches for the laws, trains the network, runs all in the seas, or continues."""
    RUNS.mkdir(exist_ok=True)
    laws = {name: _law(dx, name, workers) for name in LAWS}
    laws["network"] = _network(dx, laws["reactive control"].models[-1], workers)
    with Report(f"buoy_control_{dx:g}", "Control of a heaving buoy in seas", dx) as report:
        for name, law in laws.items():
            if law.models:
                report.row(f"{name}: runs of the calibrations", sum(len(one.runs) for one in law.models))
            for key, value in law.values.items():
                report.row(f"{name}: {key}", value)
            report.row(f"{name}: mean power by the model", law.promised, "W/m")
            powers = [analysis.mean_with_error(one) for one in law.powers]
            report.row(
                f"{name}: mean power in the water", float(np.mean([one.value for one in powers])), "W/m"
            )
            error = float(np.linalg.norm([one.error for one in powers])) / len(powers)
            report.row(f"{name}: standard error of this power", error, "W/m")
            for Tp, power in zip(TABLE.Tp, powers, strict=True):
                report.row(f"{name}: mean power in the sea with Tp = {Tp:g} s", power.value, "W/m")
        in_time = laws["latching"].models[-1]
        for name, error in in_time.error.items():
            report.row(f"latching: error of the model's {name}, runs left out", 100.0 * error, "%")
        for name, seconds in _times(in_time).items():
            report.row(f"latching: {name}", seconds, "s")
        usual, *others = laws
        for name in others:
            ratio = _ratio(laws[usual].powers, laws[name].powers)
            bar, passes = "above 1 by two errors", ratio.value - 2.0 * ratio.error > 1.0
            report.row(f"{name}: mean power over that with {usual}", ratio.value, bar=bar, passes=passes)
            report.row(f"{name}: standard error of this ratio", ratio.error)
        report.picture(_picture(laws))


class _Law(NamedTuple):
    """A law of control, by the model and in the water."""

    values: Mapping[str, float]
    """Parameters that were found."""
    promised: float
    """Mean power over the seas by the model, W/m."""
    models: list[js.FastModel]
    """Models that were fitted during the search."""
    powers: list[np.ndarray]
    """Power in each sea (W/m) over the time."""


def _law(dx: float, name: str, workers: int) -> _Law:
    """The best law within the bounds, and its power in the seas."""
    file, bounds = f"buoy_control_{name.replace(' ', '_')}_{dx:g}", {key: BOUNDS[key] for key in LAWS[name]}
    latch = {"link.latch": LATCH} if HOLD in bounds else {}
    case = js.load_case("buoy_heave").replace({"dx": dx, "t1": 18.0, **latch})
    out = RUNS / f"{file}.h5"
    found = js.search(case, bounds, out, of="P_pto", table=TABLE, workers=workers)
    models = [js.FastModel.read(path) for path in sorted(out.with_name(f"{out.name}.models").glob("??.json"))]
    law = {key: found.case.value(key) for key in bounds}
    sea = js.load_case("buoy_heave").replace({"dx": dx, **SEA, **latch}).replace(law)
    runs = js.sweep(sea, {"waves.Tp": TABLE.Tp.tolist()}, RUNS / f"{file}_seas.h5", workers=workers)
    return _Law(law, found.value, models, _powers(runs))


def _powers(runs: js.Sweep) -> list[np.ndarray]:
    """Power of the take-off over the time of the averages, W/m."""
    members = (runs.members[place] for place in sorted(runs.members))
    return [one["power_take_off"][one["time"] > BEGIN] for one in members]


def force(weights: jax.Array, s: jax.Array, v: jax.Array, t: jax.Array) -> jax.Array:
    """Force of the network's law (N/m) from the position s (m) and the speed v (m/s) of the buoy."""
    del t
    stiffness, damping = weights[:2]
    inward, outward = weights[2 : 2 + 2 * HIDDEN].reshape(HIDDEN, 2), weights[2 + 2 * HIDDEN :]
    hidden = jnp.tanh(inward @ (jnp.stack([s, v]) * SIZES[:2]))
    return SIZES[2] * outward @ hidden - stiffness * s - damping * v


def controlled(dx: float, Tp: float, weights: list[float]) -> js.Problem:
    """Buoy whose take-off has the law of the network, in a sea."""
    problem = js.load_case("buoy_heave").replace({"dx": dx, **SEA}).replace({"waves.Tp": Tp}).problem()
    law = js.Controlled.of(force, jnp.asarray(weights, jnp.float32))
    return problem.with_parts(links=[dataclasses.replace(one, law=law) for one in problem.model.links])


def _network(dx: float, model: js.FastModel, workers: int) -> _Law:
    """The network, trained on a model, and its power in the seas."""
    trained = RUNS / f"buoy_control_network_{dx:g}.json"
    if not trained.exists():  # rounding errors would lead another training elsewhere
        trained.write_text(json.dumps(_trained(model)))
    weights, promised = json.loads(trained.read_text())
    program = js.Program(controlled, {"dx": dx, "Tp": 1.2, "weights": weights})
    path = RUNS / f"buoy_control_network_{dx:g}_seas.h5"
    runs = js.sweep(program, {"Tp": TABLE.Tp.tolist()}, path, workers=workers)
    return _Law({}, promised, [], _powers(runs))


def _trained(model: js.FastModel) -> tuple[list[float], float]:
    """Weights of the network with the largest mean power over the seas by a model, and this power (W/m)."""
    inward = np.random.default_rng(0).normal(size=2 * HIDDEN)
    weights = jnp.asarray(np.concatenate([[0.0, 200.0], inward, np.zeros(HIDDEN)]), jnp.float32)
    sizes = jnp.asarray(np.concatenate([[30.0, 10.0], np.full(3 * HIDDEN, 0.05)]), jnp.float32)

    @jax.jit
    @jax.value_and_grad
    def falling(x: jax.Array) -> jax.Array:
        return -model.with_laws({"take_off": js.Controlled.of(force, sizes * x)}).annual(TABLE)

    x = weights / sizes
    optimiser = optax.adam(1.0)
    state, best = optimiser.init(x), (np.inf, x)
    for _ in range(TRAINING):
        value, slope = falling(x)
        best = min(best, (float(value), x), key=lambda one: one[0])
        change, state = optimiser.update(slope, state)
        x = jnp.asarray(optax.apply_updates(x, change))
    return np.round(np.asarray(sizes * best[1], float), 4).tolist(), -best[0]


def _times(model: js.FastModel) -> dict[str, float]:
    """Times of answers of a compiled model, s: the best of three."""
    sea, every = {"waves.Hs": HS, "waves.Tp": 1.3}, np.linspace(1.15, 1.5, SEAS)
    year = js.ScatterTable(np.full(SEAS, HS), every, np.full(SEAS, 1.0 / SEAS))
    answers: dict[str, Callable[[float], Any]] = {
        "time of an answer in regular waves": lambda hold: model.results({HOLD: hold}),
        "time of an answer in a sea": lambda hold: model.results({HOLD: hold, **sea}),
        f"time of a year of {SEAS} seas": lambda hold: model.annual(year, {HOLD: hold}),
    }
    found = {}
    for name, answer in answers.items():
        compiled, times = jax.jit(answer), []
        for hold in (0.1, 0.11, 0.12, 0.13):
            began = time.perf_counter()
            jax.block_until_ready(compiled(hold))
            times.append(time.perf_counter() - began)
        found[name] = min(times[1:])
    return found


def _ratio(usual: list[np.ndarray], other: list[np.ndarray]) -> analysis.Mean:
    """Ratio of the mean powers over the seas, and its standard error.

    The seas are the same for both. The error is that of the mean of Q - ratio P for powers P and Q, in which
    most of the changes with the groups of waves cancel.
    """
    means, errors = [], []
    for P, Q in zip(usual, other, strict=True):
        means.append((np.mean(P), np.mean(Q)))
        errors.append(analysis.mean_with_error(Q - np.mean(Q) / np.mean(P) * P).error)
    P, Q = np.sum(means, axis=0)
    return analysis.Mean(Q / P, float(np.linalg.norm(errors)) / P)


def _picture(laws: Mapping[str, _Law]) -> Figure:
    figure = Figure(figsize=(6, 3.6), layout="constrained")
    axis = figure.subplots()
    for (name, law), shift in zip(laws.items(), (-0.015, -0.005, 0.005, 0.015), strict=True):
        means = [analysis.mean_with_error(one) for one in law.powers]
        P, errors = ([getattr(one, of) for one in means] for of in ("value", "error"))
        axis.errorbar(TABLE.Tp + shift, P, errors, fmt="o", capsize=3, label=name)
    axis.set(xlabel="peak period, s", ylabel="mean power in the water, W/m", ylim=(0.0, None))
    axis.legend()
    return figure
