"""Probes of a case's run, at the positions that `Geometry` gives."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxsph.case.flume import flume_case
from jaxsph.case.geometry import Geometry
from jaxsph.case.sections import Sections
from jaxsph.case.shapes import crest_of
from jaxsph.core.arrays import on_device
from jaxsph.model.interfaces import Model
from jaxsph.model.probe import AbstractProbe
from jaxsph.model.state import State
from jaxsph.parts.border import flume_of
from jaxsph.probes.coast import OvertoppingProbe, RunUpProbe
from jaxsph.probes.default import default_probes
from jaxsph.probes.gauges import FlumeGauge, InterpolatedGauge, WaveGauge, WireGauge
from jaxsph.probes.sensors import BodyPressureProbe, PressureProbe, VelocityProbe


def make_probes(case: Sections, model: Model, state: State) -> tuple[AbstractProbe, ...]:
    """Makes the probes of a case, at the positions that `Geometry` gives.

    All gauges measure elevations above the still water level, or above the bed if a column is released.
    """
    geometry = Geometry.of(case)
    dtype = model.dt.dtype
    found: list[AbstractProbe] = [*default_probes(model, state, case.output.sample_dt)]
    released = case.tank.column is not None
    level = jnp.zeros_like(model.depth) if released else model.depth
    if geometry.gauges:
        gauge = _gauge(geometry, (model, state), released)
        if case.flume is None:
            found.append(gauge)
        else:
            before = _gauge(geometry, flume_of(model, state), released)
            # where flume and fine zone overlap, each is measured on its own side of the middle
            middle = on_device(0.5 * (case.near + flume_case(case).tank.length), dtype)
            found.append(FlumeGauge(gauge, before, middle))
    if geometry.surface:
        at, top = np.asarray(geometry.surface), model.walls.high[-1]
        levels = np.arange(0.0, top, 0.5 * case.dx)
        at, levels = (on_device(a, dtype) for a in (at, levels))
        found.append(InterpolatedGauge(at, levels, level))
        wire = WireGauge(at, jnp.zeros_like(at[:, 0]))
        still = wire.still if released else _measure(wire, model, state)["eta_wire"]
        found.append(WireGauge(at, still))
    if geometry.pressure:
        found.append(PressureProbe(on_device(geometry.pressure, dtype)))
    if geometry.velocity:
        found.append(VelocityProbe(on_device(geometry.velocity, dtype)))
    for name in case.probes.overtopping:
        crest, top = (jnp.asarray(a, dtype) for a in crest_of(geometry.solids[name], case.dx))
        probe = OvertoppingProbe(crest, top, jnp.zeros_like(crest), name)
        still = _measure(probe, model, state)[f"overtopped_{name}"]
        found.append(OvertoppingProbe(crest, top, still, name))
    for name in case.probes.run_up:
        crest, _ = crest_of(geometry.solids[name], case.dx)
        found.append(RunUpProbe(jnp.asarray(crest, dtype), model.depth, name))
    bodies = {body.name: body for body in model.bodies}
    for name, section in case.every_body.items():
        if section.sensors:
            found.append(BodyPressureProbe.of(bodies[name], on_device(section.sensors, dtype)))
    return tuple(found)


def _gauge(geometry: Geometry, zone: tuple[Model, State], released: bool) -> WaveGauge:
    """Wave gauges at the case's positions in a zone, which read zero in the zone's initial state, or on a dry
    bed if a column is `released`."""
    model, state = zone
    at = on_device(geometry.gauges, model.dt.dtype)
    gauge = WaveGauge(at, on_device(np.zeros(len(at)), model.dt.dtype))
    # a gauge reads the depth of the water, which is smaller above a raised bed
    return gauge if released else WaveGauge(at, _measure(gauge, model, state)["eta"])


@eqx.filter_jit
def _measure(probe: AbstractProbe, model: Model, state: State) -> dict[str, jax.Array]:
    """Readings of a probe in the given state, by name; compiled as one function."""
    return probe.measure(model, state, None)
