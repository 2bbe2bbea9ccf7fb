"""Rigid bodies that move in the x-z plane under the water's forces (Yeylaghi et al. 2016, Eq. 18-21).

Surge (m) is positive along x, heave (m) upwards, and pitch (rad) from z towards x (landward for a flap). The
generalised forces are two forces and a moment about the pivot: N, N, N m (per metre in 2-D).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.model.meaning import Entry, Exchange, Oscillation, Reading
from jaxsph.model.solids import AbstractBody, AbstractJoint, turned
from jaxsph.model.state import Tally
from jaxsph.parts.joint import MOTIONS, PlanarJoint
from jaxsph.parts.pose import PosedSolid, turn
from jaxsph.solids.shapes import AbstractShape

__all__ = ["BodyMotion", "RigidBody"]


class BodyMotion(eqx.Module):
    """Motion of a rigid body at time t, and the water's force on it."""

    q: Float[Array, " k"]
    """Coordinates of the body's joint, m or rad."""
    rates: Float[Array, " k"]
    """Rates of the coordinates, m/s or rad/s."""
    pose: Float[Array, "3"]
    """Displacements of the pivot along x and z (m), and pitch (rad), from the position at rest."""
    velocity: Float[Array, "3"]
    """Velocities of the pivot along x and z, and of the pitch, m/s, m/s, rad/s."""
    force: Float[Array, "3"]
    """Force of the water's pressure, and of the air in the body's chambers, in the last step, N, N, N m (per
    metre in 2-D)."""
    contact: Float[Array, "3"]
    """Contact force of the water in the last step, N, N, N m (per metre in 2-D).

    It acts on the body in the next step.
    """
    impulse: Tally
    """Impulse `[3]` of the water's force, N s, N s, N m s (per metre in 2-D)."""


class RigidBody(PosedSolid, AbstractBody):
    """Rigid body whose free motions follow the forces on it; its joint determines which motions are free."""

    shape: AbstractShape
    """Shape in the position at rest."""
    mass: Scalar
    """Mass, kg (kg/m in 2-D)."""
    inertia: Scalar
    """Moment of inertia about the centre of mass, kg m2 (kg m in 2-D)."""
    pivot: Float[Array, "2"]
    """Point (x, z) of the joint at rest, about which moments are taken, m."""
    centre: Float[Array, "2"]
    """Centre of mass (x, z) at rest, m."""
    joint: AbstractJoint
    """Joint to the tank or to another body."""
    rows: tuple[int, int] = eqx.field(static=True)
    """Index of the body's first ghost, and index after its last ghost; an entry of `Ghosts.dummies`."""
    name: str = eqx.field(static=True, default="body", kw_only=True)
    usual_name: ClassVar[str] = "body"

    @classmethod
    def of(
        cls,
        shape: AbstractShape,
        rows: tuple[int, int],
        joint: AbstractJoint | Sequence[str],
        *,
        density: float,
        pivot: tuple[float, float] | None = None,
        name: str = "body",
        dtype: Any = jnp.float32,
    ) -> RigidBody:
        """Builds a body of uniform density (kg/m3).

        **Arguments**: `rows`: the entry of `Ghosts.dummies` that belongs to the shape; `joint`: a joint, or
        the free motions of a joint to the tank, any of "surge", "heave" and "pitch"; `pivot`: point of the
        joint (x, z), m, by default the centre of mass.
        """
        area, centre, second = shape.moments()

        def leaf(value: Any) -> Array:
            return jnp.asarray(value, dtype)

        return cls(
            shape=jax.tree.map(leaf, shape),
            rows=rows,
            mass=leaf(density * area),
            inertia=leaf(density * second),
            pivot=leaf(centre if pivot is None else pivot),
            centre=leaf(centre),
            joint=joint if isinstance(joint, AbstractJoint) else PlanarJoint.of(joint, dtype=dtype),
            name=name,
        )

    def start(self, dtype: Any) -> BodyMotion:
        """See `AbstractMovingSolid`: at its position at rest; `Mechanism.start` sets the pose."""
        q, rates = self.joint.start(dtype)
        none = jnp.zeros(3, dtype)
        return BodyMotion(q, rates, none, none, none, none, Tally.zero(dtype, (3,)))

    def entries(self):
        """See `AbstractPart`."""
        if not self.joint.driven:
            return {}
        words = f"work of the imposed motion of the {self.name}"
        return {self.called("body_drive"): Entry(words, Exchange.GIVEN)}

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
            **{name: reading for name, (_, reading) in self._relative().items()},
        }
        return {self.called(name): reading for name, reading in self._told(motion, forces).items()}

    def oscillations(self, dim):
        """See `AbstractPart`."""
        force, moment = ("N/m", "N") if dim == 2 else ("N", "N m")
        units = dict(zip(MOTIONS, ("m", "m", "rad"), strict=True))
        motion = {
            name: Oscillation(
                self.called(name), f"{name} of the {self.name}", unit, None, True, True, name == "surge"
            )
            for (name, unit), moves in zip(units.items(), self.joint.moves, strict=True)
            if moves or self.joint.parent
        } | {
            name: Oscillation(self.called(name), reading.long_name, reading.units, None, True, True)
            for name, (_, reading) in self._relative().items()
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
            **{name: state.q[k] for name, (k, _) in self._relative().items()},
        }
        return {self.called(name): value for name, value in self._told(motion, forces).items()}

    def _relative(self) -> dict[str, tuple[int, Reading]]:
        """Index and reading of the joint's free coordinates, by short name; none for a joint to the tank."""
        other = self.joint.parent
        named = enumerate(zip(self.joint.coordinates, self.joint.free, strict=True))
        return {
            f"relative_{name}": (k, Reading(unit, f"{name} of the {self.name} relative to the {other}"))
            for k, ((name, unit), free) in named
            if other and free
        }

    def _told(self, motion: dict[str, Any], forces: dict[str, Any]) -> dict[str, Any]:
        """Readings of the body by name: `motion` and `forces`, or only `forces` for a fixed body."""
        if not self.fixed:
            return motion | forces
        if self.name == self.usual_name:
            return forces
        return {name.removeprefix("body_"): force for name, force in forces.items()}

    def generalised_mass(self):
        """See `AbstractBody`."""
        return jnp.stack([self.mass, self.mass, self.inertia])

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

    def normals(self, motion, x):
        """See `AbstractBody`."""
        # evaluated at rest, since rounding of the pose must not decide between two equally near faces
        away, back = jax.vjp(self.shape.distance, jax.lax.stop_gradient(x))
        (normal,) = back(jnp.ones_like(away))
        normal = normal / jnp.sqrt(jnp.sum(normal**2, axis=1, keepdims=True) + 1e-12)
        return turn(normal, motion.pose[2])

    def energy(self, motion, g):
        """See `AbstractBody`."""
        arm = self.centre - self.pivot
        # the motion of the centre of mass follows from the pivot's
        moved, moving = jax.jvp(
            lambda pose: pose[:2] + turned(arm, pose[2]) - arm, (motion.pose,), (motion.velocity,)
        )
        speeds = jnp.concatenate([moving, motion.velocity[2:]])
        kinetic = 0.5 * jnp.sum(self.generalised_mass() * speeds**2)
        potential = -self.mass * jnp.sum(g[jnp.array([0, -1])] * moved)
        return kinetic, potential
