"""Probes of a case's run, and the report of `jaxsph check`: what the run will be and how long it takes."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from jaxsph.case.build import build
from jaxsph.case.case import Case
from jaxsph.case.geometry import Geometry
from jaxsph.case.linear import incident_power
from jaxsph.case.speeds import wavenumber
from jaxsph.model.interfaces import AbstractProbe, Model
from jaxsph.model.state import State
from jaxsph.probes.default import default_probes
from jaxsph.probes.gauges import InterpolatedGauge, WaveGauge, WireGauge
from jaxsph.probes.sensors import BodyPressureProbe, PressureProbe, VelocityProbe


def make_probes(case: Case, model: Model, state: State) -> tuple[AbstractProbe, ...]:
    """Probes that a case asks for, at their places on the lattice.

    Elevations of all gauges have one zero: the still water level, or the bed where a column is released.
    """
    geometry = Geometry.of(case)
    dtype = model.dt.dtype
    found: list[AbstractProbe] = [*default_probes(model, state, case.output.sample_dt)]
    released = case.tank.column is not None
    level = jnp.zeros_like(model.depth) if released else model.depth
    if geometry.gauges:
        at = jnp.asarray(geometry.gauges, dtype)
        gauge = WaveGauge(at, jnp.zeros_like(at))
        # a gauge reads the depth of the water, over a raised bed too
        still = jnp.zeros_like(at) if released else gauge.measure(model, state, None)["eta"]
        found.append(WaveGauge(at, still))
    if geometry.surface:
        at, top = np.asarray(geometry.surface), model.walls.high[-1]
        levels = np.arange(0.0, top, 0.5 * case.dx)
        at, levels = (jnp.asarray(a, dtype) for a in (at, levels))
        found.append(InterpolatedGauge(at, levels, level))
        wire = WireGauge(at, jnp.zeros_like(at[:, 0]))
        still = wire.still if released else wire.measure(model, state, None)["eta_wire"]
        found.append(WireGauge(at, still))
    if geometry.pressure:
        found.append(PressureProbe(jnp.asarray(geometry.pressure, dtype)))
    if geometry.velocity:
        found.append(VelocityProbe(jnp.asarray(geometry.velocity, dtype)))
    if model.bodies and case.body.sensors:
        found.append(BodyPressureProbe(jnp.asarray(case.body.sensors, dtype)))
    return tuple(found)


def steps_per_sample(case: Case, model: Model) -> int:
    """Number of time steps between two samples; the time step divides the sampling interval."""
    return round(case.output.sample_dt / float(model.dt))


def check(case: Case) -> list[tuple[str, str]]:
    """Report before a run, as labels and values: particles, time step, waves, incident power, wall time."""
    model, state = build(case)
    n, ghosts = state.particles.x.shape[0], model.walls.count
    steps = int(np.ceil(case.t1 / float(model.dt) - 1e-3))
    rows = [
        ("case", f"{case.name}: {case.description}"),
        ("particles", f"{n:,} of water, {ghosts:,} ghosts, dx = {case.dx:g} m"),
        ("scheme", model.scheme.description()),
        ("time step", f"{float(model.dt):.3e} s, {steps:,} steps to t1 = {case.t1:g} s"),
    ]
    if case.waves is not None:
        geometry = Geometry.of(case)
        k = wavenumber(case.waves.period, geometry.depth, case.g)
        rows += [
            ("wavelength", f"{2 * np.pi / k:.4g} m (kd = {k * geometry.depth:.3g})"),
            ("paddle stroke", f"{geometry.stroke:.4g} m"),
            ("incident power", f"{incident_power(case):.4g} W per metre of width"),
        ]
    search = model.search
    seconds = steps * (n + ghosts) * model.scheme.cost(case.dx, case.dim)
    return [
        *rows,
        ("neighbours", f"{search.capacity} slots, searched every {search.rebuild_every} steps"),
        ("wall time", f"about {_duration(seconds)} on one core of a current CPU"),
    ]


def _duration(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
