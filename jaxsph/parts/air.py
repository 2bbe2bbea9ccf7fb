"""Laws of the air between a chamber's water and its power take-off: incompressible or isentropic.

Signs and flows are defined in `parts.pto`. The water does work on the air at the rate P_a q, where q is the
volume flow of the rising water surface. The power take-off absorbs the power `head` (Pa) times the flow
through the take-off, and the air stores the remainder.
"""

from __future__ import annotations

import abc
from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax.numpy as jnp

from jaxsph.core.arrays import Scalar
from jaxsph.model.air import AbstractPTO, Air, Pressed
from jaxsph.model.meaning import Entry, Reading
from jaxsph.model.state import Tally

__all__ = ["AbstractAirLaw", "Confined", "IncompressibleAir", "IsentropicAir"]


class AbstractAirLaw(eqx.Module):
    """Law of a chamber's air, which divides the flow at the water's surface into outflow and compression."""

    @abc.abstractmethod
    def start(self, dtype: Any) -> Any:
        """State of the air at t = 0, stored as `Air.confined`."""

    @abc.abstractmethod
    def entries(self, whose: str) -> Mapping[str, Entry]:
        """Meaning of the air's energies in the ledger, by short name; `whose`: the chamber's name."""

    @abc.abstractmethod
    def readings(self, dim: int) -> Mapping[str, Reading]:
        """Meaning of the readings of `read`, in `dim` dimensions."""

    @abc.abstractmethod
    def read(self, air: Air) -> Mapping[str, Scalar]:
        """Additional readings of compressible air, by name; none for incompressible air."""

    @abc.abstractmethod
    def press(
        self,
        pto: AbstractPTO,
        air: Air,
        q_free: Scalar,
        compliance: Scalar,
        ducted: Scalar,
        t: Scalar,
        dt: Scalar,
    ) -> tuple[Scalar, Scalar]:
        """Gauge pressure (Pa) over a step of dt (s), and flow through the power take-off, m3/s (m2/s in 2-D).

        **Arguments** as for `AbstractPTO.pressure`; also `air`: the chamber's air at the beginning of the
        step; `ducted`: flow into the chamber's ducts, m3/s (m2/s in 2-D).
        """

    @abc.abstractmethod
    def divided(self, pressed: Pressed, mean: Scalar) -> tuple[Scalar, Scalar]:
        """Flows through the power take-off and into the ducts in a step, m3/s (m2/s in 2-D).

        **Arguments**: `pressed`: pressures and flows of the air in the step; `mean`: mean flow at the water's
        surface over the step, m3/s (m2/s in 2-D).
        """

    @abc.abstractmethod
    def head(self, P_a: Scalar) -> Scalar:
        """Energy of air at the gauge pressure P_a (Pa) per volume that flows out to the ambient air, Pa."""

    @abc.abstractmethod
    def finish(self, air: Air, passed: Scalar, left: Scalar, mean: Scalar, dt: Scalar) -> Any:
        """State of the air after a step of dt (s).

        **Arguments**: `passed`: flow through the power take-off; `left`: flow through the power take-off and
        the ducts together; `mean`: mean flow at the water's surface; all in m3/s (m2/s in 2-D).
        """


class IncompressibleAir(AbstractAirLaw):
    """Incompressible air. All air that the water displaces flows through the power take-off or the ducts."""

    def start(self, dtype):
        """See `AbstractAirLaw`: there is no state."""
        del dtype
        return ()

    def entries(self, whose):
        """See `AbstractAirLaw`."""
        del whose
        return {}

    def readings(self, dim):
        """See `AbstractAirLaw`."""
        return {}

    def read(self, air):
        """See `AbstractAirLaw`."""
        del air
        return {}

    def press(self, pto, air, q_free, compliance, ducted, t, dt):
        """See `AbstractAirLaw`."""
        del air, dt
        free = q_free - ducted
        P_a = pto.pressure(free, compliance, t)
        return P_a, free - compliance * P_a

    def divided(self, pressed, mean):
        """See `AbstractAirLaw`."""
        return pressed.pto.divided(mean, pressed.ducted)

    def head(self, P_a):
        """See `AbstractAirLaw`."""
        return P_a

    def finish(self, air, passed, left, mean, dt):
        """See `AbstractAirLaw`."""
        del air, passed, left, mean, dt
        return ()


