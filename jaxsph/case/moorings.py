"""Moorings of a case: the parts, and checks of lines against the tank, its solids and the time step."""

from __future__ import annotations

import math
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import shapely

from jaxsph.case.bodies import check_position
from jaxsph.case.geometry import Geometry
from jaxsph.case.mooring_sections import MooringSection
from jaxsph.case.scheme import stable_time_step
from jaxsph.case.section import choice
from jaxsph.case.sections import Sections
from jaxsph.case.shapes import carriers, in_tank, initial_position, pivot_of
from jaxsph.core.points import at_points
from jaxsph.errors import CaseError
from jaxsph.parts.catenary import AbstractCatenary, GroundedCatenary, HangingCatenary
from jaxsph.parts.line import Bed, LumpedLine, Morison
from jaxsph.parts.moorings import FromAnchor, Mooring, QuasiStatic

MOST_STRETCH = 0.1
"""Largest strain of a mooring at rest (-)."""
MOST_SUBSTEPS = 500
"""Largest number of steps of a line in a step of the water. A line with this number of steps needs more
computing time than the water."""
ON_BED = 1e-6
"""Largest height at which an anchor counts as on the bed, m."""


def make_moorings(case: Sections, leaf: Any) -> tuple[Mooring, ...]:
    """Moorings of a case. `leaf` converts a number to an array of the case's precision."""
    found = []
    for name, section in case.mooring.items():
        beside = pivot_of(case.every_body[section.body])
        ends = FromAnchor(
            section.body, leaf(in_tank(section.at, beside)), leaf(in_tank(section.anchor, beside))
        )
        static = section.kind == "catenary"
        law = QuasiStatic(_at_rest(case, section, leaf)) if static else _line(case, section, leaf)
        found.append(Mooring(ends, law, name=name))
    return tuple(found)


def _at_rest(case: Sections, section: MooringSection, leaf: Any) -> AbstractCatenary:
    """Catenary of all lines of a mooring (in 2-D, those per metre of width) in static equilibrium."""
    kind = GroundedCatenary if section.anchor[-1] <= ON_BED else HangingCatenary
    weight = section.weight_in_water(case.fluid.rho0, case.g)
    return kind(
        leaf(section.length), leaf(section.lines * weight), leaf(section.lines * section.axial_stiffness)
    )


def _line(case: Sections, section: MooringSection, leaf: Any) -> LumpedLine:
    """Lumped masses that represent all lines of a mooring, in 2-D those per metre of width."""
    assert section.mass is not None and section.diameter is not None and section.drag is not None
    rho0, d, count = case.fluid.rho0, section.diameter, section.lines
    across, along = (0.5 * rho0 * d * count * one for one in section.drag)
    added = (rho0 * section.area * count * one for one in section.added_mass)
    size = section.length / section.segments
    line = LumpedLine(
        at_rest=_at_rest(case, section, leaf),
        mass=leaf(count * section.mass),
        damping=leaf(count * section.damping * size * math.sqrt(section.axial_stiffness * section.mass)),
        water=Morison(leaf(across), leaf(math.pi * along), *map(leaf, added)),
        bed=Bed(
            leaf(-section.anchor[-1]),
            leaf(count * d * section.bed_stiffness),
            leaf(count * d * section.bed_damping),
        ),
        segments=section.segments,
    )
    return line.stepped(min(stable_time_step(case), 0.5 * case.output.sample_dt))


def check_moorings(case: Sections, geometry: Geometry) -> None:
    """**Raises** CaseError for a mooring that does not fit into the tank, does not sink in water, or needs
    too many time steps."""
    for name, section in case.mooring.items():
        _check_ends(case, geometry, name, section)
        weight = section.weight_in_water(case.fluid.rho0, case.g)
        if weight <= 0.0 and case.g == 0.0:
            raise CaseError(
                f"mooring.{name}: without gravity (g = 0) a mooring has no weight; use a positive g, or a "
                "link with slack = true"
            )
        if weight <= 0.0:
            raise CaseError(
                f"mooring.{name} weighs {weight:.3g} N/m in water, but must sink: use a larger mass or a "
                "smaller diameter; for a rope without weight use a link with slack = true"
            )
        _check_path(case, geometry, name, section)
        if section.kind == "line":
            steps = _line(case, section, np.asarray).substeps
            if steps > MOST_SUBSTEPS:
                raise CaseError(
                    f"mooring.{name}.axial_stiffness = {section.axial_stiffness:g} N: the line would take "
                    f"{steps} steps in each time step of the water, but at most {MOST_SUBSTEPS} are allowed; "
                    "use a smaller axial_stiffness, damping or bed_stiffness, fewer segments, or "
                    'kind = "catenary"'
                )


