"""Chamber of an oscillating water column: trapped air over the water, which drives a power take-off.

Signs: `P_a` is the gauge pressure of the chamber's air, positive when compressed; `q` is the volume flow of
air out of the chamber, positive when the water column rises; the PTO takes P_a q from the water.
"""

from __future__ import annotations

import abc
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Components, Float, Scalar, columns, dot, stack
from jaxsph.core.pairs import Law
from jaxsph.model import laws
from jaxsph.model.interfaces import AbstractChamber, AbstractPTO, Air, Kick
from jaxsph.model.state import Tally
from jaxsph.parts.air import AbstractAirLaw, IncompressibleAir

__all__ = ["AbstractGrip", "BodyForceGrip", "Chamber", "SurfaceGrip"]


class AbstractGrip(eqx.Module):
    """Coupling of the air's pressure to a scheme's water: p = P_a on the surface inside a chamber."""

    @abc.abstractmethod
    def force(
        self, chamber: Chamber, x: Components, V: Float[Array, " C"], around: Callable[[Law], Components]
    ) -> Components:
        """Force on particles per unit of P_a, m2 (m in 2-D).

        **Arguments**: positions x (m) and volumes V (m3; m2 in 2-D) of the particles; `around(law)`: sums of
        a pair law over their neighbours.
        """

    @abc.abstractmethod
    def inertia(self, chamber: Chamber) -> Scalar | float:
        """Inertia of the water in the reach of the air's force, over that of all water that moves with it."""

    @abc.abstractmethod
    def water_pressure(self, weight: Float[Array, " N"]) -> Float[Array, " N"]:
        """Share (0 to 1) of P_a that is in the water's pressure but not in the scheme's own pressure.

        `weight`: weights chi of the chamber at the particles.
        """


class SurfaceGrip(AbstractGrip):
    """Coupling by the pair sum of the pressure gradient, for a scheme that knows no surface.

    The surface condition p = P_a enters the gradient as (p_j - P_a chi_i) + (p_i - P_a chi_i). The constant
    drops out where the kernel is full and acts at the surface, so no particle has to be called a surface
    particle (a switch, in Zhu et al. 2020, Eq. 15-16), and suction in the air puts no tension in the column.
    """

    def force(self, chamber, x, V, around):
        """See `AbstractGrip`."""
        s = around(laws.surface_vector)
        w = 2.0 * chamber.weight(x) * V
        return tuple(w * c for c in s)

    def inertia(self, chamber):
        """See `AbstractGrip`: 1, since sound takes several steps to the water below."""
        return 1.0

    def water_pressure(self, weight):
        """See `AbstractGrip`: zero, since the scheme's pressure is the water's."""
        return jnp.zeros_like(weight)


class BodyForceGrip(AbstractGrip):
    """Coupling by the body force -P_a chi'(z) in the place of the pressure P_a chi(z).

    For a scheme whose pressure is zero on the surface.
    """

    def force(self, chamber, x, V, around):
        """See `AbstractGrip`."""
        del around
        slope = jax.jvp(lambda z: chamber.weight((*x[:-1], z)), (x[-1],), (jnp.ones_like(x[-1]),))[1]
        return (*(jnp.zeros_like(V) for _ in x[:-1]), -slope * V)

    def inertia(self, chamber):
        """See `AbstractGrip`: the projection moves the whole column, and about a chamber's length below it.

        A force per volume of chi' has the inertia of a slug of 5/6 of the fading zone's height, and of no
        more: taken for the whole it makes the air softer than its law, by a sixth at dx = 0.04 m.
        """
        column = chamber.still - chamber.fade_low + chamber.length
        return 5.0 / 6.0 * (chamber.fade_high - chamber.fade_low) / column

    def water_pressure(self, weight):
        """See `AbstractGrip`."""
        return weight


