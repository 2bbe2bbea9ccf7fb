"""Shapes of a case's body and fixed solids, and checks that they fit the lattice and the tank."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import shapely
from shapely.validation import explain_validity

from jaxsph.case.sections import Sections
from jaxsph.case.shape_sections import (
    BlockSection,
    BodySection,
    PlateSection,
    ShapeSection,
    SolidSection,
    SphereSection,
)
from jaxsph.errors import CaseError
from jaxsph.solids.plate import Plate
from jaxsph.solids.shapes import AbstractShape, Block, Disc, Polygon
from jaxsph.solids.volumes import Cylinder, Sphere

Points = tuple[tuple[float, ...], ...]


def shape_of(section: ShapeSection, name: str, dim: int, dx: float) -> AbstractShape:
    """Shape of the section `name` in a tank of `dim` dimensions.

    **Raises** CaseError if the shape has another number of dimensions, or if no particle of spacing dx (m)
    fits in the shape.
    """
    if (found := _dimensions(section)) != dim:
        raise CaseError(f"{name}: its shape has {found} dimensions, and the tank has {dim}")
    if section.block is not None:
        least = min(b - a for a, b in zip(section.block.low, section.block.high, strict=True))
        if least < 0.5 * dx:
            raise CaseError(
                f"{name}.block: is {least:g} m thick, and must be at least half a spacing, {0.5 * dx:g} m"
            )
        return Block(section.block.low, section.block.high)
    if isinstance(section, SolidSection) and section.plate is not None:
        return _plate(section.plate, name, dx)
    if section.disc is not None:
        if section.disc.radius <= 0.5 * dx:
            raise CaseError(
                f"{name}.disc.radius = {section.disc.radius:g} m: must be more than half a spacing (dx "
                f"= {dx:g} m)"
            )
        return Disc(section.disc.centre, section.disc.radius)
    if section.sphere is not None or section.cylinder is not None:
        return _round(section, name, dx)
    assert section.polygon is not None
    _check_polygon(section.polygon, name, dx)
    return Polygon(section.polygon)


def _dimensions(section: ShapeSection) -> int:
    """Number of dimensions of a section's shape."""
    if section.block is not None:
        return len(section.block.low)
    return 2 if section.sphere is None and section.cylinder is None else 3


def _round(section: ShapeSection, name: str, dx: float) -> AbstractShape:
    """Sphere or cylinder of the section `name`. **Raises** CaseError if it is too small for dx (m)."""
    key, given = ("sphere", section.sphere) if section.cylinder is None else ("cylinder", section.cylinder)
    assert given is not None
    if given.radius < dx:
        raise CaseError(
            f"{name}.{key}.radius = {given.radius:g} m: must be at least one spacing (dx = {dx:g} m)"
        )
    if isinstance(given, SphereSection):
        return Sphere(given.centre, given.radius)
    if (length := math.dist(given.foot, given.head)) < dx:
        raise CaseError(
            f"{name}.cylinder: is {length:.4g} m long, and must be at least one spacing long (dx = {dx:g} m)"
        )
    return Cylinder(given.foot, given.head, given.radius)


def _plate(section: PlateSection, name: str, dx: float) -> Plate:
    """Plate of the section `name`.plate.

    **Raises** CaseError if it is too short or too thin for ghosts of spacing dx (m) on its faces.
    """
    plate = Plate(section.foot, section.head, section.thickness)
    length = plate.straight().length
    if length < max(2.0 * dx, section.thickness):
        raise CaseError(
            f"{name}.plate: is {length:.4g} m long from foot to head; its length must be at least its "
            f"thickness, and at least two spacings of {dx:g} m"
        )
    if section.thickness < 0.45 * dx:
        raise CaseError(
            f"{name}.plate.thickness = {section.thickness:g} m is less than half a spacing of {dx:g} m: the "
            "plate would not act on the particles beyond its ends; use dx of at most "
            f"{2 * section.thickness:g} m"
        )
    return plate


def check_inside(corners: np.ndarray, name: str, upper: Sequence[float], slack: float) -> None:
    """**Raises** CaseError if corners `[K, D]` (m) are outside the tank (0 to `upper`, m) by more than
    `slack` (m)."""
    out = ((corners < -slack) | (corners > np.asarray(upper) + slack)).any(axis=1)
    if out.any():
        at = ", ".join(f"{a:.4g}" for a in corners[out][0])
        raise CaseError(
            f"{name}: extends outside the tank at ({at}) m; the tank extends from 0 to {list(upper)} m"
        )


