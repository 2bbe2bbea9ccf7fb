"""Chamber of an oscillating water column, where air trapped above the water drives a power take-off.

Signs: `P_a` is the gauge pressure of the chamber's air, positive when compressed; `q` is the volume flow of
air out of the chamber, positive when the water column rises. The water does work on the air at the rate
P_a q. The PTO and the ducts absorb this power, except for the part that compressible air stores.
"""

from __future__ import annotations

import dataclasses
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxsph.core.arrays import Array, Components, Float, Scalar, columns
from jaxsph.core.native.forms import true_indices
from jaxsph.model import laws
from jaxsph.model.air import AbstractFrame, AbstractPTO, Air, AirCoupling, Given, Pressed
from jaxsph.model.interfaces import AbstractChamber, AbstractGrip
from jaxsph.model.meaning import Oscillation, Reading
from jaxsph.model.solids import AbstractBody
from jaxsph.model.state import Tally
from jaxsph.parts.air import AbstractAirLaw, IncompressibleAir
from jaxsph.parts.frames import BodyFrame, TankFrame
from jaxsph.parts.sides import AbstractSides, Face, Plan, Sides

__all__ = ["BodyForceGrip", "Chamber", "SurfaceGrip"]


class SurfaceGrip(AbstractGrip):
    """Coupling by the pair sum of the pressure gradient, for a scheme that does not detect the surface.

    The surface condition p = P_a enters the gradient as (p_j - P_a chi_i) + (p_i - P_a chi_i). The term
    with P_a cancels where the kernel's support is full and acts at the surface. Unlike in Zhu et al. 2020,
    Eq. 15-16, surface particles need not be detected. Suction in the air causes no tension in the column.
    """

    def force(self, chamber, x, V, around):
        """See `AbstractGrip`."""
        s = around(laws.surface_vector)
        w = 2.0 * chamber.weight(x) * V
        return tuple(w * c for c in s)

    def water_pressure(self, weight):
        """See `AbstractGrip`: zero, since the scheme's pressure is the whole pressure of the water."""
        return jnp.zeros_like(weight)


class BodyForceGrip(AbstractGrip):
    """Coupling by the body force -P_a chi'(z), which replaces the pressure P_a chi(z).

    This coupling is for a scheme whose pressure is zero on the surface.
    """

    def force(self, chamber, x, V, around):
        """See `AbstractGrip`."""
        del around
        slope = jax.jvp(lambda z: chamber.weight((*x[:-1], z)), (x[-1],), (jnp.ones_like(x[-1]),))[1]
        return (*(jnp.zeros_like(V) for _ in x[:-1]), -slope * V)

    def water_pressure(self, weight):
        """See `AbstractGrip`."""
        return weight


