"""Linear response of jointed bodies with links and chambers to regular waves.

The unknowns xi are the amplitudes of small changes of the joints' coordinates from equilibrium. The Jacobian
J gives the velocities v of all hulls from the coordinates' rates. With the symbols of `waves.panels`, the
mass matrix M, the stiffness K of weight, buoyancy and links, the damping C of the links and an incident
amplitude a,

    (-omega^2 M + K - i omega (C + J^T (B - i omega A) J)) xi - J^T P p = J^T X a,
    q = S a - i omega T J xi - Z p,    q_t = q + i omega c p,    p = r q_t,

where c is the compliance of a chamber's air, q_t its turbine's flow and r its turbine's resistance. Forces
of links and turbines that are nonlinear in the rate are replaced by the linear force that absorbs the same
mean power in a sinusoidal motion of the computed amplitude (equivalent linearisation). A complex amplitude a
stands for Re(a exp(-i omega t)), with the incident crest at x = 0 at t = 0. All values are per metre of
width. The module uses numpy on the host in double precision.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jaxsph.waves.panels import Hydrodynamics
from jaxsph.waves.radiation import group_velocity

__all__ = ["Compliance", "Damping", "LinearBodies", "SmallMotion", "linear_motion"]

PHASES = 256
"""Number of phases in a period at which a force is evaluated for its equivalent linearisation."""
MOST = 500
"""Largest number of iterations of the equivalent linearisation."""
EXACT = 1e-8
"""Relative change of the amplitudes below which the iteration ends."""

Real = NDArray[Any]
"""Array of real numbers."""
Complex = NDArray[Any]
"""Array of complex numbers."""


@dataclass(frozen=True)
class Damping:
    """Force of a link that depends on the rate of the link's extension."""

    way: Real
    """Change of the extension per unit change of each of the n coordinates `[n]`."""
    force: Callable[[Real], Real]
    """Force (N or N m), positive if it increases the extension, as a function of rates `[K]` (m/s or
    rad/s)."""

    def linearised(self, speed: float) -> float:
        """Damping (N s/m or N m s) that absorbs the same mean power at a sinusoidal rate of the amplitude
        `speed` (m/s or rad/s)."""
        turn = np.cos(2.0 * np.pi * (np.arange(PHASES) + 0.5) / PHASES)
        speed = max(speed, 1e-9)
        return float(-2.0 * np.mean(self.force(speed * turn) * turn) / speed)


@dataclass(frozen=True)
class Compliance:
    """Turbine and air of a chamber: p = (resistance + K_dm^2 |q_t|) q_t."""

    resistance: float = 0.0
    """Resistance of a linear turbine, Pa s/m2."""
    K_dm: float = 0.0
    """Damping coefficient K_dm of the quadratic law, kg^0.5 m^-2.5."""
    give: float = 0.0
    """Compliance of the air, m2/Pa; 0 for incompressible air."""

    def linearised(self, flow: float) -> float:
        """Resistance (Pa s/m2) that absorbs the same mean power in a sinusoidal flow (amplitude in m2/s)."""
        return self.resistance + 8.0 / (3.0 * np.pi) * self.K_dm**2 * flow


@dataclass(frozen=True)
class SmallMotion:
    """Equations of small motions of jointed bodies about equilibrium in still water, in n coordinates."""

    mass: Real
    """Mass matrix `[n, n]`, kg, kg m or kg m2 per metre of width."""
    stiffness: Real
    """Stiffness `[n, n]` of weight, buoyancy and links, N/m, N or N m per metre of width."""
    damping: Real
    """Damping `[n, n]` of the links with linear forces, N s/m, N s or N m s per metre of width."""
    jacobian: Real
    """Velocities of the hulls `[m, n]`, as in `Hydrodynamics`, per unit rate of the coordinates."""
    dampings: tuple[Damping, ...] = ()
    """Rate-dependent forces of the links, each along one extension."""
    chambers: tuple[Compliance, ...] = ()
    """Turbines and air of the chambers, in the order of the section."""


@dataclass(frozen=True, eq=False)
class LinearBodies:
    """Linear response of bodies to a regular wave, as complex amplitudes."""

    water: Hydrodynamics
    """Radiation and diffraction at the wave's frequency."""
    H: float
    """Incident wave height, m."""
    coordinates: Complex
    """Changes of the n free coordinates from equilibrium, m or rad."""
    motions: Complex
    """Surge (m), heave (m) and pitch (rad) of every hull `[m]`."""
    extensions: Complex
    """Extensions of the links in `SmallMotion.dampings`, m or rad."""
    dampings: Real
    """Equivalent linear damping of these links, N s/m or N m s."""
    link_power: Real
    """Mean power absorbed by each of these links, W/m."""
    q: Complex
    """Flow of air out of every chamber, relative to the hull that carries it, m2/s."""
    q_pto: Complex
    """Flow through every turbine, m2/s."""
    P_a: Complex
    """Gauge pressure of every chamber, Pa."""
    chamber_power: Real
    """Mean power absorbed by every turbine, W/m."""
    R: complex
    """Reflected wave per unit incident wave, at x = 0 (-)."""
    transmitted: complex
    """Transmitted wave per unit incident wave, at x = 0 (-)."""

    @property
    def P_inc(self) -> float:
        """Mean incident power, W/m."""
        c_g = group_velocity(self.water.omega, self.water.k, self.water.section.depth)
        return float(0.125 * self.water.rho * self.water.g * c_g * self.H**2)


