"""Shapes of a case's body and fixed solids, and checks that they fit the lattice and the tank."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import shapely

from jaxsph.case.body_sections import MOTIONS, PLANAR, BodySection
from jaxsph.case.section import choice
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
        raise CaseError(
            f"{name}: the shape has {given.dim} dimensions, but the tank has {dim}; choose another shape, or "
            f"{'give' if dim == 2 else 'remove'} tank.width"
        )
    given.check(f"{name}.{section.shape_key}", dx)
    return section.placed(dx)


def check_inside(corners: np.ndarray, name: str, upper: Sequence[float], slack: float) -> None:
    """**Raises** CaseError if corners `[K, D]` (m) are outside the tank (0 to `upper`, m) by more than
    `slack` (m)."""
    out = ((corners < -slack) | (corners > np.asarray(upper) + slack)).any(axis=1)
    if out.any():
        at = ", ".join(f"{a:.4g}" for a in corners[out][0])
        raise CaseError(
            f"{name} extends outside the tank at ({at}) m: move {name} into the tank, which extends from 0 "
            f"to {list(upper)} m, or enlarge the tank"
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
                f"{a} and {b} have {common:.3g} m{dim} in common: move one of them, or combine both in one "
                "shape"
            )


def _common_volume(a: AbstractShape, b: AbstractShape, low: np.ndarray, high: np.ndarray, dx: float) -> float:
    """Volume (m3) that two shapes have in common in the box between `low` and `high` (m), counted in cells of
    half the width dx (m)."""
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
    for carrier in carried_by:
        if np.any(carrier.angle):
            shape = Placed(shape, angle=carrier.angle, about=tuple(pivot_of(carrier)))
    return shape


def pivot_of(body: BodySection) -> np.ndarray:
    """Position `[D]` (m) of the joint of a body at rest; by default its centre of mass."""
    centroid = body.placed(math.inf).moments()[1]
    return in_tank(body.pivot or body.centre or centroid, centroid)


def in_tank(point: Any, beside: Any) -> np.ndarray:
    """Position `[D]` (m) of a point (x, z) or (x, y, z); a point without y has the y of the point `beside`
    `[D]` (m)."""
    if len(point) == 2 and len(beside) == 3:
        return np.array([point[0], beside[1], point[1]])
    return np.asarray(point, float)


def check_dimensions(section: BodySection, key: str, dim: int) -> None:
    """**Raises** CaseError for motions, positions or inertia that a body cannot have in `dim` dimensions."""
    if dim == 3:
        return
    beyond = [one for one in section.free if one not in PLANAR]
    if beyond:
        raise CaseError(
            f"{key}.free has {', '.join(beyond)}, but a two-dimensional case has only {', '.join(PLANAR)}: "
            "remove the other motions, or give tank.width to make the case three-dimensional"
        )
    motion = section.motion
    values: dict[str, tuple[Any, int]] = {
        "pivot": (section.pivot, 2),
        "centre": (section.centre, 2),
        "velocity": (section.velocity, 3),
        "inertia": (section.inertia, 0),
        "angle": (section.angle, 0),
    }
    if motion is not None:
        values |= {"motion.amplitude": (motion.amplitude, 3), "motion.phase": (motion.phase, 3)}
        for name in sorted(set(MOTIONS) - set(PLANAR)):
            values[f"motion.{name}"] = getattr(motion, name) or None, -1
    for name, (value, count) in values.items():
        if value is not None and np.size(value) != (count or 1):
            asked = f"{count} values" if count > 0 else "a single number" if count == 0 else "no values"
            raise CaseError(
                f"{key}.{name}: must have {asked} in a two-dimensional case; give tank.width to make the "
                "case three-dimensional"
            )


def turned(corners: np.ndarray, body: BodySection) -> np.ndarray:
    """Corners `[K, D]` (m), turned with a body to its initial angle about its pivot.

    The corners are those of the body itself, or of a body that it carries.
    """
    turns_in_place = (body.disc is not None or body.sphere is not None) and not (body.pivot or body.centre)
    if not np.any(body.angle) or (turns_in_place and np.array_equal(corners, body.corners())):
        return corners
    return rotated(corners, body.angle, pivot_of(body))


class Inertia(NamedTuple):
    """Inertia of a body."""

    mass: float
    """Mass, kg (kg/m in 2-D); 0 for a body that only follows a prescribed motion."""
    about_centre: Any
    """Inertia about the centre of mass: a number (kg m) in 2-D, a tensor `[3, 3]` (kg m2) in 3-D."""
    centre: np.ndarray
    """Centre of mass, m."""
    pivot: np.ndarray
    """Position of the joint, m."""


def inertia_of(section: BodySection, shape: AbstractShape, key: str) -> Inertia:
    """Inertia of the body of a section `key`. **Raises** CaseError if the given inertia is impossible."""
    check_dimensions(section, key, len(shape.bounds()[0]))
    volume, centroid, second = shape.moments()
    centre = in_tank(section.centre or centroid, centroid)
    pivot = in_tank(section.pivot or centre, centroid)
    if section.density is not None:
        return Inertia(section.density * volume, section.density * second, centre, pivot)
    mass, arm = section.mass or 0.0, centre - pivot
    if section.inertia is None:
        return Inertia(mass, np.zeros_like(second), centre, pivot)
    if np.ndim(second) == 0:
        return Inertia(mass, _about_centre(section.inertia, float(mass * arm @ arm), key), centre, pivot)
    shift: Any = mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return Inertia(mass, _tensor_about_centre(section, shift, key), centre, pivot)


def _about_centre(inertia: Any, shift: float, key: str) -> float:
    """Moment of inertia (kg m) about the centre of mass: `inertia` about the pivot minus `shift`."""
    if inertia <= shift:
        raise CaseError(
            f"{key}.inertia = {inertia:g}: the moment of inertia about the pivot must be more "
            f"than mass times the squared distance of the centre of mass from the pivot, {shift:.4g}"
        )
    return inertia - shift


def _tensor_about_centre(section: BodySection, shift: np.ndarray, key: str) -> np.ndarray:
    """Inertia tensor (kg m2) about the centre of mass: the tensor about the pivot minus `shift`."""
    given = section.inertia
    if isinstance(given, float | int):
        beyond = [one for one in section.free if one in ("roll", "yaw")]
        if beyond:
            raise CaseError(
                f"{key}.inertia = {given:g} is the inertia in pitch, but the body is also free in "
                f"{', '.join(beyond)}: give [I_xx, I_yy, I_zz]"
            )
        return _about_centre(given, float(shift[1, 1]), key) * np.eye(3)
    assert given is not None
    if len(given) not in (3, 6):
        raise CaseError(f"{key}.inertia: must have 1, 3 or 6 numbers, but has {len(given)}")
    tensor = np.diag(given[:3]).astype(float)
    for (i, j), value in zip(((0, 1), (0, 2), (1, 2)), given[3:], strict=False):
        tensor[i, j] = tensor[j, i] = value
    about = tensor - shift
    moments = np.linalg.eigvalsh(about)
    # no principal moment exceeds the sum of the other two; for a flat body it may equal this sum
    if moments[0] <= 0.0 or moments[2] > (moments[0] + moments[1]) * (1.0 + 1e-6):
        listed = ", ".join(f"{one:.4g}" for one in moments)
        raise CaseError(
            f"{key}.inertia = {list(given)}: no body has these moments of inertia, because those about the "
            f"centre of mass would be {listed}; each must be positive, and at most the sum of the other two"
        )
    return about


def in_order(case: Sections) -> dict[str, BodySection]:
    """Rigid bodies of a case by name, each after the body to which it is joined.

    **Raises** CaseError if a body is joined to a body that does not exist, or if joints form a closed loop.
    """
    sections, found = case.every_body, {}
    for name, section in sections.items():
        if section.joined_to is not None and section.joined_to not in sections:
            others = choice([other for other in sections if other != name], "other bodies")
            raise CaseError(
                f"{case.body_key(name)}.joined_to = {section.joined_to!r}: there is no such body; {others}, "
                "or remove joined_to to join the body to the tank"
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
                f"{', '.join(case.body_key(name) for name in circle)}: joined_to forms a loop; "
                "join one body of the loop to the tank (remove its joined_to)"
            )
        found |= ready
    return found


def initial_position(point: Sequence[float], carried_by: Sequence[BodySection]) -> np.ndarray:
    """Position `[D]` (m) of a point (m) of a body at the initial angles of the bodies that carry it."""
    place = in_tank(point, pivot_of(carried_by[0]))[None]
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
