"""Solid walls: fixed ghost particles with interpolation nodes, and the regional sets of thin walls.

A ghost stands in the wall; its node is its mirror image in the water. Each step the water's pressure and
velocity are interpolated at the nodes and carried to the ghosts (Zhu et al. 2020, Eq. 18-20), which are
from then on ordinary sources of the pair sums. Around a wall thinner than the kernel the water is divided
into regions that see different ghosts and not each other (their section 2.4.1). Which region sees which
set is a static matrix of booleans, packed into bit masks that the neighbour search applies.
"""

from __future__ import annotations

import abc
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial import cKDTree

from jaxsph import laws
from jaxsph._typing import Array, Components, Float, Int, Scalar, columns, dot, stacked
from jaxsph.pairs import (
    Pair,
    Period,
    Smoothing,
    outer_upper,
    pair_sum,
    pair_weights,
    symmetric_inverse,
    symmetric_product,
)
from jaxsph.shapes import AbstractShape

__all__ = [
    "AbstractDivision",
    "AbstractThinWall",
    "AbstractFilling",
    "Box",
    "DiagonalDivision",
    "DummyParticles",
    "FivePartDivision",
    "FreeSlip",
    "Ghosts",
    "HorizontalDivision",
    "MirrorNodes",
    "MultiNodeGhosts",
    "NoSlip",
    "NodeFit",
    "Platform",
    "Regions",
    "RegionalGhosts",
    "WallPlate",
    "lattice",
    "spring",
    "wall_normals",
]

PLAIN = 1 << 16
"""Kind bit of an ordinary wall's ghosts: every region sees them."""


# --------------------------------------------------------------------------- what a wall does to u


class FreeSlip(eqx.Module):
    """The tangential velocity is carried to the ghost as it is."""

    tangential: float = eqx.field(static=True, default=1.0)


class NoSlip(eqx.Module):
    """The tangential velocity is reversed, so that it vanishes at the wall."""

    tangential: float = eqx.field(static=True, default=-1.0)


# --------------------------------------------------------------------------- regions of a thin wall


@dataclass(frozen=True)
class WallPlate:
    """A vertical plate that pierces the surface: x0 <= x <= x1, from its tip upwards (m)."""

    x0: float
    x1: float
    tip: float

    @property
    def thickness(self) -> float:
        """Plate thickness, m."""
        return self.x1 - self.x0

    @property
    def middle(self) -> float:
        """x half-way between the faces, m."""
        return 0.5 * (self.x0 + self.x1)

    def is_thin(self, dx: float, layers: int) -> bool:
        """Whether the kernel, of so many layers, reaches through it: it needs what a thin wall needs."""
        return self.thickness <= layers * dx


@dataclass(frozen=True)
class Platform:
    """A raised bed: solid for x >= start and z <= height (m), to the end of the tank."""

    start: float
    height: float

    def in_front(self, x: Components) -> jax.Array:
        """True for what is beside its front rather than above its top: particles pressed a little into it
        stay under the ghosts of the face that they entered."""
        below = self.height - x[-1]
        return (below > 0) & (x[0] - self.start < below)


PLATFORM_SETS = ("top", "front")
"""Ghost sets of a platform, one per face."""
SETS = ("left", "right", "tip")
"""Ghost sets of a thin wall, one per face."""


class AbstractDivision(eqx.Module):
    """A division of the water around a plate into regions (section 2.4.1.2; the figure is missing from
    the recovered text, so each reading is stated).

    `region` gives a particle's region; the matrices say which regions see each other, which ghost sets a
    region sees, and which regions the interpolation nodes of a set may use.
    """

    regions: eqx.AbstractClassVar[tuple[str, ...]]
    water: eqx.AbstractClassVar[tuple[str, ...]]
    """For every region, the regions it sees."""
    ghosts: eqx.AbstractClassVar[tuple[str, ...]]
    """For every region, the set it sees."""
    nodes: eqx.AbstractClassVar[tuple[tuple[str, ...], ...]]
    """For every set of `SETS`, the regions its nodes use."""

    @abc.abstractmethod
    def region(self, x: Components, plate: WallPlate) -> Int[Array, " N"]:
        """Index into `regions`."""

    def water_mask(self) -> np.ndarray:
        """Regions x regions: True where two particles may interact. Symmetric."""
        return np.array([[b in seen.split() for b in self.regions] for seen in self.water])

    def ghost_mask(self) -> np.ndarray:
        """Regions x sets: True where a particle sees a ghost."""
        return np.array([[s == seen for s in SETS] for seen in self.ghosts])

    def node_mask(self) -> np.ndarray:
        """Sets x regions: True where a node uses a particle."""
        return np.array([[r in used for r in self.regions] for used in self.nodes])


class HorizontalDivision(AbstractDivision):
    """(b), the default: left and right of the plate above its tip; all water below the tip is one region."""

    regions: ClassVar[tuple[str, ...]] = ("left", "right", "below")
    water: ClassVar[tuple[str, ...]] = ("left below", "right below", "left right below")
    ghosts: ClassVar[tuple[str, ...]] = ("left", "right", "tip")
    nodes: ClassVar[tuple[tuple[str, ...], ...]] = (("left",), ("right",), ("below",))

    def region(self, x, plate):
        """See `AbstractDivision`."""
        side = jnp.where(x[0] < plate.middle, 0, 1)
        # A particle pressed a little into the tip stays under the tip's ghosts, which push it out.
        under = (x[0] > plate.x0) & (x[0] < plate.x1) & (x[-1] < plate.tip + plate.thickness)
        return jnp.where(under | (x[-1] < plate.tip), 2, side).astype(jnp.int32)