def check_apart(shapes: Mapping[str, AbstractShape], areas: Mapping[str, Any], dx: float) -> None:
    """**Raises** CaseError if two shapes, given by name, overlap by more than half a particle's volume.

    `areas`: areas of the same shapes in the x-z plane, those of bodies at their initial angles.
    """
    for a, b in itertools.combinations(shapes, 2):
        low, high = (np.stack(ends) for ends in zip(shapes[a].bounds(), shapes[b].bounds(), strict=True))
        across = np.maximum(high.min(axis=0) - low.max(axis=0), 0.0)[1:-1]  # along y, in three dimensions
        dim, common = low.shape[1], areas[a].intersection(areas[b]).area * np.prod(across)
        if common > 0.5 * dx**dim:
            raise CaseError(
                f"{a} and {b}: have {common:.3g} m{dim} in common: move one of them, or combine both in one "
                "polygon"
            )


def initial_area(shape: AbstractShape, carried_by: Sequence[BodySection]) -> Any:
    """Area of a shape in the x-z plane at the initial angles of the bodies that carry it."""
    region = shape.region()
    for carrier in carried_by:
        region = shapely.transform(region, functools.partial(turned, body=carrier))
    return region


def _check_polygon(corners: Points, name: str, dx: float) -> None:
    """**Raises** CaseError if sides between the corners cross or touch, or if the area that they enclose is
    too thin to contain a particle."""
    sides = np.roll(corners, -1, axis=0) - np.asarray(corners)
    lengths = np.hypot(*sides.T)
    if lengths.min() < 1e-3 * dx:
        here = int(lengths.argmin())
        raise CaseError(
            f"{name}.polygon: corners {here} and {(here + 1) % len(corners)} are at the same place, "
            f"{list(corners[here])}: remove one (the outline closes by itself)"
        )
    whole = shapely.Polygon(corners)
    if not whole.is_valid:
        raise CaseError(
            f"{name}.polygon: its sides must not cross or touch each other ({explain_validity(whole)})"
        )
    if whole.buffer(-0.5 * dx, join_style="mitre", mitre_limit=20.0).is_empty:
        raise CaseError(
            f"{name}.polygon: is everywhere thinner than a spacing (dx = {dx:g} m), and contains no particle"
        )


def corners_of(body: ShapeSection) -> np.ndarray:
    """Points `[K, D]` (m) that span the extent of a shape."""
    if body.polygon is not None:
        return np.asarray(body.polygon)
    if isinstance(body, SolidSection) and body.plate is not None:
        return np.array([body.plate.foot, body.plate.head])
    if body.disc is not None:
        r = body.disc.radius
        return np.asarray(body.disc.centre) + r * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
    if body.sphere is not None:
        return np.asarray(body.sphere.centre) + body.sphere.radius * np.concatenate([np.eye(3), -np.eye(3)])
    if body.cylinder is not None:
        return Cylinder(body.cylinder.foot, body.cylinder.head, body.cylinder.radius).rims()
    assert body.block is not None
    ends = zip(body.block.low, body.block.high, strict=True)
    return np.stack(np.meshgrid(*ends, indexing="ij"), -1).reshape(-1, len(body.block.low))


def turned(corners: np.ndarray, body: BodySection) -> np.ndarray:
    """Corners `[K, D]` (m), turned with a body to its initial angle about its pivot in the x-z plane.

    The corners are those of the body itself, or of a body that it carries.
    """
    own = corners_of(body)
    pivot = body.pivot or body.centre
    turns_in_place = body.disc is not None or body.sphere is not None
    if not body.angle or (turns_in_place and pivot is None and np.array_equal(corners, own)):
        return corners
    if pivot is None:  # the centre of mass of a uniform body
        middle = 0.5 * (own.min(axis=0) + own.max(axis=0))[[0, -1]]
        pivot = middle if body.polygon is None else shapely.Polygon(own).centroid.coords[0]
    c, s = math.cos(body.angle), math.sin(body.angle)
    r = corners[:, [0, -1]] - pivot
    found = corners.copy()
    found[:, 0] = pivot[0] + c * r[:, 0] + s * r[:, 1]
    found[:, -1] = pivot[1] + c * r[:, 1] - s * r[:, 0]
    return found


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


def off_lattice(block: BlockSection, name: str, dx: float) -> list[str]:
    """Notice if a face of the block of the section `name` does not lie midway between two particles; the
    notice proposes a dx that fits all faces, if there is one."""
    faces = np.array([*block.low, *block.high])
    off = np.abs(faces / dx - np.round(faces / dx)) * dx
    if off.max() < 1e-3 * dx:
        return []
    worst = int(off.argmax())
    # the largest spacing that divides all faces, found in whole micrometres
    common = math.gcd(*(round(face * 1e6) for face in faces)) * 1e-6
    fits = f"no dx close to {dx:g} m fits all faces of the block"
    if common >= 0.25 * dx:
        fits = f"dx = {common / max(1, math.ceil(common / dx - 1e-9)):.4g} m fits all faces of the block"
    return [
        f"{name}.block: its face at {faces[worst]:g} m misses the lattice of {dx:g} m by {off[worst]:.3g} m: "
        f"the water's volume is right, but particles next to the face are not half a spacing from it; {fits}"
    ]