def _check_ends(case: Sections, geometry: Geometry, name: str, section: MooringSection) -> None:
    """**Raises** CaseError if a mooring's body does not exist, if the line is too short, if an end is outside
    the tank, or if the anchor is inside a solid."""
    if section.body not in case.every_body:
        raise CaseError(
            f"mooring.{name}.body: there is no body {section.body!r}; {choice(case.every_body, 'bodies')}"
        )
    slack = 0.01 * case.dx
    for key in ("at", "anchor"):
        check_position(getattr(section, key), f"mooring.{name}.{key}", case.dim)
    fairlead, anchor = _ends(case, section)
    for key, point in (("at", fairlead), ("anchor", anchor)):
        if np.any(point < 0.0) or np.any(point > geometry.upper):
            place, ends = (", ".join(f"{a:.4g}" for a in one) for one in (point, geometry.upper))
            raise CaseError(
                f"mooring.{name}.{key}: ({place}) m is outside the tank, which extends from 0 to ({ends}) m; "
                "move this end into the tank"
            )
    for other in geometry.initial:
        if _depth_in(geometry, other, anchor[None]) > slack:
            raise CaseError(
                f"mooring.{name}.anchor = {list(section.anchor)} m is inside {other}: move the anchor out "
                f"of {other}, or onto its boundary"
            )
    span = math.dist(fairlead, anchor)
    if span > (1.0 + MOST_STRETCH) * section.length:
        raise CaseError(
            f"mooring.{name}.length = {section.length:g} m: the distance from the anchor to the fairlead is "
            f"{span:.4g} m, which would stretch the line by {100 * (span / section.length - 1):.3g} % (at "
            f"most {100 * MOST_STRETCH:g} % is allowed); use a length of at least "
            f"{span / (1.0 + MOST_STRETCH):.4g} m"
        )


def _check_path(case: Sections, geometry: Geometry, name: str, section: MooringSection) -> None:
    """**Raises** CaseError for a line through a solid, or below the bed, at the bodies' initial angles."""
    line, (fairlead, anchor) = _at_rest(case, section, np.float32), _ends(case, section)
    ends = jnp.asarray(fairlead - anchor, jnp.float32)
    points = anchor + np.asarray(_shape(QuasiStatic(line), (), ends))
    lowest = float(points[:, -1].min())
    if lowest < -0.5 * case.dx:
        raise CaseError(
            f"mooring.{name}.anchor = {list(section.anchor)} m is above the bed, and the line would sag "
            f"{-lowest:.3g} m below the bed: use an anchor on the bed (z = 0), or a shorter line"
        )
    for other in geometry.initial:
        depth = _depth_in(geometry, other, points)
        if depth > case.dx:
            raise CaseError(
                f"mooring.{name}: the line at rest passes through {other}, up to {depth:.3g} m below its "
                "surface; move the anchor or the fairlead, or change the length"
            )


def _ends(case: Sections, section: MooringSection) -> tuple[np.ndarray, np.ndarray]:
    """Initial positions `[D]` (m) of a mooring's fairlead and anchor."""
    fairlead = initial_position(section.at, carriers(case.every_body, section.body))
    return fairlead, in_tank(section.anchor, pivot_of(case.every_body[section.body]))


def _depth_in(geometry: Geometry, name: str, points: np.ndarray) -> float:
    """Largest depth (m) of points `[K, D]` (m) inside a solid in its initial position; 0 outside."""
    if points.shape[1] == 3:
        return max(0.0, -float(at_points(geometry.initial[name].distance, points).min()))
    area, places = geometry.areas[name], shapely.points(points)
    return float(np.max(np.where(area.contains(places), area.boundary.distance(places), 0.0)))


_shape = eqx.filter_jit(QuasiStatic.shape)
