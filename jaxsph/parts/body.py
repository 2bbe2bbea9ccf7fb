"""Rigid bodies that move in the x-z plane under the water's forces (Yeylaghi et al. 2016, Eq. 18-21).

The generalised coordinates are surge (m), heave (m) and pitch (rad) of the pivot. Surge is positive along x,
heave upwards, and pitch from z towards x (landward for a flap). The generalised forces are two forces and a
moment: N, N, N m (per metre in 2-D).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.model.meaning import Entry, Exchange, Oscillation, Reading
from jaxsph.model.solids import AbstractBody
from jaxsph.model.state import Tally
from jaxsph.parts.pose import PosedSolid, turn
from jaxsph.parts.rotational import AbstractRotationalPTO, FreeHinge
from jaxsph.solids.shapes import AbstractShape

__all__ = ["BodyMotion", "RigidBody", "advance_body"]

MOTIONS = ("surge", "heave", "pitch")
"""Names of a body's motions, in the order of its coordinates."""


class BodyMotion(eqx.Module):
    """Motion of a rigid body at time t in surge, heave and pitch, and the water's force on it."""

    pose: Float[Array, "3"]
    """Surge (m), heave (m) and pitch (rad) from the position at rest."""
    velocity: Float[Array, "3"]
    """Velocities of surge, heave and pitch, m/s, m/s, rad/s."""
    force: Float[Array, "3"]
    """Force of the water's pressure in the last step, N, N, N m (per metre in 2-D)."""
    contact: Float[Array, "3"]
    """Contact force of the water in the last step, N, N, N m (per metre in 2-D).

    It acts on the body in the next step.
    """
    impulse: Tally
    """Impulse `[3]` of the water's force, N s, N s, N m s (per metre in 2-D)."""

    @classmethod
    def at_rest(cls, dtype: Any, velocity: Any = (0.0, 0.0, 0.0), pose: Any = (0.0, 0.0, 0.0)) -> BodyMotion:
        """Motion with this velocity (m/s, m/s, rad/s) and pose (m, m, rad), and without water forces."""
        none = jnp.zeros(3, dtype)
        return cls(
            jnp.asarray(pose, dtype), jnp.asarray(velocity, dtype), none, none, Tally.zero(dtype, (3,))
        )