class DiagonalDivision(AbstractDivision):
    """(a): the region below is the wedge between the bisectors of the tip's two corners."""

    regions: ClassVar[tuple[str, ...]] = ("left", "right", "below")
    water: ClassVar[tuple[str, ...]] = ("left below", "right below", "left right below")
    ghosts: ClassVar[tuple[str, ...]] = ("left", "right", "tip")
    nodes: ClassVar[tuple[tuple[str, ...], ...]] = (("left",), ("right",), ("below",))

    def region(self, x, plate):
        """See `AbstractDivision`."""
        beside = jnp.abs(x[0] - plate.middle) - 0.5 * plate.thickness
        side = jnp.where(x[0] < plate.middle, 0, 1)
        return jnp.where(beside < plate.tip - x[-1], 2, side).astype(jnp.int32)


class FivePartDivision(AbstractDivision):
    """(c): above the tip left and right; below it left, right, and the narrow strip under the plate."""

    regions: ClassVar[tuple[str, ...]] = ("left", "right", "below", "below_left", "below_right")
    water: ClassVar[tuple[str, ...]] = (
        "left below below_left",
        "right below below_right",
        "left right below below_left below_right",
        "left below below_left below_right",
        "right below below_left below_right",
    )
    ghosts: ClassVar[tuple[str, ...]] = ("left", "right", "tip", "left", "right")
    nodes: ClassVar[tuple[tuple[str, ...], ...]] = (("left",), ("right",), ("below",))

    def region(self, x, plate):
        """See `AbstractDivision`."""
        above = jnp.where(x[0] < plate.middle, 0, 1)
        below = jnp.where(x[0] < plate.x0, 3, jnp.where(x[0] > plate.x1, 4, 2))
        return jnp.where(x[-1] < plate.tip, below, above).astype(jnp.int32)


class Regions(eqx.Module):
    """Who sees whom, as static tables of bits.

    The division's regions (one without a plate), twice where there is a platform: above its top, then in
    front of it. Across the platform's edge the water sees itself as it would without; only the ghosts of
    the two faces are seen from their own side alone.
    """

    plate: WallPlate | None = eqx.field(static=True)
    division: AbstractDivision | None
    platform: Platform | None = eqx.field(static=True, default=None)

    @property
    def _around_plate(self) -> int:
        return 1 if self.plate is None else len(self.division.regions)

    @property
    def count(self) -> int:
        """Number of regions."""
        return self._around_plate * (1 if self.platform is None else 2)

    @property
    def sets(self) -> tuple[str, ...]:
        """Ghost sets beside the plain ones, in the order of their bits."""
        return (() if self.plate is None else SETS) + (() if self.platform is None else PLATFORM_SETS)

    def index(self, x: Float[Array, "N D"]) -> Int[Array, " N"]:
        """Region of every particle."""
        region = jnp.zeros(x.shape[0], jnp.int32)
        if self.plate is not None:
            region = self.division.region(columns(x), self.plate)
        if self.platform is not None:
            region = region + self._around_plate * self.platform.in_front(columns(x)).astype(jnp.int32)
        return region

    def kind(self, region: Int[Array, " N"]) -> Int[Array, " N"]:
        """Kind bit of particles."""
        return jnp.left_shift(jnp.int32(1), region)

    def sees(self, region: Int[Array, " N"]) -> Int[Array, " N"]:
        """Bits of the particles and ghosts that a particle sees."""
        return jnp.asarray(self._packed())[region]

    def _packed(self) -> np.ndarray:
        water, ghosts = np.ones((1, 1), bool), np.zeros((1, 0), bool)
        if self.plate is not None:
            water, ghosts = self.division.water_mask(), self.division.ghost_mask()
        if self.platform is not None:
            faces = np.repeat(np.eye(2, dtype=bool), len(water), axis=0)
            water, ghosts = np.tile(water, (2, 2)), np.hstack([np.tile(ghosts, (2, 1)), faces])
        bits = np.concatenate([water, ghosts], axis=1)
        return (bits @ (1 << np.arange(bits.shape[1])) | PLAIN).astype(np.int32)

    def set_kind(self, which: int) -> int:
        """Kind bit of a ghost set, by its place in `sets`."""
        return 1 << (self.count + which)

    def node_sees(self, which: int) -> int:
        """Bits of the particles that the nodes of a set use."""
        regions = np.arange(self.count)
        name = self.sets[which]
        if name in PLATFORM_SETS:
            used = regions // self._around_plate == PLATFORM_SETS.index(name)
        else:
            used = self.division.node_mask()[which][regions % self._around_plate]
        return int(used @ (1 << regions))


class AbstractThinWall(eqx.Module):
    """How the ghosts of a plate are placed."""

    division: eqx.AbstractVar[AbstractDivision]

    @abc.abstractmethod
    def check(self, plate: WallPlate, dx: float, layers: int) -> None:
        """Raises ValueError where the plate is too thin for this method at this spacing."""

    @abc.abstractmethod
    def body(self, plate: WallPlate, dx: float, layers: int) -> tuple[tuple[float, float], ...]:
        """For each of `SETS`, the extent (m) that its ghosts fill behind their face."""

    def tip_tangential(self, plate: WallPlate, dx: float, layers: int) -> float:
        """Factor of the tangential velocity that the tip's ghosts carry."""
        return 1.0


