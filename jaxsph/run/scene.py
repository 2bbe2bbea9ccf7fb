"""Walls, solids and links that are drawn around the particles in pictures of a run, as stored in the run's
file."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import shapely

from jaxsph.model.interfaces import Model
from jaxsph.model.mechanism import Mechanism
from jaxsph.model.solids import AbstractMovingSolid
from jaxsph.model.state import State
from jaxsph.parts.border import zones
from jaxsph.problem.problem import Problem
from jaxsph.solids.box import SIDES
from jaxsph.solids.shapes import box_corners

FAR = 10.0
"""Distance to which an unbounded solid is drawn, in multiples of the larger side of the box."""


def scene_of(problem: Problem) -> dict[str, Any]:
    """Box of the water, its walls, and the outlines of all solids in the x-z plane; lengths in m.

    Moving solids are drawn in their rest positions. Keys: `dx`; `low`, `high`: corners (x, z) of the box;
    `walls`: whether the box has a left, a right and a bottom wall; `level`: still water level, None if it is
    at the top of the box; `solids`: `name` (key of the pose in snapshots, empty for a fixed solid),
    `corners`, `pivot`; `lines`: names of the links to draw, whose points are stored in the snapshots.
    """
    model = problem.model
    walls = model.walls
    near = zones(model, problem.state)[-1][0].walls
    low, high = ((float(ends[0]), float(ends[-1])) for ends in (near.low, walls.high))
    far = FAR * max(high[0] - low[0], high[1] - low[1])
    beside, below = SIDES[walls.sides[0]], SIDES[walls.sides[-1]]
    depth = float(model.depth)
    inside = shapely.Polygon(box_corners(low, (high[0], far)))
    solids = []
    for solid in model.solids:
        corners = solid.outline(far)
        if len(corners):
            # fixed solids are not drawn beyond the walls
            cut = shapely.Polygon(corners).intersection(inside)
            if isinstance(cut, shapely.Polygon) and not cut.is_empty:
                solids.append(_outline("", np.asarray(cut.exterior.coords)[:-1], np.zeros(2)))
    for solid, motion in _movers(model, problem.state):
        corners = solid.outline(far)
        if len(corners):
            solids.append(_outline(solid.name, corners, np.asarray(solid.pose(motion)[1])))
    for body in (body for body in model.bodies if body.fixed):
        corners = body.outline(far)
        if len(body.pivot) == 3:
            corners = np.insert(corners, 1, float(body.pivot[1]), axis=1)
        corners = body.carry(problem.state.parts[body.name], jnp.asarray(corners))
        solids.append(_outline("", np.asarray(corners)[:, [0, -1]], np.zeros(2)))
    return {
        "dx": float(model.dx),
        "low": low,
        "high": high,
        "walls": [bool(beside[0] and not near.paddle), bool(beside[1]), bool(below[0])],
        "level": depth if depth < 0.999 * (high[1] - low[1]) else None,
        "solids": solids,
        "lines": list(_lines(model, problem.state)),
    }


def _outline(name: str, corners: np.ndarray, pivot: np.ndarray) -> dict[str, Any]:
    """Outline of a solid, rounded to a micrometre."""
    rounded = {"corners": corners, "pivot": pivot}
    return {"name": name} | {key: np.round(a.astype(float), 6).tolist() for key, a in rounded.items()}


def places_of(model: Model, state: State) -> dict[str, np.ndarray]:
    """Poses of the moving solids and points of the links, by name, for a snapshot of the state.

    A pose consists of surge (m), heave (m) and pitch (rad), or of all six motions for a body in 3-D
    (`model.rigid`). The points of a link are `[K, D]` (m).
    """
    poses = {one.name: np.asarray(one.pose(motion)[0]) for one, motion in _movers(model, state)}
    return poses | _lines(model, state)


def _movers(model: Model, state: State) -> Iterator[tuple[AbstractMovingSolid, Any]]:
    """Yields all solids that can move, those of a flume too, with their states."""
    for zone, its in zones(model, state):
        for solid in zone.movers():
            yield solid, its.parts[solid.name]


def _lines(model: Model, state: State) -> dict[str, np.ndarray]:
    """Points `[K, D]` (m) of the links that are drawn, by name."""
    if not model.links:
        return {}
    drawn = _drawn(model.mechanism, dict(state.parts), model.time(state))
    return {name: np.asarray(line) for name, line in drawn.items()}


_drawn = eqx.filter_jit(Mechanism.drawn)