class Chamber(AbstractChamber):
    """Water column below trapped air between walls, and the air's power take-off.

    A smooth function chi of position weights the air's pressure: chi is 1 in the upper part of the column and
    fades to 0 towards the level of the front wall's tip. The flow is q = -sum_i f_i.u_i, with the force f_i
    on particle i per unit of P_a. This sum is the volume flux averaged over the fading zone. P_a q is then
    exactly the power that the air's force extracts from the particles.
    """

    pto: AbstractPTO
    """Power take-off of the air."""
    sides: AbstractSides
    """Inner faces of the walls; `volume` counts water above the middle of the fading zone."""
    fade_low: Scalar
    """Level up to which chi is 0, m."""
    fade_high: Scalar
    """Level from which chi is 1, m."""
    still: Scalar
    """Still water level, m."""
    beyond: Scalar
    """Distance (m) behind the face of the back wall (in 3-D of any wall) up to which a particle pressed into
    the wall still counts as inside the chamber."""
    air: AbstractAirLaw = IncompressibleAir()
    """Air between the water and the power take-off."""
    frame: AbstractFrame = eqx.field(default=TankFrame(), kw_only=True)
    """Frame in which the walls are at rest: the tank's or a body's."""
    name: str = eqx.field(static=True, default="chamber", kw_only=True)
    usual_name: ClassVar[str] = "chamber"

    @classmethod
    def of(
        cls,
        pto: AbstractPTO,
        *,
        between: tuple[Face, Face] | np.ndarray,
        tip: float,
        level: float,
        dx: float,
        air: AbstractAirLaw | None = None,
        name: str = "chamber",
        dtype: Any = jnp.float32,
    ) -> Chamber:
        """Builds a chamber from plain numbers.

        **Arguments**: `between`: inner faces of the front and the back wall, each given by its x (m) if it is
        upright, or by its corners (x, z) (m) from the bottom up; in three dimensions the three or more
        corners `[K, 2]` (x, y) (m) of the water surface between upright walls; `tip`: level of the front
        wall's tip, m (air escapes if the water falls below this level); `level`: still water level, m; `dx`:
        spacing, m; `air`: law of the air, for example `IsentropicAir`; incompressible by default.
        """
        fade_high = tip + 0.5 * (level - tip)
        base = 0.5 * (tip + fade_high)
        if isinstance(between, np.ndarray):
            sides: AbstractSides = Plan(jnp.asarray(between, dtype), jnp.asarray(base, dtype))
        else:
            highest = [np.max(np.asarray(face)[:, 1]) for face in between if np.ndim(face)]
            sides = Sides.of(*between, tip, base, max(2.0 * level - tip, *highest, 0.0), dtype)
        numbers = {"fade_low": tip, "fade_high": fade_high, "still": level, "beyond": 0.5 * dx}
        leaves: dict[str, Any] = {key: jnp.asarray(value, dtype) for key, value in numbers.items()}
        air = IncompressibleAir() if air is None else air
        return cls(pto=pto, sides=sides, air=air, name=name, **leaves)

    def in_body(self, body: AbstractBody) -> Chamber:
        """The same chamber, with walls that belong to a rigid body."""
        return dataclasses.replace(self, frame=BodyFrame(body.name, body.pivot))

    def start(self, dtype: Any) -> Air:
        """See `AbstractChamber`: air at rest."""
        zero = jnp.zeros((), dtype)
        return Air(zero, zero, Tally.zero(dtype), self.air.start(dtype))

    def entries(self):
        """See `AbstractPart`."""
        found = {**self.pto.entries(self.name), **self.air.entries(self.name)}
        return {self.called(name): entry for name, entry in found.items()}

    def readings(self, dim):
        """See `AbstractPart`."""
        area, flow, width = ("m2", "m2 s-1", " per unit width") if dim == 2 else ("m3", "m3 s-1", "")
        measured = "the middle of the zone in which the flow is measured"
        found = {
            "chamber_level": Reading("m", "mean elevation of the chamber's surface above still water"),
            "chamber_volume": Reading(area, f"volume of water{width} in the chamber above {measured}"),
            "P_a": Reading("Pa", "gauge pressure of the chamber's air, positive when compressed"),
            "flow": Reading(flow, f"flow of air out of the chamber{width}"),
            "flow_mean": Reading(flow, "flow out of the chamber, mean since the last sample"),
            **self.air.readings(dim),
        }
        return {self.called(name): reading for name, reading in found.items()}

    def oscillations(self, dim):
        """See `AbstractPart`."""
        pressure = Oscillation(self.called("P_a"), f"air pressure in the {self.name}", "Pa")
        flow = Oscillation(
            self.called("flow_mean"), f"air flow out of the {self.name}", "m2/s" if dim == 2 else "m3/s"
        )
        level = Oscillation(self.called("chamber_level"), f"level in the {self.name}", "m")
        found = {"P_a": pressure, "flow": flow, "chamber_level": level._replace(over_waves=True)}
        return {self.called(name): one for name, one in found.items()}

    def read(self, state, sampled):
        """See `AbstractPart`."""
        x = self.frame.back(sampled.parts, sampled.x)
        found = {
            "chamber_level": self.level(x, sampled.V, sampled.dx),
            "chamber_volume": self.volume(x, sampled.V, sampled.dx),
            "P_a": state.P_a,
            "flow": state.q,
            "flow_mean": state.driven.recent / sampled.interval,
            **self.air.read(state),
        }
        return {self.called(name): value for name, value in found.items()}

    @property
    def surface(self) -> Scalar:
        """Area of the water surface between the walls at the still level, m2; its length, m, in 2-D."""
        return self.sides.surface(self.still)

    def inside(self, x: Components) -> Array:
        """Mask of points x (m), True between the chamber's walls."""
        # The mask ends sharply at the front wall's face. No particle is affected, because none is inside the
        # wall.
        return self.sides.between(x, 1e-4, self.beyond)

    def weight(self, x: Components) -> Float[Array, " N"]:
        """Weight chi of the air's pressure at points x (m), 0 to 1."""
        s = jnp.clip((x[-1] - self.fade_low) / (self.fade_high - self.fade_low), 0.0, 1.0)
        return jnp.where(self.inside(x), s * s * (3.0 - 2.0 * s), 0.0)

    def candidates(self, x, margin, capacity):
        """See `AbstractChamber`."""
        first, last = self.sides.ends()
        near = (x[0] > first - margin) & (x[0] < last + self.beyond + margin)
        may = near & (x[-1] > self.fade_low - margin)
        return true_indices(may, capacity), jnp.sum(may)

    def coupling(self, scheme, water, sources, tables, parts):
        """See `AbstractChamber`."""
        index, n = tables.chambers[self.name], water.m.shape[0]
        slabs, i = tables.fluid.slabs, jnp.minimum(index, n - 1)
        fields = slabs.take({"V": sources.water["V"], "m": water.m, "x": columns(water.x)}, i)
        V, x = jnp.where(index < n, jnp.abs(fields["V"]), 0.0), fields["x"]

        def around(law):
            return self.frame.turned_back(
                parts, tables.fluid.sum_at(i, law, scheme.smoothing, {"x": x}, sources)
            )

        force = self.frame.turned(parts, scheme.grip.force(self, self.frame.back(parts, x), V, around))
        # no force acts on a particle without mass, so that any divisor is suitable
        m = jnp.where(fields["m"] > 0.0, fields["m"], 1.0)
        return AirCoupling(index, force, m, slabs, self.frame.reaction(parts, x, force))

    def press(self, air, q_free, compliance, ducted, t, dt):
        """See `AbstractChamber`."""
        pto = self.pto.at(air, t)
        return Pressed(*self.air.press(pto, air, q_free, compliance, ducted, t, dt), pto, ducted)

    def finish(self, air, pressed, before, after, dt):
        """See `AbstractChamber`."""
        mean = 0.5 * (before + after)
        passed, ducted = self.air.divided(pressed, mean)
        left, head = passed + ducted, self.air.head(pressed.P_a)
        # force times mean velocity times dt is exactly the kinetic energy that the force removes in the step
        amounts = {name: dt * head * q for name, q in pressed.pto.flows(pressed.P_a, passed).items()}
        amounts |= {name: dt * (pressed.P_a * mean - head * left) for name in self.air.entries("")}
        kept = self.air.finish(air, passed, left, mean, dt)
        air = Air(pressed.P_a, after, air.driven.add(dt * after), kept)
        return air, {self.called(name): amount for name, amount in amounts.items()}, Given(head, ducted)

    def water_pressure(self, air, grip, x):
        """See `AbstractChamber`."""
        return air.P_a * grip.water_pressure(self.weight(x))

    def volume(self, x: Components, V: Float[Array, " N"], smooth: Scalar) -> Scalar:
        """Volume of water in the chamber above the middle of the fading zone, m3 (m2 in 2-D).

        **Arguments**: `x`, `V`: positions (m) and volumes (m3; m2 in 2-D) of the particles; `smooth`: half
        the height (m) of the layer around this level in which particles are counted in part.
        """
        s = jnp.clip((x[-1] - self.sides.base) / (2.0 * smooth) + 0.5, 0.0, 1.0)
        return jnp.sum(jnp.where(self.inside(x), V * s, 0.0))

    def level(self, x: Components, V: Float[Array, " N"], smooth: Scalar) -> Scalar:
        """Mean elevation of the chamber's surface above still water, m; arguments as for `volume`."""
        return self.sides.level(self.volume(x, V, smooth)) - self.still
