"""Rigid bodies of a model with their joints, prescribed motions and links, from a case's sections."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy  # which imports its subpackages on first use

from jaxsph.case.body_sections import BodySection, LinkSection, MotionSection, RotationalPTOSection, spatial
from jaxsph.case.geometry import Geometry
from jaxsph.case.section import choice
from jaxsph.case.sections import TANK, Sections
from jaxsph.case.shapes import in_tank, inertia_of
from jaxsph.errors import CaseError
from jaxsph.model.links import AbstractEnds, AbstractLaw, Link
from jaxsph.parts.body import RigidBody
from jaxsph.parts.driven import AbstractPath
from jaxsph.parts.joint import joint_of
from jaxsph.parts.links import (
    AlongJoint,
    BetweenPoints,
    Damper,
    EndStops,
    Friction,
    Latch,
    Laws,
    Rope,
    Spring,
)
from jaxsph.parts.paths import HarmonicPath, SampledPath
from jaxsph.solids.shapes import AbstractShape


def make_bodies(
    case: Sections, geometry: Geometry, dummies: Sequence[tuple[int, int]], leaf: Any
) -> tuple[RigidBody, ...]:
    """Rigid bodies of a case, followed by the fixed solids, which are bodies without free motions.

    `dummies`: rows of every solid's ghosts, as in `Ghosts.dummies`; `leaf` converts a number to an array of
    the case's precision.
    """
    sections, rows = case.every_body, iter(dummies)
    moving = tuple(
        _body(case, name, sections[name], shape, next(rows), leaf) for name, shape in geometry.bodies.items()
    )
    fixed = (
        RigidBody.of(shape, next(rows), (), density=1.0, name=name, dtype=np.dtype(case.precision))
        for name, shape in geometry.solids.items()
    )
    return (*moving, *fixed)


def _body(
    case: Sections, name: str, section: BodySection, shape: AbstractShape, rows: tuple[int, int], leaf: Any
) -> RigidBody:
    """Rigid body of a case."""
    dtype = np.dtype(case.precision)
    found = inertia_of(section, shape, case.body_key(name))
    dim = len(found.pivot)
    joint = joint_of(
        dim,
        section.free,
        dtype=dtype,
        release=section.release,
        parent=section.joined_to or "",
        angle=section.incline,
        velocity=_whole(section.velocity, dim),
        position=_position(section.angle, dim),
        path=() if section.motion is None else (_path(section.motion, dim, dtype),),
    )
    return RigidBody(
        shape=jax.tree.map(leaf, shape),
        mass=leaf(found.mass),
        inertia=leaf(found.about_centre),
        pivot=leaf(found.pivot),
        centre=leaf(found.centre),
        joint=joint,
        rows=rows,
        name=name,
    )


def _whole(values: Sequence[float], dim: int) -> tuple[float, ...]:
    """Values of all motions in `dim` dimensions, from three or six values of a section."""
    return tuple(values) if dim == 2 else spatial(values)


def _position(angle: Any, dim: int) -> tuple[float, ...]:
    """Coordinates (m, rad) of a body at its initial angles (rad)."""
    if dim == 2:
        return 0.0, 0.0, angle
    angles = (0.0, angle, 0.0) if isinstance(angle, float | int) else angle
    turn = scipy.spatial.transform.Rotation.from_euler("xyz", angles)
    return 0.0, 0.0, 0.0, *map(float, turn.as_rotvec())


FRICTION_SCALE = 0.01
"""Rate of a link's extension at which Coulomb friction reaches 76 % of its full value, m/s or rad/s."""


def make_links(case: Sections, bodies: Sequence[RigidBody], leaf: Any) -> tuple[Link, ...]:
    """All links of a case: the bodies' power take-offs and the `link` sections.

    `leaf` converts a number to an array of the case's precision. **Raises** CaseError for a link to a body
    that does not exist, or along a motion in which the body is not free.
    """
    found, by_name, laws = [], {body.name: body for body in bodies}, link_laws(case, leaf)
    for name, called in case.pto_names.items():
        ends = AlongJoint.of(by_name[name], _index(by_name[name], "pitch"))
        found.append(Link(ends, laws[called], harvests=True, name=called))
    for name, section in case.link.items():
        ends = _ends(case, name, section, by_name, leaf)
        found.append(Link(ends, laws[name], harvests=section.take_off, name=name))
    return tuple(found)


