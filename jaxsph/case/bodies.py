"""Rigid bodies of a model, with their joints and given motions, from a case's sections."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxsph.case.geometry import Geometry
from jaxsph.case.sections import Sections
from jaxsph.case.shape_sections import BodySection, MotionSection
from jaxsph.errors import CaseError
from jaxsph.parts.body import RigidBody
from jaxsph.parts.driven import AbstractPath
from jaxsph.parts.joint import PlanarJoint
from jaxsph.parts.paths import HarmonicPath, SampledPath
from jaxsph.parts.rotational import AbstractRotationalPTO, FreeHinge, RotationalPTO
from jaxsph.solids.shapes import AbstractShape
from jaxsph.solids.walls import Ghosts


def make_bodies(case: Sections, geometry: Geometry, walls: Ghosts, leaf: Any) -> tuple[RigidBody, ...]:
    """Rigid bodies of a case, followed by the fixed solids, which are bodies without free motions.

    `leaf` converts a number to an array of the case's precision. **Raises** CaseError for a moment of inertia
    that no body has.
    """
    sections, rows = case.every_body, iter(walls.dummies)
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
    area, centroid, second = shape.moments()
    centre = np.asarray(centroid if section.centre is None else section.centre)
    pivot = centre if section.pivot is None else np.asarray(section.pivot)
    # a body that only follows a given motion needs neither mass nor inertia
    mass, inertia = section.mass or 0.0, 0.0
    if section.density is not None:
        mass, inertia = section.density * area, section.density * second
    if section.inertia is not None:
        shifted = mass * float(np.sum((centre - pivot) ** 2))
        inertia = section.inertia - shifted
        if inertia <= 0.0:
            raise CaseError(
                f"{case.body_key(name)}.inertia = {section.inertia:g}: the moment of inertia about the pivot "
                f"must be more than mass times the squared distance from the centre of mass, {shifted:.4g}"
            )
    pto: AbstractRotationalPTO = FreeHinge()
    if section.pto is not None:
        pto = RotationalPTO.of(**section.pto.model_dump(), dtype=dtype)
    joint = PlanarJoint.of(
        section.free,
        dtype=dtype,
        release=section.release,
        parent=section.joined_to or "",
        angle=section.incline,
        velocity=section.velocity,
        position=(0.0, 0.0, section.angle),
        path=() if section.motion is None else (_path(section.motion, dtype),),
    )
    return RigidBody(
        shape=jax.tree.map(leaf, shape),
        mass=leaf(mass),
        inertia=leaf(inertia),
        pivot=leaf(pivot),
        centre=leaf(centre),
        joint=joint,
        pto=pto,
        rows=rows,
        name=name,
    )


def _path(section: MotionSection, dtype: np.dtype) -> AbstractPath:
    """Given motion of a body."""
    if section.amplitude is None or section.period is None:
        return SampledPath.of(np.asarray(section.t), section.samples, dtype)
    ramp = section.period if section.ramp is None else max(section.ramp, 1e-6)
    numbers = (section.amplitude, 2.0 * np.pi / section.period, section.phase, ramp)
    return HarmonicPath(*(jnp.asarray(a, dtype) for a in numbers))
