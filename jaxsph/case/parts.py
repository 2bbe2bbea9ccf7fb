"""Parts of a case's model: the rigid body of section `body` and the wavemaker of section `waves`."""

from __future__ import annotations

from typing import Any

import jax
import numpy as np

from jaxsph.case.case import Case
from jaxsph.case.geometry import Geometry
from jaxsph.errors import CaseError
from jaxsph.model.state import BodyState
from jaxsph.parts.body import RigidBody, RotationalPTO
from jaxsph.parts.paddle import Wavemaker
from jaxsph.waves.absorption import ActiveAbsorption
from jaxsph.waves.regular import RegularWaves, SecondOrderPiston


def make_body(case: Case, geometry: Geometry, leaf: Any) -> tuple[RigidBody | None, BodyState | None]:
    """Rigid body of a case and its state at the start; (None, None) without one.

    `leaf` makes an array of the case's precision of a number.
    **Raises** CaseError for a body whose motions the model does not have.
    """
    section, solid = case.body, geometry.solid
    if section is None:
        return None, None
    area, centroid, second = solid.moments()
    mass = section.mass if section.density is None else section.density * area
    centre = np.asarray(centroid if section.centre is None else section.centre)
    pivot = centre if section.pivot is None else np.asarray(section.pivot)
    inertia = section.inertia
    if section.density is not None:
        inertia = section.density * second + mass * float(np.sum((centre - pivot) ** 2))
    pto = None
    if section.pto is not None:
        pto = RotationalPTO.of(**section.pto.model_dump(), dtype=np.dtype(case.precision))
    try:
        body = RigidBody(
            free=tuple(name in section.free for name in ("surge", "heave", "pitch")),
            shape=solid,
            mass=leaf(mass or 1.0),  # what nothing moves needs no mass
            inertia=leaf(inertia or 1.0),
            pivot=leaf(pivot),
            centre=leaf(centre),
            release=leaf(section.release),
            pto=pto,
        )
    except ValueError as error:
        raise CaseError(f"body.{error}") from None
    start = BodyState.at_rest(np.dtype(case.precision), section.velocity, (0.0, 0.0, section.angle))
    return body, start


def make_wavemaker(case: Case, geometry: Geometry, leaf: Any) -> Wavemaker | None:
    """Piston of a case's waves, with active absorption where it is asked for; None without waves.

    `leaf` makes an array of the case's precision of a number.
    """
    section = case.waves
    if section is None:
        return None
    regular = RegularWaves(
        leaf(section.H),
        leaf(section.T),
        leaf(geometry.depth),
        leaf(case.g),
        leaf(section.ramp_periods * section.T),
        SecondOrderPiston() if section.second_order else None,
    )
    distance = 4.0 * case.smoothing_length
    absorption = None
    if section.absorption:
        # Slow against the waves, quick against the drift: with 0.01 omega the paddle crept 0.04 m back
        # in ten periods, on the half millimetre by which the gauge's mean is off.
        rate = 0.04 * float(regular.omega)
        absorption = ActiveAbsorption.at_gauge(regular, distance, drift_rate=rate)
        absorption = jax.tree.map(leaf, absorption)
    return Wavemaker(regular, absorption, leaf(distance), leaf(0.0))
