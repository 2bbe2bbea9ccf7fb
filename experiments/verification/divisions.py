"""Vessels at rest, joined under a wall one spacing thick, with the paper's three region divisions.

Section 2.4.1.2 of the paper defines the divisions. Each division is run twice: with the background pressure
(`Background`, the default), and without it, as in the paper. The vessels are 0.35 and 0.32 m wide, and the
water is 0.8 m deep. The wall is 0.01 m thick and reaches 0.6 m into the water.
"""

from __future__ import annotations

import dataclasses
import time
from typing import NamedTuple

import equinox as eqx
import jax
import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import RUNS, Report
from jaxsph.model.state import Failure

LENGTH, DEPTH, DRAUGHT, CHAMBER, WALL = 0.68, 0.8, 0.6, 0.32, 0.01
SCALE = 0.5 * 1000.0 * 9.81 * DEPTH**2 * (LENGTH - WALL)
"""Potential energy of the water relative to the bed, rho g d^2/2 times the width of the vessels, J/m."""
BAR = 1.0e-4
"""Largest allowed ratio of the final kinetic energy to `SCALE`: the RMS speed is then 0.01 sqrt(g d)."""
COLOURS = {"a": "#E69F00", "b": "#0072B2", "c": "#D55E00"}
PAPER = {"a": "unsteady", "b": "at rest", "c": "unsteady"}
"""State of each division at 10 s according to section 2.4.1.2; the paper gives no numbers for its Fig. 8."""


class Found(NamedTuple):
    """Results of a run: series, last valid state, and how it ended."""

    t: np.ndarray
    kinetic: np.ndarray
    max_speed: np.ndarray
    x: np.ndarray
    u: np.ndarray
    p: np.ndarray
    ended: str
    """Failure that stopped the run; empty if there was none."""
    seconds: float


def main(dx: float = 0.01, t1: float = 10.0) -> None:
    """Runs the three divisions with and without the background pressure to t1 (s)."""
    found = {}
    for background in (True, False):
        for division in "abc":
            found[division, background] = _kept(division, background, dx, t1)
    with Report(
        f"divisions_{dx:g}", f"Vessels at rest for {t1:g} s with three region divisions", dx
    ) as report:
        report.seconds = sum(run.seconds for run in found.values())
        report.row("potential energy relative to the bed, rho g d^2/2 times the width", SCALE, "J/m")
        for (division, background), run in found.items():
            _rows(report, division, background, run, t1)
        report.picture(_energies(found), "_energy")
        for background, suffix in ((True, "_fields"), (False, "_fields_without")):
            runs = {division: found[division, background] for division in "abc"}
            report.picture(_fields(runs, dx), suffix)


def case_of(division: str, dx: float) -> js.Case:
    """The vessels at rest, with one division of the water around the wall."""
    return js.load_case("vessel").replace(
        {
            "scheme.kind": "weakly_compressible",
            "dx": dx,
            "tank.length": LENGTH,
            "tank.depth": DEPTH,
            "tank.height": DEPTH + 0.2,
            "device.chamber_length": CHAMBER,
            "device.wall_thickness": WALL,
            "device.draught": DRAUGHT,
            "device.division": division,
            "pto": None,
            "probes.gauges": None,
            "output.sample_dt": 0.02,
        }
    )


def _kept(division: str, background: bool, dx: float, t1: float) -> Found:
    """Reads the run from `runs/`, or computes it if it does not exist."""
    label = "with" if background else "without"
    path = RUNS / f"divisions_{division}_{label}_{dx:g}_{t1:g}.npz"
    if not path.exists():
        RUNS.mkdir(exist_ok=True)
        run = solve(case_of(division, dx), background, t1)
        np.savez(path, **run._asdict())
    with np.load(path) as file:
        return Found(**{k: file[k] if file[k].ndim else file[k].item() for k in Found._fields})


def solve(case: js.Case, background: bool, t1: float) -> Found:
    """Runs to t1 (s) or to the first failure, which is a result here and not an error."""
    began = time.perf_counter()
    model, state = js.build(case)
    every = round(case.output.sample_dt / float(model.dt))
    # The tables get spare capacity for a division with moving water; if a table becomes stale, the search is
    # repeated more often.
    search = dataclasses.replace(
        model.search,
        capacity=int(1.5 * model.search.capacity),
        node_capacity=int(1.5 * model.search.node_capacity),
        rebuild_every=max(n for n in range(1, 9) if every % n == 0),
    )
    model = eqx.tree_at(lambda m: m.search, model, search)
    if not background:
        model = eqx.tree_at(lambda m: m.scheme.background, model, ())
    probes = js.make_probes(case, model, state)
    per_chunk = round(0.2 / case.output.sample_dt) * every
    advance = jax.jit(lambda m, s: js.simulate(m, s, n_steps=per_chunk, sample_every=every, probes=probes))
    series, ended = [], ""
    while float(model.time(state)) < t1 - 0.5 * float(model.dt):
        new, readings = advance(model, state)
        failure = Failure(int(new.status.bits))
        if failure == Failure.STALE_TABLE and search.rebuild_every > 1:
            # a particle has left the reach of the tables: repeat from the last state, as `js.run` does
            shorter = max(n for n in range(1, search.rebuild_every) if every % n == 0)
            search = dataclasses.replace(search, rebuild_every=shorter)
            model = eqx.tree_at(lambda m: m.search, model, search)
            continue
        series.append({k: np.asarray(v) for k, v in readings.items()})
        if failure:
            when = int(new.status.step) * float(model.dt)
            ended = f"{failure.name} at {when:.2f} s"
            break
        state = new
    joined = {k: np.concatenate([s[k] for s in series]) for k in ("time", "kinetic", "max_speed")}
    if ended:  # readings after the failure are meaningless
        joined = {k: v[joined["time"] <= when] for k, v in joined.items()}
    p = state.particles
    return Found(
        t=joined["time"],
        kinetic=joined["kinetic"],
        max_speed=joined["max_speed"],
        x=np.asarray(p.x, np.float64),
        u=np.asarray(p.u),
        p=np.asarray(p.rho) * float(model.scheme.c0) ** 2,
        ended=ended,
        seconds=time.perf_counter() - began,
    )


