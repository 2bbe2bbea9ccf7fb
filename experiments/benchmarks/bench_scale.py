"""Time, memory and messages of a run by number of particles and devices, with a model of the time.

Runs the built-in OWC at three spacings, in both schemes, on one device and on several. Messages between
devices are counted in the compiled step. Every case runs in a separate process, because the number of devices
must be set before JAX is used.
"""

from __future__ import annotations

import re
from typing import NamedTuple

import jax
import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.benchmarks.bench_devices import apart, cost
from experiments.common import Report
from jaxsph.run.devices import share

SPACINGS = (0.02, 0.01, 0.005)
SCHEMES = ("incompressible", "weakly_compressible")
PAPER = 26.7
"""Time of a step of 4,222,746 particles on 16 threads, s (Yeylaghi et al. 2016, table 1)."""
LATENCY, BANDWIDTH = 5e-6, 1e10
"""Latency of a message between machines (s) and bandwidth (bytes/s) of a common cluster's network. Both are
assumed, because no cluster was available to measure them."""
SIZES = {"f32": 4, "s32": 4, "u32": 4, "f64": 8, "s64": 8, "pred": 1}


class Messages(NamedTuple):
    """Messages that a device receives: number, bytes from the adjacent slabs, bytes from all slabs."""

    count: int
    beside: int
    every: int


def main(devices: int = 2, slabs: int = 8, turns: int = 4, steps: int = 500) -> None:
    """Times steps on one core and on `devices` devices, and counts the messages between `slabs` devices."""
    with Report(
        "bench_scale", f"Cost of {steps} steps of the OWC by number of particles and devices"
    ) as report:
        columns: dict[str, list[float]] = {name: [] for name in COLUMNS}
        for scheme in SCHEMES:
            for dx in SPACINGS:
                changes = {"dx": dx, "scheme.kind": scheme}
                for count in (1, devices):
                    found = apart(cost, changes, count, turns, count == 1)
                    row = [scheme == SCHEMES[0], dx, found["water"], found["ghosts"], count]
                    row += [steps * found["seconds"], found["memory"]]
                    for name, value in zip(COLUMNS, row, strict=True):
                        columns[name].append(float(value))
                    label = f"{scheme}, dx = {dx:g} m, {found['water']} particles, {count} device(s)"
                    report.row(f"{label}: time of {steps} steps", steps * found["seconds"], "s")
                    if count == 1:
                        every = found["water"] + found["ghosts"]
                        report.row(f"{label}: memory per particle", found["memory"] / every, "bytes")
        report.table(columns)
        _model(report, {k: np.array(v) for k, v in columns.items()}, steps)
        for scheme in SCHEMES:
            _sent(report, scheme, slabs)
        for scheme in SCHEMES:
            changes = {"dx": 0.02, "scheme.kind": scheme}
            found = apart(cost, changes, 1, 1, True, "dam_break_column")
            every = found["water"] + found["ghosts"]
            report.row(
                f"{scheme}, 3-D, {every} particles: memory per particle", found["memory"] / every, "bytes"
            )


COLUMNS = ("incompressible", "dx (m)", "particles", "ghosts", "devices", "seconds", "memory (bytes)")


def _model(report: Report, table: dict[str, np.ndarray], steps: int) -> None:
    """Fits the time of a step by a part proportional to the particles of a device and a constant part.

    With several devices another constant part is added.
    """
    figure = Figure(figsize=(6, 4.5), layout="constrained")
    axis = figure.subplots()
    for colour, scheme in zip(("C0", "C1"), SCHEMES, strict=True):
        of = table["incompressible"] == (scheme == SCHEMES[0])
        n, many = table["particles"][of] / table["devices"][of], table["devices"][of] > 1
        seconds = table["seconds"][of] / steps
        # each equation is divided by its time, so that relative errors are minimised
        A = np.stack([n, np.ones_like(n), many], axis=1) / seconds[:, None]
        each, once, shared = np.linalg.lstsq(A, np.ones_like(n), rcond=None)[0]
        worst = float(np.max(np.abs(A @ [each, once, shared] - 1.0)))
        report.row(f"{scheme}: model, time per particle and step", 1e6 * each, "us")
        report.row(f"{scheme}: model, constant time per step", 1e3 * once, "ms")
        report.row(f"{scheme}: model, additional time per step on several devices", 1e3 * shared, "ms")
        report.row(
            f"{scheme}: largest relative error of the modelled time per step",
            100 * worst,
            "%",
            bar="20 %",
            passes=worst < 0.2,
        )
        x = np.geomspace(n.min() / 2, n.max() * 2, 50)
        for marker, which in (("o", ~many), ("s", many)):
            axis.plot(n[which], 1e3 * seconds[which], colour + marker, mfc="none" if marker == "s" else None)
        axis.plot(x, 1e3 * (each * x + once), colour + "-", lw=0.8, label=scheme)
        axis.plot(x, 1e3 * (each * x + once + shared), colour + "--", lw=0.8)
        # 1e9 particles on 10,000 cores, 1e5 on each
        report.row(
            f"{scheme}: 1e9 particles on 10,000 cores, time per step by the model", each * 1e5 + once, "s"
        )
    axis.set(xscale="log", yscale="log", xlabel="particles per device", ylabel="time per step, ms")
    axis.legend(title="one device (full), several (dashed)", fontsize=8)
    report.picture(figure)


