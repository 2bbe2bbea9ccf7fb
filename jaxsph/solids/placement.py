"""Placement of particles before a run, in NumPy: water on a lattice, and ghosts of every kind of wall."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from jaxsph.core.points import at_points
from jaxsph.solids.box import Box, LeaningPlate, Platform, WallPlate
from jaxsph.solids.divisions import (
    PLAIN,
    SETS,
    AbstractThinWall,
    Regions,
)
from jaxsph.solids.shapes import AbstractShape


def lattice(
    low: Sequence[float],
    high: Sequence[float],
    dx: float,
    plates: Sequence[WallPlate] = (),
    platforms: Sequence[Platform] = (),
) -> tuple[np.ndarray, np.ndarray]:
    """Positions `[N, D]` (m) and volumes `[N]` (m^D) of water that fills a box around plates and a platform.

    The box from `low` to `high` (m), the levels of the plates' tips and the platform's lengths must be whole
    numbers of spacings `dx` (m). A plate's faces may lie anywhere. Beside the plate, the columns of particles
    on either side are stretched to fill that side; below the plate's tip they are not stretched.
    """
    axes = [a + (np.arange(round((b - a) / dx)) + 0.5) * dx for a, b in zip(low, high, strict=True)]
    parts = []
    tips = [-np.inf, *sorted(plate.tip for plate in plates), np.inf]
    for bottom, top in itertools.pairwise(tips):
        rows = axes[-1][(axes[-1] > bottom) & (axes[-1] <= top)]
        cutting = sorted((plate for plate in plates if plate.tip <= bottom), key=lambda plate: plate.x0)
        starts, ends = [low[0], *(p.x1 for p in cutting)], [*(p.x0 for p in cutting), high[0]]
        for start, end in zip(starts, ends, strict=True):
            along, width = axes[0], dx
            if cutting:
                count = max(1, int(np.floor((end - start) / dx + 0.5 + 1e-9)))
                width = (end - start) / count
                along = start + (np.arange(count) + 0.5) * width
            x = np.stack(np.meshgrid(along, *axes[1:-1], rows, indexing="ij"), -1).reshape(-1, len(low))
            parts.append((x, np.full(len(x), width * dx ** (len(low) - 1))))
    x, volume = (np.concatenate(part) for part in zip(*parts, strict=True))
    for platform in platforms:
        wet = (x[:, 0] < platform.start) | (x[:, -1] > platform.height)
        x, volume = x[wet], volume[wet]
    if not plates:
        return x, volume
    order = np.lexsort((x[:, -1], x[:, 0]))
    return x[order], volume[order]


HELD = 1e-4
"""Distance from a wall or a solid within which a plate's end counts as attached to it, m."""


class GhostSet(NamedTuple):
    """Ghosts of a wall, as NumPy arrays with one row for each ghost."""

    x: np.ndarray
    """Positions `[G, D]`, m."""
    node: np.ndarray
    """Interpolation nodes `[G, D]`, m."""
    mirror: np.ndarray
    """Factors `[G, D]` of the velocity's components: -1 normal to the wall, 1 along it (0 at a thin wall's
    tip); 0 for dummy particles."""
    kind: np.ndarray
    """Kind bits `[G]`, which determine the regions that see a ghost."""
    node_sees: np.ndarray
    """Bits `[G]` of the particles that the nodes use; -1 for all particles that the node's region sees."""
    moves: np.ndarray
    """Mask `[G]` of the ghosts that move with the paddle."""
    volume: np.ndarray
    """Volumes `[G]`, m^D."""


def join(parts: Sequence[GhostSet]) -> GhostSet:
    """Joins several sets of ghosts into one."""
    return GhostSet(*(np.concatenate(a) for a in zip(*parts, strict=True)))