class RegionalGhosts(AbstractThinWall):
    """Each face has its own full depth of ghosts, which may stand in the plate, in the water behind it
    and over each other: only their own region sees them, so the plate may be half a spacing thin."""

    division: AbstractDivision = HorizontalDivision()

    def check(self, plate, dx, layers):
        """See `AbstractThinWall`."""
        if plate.thickness < 0.45 * dx:
            raise ValueError(
                f"wall_thickness = {plate.thickness:g} m is less than half a spacing (dx = {dx:g} m): "
                "the particles under the tip would not see it; use dx of at most "
                f"{2 * plate.thickness:g} m"
            )

    def body(self, plate, dx, layers):
        """See `AbstractThinWall`."""
        depth = layers * dx
        return ((depth, np.inf), (depth, np.inf), (plate.thickness, depth))

    def tip_tangential(self, plate, dx, layers):
        """See `AbstractThinWall`."""
        if not plate.is_thin(dx, layers):
            return 1.0
        # Carried along, the tip's few ghosts would stream out of the plate's own sides: a spurious flow
        # that made 0.2 J/m a period in the OWC at dx = 0.02 m, four times what is left without it.
        return 0.0


class MultiNodeGhosts(AbstractThinWall):
    """Ghosts only inside the plate, each with a node per face (Meringolo et al. 2015): the plate needs
    as many layers as the kernel reaches."""

    division: AbstractDivision = HorizontalDivision()

    def check(self, plate, dx, layers):
        """See `AbstractThinWall`."""
        needed = layers - 1
        if plate.thickness < (needed - 0.01) * dx:
            raise ValueError(
                f"wall_thickness = {plate.thickness:g} m holds {plate.thickness / dx:.1f} layers of "
                f"ghosts at dx = {dx:g} m; multi-node ghosts need {needed}: use dx of at most "
                f"{plate.thickness / needed:.4g} m, or regional ghosts"
            )

    def body(self, plate, dx, layers):
        """See `AbstractThinWall`."""
        return ((plate.thickness, np.inf), (plate.thickness, np.inf), (plate.thickness, layers * dx))


# --------------------------------------------------------------------------- ghosts on the host


SIDES = {
    "walls": (True, True),
    "floor": (True, False),
    "lid": (False, True),
    "open": (False, False),
    "periodic": (False, False),
}
"""What may bound an axis, and whether that is a wall at its low and at its high end."""


@dataclass(frozen=True)
class Box:
    """The domain, low <= x <= high (m), and what bounds it along each axis.

    **Raises** ValueError for a side that there is not, or an empty extent.
    """

    low: tuple[float, ...]
    high: tuple[float, ...]
    paddle: bool = False
    """Whether the first axis' low wall moves."""
    stroke: float = 0.0
    """Largest displacement of the paddle towards negative x, m: the bed reaches that far."""
    sides: tuple[str, ...] = ()
    """One of `SIDES` for every axis; by default a tank's: walls, and along the last axis a floor. Where there
    is no wall the box only says how far the fluid may go."""

    def __post_init__(self) -> None:
        """Fills in the default sides and checks them."""
        if not self.sides:
            object.__setattr__(self, "sides", ("walls",) * (len(self.low) - 1) + ("floor",))
        wrong = [side for side in self.sides if side not in SIDES]
        if wrong or len(self.sides) != len(self.low):
            raise ValueError(f"sides = {self.sides}: one of {', '.join(SIDES)} for every axis")
        if not all(a < b for a, b in zip(self.low, self.high, strict=True)):
            raise ValueError(f"low = {self.low} must be below high = {self.high} along every axis")

    @property
    def walls(self) -> np.ndarray:
        """`[D, 2]`, True where there is a wall at the low and the high end of an axis."""
        return np.array([SIDES[side] for side in self.sides])

    @property
    def period(self) -> Period:
        """Length of every periodic axis, None for the others; None where there is none."""
        found = tuple(
            float(b - a) if side == "periodic" else None
            for a, b, side in zip(self.low, self.high, self.sides, strict=True)
        )
        return found if any(found) else None


