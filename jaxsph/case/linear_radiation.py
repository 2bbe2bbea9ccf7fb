"""Added mass, damping and excitation of a case's bodies by linear theory (see `waves.panels`)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from jaxsph.analysis.coefficients import LinearCoefficients, Mode
from jaxsph.case.geometry import Geometry
from jaxsph.case.sections import Sections
from jaxsph.case.shapes import inertia_of
from jaxsph.waves.panels import Hull, Section, hydrodynamics

FINE = 2e-3
"""Largest distance of a curved outline from its hull's straight sides, divided by the outline's height."""


def linear_coefficients(
    case: Sections, modes: Sequence[Mode], omega: ArrayLike, x: float
) -> LinearCoefficients | None:
    """Coefficients of a two-dimensional case over frequencies omega (rad/s) by linear theory; None if the
    theory does not cover the tank.

    Phases are relative to the waves at `x` (m from the paddle). The bed must be flat; a solid that reaches an
    end of the tank would change the depth there, and is not covered. Waves leave the tank at both ends or,
    without a sponge, at the paddle only.
    """
    geometry = Geometry.of(case)
    for shape in geometry.solids.values():
        low, high = shape.bounds()
        if low[0] <= 0.0 or high[0] >= geometry.length:
            return None
    origin, hulls = np.array([x, geometry.depth]), []
    for name, shape in geometry.shapes.items():
        height = float(np.ptp(np.stack(shape.bounds()), axis=0)[1])
        outline = shape.region().simplify(FINE * height).exterior.coords[:-1] - origin
        pivot = origin
        if name in geometry.bodies:
            pivot = inertia_of(case.every_body[name], shape, case.body_key(name)).pivot
        hulls.append(Hull(name, tuple(map(tuple, outline)), tuple(pivot - origin)))
    end = None if case.sponge is not None else geometry.length - x
    try:
        section = Section(geometry.depth, tuple(hulls), end)
        found = [hydrodynamics(section, float(one), case.fluid.rho0, case.g) for one in np.atleast_1d(omega)]
    except ValueError:  # hulls that touch or overlap
        return None
    at = [found[0].index(*mode) for mode in modes]
    both = np.ix_(at, at)
    return LinearCoefficients(
        A=np.stack([one.added_mass[both] for one in found]),
        B=np.stack([one.damping[both] for one in found]),
        # the theory's time factor is exp(-i omega t)
        X=np.stack([np.conj(one.excitation[at]) for one in found]),
    )
