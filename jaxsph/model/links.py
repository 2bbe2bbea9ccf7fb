"""Interfaces of links: forces between two points, or along a coordinate of a joint, and their laws.

A link acts along its extension s, a length (m) or an angle (rad), with a force (N; N/m in 2-D) or a moment
(N m; N in 2-D) that is positive if it increases s. In the units below, a link along an angle has N m for N,
rad for m, and all quantities are per metre of width in 2-D.
"""

from __future__ import annotations

import abc
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.model.meaning import Entry, Exchange, Oscillation, Reading
from jaxsph.model.part import AbstractPart
from jaxsph.model.solids import turned

__all__ = ["AbstractEnds", "AbstractLaw", "Link", "LinkMotion", "Places"]


class Places(NamedTuple):
    """Places of all bodies at one time, by the body's name."""

    poses: Mapping[str, Float[Array, "3"]]
    """Displacements of the pivots along x and z (m), and pitch (rad)."""
    pivots: Mapping[str, Float[Array, "2"]]
    """Pivots (x, z) at rest, m."""
    q: Mapping[str, Float[Array, " k"]]
    """Coordinates of the bodies' joints, m or rad."""

    def point(self, body: str, x: Float[Array, "2"]) -> Float[Array, "2"]:
        """Present position (m) of a point of a body, from its position x (m) at rest; no name: the tank."""
        if not body:
            return x
        pose, pivot = self.poses[body], self.pivots[body]
        return pivot + pose[:2] + turned(x - pivot, pose[2])


class AbstractEnds(eqx.Module):
    """What a link connects, and the extension that follows from the bodies' places."""

    @property
    @abc.abstractmethod
    def unit(self) -> str:
        """Unit of the extension, "m" or "rad"."""

    @abc.abstractmethod
    def extension(self, places: Places) -> Scalar:
        """Extension s, m or rad."""

    @property
    @abc.abstractmethod
    def bodies(self) -> tuple[str, ...]:
        """Names of the bodies that the link connects."""


class AbstractLaw(eqx.Module):
    """Law of a link's force.

    The force is minus the slope of the energy `stored`, plus the `force` of everything else: dampers,
    friction, control. Both are made implicit in the step by their derivatives, so that stiff laws are stable.
    """

    @property
    def dissipates(self) -> bool:
        """Whether the law has a `force` besides that of its stored energy."""
        return True

    def start(self, dtype: Any) -> Any:
        """State of the law at t = 0; empty by default."""
        del dtype
        return ()

    def stored(self, own: Any, s: Scalar) -> Scalar:
        """Energy stored at the extension s (m), J; zero by default. `own`: state of the law."""
        del own
        return jnp.zeros_like(s)

    def force(self, own: Any, s: Scalar, v: Scalar, t: Scalar) -> Scalar:
        """Force at the extension s (m), its rate v (m/s) and the time t (s), N; zero by default."""
        del own, v, t
        return jnp.zeros_like(s)

    def advance(self, own: Any, s: Scalar, v: Scalar, t: Scalar, dt: Scalar) -> Any:
        """State of the law after a step of dt (s) at the mean rate v (m/s); unchanged by default."""
        del s, v, t, dt
        return own


class LinkMotion(eqx.Module):
    """State of a link."""

    own: Any
    """State of its law."""
    extension: Scalar
    """Extension, m or rad."""
    force: Scalar
    """Force of the last step, at first that of the stored energy, N or N m (per metre in 2-D)."""


class Pull(NamedTuple):
    """Force of a link in a step, as a linear function of the coordinates' accelerations."""

    way: Float[Array, " n"]
    """Change of the extension per unit change of each coordinate."""
    rate: Scalar
    """Rate of the extension before the step, m/s or rad/s."""
    elastic: Scalar
    """Force from the stored energy at constant rate, N or N m."""
    other: Scalar
    """Other force at constant rate, N or N m."""
    stiffness: Scalar
    """Force per unit change of the extension, N/m or N m."""
    damping: Scalar
    """Force per unit change of the rate, N s/m or N m s."""

    def impedance(self, dt: Scalar) -> Scalar:
        """Decrease of the force per unit acceleration of the extension in a step of dt (s), kg or kg m2.

        The stored energy acts at the mean of the extensions before and after the step, the midpoint rule, and
        the damping at the rate after the step.
        """
        return dt * self.damping + 0.25 * dt**2 * self.stiffness


