"""Coarse flume in front of the water of spacing dx: its checks, its model, and the border between the two."""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import numpy as np

from jaxsph.case.assemble import SKIN, assemble
from jaxsph.case.geometry import Geometry
from jaxsph.case.initial import at_rest, initial_velocity, still_water
from jaxsph.case.parts import make_paddle, make_zones
from jaxsph.case.scheme import make_scheme, stable_time_step
from jaxsph.case.sections import ProbesSection, Sections
from jaxsph.case.speeds import search_speed, wavenumber
from jaxsph.core.arrays import on_device
from jaxsph.errors import CaseError
from jaxsph.model.meaning import Group, Label
from jaxsph.parts.border import REACH, Border, Edge, FlumeEnd
from jaxsph.parts.paddle import column_depth
from jaxsph.problem.record import Record, Result
from jaxsph.schemes.base import AbstractParticleScheme
from jaxsph.solids.box import FreeSlip, NoSlip
from jaxsph.solids.walls import Ghosts

OVERLAP = 1.0
"""Length over which flume and fine zone overlap, in depths, unless the edges' gauges need more. Errors of the
exchange fall to exp(-pi/2) over one depth."""
CLEAR = 4
"""Least distance between the flume's end and the first solid, in spacings of the flume."""
GAUGE = 5.0
"""Distance of an edge's gauge from the edge, in spacings of the flume."""
BELL = 3.0
"""Half-width of the column of water that an edge's gauge measures, in spacings of the flume."""
WEIGHT = 1.2
"""Width of the Gaussian weight of a measured velocity, in spacings of the flume."""
ROOM = 2
"""Ratio of the largest number of particles near an edge to that in still water beside a straight edge."""
FEEDBACK = 0.3
"""Ratio of an edge's answer to a difference between the zones' elevations to that of an absorbing wall (-).
Differences that last, such as one of the levels, decay in a second or two; a full answer adds noise."""
STRAIGHTENING = 10.0
"""Time over which an edge's displacement is averaged before it is straightened, in sqrt(d/g)."""


def flume_case(case: Sections) -> Sections:
    """The flume alone: a tank of larger particles, with the case's waves, that ends inside the fine zone."""
    assert case.flume is not None, "only a case with a flume has one"
    dx = round(case.flume.factor * case.dx, 12)
    # the gauge of an edge must measure a whole column of the other zone, too
    overlap = max(round(OVERLAP * case.tank.depth / dx), int(GAUGE + BELL)) * dx
    tank = case.tank.model_copy(update={"length": round(case.near + overlap, 12)})
    nothing: dict[str, Any] = dict.fromkeys(("flume", "device", "pto", "air", "sponge", "body"))
    nothing |= {name: {} for name in ("bodies", "link", "mooring", "solid", "chamber", "duct")}
    probes = ProbesSection.model_validate({})
    return case.model_copy(update=nothing | {"dx": dx, "tank": tank, "probes": probes})


def check_flume(case: Sections, geometry: Geometry) -> None:
    """**Raises** CaseError for a flume that the case's scheme, tank or probes exclude, or that reaches a
    solid."""
    if case.flume is None:
        return
    asked = f"flume.length = {case.flume.length:g} m"
    others = {
        "a scheme other than the incompressible one": case.scheme.kind != "incompressible",
        "tank.width": case.dim == 3,
        "tank.column": case.tank.column is not None,
        "sponge.near": case.sponge is not None and case.sponge.near is not None,
    }
    for other, given in others.items():
        if given:
            raise CaseError(f"{asked}: a flume cannot be combined with {other}; remove one of the two")
    alone = flume_case(case)
    end, spacing = alone.tank.length, alone.dx
    if abs(case.near - case.flume.length) > 1e-6:
        raise CaseError(
            f"{asked}: must be a whole number of the flume's spacings of {spacing:g} m; use {case.near:g} m"
        )
    rows = geometry.depth / spacing
    if abs(rows - round(rows)) > 1e-6 * rows:
        raise CaseError(
            f"flume.factor = {case.flume.factor}: the depth of {geometry.depth:g} m is not a whole number of "
            f"the flume's spacings of {spacing:g} m; use another dx or flume.factor"
        )
    if case.near < 10 * spacing:
        raise CaseError(f"{asked}: must be at least ten spacings of the flume, {10 * spacing:g} m")
    solids = [float(shape.bounds()[0][0]) for shape in geometry.named_shapes().values()]
    first = min([geometry.length, *solids])
    if end + CLEAR * spacing > first + 1e-9:
        raise CaseError(
            f"{asked}: the flume overlaps with the water of spacing dx up to x = {end:g} m, "
            f"and must end {CLEAR * spacing:g} m before the first solid or the end wall, at {first:.4g} m; "
            f"use at most {first - CLEAR * spacing - (end - case.near):.4g} m, or a smaller flume.factor"
        )
    for name in ("surface", "pressure", "velocity"):
        for index, point in enumerate(getattr(geometry, name)):
            if point[0] < case.near:
                raise CaseError(
                    f"probes.{name}[{index}] = {list(point)} is in the flume (up to {case.near:g} m), where "
                    "only gauges measure: move the point behind the border, or use a shorter flume"
                )


