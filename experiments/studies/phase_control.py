"""Damping as a function of the phase of the waves, optimised wave by wave in reverse mode.

The OWC is in a tank 1.2 m long. The function has four Fourier coefficients. For every wave one filtered
reverse pass computes the absorbed energy and its slopes for all coefficients; Adam then changes the
coefficients for the next wave. Afterwards waves with the learnt damping are compared with waves with the
constant damping.

The method fails: with coefficients that follow the slopes, the OWC absorbs less and less energy. The
filtered slope of one wave contains the direct effect of a coefficient on that wave and most of the water's
response during the wave, but no effect on later waves.
"""

from __future__ import annotations

import dataclasses
import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import Report
from experiments.owc_tank import T, short_case
from jaxsph.case.linear import incident_power
from jaxsph.model.interfaces import ExactTangents


def main(dx: float = 0.02, learn: int = 16, judge: int = 12, before: int = 4, rate: float = 0.15) -> None:
    """Optimises over `learn` waves, after `before` initial waves, and compares over `judge` waves."""
    case = short_case(dx, (before + learn + judge) * T).replace({"pto.phase": [0.0] * 4})
    model, state = js.build(case)
    every = model.search.rebuild_every
    n_steps = round(T / float(model.dt) / every) * every

    def wave(phase, state, tangents):
        changed = eqx.tree_at(lambda m: m.chambers[0].pto.phase, model, phase)
        changed = dataclasses.replace(changed, tangents=tangents)
        new, _ = js.simulate(changed, state, n_steps=n_steps, sample_every=n_steps)
        return new.ledger["pto"].total - state.ledger["pto"].total, new

    run = jax.jit(functools.partial(wave, tangents=ExactTangents()))
    slope = jax.jit(jax.value_and_grad(functools.partial(wave, tangents=js.TangentFilter()), has_aux=True))
    constant = phase = jnp.zeros(4)
    for _ in range(before):
        state = run(phase, state)[1]
    optimiser = optax.adam(rate, b1=0.5, b2=0.9)
    memory, other = optimiser.init(phase), state
    learnt, way = [], [phase]
    for _ in range(learn):
        (energy, state), slopes = slope(phase, state)
        change, memory = optimiser.update(-slopes, memory)
        phase = optax.apply_updates(phase, change)
        learnt.append(float(energy))
        way.append(phase)
        print(f"  {energy:.4f} J/m, slopes {np.array2string(np.asarray(slopes), precision=3)}", flush=True)
    with_it, without = [], []
    for _ in range(learn):
        energy, other = run(constant, other)
        without.append(float(energy))
    for _ in range(judge):
        energy, state = run(phase, state)
        with_it.append(float(energy))
        energy, other = run(constant, other)
        without.append(float(energy))
    if int(state.status.bits) or int(other.status.bits):
        raise SystemExit(
            f"a run failed: flags {state.status.bits | other.status.bits} of model.state.Failure"
        )
    with Report(
        f"phase_control_{dx:g}", "Damping as a function of the waves' phase, learnt wave by wave", dx
    ) as report:
        P = incident_power(case) * T
        a, b = np.array(with_it[2:]) / P, np.array(without[learn + 2 :]) / P
        error = float(np.sqrt((a.var(ddof=1) + b.var(ddof=1)) / len(a)))
        report.row("xi with a constant damping", b.mean())
        report.row("xi with the learnt damping", a.mean())
        report.row(
            "gain of xi by the learnt damping",
            a.mean() - b.mean(),
            bar="more than two standard errors",
            passes=a.mean() - b.mean() > 2 * error,
        )
        report.row("standard error of the gain", error)
        for name, value in zip(("a1", "b1", "a2", "b2"), np.asarray(phase), strict=True):
            report.row(f"coefficient {name}", float(value))
        figure = Figure(figsize=(10, 4), layout="constrained")
        left, right = figure.subplots(1, 2)
        left.plot(np.array(learnt + with_it) / P, "C0.-", label="learning, then held")
        left.plot(np.array(without) / P, "0.5", label="constant")
        left.axvline(learn - 0.5, color="0.8")
        left.set(xlabel="wave", ylabel="xi of the wave")
        left.legend()
        right.plot(np.stack(way))
        right.set(xlabel="wave", ylabel="coefficients a1, b1, a2, b2 of ln K_dm")
        report.picture(figure)
