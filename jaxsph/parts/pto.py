"""Power take-offs: of a chamber's air (pressure against flow) and of a body's pitch (moment against angle).

Signs: `P_a` is the gauge pressure of a chamber's air, positive when compressed; `q` is the volume flow of air
out of the chamber, positive when the water column rises; the PTO takes the power P_a q from the water, which
for a turbine is never negative.
"""

from __future__ import annotations

import abc
from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.model.interfaces import AbstractPTO, Entry, Exchange

__all__ = [
    "AbstractRotationalPTO",
    "FreeHinge",
    "PhasedPTO",
    "PneumaticPTO",
    "PrescribedPressure",
    "RotationalPTO",
]


class PneumaticPTO(AbstractPTO):
    """Quadratic turbine or slot, P_a = K_dm^2 |q| q (Zhu et al. 2020, Eq. 13 with the signs above).

    The law is solved in closed form together with the water's own response over the step, q = q_free -
    compliance P_a: so it is stable for every K_dm >= 0, exactly dissipative, smooth in K_dm, and tends to a
    closed chamber (q = 0) as K_dm grows.
    """

    K_dm: Scalar
    """Damping coefficient, kg^0.5 m^-2.5 (flow per unit width)."""

    def pressure(self, q_free, compliance, t):
        """See `AbstractPTO`."""
        del t
        # The root needs a positive argument for a finite derivative at q = 0: 1e-12 m2/s is no flow.
        size = jnp.abs(q_free) + 1e-12
        root = jnp.sqrt(1.0 + 4.0 * compliance * self.K_dm**2 * size)
        scaled = 2.0 * self.K_dm / (1.0 + root)  # the ratio first: it is small where K_dm^2 overflows
        return scaled**2 * size * q_free


