"""Vertical section of water with floating or fixed hulls and chambers, for two-dimensional potential flow.

z = 0 is the still water level, and the bed is flat at z = -depth. Waves travel towards +x. Lengths are in m.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

__all__ = ["FREE", "RADIATING", "Chamber", "Edge", "Hull", "Section", "edges"]

FREE = "free surface"
"""Owner of an edge on the free surface outside chambers."""
RADIATING = "radiating end"
"""Owner of the vertical edges through which waves leave the section."""

CLOSE = 1e-7
"""Distance, relative to the depth, below which two points of a section count as the same point."""
REACH = 0.5
"""Distance from the outermost hull or chamber to a radiating end, relative to the depth. Over this distance
the slowest evanescent mode decays by a factor of 0.21 in shallow water and 0.46 in deep water; at the
end the potential is matched to the outgoing wave and `panels.MODES` evanescent modes."""


@dataclass(frozen=True)
class Hull:
    """Body of a section, whose wetted part is a boundary of the water."""

    name: str
    outline: tuple[tuple[float, float], ...]
    """Corners (x, z) of the closed outline in order, m. Parts above the still water, below the bed or behind
    the end wall are cut off."""
    pivot: tuple[float, float] = (0.0, 0.0)
    """Point (x, z) whose motion is the surge and heave, and about which pitch and moments are defined, m."""

    def __post_init__(self) -> None:
        """Makes the corners tuples of floats. **Raises** ValueError for an outline that crosses itself."""
        corners = tuple((float(x), float(z)) for x, z in self.outline)
        object.__setattr__(self, "outline", corners)
        object.__setattr__(self, "pivot", (float(self.pivot[0]), float(self.pivot[1])))
        if len(corners) < 3 or not shapely.Polygon(corners).is_valid:
            raise ValueError(
                f"hull {self.name}: outline must be a polygon with three or more corners and no crossing "
                "sides"
            )


@dataclass(frozen=True)
class Chamber:
    """Stretch of the water surface under air of uniform pressure."""

    name: str
    first: float
    """x at which the stretch begins, m."""
    last: float
    """x at which the stretch ends, m."""
    hull: str = ""
    """Name of the hull that carries the chamber; empty for a chamber at rest. The flow of air of a carried
    chamber is relative to the hull, and the air pressure also acts on the hull's roof and walls."""

    def __post_init__(self) -> None:
        """**Raises** ValueError unless `first` is less than `last`."""
        if not self.first < self.last:
            raise ValueError(
                f"chamber {self.name}: first = {self.first} m must be less than last = {self.last} m"
            )


@dataclass(frozen=True)
class Section:
    """Water over a flat bed, with hulls, chambers, and possibly a vertical end wall on the right."""

    depth: float
    """Still water depth, m."""
    hulls: tuple[Hull, ...] = ()
    end_wall: float | None = None
    """x of the vertical wall that bounds the water on the right, m; by default waves leave on both sides."""
    chambers: tuple[Chamber, ...] = ()

    def __post_init__(self) -> None:
        """**Raises** ValueError for duplicate names, unknown hulls, and lengths that are out of range."""
        object.__setattr__(self, "hulls", tuple(self.hulls))
        object.__setattr__(self, "chambers", tuple(self.chambers))
        if not self.depth > 0.0:
            raise ValueError(f"depth = {self.depth} m must be positive")
        names = [one.name for one in (*self.hulls, *self.chambers)]
        if not names:
            raise ValueError("hulls and chambers are both empty: give at least one hull or chamber")
        if len({*names, FREE, RADIATING}) < len(names) + 2:
            raise ValueError(
                f"names of hulls and chambers must all differ, and must not be {FREE!r} or {RADIATING!r}: "
                f"{', '.join(names)}"
            )
        for one in self.chambers:
            if one.hull and one.hull not in {hull.name for hull in self.hulls}:
                there = ", ".join(hull.name for hull in self.hulls) or "none"
                raise ValueError(f"chamber {one.name}: there is no hull {one.hull!r}; give one of {there}")
            if any(one.last > wall + CLOSE * self.depth for wall in self.walls):
                raise ValueError(
                    f"chamber {one.name}: last = {one.last} m is behind the end wall; use at most "
                    f"{self.end_wall} m"
                )
        for one, other in itertools.pairwise(sorted(self.chambers, key=lambda c: c.first)):
            if other.first < one.last - CLOSE * self.depth:
                raise ValueError(
                    f"chambers {one.name} and {other.name} overlap: {one.name} ends at {one.last} m, so "
                    f"begin {other.name} there or beyond, and not at {other.first} m"
                )

    @property
    def walls(self) -> tuple[float, ...]:
        """x of the end wall, m; empty without an end wall."""
        return (float(self.end_wall),) if isinstance(self.end_wall, int | float) else ()

    @property
    def ends(self) -> tuple[float, float]:
        """x of the left and the right end of the computed part of the water, m."""
        x = [x for hull in self.hulls for x, _ in hull.outline]
        x += [x for one in self.chambers for x in (one.first, one.last)]
        left, right = min(x) - REACH * self.depth, max(x) + REACH * self.depth
        return left, next(iter(self.walls), right)


class Edge(NamedTuple):
    """Straight edge of the water's boundary, with the water on its left."""

    a: NDArray[np.floating]
    """Beginning (x, z), m."""
    b: NDArray[np.floating]
    """End (x, z), m."""
    owner: str
    """Name of the hull or chamber that the edge belongs to, or `FREE` or `RADIATING`."""
    sharp: tuple[bool, bool]
    """Whether the velocity is singular at the beginning and at the end of the edge. It is singular at a hull
    corner whose angle in the water exceeds pi."""
    corner: tuple[bool, bool]
    """Whether the boundary turns, or its condition changes, at the beginning and at the end."""

    @property
    def length(self) -> float:
        """Length, m."""
        return float(np.hypot(*(self.b - self.a)))


