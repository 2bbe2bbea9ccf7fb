"""Water surfaces below chambers; in three dimensions the surface that solids enclose around a point."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import shapely

from jaxsph.case.air_sections import ChamberSection
from jaxsph.case.chambers import Stretch, Tank, check_apart_chambers, stretch_between, stretch_in
from jaxsph.case.section import choice
from jaxsph.case.sections import Sections
from jaxsph.core.points import at_points
from jaxsph.errors import CaseError
from jaxsph.solids.cells import area_inside
from jaxsph.solids.shapes import AbstractShape

FINE, COARSE = 0.125, 0.5
"""Distances between the points at which horizontal sections are sampled, in spacings of the particles: `FINE`
for the water surface, `COARSE` for finding the levels of the walls' ends."""
CLOSE = 0.01
"""Largest deviation of a chamber's outline from the section through the solids, in spacings."""
SEAM = 0.1
"""Half the width of the widest gap between two solids that counts as closed, in spacings."""
UPRIGHT = 0.02
"""Largest relative change of a chamber's area over its height for which the walls count as upright."""
NARROW = 3.0
"""Least width of a chamber, in spacings."""

CutAt = Callable[[float], Any]
"""Water at a level (m) that is connected with a chamber's point, as a polygon of `shapely`; None if the point
is in a solid, or if this water is connected with the open water outside the chamber."""


class Pool(NamedTuple):
    """Water surface of a chamber with upright walls."""

    given: str
    """Key and value with which a case gives the chamber, as text for messages."""
    carrier: str
    """Name of the body in whose hollow the chamber is; empty for a chamber between walls at rest."""
    corners: np.ndarray
    """Corners `[K, 2]` (x, y) (m) of the water surface at rest."""
    tip: float
    """Level of the upper edge of the highest opening under a wall, m. Air escapes if the water falls
    below this level."""
    top: float
    """Level at which the walls end or the roof begins, m."""
    surface: float
    """Area of the water surface at rest, m2."""

    @property
    def first(self) -> float:
        """Smallest x of the water surface, m."""
        return float(self.corners[:, 0].min())

    @property
    def last(self) -> float:
        """Largest x of the water surface, m."""
        return float(self.corners[:, 0].max())

    @property
    def nearest(self) -> float:
        """Smallest x of the chamber's walls, m."""
        return self.first

    @property
    def narrowest(self) -> float:
        """Least width of the water surface, m."""
        return 2.0 * float(shapely.maximum_inscribed_circle(shapely.Polygon(self.corners)).length)

    @property
    def walls(self) -> np.ndarray:
        """Walls of the chamber, for `Chamber.of`."""
        return self.corners


WaterSurface = Stretch | Pool
"""Water surface below a chamber at rest, in two or three dimensions."""


def water_surfaces(case: Sections, tank: Tank) -> dict[str, WaterSurface]:
    """Water surfaces of a case's chambers, by the chambers' names.

    **Raises** CaseError if the solids around a chamber cannot hold air over water, or if chambers overlap.
    """
    if tank.width is None:
        stretches = {name: _stretch(f"chamber.{name}", one, tank) for name, one in case.chambers.items()}
        check_apart_chambers(stretches)
        return dict(stretches)
    pools = {name: _pool(f"chamber.{name}", one, tank) for name, one in case.chambers.items()}
    _check_apart(pools)
    return dict(pools)


def _stretch(key: str, section: ChamberSection, tank: Tank) -> Stretch:
    """Water surface of a chamber in two dimensions."""
    if isinstance(section.at, tuple):
        raise CaseError(
            f"{key}.at = {list(section.at)} needs tank.width; in two dimensions give between, "
            "or body with a single position at = x"
        )
    if section.between is not None:
        return stretch_between(key, section.between, tank)
    assert section.body is not None
    return stretch_in(key, section.body, section.at, _carrier(key, section.body, tank), tank)


def _carrier(key: str, body: str, tank: Tank) -> AbstractShape:
    """Shape of the body that carries a chamber. **Raises** CaseError if there is no such body."""
    if body in tank.bodies:
        return tank.bodies[body]
    raise CaseError(f"{key}.body = {body!r}: there is no such body; {choice(tank.bodies, 'bodies')}")