class PhasedPTO(AbstractPTO):
    """Quadratic turbine whose damping follows the waves' phase, by Fourier coefficients of its logarithm.

        ln(K_dm(t)/K_dm) = sum_n a_n cos(n omega t) + b_n sin(n omega t).

    It stays positive, so the turbine never drives the water.
    """

    K_dm: Scalar
    """Geometric mean of the damping over a wave period, kg^0.5 m^-2.5."""
    phase: Float[Array, " 2n"]
    """Fourier coefficients a_1, b_1, a_2, b_2, ..."""
    omega: Scalar
    """Angular frequency of the waves, rad/s."""

    def damping(self, t: Scalar) -> Scalar:
        """Damping coefficient K_dm at the time t (s), kg^0.5 m^-2.5."""
        n = 1 + jnp.arange(self.phase.shape[0] // 2)
        angle = n * self.omega * t
        a, b = self.phase[::2], self.phase[1::2]
        return self.K_dm * jnp.exp(jnp.sum(a * jnp.cos(angle) + b * jnp.sin(angle)))

    def pressure(self, q_free, compliance, t):
        """See `AbstractPTO`."""
        return PneumaticPTO(self.damping(t)).pressure(q_free, compliance, t)


class PrescribedPressure(AbstractPTO):
    """Air pressure given as a function of time: a linear rise to P_a, which then stays."""

    P_a: Scalar
    """Gauge pressure at the end of the rise, Pa."""
    ramp: Scalar
    """Duration of the rise, s."""

    def pressure(self, q_free, compliance, t):
        """See `AbstractPTO`."""
        del q_free, compliance
        return self.P_a * jnp.clip(t / jnp.maximum(self.ramp, 1e-6), 0.0, 1.0)


# --------------------------------------------------------------------------- of a body's pitch


class AbstractRotationalPTO(eqx.Module):
    """Power take-off of a body's pitch: the moments about its pivot of dampers, springs and stops."""

    @abc.abstractmethod
    def entries(self, name: str) -> Mapping[str, Entry]:
        """Energies that the power take-off books, for a body of this name."""

    @abc.abstractmethod
    def moment(self, angle: Scalar, omega: Scalar) -> Scalar:
        """Moment at the pitch `angle` (rad) and its velocity `omega` (rad/s), N m (per metre in 2-D).

        The linear damping is not in it.
        """

    @abc.abstractmethod
    def linear_damping(self, zero: Scalar) -> Scalar:
        """Linear damping coefficient of the pitch, N m s/rad; `zero` is 0 in the state's precision."""

    @abc.abstractmethod
    def absorbed(self, old: Scalar, new: Scalar, dt: Scalar) -> Scalar:
        """Energy taken by damping in a step of dt (s) from the pitch velocity `old` to `new` (rad/s), J."""

    @abc.abstractmethod
    def stored(self, angle: Scalar) -> Scalar:
        """Energy stored in springs and stops at the pitch `angle` (rad), J."""


class FreeHinge(AbstractRotationalPTO):
    """Hinge without any moment: no power take-off, spring or stops."""

    def entries(self, name):
        """See `AbstractRotationalPTO`."""
        del name
        return {}

    def moment(self, angle, omega):
        """See `AbstractRotationalPTO`."""
        del omega
        return jnp.zeros_like(angle)

    def linear_damping(self, zero):
        """See `AbstractRotationalPTO`."""
        return zero

    def absorbed(self, old, new, dt):
        """See `AbstractRotationalPTO`."""
        del old, new
        return jnp.zeros_like(dt)

    def stored(self, angle):
        """See `AbstractRotationalPTO`."""
        return jnp.zeros_like(angle)


class RotationalPTO(AbstractRotationalPTO):
    """Power take-off of a flap's pitch: linear and Coulomb damping, a spring, and end stops.

    Yeylaghi et al. 2016, Eq. 21.
    """

    damping: Scalar
    """Linear damping coefficient, N m s/rad."""
    coulomb: Scalar
    """Moment of the Coulomb damping, N m, reached smoothly within a hundredth of a rad/s."""
    spring: Scalar
    """Stiffness of the spring about the upright, N m/rad."""
    stop: Scalar
    """Angle to either side at which the end stops begin, rad."""
    stop_stiffness: Scalar
    """Stiffness of the end stops, N m/rad."""

    @classmethod
    def of(
        cls, damping=0.0, coulomb=0.0, spring=0.0, stop=np.pi, stop_stiffness=0.0, dtype: Any = jnp.float32
    ):
        """Builds a power take-off from plain numbers, in the units of the fields."""
        return cls(*(jnp.asarray(a, dtype) for a in (damping, coulomb, spring, stop, stop_stiffness)))

    def entries(self, name):
        """See `AbstractRotationalPTO`."""
        return {"pto" + name.removeprefix("body"): Entry(f"power take-off of the {name}", Exchange.HARVESTED)}

    def friction(self, omega: Scalar) -> Scalar:
        """Moment of the Coulomb damping at the pitch's velocity omega (rad/s), N m."""
        return -self.coulomb * jnp.tanh(omega / 0.01)

    def restoring(self, angle: Scalar) -> Scalar:
        """Moment of the spring and the end stops at the pitch `angle` (rad), N m."""
        beyond = jnp.maximum(jnp.abs(angle) - self.stop, 0.0) * jnp.sign(angle)
        return -self.spring * angle - self.stop_stiffness * beyond

    def moment(self, angle, omega):
        """See `AbstractRotationalPTO`."""
        return self.friction(omega) + self.restoring(angle)

    def linear_damping(self, zero):
        """See `AbstractRotationalPTO`."""
        del zero
        return self.damping

    def absorbed(self, old, new, dt):
        """See `AbstractRotationalPTO`."""
        mean = 0.5 * (old + new)
        return dt * mean * (self.damping * new - self.friction(old))

    def stored(self, angle):
        """See `AbstractRotationalPTO`."""
        beyond = jnp.maximum(jnp.abs(angle) - self.stop, 0.0)
        return 0.5 * (self.spring * angle**2 + self.stop_stiffness * beyond**2)