def _sent(report: Report, scheme: str, slabs: int) -> None:
    """Reports the bytes that a device receives in a step, against the particles in its halos."""
    ratios = []
    for dx in SPACINGS:
        found = apart(messages, {"dx": dx, "scheme.kind": scheme}, slabs, 0, False)
        step, solution = Messages(*found["step"]), Messages(*found["iteration"])
        label = f"{scheme}, {slabs} devices, dx = {dx:g} m"
        surface = 2 * found["halo"]
        ratios.append(step.beside / surface)
        report.row(f"{label}: particles per slab", found["slab"])
        report.row(f"{label}: particles in the halos of a slab", surface)
        report.row(f"{label}: messages per step", step.count)
        report.row(f"{label}: bytes per step from the adjacent slabs", step.beside)
        report.row(f"{label}: bytes per step from all slabs, for walls and sums", step.every)
        if solution.count:
            report.row(f"{label}: messages per iteration of the pressure solver", solution.count)
            report.row(f"{label}: bytes per iteration from the adjacent slabs", solution.beside)
            report.row(f"{label}: bytes per iteration from all slabs", solution.every)
        wire = LATENCY * step.count + (step.beside + step.every) / BANDWIDTH
        report.row(f"{label}: time of the messages of a step on a cluster, by the model", 1e6 * wire, "us")
    spread = max(ratios) / min(ratios) - 1.0
    report.row(f"{scheme}: bytes from the adjacent slabs per halo particle", float(np.mean(ratios)), "bytes")
    what = f"{scheme}: bytes per halo particle, spread between the spacings"
    report.row(what, 100 * spread, "%", bar="5 %", passes=spread < 0.05)


def messages(case: js.Case, devices: int, turns: int) -> dict:
    """Messages to a device per step and per iteration of the pressure solver, in the compiled program."""
    del turns
    model, state = js.build(case)
    model, state = share(model, state, devices)
    _, tables = jax.jit(lambda m, s: m.scheme.prepare(m, s))(model, state)
    step = jax.jit(lambda m, s, t: m.step(s, t)).lower(model, state, tables).compile()
    inside, outside = received(step.as_text(), devices)
    slab = len(state.particles.id) // devices
    return {"step": outside, "iteration": inside, "slab": slab, "halo": model.search.slabs.in_halo(slab)}


def received(text: str, devices: int) -> tuple[Messages, Messages]:
    """Messages inside the loops of a compiled program and outside of them, each counted once."""
    bodies = set(re.findall(r"body=%?([\w.\-]+)", text))
    found = {True: [0, 0, 0], False: [0, 0, 0]}
    name = ""
    for line in text.splitlines():
        if head := re.match(r"(?:ENTRY )?%?([\w.\-]+) .*\{$", line):
            name = head.group(1)
        kind = re.search(r"= (.*?) (collective-permute|all-gather|all-reduce)(?:-start)?\(", line)
        if not kind:
            continue
        size = sum(
            SIZES[t] * int(np.prod([int(a) for a in shape.split(",") if a]))
            for t, shape in re.findall(r"(\w+)\[([\d,]*)\]", kind.group(1))
        )
        total = found[name in bodies]
        total[0] += 1
        if kind.group(2) == "collective-permute":
            total[1] += size
        else:
            share = (devices - 1) / devices if kind.group(2) == "all-gather" else 1.0
            total[2] += int(size * share)
    return Messages(*found[True]), Messages(*found[False])
