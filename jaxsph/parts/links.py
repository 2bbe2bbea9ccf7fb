"""Links: their ends, and the laws of springs, dampers, friction, stops, latches and hydraulics."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jax.tree_util import Partial

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.model.links import AbstractEnds, AbstractLaw
from jaxsph.model.solids import AbstractBody

__all__ = [
    "AlongJoint",
    "BetweenPoints",
    "Controlled",
    "Damper",
    "EndStops",
    "Friction",
    "HydraulicTakeOff",
    "Latch",
    "Laws",
    "Rope",
    "Spring",
]


class BetweenPoints(AbstractEnds):
    """Ends of a straight link between two points; the extension is the length of the link minus `rest`."""

    first: str = eqx.field(static=True)
    """Name of the body at the first end; empty for the tank."""
    second: str = eqx.field(static=True)
    """Name of the body at the second end; empty for the tank."""
    a: Float[Array, " D"]
    """Position of the first end at rest, m."""
    b: Float[Array, " D"]
    """Position of the second end at rest, m."""
    rest: Scalar
    """Length at which the extension is zero, m."""

    @property
    def unit(self):
        """See `AbstractEnds`."""
        return "m"

    def extension(self, places):
        """See `AbstractEnds`."""
        apart = places.point(self.second, self.b) - places.point(self.first, self.a)
        # 1e-12 m2 keeps the direction finite where both ends coincide
        return jnp.sqrt(jnp.sum(apart**2) + 1e-12) - self.rest

    def points(self, places):
        """See `AbstractEnds`."""
        return jnp.stack([places.point(self.first, self.a), places.point(self.second, self.b)])

    @property
    def bodies(self):
        """See `AbstractEnds`."""
        return tuple(name for name in (self.first, self.second) if name)


class AlongJoint(AbstractEnds):
    """Ends of a link along one coordinate of a body's joint: the body, and its parent or the tank."""

    body: str = eqx.field(static=True)
    """Name of the body."""
    coordinate: int = eqx.field(static=True)
    """Index of the coordinate in `AbstractJoint.coordinates`."""
    coordinate_unit: str = eqx.field(static=True)
    """Unit of the coordinate, "m" or "rad"."""

    @classmethod
    def of(cls, body: AbstractBody, coordinate: int) -> AlongJoint:
        """Builds the ends of a link along a coordinate of a body's joint; `coordinate`: its index.

        The ends store the coordinate's unit. **Raises** ValueError if the joint has no such coordinate.
        """
        known = body.joint.coordinates
        if not 0 <= coordinate < len(known):
            there = ", ".join(f"{index} ({name})" for index, (name, _) in enumerate(known))
            asked = (
                f"must be one of {there}" if there else "the joint has no coordinates; choose another body"
            )
            raise ValueError(f"coordinate = {coordinate} of the joint of {body.name}: {asked}")
        return cls(body.name, coordinate, known[coordinate][1])

    @property
    def unit(self):
        """See `AbstractEnds`."""
        return self.coordinate_unit

    def extension(self, places):
        """See `AbstractEnds`."""
        return places.q[self.body][self.coordinate]

    @property
    def bodies(self):
        """See `AbstractEnds`."""
        return (self.body,)


class Spring(AbstractLaw):
    """Linear spring, which pulls with `pretension` at zero extension."""

    stiffness: Scalar
    """Stiffness, N/m."""
    pretension: Scalar
    """Tension at zero extension, N."""

    @property
    def dissipates(self):
        """See `AbstractLaw`."""
        return False

    def stored(self, own, s):
        """See `AbstractLaw`."""
        del own
        return (0.5 * self.stiffness * s + self.pretension) * s


class Rope(AbstractLaw):
    """Linear spring and damper that never push; slack where the spring's tension would be negative."""

    stiffness: Scalar
    """Stiffness where the rope is taut, N/m; positive."""
    pretension: Scalar
    """Tension at zero extension, N."""
    damping: Scalar
    """Coefficient of the damper, which acts where the spring is taut, N s/m."""

    def _tension(self, s: Scalar) -> Scalar:
        """Tension of the spring, N."""
        return jnp.maximum(self.stiffness * s + self.pretension, 0.0)

    def stored(self, own, s):
        """See `AbstractLaw`."""
        del own
        return 0.5 * self._tension(s) ** 2 / self.stiffness

    def force(self, own, s, v, t):
        """See `AbstractLaw`."""
        del own, t
        tension = self._tension(s)
        return -jnp.where(tension > 0.0, jnp.maximum(self.damping * v, -tension), 0.0)


class Damper(AbstractLaw):
    """Linear and quadratic damper, force -(linear + quadratic |v|) v."""

    linear: Scalar
    """Linear coefficient, N s/m."""
    quadratic: Scalar
    """Quadratic coefficient, N s2/m2."""

    def force(self, own, s, v, t):
        """See `AbstractLaw`."""
        del own, s, t
        return -(self.linear + self.quadratic * jnp.abs(v)) * v


class Friction(AbstractLaw):
    """Coulomb friction with a smoothed reversal: force -size tanh(v / scale) at the rate v."""

    size: Scalar
    """Friction force, N."""
    scale: Scalar
    """Rate at which the friction reaches 76 % of `size`, m/s."""

    def force(self, own, s, v, t):
        """See `AbstractLaw`."""
        del own, s, t
        return -self.size * jnp.tanh(v / self.scale)


