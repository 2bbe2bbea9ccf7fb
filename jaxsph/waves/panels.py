"""Radiation and diffraction of regular waves by hulls and chambers in two dimensions, by a panel method.

The flow is a linear potential flow over a flat bed, around any number of floating, submerged or fixed hulls
of any shape, with chambers of air on the free surface. The conventions are those of `waves.radiation`: the
time factor is exp(-i omega t), z = 0 is the still water level, and q is the flow of AIR OUT of a chamber, per
metre of width. The incident wave travels towards +x and has its crest at x = 0 at t = 0. The module uses
numpy on the host in double precision; no function is traced.

The generalised velocities v are surge, heave and pitch of every hull about its pivot, and p are the gauge
pressures of the chambers. For the incident amplitude a, the forces F of the water and of the chambers' air on
the hulls, and the flows q, are

    F = X a - (B - i omega A) v + P p,    q = S a + T v - Z p,

where F excludes the hydrostatic restoring forces. By reciprocity, A, B and Z are symmetric and P = -T^T. The
real part of Z is positive semidefinite.

Method: Green's identity on the boundary of the water, with mirror images at the bed and the end wall, gives
the potential on the boundary. On every straight panel the potential is a polynomial, collocated at Gauss
points, and all integrals over panels near a point are exact (see `waves.boundary`). Panels become smaller
towards corners in geometric progression. At the radiating ends, half a depth away from the hulls, the
potential is matched to outgoing and evanescent modes, so that the radiation condition is exact. The equation
has no irregular frequencies. Source of the integral equation: J. V. Wehausen and E. V. Laitone, Surface
waves, Handbuch der Physik 9 (1960) 446-778, section 17; J. N. Newman, Marine Hydrodynamics (1977), sections
6.15 to 6.18 for the relations between excitation forces, damping and radiated waves.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jaxsph.waves import theory
from jaxsph.waves.boundary import Boundary, Resolution
from jaxsph.waves.radiation import evanescent, propagating
from jaxsph.waves.section import RADIATING, Chamber, Hull, Section

__all__ = ["MOTIONS", "Chamber", "Hull", "Hydrodynamics", "Section", "hydrodynamics"]

MOTIONS = ("surge", "heave", "pitch")
"""Motions of every hull, in order. Pitch is positive from z towards x: it moves a point at (x, z) relative
to the pivot by (z, -x) per radian."""

Complex = NDArray[Any]
"""Array of complex numbers."""

MODES = 12
"""Number of evanescent modes that are matched at a radiating end. The next mode decays by a factor of
exp(-20) between the nearest hull and the end."""


@dataclass(frozen=True, eq=False)
class Hydrodynamics:
    """Radiation and diffraction of waves by a section at one frequency.

    The m generalised motions are surge, heave and pitch of the first hull, then of the second hull, and so
    on; the c chambers are in the order of the section. All forces and flows are per metre of width.
    """

    section: Section
    omega: float
    """Angular frequency, rad/s."""
    rho: float
    """Density of the water, kg/m3."""
    g: float
    """Acceleration of gravity, m/s2."""
    k: float
    """Wavenumber, rad/m."""
    added_mass: NDArray[np.floating]
    """Added mass A `[m, m]`, kg/m (kg and kg m for pitch)."""
    damping: NDArray[np.floating]
    """Radiation damping B `[m, m]`, N s/m2 (N s/m and N s for pitch)."""
    excitation: Complex
    """Exciting force X `[m]` per metre of incident amplitude, N/m2 (N/m for pitch)."""
    pressure_force: Complex
    """Force P `[m, c]` on the hulls per unit pressure of a chamber, m (m2 for pitch); for a chamber that a
    hull carries, this includes the force on its roof and walls."""
    scattered_flow: Complex
    """Flow of air S `[c]` out of open chambers per metre of incident amplitude, with fixed hulls, m/s."""
    motion_flow: Complex
    """Flow of air T `[c, m]` out of open chambers per unit velocity, m (m2 for pitch); relative to the
    hull that carries the chamber."""
    admittance: Complex
    """Radiation admittance Z `[c, c]`: flow of air into a chamber per unit pressure, m2/(s Pa)."""
    reflection: complex
    """Reflected wave per unit incident wave, with fixed hulls and open chambers, at x = 0 (-)."""
    transmission: complex
    """Transmitted wave per unit incident wave, with fixed hulls and open chambers, at x = 0 (-)."""
    radiated: Complex
    """Amplitudes `[2, m + c]` of the waves to the left and to the right, relative to x = 0, per unit velocity
    of a motion (s; m s for pitch) and per unit pressure of a chamber (m/Pa)."""

    def index(self, hull: str, motion: str) -> int:
        """Index of the motion "surge", "heave" or "pitch" of a hull among the m motions."""
        names = [one.name for one in self.section.hulls]
        return 3 * names.index(hull) + MOTIONS.index(motion)

    @property
    def impedance(self) -> Complex:
        """Radiation impedance B - i omega A `[m, m]`: force opposing the motion, per unit velocity."""
        return self.damping - 1j * self.omega * self.added_mass


def hydrodynamics(
    section: Section, omega: float, rho: float = 1000.0, g: float = theory.GRAVITY
) -> Hydrodynamics:
    """Radiation and diffraction of waves by a section at the angular frequency `omega` (rad/s, > 0).

    A call takes a few tenths of a second; results are cached. `rho`: density, kg/m3; `g`: gravity, m/s2.
    **Raises** ValueError if a number is not positive, and in the cases given at `waves.section.edges`.
    """
    if not (omega > 0.0 and rho > 0.0 and g > 0.0):
        raise ValueError(f"omega = {omega}, rho = {rho} and g = {g} must be positive")
    return _solved(section, float(omega), float(rho), float(g), Resolution())


@lru_cache(maxsize=512)
def _solved(section: Section, omega: float, rho: float, g: float, resolution: Resolution) -> Hydrodynamics:
    """Radiation and diffraction as in `hydrodynamics`, with a given resolution of the boundary."""
    K = omega**2 / g
    k = propagating(K * section.depth) / section.depth
    boundary = Boundary.of(section, k, resolution)
    ends = _radiating(section, boundary, omega, k, g)
    incident, slope = _incident(section, boundary, omega, k, g)
    hulls = _motions(section, boundary)
    roofs = np.reshape([boundary.owner == one.name for one in section.chambers], (-1, len(slope))) * 1.0
    dry = np.isin(boundary.owner, [hull.name for hull in section.hulls])
    m, c = len(hulls), len(roofs)
    # unit velocities of hulls, unit pressures of chambers, and minus the incident wave's velocity on hulls
    given = np.concatenate([hulls, 1j * omega / (rho * g) * roofs, [-slope * dry]]).T
    phi = _potential(boundary, dry, ends, K, given)
    force, flow = 1j * omega * rho * hulls * boundary.weight, roofs * boundary.weight
    by_motion, carried = force @ phi[:, :m], _carried(section)
    waves = np.zeros((2, m + c + 1), complex)
    for side, end in enumerate(ends):
        waves[side] = end.onto @ phi[end.rows]
    there, wall = 1.0 + waves[1, -1], 0j
    for x in section.walls:
        there, wall = 0j, np.exp(2j * k * x)
    return Hydrodynamics(
        section,
        omega,
        rho,
        g,
        k,
        added_mass=by_motion.imag / omega,
        damping=-by_motion.real,
        excitation=force @ (phi[:, -1] + incident),
        pressure_force=force @ phi[:, m:-1] + carried,
        scattered_flow=K * (flow @ (phi[:, -1] + incident)),
        motion_flow=K * (flow @ phi[:, :m]) - carried.T,
        admittance=-K * (flow @ phi[:, m:-1]) - 1j * omega / (rho * g) * np.diag(flow.sum(axis=1)),
        reflection=complex(waves[0, -1] + wall),
        transmission=complex(there),
        radiated=waves[:, :-1],
    )


class _End(NamedTuple):
    """Radiating end of a section."""

    rows: NDArray[np.integer]
    """Nodes at the end."""
    relation: Complex
    """Matrix from the potential at these nodes to the velocity out of the section, 1/m."""
    onto: Complex
    """Weights with which the potential at these nodes sums to the outgoing wave's amplitude at x = 0, s/m."""