def lattice(
    low: tuple[float, ...],
    high: tuple[float, ...],
    dx: float,
    plate: WallPlate | None = None,
    platform: Platform | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Positions `[N, D]` (m) and volumes `[N]` (m^D) of particles that fill a box around a plate and over a
    platform.

    The box is a whole number of spacings, and so are the level of the plate's tip and the platform's lengths.
    The plate's faces need not be: beside it the columns of either side are stretched to fill that side, below
    it they are not.
    """
    axes = [a + (np.arange(round((b - a) / dx)) + 0.5) * dx for a, b in zip(low, high, strict=True)]

    def filled(columns: np.ndarray, rows: np.ndarray, width: float) -> tuple[np.ndarray, np.ndarray]:
        x = np.stack(np.meshgrid(columns, *axes[1:-1], rows, indexing="ij"), -1).reshape(-1, len(low))
        return x, np.full(len(x), width * dx ** (len(low) - 1))

    parts = [filled(axes[0], axes[-1], dx)]
    if plate is not None:
        above = axes[-1] > plate.tip
        parts = [filled(axes[0], axes[-1][~above], dx)]
        for start, end in ((low[0], plate.x0), (plate.x1, high[0])):
            count = max(1, int(np.floor((end - start) / dx + 0.5 + 1e-9)))
            width = (end - start) / count
            parts.append(filled(start + (np.arange(count) + 0.5) * width, axes[-1][above], width))
    x, volume = (np.concatenate(part) for part in zip(*parts, strict=True))
    if platform is not None:
        wet = (x[:, 0] < platform.start) | (x[:, -1] > platform.height)
        x, volume = x[wet], volume[wet]
    if plate is None:
        return x, volume
    order = np.lexsort((x[:, -1], x[:, 0]))
    return x[order], volume[order]


class _Lattice(NamedTuple):
    x: np.ndarray
    node: np.ndarray
    mirror: np.ndarray
    kind: np.ndarray
    node_sees: np.ndarray
    moves: np.ndarray
    volume: np.ndarray


def _sliding(
    x: np.ndarray, box: Box, sliding: Mapping[tuple[int, int], Sequence[float]] | None
) -> np.ndarray | None:
    """Velocity of the wall that each ghost is behind, m/s."""
    if not sliding:
        return None
    u = np.zeros_like(x)
    for (axis, end), velocity in sliding.items():
        if not box.walls[axis, end]:
            raise ValueError(f"sliding: there is no wall at end {end} of axis {axis} ({box.sides[axis]})")
        if velocity[axis]:
            raise ValueError(f"sliding: wall {end} of axis {axis} may only move along itself, not {velocity}")
        behind = x[:, axis] > box.high[axis] if end else x[:, axis] < box.low[axis]
        u[behind] += np.asarray(velocity, float)
    return u


def _box_ghosts(box: Box, dx: float, layers: int) -> _Lattice:
    """Ghosts on the lattice outside the box; a corner's are mirrored in every wall they are behind."""
    dim = len(box.low)
    low, high = np.array(box.low), np.array(box.high)
    behind = int(np.ceil(box.stroke / dx)) if box.paddle else 0
    axes = []
    for axis in range(dim):
        count = int(round((high[axis] - low[axis]) / dx))
        floor, lid = box.walls[axis]
        first = -layers - (behind if axis == 0 else 0) if floor else 0
        last = count + (layers if lid else 0)
        axes.append(low[axis] + (np.arange(first, last) + 0.5) * dx)
    x = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, dim)
    under, over = x < low, x > high
    outside = (under | over).any(axis=1)
    # the paddle carries its own corner; the bed goes on behind it for as far as it may withdraw
    x, under, over = x[outside], under[outside], over[outside]
    node = np.where(under, 2 * low - x, np.where(over, 2 * high - x, x))
    normal = under | over
    mirror = np.where(normal, -1.0, 1.0)
    moves = np.zeros(len(x), bool)
    keep = np.ones(len(x), bool)
    extra: list[_Lattice] = []
    if box.paddle:
        at_paddle = under[:, 0]
        others = normal[:, 1:].any(axis=1)
        near = x[:, 0] > low[0] - layers * dx
        moves = at_paddle & near
        keep = ~at_paddle | near
        # bed (and side walls) under the withdrawn paddle: mirrored in the bed alone
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
                _Lattice(sub, node_bed, mirror_bed, plain, np.full(n, -1), np.zeros(n, bool), volume)
            )
    plain = np.full(len(x), PLAIN, np.int32)
    whole = _Lattice(x, node, mirror, plain, np.full(len(x), -1), moves, np.full(len(x), dx**dim))
    whole = _Lattice(*(a[keep] for a in whole))
    return _Lattice(*(np.concatenate(parts) for parts in zip(whole, *extra, strict=True)))


def _above_platform(
    ghosts: _Lattice, box: Box, platform: Platform, regions: Regions, dx: float, layers: int
) -> _Lattice:
    """The box's ghosts where a platform fills its end: those in the two inner corners of the platform are
    mirrored in its faces too and seen from one side, and what else is behind it is left out."""
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
        which = regions.sets.index(name)
        node[rows, axis] = 2 * face - x[rows, axis]
        # in the end's corner the bed was the other mirror, and is no longer there
        mirror[rows, axis] = -1.0
        kind[rows], node_sees[rows] = regions.set_kind(which), regions.node_sees(which)
        keep |= rows
    changed = _Lattice(x, node, mirror, kind, node_sees, ghosts.moves, ghosts.volume)
    return _Lattice(*(a[keep] for a in changed))


def _platform_ghosts(box: Box, platform: Platform, regions: Regions, dx: float, layers: int) -> _Lattice:
    """Behind each face its own full depth of ghosts, which the other face's water does not see."""
    depth = layers * dx
    faces = {
        "top": ((platform.start, box.high[0]), (platform.height - depth, platform.height)),
        "front": ((platform.start, platform.start + depth), (box.low[-1], platform.height)),
    }
    parts = []
    for name, ((x0, x1), (z0, z1)) in faces.items():
        x, volume = lattice((x0, z0), (x1, z1), dx)
        axis, face = (-1, platform.height) if name == "top" else (0, platform.start)
        node, mirror, which, n = x.copy(), np.ones_like(x), regions.sets.index(name), len(x)
        node[:, axis] = 2 * face - x[:, axis]
        mirror[:, axis] = -1.0
        kind, sees = np.full(n, regions.set_kind(which), np.int32), np.full(n, regions.node_sees(which))
        parts.append(_Lattice(x, node, mirror, kind, sees, np.zeros(n, bool), volume))
    return _Lattice(*(np.concatenate(a) for a in zip(*parts, strict=True)))


