"""Fast model of an onshore oscillating water column in regular waves: linear theory with a loss, in JAX.

The flow of air q out of the chamber and its pressure p follow from the equations of `waves.linear_owc`, with
two additions: the head lost at the lip, zeta rho |v| v / 2 with the column's velocity v = q / b, which acts
beside compressible air too, and an additional length of the column, which stands for inertia that the theory
lacks. Neither is known beforehand; both are found from runs of the water (`study.fast_model`).

The water's response is solved once at several frequencies and lengths of the chamber (`WaterSeries.of`, on
the host) and interpolated, so that an answer takes a fraction of a millisecond and can be differentiated with
respect to the waves, the damping and the chamber.
"""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.core.roots import increasing_root
from jaxsph.waves import theory
from jaxsph.waves.radiation import ChamberGeometry, radiation_and_scattering

LENGTHS = ("draught", "length", "thickness")
"""Lengths of a `ChamberGeometry` that may change."""
SHARE = 0.1
"""Change of each length at which the water's response is solved besides the given one, relative to it (-)."""
NODES = 16
"""Number of frequencies at which the water's response is solved."""

_EQUAL = 8.0 / (3.0 * math.pi)
"""Ratio of the resistance with the same mean power to that of a quadratic law at the flow's amplitude (-)."""
BEYOND = 100.0
"""Bound of the flow through the turbine, relative to that of an open chamber in linear theory (-)."""


class WaterSeries(eqx.Module):
    """Response of the water to waves and to air pressure, over the frequency and the lengths of the chamber.

    Chebyshev series of the frequency; a parabola through three values of each length, whose changes add up.
    """

    coefficients: Float[Array, "V C 4"]
    """Coefficients of the series for each set of lengths: the given ones, then each length of `LENGTHS`
    reduced and increased; for the real and imaginary parts of 1 / q_R (1/m) and q_S / q_R (1/s)."""
    omega: tuple[float, float] = eqx.field(static=True)
    """Least and largest angular frequency, rad/s."""
    geometry: ChamberGeometry = eqx.field(static=True)
    """The given lengths, m."""
    g: float = eqx.field(static=True, default=theory.GRAVITY)
    """Acceleration of gravity, m/s2."""

    @classmethod
    def of(cls, geometry: ChamberGeometry, T: tuple[float, float], g: float = theory.GRAVITY) -> WaterSeries:
        """Series for wave periods T from the first to the second (s); solves some 200 flows in seconds."""
        low, high = (2.0 * math.pi / one for one in reversed(T))
        places = np.cos(np.pi * (np.arange(NODES) + 0.5) / NODES)
        nodes = 0.5 * (low + high) + 0.5 * (high - low) * places
        basis = np.cos(np.arange(NODES)[:, None] * np.arccos(places)) * (2.0 / NODES)
        basis[0] *= 0.5
        found = [basis @ _responses(one, nodes, g) for one in _around(geometry)]
        return cls(jnp.asarray(np.array(found), jnp.float32), (low, high), geometry, g)

    def at(self, omega: Scalar, lengths: dict[str, Scalar]) -> tuple[Array, Array]:
        """Complex flows q_R (m) and q_S (m/s) at an angular frequency (rad/s).

        `lengths`: lengths that differ from the given ones, m, by the names in `LENGTHS`.
        """
        low, high = self.omega
        x = (2.0 * omega - low - high) / (high - low)
        before, last = jnp.zeros(self.coefficients[:, 0].shape), jnp.zeros(self.coefficients[:, 0].shape)
        for k in range(NODES - 1, 0, -1):  # Clenshaw's recurrence
            before, last = last, 2.0 * x * last - before + self.coefficients[:, k]
        values = x * last - before + self.coefficients[:, 0]
        found = values[0]
        for k, name in enumerate(LENGTHS):
            usual, less, more = getattr(self.geometry, name), values[1 + 2 * k], values[2 + 2 * k]
            step = SHARE * usual
            s = (lengths.get(name, usual) - usual) / step if step else 0.0
            found = found + 0.5 * s * (more - less) + 0.5 * s * s * (more - 2.0 * values[0] + less)
        q_R = 1.0 / (found[0] + 1j * found[1])
        return q_R, q_R * (found[2] + 1j * found[3])


def _around(geometry: ChamberGeometry) -> list[ChamberGeometry]:
    """The given lengths, and those with each of `LENGTHS` reduced and increased."""
    found = [geometry]
    for name in LENGTHS:
        for change in (-SHARE, SHARE):
            found.append(dataclasses.replace(geometry, **{name: getattr(geometry, name) * (1.0 + change)}))
    return found


def _responses(geometry: ChamberGeometry, omega: np.ndarray, g: float) -> np.ndarray:
    """Real and imaginary parts of 1 / q_R and q_S / q_R at each frequency, `[C, 4]`.

    These are proportional to the column's impedance and the waves' force, which have no peak at resonance.
    """
    found = [radiation_and_scattering(geometry, float(one), g) for one in omega]
    ratios = [(1.0 / a.q_R, a.q_S / a.q_R) for a in found]
    return np.array([[a.real, a.imag, b.real, b.imag] for a, b in ratios])