class RigidBody(PosedSolid, AbstractBody):
    """Rigid body whose free motions follow the forces on it; its other motions keep their velocities."""

    shape: AbstractShape
    """Shape in the position at rest."""
    mass: Scalar
    """Mass, kg (kg/m in 2-D)."""
    inertia: Scalar
    """Moment of inertia about the pivot, kg m2 (kg m in 2-D)."""
    pivot: Float[Array, "2"]
    """Pivot (x, z) at rest, m: the hinge, or the centre of mass if pitch and another motion are free."""
    centre: Float[Array, "2"]
    """Centre of mass (x, z) at rest, m."""
    free: tuple[bool, bool, bool] = eqx.field(static=True)
    """Whether surge, heave and pitch are free."""
    release: Scalar
    """Time at which the free motions are released, s."""
    pto: AbstractRotationalPTO
    """Power take-off, spring and stops on the pitch; `parts.rotational.FreeHinge` without these."""
    rows: tuple[int, int] = eqx.field(static=True)
    """Index of the body's first ghost, and of the ghost after its last: an entry of `Ghosts.dummies`."""
    initial_velocity: tuple[float, float, float] = eqx.field(static=True, default=(0.0, 0.0, 0.0))
    """Velocities of surge, heave and pitch at t = 0, m/s, m/s, rad/s."""
    initial_pitch: float = eqx.field(static=True, default=0.0)
    """Pitch at t = 0, rad."""
    name: str = eqx.field(static=True, default="body", kw_only=True)
    usual_name: ClassVar[str] = "body"

    def __check_init__(self) -> None:
        """Checks the pivot. **Raises** ValueError if the equations of motion do not hold for this pivot."""
        if self.free[2] and any(self.free[:2]) and not isinstance(self.pivot, Tracer):
            if not np.allclose(np.asarray(self.pivot, float), np.asarray(self.centre, float)):
                raise ValueError("pivot: must be the centre of mass if pitch and another motion are free")

    @classmethod
    def of(
        cls,
        shape: AbstractShape,
        rows: tuple[int, int],
        free: Sequence[str],
        *,
        density: float,
        pivot: tuple[float, float] | None = None,
        pto: AbstractRotationalPTO | None = None,
        name: str = "body",
        dtype: Any = jnp.float32,
    ) -> RigidBody:
        """Builds a body of uniform density (kg/m3), at rest.

        **Arguments**: `rows`: the entry of `Ghosts.dummies` that belongs to the shape; `free`: any of
        "surge", "heave" and "pitch"; `pivot`: hinge (x, z), m, by default the centre of mass; `pto`: power
        take-off on the body's pitch.
        """
        area, centre, second = shape.moments()
        pivot = centre if pivot is None else pivot
        arm2 = float(np.sum((np.asarray(centre) - np.asarray(pivot)) ** 2))

        def leaf(value: Any) -> Array:
            return jnp.asarray(value, dtype)

        return cls(
            shape=jax.tree.map(leaf, shape),
            rows=rows,
            mass=leaf(density * area),
            inertia=leaf(density * (second + area * arm2)),
            pivot=leaf(pivot),
            centre=leaf(centre),
            free=("surge" in free, "heave" in free, "pitch" in free),
            release=leaf(0.0),
            pto=FreeHinge() if pto is None else pto,
            name=name,
        )

    def start(self, dtype: Any) -> BodyMotion:
        """See `AbstractMovingSolid`."""
        return BodyMotion.at_rest(dtype, self.initial_velocity, (0.0, 0.0, self.initial_pitch))

    def entries(self):
        """See `AbstractPart`."""
        found = dict(self.pto.entries(self.name))
        if not self.fixed and not all(self.free):
            found["body_drive"] = Entry(f"work of the imposed motion of the {self.name}", Exchange.GIVEN)
        return {self.called(name): entry for name, entry in found.items()}

    def readings(self, dim):
        """See `AbstractPart`."""
        units = "N m-1, N m-1, N" if dim == 2 else "N, N, N m"
        force = f"the water's force on the {self.name}, and its moment about the pivot"
        forces = {
            "body_force": Reading(units, force, "motion"),
            "body_force_mean": Reading(units, f"{force}, mean since the last sample", "motion"),
        }
        motion = {
            "surge": Reading("m", f"displacement of the {self.name} along the tank"),
            "heave": Reading("m", f"displacement of the {self.name} upwards"),
            "pitch": Reading("rad", f"angle of the {self.name}, positive landward"),
            "body_velocity": Reading(
                "m s-1, m s-1, rad s-1", "velocities of surge, heave and pitch", "motion"
            ),
        }
        return {self.called(name): reading for name, reading in self._told(motion, forces).items()}

    def oscillations(self, dim):
        """See `AbstractPart`."""
        force, moment = ("N/m", "N") if dim == 2 else ("N", "N m")
        motion = {
            name: Oscillation(self.called(name), f"{name} of the {self.name}", unit, None, True, True)
            for name, unit, free in zip(MOTIONS, ("m", "m", "rad"), self.free, strict=True)
            if free
        }
        (reading,) = self._told({}, {"body_force_mean": None})
        forces = {
            name: Oscillation(self.called(reading), f"{words} on the {self.name}", unit, k, True, True)
            for k, (name, words, unit) in enumerate(
                (
                    ("body_force_x", "force along the tank", force),
                    ("body_force_z", "force upwards", force),
                    ("body_moment", "moment", moment),
                )
            )
        }
        return {self.called(name): one for name, one in self._told(motion, forces).items()}

    def read(self, state, sampled):
        """See `AbstractPart`."""
        forces = {
            "body_force": state.force + state.contact,
            "body_force_mean": state.impulse.recent / sampled.interval,
        }
        motion = {
            "surge": state.pose[0],
            "heave": state.pose[1],
            "pitch": state.pose[2],
            "body_velocity": state.velocity,
        }
        return {self.called(name): value for name, value in self._told(motion, forces).items()}

    @property
    def fixed(self) -> bool:
        """Whether the body does not move: no motion is free, and no initial velocity is given."""
        return not any((*self.free, *self.initial_velocity))

    def _told(self, motion: dict[str, Any], forces: dict[str, Any]) -> dict[str, Any]:
        """Readings of the body by name: `motion` and `forces`, or only `forces` for a fixed body."""
        if not self.fixed:
            return motion | forces
        if self.name == self.usual_name:
            return forces
        return {name.removeprefix("body_"): force for name, force in forces.items()}

    def exchanges(self, taken, driven):
        """See `AbstractBody`."""
        names = {Exchange.HARVESTED: taken, Exchange.GIVEN: driven}
        return {name: names[entry.exchange] for name, entry in self.entries().items()}

    def movable(self, t):
        """See `AbstractBody`."""
        return jnp.asarray(self.free, t.dtype) * (t >= self.release).astype(t.dtype)

    def generalised_mass(self):
        """See `AbstractBody`."""
        return jnp.stack([self.mass, self.mass, self.inertia])

    def halfway(self, old, new, dt):
        """See `AbstractMovingSolid`: the motion half a step on, with the velocity at the step's beginning."""
        del new
        return advance_body(old, jnp.zeros_like(old.velocity), 0.5 * dt)

    def velocity(self, motion, x):
        """See `AbstractMovingSolid`."""
        return jnp.einsum("knd,k->nd", self.directions(motion, x), motion.velocity)

    def directions(self, motion, x):
        """See `AbstractBody`."""
        r, zero, one = self.lever(motion, x), jnp.zeros_like(x), jnp.ones_like(x[:, 0])
        return jnp.stack(
            [
                zero.at[:, 0].set(one),
                zero.at[:, -1].set(one),
                zero.at[:, 0].set(r[:, -1]).at[:, -1].set(-r[:, 0]),
            ]
        )

    def external(self, motion, g):
        """See `AbstractBody`: weight, friction, spring and stops."""
        arm = jnp.zeros((1, 2), g.dtype).at[0].set(self.centre - self.pivot)
        arm = turn(arm, motion.pose[2])[0]
        weight = self.mass * g[jnp.array([0, -1])]
        moment = arm[1] * weight[0] - arm[0] * weight[1]
        moment = moment + self.pto.moment(motion.pose[2], motion.velocity[2])
        return jnp.stack([weight[0], weight[1], moment])

    def damping(self):
        """See `AbstractBody`."""
        zero = jnp.zeros_like(self.mass)
        return jnp.stack([zero, zero, self.pto.linear_damping(zero)])

    def absorbed(self, old, new, dt):
        """See `AbstractBody`."""
        return self.pto.absorbed(old.velocity[2], new.velocity[2], dt)

    def normals(self, motion, x):
        """See `AbstractBody`."""
        # evaluated at rest, since rounding of the pose must not decide between two equally near faces
        away, back = jax.vjp(self.shape.distance, jax.lax.stop_gradient(x))
        (normal,) = back(jnp.ones_like(away))
        normal = normal / jnp.sqrt(jnp.sum(normal**2, axis=1, keepdims=True) + 1e-12)
        return turn(normal, motion.pose[2])

    def energy(self, motion, g):
        """See `AbstractBody`."""
        kinetic = 0.5 * jnp.sum(self.generalised_mass() * motion.velocity**2)
        arm = turn((self.centre - self.pivot)[None], motion.pose[2])[0] - (self.centre - self.pivot)
        potential = -self.mass * jnp.sum(g[jnp.array([0, -1])] * (motion.pose[:2] + arm))
        return kinetic, potential + self.pto.stored(motion.pose[2])


def advance_body(motion: BodyMotion, acceleration: Float[Array, "3"], dt: Scalar) -> BodyMotion:
    """Motion of a body after dt (s) at the constant `acceleration` (m/s2, m/s2, rad/s2)."""
    velocity = motion.velocity + dt * acceleration
    pose = motion.pose + 0.5 * dt * (motion.velocity + velocity)
    return BodyMotion(pose, velocity, motion.force, motion.contact, motion.impulse)
