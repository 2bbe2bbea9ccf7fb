"""Linear theory of one floating body in two dimensions: motions in waves, natural periods, free decay.

The hydrodynamic coefficients are those of `jaxsph.waves.panels`; z = 0 is the still water level. Motions are
surge (m), heave (m) and pitch (rad, from z towards x) of the centre of mass; all values are per metre of
width, and the time factor is exp(-i omega t).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from jaxsph.case.hydrostatics import buoyancy_stiffness, submerged
from jaxsph.waves.panels import MOTIONS, Hull, Hydrodynamics, Section, hydrodynamics

RHO, G = 1000.0, 9.81
Values = NDArray[np.floating]
"""Array of real numbers."""
Points = tuple[tuple[float, float], ...]
"""Positions (x, z), m."""
LOWEST, HIGHEST, NODES = 0.3, 40.0, 60
"""Lowest and highest angular frequency (rad/s), and number of frequencies, of the coefficients that are
interpolated for the motion in time. Added mass and damping are taken as constant outside this range."""


@dataclass(frozen=True)
class Spring:
    """A linear spring without pretension between the body and the tank."""

    on_body: tuple[float, float]
    """Position (x, z) of the spring's end on the body, m."""
    anchor: tuple[float, float]
    """Position (x, z) of the spring's end on the tank, m."""
    stiffness: float
    """Stiffness, N/m."""

    def matrix(self, centre: tuple[float, float]) -> Values:
        """Stiffness matrix `[3, 3]` of the spring for surge, heave and pitch of the body's centre of mass."""
        along = np.subtract(self.on_body, self.anchor)
        along = along / np.hypot(*along)
        x, z = np.subtract(self.on_body, centre)
        extends = np.array([along[0], along[1], z * along[0] - x * along[1]])
        return self.stiffness * np.outer(extends, extends)