class Chamber(AbstractChamber):
    """Water column under trapped air between two vertical walls, and the power take-off of the air.

    The air acts through a smooth weight chi of position that is 1 in the column and fades to 0 above the
    wall's tip. The flow is the matching sum, q = -sum_i f_i.u_i with the force f_i per unit of P_a: the
    volume flux through the fading zone, averaged over it. With it P_a q is exactly the power that the air's
    force takes from the particles.
    """

    pto: AbstractPTO
    """Power take-off of the air."""
    x0: Scalar
    """Inner face of the front wall, m."""
    x1: Scalar
    """Inner face of the back wall, m."""
    fade_low: Scalar
    """Level up to which chi is 0, m."""
    fade_high: Scalar
    """Level from which chi is 1, m."""
    still: Scalar
    """Still water level, m."""
    beyond: Scalar
    """Distance (m) behind the back wall's face up to which a particle pressed into the wall still counts."""
    grip: AbstractGrip = SurfaceGrip()
    """Coupling of the air's pressure to the water."""
    air: AbstractAirLaw = IncompressibleAir()
    """Air between the water and the power take-off."""
    name: str = eqx.field(static=True, default="chamber", kw_only=True)

    @classmethod
    def of(
        cls,
        pto: AbstractPTO,
        *,
        between: tuple[float, float],
        tip: float,
        level: float,
        dx: float,
        grip: AbstractGrip | None = None,
        air: AbstractAirLaw | None = None,
        name: str = "chamber",
        dtype: Any = jnp.float32,
    ) -> Chamber:
        """Builds a chamber from plain numbers.

        **Arguments**: `between`: inner faces of its front and back wall, m; `tip`: level of the front wall's
        tip, and `level` of still water, m; `dx`: spacing, m; `grip`: `SurfaceGrip` for the weakly
        compressible scheme (the default), `BodyForceGrip` for the incompressible one; `air`: such as
        `IsentropicAir`, or incompressible (the default). There is an argument for
        each property of the chamber.
        """
        numbers = {"x0": between[0], "x1": between[1], "still": level, "beyond": 0.5 * dx}
        numbers |= {"fade_low": tip, "fade_high": tip + 0.5 * (level - tip)}
        leaves = {key: jnp.asarray(value, dtype) for key, value in numbers.items()}
        grip = SurfaceGrip() if grip is None else grip
        air = IncompressibleAir() if air is None else air
        return cls(pto=pto, grip=grip, air=air, name=name, **leaves)

    def start(self, dtype: Any) -> Air:
        """See `AbstractChamber`: air at rest."""
        zero = jnp.zeros((), dtype)
        return Air(zero, zero, Tally.zero(dtype), self.air.start(dtype))

    @property
    def _suffix(self) -> str:
        return self.name.removeprefix("chamber")

    @property
    def energy(self) -> str:
        """Name in the ledger of the energy that the PTO takes."""
        return "pto" + self._suffix

    def entries(self):
        """See `AbstractChamber`."""
        found = {**self.pto.entries(self._suffix), **self.air.entries(self._suffix)}
        return {name + self._suffix: entry for name, entry in found.items()}

    def readings(self):
        """See `AbstractChamber`."""
        return self.air.readings()

    def read(self, own):
        """See `AbstractChamber`."""
        return self.air.read(own)

    @property
    def length(self) -> Scalar:
        """Length of the chamber between its walls, m."""
        return self.x1 - self.x0

    def inside(self, x: Components) -> Array:
        """Mask of points x (m) between the chamber's walls, True between them."""
        # A hard cut at the front wall's face cuts no particle: none is inside the wall.
        return (x[0] > self.x0 - 1e-4) & (x[0] < self.x1 + self.beyond)

    def weight(self, x: Components) -> Float[Array, " N"]:
        """Weight chi of the air's pressure at points x (m), 0 to 1."""
        s = jnp.clip((x[-1] - self.fade_low) / (self.fade_high - self.fade_low), 0.0, 1.0)
        return jnp.where(self.inside(x), s * s * (3.0 - 2.0 * s), 0.0)

    def candidates(self, x, margin, capacity):
        """See `AbstractChamber`."""
        near = (x[:, 0] > self.x0 - margin) & (x[:, 0] < self.x1 + self.beyond + margin)
        may = near & (x[:, -1] > self.fade_low - margin)
        index = jnp.nonzero(may, size=capacity, fill_value=x.shape[0])[0]
        return index.astype(jnp.int32), jnp.sum(may)

    def kick(self, own, scheme, water, sources, u, tables, t, dt):
        """See `AbstractChamber`."""
        index, n = tables.chambers[self.name], u.shape[0]
        slabs, i = tables.fluid.slabs, jnp.minimum(index, n - 1)
        fields = {"V": sources.water["V"], "m": water.m, "x": columns(water.x), "u": columns(u)}
        fields = slabs.take(fields, i)
        V = jnp.where(index < n, jnp.abs(fields["V"]), 0.0)
        # a particle without mass feels no force: whatever it is divided by
        m, x = jnp.where(fields["m"] > 0.0, fields["m"], 1.0), fields["x"]

        def around(law):
            return tables.fluid.sum_at(i, law, scheme.smoothing, {"x": x}, sources)

        force = self.grip.force(self, x, V, around)
        q_free = -jnp.sum(dot(force, fields["u"]))
        pto = self.pto.at(own, t)

        def press(compliance: Scalar) -> tuple[Scalar, Scalar]:
            return self.air.press(pto, own, q_free, compliance, t, dt)

        compliance = self._compliance(press, dt * jnp.sum(dot(force, force) / m), q_free)
        P_a, pressed = press(compliance)
        change = stack([dt * P_a * f / m for f in force])
        return Kick(slabs.add(u, index, change), P_a, index, force, slabs, pto, pressed)

    def _compliance(
        self, press: Callable[[Scalar], tuple[Scalar, Scalar]], alone: Scalar, q_free: Scalar
    ) -> Scalar:
        """Compliance -dq/dP_a of the water in a step (m2/s/Pa), from that of the water in the force's reach.

        All water that moves with it counts where the air is soft. A nearly closed chamber, whose pressure
        would more than stop the water in reach, has the compliance of that alone: too large, and stable.
        """
        # A flow of 1e-8 m2/s is none. A derivative divides by the bound's square, which float32 must hold.
        gain2 = (press(jnp.zeros_like(alone))[0] * alone) ** 2 / (q_free**2 + 1e-16)
        share = self.grip.inertia(self)
        return alone * (share + (1.0 - share) * gain2 / (1.0 + gain2))

    def finish(self, own, kick, before, after, dt):
        """See `AbstractChamber`."""
        i = jnp.minimum(kick.index, before.shape[0] - 1)
        both = kick.slabs.take((columns(before), columns(after)), i)
        old, q = (-jnp.sum(dot(kick.force, u)) for u in both)
        mean = 0.5 * (old + q)
        passed = self.air.passed(kick.pressed, mean)
        head, relieved = self.air.head(kick.P_a), kick.pto.relieved(kick.P_a, passed)
        # force times mean velocity over the step: exactly the kinetic energy that the force takes
        amounts = {
            "pto": dt * head * (passed - relieved),
            "relief": dt * head * relieved,
            "air": dt * (kick.P_a * mean - head * passed),
        }
        names = {name.removesuffix(self._suffix): name for name in self.entries()}
        air = Air(kick.P_a, q, own.driven.add(dt * q), self.air.finish(own, passed, mean, dt))
        return air, {full: amounts[name] for name, full in names.items()}

    def water_pressure(self, own, x):
        """See `AbstractChamber`."""
        return own.P_a * self.grip.water_pressure(self.weight(columns(x)))

    def volume(self, x: Components, V: Float[Array, " N"], smooth: Scalar) -> Scalar:
        """Volume of water in the chamber above the middle of the fading zone, m3 (m2 in 2-D).

        **Arguments**: positions x (m) and volumes V (m3; m2 in 2-D) of the particles; `smooth`: half the
        height (m) over which a particle counts in part.
        """
        level = 0.5 * (self.fade_low + self.fade_high)
        s = jnp.clip((x[-1] - level) / (2.0 * smooth) + 0.5, 0.0, 1.0)
        return jnp.sum(jnp.where(self.inside(x), V * s, 0.0))

    def level(self, x: Components, V: Float[Array, " N"], smooth: Scalar) -> Scalar:
        """Mean elevation of the chamber's surface over still water, m; arguments as for `volume`."""
        bottom = 0.5 * (self.fade_low + self.fade_high)
        return bottom + self.volume(x, V, smooth) / self.length - self.still