def make_border(
    case: Sections, geometry: Geometry, walls: Ghosts, water: tuple[np.ndarray, np.ndarray], dt: float
) -> Border:
    """Border of the water of spacing dx, with the flume in front of it.

    **Arguments**: `walls`: ghosts of the water of spacing dx; `water`: positions (m) and volumes (m2) of its
    particles at rest; `dt`: its time step, s.
    """
    alone = flume_case(case)
    bounds = Geometry.of(alone)
    scheme = make_scheme(alone)
    ghosts, x, volume = _still_flume(alone, bounds, scheme)
    own, flume = (_Edges(case, alone, geometry, water, (x, volume)).edge(side) for side in (1.0, -1.0))
    (start, stop), (first, last) = walls.paddle, ghosts.far_end

    def leaf(a: Any) -> Any:
        return on_device(a, np.dtype(case.precision))

    paddles = () if case.waves is None else (make_paddle(alone, bounds, ghosts, (x, volume), leaf),)
    ratio = max(1, int(stable_time_step(alone) / dt * (1.0 + 1e-6)))
    model, state = assemble(
        x,
        initial_velocity(case, geometry, x),
        scheme=scheme,
        walls=ghosts,
        dx=alone.dx,
        sample_dt=2 * ratio * dt,  # two steps between regularisations; the border searches at every step
        dt_most=ratio * dt * (1.0 + 1e-6),
        p=case.fluid.rho0 * case.g * (geometry.depth - x[:, 1]),
        volume=volume,
        g=(0.0, -case.g),
        moving=(*paddles, FlumeEnd(edge=flume, rows=(first, last), face=alone.tank.length)),
        dampers=make_zones(alone, bounds, leaf),
        speed=search_speed(case),
        skin=SKIN,
        depth=geometry.depth,
    )
    return Border(edge=own, flume=model, first=state, rows=(start, stop), ratio=ratio, face=case.near)


def _still_flume(
    alone: Sections, bounds: Geometry, scheme: AbstractParticleScheme
) -> tuple[Ghosts, np.ndarray, np.ndarray]:
    """Ghosts of a flume alone, and positions (m) and volumes (m2) of its water at rest."""
    box = dataclasses.replace(bounds.box(alone), far_moves=True)
    slip = FreeSlip() if alone.tank.slip == "free_slip" else NoSlip()
    ghosts = Ghosts.build(box, alone.dx, scheme.smoothing, slip, dtype=np.dtype(alone.precision))
    x, volume = still_water(ghosts, bounds.depth, alone.dx)
    return ghosts, at_rest(x, bounds.depth, alone.dx, scheme.smoothing.kernel), volume


def border_results(case: Sections) -> tuple[Result, ...]:
    """Results of the border in waves: the power that passes it, and the share that is lost on the way."""
    if case.flume is None or case.waves is None:
        return ()
    depth = Geometry.of(case).depth
    hydrostatic = 0.5 * case.fluid.rho0 * case.g * depth**2

    def mean(record: Record, power: str, displacement: str, side: float) -> float:
        """Mean power (W/m) without the work of still water's pressure, which a drift of the edge does."""
        over = np.flatnonzero(record.window.over)
        t, X = record.t[over[[0, -1]]], record[displacement][over[[0, -1]]]
        return float(np.mean(record[power][over[1:]]) - side * hydrostatic * (X[1] - X[0]) / (t[1] - t[0]))

    def make(record: Record) -> dict[str, float]:
        if not record.window.periods:
            return {}
        given = -mean(record, "flume_far_end", "far_end", -1.0)
        taken = mean(record, "power_paddle", "border", 1.0)
        return {"border_power": taken, "border_residual": (given - taken) / given}

    labels = {
        "border_power": Label(
            "power through the border", "W/m", "mean power that the water takes", Group.NUMERICS
        ),
        "border_residual": Label(
            "power lost at the border", "", "mean power given less taken, over given", Group.NUMERICS
        ),
    }
    return (Result(make, labels, "border of the flume"),)


class _Edges:
    """Makes the edges of both zones from the particles at rest, positions (m) and volumes (m2) of each."""

    def __init__(
        self,
        case: Sections,
        alone: Sections,
        geometry: Geometry,
        fine: tuple[np.ndarray, np.ndarray],
        coarse: tuple[np.ndarray, np.ndarray],
    ) -> None:
        """**Arguments**: the case, its flume alone, and the water of the two zones."""
        self.case, self.alone, self.geometry = case, alone, geometry
        self.zones = (fine, coarse)

    def edge(self, side: float) -> Edge:
        """Near edge of the fine zone (`side` 1), or far edge of the flume (-1)."""
        case, dx, depth = self.case, self.alone.dx, self.geometry.depth
        face = case.near if side > 0 else self.alone.tank.length
        gauge, bell = face + side * GAUGE * dx, BELL * dx
        own, other = (self._depth(*zone, gauge, bell) for zone in self.zones[:: int(side)])
        speed = np.sqrt(case.g * depth)
        if case.waves is not None:
            speed = 2.0 * np.pi / (case.waves.period * wavenumber(case.waves.period, depth, case.g))
        numbers = {
            "face": face,
            "heights": np.arange(0.5, self.geometry.height / dx) * dx,
            "width": WEIGHT * dx,
            "gauge": gauge,
            "bell": bell,
            "own_still": own,
            "other_still": other,
            "gain": FEEDBACK * case.g / speed,
            "drift": np.sqrt(case.g / depth) / STRAIGHTENING,
        }
        beside = np.abs(self.zones[1 if side > 0 else 0][0][:, 0] - face) < REACH * WEIGHT * dx
        leaves = {name: on_device(a, np.dtype(case.precision)) for name, a in numbers.items()}
        return Edge(**leaves, most=ROOM * int(np.sum(beside)), side=side)

    def _depth(self, x: np.ndarray, volume: np.ndarray, gauge: float, bell: float) -> float:
        """Depth (m) that a gauge reads in still water."""
        dtype = np.dtype(self.case.precision)
        V = np.broadcast_to(volume, len(x))
        given = (on_device(a, dtype) for a in (V, gauge, bell))
        return float(_column_depth((on_device(x[:, 0], dtype), on_device(x[:, 1], dtype)), *given))


_column_depth = jax.jit(column_depth)