def sliding_velocity(
    x: np.ndarray, box: Box, sliding: Mapping[tuple[int, int], Sequence[float]]
) -> np.ndarray:
    """Velocity `[G, D]` of the wall in front of each ghost, m/s, for walls that slide in their own plane.

    **Arguments**: `x`: positions of the ghosts, m; `sliding`: velocities (m/s) with keys (axis, end), where
    end is 0 for the low and 1 for the high end.
    **Raises** ValueError if a wall in `sliding` does not exist or has a velocity normal to itself.
    """
    u = np.zeros_like(x)
    for (axis, end), velocity in sliding.items():
        if not box.walls[axis, end]:
            raise ValueError(
                f"sliding: axis {axis} ({box.sides[axis]}) has no wall at end {end}; remove ({axis}, {end})"
            )
        if velocity[axis]:
            raise ValueError(
                f"sliding: the wall at end {end} of axis {axis} can only move along itself, but its velocity "
                f"{velocity} m/s has a component along that axis; set this component to 0"
            )
        behind = x[:, axis] > box.high[axis] if end else x[:, axis] < box.low[axis]
        u[behind] += np.asarray(velocity, float)
    return u


def box_ghosts(box: Box, dx: float, layers: int) -> GhostSet:
    """Ghosts of a tank's walls, on the lattice of spacing `dx` (m) outside its box, `layers` deep.

    A ghost in a corner is mirrored in all walls of the corner.
    """
    dim = len(box.low)
    low, high = np.array(box.low), np.array(box.high)
    behind = int(np.ceil(box.stroke / dx)) if box.paddle else 0
    axes = []
    for axis in range(dim):
        count = round((high[axis] - low[axis]) / dx)
        floor, lid = box.walls[axis]
        first = -layers - (behind if axis == 0 else 0) if floor else 0
        last = count + (layers if lid else 0)
        axes.append(low[axis] + (np.arange(first, last) + 0.5) * dx)
    x = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, dim)
    under, over = x < low, x > high
    outside = (under | over).any(axis=1)
    # ghosts of the paddle and its corners move with it; the bed's ghosts extend over the paddle's stroke
    x, under, over = x[outside], under[outside], over[outside]
    node = np.where(under, 2 * low - x, np.where(over, 2 * high - x, x))
    normal = under | over
    mirror = np.where(normal, -1.0, 1.0)
    moves = np.zeros(len(x), bool)
    keep = np.ones(len(x), bool)
    extra: list[GhostSet] = []
    if box.paddle:
        at_paddle = under[:, 0]
        others = normal[:, 1:].any(axis=1)
        near = x[:, 0] > low[0] - layers * dx
        moves = at_paddle & near
        keep = ~at_paddle | near
        # ghosts of the bed (and side walls) behind the paddle are not mirrored in the paddle
        bed = at_paddle & others
        if behind:
            sub = x[bed]
            node_bed = np.where(under, 2 * low - x, np.where(over, 2 * high - x, x))[bed]
            node_bed[:, 0] = sub[:, 0]
            mirror_bed = mirror[bed].copy()
            mirror_bed[:, 0] = 1.0
            n = len(sub)
            plain = np.full(n, PLAIN, np.int32)
            volume = np.full(n, dx**dim)
            extra.append(
                GhostSet(sub, node_bed, mirror_bed, plain, np.full(n, -1), np.zeros(n, bool), volume)
            )
    plain = np.full(len(x), PLAIN, np.int32)
    whole = GhostSet(x, node, mirror, plain, np.full(len(x), -1), moves, np.full(len(x), dx**dim))
    whole = GhostSet(*(a[keep] for a in whole))
    return GhostSet(*(np.concatenate(parts) for parts in zip(whole, *extra, strict=True)))


