"""Shapes of a case's body and fixed solids, and checks that they fit the lattice and the tank."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import shapely

from jaxsph.case.body_sections import BodySection
from jaxsph.case.sections import Sections
from jaxsph.case.shape_sections import ShapeSection
from jaxsph.core.points import at_points
from jaxsph.errors import CaseError
from jaxsph.solids.composed import Placed, rotated
from jaxsph.solids.shapes import AbstractShape

Points = tuple[tuple[float, ...], ...]


def shape_of(section: ShapeSection, name: str, dim: int, dx: float) -> AbstractShape:
    """Shape of the section `name` in a tank of `dim` dimensions.

    **Raises** CaseError if the shape has another number of dimensions, or if no particle of spacing dx (m)
    fits in the shape.
    """
    given = section.given
    if given.dim != dim:
        raise CaseError(f"{name}: its shape has {given.dim} dimensions, and the tank has {dim}")
    given.check(f"{name}.{section.shape_key}", dx)
    return section.placed(dx)


def check_inside(corners: np.ndarray, name: str, upper: Sequence[float], slack: float) -> None:
    """**Raises** CaseError if corners `[K, D]` (m) are outside the tank (0 to `upper`, m) by more than
    `slack` (m)."""
    out = ((corners < -slack) | (corners > np.asarray(upper) + slack)).any(axis=1)
    if out.any():
        at = ", ".join(f"{a:.4g}" for a in corners[out][0])
        raise CaseError(
            f"{name}: extends outside the tank at ({at}) m; the tank extends from 0 to {list(upper)} m"
        )


def check_apart(shapes: Mapping[str, AbstractShape], dx: float) -> None:
    """**Raises** CaseError if two shapes, given by name, overlap by more than half a particle's volume; the
    shapes are those at the initial angles of the bodies, and dx (m) is the spacing."""
    for a, b in itertools.combinations(shapes, 2):
        low, high = (np.stack(ends) for ends in zip(shapes[a].bounds(), shapes[b].bounds(), strict=True))
        dim, low, high = low.shape[1], low.max(axis=0), high.min(axis=0)
        if (high <= low).any():
            continue
        if dim == 3:
            common = _common_volume(shapes[a], shapes[b], low, high, dx)
        else:
            common = shapes[a].region().intersection(shapes[b].region()).area
        if common > 0.5 * dx**dim:
            raise CaseError(
                f"{a} and {b}: have {common:.3g} m{dim} in common: move one of them, or combine both in one "
                "shape"
            )


def _common_volume(a: AbstractShape, b: AbstractShape, low: np.ndarray, high: np.ndarray, dx: float) -> float:
    """Volume (m3) that two shapes have in common, counted in cells half as wide as dx (m) of the box between
    `low` and `high` (m)."""
    counts = np.ceil((high - low) / (0.5 * dx)).astype(int)
    axes = [
        start + (np.arange(n) + 0.5) * (end - start) / n
        for start, end, n in zip(low, high, counts, strict=True)
    ]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    inside = (at_points(a.distance, points) < 0.0) & (at_points(b.distance, points) < 0.0)
    return float(np.mean(inside) * np.prod(high - low))


def initial_shape(shape: AbstractShape, carried_by: Sequence[BodySection]) -> AbstractShape:
    """A shape at the initial angles of the bodies that carry it."""
    dim = len(shape.bounds()[0])
    for carrier in carried_by:
        if carrier.angle:
            shape = Placed(shape, angle=carrier.angle, about=_pivot(carrier, dim))
    return shape


def _pivot(body: BodySection, dim: int) -> tuple[float, ...]:
    """Position `[D]` (m) of the joint of a body at rest; without a given one, its centre of mass."""
    x, z = body.pivot or body.centre or body.placed(math.inf).moments()[1]
    return (x, z) if dim == 2 else (x, 0.0, z)


def turned(corners: np.ndarray, body: BodySection) -> np.ndarray:
    """Corners `[K, D]` (m), turned with a body to its initial angle about its pivot in the x-z plane.

    The corners are those of the body itself, or of a body that it carries.
    """
    turns_in_place = (body.disc is not None or body.sphere is not None) and not (body.pivot or body.centre)
    if not body.angle or (turns_in_place and np.array_equal(corners, body.corners())):
        return corners
    return rotated(corners, body.angle, _pivot(body, corners.shape[1]))


class Inertia(NamedTuple):
    """Inertia of a body."""

    mass: float
    """Mass, kg (kg/m in 2-D); 0 for a body that only follows a given motion."""
    about_centre: float
    """Moment of inertia about the centre of mass, kg m2 (kg m in 2-D)."""
    centre: np.ndarray
    """Centre of mass (x, z), m."""
    pivot: np.ndarray
    """Position of the joint (x, z), m."""


def inertia_of(section: BodySection, shape: AbstractShape, key: str) -> Inertia:
    """Inertia of the body of a section `key`. **Raises** CaseError if the given inertia is impossible."""
    area, centroid, second = shape.moments()
    centre = np.asarray(centroid if section.centre is None else section.centre)
    pivot = centre if section.pivot is None else np.asarray(section.pivot)
    if section.density is not None:
        return Inertia(section.density * area, section.density * second, centre, pivot)
    mass, inertia = section.mass or 0.0, 0.0
    if section.inertia is not None:
        shifted = mass * float(np.sum((centre - pivot) ** 2))
        inertia = section.inertia - shifted
        if inertia <= 0.0:
            raise CaseError(
                f"{key}.inertia = {section.inertia:g}: the moment of inertia about the pivot must be more "
                f"than mass times the squared distance of the centre of mass from the pivot, {shifted:.4g}"
            )
    return Inertia(mass, inertia, centre, pivot)


def in_order(case: Sections) -> dict[str, BodySection]:
    """Rigid bodies of a case by name, each after the body that it is joined to.

    **Raises** CaseError if a body is joined to a body that does not exist, or if joints form a closed loop.
    """
    sections, found = case.every_body, {}
    for name, section in sections.items():
        if section.joined_to is not None and section.joined_to not in sections:
            others = ", ".join(other for other in sections if other != name) or "none"
            raise CaseError(
                f"{case.body_key(name)}.joined_to = {section.joined_to!r}: there is no such body; there are "
                f"{others}. Without joined_to the body is joined to the tank"
            )
    while len(found) < len(sections):
        ready = {
            name: one
            for name, one in sections.items()
            if name not in found and (one.joined_to is None or one.joined_to in found)
        }
        if not ready:
            circle = sorted(sections.keys() - found)
            raise CaseError(
                f"{', '.join(case.body_key(name) for name in circle)}: joined_to forms a loop: join one of "
                "these bodies to the tank (remove the key)"
            )
        found |= ready
    return found


def initial_position(point: Sequence[float], carried_by: Sequence[BodySection]) -> np.ndarray:
    """Position `[2]` (m) of a point (x, z) of a body at the initial angles of the bodies that carry it."""
    place = np.array([point])
    for carrier in carried_by:
        place = turned(place, carrier)
    return place[0]


def carriers(sections: Mapping[str, BodySection], name: str) -> list[BodySection]:
    """Sections of a body and of the bodies that carry it, from the body to the tank."""
    found, carrier = [], name
    while carrier is not None:
        found.append(sections[carrier])
        carrier = sections[carrier].joined_to
    return found


def ends_at(shape: AbstractShape, level: float) -> tuple[float, float] | None:
    """First and last x (m) of a shape at a level (m); None if the shape does not reach this level."""
    low, high = shape.bounds()
    if not low[-1] < level < high[-1]:
        return None
    if len(low) == 3:
        return float(low[0]), float(high[0])
    across = shapely.LineString([(low[0] - 1.0, level), (high[0] + 1.0, level)])
    first, _, last, _ = shape.region().intersection(across).bounds
    return float(first), float(last)


def crest_of(shape: AbstractShape, dx: float) -> tuple[float, float]:
    """Landward end x (m) of a shape's crest, and its level (m); `dx` (m): spacing of the particles."""
    top = float(shape.bounds()[1][-1])
    ends = ends_at(shape, top - 0.01 * dx)
    assert ends is not None
    return ends[1], top