def pressure_error(run: Found) -> float:
    """RMS of p - rho g (d - z) in the last valid state, divided by rho g d (-)."""
    error = run.p / (1000.0 * 9.81) - (DEPTH - run.x[:, 1])
    return float(np.sqrt(np.mean(error**2)) / DEPTH)


def verdict(run: Found) -> str:
    """Verdict on the run: "at rest" if kinetic energy / `SCALE` stays below `BAR` and does not grow after
    settling.

    The settled energy is the mean over the second fifth of the run, the final energy the mean over its last
    fifth. In a quiet run the two are equal except for noise, which is well below a factor of two.
    """
    if run.ended:
        return "fails"
    share = run.kinetic / SCALE
    fifth = len(share) // 5
    if share[fifth:].max() > BAR:
        return "unsteady"
    return "growing" if share[-fifth:].mean() > 2 * share[fifth : 2 * fifth].mean() else "at rest"


def _rows(report: Report, division: str, background: bool, run: Found, t1: float) -> None:
    label = (
        f"({division}) {'with the background pressure' if background else 'without the background pressure'}"
    )
    share = run.kinetic / SCALE
    # A failed run has no energy at t1 and counts as missed. Only the default (b, with the background
    # pressure) has a limit.
    last = "failed" if run.ended else float(share[-1])
    barred = division == "b" and background
    report.row(
        f"{label}: kinetic energy at {t1:g} s over the potential energy",
        run.ended or last,
        theory=0.0,
        bar=f"< {BAR:g}" if barred else "",
        passes=(not run.ended and last < BAR) if barred else None,
    )
    report.row(f"{label}: largest kinetic energy over the potential energy", float(np.nanmax(share)))
    report.row(f"{label}: state of the water", verdict(run), theory="at rest", paper=PAPER[division])
    report.row(f"{label}: RMS pressure error / rho g d", 100 * pressure_error(run), "%", theory=0.0)
    report.row(f"{label}: largest speed at the end", float(run.max_speed[-1]), "m/s", theory=0.0)


def _energies(found: dict[tuple[str, bool], Found]) -> Figure:
    """Figure of the ratio of the kinetic energy to `SCALE` over time."""
    figure = Figure(figsize=(8, 5), layout="constrained")
    axis = figure.subplots()
    for (division, background), run in found.items():
        label = f"({division}) {'with' if background else 'without'} background pressure"
        style = "-" if background else "--"
        # in the first sample the water is exactly at rest, which a logarithm cannot show
        shown = run.kinetic > 0
        axis.semilogy(
            run.t[shown], run.kinetic[shown] / SCALE, style, color=COLOURS[division], lw=1, label=label
        )
    axis.axhline(BAR, color="0.4", lw=1, ls=":", label="limit")
    axis.set(xlabel="t, s", ylabel="kinetic energy / (rho g d$^2$ width / 2)")
    axis.legend(fontsize="small", ncols=2)
    return figure


def _fields(runs: dict[str, Found], dx: float) -> Figure:
    """Figure of pressure, its error and horizontal velocity in the last valid state."""
    figure = Figure(figsize=(9, 10), layout="constrained")
    axes = figure.subplots(3, len(runs), sharex=True, sharey=True)
    speed = max(float(np.percentile(abs(run.u[:, 0]), 99.5)) for run in runs.values())
    speed = max(speed, 1e-3)
    rows = (
        ("pressure, Pa", lambda run: run.p, (0.0, 9810 * DEPTH), "viridis"),
        (
            "pressure minus rho g (d - z), Pa",
            lambda run: run.p - 9810 * (DEPTH - run.x[:, 1]),
            (-200, 200),
            "RdBu",
        ),
        ("horizontal velocity, m/s", lambda run: run.u[:, 0], (-speed, speed), "RdBu"),
    )
    for line, (label, values, limits, colours) in zip(axes, rows, strict=True):
        for axis, (division, run) in zip(line, runs.items(), strict=True):
            dots = axis.scatter(
                *run.x.T,
                c=values(run),
                s=5,
                cmap=colours,
                vmin=limits[0],
                vmax=limits[1],
                lw=0,
                antialiased=False,  # reduces the file to a third
            )
            end = f"stopped: {run.ended}" if run.ended else f"{run.t[-1]:.1f} s"
            axis.set(aspect="equal", title=f"({division}), {end}", xlim=(0, LENGTH), ylim=(0, DEPTH + 4 * dx))
        figure.colorbar(dots, ax=line, label=label, extend="both")
    for axis in axes[-1]:
        axis.set_xlabel("x, m")
    for axis in axes[:, 0]:
        axis.set_ylabel("z, m")
    return figure