def cut_by_platform(
    ghosts: GhostSet, box: Box, platform: Platform, regions: Regions, dx: float, layers: int
) -> GhostSet:
    """Ghosts of the walls of a tank with a platform at its far end.

    Ghosts beyond the end wall just below the platform's top are also mirrored in the top, and only the water
    above the top sees them. Ghosts below the bed just behind the platform's front are also mirrored in the
    front, and only the water in front of the platform sees them. All other ghosts behind the platform are
    removed.
    """
    x, node, mirror = ghosts.x.copy(), ghosts.node.copy(), ghosts.mirror.copy()
    kind, node_sees = ghosts.kind.copy(), ghosts.node_sees.copy()
    behind = (x[:, 0] > platform.start) & (x[:, -1] < platform.height)
    keep = ~behind
    at_end, at_bed = behind & (x[:, 0] > box.high[0]), behind & (x[:, -1] < box.low[-1])
    for rows, near, axis, face, name in (
        (at_end, x[:, -1] > platform.height - layers * dx, -1, platform.height, "top"),
        (at_bed & ~at_end, x[:, 0] < platform.start + layers * dx, 0, platform.start, "front"),
    ):
        rows = rows & near
        which = regions.sets.index((len(regions.thin), name))
        node[rows, axis] = 2 * face - x[rows, axis]
        # in the corner with the end wall, the platform's top replaces the bed as the other mirror plane
        mirror[rows, axis] = -1.0
        kind[rows], node_sees[rows] = regions.set_kind(which), regions.node_sees(which)
        keep |= rows
    changed = GhostSet(x, node, mirror, kind, node_sees, ghosts.moves, ghosts.volume)
    return GhostSet(*(a[keep] for a in changed))


def platform_ghosts(box: Box, platform: Platform, regions: Regions, dx: float, layers: int) -> GhostSet:
    """Ghosts of a platform, `layers` deep behind each face; only the water in front of a face sees them."""
    depth = layers * dx
    faces = {
        "top": ((platform.start, box.high[0]), (platform.height - depth, platform.height)),
        "front": ((platform.start, platform.start + depth), (box.low[-1], platform.height)),
    }
    parts = []
    for name, ((x0, x1), (z0, z1)) in faces.items():
        x, volume = lattice((x0, z0), (x1, z1), dx)
        axis, face = (-1, platform.height) if name == "top" else (0, platform.start)
        node, mirror, which, n = (
            x.copy(),
            np.ones_like(x),
            regions.sets.index((len(regions.thin), name)),
            len(x),
        )
        node[:, axis] = 2 * face - x[:, axis]
        mirror[:, axis] = -1.0
        kind, sees = np.full(n, regions.set_kind(which), np.int32), np.full(n, regions.node_sees(which))
        parts.append(GhostSet(x, node, mirror, kind, sees, np.zeros(n, bool), volume))
    return GhostSet(*(np.concatenate(a) for a in zip(*parts, strict=True)))


def plate_ghosts(
    box: Box,
    plate: WallPlate,
    wall: AbstractThinWall,
    regions: Regions,
    dx: float,
    layers: int,
) -> GhostSet:
    """Ghosts of a plate, one set behind each face, with the extents from `AbstractThinWall.body`.

    **Raises** ValueError if the plate is too thin for the method `wall`.
    """
    first = len(SETS) * regions.plates.index(plate)
    wall.check(plate, dx, layers)
    top = box.high[-1]
    depth = wall.body(plate, dx, layers)
    rows = plate.tip + (np.arange(round((top - plate.tip) / dx)) + 0.5) * dx
    parts = []
    for which, (across, up) in enumerate(depth):
        # the columns fill the extent, which inside a plate need not be a whole number of spacings
        n_across = max(1, round(across / dx))
        width = across / n_across
        inward = (np.arange(n_across) + 0.5) * width
        xs = plate.x1 - inward if which == 1 else plate.x0 + inward
        zs = rows[rows < plate.tip + up]
        middle = [np.arange(lo + dx / 2, hi, dx) for lo, hi in _inner_axes(box)]
        x = np.stack(np.meshgrid(xs, *middle, zs, indexing="ij"), -1).reshape(-1, len(box.low))
        node = x.copy()
        tangential = 1.0 if which < 2 else wall.tip_tangential(plate, dx, layers)
        mirror = np.full(x.shape, tangential)
        axis = -1 if which == 2 else 0
        face = (plate.x0, plate.x1, plate.tip)[which]
        node[:, axis] = 2 * face - x[:, axis]
        mirror[:, axis] = -1.0
        n = len(x)
        parts.append(
            GhostSet(
                x,
                node,
                mirror,
                np.full(n, regions.set_kind(first + which), np.int32),
                np.full(n, regions.node_sees(first + which)),
                np.zeros(n, bool),
                np.full(n, width * dx ** (len(box.low) - 1)),
            )
        )
    return GhostSet(*(np.concatenate(a) for a in zip(*parts, strict=True)))