class EndStops(AbstractLaw):
    """Elastic stops at both ends of a range of the extension."""

    low: Scalar
    """Extension below which the lower stop acts, m."""
    high: Scalar
    """Extension above which the upper stop acts, m."""
    stiffness: Scalar
    """Stiffness of the stops, N/m."""

    @property
    def dissipates(self):
        """See `AbstractLaw`."""
        return False

    def stored(self, own, s):
        """See `AbstractLaw`."""
        del own
        beyond = jnp.maximum(s - self.high, 0.0) + jnp.maximum(self.low - s, 0.0)
        return 0.5 * self.stiffness * beyond**2


class Latch(AbstractLaw):
    """Latch that holds the link for a given time whenever the rate changes sign (latching control)."""

    hold: Scalar
    """Time for which the latch holds, s."""
    damping: Scalar
    """Coefficient of the damper that holds the link, N s/m."""

    def start(self, s):
        """See `AbstractLaw`: the time until which the latch holds (s), and the last rate (m/s)."""
        return jnp.zeros_like(s), jnp.zeros_like(s)

    def force(self, own, s, v, t):
        """See `AbstractLaw`."""
        until, _ = own
        return -jnp.where(t < until, self.damping, 0.0) * v

    def advance(self, own, s, v, t, dt):
        """See `AbstractLaw`."""
        until, last = own
        free = t >= until
        caught = free & (v * last < 0.0)
        ago = dt * v / jnp.where(caught, v - last, 1.0)  # time since the rate was zero
        return jnp.where(caught, t - ago + self.hold, until), jnp.where(free & ~caught, v, 0.0)


class Controlled(AbstractLaw):
    """Force given by a function of extension, rate and time, for user-defined control."""

    function: Partial
    """Force (N) as a function of extension s (m), rate v (m/s) and time t (s), bound to its parameters."""

    @classmethod
    def of(cls, function: Callable[..., Scalar], *parameters: Any) -> Controlled:
        """Builds the law from a function of the parameters, s, v and t; the force can be differentiated with
        respect to the parameters."""
        return cls(Partial(function, *parameters))

    def force(self, own, s, v, t):
        """See `AbstractLaw`."""
        del own
        return self.function(s, v, t)


FULL = 0.99
"""Largest fraction of the accumulator's volume V0 that oil can fill (-)."""


class HydraulicTakeOff(AbstractLaw):
    """Cylinder with check valves, a gas accumulator and a hydraulic motor.

    The cylinder pumps oil into the accumulator in both directions of motion, against the gas pressure p. The
    gas follows p V^gamma = p0 V0^gamma, with gamma = 1 for constant temperature, and the flow through the
    motor is proportional to p - p0. When oil fills the fraction `FULL` of the volume V0, a relief valve
    discharges any further oil.
    """

    area: Scalar
    """Area of the piston, m2."""
    pressure: Scalar
    """Precharge pressure p0 of the accumulator (without oil), and pressure of the return line, Pa."""
    volume: Scalar
    """Gas volume V0 of the accumulator without oil, m3."""
    motor: Scalar
    """Flow through the motor per unit of p - p0, m3/s/Pa."""
    gamma: Scalar
    """Polytropic exponent of the gas (-)."""
    scale: Scalar
    """Rate at which the force reaches 76 % of its value with fully open valves, m/s."""

    def start(self, s):
        """See `AbstractLaw`: the volume of oil in the accumulator, m3."""
        return jnp.zeros_like(s)

    def excess(self, oil: Scalar) -> Scalar:
        """Pressure of the gas above p0 (Pa) for a volume of oil (m3) in the accumulator."""
        return self.pressure * ((self.volume / (self.volume - oil)) ** self.gamma - 1.0)

    def stored(self, own, s):
        """See `AbstractLaw`: the work of compressing the gas against p0."""
        squeezed, over = -jnp.log1p(-own / self.volume), self.gamma - 1.0
        # work / (p0 V0) = (exp(over * squeezed) - 1) / over, which tends to `squeezed` as over tends to 0
        # (constant temperature)
        warm = jnp.where(over == 0.0, 1.0, over)
        work = jnp.where(over == 0.0, squeezed, jnp.expm1(warm * squeezed) / warm)
        return self.pressure * (self.volume * work - own) + 0.0 * s

    def force(self, own, s, v, t):
        """See `AbstractLaw`."""
        return -self.area * self.excess(own) * jnp.tanh(v / self.scale)

    def advance(self, own, s, v, t, dt):
        """See `AbstractLaw`."""
        pumped = self.area * jnp.abs(v) * jnp.abs(jnp.tanh(v / self.scale))
        oil = own + dt * (pumped - self.motor * self.excess(own))
        return jnp.clip(oil, 0.0, FULL * self.volume)


class Laws(AbstractLaw):
    """Sum of several laws that act in parallel."""

    laws: tuple[AbstractLaw, ...]
    """The laws."""

    @property
    def dissipates(self):
        """See `AbstractLaw`."""
        return any(law.dissipates for law in self.laws)

    def start(self, s):
        """See `AbstractLaw`."""
        return tuple(law.start(s) for law in self.laws)

    def stored(self, own, s):
        """See `AbstractLaw`."""
        each = (law.stored(one, s) for law, one in zip(self.laws, own, strict=True))
        return sum(each, jnp.zeros((), s.dtype))

    def force(self, own, s, v, t):
        """See `AbstractLaw`."""
        each = (law.force(one, s, v, t) for law, one in zip(self.laws, own, strict=True))
        return sum(each, jnp.zeros_like(s))

    def advance(self, own, s, v, t, dt):
        """See `AbstractLaw`."""
        return tuple(law.advance(one, s, v, t, dt) for law, one in zip(self.laws, own, strict=True))