def _plate_ghosts(
    box: Box,
    plate: WallPlate,
    wall: AbstractThinWall,
    regions: Regions,
    dx: float,
    layers: int,
) -> _Lattice:
    wall.check(plate, dx, layers)
    top = box.high[-1]
    depth = wall.body(plate, dx, layers)
    rows = plate.tip + (np.arange(int(round((top - plate.tip) / dx))) + 0.5) * dx
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
            _Lattice(
                x,
                node,
                mirror,
                np.full(n, regions.set_kind(which), np.int32),
                np.full(n, regions.node_sees(which)),
                np.zeros(n, bool),
                np.full(n, width * dx ** (len(box.low) - 1)),
            )
        )
    return _Lattice(*(np.concatenate(a) for a in zip(*parts, strict=True)))


def _solid_ghosts(x: np.ndarray, dx: float) -> _Lattice:
    """Dummies of a solid: they carry its own velocity, and nothing for a viscous force to hold on to."""
    n = len(x)
    plain = np.full(n, PLAIN, np.int32)
    volume = np.full(n, dx ** x.shape[1])
    return _Lattice(x, x, np.zeros_like(x), plain, np.full(n, -1), np.zeros(n, bool), volume)


def _inner_axes(box: Box) -> list[tuple[float, float]]:
    return [(box.low[k], box.high[k]) for k in range(1, len(box.low) - 1)]


def _fill(points: np.ndarray, water: np.ndarray, volume: np.ndarray, h: float, reach: float) -> np.ndarray:
    """sum V W at points for a tank full of water to the brim (Gaussian weights are near enough)."""
    dim = points.shape[1]
    tree = cKDTree(water)
    norm = 1.0 / (np.pi ** (dim / 2) * h**dim)
    total = np.empty(len(points))
    for i, near in enumerate(tree.query_ball_point(points, reach * h)):
        r2 = ((water[near] - points[i]) ** 2).sum(axis=1)
        total[i] = norm * (volume[near] * np.exp(-r2 / h**2)).sum()
    return total


# --------------------------------------------------------------------------- ghosts in the loop


class NodeFit(NamedTuple):
    """Weights of an interpolation that is exact for linear fields: sum_j w_j (a + b.r_j) f_j."""

    a: Float[Array, " G"]
    b: Components
    offset: Components
    """Weighted mean of x_j - x_node that is left, m: zero except where too little water is near."""
    wet: Float[Array, " G"]
    """1 where the node is in water, 0 where it is dry, smooth between."""


class AbstractFilling(eqx.Module):
    """From where in the water a ghost takes its pressure and velocity, and how."""

    least: eqx.AbstractClassVar[float]
    """Least that a node counts as full, of sum V W."""

    @abc.abstractmethod
    def nodes(self, ghosts: np.ndarray, mirrored: np.ndarray) -> np.ndarray:
        """Interpolation nodes `[G, D]` (m) of ghosts whose mirror images are these."""

    @abc.abstractmethod
    def fit(
        self,
        nodes: Float[Array, "G D"],
        full: Float[Array, " G"],
        water: dict,
        smoothing: Smoothing,
        table: Int[Array, "K G"],
    ) -> NodeFit:
        """Interpolation weights at the nodes; `full`: sum V W there were the tank full."""


class MirrorNodes(AbstractFilling):
    """From its mirror image in the water (Zhu et al. 2020, section 2.3), exact for linear fields where enough
    water is near.

    Moving least squares of first order in the place of Eq. 18's Shepard sum, which is wrong by a
    slope times the offset of the weighted centre wherever the kernel is cut: at corners, the tip
    and the surface. Where the second moments are too flat for a slope, Shepard's sum is left.
    """

    least: ClassVar[float] = 0.05

    def nodes(self, ghosts, mirrored):
        """See `AbstractFilling`."""
        return mirrored

    def fit(self, nodes, full, water, smoothing, table):
        """See `AbstractFilling`."""
        dim = nodes.shape[1]
        h = smoothing.h

        def moments(pair: Pair, i, j):
            w = laws.volume(j) * pair.W
            r = tuple(-c / h for c in pair.r)  # from the node to the particle
            return w, tuple(w * c for c in r), outer_upper(r, tuple(w * c for c in r))

        zeroth, first, second = pair_sum(moments, smoothing, {"x": columns(nodes)}, water, table)
        norm = 1.0 / jnp.maximum(zeroth, 1e-6)
        mean = tuple(c * norm for c in first)
        product = outer_upper(mean, mean)
        covariance = tuple(s * norm - p for s, p in zip(second, product, strict=True))
        determinant, inverse = _flat_inverse(covariance)
        ratio = zeroth / full
        # A fully supported Gaussian has covariance 1/2 per axis; below a tenth of that volume, or for a
        # node farther from its water than that water is wide, a slope would be extrapolated from noise.
        slope = symmetric_product(inverse, mean)
        sound = (determinant > 0.1 * 0.5**dim) & (dot(slope, mean) < 1.5) & (ratio > 0.5)
        a = norm * (1.0 + jnp.where(sound, dot(slope, mean), 0.0))
        b = tuple(-norm * jnp.where(sound, c, 0.0) for c in slope)
        offset = tuple(jnp.where(sound, 0.0, c * h) for c in mean)
        wet = jnp.clip((ratio - 0.3) / 0.4, 0.0, 1.0)
        return NodeFit(a, b, offset, wet)


