"""Cases: a validated description in SI units, and `build`, which turns it into a model and a state.

Everything that fixes an array's shape is spent here, on the host. Lengths are snapped to the lattice of
spacing dx, and `Case.notices` says what became of each.
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from jaxsph.case.build import (
    build,
)
from jaxsph.case.case import Case
from jaxsph.model.interfaces import AbstractProbe, Model
from jaxsph.model.state import State
from jaxsph.probes.default import default_probes
from jaxsph.probes.gauges import InterpolatedGauge, ParticleGauge, WaveGauge
from jaxsph.probes.sensors import BodyPressureProbe, PressureProbe, VelocityProbe
from jaxsph.waves import theory


def make_probes(case: Case, model: Model, state: State) -> tuple[AbstractProbe, ...]:
    """The probes that a case asks for, zeroed in its initial state."""
    dtype = model.dt.dtype
    found: list[AbstractProbe] = [*default_probes(model, state, case.output.sample_dt)]
    if case.probes.gauges:
        at = jnp.asarray(case.probes.gauges, dtype)
        gauge = WaveGauge(at, jnp.zeros_like(at))
        still = gauge.measure(model, state, None)["eta"]
        found.append(WaveGauge(at, still))
    if case.probes.surface:
        at, top = np.asarray(case.probes.surface), model.walls.high[-1]
        levels = np.arange(0.0, top, 0.5 * case.dx)
        at, levels, half = (jnp.asarray(a, dtype) for a in (at, levels, 0.5 * case.dx))
        found.append(InterpolatedGauge(at, levels, model.depth))
        found.append(ParticleGauge(at, model.depth - half))
    if case.probes.pressure:
        found.append(PressureProbe(jnp.asarray(case.probes.pressure, dtype)))
    if case.probes.velocity:
        found.append(VelocityProbe(jnp.asarray(case.probes.velocity, dtype)))
    if model.bodies and case.body.sensors:
        found.append(BodyPressureProbe(jnp.asarray(case.body.sensors, dtype)))
    return tuple(found)


def steps_per_sample(case: Case, model: Model) -> int:
    """Steps between two samples (dt was chosen to divide it)."""
    return round(case.output.sample_dt / float(model.dt))


def check(case: Case) -> list[tuple[str, str]]:
    """What a run of this case will be: labels and values, for people."""
    model, state = build(case)
    n, ghosts = state.particles.x.shape[0], model.walls.count
    steps = int(np.ceil(case.t1 / float(model.dt) - 1e-3))
    rows = [
        ("case", f"{case.name}: {case.description}"),
        ("particles", f"{n:,} of water, {ghosts:,} ghosts, dx = {case.dx:g} m"),
        ("scheme", model.scheme.described()),
        ("time step", f"{float(model.dt):.3e} s, {steps:,} steps to t1 = {case.t1:g} s"),
    ]
    if case.waves is not None:
        omega = 2 * np.pi / case.waves.T
        k = float(theory.wavenumber(omega, case.tank.depth, case.g))
        power = theory.incident_power(case.waves.H, case.waves.T, case.tank.depth, case.fluid.rho0, case.g)
        rows += [
            ("wavelength", f"{2 * np.pi / k:.4g} m (kd = {k * case.tank.depth:.3g})"),
            ("paddle stroke", f"{case.waves.H / float(theory.biesel(k, case.tank.depth)):.4g} m"),
            ("incident power", f"{float(power):.4g} W per metre of width"),
        ]
    search = model.search
    rows += [
        (
            "neighbours",
            f"{search.capacity} slots, searched every {search.rebuild_every} steps",
        ),
        (
            "wall time",
            f"about {_duration(n * steps * model.scheme.cost(len(model.g)))} on one core of a current CPU",
        ),
    ]
    return rows


def _duration(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
