"""Fast model of an onshore oscillating water column in waves: linear theory with a loss, in JAX.

The flow of air q out of the chamber and its pressure p follow, for each wave of a sea, from the equations of
`waves.linear_owc`, with two additions: the head lost at the lip, zeta rho |v| v / 2 with the column's
velocity v = q / b, which acts beside compressible air too, and an additional length of the column, which
stands for inertia that the theory lacks. Neither is known beforehand; both are found from runs of the water
(`study.fast_model`).

Quadratic laws are replaced by linear ones that take the same mean power, from a sinusoidal flow in regular
waves, from a Gaussian flow in a sea (`waves.linear_sea`).

The water's response is solved once at several frequencies and lengths of the chamber (`WaterSeries.of`, on
the host) and interpolated, so that an answer takes a fraction of a millisecond and can be differentiated with
respect to the waves, the damping and the chamber.
"""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.core.chebyshev import Series
from jaxsph.core.roots import fixed_point
from jaxsph.waves import theory
from jaxsph.waves.radiation import ChamberGeometry, radiation_and_scattering
from jaxsph.waves.spectra import HIGHEST, LOWEST, AbstractSpectrum

LENGTHS = ("draught", "length", "thickness")
"""Lengths of a `ChamberGeometry` that may change."""
SHARE = 0.1
"""Change of each length at which the water's response is solved besides the given one, relative to it (-)."""
TINY = 1e-24
"""Square of a size at which its square root is still differentiable."""
COMPONENTS = 93
"""Number of waves of a sea."""
ITERATIONS = 26
"""Number of iterations for the flow; each at least halves its error, to 2e-8."""


class WaterSeries(eqx.Module):
    """Response of the water to waves and to air pressure, over the frequency and the lengths of the chamber.

    Chebyshev series of the frequency in each range of frequencies; a parabola through three values of each
    length, whose changes add up.
    """

    series: Series
    """Series over the angular frequency (rad/s) of the real and imaginary parts of 1 / q_R (1/m) and of
    q_S / q_R (1/s), `[V, 4]`, for each set of lengths: the given ones, then each length of `LENGTHS` reduced
    and increased."""
    lengths: dict[str, float]
    """The given lengths of `LENGTHS`, m."""
    depth: float = eqx.field(static=True)
    """Depth of the water, m."""
    g: float = eqx.field(static=True, default=theory.GRAVITY)
    """Acceleration of gravity, m/s2."""

    @classmethod
    def of(
        cls, geometry: ChamberGeometry, omega: tuple[float, ...], g: float = theory.GRAVITY
    ) -> WaterSeries:
        """Series for the ranges of angular frequency between the successive values of omega (rad/s,
        ascending); solves some 100 flows for each, in a second."""

        def responses(nodes: np.ndarray) -> np.ndarray:
            return np.stack([_responses(one, nodes, g) for one in _around(geometry)], axis=1)

        return cls.restored(Series.of(responses, omega), geometry, g)

    @classmethod
    def restored(cls, series: Series, geometry: ChamberGeometry, g: float) -> WaterSeries:
        """Response with series that were found before, for the given lengths."""
        usual = {name: float(getattr(geometry, name)) for name in LENGTHS}
        return cls(series, usual, geometry.depth, g)

    def at(self, omega: Scalar, lengths: dict[str, Scalar]) -> tuple[Array, Array]:
        """Complex flows q_R (m) and q_S (m/s) at an angular frequency (rad/s).

        `lengths`: lengths that differ from the given ones, m, by the names in `LENGTHS`.
        """
        values = self.series(omega)
        found = values[0]
        for k, name in enumerate(LENGTHS):
            usual, less, more = self.lengths[name], values[1 + 2 * k], values[2 + 2 * k]
            step = jnp.where(usual == 0.0, 1.0, SHARE * usual)
            s = (lengths.get(name, usual) - usual) / step
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


class Law(NamedTuple):
    """Averages of a quadratic law over time, for a flow whose mean square is half of that of its size."""

    equal: float
    """Ratio of the linear resistance with the same mean power to that of the law at the flow's size (-)."""
    square: float
    """Mean square of the law's pressure over that of its value at the flow's size, times two (-)."""


class Incident(NamedTuple):
    """Incident waves, and the averages of a quadratic law in a flow that they cause."""

    amplitude: Float[Array, " N"]
    """Amplitudes of the waves, m."""
    omega: Float[Array, " N"]
    """Their angular frequencies, rad/s."""
    law: Law

    @classmethod
    def regular(cls, H: ArrayLike, T: ArrayLike) -> Incident:
        """Regular waves of height H (m) and period T (s), in which a flow is sinusoidal."""
        equal = 8.0 / (3.0 * math.pi)
        # the size is the amplitude, and of the pressure only the part at the waves' frequency is kept
        return cls(0.5 * jnp.atleast_1d(H), 2.0 * jnp.pi / jnp.atleast_1d(T), Law(equal, equal**2))

    @classmethod
    def sea(cls, Hs: ArrayLike, Tp: ArrayLike, shape: AbstractSpectrum) -> Incident:
        """Sea of significant height Hs (m) and peak period Tp (s) with the shape of a spectrum, in which a
        flow is Gaussian."""
        ratio = np.linspace(LOWEST, HIGHEST, COMPONENTS)
        share = shape.shape(ratio)
        amplitude = np.sqrt(share / np.sum(share) / 8.0)  # half of the sum of squares is (Hs / 4)^2
        # the size is sqrt(2) sigma: E|q|^3 = sqrt(8 / pi) sigma^3, E q^4 = 3 sigma^4
        return cls(
            jnp.asarray(amplitude, jnp.float32) * Hs,
            jnp.asarray(2.0 * np.pi * ratio, jnp.float32) / Tp,
            Law(2.0 / math.sqrt(math.pi), 1.5),
        )

    def power(self, depth: float, rho0: float, g: float) -> Array:
        """Mean power of the waves, W/m, in water of a depth (m) and a density (kg/m3)."""
        H, T = 2.0 * self.amplitude, 2.0 * jnp.pi / self.omega
        return jnp.sum(theory.incident_power(H, T, depth, rho0, g))