def linear_motion(water: Hydrodynamics, bodies: SmallMotion, H: float) -> LinearBodies:
    """Linear response of bodies to a regular wave of height H (m, > 0).

    **Raises** ValueError if the sizes of arrays do not match or H is not positive, and if the equivalent
    linearisation does not converge.
    """
    hulls, chambers = len(water.excitation), len(water.scattered_flow)
    if not H > 0.0:
        raise ValueError(f"H = {H} m must be positive")
    if bodies.jacobian.shape[0] != hulls or len(bodies.chambers) != chambers:
        raise ValueError(
            f"jacobian has {bodies.jacobian.shape[0]} rows and chambers has {len(bodies.chambers)} entries: "
            f"give {hulls} rows, one for each motion of the section, and {chambers} entries, one for each "
            "chamber"
        )
    ways = np.reshape([one.way for one in bodies.dampings], (len(bodies.dampings), len(bodies.mass)))
    sizes = np.full(len(ways) + chambers, 0.1 * H * water.omega)
    for _ in range(MOST):
        damping = np.array([one.linearised(v) for one, v in zip(bodies.dampings, sizes, strict=False)])
        flows = zip(bodies.chambers, sizes[len(ways) :], strict=True)
        resistance = np.array([one.linearised(q) for one, q in flows])
        xi, q_pto = _solved(water, bodies, 0.5 * H, ways.T @ (damping[:, None] * ways), resistance)
        after = np.abs(np.concatenate([water.omega * (ways @ xi), q_pto]))
        if np.all(np.abs(after - sizes) <= EXACT * (sizes + 1e-9)):
            return _response(water, bodies, H, ways, xi, q_pto, damping, resistance)
        # the amplitude falls as the equivalent damping rises, so that the geometric mean of the old and the
        # new amplitude converges
        sizes = np.sqrt(np.maximum(after, 1e-12) * np.maximum(sizes, 1e-12))
    raise ValueError(
        f"the equivalent linearisation of the links and turbines does not converge at H = {H:g} m: use a "
        "smaller wave height"
    )


def _solved(
    water: Hydrodynamics, bodies: SmallMotion, a: float, damping: Real, resistance: Real
) -> tuple[Complex, Complex]:
    """Coordinates (m or rad) and flows of the turbines (m2/s) for the incident amplitude a (m).

    `damping`: equivalent damping `[n, n]` of the links; `resistance` (Pa s/m2) of the turbines.
    """
    J, omega, n = bodies.jacobian, water.omega, len(bodies.mass)
    give = np.array([one.give for one in bodies.chambers])
    radiation = J.T @ water.impedance @ J
    moved = -(omega**2) * bodies.mass + bodies.stiffness
    moved = moved - 1j * omega * (bodies.damping + damping + radiation)
    through = np.eye(len(give)) + (water.admittance - 1j * omega * np.diag(give)) * resistance
    matrix = np.block(
        [[moved, -(J.T @ water.pressure_force) * resistance], [1j * omega * (water.motion_flow @ J), through]]
    )
    given = np.concatenate([J.T @ water.excitation, water.scattered_flow]) * a
    found = np.linalg.solve(matrix, given)
    return found[:n], found[n:]


def _response(
    water: Hydrodynamics,
    bodies: SmallMotion,
    H: float,
    ways: Real,
    xi: Complex,
    q_pto: Complex,
    damping: Real,
    resistance: Real,
) -> LinearBodies:
    """Response of the bodies, from the solution of the linear equations."""
    P_a = resistance * q_pto
    give = np.array([one.give for one in bodies.chambers])
    motions = bodies.jacobian @ xi
    sent = water.radiated @ np.concatenate([-1j * water.omega * motions, P_a]) / (0.5 * H)
    extensions = ways @ xi
    return LinearBodies(
        water,
        H,
        coordinates=xi,
        motions=motions,
        extensions=extensions,
        dampings=damping,
        link_power=0.5 * damping * np.abs(water.omega * extensions) ** 2,
        q=q_pto - 1j * water.omega * give * P_a,
        q_pto=q_pto,
        P_a=P_a,
        chamber_power=0.5 * resistance * np.abs(q_pto) ** 2,
        R=complex(water.reflection + sent[0]),
        transmitted=complex(water.transmission + sent[1]),
    )
