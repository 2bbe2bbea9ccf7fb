"""Rigid bodies in the water: their motion in the x-z plane, and a rotational power take-off
(Yeylaghi et al. 2016, Eq. 18-21).

The generalised coordinates are surge (m), heave (m) and pitch (rad) of the pivot, positive along x, upwards
and, for pitch, from z towards x: landward for a flap. Forces go with them: N, N, N m (per metre in 2-D).
"""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.model.interfaces import AbstractBody
from jaxsph.model.state import BodyState
from jaxsph.solids.shapes import AbstractShape


class RotationalPTO(eqx.Module):
    """Moment against the pitch of a flap: linear and Coulomb damping, a spring, and end stops."""

    damping: Scalar
    """N m s/rad."""
    coulomb: Scalar
    """N m, reached smoothly within a hundredth of a rad/s."""
    spring: Scalar
    """N m/rad, about the upright."""
    stop: Scalar
    """Angle to either side at which the end stops begin, rad."""
    stop_stiffness: Scalar
    """N m/rad."""

    @classmethod
    def of(cls, damping=0.0, coulomb=0.0, spring=0.0, stop=np.pi, stop_stiffness=0.0, dtype=jnp.float32):
        """From plain numbers."""
        return cls(*(jnp.asarray(a, dtype) for a in (damping, coulomb, spring, stop, stop_stiffness)))

    def friction(self, omega: Scalar) -> Scalar:
        """Moment of the Coulomb damping, N m."""
        return -self.coulomb * jnp.tanh(omega / 0.01)

    def restoring(self, angle: Scalar) -> Scalar:
        """Moment of the spring and the end stops, N m."""
        beyond = jnp.maximum(jnp.abs(angle) - self.stop, 0.0) * jnp.sign(angle)
        return -self.spring * angle - self.stop_stiffness * beyond

    def stored(self, angle: Scalar) -> Scalar:
        """Energy of the spring and the end stops, J."""
        beyond = jnp.maximum(jnp.abs(angle) - self.stop, 0.0)
        return 0.5 * (self.spring * angle**2 + self.stop_stiffness * beyond**2)


class RigidBody(AbstractBody):
    """A rigid body some of whose motions are free; the others go on at the velocity that they have."""

    shape: AbstractShape
    mass: Scalar
    """kg (kg/m in 2-D)."""
    inertia: Scalar
    """About the pivot, kg m2 (kg m in 2-D)."""
    pivot: Float[Array, "2"]
    """x and z at rest, m: the hinge, or the centre of mass where more than pitch is free."""
    centre: Float[Array, "2"]
    """Centre of mass at rest, m."""
    free: tuple[bool, bool, bool] = eqx.field(static=True)
    """Surge, heave, pitch."""
    release: Scalar | float = 0.0
    """Time from which it is free, s."""
    pto: RotationalPTO | None = None

    def __check_init__(self) -> None:
        """Refuses what the equations of motion do not hold for."""
        if self.free[2] and any(self.free[:2]) and not isinstance(self.pivot, jax.core.Tracer):
            if not np.allclose(np.asarray(self.pivot, float), np.asarray(self.centre, float)):
                raise ValueError("pivot: must be the centre of mass where pitch and another motion are free")

    def movable(self, t):
        """See `AbstractBody`."""
        return jnp.asarray(self.free, t.dtype) * (t >= self.release)

    def generalised_mass(self):
        """See `AbstractBody`."""
        return jnp.stack([self.mass, self.mass, self.inertia])

    def moved(self, x, body):
        """See `AbstractBody`."""
        return self._turned(x - self._at(x), body.pose[2]) + self._at(x, body)

    def at_rest(self, x: Float[Array, "N D"], body: BodyState) -> Float[Array, "N D"]:
        """The inverse of `moved`."""
        return self._turned(x - self._at(x, body), -body.pose[2]) + self._at(x)

    def velocity(self, x, body):
        """See `AbstractBody`."""
        return jnp.einsum("knd,k->nd", self.directions(x, body), body.velocity)

    def directions(self, x, body):
        """See `AbstractBody`."""
        r, zero, one = x - self._at(x, body), jnp.zeros_like(x), jnp.ones_like(x[:, 0])
        return jnp.stack(
            [
                zero.at[:, 0].set(one),
                zero.at[:, -1].set(one),
                zero.at[:, 0].set(r[:, -1]).at[:, -1].set(-r[:, 0]),
            ]
        )

    def centripetal(self, x, body):
        """See `AbstractBody`."""
        r = (x - self._at(x, body)) * jnp.zeros(x.shape[1], x.dtype).at[jnp.array([0, -1])].set(1.0)
        return -(body.velocity[2] ** 2) * r

    def external(self, body, g):
        """See `AbstractBody`: weight, friction, spring and stops."""
        arm = jnp.zeros((1, 2), g.dtype).at[0].set(self.centre - self.pivot)
        arm = self._turned(arm, body.pose[2])[0]
        weight = self.mass * g[jnp.array([0, -1])]
        moment = arm[1] * weight[0] - arm[0] * weight[1]
        if self.pto is not None:
            moment = moment + self.pto.friction(body.velocity[2]) + self.pto.restoring(body.pose[2])
        return jnp.stack([weight[0], weight[1], moment])

    def damping(self):
        """See `AbstractBody`."""
        zero = jnp.zeros_like(self.mass)
        return jnp.stack([zero, zero, zero if self.pto is None else self.pto.damping])

    def absorbed(self, old, new, dt):
        """See `AbstractBody`."""
        if self.pto is None:
            return jnp.zeros_like(dt)
        mean = 0.5 * (old.velocity[2] + new.velocity[2])
        return dt * mean * (self.pto.damping * new.velocity[2] - self.pto.friction(old.velocity[2]))

    def normals(self, x, body):
        """See `AbstractBody`."""
        # at rest, where points as near to one face as to another are so whatever rounding makes of the pose
        away, back = jax.vjp(self.shape.distance, jax.lax.stop_gradient(x))
        (normal,) = back(jnp.ones_like(away))
        normal = normal / jnp.sqrt(jnp.sum(normal**2, axis=1, keepdims=True) + 1e-12)
        return self._turned(normal, body.pose[2])

    def energy(self, body, g):
        """See `AbstractBody`."""
        kinetic = 0.5 * jnp.sum(self.generalised_mass() * body.velocity**2)
        arm = self._turned((self.centre - self.pivot)[None], body.pose[2])[0] - (self.centre - self.pivot)
        potential = -self.mass * jnp.sum(g[jnp.array([0, -1])] * (body.pose[:2] + arm))
        if self.pto is not None:
            potential = potential + self.pto.stored(body.pose[2])
        return kinetic, potential

    def distance(self, x, body):
        """See `AbstractBody`."""
        return self.shape.distance(self.at_rest(x, body))

    def _at(self, x: Float[Array, "N D"], body: BodyState | None = None) -> Float[Array, " D"]:
        at = self.pivot if body is None else self.pivot + body.pose[:2]
        return jnp.zeros(x.shape[1], x.dtype).at[jnp.array([0, -1])].set(at)

    @staticmethod
    def _turned(r: Float[Array, "N D"], angle: Scalar) -> Float[Array, "N D"]:
        c, s = jnp.cos(angle), jnp.sin(angle)
        return r.at[:, 0].set(c * r[:, 0] + s * r[:, -1]).at[:, -1].set(c * r[:, -1] - s * r[:, 0])