class DummyParticles(AbstractFilling):
    """From the water that its own kernel reaches, by Shepard's sum; what that water is away from it makes the
    hydrostatic part of its pressure (Yeylaghi et al. 2016, Eq. 22; Adami et al. 2012).

    It needs no mirror image, so solids of any shape may have it, and move.
    """

    least: ClassVar[float] = 1.0e-3

    def nodes(self, ghosts, mirrored):
        """See `AbstractFilling`."""
        return ghosts

    def fit(self, nodes, full, water, smoothing, table):
        """See `AbstractFilling`."""
        h = smoothing.h

        def moments(pair: Pair, i, j):
            w = laws.volume(j) * pair.W
            return w, tuple(-w * c / h for c in pair.r)

        zeroth, first = pair_sum(moments, smoothing, {"x": columns(nodes)}, water, table)
        # far below what a single particle at the kernel's edge gives
        norm = 1.0 / jnp.maximum(zeroth, 1e-6)
        wet = jnp.clip((zeroth / full - 0.05) / 0.2, 0.0, 1.0)
        none = tuple(jnp.zeros_like(norm) for _ in first)
        return NodeFit(norm, none, tuple(c * norm * h for c in first), wet)


class Ghosts(eqx.Module):
    """Ghost particles of all walls, their nodes, and how to fill them.

    Leaves are static in the sense of never evolving: positions at rest, masks, mirror factors. A moving
    paddle shifts its ghosts and nodes by its displacement (`moved`).
    """

    x: Float[Array, "G D"]
    node: Float[Array, "G D"]
    mirror: Float[Array, "G D"]
    """-1 for components normal to the wall, 1 for tangential ones (0 at a thin wall's tip)."""
    shear: Float[Array, "G D"]
    """The same with the slip factor for tangential components: what the viscous force sees."""
    moves: Float[Array, " G"]
    """1 for the paddle's ghosts."""
    full: Float[Array, " G"]
    """sum V W at the node were the tank full."""
    volume: Float[Array, " G"]
    """m^D."""
    kind: Int[Array, " G"]
    node_sees: Int[Array, " G"]
    regions: Regions
    paddle: tuple[int, ...] = eqx.field(static=True)
    """First and last index of the paddle's ghosts (they are stored together); () without one."""
    low: tuple[float, ...] = eqx.field(static=True)
    high: tuple[float, ...] = eqx.field(static=True)
    sides: tuple[str, ...] = eqx.field(static=True)
    """What bounds each axis, as in `Box`."""
    sliding: Float[Array, "G D"] | None = None
    """Velocity of walls that move along themselves, m/s."""
    filling: AbstractFilling = MirrorNodes()
    solid: tuple[int, ...] = eqx.field(static=True, default=())
    """First index of a solid's dummies and the one after its last; () without one."""

    @classmethod
    def build(
        cls,
        box: Box,
        dx: float,
        smoothing: Smoothing,
        slip: FreeSlip | NoSlip,
        plate: WallPlate | None = None,
        thin_wall: AbstractThinWall | None = None,
        dtype: np.dtype | type = np.float32,
        sliding: Mapping[tuple[int, int], Sequence[float]] | None = None,
        platform: Platform | None = None,
        filling: AbstractFilling | None = None,
        solid: AbstractShape | None = None,
    ) -> Ghosts:
        """Places the ghosts of a tank and of a plate in it, on the host; none where it has no walls.

        **Arguments**: `sliding`: velocities (m/s) of walls that move along themselves, by (axis, 0 for the
        low or 1 for the high end); only walls without slip drag the fluid with them. `platform`: a raised
        bed at the far end of a two-dimensional tank, its lengths whole numbers of spacings. `filling`: by
        default `MirrorNodes`. `solid`: a solid in the tank, which needs
        `DummyParticles`.
        **Raises** ValueError for a plate too thin for the method chosen, or a wall that cannot slide so.
        """
        reach, h = smoothing.kernel.reach, float(smoothing.h)
        layers = int(np.ceil(reach * h / dx - 0.5))
        regions = Regions(plate, thin_wall.division if plate is not None else None, platform)
        parts = [_box_ghosts(box, dx, layers)]
        if platform is not None:
            if len(box.low) != 2 or not box.walls[0, 1] or not box.walls[-1, 0]:
                raise ValueError("a platform needs a two-dimensional tank with an end wall and a floor")
            parts = [
                _above_platform(parts[0], box, platform, regions, dx, layers),
                _platform_ghosts(box, platform, regions, dx, layers),
            ]
        if plate is not None:
            parts.append(_plate_ghosts(box, plate, thin_wall, regions, dx, layers))
        filling = MirrorNodes() if filling is None else filling
        if solid is not None:
            if not isinstance(filling, DummyParticles):
                raise ValueError("a solid needs walls of DummyParticles: its dummies have no mirror image")
            parts.append(_solid_ghosts(solid.dummies(dx, layers), dx))
        count_solid = 0 if solid is None else len(parts[-1].x)
        ghosts = _Lattice(*(np.concatenate(a) for a in zip(*parts, strict=True)))
        ghosts = ghosts._replace(node=filling.nodes(ghosts.x, ghosts.node))
        in_solid = np.arange(len(ghosts.x)) >= len(ghosts.x) - count_solid
        # the solid's last, the paddle's first, then by column: a gather from neighbours in memory is cheaper
        order = np.lexsort((ghosts.x[:, -1], ghosts.x[:, 0], ~ghosts.moves, in_solid))
        ghosts = _Lattice(*(a[order] for a in ghosts))
        own = np.asarray(regions.index(jnp.asarray(ghosts.node, jnp.float32)))
        water_bits = (1 << regions.count) - 1
        plain = np.asarray(regions.sees(jnp.asarray(own))) & water_bits
        node_sees = np.where(ghosts.node_sees < 0, plain, ghosts.node_sees)

        # full to the brim and a little over it, as over every end without a wall
        beyond = np.where(box.walls.T, 0.0, (2 * layers - 1) * dx)
        under, over = tuple(box.low - beyond[0]), tuple(box.high + beyond[1])
        brim, brim_volume = lattice(under, over, dx, plate, platform)
        if solid is not None:
            outside = np.asarray(solid.distance(jnp.asarray(brim, jnp.float32))) > 0
            brim, brim_volume = brim[outside], brim_volume[outside]
        full = np.zeros(len(ghosts.x))
        brim_kind = np.asarray(regions.kind(regions.index(jnp.asarray(brim, jnp.float32))))
        for mask in np.unique(node_sees):
            of = node_sees == mask
            seen = (brim_kind & mask) != 0
            full[of] = _fill(ghosts.node[of], brim[seen], brim_volume[seen], h, reach)
        count = int(ghosts.moves.sum())
        return cls(
            x=jnp.asarray(ghosts.x, dtype),
            node=jnp.asarray(ghosts.node, dtype),
            mirror=jnp.asarray(ghosts.mirror, dtype),
            # The paddle is free-slip whatever the tank's walls are (section 2.4).
            shear=jnp.asarray(
                np.where(
                    (ghosts.mirror == -1.0) | ghosts.moves[:, None],
                    ghosts.mirror,
                    np.where(in_solid[order, None], 1.0, np.minimum(ghosts.mirror, slip.tangential)),
                ),
                dtype,
            ),
            moves=jnp.asarray(ghosts.moves, dtype),
            full=jnp.asarray(np.maximum(full, filling.least), dtype),
            volume=jnp.asarray(ghosts.volume, dtype),
            kind=jnp.asarray(ghosts.kind, jnp.int32),
            node_sees=jnp.asarray(node_sees, jnp.int32),
            regions=regions,
            paddle=(0, count) if count else (),
            low=box.low,
            high=box.high,
            sides=box.sides,
            sliding=None if sliding is None else jnp.asarray(_sliding(ghosts.x, box, sliding), dtype),
            filling=filling,
            solid=(len(ghosts.x) - count_solid, len(ghosts.x)) if count_solid else (),
        )

    @property
    def period(self) -> Period:
        """As `Box.period`."""
        return Box(self.low, self.high, sides=self.sides).period

    @property
    def width(self) -> float:
        """Of the tank across x and z, m; 1 in two dimensions, where everything is per metre."""
        return float(np.prod([b - a for a, b in zip(self.low[1:-1], self.high[1:-1], strict=True)]))

    @property
    def count(self) -> int:
        """Number of ghosts."""
        return self.x.shape[0]

    def moved(self, displacement: Scalar) -> tuple[Float[Array, "G D"], Float[Array, "G D"]]:
        """Positions of ghosts and nodes with the paddle displaced by so much (m)."""
        shift = jnp.zeros_like(self.x).at[:, 0].set(self.moves * displacement)
        return self.x + shift, self.node + shift

    def push(
        self, x: Float[Array, "N D"], displacement: Scalar, dx: Scalar, c0: Scalar
    ) -> Float[Array, "N D"]:
        """Acceleration (m/s2) of a spring that keeps particles from touching a wall.

        Mirrored pressures do not: a particle that comes near its own image feels less and less of it, and
        in a vortex at the tip some entered the plate, and stayed. The spring starts at 0.4 spacings from
        the face, is conservative, and stops a normal speed of a tenth of c0 (stable at Courant 3).
        """

        def away(gap):
            return spring(gap, dx, c0)

        low = jnp.asarray(self.low, x.dtype).at[0].add(displacement)
        high = jnp.asarray(self.high, x.dtype)
        # where there is no wall the box only says how far the fluid may go
        floor, lid = (jnp.asarray([SIDES[side][end] for side in self.sides], x.dtype) for end in (0, 1))
        push = floor * away(x - low) - lid * away(high - x)
        plate, platform = self.regions.plate, self.regions.platform
        if plate is not None:
            beside = jnp.abs(x[:, 0] - plate.middle) - 0.5 * plate.thickness
            side = jnp.where(x[:, 0] < plate.middle, -1.0, 1.0)
            along, up = _off_edge(beside, plate.tip - x[:, -1], away)
            push = push.at[:, 0].add(side * along).at[:, -1].add(-up)
        if platform is not None:
            along, up = _off_edge(platform.start - x[:, 0], x[:, -1] - platform.height, away)
            push = push.at[:, 0].add(-along).at[:, -1].add(up)
        return push

    def entered(self, x: Float[Array, "N D"], displacement: Scalar, dx: Scalar) -> Array:
        """True for particles that are in a wall, and not by a rounding: on their way out."""
        low = jnp.asarray(self.low, x.dtype).at[0].add(displacement)
        high = jnp.asarray(self.high, x.dtype)
        out = jnp.any((x < low - 0.5 * dx) | (x > high + 0.5 * dx), axis=1)
        plate, platform = self.regions.plate, self.regions.platform
        if plate is not None:
            depth = jnp.minimum(x[:, 0] - plate.x0, plate.x1 - x[:, 0])
            out |= (depth > 0.4 * plate.thickness) & (x[:, -1] > plate.tip + 0.5 * dx)
        if platform is not None:
            out |= jnp.minimum(x[:, 0] - platform.start, platform.height - x[:, -1]) > 0.5 * dx
        return out

    def behind_paddle(self, x: Float[Array, "G D"], displacement: Scalar, dx: Scalar) -> Array:
        """1 for ghosts in front of the paddle's face or part of it, 0 for the bed behind it."""
        if not self.paddle:
            return jnp.ones(self.count, x.dtype)
        front = jnp.clip((x[:, 0] - self.low[0] - displacement) / dx + 0.5, 0.0, 1.0)
        return jnp.maximum(self.moves, front)

    def fit(
        self,
        nodes: Float[Array, "G D"],
        water: dict,
        smoothing: Smoothing,
        table: Int[Array, "K G"],
    ) -> NodeFit:
        """Interpolation weights at the nodes."""
        return self.filling.fit(nodes, self.full, water, smoothing, table)

    def at_nodes(
        self,
        law,
        fit: NodeFit,
        nodes: Float[Array, "G D"],
        water: dict,
        smoothing: Smoothing,
        table: Int[Array, "K G"],
    ):
        """Interpolated values of `law(j)` (a pytree of fields of the water) at the nodes."""

        def weighted(pair: Pair, i, j):
            w = _interpolation_weight(pair, i, j, smoothing.h)
            return jax.tree.map(lambda f: w * f, law(j))

        targets = {"x": columns(nodes), "a": fit.a, "b": fit.b}
        return pair_sum(weighted, smoothing, targets, water, table)

    def node_weights(
        self,
        fit: NodeFit,
        nodes: Float[Array, "G D"],
        water: dict,
        smoothing: Smoothing,
        table: Int[Array, "K G"],
    ) -> Float[Array, "K G"]:
        """The weights of `at_nodes`, zero at dry nodes, for `pairs.weighted_sum`."""

        def law(pair: Pair, i, j):
            return (), i["wet"] * _interpolation_weight(pair, i, j, smoothing.h)

        wet = jnp.where(fit.wet > 0, 1.0, 0.0).astype(fit.wet.dtype)
        targets = {"x": columns(nodes), "a": fit.a, "b": fit.b, "wet": wet}
        return pair_weights(law, smoothing, targets, water, table)[1]

    def pressure(
        self,
        fit: NodeFit,
        at_node: Float[Array, " G"],
        x: Float[Array, "G D"],
        nodes: Float[Array, "G D"],
        body_force: Float[Array, "G D"],
    ) -> Float[Array, " G"]:
        """Eq. 19-20: the node's pressure plus the slope that balances the body force, Pa.

        `body_force` is rho0 (f - a_wall), N/m3.
        """
        reach = tuple(g - n - o for g, n, o in zip(columns(x), columns(nodes), fit.offset, strict=True))
        return at_node + dot(columns(body_force), reach)

    def velocity(
        self, at_node: Components, wall: Components, mirror: Float[Array, "G D"]
    ) -> Float[Array, "G D"]:
        """u_ghost = mirror u_node + (1 - mirror) u_wall, component by component (section 2.4)."""
        return stacked(
            [m * u + (1.0 - m) * w for m, u, w in zip(columns(mirror), at_node, wall, strict=True)]
        )