def _radiating(section: Section, boundary: Boundary, omega: float, k: float, g: float) -> list[_End]:
    """Radiating ends, left and right, with an outgoing wave of wavenumber k (rad/m) and evanescent modes."""
    h, found = section.depth, []
    roots = evanescent(omega**2 / g * h, MODES)
    norm = np.sqrt(0.5 * (1.0 + np.sin(2.0 * roots) / (2.0 * roots)))
    rates = np.concatenate([[1j * k], -roots / h])
    sides = (-1.0,) if section.walls else (-1.0, 1.0)
    for side, x in zip(sides, section.ends, strict=False):
        rows = np.flatnonzero((boundary.owner == RADIATING) & (np.abs(boundary.x[:, 0] - x) < 1e-6 * h))
        z = boundary.x[rows, 1]
        evanescent_modes = np.cos(roots[:, None] * (z / h + 1.0)) / norm[:, None]
        modes = np.concatenate([_wave(z, k, h)[None], evanescent_modes]).astype(complex)
        onto = modes * boundary.weight[rows] / h
        elevation = 1j * omega / g * _wave(np.zeros(1), k, h) * np.exp(-1j * side * k * x)
        found.append(_End(rows, modes.T @ (rates[:, None] * onto), elevation * onto[0]))
    return found