@dataclass(frozen=True)
class LinearBody:
    """A body that floats in water of uniform depth, held by springs or free."""

    outline: Points
    """Corners (x, z) of the body's outline at rest, m."""
    depth: float
    """Depth of still water, m."""
    mass: float
    """Mass, kg/m."""
    inertia: float
    """Moment of inertia about the centre of mass, kg m."""
    centre: tuple[float, float]
    """Centre of mass, m."""
    springs: tuple[Spring, ...] = ()

    def water(self, omega: float) -> Hydrodynamics:
        """Added mass, damping and excitation at the angular frequency omega (rad/s)."""
        section = Section(self.depth, (Hull("body", self.outline, self.centre),))
        return hydrodynamics(section, omega, RHO, G)

    @property
    def masses(self) -> Values:
        """Mass matrix `[3, 3]` of the body."""
        return np.diag([self.mass, self.mass, self.inertia])

    @cached_property
    def stiffness(self) -> Values:
        """Stiffness matrix `[3, 3]` of buoyancy and weight, and of the springs."""
        whole = hydrostatic_stiffness(self.outline, self.centre)
        return whole + sum((one.matrix(self.centre) for one in self.springs), np.zeros((3, 3)))

    @property
    def metacentric_height(self) -> float:
        """Metacentric height due to buoyancy and weight, without the springs, m."""
        return float(hydrostatic_stiffness(self.outline, self.centre)[2, 2] / (self.mass * G))

    def raos(self, T: float, damping: Values | None = None) -> NDArray[np.complexfloating]:
        """Complex amplitudes `[3]` of surge, heave and pitch per metre of wave amplitude, at period T (s).

        `damping` `[3, 3]`: damping of a take-off, N s/m.
        """
        omega = 2.0 * np.pi / T
        water = self.water(omega)
        more = np.zeros((3, 3)) if damping is None else damping
        dynamic = self.stiffness - omega**2 * (self.masses + water.added_mass)
        return np.linalg.solve(dynamic - 1j * omega * (water.damping + more), water.excitation)

    def natural_period(self, motion: str) -> float:
        """Undamped natural period of the mode in which a motion has most of the energy, s.

        The added mass is that at the natural frequency.

        **Raises** ValueError if the motion has no restoring force, or if the frequency is not found in 100
        steps.
        """
        at, omega = MOTIONS.index(motion), 5.0
        for _ in range(100):
            total = self.masses + self.water(omega).added_mass
            root = np.linalg.inv(np.linalg.cholesky(total))
            squares, modes = np.linalg.eigh(root @ self.stiffness @ root.T)
            square = float(squares[np.argmax(np.abs(modes[at]))])
            if square <= 0.0:
                raise ValueError(f"{motion} has no restoring force and therefore no natural period")
            if abs(np.sqrt(square) / omega - 1.0) < 1e-4:
                return 2.0 * np.pi / float(np.sqrt(square))
            omega = float(np.sqrt(omega * np.sqrt(square)))
        raise ValueError(f"the natural frequency of {motion} did not converge in 100 steps")

    def decay(self, start: Sequence[float], t: Values) -> Values:
        """Motions `[3, times]` at the times t (s) after a release at rest from the displacements `start`.

        Releasing a body removes the constant force that has held it. The response to such a step is
        (2/pi) int Re H(omega) sin(omega t)/omega d omega, with H the response to a harmonic force.
        """
        omega = np.linspace(1e-3, HIGHEST, 40_000)
        added, damping = self._interpolated(omega)
        square = omega[:, None, None] ** 2
        dynamic = self.stiffness - square * (self.masses + added) - 1j * omega[:, None, None] * damping
        forced = np.linalg.solve(dynamic, (self.stiffness @ start)[None, :, None])[:, :, 0].real
        sines = np.sin(np.outer(omega, t)) / omega[:, None]
        step = 2.0 / np.pi * np.stack([np.trapezoid(f[:, None] * sines, omega, axis=0) for f in forced.T])
        return np.asarray(start)[:, None] - step

    def _interpolated(self, omega: Values) -> tuple[Values, Values]:
        """Added mass and damping `[frequencies, 3, 3]` at the frequencies omega (rad/s)."""
        nodes, found = self._table
        within = np.clip(omega, nodes[0], nodes[-1])
        return tuple(CubicSpline(np.log(nodes), one)(np.log(within)) for one in found)

    @cached_property
    def _table(self) -> tuple[Values, tuple[Values, Values]]:
        """Angular frequencies (rad/s), and the added mass and damping at these frequencies."""
        nodes = np.geomspace(LOWEST, HIGHEST, NODES)
        water = [self.water(float(one)) for one in nodes]
        return nodes, (np.stack([w.added_mass for w in water]), np.stack([w.damping for w in water]))


def hydrostatic_stiffness(outline: Points, centre: tuple[float, float]) -> Values:
    """Hydrostatic stiffness `[3, 3]` of a body whose weight equals its buoyancy and acts at `centre` (m).

    For a body that does not float freely, give its pivot as `centre`: the matrix is then that of the
    buoyancy alone.
    """
    return buoyancy_stiffness(shapely.Polygon(outline), 0.0, np.asarray(centre), RHO * G)


def displaced(outline: Points) -> float:
    """Mass of the water that an outline (m) displaces with the still water level at z = 0, kg/m."""
    return RHO * submerged(shapely.Polygon(outline), 0.0).area


def box_outline(width: float, draught: float, height: float, bilge: float = 0.0, sides: int = 8) -> Points:
    """Outline of an upright box about x = 0, m; its lower corners are rounded by arcs of the radius `bilge`.

    An arc is a polyline of `sides` sides.
    """
    half, turns = 0.5 * width, 0.5 * np.pi * np.arange(sides + 1 if bilge else 1) / sides
    left = [(bilge - half - bilge * np.cos(a), bilge - draught - bilge * np.sin(a)) for a in turns]
    right = [(-x, z) for x, z in reversed(left)]
    top = [(half, height - draught), (-half, height - draught)]
    return tuple((float(x), float(z)) for x, z in (*left, *right, *top))


def disc_outline(radius: float, sides: int = 120) -> Points:
    """Outline of a half-immersed circular cylinder about (0, 0): a polygon of the circle's area, m."""
    angle = 2.0 * np.pi * np.arange(sides) / sides
    radius *= float(np.sqrt(2.0 * np.pi / sides / np.sin(2.0 * np.pi / sides)))
    return tuple((float(radius * np.cos(a)), float(radius * np.sin(a))) for a in angle)