def solid_ghosts(
    shape: AbstractShape, regions: Regions, box: Box, others: Sequence[AbstractShape], dx: float, layers: int
) -> GhostSet:
    """Dummy particles of a solid as ghosts, `layers` deep at the spacing dx (m).

    The ghosts have the solid's velocity (mirror factors of 0) and exert no viscous force. Behind each face
    of a plate that divides the water, the ghosts fill the full depth, except inside `others` or outside the
    box.
    """
    parts = [_behind_plate(plate, regions, box, others, dx, layers) for plate in shape.dividers()]
    return join(parts) if parts else _dummies(*shape.dummies(dx, layers), PLAIN, -1)


def _behind_plate(
    plate: LeaningPlate, regions: Regions, box: Box, others: Sequence[AbstractShape], dx: float, layers: int
) -> GhostSet:
    """Dummy particles of a plate as ghosts, one set for each of its faces."""
    held = [_is_held(end, box, others) for end in (plate.foot, plate.head)]
    first, parts = len(SETS) * regions.thin.index(plate), []
    for which in range(len(SETS)):
        x, volume = _behind_face(plate, which, held, dx, layers)
        kept = np.all((x > box.low) & (x < box.high), axis=1)
        for other in others:
            kept &= at_points(other.distance, x) > 0
        kind, sees = regions.set_kind(first + which), regions.node_sees(first + which)
        parts.append(_dummies(x[kept], volume[kept], kind, sees))
    return join(parts)


def _dummies(x: np.ndarray, volume: np.ndarray, kind: int, node_sees: int) -> GhostSet:
    """Ghosts with the velocity of their solid, from positions `x` (m), volumes (m^D) and bits."""
    n = len(x)
    kinds, sees = np.full(n, kind, np.int32), np.full(n, node_sees)
    return GhostSet(x, x, np.zeros_like(x), kinds, sees, np.zeros(n, bool), volume)


def _is_held(end: tuple[float, float], box: Box, others: Sequence[AbstractShape]) -> bool:
    """Whether a plate's end (m) touches or lies in a wall or another solid, so that no water passes there."""
    at = np.asarray(end)
    walls = np.stack([at - box.low, np.asarray(box.high) - at], axis=1)
    if (box.walls & (walls < HELD)).any():
        return True
    return any(at_points(other.distance, at[None])[0] < HELD for other in others)


def _behind_face(
    plate: LeaningPlate, which: int, held: Sequence[bool], dx: float, layers: int
) -> tuple[np.ndarray, np.ndarray]:
    """Positions `[B, 2]` (m) and volumes `[B]` (m2) of dummies behind a plate's face, `SETS[which]`.

    Behind the plate's two sides the dummies extend past every end that is `held`.
    """
    rows = max(1, round(plate.length / dx))
    step = plate.length / rows
    more = [layers if one else 0 for one in held]
    along = (np.arange(-more[0], rows + more[1]) + 0.5) * step
    if which == 2:
        along = along[more[0] : len(along) - more[1]]
        along = along[np.minimum(along, plate.length - along) < layers * dx]
        columns = max(1, round(plate.thickness / dx))
        across = ((np.arange(columns) + 0.5) / columns - 0.5) * plate.thickness
        width = plate.thickness / columns
    else:
        inward, width = (np.arange(layers) + 0.5) * dx - 0.5 * plate.thickness, dx
        across = inward if which == 0 else -inward
    (ex, ez), foot = plate.along, np.asarray(plate.foot)
    a, c = (grid.reshape(-1, 1) for grid in np.meshgrid(along, across, indexing="ij"))
    x = foot + a * np.array([ex, ez]) + c * np.array([ez, -ex])
    return x, np.full(len(x), step * width)


def _inner_axes(box: Box) -> list[tuple[float, float]]:
    return [(box.low[k], box.high[k]) for k in range(1, len(box.low) - 1)]
