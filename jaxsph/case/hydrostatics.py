"""Hydrostatics of a two-dimensional body at rest: displaced volume, stiffness and inertia about its pivot."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from jaxsph.analysis.coefficients import MOTIONS, BodyAtRest, Mode
from jaxsph.case.geometry import Geometry
from jaxsph.case.sections import Sections
from jaxsph.case.shapes import inertia_of


def at_rest(case: Sections, geometry: Geometry, name: str, x: float) -> BodyAtRest:
    """Displaced volume, inertia and stiffness of body `name` at rest, with positions relative to the point
    x (m) in the still water surface."""
    section, shape = case.every_body[name], geometry.bodies[name]
    inertia, origin = inertia_of(section, shape, case.body_key(name)), np.array([x, geometry.depth])
    under = submerged(shape.region(), geometry.depth)
    buoyancy = np.array([under.centroid.x, under.centroid.y]) if under.area else inertia.centre
    arm = inertia.centre - inertia.pivot
    weight = np.zeros((3, 3))
    weight[2, 2] = -inertia.mass * case.g * arm[1]
    stiffness = buoyancy_stiffness(shape.region(), geometry.depth, inertia.pivot, case.fluid.rho0 * case.g)
    return BodyAtRest(
        pivot=_pair(inertia.pivot - origin),
        centre=_pair(inertia.centre - origin),
        buoyancy=_pair(buoyancy - origin),
        area=float(under.area),
        inertia=inertia_matrix(inertia.mass, inertia.about_centre, arm),
        stiffness=stiffness + weight,
    )


def water_stiffness(case: Sections, geometry: Geometry, modes: Sequence[Mode]) -> NDArray[np.float64]:
    """Hydrostatic stiffness `[n, n]` of the modes from buoyancy alone, without weight, N/m2, N/m or N."""
    found = np.zeros((len(modes),) * 2)
    for i, one in enumerate(modes):
        shape = geometry.bodies[one.body]
        pivot = inertia_of(case.every_body[one.body], shape, case.body_key(one.body)).pivot
        own = buoyancy_stiffness(shape.region(), geometry.depth, pivot, case.fluid.rho0 * case.g)
        for j, other in enumerate(modes):
            if one.body == other.body:
                found[i, j] = own[MOTIONS.index(one.motion), MOTIONS.index(other.motion)]
    return found


def submerged(region: Any, level: float) -> Any:
    """Part of a region (x, z) (m) below a level (m)."""
    low_x, low_z, high_x, _ = region.bounds
    return region.intersection(shapely.box(low_x, low_z, high_x, max(level, low_z)))


def buoyancy_stiffness(
    region: Any, level: float, pivot: NDArray[np.float64], weight: float
) -> NDArray[np.float64]:
    """Stiffness `[3, 3]` of the buoyancy of a section in surge, heave and pitch about its pivot (x, z) (m).

    `level`: still water level (m); `weight` of the water, rho g (N/m3). C_33 = rho g S_0 (N/m2),
    C_35 = C_53 = -rho g S_1 (N/m) and C_55 = rho g (S_2 + V b) (N), where S_n is the integral of
    (x - x_pivot)^n over the waterline, V the displaced volume per metre of width, and b the height of the
    centre of buoyancy above the pivot (Newman 1977, chapter 6; the pitch is positive from z towards x).
    """
    low_x, _, high_x, _ = region.bounds
    line = region.intersection(shapely.LineString([(low_x - 1.0, level), (high_x + 1.0, level)]))
    S = np.zeros(3)
    for part in (one for one in shapely.get_parts(line) if one.length > 0.0):
        low, high = np.sort(np.array(part.coords)[[0, -1], 0]) - pivot[0]
        S += [(high**n - low**n) / n for n in (1, 2, 3)]
    under, found = submerged(region, level), np.zeros((3, 3))
    found[1, 1] = S[0]
    found[1, 2] = found[2, 1] = -S[1]
    found[2, 2] = S[2] + (under.area * (under.centroid.y - pivot[1]) if under.area else 0.0)
    return weight * found


def inertia_matrix(mass: float, about_centre: float, arm: NDArray[np.float64]) -> NDArray[np.float64]:
    """Inertia matrix `[3, 3]` of surge, heave and pitch about a pivot, kg/m, kg, kg m.

    `mass`: kg/m; `about_centre`: moment of inertia about the centre of mass, kg m; `arm`: (x, z) from the
    pivot to the centre of mass, m. A pitch of theta moves the centre of mass by (z, -x) theta.
    """
    way = np.array([[1.0, 0.0, arm[1]], [0.0, 1.0, -arm[0]], [0.0, 0.0, 1.0]])
    return way.T @ np.diag([mass, mass, about_centre]) @ way


def _pair(point: NDArray[np.float64]) -> tuple[float, float]:
    return float(np.round(point[0], 12)), float(np.round(point[1], 12))
