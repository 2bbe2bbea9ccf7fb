"""Interfaces of links: forces between two points, or along a coordinate of a joint, and their laws.

A link acts along its extension s, a length (m) or an angle (rad), with a force (N; N/m in 2-D) or a moment (N
m; N in 2-D) that is positive if it increases s. The extension may also be a vector, for example from an
anchor to a fairlead; the force is then a vector, too. The units below are for a link along a length. For a
link along an angle, replace m by rad and N by N m. In 2-D all quantities are per metre of width.
"""

from __future__ import annotations

import abc
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.model.meaning import Entry, Exchange, Oscillation, Reading
from jaxsph.model.part import AbstractPart
from jaxsph.model.rigid import SPACES

__all__ = ["AbstractEnds", "AbstractLaw", "Extension", "Link", "LinkMotion", "Places", "positive_part"]


class Places(NamedTuple):
    """Positions and joint coordinates of all bodies at one time, by the body's name."""

    poses: Mapping[str, Float[Array, " P"]]
    """Poses of the bodies (`model.rigid`)."""
    pivots: Mapping[str, Float[Array, " D"]]
    """Pivots at rest, m."""
    q: Mapping[str, Float[Array, " k"]]
    """Coordinates of the bodies' joints, m or rad."""

    def point(self, body: str, x: Float[Array, " D"]) -> Float[Array, " D"]:
        """Present position (m) of a point of a body, or of the tank if `body` is empty, from the point's
        position x (m) at rest."""
        if not body:
            return x
        pose, arm = self.poses[body], x - self.pivots[body]
        return x + SPACES[len(x)].moved(pose, arm)[: len(x)]


Extension: TypeAlias = Float[Array, "*components"]
"""Extension of a link, or its rate or force: a number, or a vector of k components."""


class AbstractEnds(eqx.Module):
    """Ends of a link: the bodies that it connects, and its extension as a function of the bodies'
    positions."""

    @property
    @abc.abstractmethod
    def unit(self) -> str:
        """Unit of the extension, "m" or "rad"."""

    @abc.abstractmethod
    def extension(self, places: Places) -> Extension:
        """Extension s, m or rad."""

    def points(self, places: Places) -> Float[Array, "E D"]:
        """Positions (m) of the two ends, for pictures; none by default."""
        del places
        return jnp.zeros((0, 2))

    @property
    @abc.abstractmethod
    def bodies(self) -> tuple[str, ...]:
        """Names of the bodies that the link connects."""


class AbstractLaw(eqx.Module):
    """Law of a link's force.

    The law's force is minus the derivative of the energy `stored` with respect to the extension, plus
    `force`, which contains all other contributions, such as dampers, friction and control. The step treats
    both terms implicitly, linearised with their derivatives, so that stiff laws are stable.
    """

    @property
    def dissipates(self) -> bool:
        """Whether the law has a `force` in addition to the force of its stored energy."""
        return True

    def start(self, s: Extension) -> Any:
        """State of the law at t = 0, at the extension s (m); empty by default."""
        del s
        return ()

    def stored(self, own: Any, s: Extension) -> Scalar:
        """Energy stored at the extension s (m), J; zero by default. `own`: state of the law."""
        del own
        return jnp.zeros((), s.dtype)

    def force(self, own: Any, s: Extension, v: Extension, t: Scalar) -> Extension:
        """Force at the extension s (m), its rate v (m/s) and the time t (s), N; zero by default."""
        del own, v, t
        return jnp.zeros_like(s)

    def advance(self, own: Any, s: Extension, v: Extension, t: Scalar, dt: Scalar) -> Any:
        """State of the law after a step of dt (s); unchanged by default.

        **Arguments**: the extension s (m) after the step, the mean rate v (m/s) during the step, and the time
        t (s) in the middle of the step.
        """
        del s, v, t, dt
        return own


class LinkMotion(eqx.Module):
    """State of a link."""

    own: Any
    """State of the link's law."""
    extension: Extension
    """Extension, m or rad."""
    force: Extension
    """Force in the last step, or at t = 0 the force of the link at rest, N or N m (per metre in 2-D)."""


class Pull(NamedTuple):
    """Force of a link in a step, as a linear function of the accelerations of the n coordinates.

    A scalar extension has k = 1 component.
    """

    way: Float[Array, "k n"]
    """Change of the extension per unit change of each coordinate."""
    rate: Float[Array, " k"]
    """Rate of the extension before the step, m/s or rad/s."""
    elastic: Float[Array, " k"]
    """Force from the stored energy at constant rate, N or N m."""
    other: Float[Array, " k"]
    """Other force at constant rate, N or N m."""
    stiffness: Float[Array, "k k"]
    """Decrease of the force per unit increase of the extension, N/m or N m; positive semi-definite."""
    damping: Float[Array, "k k"]
    """Decrease of the force per unit increase of the rate, N s/m or N m s; positive semi-definite."""

    @property
    def force(self) -> Float[Array, " n"]:
        """Generalised force on the coordinates at constant rate, N or N m."""
        return (self.elastic + self.other) @ self.way

    def inertia(self, dt: Scalar) -> Float[Array, "n n"]:
        """Decrease of the generalised force per unit acceleration of the coordinates in a step of dt (s), in
        kg, kg m or kg m2.

        The elastic force is evaluated at the mean of the extensions before and after the step (midpoint
        rule), and the damping force at the rate after the step.
        """
        return self.way.T @ (dt * self.damping + 0.25 * dt**2 * self.stiffness) @ self.way