class Confined(eqx.Module):
    """State of compressible air in a chamber."""

    excess: Tally
    """Volume that the air would have at ambient pressure, minus the present volume, m3 (m2 in 2-D)."""
    passed: Scalar
    """Flow through the power take-off in the last step, m3/s (m2/s in 2-D)."""


class IsentropicAir(AbstractAirLaw):
    """Isentropic air: 1 + P_a / p0 = (V0 / V)^gamma; V: volume of the air, V0: volume at ambient pressure.

    Flow through the power take-off is counted at ambient density, and air that flows in has the ambient
    entropy (Falcao and Justino 1999, Ocean Engineering 26). Over a step the air acts as a spring, linearised
    about the present state, so that the power take-off's law is solved in closed form. The state follows from
    the volumes that flowed in and out, so that the pressure does not drift.
    """

    volume: Scalar
    """Volume of the air over still water, m3 (m2, per metre of the chamber's width, in 2-D)."""
    p0: Scalar
    """Ambient pressure, Pa."""
    gamma: Scalar
    """Ratio of the specific heats of air (-)."""

    def start(self, dtype):
        """See `AbstractAirLaw`: air at ambient pressure."""
        return Confined(Tally.zero(dtype), jnp.zeros((), dtype))

    def entries(self, whose):
        """See `AbstractAirLaw`."""
        return {"air": Entry(f"compression of the air in the {whose}")}

    def readings(self, dim):
        """See `AbstractAirLaw`."""
        units, width = ("m2 s-1", " per unit width") if dim == 2 else ("m3 s-1", "")
        return {"flow_pto": Reading(units, f"flow through the power take-off{width}, at ambient density")}

    def read(self, air):
        """See `AbstractAirLaw`."""
        return {"flow_pto": air.confined.passed}

    def pressure(self, air: Air) -> Scalar:
        """Gauge pressure of the air, Pa, from the amount of air and its volume."""
        share = air.confined.excess.total / self._room(air)
        # a small pressure is a small difference of volumes: expm1 and log1p resolve it in single precision
        return self.p0 * jnp.expm1(self.gamma * jnp.log1p(jnp.maximum(share, -0.9)))

    def _room(self, air: Air) -> Scalar:
        """Volume of the air above the water, m3 (m2 in 2-D): at least 2 % of the volume over still water."""
        return jnp.maximum(self.volume - air.driven.total, 0.02 * self.volume)

    def press(self, pto, air, q_free, compliance, ducted, t, dt):
        """See `AbstractAirLaw`.

        For soft air the flow at the surface is evaluated in the middle of the step, so that the spring
        neither gains nor loses energy. The time of evaluation moves towards the end of the step as
        omega^2 dt^2 = dt compliance / give increases, where omega is the natural frequency of the water on
        the air spring, and give is -dV/dP_a. This shift damps oscillations from step to step if the air is
        too stiff for dt.
        """
        P_n = self.pressure(air)
        give = self._room(air) / (self.gamma * (self.p0 + P_n))  # -dV/dP_a
        stiff = dt * compliance / give
        late = 0.5 + 0.5 * stiff / (1.0 + stiff)
        spring = give / (late * dt)
        softer = late * compliance + spring
        free = (1.0 - late) * air.q + late * q_free + spring * P_n - ducted
        P_a = pto.pressure(free, softer, t)
        return P_a, free - softer * P_a

    def divided(self, pressed, mean):
        """See `AbstractAirLaw`. The power take-off's law determines the flow, so that a closed PTO has no
        flow."""
        del mean
        return pressed.passed, pressed.ducted

    def head(self, P_a):
        """See `AbstractAirLaw`. The energy per volume is the drop in enthalpy from P_a to the ambient air."""
        power = (self.gamma - 1.0) / self.gamma
        return self.p0 / power * jnp.expm1(power * jnp.log1p(P_a / self.p0))

    def finish(self, air, passed, left, mean, dt):
        """See `AbstractAirLaw`."""
        return Confined(air.confined.excess.add(dt * (mean - left)), passed)

    def stored(self, air: Air) -> Scalar:
        """Energy stored in the air by compression from the ambient pressure, J (J/m in 2-D)."""
        room = self._room(air)
        excess = air.confined.excess.total
        n = self.gamma - 1.0
        gain = (room + excess) * jnp.expm1(n * jnp.log1p(excess / room)) / n
        return self.p0 * (gain - excess)