class Additions(NamedTuple):
    """What linear theory of a column lacks; with zeros the model is linear theory."""

    lip: Scalar | float = 0.0
    """Coefficient zeta of the head lost at the lip, referred to the column's velocity (-)."""
    length: Scalar | float = 0.0
    """Additional length of the column, relative to the draught (-)."""


class Response(NamedTuple):
    """Response of an oscillating water column to regular waves, per metre of width."""

    xi: Array
    """Hydrodynamic efficiency (-)."""
    P_owc: Array
    """Mean absorbed power, W/m."""
    P_inc: Array
    """Mean incident power, W/m."""
    flow: Array
    """Amplitude of the flow of air out of the chamber, m2/s."""
    P_a: Array
    """Amplitude of the air's pressure at the waves' frequency, Pa."""
    level: Array
    """Amplitude of the column's mean elevation, m."""
    P_lost: Array
    """Mean power lost in the column, W/m."""


class Air(NamedTuple):
    """Quadratic and linear resistance of a turbine, and compliance of the air in the chamber."""

    K_dm: ArrayLike
    """Damping coefficient of the quadratic law, kg^0.5 m^-2.5."""
    resistance: ArrayLike = 0.0
    """Resistance of a linear turbine, Pa s/m2."""
    give: ArrayLike = 0.0
    """Compliance of the air, m2/Pa."""


def fast_response(
    water: WaterSeries,
    added: Additions,
    air: Air,
    H: Scalar,
    T: Scalar,
    lengths: dict[str, Scalar],
    rho0: float,
) -> Response:
    """Response of a column to regular waves of height H (m) and period T (s).

    Quadratic laws are replaced by linear ones that take the same mean power from a sinusoidal flow.
    `lengths`: lengths of the chamber that differ from those of the series, m, by the names in `LENGTHS`;
    `rho0`: density, kg/m3.
    """
    omega, g = 2.0 * jnp.pi / T, water.g
    q_R, q_S = water.at(omega, lengths)
    usual = {name: getattr(water.geometry, name) for name in LENGTHS}
    b, a = ((usual | lengths)[name] for name in ("length", "draught"))
    circuit = _Circuit(
        drive=0.5 * H * q_S,
        Z=-1j * omega / (rho0 * g) * q_R,
        inertia=-1j * omega * rho0 * added.length * a / b,
        lip=jnp.asarray(_EQUAL * 0.5 * rho0 * added.lip / b**2),
        resistance=jnp.asarray(air.resistance, jnp.float32),
        turbine=_EQUAL * jnp.asarray(air.K_dm) ** 2,
        softness=1j * omega * air.give,
    )
    most = BEYOND * jnp.abs(circuit.drive)
    size = increasing_root(_Circuit.excess, jnp.zeros_like(most), most, circuit)
    of_turbine, ratio, column = circuit.resistances(size)
    flow = size * jnp.abs(ratio)
    P_owc = 0.5 * of_turbine * size**2
    P_inc = theory.incident_power(H, T, water.geometry.depth, rho0, g)
    return Response(
        xi=P_owc / P_inc,
        P_owc=P_owc,
        P_inc=P_inc,
        flow=flow,
        P_a=of_turbine * size,
        level=flow / (omega * b),
        P_lost=0.5 * jnp.real(column) * flow**2,
    )


class _Circuit(NamedTuple):
    """Water, column, air and turbine at one frequency, as resistances to the flow of air."""

    drive: Array
    """Flow of an open chamber without losses, m2/s."""
    Z: Array
    """Admittance of the water, m2/(s Pa)."""
    inertia: Array
    """Pressure that accelerates the additional length of the column, per flow, Pa s/m2."""
    lip: Array
    """Resistance of the lip per unit of the column's flow, Pa s2/m4."""
    resistance: Array
    """Linear resistance of the turbine, Pa s/m2."""
    turbine: Array
    """Quadratic resistance of the turbine per unit of its flow, Pa s2/m4."""
    softness: Array
    """Admittance of the air, m2/(s Pa)."""

    def resistances(self, size: Array) -> tuple[Array, Array, Array]:
        """Turbine's resistance, ratio of the column's flow to the turbine's, and the column's resistance.

        `size`: amplitude of the flow through the turbine, m2/s.
        """
        of_turbine = self.resistance + self.turbine * size
        ratio = 1.0 - self.softness * of_turbine
        return of_turbine, ratio, self.inertia + self.lip * size * jnp.abs(ratio)

    @staticmethod
    def excess(size: Array, circuit: _Circuit) -> Array:
        """Flow of an open chamber that a flow of this size through the turbine needs, minus the drive."""
        of_turbine, ratio, column = circuit.resistances(size)
        needed = ratio * (1.0 + circuit.Z * column) + circuit.Z * of_turbine
        return size * jnp.abs(needed) - jnp.abs(circuit.drive)
