"""Chambers of a case: the walls of each chamber, their inner faces, and checks that walls can hold air."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import shapely

from jaxsph.case.air_sections import FAR
from jaxsph.case.shapes import ends_at
from jaxsph.errors import CaseError
from jaxsph.solids.shapes import AbstractShape

MOST_CORNERS = 24
"""Largest number of corners at which a wall's face is sampled. A face with more corners is sampled at this
number of evenly spaced levels instead."""


class Stretch(NamedTuple):
    """Stretch of the still water surface between a chamber's two walls."""

    given: str
    """Key and value with which a case gives the walls or the body of the chamber, as text for messages."""
    carrier: str
    """Name of the body in whose hollow the chamber is; empty for a chamber between walls at rest."""
    front: np.ndarray
    """Corners `[K, 2]` (x, z) (m) of the front wall's inner face, from bottom to top."""
    back: np.ndarray
    """Corners `[K, 2]` (x, z) (m) of the back wall's inner face, from bottom to top."""
    tip: float
    """Level of the lower end of the wall with the smaller draught, m. Air escapes if the water falls
    below this level."""
    top: float
    """Level of the lower of the two walls' tops, or of the roof of a body's hollow, m."""
    first: float
    """Position x of the front wall's inner face at the still water level, m."""
    last: float
    """Position x of the back wall's inner face at the still water level, m."""

    @property
    def surface(self) -> float:
        """Distance between the walls at the still water level, m: the surface's area per metre of width."""
        return float(np.round(self.last - self.first, 12))

    @property
    def narrowest(self) -> float:
        """Least width of the water surface, m."""
        return self.surface

    @property
    def nearest(self) -> float:
        """Smallest x of the front wall's inner face, m."""
        return float(self.front[:, 0].min())

    @property
    def walls(self) -> tuple[np.ndarray, np.ndarray]:
        """Walls of the chamber, for `Chamber.of`."""
        return self.front, self.back


class Tank(NamedTuple):
    """Size of the tank, and shapes of the solids that may enclose a chamber."""

    shapes: Mapping[str, AbstractShape]
    """Shapes of all solids, by their names in the case (`Geometry.named_shapes`)."""
    bodies: Mapping[str, AbstractShape]
    """Shapes of the bodies, by name."""
    length: float
    """Length of the tank, m."""
    width: float | None
    """Width of the tank, m; None in two dimensions."""
    depth: float
    """Depth of the still water, m."""
    height: float
    """Height of the tank, m."""
    dx: float
    """Spacing of the particles, m."""


class Wall(NamedTuple):
    """One of the two walls of a chamber."""

    name: str
    """Name of the wall in `chamber.NAME.between`."""
    shape: AbstractShape | None
    """Shape of the wall; None for the tank's end wall."""
    tank: Tank

    def ends(self, level: float) -> tuple[float, float] | None:
        """First and last x (m) of the wall at a level (m); None if the wall does not reach this level."""
        if self.shape is None:
            return self.tank.length, self.tank.length
        return ends_at(self.shape, level)

    def heights(self) -> tuple[float, float]:
        """Lowest and highest level (m) of the wall."""
        if self.shape is None:
            return 0.0, self.tank.height
        low, high = self.shape.bounds()
        return float(low[-1]), float(high[-1])

    def face(self, side: int) -> np.ndarray:
        """Corners `[K, 2]` (x, z) (m) of one face of the wall, from bottom to top.

        `side` is 0 for the face at the smaller x, and 1 for the face at the larger x. The face is sampled
        just above and just below every corner, so that both sides of a step are included.
        """
        corners = np.array(self.heights())
        if self.shape is not None:
            corners = np.sort(self.shape.outline()[:, 1])
        if len(corners) > MOST_CORNERS:
            corners = np.linspace(corners[0], corners[-1], MOST_CORNERS)
        beside = 1e-4 * self.tank.dx
        levels = np.sort(np.concatenate([corners[:-1] + beside, corners[1:] - beside]))
        there = ((self.ends(float(z)), z) for z in levels)
        return np.array([(ends[side], z) for ends, z in there if ends is not None])


def stretch_between(key: str, between: tuple[str, str], tank: Tank) -> Stretch:
    """Stretch of the surface between two walls, given by their names in the case.

    **Raises** CaseError, which names the section `key`, if these walls cannot hold air over water.
    """
    asked = f"{key}.between = {list(between)}"
    if between[0] == between[1]:
        raise CaseError(f"{asked}: a chamber needs two different walls")
    placed = sorted((_at_surface(name, asked, tank) for name in between), key=lambda pair: pair[0])
    ((_, first), front), ((last, _), back) = placed
    tip = max(wall.heights()[0] for wall in (front, back))
    top = min(wall.heights()[1] for wall in (front, back))
    found = Stretch(asked, "", front.face(1), back.face(0), tip, top, first, last)
    _check(found, between, tank)
    return found