def link_laws(case: Sections, leaf: Any) -> dict[str, Laws]:
    """Laws of the bodies' power take-offs and of the `link` sections, by the names of the links; `leaf` as in
    `make_links`."""
    found = {
        case.pto_names[name]: _take_off(one.pto, leaf) for name, one in case.every_body.items() if one.pto
    }
    return found | {name: _laws(section, leaf) for name, section in case.link.items()}


def _take_off(pto: RotationalPTOSection, leaf: Any) -> Laws:
    """Laws of a body's power take-off."""
    damper, friction = Damper(leaf(pto.damping), leaf(0.0)), Friction(leaf(pto.coulomb), leaf(FRICTION_SCALE))
    stops = EndStops(leaf(-pto.stop), leaf(pto.stop), leaf(pto.stop_stiffness))
    return Laws((damper, friction, Spring(leaf(pto.spring), leaf(0.0)), stops))


def _ends(
    case: Sections, name: str, section: LinkSection, bodies: Mapping[str, RigidBody], leaf: Any
) -> AbstractEnds:
    """Ends of a link: a motion of a body's joint, or two points of bodies or the tank."""
    named = [section.body] if section.between is None else [one for one in section.between if one != TANK]
    for body in named:
        if body not in case.every_body:
            asked = f"link.{name}.{'body' if section.between is None else 'between'}"
            raise CaseError(f"{asked}: there is no body {body!r}; {choice(case.every_body, 'bodies')}")
    if section.body is not None and section.motion is not None:
        free = case.every_body[section.body].free
        if section.motion not in free:
            others = f"choose from {', '.join(free)}, or " if free else ""
            raise CaseError(
                f"link.{name}.motion = {section.motion!r}: the body {section.body} is not free in this "
                f"motion; {others}add {section.motion!r} to {case.body_key(section.body)}.free"
            )
        return AlongJoint.of(bodies[section.body], _index(bodies[section.body], section.motion))
    assert section.between is not None and section.at is not None
    first, second = ("" if one == TANK else one for one in section.between)
    # an end on the tank has no pivot of its own, and uses the pivot of the other end's body
    pivots = [np.asarray(bodies[one or other].pivot) for one, other in ((first, second), (second, first))]
    for point in section.at:
        check_position(point, f"link.{name}.at", len(pivots[0]))
    a, b = (in_tank(point, pivot) for point, pivot in zip(section.at, pivots, strict=True))
    rest = float(np.linalg.norm(b - a)) if section.rest is None else section.rest
    return BetweenPoints(first, second, leaf(a), leaf(b), leaf(rest))


def check_position(point: Sequence[float], key: str, dim: int) -> None:
    """**Raises** CaseError for a point with more than `dim` coordinates, where `dim` is the number of
    dimensions of the tank."""
    if len(point) > dim:
        raise CaseError(
            f"{key} = {list(point)}: must be a position (x, z) in a two-dimensional case; give tank.width to "
            "make the case three-dimensional"
        )


def _index(body: RigidBody, motion: str) -> int:
    """Index of a motion among the coordinates of a body's joint."""
    return body.space.motions.index(motion)


def _laws(section: LinkSection, leaf: Any) -> Laws:
    """Laws of a link's force."""
    laws: list[AbstractLaw] = []
    if section.slack:
        return Laws((Rope(leaf(section.stiffness), leaf(section.pretension), leaf(section.damping)),))
    if section.stiffness or section.pretension:
        laws.append(Spring(leaf(section.stiffness), leaf(section.pretension)))
    if section.damping or section.quadratic:
        laws.append(Damper(leaf(section.damping), leaf(section.quadratic)))
    if section.friction:
        laws.append(Friction(leaf(section.friction), leaf(FRICTION_SCALE)))
    if section.stops is not None:
        low, high = section.stops
        laws.append(EndStops(leaf(low), leaf(high), leaf(section.stop_stiffness)))
    if section.latch is not None:
        laws.append(Latch(leaf(section.latch), leaf(section.latch_damping)))
    return Laws(tuple(laws))


def _path(section: MotionSection, dim: int, dtype: np.dtype) -> AbstractPath:
    """Prescribed motion of a body in a tank of `dim` dimensions."""
    if section.amplitude is None or section.period is None:
        samples = np.array([_whole(one, dim) for one in section.samples])
        return SampledPath.of(np.asarray(section.t), samples, dtype)
    ramp = section.period if section.ramp is None else section.ramp
    numbers = (
        _whole(section.amplitude, dim),
        2.0 * np.pi / section.period,
        _whole(section.phase, dim),
        ramp,
    )
    return HarmonicPath(*(jnp.asarray(a, dtype) for a in numbers))
