"""Power take-offs on a body's pitch, with a moment as a function of angle and angular velocity."""

from __future__ import annotations

import abc
from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxsph.core.arrays import Scalar
from jaxsph.model.meaning import Entry, Exchange

__all__ = ["AbstractRotationalPTO", "FreeHinge", "RotationalPTO"]


class AbstractRotationalPTO(eqx.Module):
    """Power take-off on a body's pitch, with moments of dampers, springs and stops about the pivot."""

    @abc.abstractmethod
    def entries(self, whose: str) -> Mapping[str, Entry]:
        """Meaning of the power take-off's energies in the ledger, by short name; `whose`: the body's name."""

    @abc.abstractmethod
    def moment(self, angle: Scalar, omega: Scalar) -> Scalar:
        """Moment at the pitch `angle` (rad) and pitch velocity `omega` (rad/s), N m (per metre in 2-D).

        The moment does not include the linear damping.
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
    """Hinge without any moment, since there is no power take-off, spring or stop."""

    def entries(self, whose):
        """See `AbstractRotationalPTO`."""
        del whose
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
    """Power take-off on a flap's pitch, with linear and Coulomb damping, a spring, and end stops.

    Yeylaghi et al. 2016, Eq. 21.
    """

    damping: Scalar
    """Linear damping coefficient, N m s/rad."""
    coulomb: Scalar
    """Moment of the Coulomb damping, N m; it builds up smoothly over about 0.01 rad/s."""
    spring: Scalar
    """Stiffness of the spring, N m/rad; its moment is zero at zero pitch."""
    stop: Scalar
    """Pitch angle to either side at which the end stops begin, rad."""
    stop_stiffness: Scalar
    """Stiffness of the end stops, N m/rad."""

    @classmethod
    def of(
        cls, damping=0.0, coulomb=0.0, spring=0.0, stop=np.pi, stop_stiffness=0.0, dtype: Any = jnp.float32
    ):
        """Builds a power take-off from plain numbers, in the units of the fields."""
        return cls(*(jnp.asarray(a, dtype) for a in (damping, coulomb, spring, stop, stop_stiffness)))

    def entries(self, whose):
        """See `AbstractRotationalPTO`."""
        return {"pto": Entry(f"power take-off of the {whose}", Exchange.HARVESTED)}

    def friction(self, omega: Scalar) -> Scalar:
        """Moment of the Coulomb damping at the pitch velocity `omega` (rad/s), N m."""
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