def stretch_in(key: str, body: str, at: float | None, shape: AbstractShape, tank: Tank) -> Stretch:
    """Stretch of the water surface in a hollow of a body with the given `shape`.

    The hollow is open below and has a roof. `at`: a position x (m) in the hollow, if there are several
    hollows. **Raises** CaseError, which names the section `key`, if the hollow cannot hold air over water.
    """
    asked = f"{key}.body = {body!r}"
    hollows = [one for one in itertools.pairwise(_crossings(shape, tank.depth)[1:-1])][::2]
    if not hollows:
        raise CaseError(
            f"{asked}: the body has no hollow at the still water level, z = {tank.depth:g} m, with a wall on "
            "either side; give the body as a polygon with a hollow that is open below"
        )
    places = ", ".join(f"{a:.4g} to {b:.4g} m" for a, b in hollows)
    found = hollows if at is None else [(a, b) for a, b in hollows if a < at < b]
    if len(found) != 1 and at is None:
        raise CaseError(
            f"{asked}: the body has hollows from x = {places}; give {key}.at, a position x in one of them"
        )
    if len(found) != 1:
        raise CaseError(
            f"{key}.at = {at:g} m is not inside a hollow of the body {body}: give a position x inside "
            f"one of its hollows ({places})"
        )
    ((first, last),) = found
    middle, beside = 0.5 * (first + last), 1e-4 * tank.dx
    corners = np.sort(np.unique(np.concatenate([shape.outline()[:, 1], [tank.depth]])))
    front, back = [], []
    tip, top = -np.inf, np.inf
    for z in np.sort(np.concatenate([corners[:-1] + beside, corners[1:] - beside])):
        crossings = _crossings(shape, float(z))
        left, right = crossings[crossings < middle], crossings[crossings > middle]
        if z < tank.depth and not (len(left) and len(right)):
            tip, front, back = z + beside, [], []
        elif len(left) % 2:  # the roof covers the middle
            if z > tank.depth:
                top = float(z) - beside
                break
            tip, front, back = z + beside, [], []
        elif len(left) and len(right):
            front.append((left[-1], z))
            back.append((right[0], z))
    if not np.isfinite(top):
        raise CaseError(
            f"{asked}: the hollow from x = {first:.4g} to {last:.4g} m is open at the top; add a roof on "
            "which the air pressure can act"
        )
    tip = float(np.round(max(tip, corners[0]), 9))
    here = Stretch(asked, body, np.array(front), np.array(back), tip, top, first, last)
    _check(here, (body,), tank)
    return here


def _crossings(shape: AbstractShape, level: float) -> np.ndarray:
    """Positions x (m), in ascending order, at which the outline of a shape crosses a level (m)."""
    low, high = shape.bounds()
    across = shapely.LineString([(low[0] - 1.0, level), (high[0] + 1.0, level)])
    parts = shapely.get_parts(shape.region().intersection(across))
    return np.sort(np.concatenate([[], *(part.xy[0] for part in parts if part.length > 0.0)]))


def _at_surface(name: str, asked: str, tank: Tank) -> tuple[tuple[float, float], Wall]:
    """First and last x (m) of the wall `name` at the still water level, and the wall."""
    wall = Wall(name, _shape_named(name, asked, tank), tank)
    ends = wall.ends(tank.depth)
    if ends is None:
        raise CaseError(
            f"{asked}: {name} does not pierce the still water surface at z = {tank.depth:g} m and cannot "
            "hold air; extend the wall, or choose another wall"
        )
    return ends, wall


def _shape_named(name: str, asked: str, tank: Tank) -> AbstractShape | None:
    """Shape of the wall `name` of a case; None for the tank's end wall."""
    if name == FAR:
        return None
    for called in (f"solid.{name}", name):
        if called in tank.shapes and called.startswith(("solid.", "device")):  # moving bodies are excluded
            return tank.shapes[called]
    solids = [called.removeprefix("solid.") for called in tank.shapes if called.startswith("solid.")]
    allowed = ", ".join([*solids, *(["device"] if "device" in tank.shapes else []), FAR])
    raise CaseError(f"{asked}: there is no wall {name!r}; choose from {allowed}")


def _check(stretch: Stretch, walls: tuple[str, ...], tank: Tank) -> None:
    """**Raises** CaseError if a chamber is too small for the spacing, or if a solid other than the `walls`
    pierces the surface in the chamber.
    """
    asked, first, last = stretch.given, stretch.first, stretch.last
    if last - first < 3.0 * tank.dx:
        raise CaseError(
            f"{asked}: the chamber is {max(last - first, 0.0):.4g} m long at the still water level, and must "
            f"be at least three spacings of dx = {tank.dx:g} m long"
        )
    if stretch.tip > tank.depth - 2.0 * tank.dx:
        raise CaseError(
            f"{asked}: the chamber's lower edge is at z = {stretch.tip:.4g} m, and must be at least two "
            f"spacings below still water at z = {tank.depth:g} m"
        )
    for called, shape in tank.shapes.items():
        if called.removeprefix("solid.").removeprefix("bodies.") in walls:
            continue
        found = ends_at(shape, tank.depth)
        if found is not None and found[0] < last - 1e-9 and found[1] > first + 1e-9:
            other = "" if stretch.carrier else ", or choose two walls next to each other"
            raise CaseError(
                f"{asked}: {called} pierces the surface in the chamber, from x = {found[0]:.4g} to "
                f"{found[1]:.4g} m; move {called} out of the chamber{other}"
            )


def check_apart_chambers(stretches: Mapping[str, Stretch]) -> None:
    """**Raises** CaseError if two chambers overlap."""
    placed = sorted(stretches.items(), key=lambda pair: pair[1].first)
    for (a, one), (b, other) in itertools.pairwise(placed):
        if other.first < one.last - 1e-9:
            raise CaseError(
                f"chamber.{a} and chamber.{b} both cover the surface from x = {other.first:.4g} to "
                f"{min(one.last, other.last):.4g} m: change between, body or at of one of the two chambers"
            )