TURN = 0.3
"""Turning angle above which two neighbouring edges of a hull form a corner, rad."""


def edges(section: Section) -> list[Edge]:
    """Edges of the water's boundary without the bed and the end wall, which are replaced by mirror images.

    **Raises** ValueError for enclosed water without a free surface, and for a stretch of a chamber
    that is not on the free surface.
    """
    found = []
    for ring in _rings(section):
        corners = _with_chamber_ends(np.asarray(ring.coords)[:-1, :2], section)
        following = np.roll(corners, -1, axis=0)
        owners = [_owner(a, b, section) for a, b in zip(corners, following, strict=True)]
        wedges = [_wedge(corners, index, owners) for index in range(len(corners))]
        sharp = [_is_sharp(wedge, owners, index, section) for index, wedge in enumerate(wedges)]
        corner = [_is_corner(wedge, owners, index) for index, wedge in enumerate(wedges)]
        for index, owner in enumerate(owners):
            end = (index + 1) % len(corners)
            if owner:
                ends = (sharp[index], sharp[end]), (corner[index], corner[end])
                found.append(Edge(corners[index], corners[end], owner, *ends))
    for one in section.chambers:
        wet = sum(edge.length for edge in found if edge.owner == one.name)
        if abs(wet - (one.last - one.first)) > 1e-3 * (one.last - one.first):
            raise ValueError(
                f"chamber {one.name}: only {wet:.4g} m of the {one.last - one.first:.4g} m from "
                f"{one.first:g} to {one.last:g} m are a free surface; move first or last out of the hull"
            )
    return found


def _rings(section: Section) -> list[shapely.LinearRing]:
    """Outlines of the water, with the water on the left of each."""
    left, right = section.ends
    solid = shapely.union_all([shapely.Polygon(hull.outline) for hull in section.hulls])
    whole = shapely.box(left, -section.depth, right, 0.0).difference(solid)
    tiny = CLOSE * section.depth
    rings = []
    for part in getattr(whole, "geoms", [whole]):
        if part.area < 1e-6 * section.depth**2:
            continue
        part = shapely.orient_polygons(shapely.Polygon(part), exterior_cw=False)
        if part.bounds[3] < -tiny:
            raise ValueError("a hull encloses water that has no free surface: fill or open this space")
        rings += [part.exterior, *part.interiors]
    return rings


def _with_chamber_ends(corners: NDArray, section: Section) -> NDArray:
    """Corners without repetitions, and with the ends of chambers on the surface added."""
    tiny = CLOSE * section.depth
    ends = np.array([x for one in section.chambers for x in (one.first, one.last)])
    found = []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if np.hypot(*(b - a)) < tiny:
            continue
        found.append(a)
        if max(abs(a[1]), abs(b[1])) < tiny:
            low, high = sorted((a[0], b[0]))
            inner = np.unique(ends[(ends > low + tiny) & (ends < high - tiny)])
            found += [np.array([x, 0.0]) for x in (inner if b[0] > a[0] else inner[::-1])]
    return np.array(found)


def _owner(a: NDArray, b: NDArray, section: Section) -> str:
    """Name of the hull or chamber of an edge, `FREE` or `RADIATING`; empty for the bed and the end wall."""
    tiny, middle = 10.0 * CLOSE * section.depth, 0.5 * (a + b)
    left, right = section.ends
    if max(abs(a[1]), abs(b[1])) < tiny:
        above = (one.name for one in section.chambers if one.first < middle[0] < one.last)
        return next(above, FREE)
    if max(abs(a[1] + section.depth), abs(b[1] + section.depth)) < tiny:
        return ""
    for x, owner in ((left, RADIATING), (right, "" if section.walls else RADIATING)):
        if max(abs(a[0] - x), abs(b[0] - x)) < tiny:
            return owner
    if len(section.hulls) == 1:
        return section.hulls[0].name
    here = shapely.Point(middle)
    away = {hull.name: shapely.LinearRing(hull.outline).distance(here) for hull in section.hulls}
    return min(away, key=lambda name: away[name])


def _wedge(corners: NDArray, index: int, owners: list[str]) -> float:
    """Angle in the water at a corner, rad; includes the mirror image at the bed or the end wall."""
    before = corners[index - 1] - corners[index]
    after = corners[(index + 1) % len(corners)] - corners[index]
    turn = np.arctan2(before[1], before[0]) - np.arctan2(after[1], after[0])
    angle = float(turn % (2.0 * np.pi))
    return 2.0 * angle if (owners[index - 1] == "") != (owners[index] == "") else angle


def _is_sharp(wedge: float, owners: list[str], index: int, section: Section) -> bool:
    """Whether the velocity is singular at a corner of hulls, or of a hull and its mirror image."""
    solid = {"", *(hull.name for hull in section.hulls)}
    return wedge > np.pi + TURN and {owners[index - 1], owners[index]} <= solid


def _is_corner(wedge: float, owners: list[str], index: int) -> bool:
    """Whether the boundary turns at a corner or its condition changes there; False at a radiating end."""
    both = {owners[index - 1], owners[index]}
    if RADIATING in both:
        return False
    return len(both - {""}) > 1 or abs(wedge - np.pi) > TURN