class Link(AbstractPart):
    """Spring, damper, take-off or other force between two bodies, or between a body and the tank."""

    ends: AbstractEnds
    """What the link connects."""
    law: AbstractLaw
    """Law of the force."""
    harvests: bool = eqx.field(static=True, default=False, kw_only=True)
    """Whether the energy that the link takes is the power of a device."""
    name: str = eqx.field(static=True, default="pto", kw_only=True)
    usual_name: ClassVar[str] = "pto"

    def start(self, dtype: Any) -> LinkMotion:
        """State of the link at t = 0, before the extension is known."""
        none = jnp.zeros((), dtype)
        return LinkMotion(self.law.start(dtype), none, none)

    def entries(self):
        """See `AbstractPart`."""
        if not self.law.dissipates:
            return {}
        if self.harvests:
            return {self.name: Entry(f"power take-off {self.name}", Exchange.HARVESTED)}
        return {self.name: Entry(f"energy taken by the link {self.name}")}

    def readings(self, dim):
        """See `AbstractPart`."""
        return {
            self.called("link_force"): Reading(self._force_unit(dim), f"force of the link {self.name}"),
            self.called("link_extension"): Reading(self.ends.unit, f"extension of the link {self.name}"),
        }

    def read(self, state, sampled):
        """See `AbstractPart`."""
        del sampled
        return {self.called("link_force"): state.force, self.called("link_extension"): state.extension}

    def oscillations(self, dim):
        """See `AbstractPart`."""
        return {
            name: Oscillation(name, reading.long_name, reading.units, None, True, True)
            for name, reading in self.readings(dim).items()
        }

    def pull(self, motion: LinkMotion, s: Scalar, way: Float[Array, " n"], rate: Scalar, t: Scalar) -> Pull:
        """Force of the link at the time t (s).

        **Arguments**: the state `motion`; the extension s (m), its derivatives `way` by the coordinates and
        its `rate` (m/s).
        """
        own, slope = motion.own, jax.grad(self.law.stored, argnums=1)
        force, softening = jax.value_and_grad(self.law.force, argnums=2)(own, s, rate, t)
        stiffness = jax.grad(slope, argnums=1)(own, s)
        # a law that drives the motion would make the step unstable if it were implicit
        stiffness, damping = jnp.maximum(stiffness, 0.0), jnp.maximum(-softening, 0.0)
        return Pull(way, rate, -slope(own, s), force, stiffness, damping)

    def done(
        self,
        motion: LinkMotion,
        s: Scalar,
        pull: Pull,
        acceleration: Float[Array, " n"],
        t: Scalar,
        dt: Scalar,
    ) -> tuple[LinkMotion, dict[str, Scalar]]:
        """State of the link after a step of dt (s), and the energy that it took, by ledger name, J.

        **Arguments**: the extension s (m) and the force `pull` at the time t (s) of the step's forces;
        `acceleration` (m/s2 or rad/s2) of the bodies' coordinates by all forces.
        """
        change = dt * (pull.way @ acceleration)
        mean, other = pull.rate + 0.5 * change, pull.other - pull.damping * change
        own = self.law.advance(motion.own, s, mean, t, dt)
        kept = self.law.stored(own, s) - self.law.stored(motion.own, s)
        force = pull.elastic - 0.25 * dt * pull.stiffness * change + other
        taken = -dt * other * mean - kept
        return LinkMotion(own, s + 0.5 * dt * (pull.rate + change), force), dict.fromkeys(
            self.entries(), taken
        )

    def _force_unit(self, dim: int) -> str:
        """Unit of the force, or of the moment."""
        flat, solid = ("N m-1", "N") if self.ends.unit == "m" else ("N", "N m")
        return flat if dim == 2 else solid
