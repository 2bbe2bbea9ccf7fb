"""Report of `jaxsph check`: a description of a run, and an estimate of its computing time."""

from __future__ import annotations

from typing import Any

import numpy as np

from jaxsph.case.geometry import Geometry
from jaxsph.case.linear import incident_power
from jaxsph.case.sections import Sections
from jaxsph.case.speeds import wavenumber
from jaxsph.core.native.forms import SHARE, available
from jaxsph.model.interfaces import Model
from jaxsph.parts.border import flumes
from jaxsph.problem.sources import source_of

SEARCHED = 2.0
"""Time of a step with a neighbour search over that of a step, for a flume, which searches at every step."""


def check(given: Any) -> list[tuple[str, str]]:
    """Report on a case, a problem or a function before a run, as labels and values: particles, time step,
    waves, incident power and wall time."""
    source = source_of(given)
    problem = source.problem()
    model, dx = problem.model, float(problem.model.dx)
    n, ghosts = len(problem.state.particles.id), model.walls.count
    steps = int(np.ceil(problem.t1 / float(model.dt) - 1e-3))
    about = f"{problem.name}: {problem.description}" if problem.description else problem.name
    rows = [
        ("case", about),
        ("particles", f"{n:,} of water, {ghosts:,} ghosts, dx = {dx:g} m"),
        ("scheme", model.scheme.description()),
        ("time step", f"{float(model.dt):.3e} s, {steps:,} steps to t1 = {problem.t1:g} s"),
    ]
    if isinstance(source, Sections) and source.waves is not None:
        geometry = Geometry.of(source)
        # a run may average over a part of a sea, whose power differs
        whole = {"irregular": ", mean of the whole sea", "recorded": ", mean of the whole series"}.get(
            source.waves.kind, ""
        )
        k = wavenumber(source.waves.period, geometry.depth, source.g)
        rows += [
            ("wavelength", f"{2 * np.pi / k:.4g} m (kd = {k * geometry.depth:.3g})"),
            ("paddle stroke", f"{geometry.stroke:.4g} m"),
            ("incident power", f"{incident_power(source):.4g} W per metre of width{whole}"),
        ]
    search, seconds = model.search, _cost(model, n)
    for border in flumes(model):
        flume, count = border.flume, len(border.first.particles.id)
        where = f"up to x = {border.face:g} m, with an overlap"
        rows.append(("flume", f"{count:,} particles of water, dx = {float(flume.dx):g} m, {where}"))
        seconds += SEARCHED * _cost(flume, count) / border.ratio
    seconds *= steps * (SHARE if available() else 1.0)
    return [
        *rows,
        ("neighbours", f"{search.capacity} slots, searched every {search.rebuild_every} steps"),
        ("wall time", f"about {in_time(seconds)} on one core of a current CPU"),
    ]


def _cost(model: Model, count: int) -> float:
    """Time of a step with `count` particles of water, s, on one core of a current CPU."""
    costly = count + model.walls.filling.effort * model.walls.count
    return costly * model.scheme.cost(float(model.dx), len(model.g))


def in_time(seconds: float) -> str:
    """A time (s) as text, in seconds, minutes or hours."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