class Response(NamedTuple):
    """Response of an oscillating water column to waves, per metre of width.

    In a sea the amplitudes are sqrt(2) times the standard deviations.
    """

    xi: Array
    """Hydrodynamic efficiency (-)."""
    P_owc: Array
    """Mean absorbed power, W/m."""
    P_inc: Array
    """Mean incident power, W/m."""
    flow: Array
    """Amplitude of the flow of air out of the chamber, m2/s."""
    P_a: Array
    """Amplitude of the air's pressure, in regular waves at their frequency, Pa."""
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
    waves: Incident,
    lengths: dict[str, Scalar],
    rho0: float,
) -> Response:
    """Response of a column to incident waves.

    `lengths`: lengths of the chamber that differ from those of the series, m, by the names in `LENGTHS`;
    `rho0`: density, kg/m3.
    """
    omega, g = waves.omega, water.g
    q_R, q_S = jax.vmap(lambda one: water.at(one, lengths))(omega)
    b, a = ((water.lengths | lengths)[name] for name in ("length", "draught"))
    circuit = _Circuit(
        drive=waves.amplitude * q_S,
        Z=-1j * omega / (rho0 * g) * q_R,
        inertia=-1j * omega * rho0 * added.length * a / b,
        lip=jnp.asarray(waves.law.equal * 0.5 * rho0 * added.lip / b**2),
        resistance=jnp.asarray(air.resistance, jnp.float32),
        turbine=waves.law.equal * jnp.asarray(air.K_dm) ** 2,
        softness=1j * omega * air.give,
    )
    through, column = circuit.sizes()
    flow = circuit.flows(through, column)[1]
    P_owc = 0.5 * (circuit.resistance + circuit.turbine * through) * through**2
    P_inc = waves.power(water.depth, rho0, g)
    linear, quadratic = circuit.resistance * through, circuit.turbine / waves.law.equal * through**2
    P_a = linear**2 + 2.0 * waves.law.equal * linear * quadratic + waves.law.square * quadratic**2
    return Response(
        xi=P_owc / P_inc,
        P_owc=P_owc,
        P_inc=P_inc,
        flow=column,
        P_a=jnp.sqrt(P_a),
        level=amplitudes(flow / (omega * b)),
        P_lost=0.5 * circuit.lip * column**3,
    )


def amplitudes(a: Array) -> Array:
    """Amplitudes of waves, or sqrt(2) times the standard deviations of sums of waves, over the first axis."""
    return jnp.sqrt(jnp.sum(jnp.real(a) ** 2 + jnp.imag(a) ** 2, axis=0) + TINY)


class _Circuit(NamedTuple):
    """Water, column, air and turbine at each frequency, as resistances to the flow of air."""

    drive: Array
    """Flow of an open chamber without losses, m2/s."""
    Z: Array
    """Admittance of the water, m2/(s Pa)."""
    inertia: Array
    """Pressure that accelerates the additional length of the column, per flow, Pa s/m2."""
    lip: Array
    """Resistance of the lip per size of the column's flow, Pa s2/m4."""
    resistance: Array
    """Linear resistance of the turbine, Pa s/m2."""
    turbine: Array
    """Quadratic resistance of the turbine per size of its flow, Pa s2/m4."""
    softness: Array
    """Admittance of the air, m2/(s Pa)."""

    def flows(self, through: Array, column: Array) -> tuple[Array, Array]:
        """Flows through the turbine and of the column at each frequency, m2/s, with the resistances at these
        sizes of the two flows (m2/s)."""
        turbine = self.resistance + self.turbine * through
        ratio = 1.0 - self.softness * turbine
        impedance = ratio * (1.0 + self.Z * (self.inertia + self.lip * column)) + self.Z * turbine
        of_turbine = self.drive / impedance
        return of_turbine, ratio * of_turbine

    def sizes(self) -> tuple[Array, Array]:
        """Sizes of the flows through the turbine and of the column, m2/s, that agree with their resistances.

        If a resistance grows by a factor, its flow falls by at most this factor. Hence the geometric mean of
        the flows before and after a step converges, and at least halves the error of the logarithm.
        """

        def step(sizes: tuple[Array, Array]) -> tuple[Array, Array]:
            through, column = self.flows(*sizes)
            return jnp.sqrt(sizes[0] * amplitudes(through)), jnp.sqrt(sizes[1] * amplitudes(column))

        open_chamber = amplitudes(self.drive)
        return fixed_point(step, (open_chamber, open_chamber), ITERATIONS)