def _wave(z: NDArray, k: float, h: float) -> NDArray[np.floating]:
    """Mode cosh k(z + h) of the propagating wave at z (m), with a mean square of 1 over the depth h (m)."""
    norm = 0.5 * (np.exp(-2.0 * k * h) - np.expm1(-4.0 * k * h) / (4.0 * k * h))
    return 0.5 * (np.exp(k * z) + np.exp(-k * (z + 2.0 * h))) / np.sqrt(norm)


def _potential(boundary: Boundary, dry: NDArray, ends: list[_End], K: float, given: NDArray) -> NDArray:
    """Potentials `[N, r]` at the nodes, for the `given` parts `[N, r]` of the velocity out of the water.

    The velocity is `given` on hulls (nodes in the mask `dry`), and K phi + `given` on the surface. At the
    radiating ends the velocity follows from the potential.
    """
    source = boundary.source
    matrix = (np.pi * np.eye(len(source)) - boundary.dipole).astype(complex)
    surface = ~dry & (boundary.owner != RADIATING)
    matrix[:, surface] += K * source[:, surface]
    for end in ends:
        matrix[:, end.rows] += source[:, end.rows] @ end.relation
    return np.linalg.solve(matrix, -source @ given)


def _incident(
    section: Section, boundary: Boundary, omega: float, k: float, g: float
) -> tuple[NDArray, NDArray]:
    """Potential (m2/s) and normal velocity out of the water (m/s) at the nodes, for an incident wave of unit
    amplitude and its reflection from the end wall."""
    x, z = boundary.x.T
    shape = -1j * g / omega / _wave(np.zeros(1), k, section.depth)
    # d/dz of the mode is k times the mode with the opposite sign of the second exponential
    down = _wave(z, k, section.depth)
    rise = k * np.tanh(k * (z + section.depth)) * down
    there, back = np.exp(1j * k * x), np.zeros(len(x))
    for wall in section.walls:
        back = np.exp(1j * k * (2.0 * wall - x))
    along, up = 1j * k * (there - back) * down, (there + back) * rise
    return shape * (there + back) * down, shape * (along * boundary.normal[:, 0] + up * boundary.normal[:, 1])


def _motions(section: Section, boundary: Boundary) -> NDArray[np.floating]:
    """Normal velocities `[m, N]` at the nodes per unit velocity of every hull's surge, heave and pitch."""
    found = []
    for hull in section.hulls:
        own = (boundary.owner == hull.name)[:, None] * boundary.normal
        arm = boundary.x - hull.pivot
        found += [own[:, 0], own[:, 1], arm[:, 1] * own[:, 0] - arm[:, 0] * own[:, 1]]
    return np.reshape(found, (-1, len(boundary.x)))


def _carried(section: Section) -> NDArray[np.floating]:
    """Force `[m, c]`, per unit pressure of a chamber, on the hull that carries the chamber, m (m2 for pitch).

    This force is the negative of the air's force on the water surface.
    """
    found = np.zeros((3 * len(section.hulls), len(section.chambers)))
    names = [hull.name for hull in section.hulls]
    for column, one in enumerate(section.chambers):
        if one.hull:
            row = 3 * names.index(one.hull)
            length, middle = one.last - one.first, 0.5 * (one.first + one.last)
            found[row + 1, column] = length
            found[row + 2, column] = -length * (middle - section.hulls[names.index(one.hull)].pivot[0])
    return found