class Link(AbstractPart):
    """Spring, damper, take-off or other force between two bodies, or between a body and the tank."""

    ends: AbstractEnds
    """Ends of the link, which determine its extension."""
    law: AbstractLaw
    """Law of the force."""
    harvests: bool = eqx.field(static=True, default=False, kw_only=True)
    """Whether the energy that the link absorbs counts as harvested by a power take-off."""
    name: str = eqx.field(static=True, default="pto", kw_only=True)
    usual_name: ClassVar[str] = "pto"

    def start(self, s: Extension, t: Scalar) -> LinkMotion:
        """State of the link at rest at the extension s (m), at the time t (s)."""
        own = self.law.start(s)
        other = self.law.force(own, s, jnp.zeros_like(s), t)
        return LinkMotion(own, s, other - jax.grad(self.law.stored, argnums=1)(own, s))

    def drawn(self, motion: LinkMotion, places: Places) -> Float[Array, "K D"]:
        """Points (m) of the line that pictures show, from end to end; none for a link along a joint."""
        del motion
        return self.ends.points(places)

    def entries(self):
        """See `AbstractPart`."""
        if not self.law.dissipates:
            return {}
        if self.harvests:
            return {self.name: Entry(f"power take-off {self.name}", Exchange.HARVESTED)}
        return {self.name: Entry(f"energy absorbed by the link {self.name}")}

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

    def pull(
        self, motion: LinkMotion, s: Extension, way: Float[Array, "k n"], rate: Float[Array, " k"], t: Scalar
    ) -> Pull:
        """Force of the link at the time t (s).

        **Arguments**: the state `motion`; the extension s (m or rad), its derivatives `way` with respect to
        the coordinates, and its `rate` (m/s or rad/s).
        """

        def slope(flat):
            return jax.grad(lambda flat: self.law.stored(motion.own, flat.reshape(s.shape)))(flat)

        def force(rate):
            found = self.law.force(motion.own, s, rate.reshape(s.shape), t).reshape(-1)
            return found, found

        softening, other = jax.jacfwd(force, has_aux=True)(rate)
        stiffness = jax.jacfwd(slope)(s.reshape(-1))
        # a law that drives the motion would make the step unstable if it were treated implicitly
        return Pull(
            way, rate, -slope(s.reshape(-1)), other, positive_part(stiffness), positive_part(-softening)
        )

    def done(
        self,
        motion: LinkMotion,
        s: Extension,
        pull: Pull,
        acceleration: Float[Array, " n"],
        t: Scalar,
        dt: Scalar,
    ) -> tuple[LinkMotion, dict[str, Scalar]]:
        """State of the link after a step of dt (s), and the energy that the link absorbed, by ledger name, J.

        **Arguments**: the extension s (m) and the force `pull` at the time t (s), at which the step
        evaluates the forces; `acceleration` (m/s2 or rad/s2) of the bodies' coordinates due to all forces.
        """
        change = dt * (pull.way @ acceleration)
        mean, other = pull.rate + 0.5 * change, pull.other - pull.damping @ change
        end = s + (0.5 * dt * (pull.rate + change)).reshape(s.shape)
        own = self.law.advance(motion.own, end, mean.reshape(s.shape), t, dt)
        kept = self.law.stored(own, end) - self.law.stored(motion.own, end)
        force = pull.elastic - 0.25 * dt * (pull.stiffness @ change) + other
        taken = -dt * (other @ mean) - kept
        return LinkMotion(own, end, force.reshape(s.shape)), dict.fromkeys(self.entries(), taken)

    def _force_unit(self, dim: int) -> str:
        """Unit of the force, or of the moment."""
        flat, solid = ("N m-1", "N") if self.ends.unit == "m" else ("N", "N m")
        return flat if dim == 2 else solid


@jax.custom_jvp
def positive_part(matrix: Float[Array, "k k"]) -> Float[Array, "k k"]:
    """Symmetric part of a matrix, with negative eigenvalues set to zero."""
    values, vectors = _eigen(matrix)
    return (vectors * jnp.maximum(values, 0.0)) @ vectors.T


@positive_part.defjvp
def _positive_part_jvp(primals, tangents):
    """Derivative of `positive_part` by divided differences of the eigenvalues, valid also for equal
    eigenvalues (Higham 2008, theorem 3.11)."""
    (matrix,), (change,) = primals, tangents
    values, vectors = _eigen(matrix)
    kept = jnp.maximum(values, 0.0)
    apart = values[:, None] - values
    equal = apart == 0.0
    slopes = jnp.where(
        equal, jnp.heaviside(values, 0.0), (kept[:, None] - kept) / jnp.where(equal, 1.0, apart)
    )
    turned_change = vectors.T @ (0.5 * (change + change.T)) @ vectors
    return positive_part(matrix), vectors @ (slopes * turned_change) @ vectors.T


def _eigen(matrix: Float[Array, "k k"]) -> tuple[Float[Array, " k"], Float[Array, "k k"]]:
    """Eigenvalues and eigenvectors of the symmetric part of a matrix."""
    if len(matrix) == 1:
        return matrix[0], jnp.ones_like(matrix)
    values, vectors = jnp.linalg.eigh(0.5 * (matrix + matrix.T))
    return values, vectors
