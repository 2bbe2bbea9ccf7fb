"""Notices about densities of another unit, and positions of bodies and sensors that may be mistaken."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, cast

import scipy  # which imports its subpackages on first use

from jaxsph.case.geometry import Geometry
from jaxsph.case.hydrostatics import submerged
from jaxsph.case.sections import Sections
from jaxsph.case.shapes import inertia_of

LIGHT = 10.0
"""Density (kg/m3) below which a value was probably meant in another unit, such as g/cm3."""


def position_notices(case: Sections, geometry: Geometry) -> list[str]:
    """Notices about densities of another unit, bodies far from equilibrium, and sensors above the water."""
    return [*_light(case), *_afloat(case, geometry), *_dry_sensors(case, geometry)]


def _light(case: Sections) -> Iterator[str]:
    """Notices about densities that were probably given in another unit."""
    given = {f"{case.body_key(name)}.density": one.density for name, one in case.every_body.items()}
    for key, density in ({"fluid.rho0": case.fluid.rho0} | given).items():
        if density is not None and density < LIGHT:
            yield f"{key} = {density:g} kg/m3 is very small: densities are in kg/m3 (water: 1000)"


def _dry_sensors(case: Sections, geometry: Geometry) -> Iterator[str]:
    """Notices about pressure sensors above the still water level."""
    if case.tank.column is not None:  # the water of a released column reaches sensors above its level
        return
    for index, point in enumerate(geometry.pressure):
        above = point[-1] - geometry.depth
        if above > 0.01 * case.dx:
            yield (
                f"probes.pressure[{index}] = {list(point)} m is {above:.3g} m above the still water level: "
                "it reads zero except while water reaches it; for the air in a chamber, use the reading P_a"
            )


def _afloat(case: Sections, geometry: Geometry) -> Iterator[str]:
    """Notices about bodies of two-dimensional cases that float more than a spacing from where they are given.

    Only for bodies that are free in heave, and on which only weight and buoyancy act. The equilibrium is that
    of a vertical displacement in water whose level does not change.
    """
    if case.dim != 2 or case.tank.column is not None or case.g == 0.0:
        return
    for name, section in case.every_body.items():
        if "heave" not in section.free or section.incline or section.motion or name in _held(case):
            continue
        key, rho0 = case.body_key(name), case.fluid.rho0
        mass = inertia_of(section, geometry.bodies[name], key).mass
        region = geometry.areas[geometry.keys[name]]
        if mass > rho0 * region.area:  # the body sinks, see `notices`
            continue
        rise = geometry.depth - _waterline(region, mass / rho0)
        if abs(rise) > case.dx:
            displaced = rho0 * submerged(region, geometry.depth).area
            more, where = ("less", "above") if rise > 0.0 else ("more", "below")
            yield (
                f"{key} floats {abs(rise):.2g} m {where} its given position, because its mass of {mass:.4g} "
                f"kg/m is {more} than the {displaced:.4g} kg/m of water that it displaces there: change its "
                "position, its density or its mass, unless it should begin away from its equilibrium"
            )


def _waterline(region: Any, area: float) -> float:
    """Level (m) below which a region (x, z) (m) has an area (m2)."""
    _, low, _, high = region.bounds
    return cast(float, scipy.optimize.brentq(lambda level: submerged(region, level).area - area, low, high))


def _held(case: Sections) -> set[str | None]:
    """Names of the bodies on which joints, moorings, springs or stops act besides weight and buoyancy."""
    held: set[str | None] = {mooring.body for mooring in case.mooring.values()}
    for name, one in case.every_body.items():
        if one.joined_to is not None:
            held |= {name, one.joined_to}
    for link in case.link.values():
        if link.stiffness or link.pretension or link.stop_stiffness or link.latch_damping:
            held |= {link.body, *(link.between or ())}
    return held
