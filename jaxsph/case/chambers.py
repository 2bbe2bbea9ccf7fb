"""Chambers of a case: the walls that each is between, their inner faces, and whether they hold air."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from jaxsph.case.air_sections import FAR
from jaxsph.case.shapes import ends_at
from jaxsph.errors import CaseError
from jaxsph.solids.shapes import AbstractShape

MOST_CORNERS = 24
"""Corners of a wall's outline above which its face is read at so many even levels instead."""


class Stretch(NamedTuple):
    """Stretch of the still surface between a chamber's two walls."""

    walls: tuple[str, str]
    """Names of the front and the back wall, as of `Geometry.named_shapes`, or `FAR`."""
    front: np.ndarray
    """Corners `[K, 2]` (x, z) (m) of the front wall's inner face, from below upwards."""
    back: np.ndarray
    """Corners of the back wall's inner face."""
    tip: float
    """Level of the shorter wall's lower end, m: below it the air would escape."""
    top: float
    """Level up to which both walls go, m."""
    first: float
    """Inner face of the front wall at still water, m."""
    last: float
    """Inner face of the back wall at still water, m."""

    @property
    def length(self) -> float:
        """Length between the walls at still water, m."""
        return float(np.round(self.last - self.first, 12))


class Tank(NamedTuple):
    """What a chamber's walls stand in."""

    shapes: Mapping[str, AbstractShape]
    """Shapes of all solids, by what a case calls them."""
    length: float
    depth: float
    height: float
    """Lengths of the tank, m."""
    dx: float
    """Spacing of the particles, m."""


class Wall(NamedTuple):
    """One of the two walls of a chamber."""

    name: str
    """Name in `chamber.NAME.between`."""
    shape: AbstractShape | None
    """Its shape; None for the tank's end wall."""
    tank: Tank

    def ends(self, level: float) -> tuple[float, float] | None:
        """First and last x (m) of the wall at a level (m); None where it does not go through it."""
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
        """Corners `[K, 2]` (x, z) (m) of the wall's face, from below upwards.

        The face is that of the last x with the `side` 1, of the first with 0.

        It is read beside every corner of the wall, on both sides of a step.
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
    """Stretch of the surface between two walls by the names that a case has for them.

    **Raises** CaseError, for the section `key`, where these walls hold no air over water.
    """
    asked = f"{key}.between = {list(between)}"
    if between[0] == between[1]:
        raise CaseError(f"{asked}: a chamber is between two walls, and these are one")
    placed = sorted((_at_surface(name, asked, tank) for name in between), key=lambda pair: pair[0])
    ((_, first), front), ((last, _), back) = placed
    if last - first < 3.0 * tank.dx:
        raise CaseError(
            f"{asked}: there are {max(last - first, 0.0):.4g} m of water between them, and three spacings of "
            f"dx = {tank.dx:g} m are the least"
        )
    tip = max(wall.heights()[0] for wall in (front, back))
    top = min(wall.heights()[1] for wall in (front, back))
    if tip > tank.depth - 2.0 * tank.dx:
        raise CaseError(
            f"{asked}: a wall ends at {tip:.4g} m, and must be two spacings under water, which stands at "
            f"{tank.depth:g} m"
        )
    _check_free(asked, (first, last), between, tank)
    return Stretch((front.name, back.name), front.face(1), back.face(0), tip, top, first, last)


def _at_surface(name: str, asked: str, tank: Tank) -> tuple[tuple[float, float], Wall]:
    """Ends (m) at the still surface of the wall that a case calls by this name, and the wall."""
    wall = Wall(name, _shape_named(name, asked, tank), tank)
    ends = wall.ends(tank.depth)
    if ends is None:
        raise CaseError(
            f"{asked}: {name} does not go through the still surface, at {tank.depth:g} m, and holds no air: "
            "make it higher, or take another wall"
        )
    return ends, wall


def _shape_named(name: str, asked: str, tank: Tank) -> AbstractShape | None:
    """Shape of the wall that a case calls by this name; None for the tank's end wall."""
    if name == FAR:
        return None
    for called in (f"solid.{name}", name):
        if called in tank.shapes and called != "body":
            return tank.shapes[called]
    solids = [called.removeprefix("solid.") for called in tank.shapes if called.startswith("solid.")]
    allowed = ", ".join([*solids, *(["device"] if "device" in tank.shapes else []), FAR])
    raise CaseError(f"{asked}: there is no wall {name!r}; there are {allowed}")


def _check_free(asked: str, ends: tuple[float, float], walls: tuple[str, str], tank: Tank) -> None:
    """**Raises** CaseError where another solid is at the surface between a chamber's walls."""
    for called, shape in tank.shapes.items():
        if called.removeprefix("solid.") in walls:
            continue
        found = ends_at(shape, tank.depth)
        if found is not None and found[0] < ends[1] - 1e-9 and found[1] > ends[0] + 1e-9:
            raise CaseError(
                f"{asked}: {called} is at the surface between them, from {found[0]:.4g} to {found[1]:.4g} m: "
                "a chamber is between two walls next to each other"
            )


def check_apart_chambers(stretches: Mapping[str, Stretch]) -> None:
    """**Raises** CaseError for two chambers over one stretch of the surface."""
    placed = sorted(stretches.items(), key=lambda pair: pair[1].first)
    for (a, one), (b, other) in itertools.pairwise(placed):
        if other.first < one.last - 1e-9:
            raise CaseError(
                f"chamber.{a} and chamber.{b}: both are over the surface from {other.first:.4g} to "
                f"{min(one.last, other.last):.4g} m: give each a stretch of its own"
            )