def spring(gap: jax.Array, dx: Scalar, c0: Scalar) -> jax.Array:
    """Acceleration (m/s2) away from a wall at the distance `gap` (m): see `Ghosts.push`."""
    reach = 0.4 * dx
    return (0.1 * c0 / reach) ** 2 * jnp.maximum(reach - gap, 0.0)


def _interpolation_weight(pair: Pair, i, j, h: Scalar) -> jax.Array:
    r = tuple(-c / h for c in pair.r)
    return laws.volume(j) * pair.W * (i["a"] + dot(i["b"], r))


def _off_edge(beside: jax.Array, beyond: jax.Array, away: Callable) -> tuple[jax.Array, jax.Array]:
    """What `away` (of a gap, m) gives off a solid's outer edge, along both normals: from the distances
    (m) beside one face and beyond the other, negative behind them."""
    corner = (beside > 0) & (beyond > 0)
    distance = jnp.sqrt(jnp.where(corner, beside**2 + beyond**2, 1.0))
    out = away(jnp.where(corner, distance, jnp.maximum(beside, beyond)))
    return (
        out * jnp.where(corner, beside / distance, beside > beyond),
        out * jnp.where(corner, beyond / distance, beside <= beyond),
    )


def _flat_inverse(C: tuple[jax.Array, ...]) -> tuple[jax.Array, tuple[jax.Array, ...]]:
    """Determinant and inverse of covariances of order one half; see `symmetric_inverse`."""
    scaled = tuple(2.0 * c for c in C)
    if len(C) == 3:
        determinant = scaled[0] * scaled[2] - scaled[1] ** 2
        dim = 2
    else:
        xx, xy, xz, yy, yz, zz = scaled
        determinant = xx * (yy * zz - yz * yz) - xy * (xy * zz - xz * yz) + xz * (xy * yz - xz * yy)
        dim = 3
    return determinant * 0.5**dim, tuple(2.0 * c for c in symmetric_inverse(scaled))


def wall_normals(
    ghosts: Float[Array, "G D"], water: dict, smoothing: Smoothing, table: Int[Array, "K G"]
) -> Float[Array, "G D"]:
    """Eq. 21: unit normals from the kernel's gradient over the water, pointing into it."""
    raw = pair_sum(laws.surface_vector, smoothing, {"x": columns(ghosts)}, water, table)
    length = jnp.sqrt(dot(raw, raw) + 1e-20)
    return stacked([c / length for c in raw])