def _pool(key: str, section: ChamberSection, tank: Tank) -> Pool:
    """Water surface of a chamber in three dimensions, around the point `at` of its section.

    **Raises** CaseError, which names the section `key`, if the solids around `at` do not form a chamber.
    """
    if not isinstance(section.at, tuple):
        instead = "" if section.between is None else ", instead of between"
        raise CaseError(
            f"{key}: in a tank with a width give at = [x, y], a point (m) in the chamber{instead}"
        )
    assert tank.width is not None
    at, carrier = section.at, section.body or ""
    asked = f"{key}.at = {list(at)}"
    if carrier:
        shapes = [_carrier(key, carrier, tank)]
        ends = shapes[0].bounds()
        low, high = ends[0][:2] - 2.0 * tank.dx, ends[1][:2] + 2.0 * tank.dx
    else:
        shapes = [shape for name, shape in tank.shapes.items() if name.startswith("solid.")]
        low, high = np.zeros(2), np.array([tank.length, tank.width])
    if not shapes:
        raise CaseError(
            f"{asked}: there is no solid that could enclose this point; give the chamber's walls as solids"
        )
    surface = _cuts(np.asarray(at), shapes, (low, high), tank.dx, FINE)(tank.depth)
    if surface is None:
        who = f"the body {carrier} does" if carrier else "solids do"
        raise CaseError(
            f"{asked}: {who} not enclose this point at the still water level, z = {tank.depth:g} m; choose a "
            "point between walls that pierce the surface, or close the gap between these walls"
        )
    if surface.interiors:
        raise CaseError(f"{asked}: a solid pierces the surface in the chamber; move this solid out")
    cut = _cuts(np.asarray(at), shapes, (low, high), tank.dx, COARSE)
    # the section is taken through solids thickened by a seam
    seam = SEAM * tank.dx
    tip = _last_level(cut, tank.depth, 0.0, tank.dx) + seam
    top = _last_level(cut, tank.depth, tank.height, tank.dx)
    above = np.array([[*at, top + 2.0 * seam]])
    roofed = any(float(at_points(shape.distance, above, float)[0]) < 0.0 for shape in shapes)
    top += seam if roofed else -seam
    if carrier and not roofed:
        raise CaseError(
            f"{asked}: the hollow of {carrier!r} is open at the top (z = {top:.4g} m); add a roof on "
            "which the air pressure can act"
        )
    corners = np.asarray(surface.simplify(CLOSE * tank.dx).exterior.coords)[:-1]
    found = Pool(asked, carrier, corners, tip, top, float(surface.area))
    _check(found, cut, tank)
    return found


def _cuts(
    at: np.ndarray,
    shapes: Sequence[AbstractShape],
    box: tuple[np.ndarray, np.ndarray],
    dx: float,
    fine: float,
) -> CutAt:
    """Function that returns the enclosed water around a point (x, y) (m) at any level; see `CutAt`.

    Water that reaches the lowest x of the `box`, given by two corners (m), counts as connected with the open
    water. The section is sampled at points that are `fine` spacings dx (m) apart.
    """
    (low, high), side = box, fine * dx
    x, y = (np.arange(a - 2.0 * side, b + 2.5 * side, side) for a, b in zip(low, high, strict=True))
    # At and beyond the walls of the box, the section is sampled one spacing inside the walls, so that the
    # ends of solids that reach up to the walls have no effect. The water is then cut off at the walls.
    plane = np.stack(np.meshgrid(x, y, indexing="ij"), -1).reshape(-1, 2)
    plane = np.clip(plane, low + dx, high - dx)
    within, seam = shapely.box(*low, *high), SEAM * dx

    def cut(level: float) -> Any:
        points = np.column_stack([plane, np.full(len(plane), level)])
        solid = np.min([at_points(shape.distance, points, float) for shape in shapes], axis=0)
        wet = np.pad((seam - solid).reshape(len(x), len(y))[1:-1, 1:-1], 1, constant_values=side)
        water = area_inside(x, y, wet).buffer(seam, join_style="mitre").intersection(within)
        for part in shapely.get_parts(water):
            if part.contains(shapely.Point(at)):
                return None if part.bounds[0] < low[0] + side else part
        return None

    return cut


def _last_level(cut: CutAt, level: float, end: float, dx: float) -> float:
    """Last level (m) on the way from `level` to `end` (m) at which the water is enclosed, found in steps
    of half a spacing dx (m) and then by bisection."""
    way = 0.5 * dx if end > level else -0.5 * dx
    while (end - level) / way > 1.0 and cut(level + way) is not None:
        level += way
    beyond = level + way if (end - level) / way > 1.0 else end
    if cut(beyond) is not None:
        return end
    for _ in range(9):
        middle = 0.5 * (level + beyond)
        level, beyond = (middle, beyond) if cut(middle) is not None else (level, middle)
    resolved = 0.002 * dx
    return float(resolved * np.round(0.5 * (level + beyond) / resolved))


def _check(pool: Pool, cut: CutAt, tank: Tank) -> None:
    """**Raises** CaseError if a chamber is too small for the spacing, or if its walls are not upright."""
    if pool.tip > tank.depth - 2.0 * tank.dx:
        raise CaseError(
            f"{pool.given}: the chamber's lower edge is at z = {pool.tip:.4g} m, and must be at least two "
            f"spacings below still water at z = {tank.depth:g} m"
        )
    if pool.narrowest < NARROW * tank.dx:
        raise CaseError(
            f"{pool.given}: the chamber is {pool.narrowest:.3g} m wide, and must be at least three spacings "
            f"of dx = {tank.dx:g} m wide"
        )
    # closer than a spacing to an edge, the distances on the grid do not resolve the section
    for level in (pool.tip + tank.dx, min(2.0 * tank.depth - pool.tip, pool.top - tank.dx)):
        water = cut(level)
        area = 0.0 if water is None else water.area
        if abs(area / pool.surface - 1.0) > UPRIGHT:
            raise CaseError(
                f"{pool.given}: the chamber's area is {pool.surface:.4g} m2 at still water and {area:.4g} m2 "
                f"at z = {level:.4g} m; in three dimensions a chamber needs upright walls"
            )


def _check_apart(pools: Mapping[str, Pool]) -> None:
    """**Raises** CaseError if the water surfaces of two chambers overlap."""
    for (a, one), (b, other) in itertools.combinations(pools.items(), 2):
        if shapely.Polygon(one.corners).intersection(shapely.Polygon(other.corners)).area > 0.0:
            raise CaseError(
                f"chamber.{a} and chamber.{b}: their water surfaces overlap; change chamber.{a}.at or "
                f"chamber.{b}.at"
            )
