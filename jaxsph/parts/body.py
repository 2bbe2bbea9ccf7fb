"""Rigid bodies that move under the water's forces (Yeylaghi et al. 2016, Eq. 18-21).

A body has V motions, three in 2-D and six in 3-D; `model.rigid` states their names and signs. The generalised
forces are forces (N) and moments about the pivot (N m), in 2-D per metre of width.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.model.meaning import Entry, Exchange, Oscillation, Reading
from jaxsph.model.solids import AbstractBody, AbstractJoint
from jaxsph.model.state import Tally
from jaxsph.parts.joint import joint_of
from jaxsph.parts.pose import PosedSolid
from jaxsph.solids.shapes import AbstractShape

__all__ = ["BodyMotion", "RigidBody"]

WORDS = {
    "surge": "displacement of the {} along the tank",
    "sway": "displacement of the {} across the tank",
    "heave": "displacement of the {} upwards",
    "roll": "angle of the {} about the axis along the tank",
    "pitch": "angle of the {}, positive landward",
    "yaw": "angle of the {} about the vertical axis",
}
"""Descriptions of the motions of a body, with a placeholder for its name."""
ADRIFT = ("surge", "sway", "yaw")
"""Motions in which a floating body drifts, because the water exerts no restoring force."""


MEANS = {
    "force_x": "mean drift force; with water on one side only, it includes the hydrostatic force",
    "force_z": "includes the hydrostatic force",
}
"""Explanations of the means of forces, by the names of the forces."""


class BodyMotion(eqx.Module):
    """Motion of a rigid body at time t, and the forces of water and air on the body."""

    q: Float[Array, " k"]
    """Coordinates of the body's joint, m or rad."""
    rates: Float[Array, " k"]
    """Rates of the coordinates, m/s or rad/s."""
    pose: Float[Array, " P"]
    """Pose (`model.rigid`)."""
    velocity: Float[Array, " V"]
    """Velocity of the pivot, m/s, and angular velocity, rad/s."""
    force: Float[Array, " V"]
    """Force of the water's pressure, and of the air in the body's chambers, in the last step, N, N m (per
    metre in 2-D)."""
    contact: Float[Array, " V"]
    """Contact force of the water in the last step, N, N m (per metre in 2-D).

    This force acts on the body in the next step.
    """
    impulse: Tally
    """Impulse `[V]` of `force` and `contact`, N s, N m s (per metre in 2-D)."""


class RigidBody(PosedSolid, AbstractBody):
    """Rigid body whose free motions follow from the forces on the body. Its joint determines which motions
    are free."""

    shape: AbstractShape
    """Shape in the position at rest."""
    mass: Scalar
    """Mass, kg (kg/m in 2-D)."""
    inertia: Float[Array, "..."]
    """Moment of inertia about the centre of mass at rest: a number (kg m) in 2-D, a tensor `[3, 3]` (kg m2)
    in 3-D."""
    pivot: Float[Array, " D"]
    """Point of the joint at rest, about which moments are taken, m."""
    centre: Float[Array, " D"]
    """Centre of mass at rest, m."""
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
        pivot: Sequence[float] | None = None,
        name: str = "body",
        dtype: Any = jnp.float32,
    ) -> RigidBody:
        """Builds a body of uniform density (kg/m3).

        **Arguments**: `rows`: the entry of `Ghosts.dummies` that belongs to the shape; `joint`: a joint, or
        the names of the free motions of a joint to the tank; `pivot`: point of the joint, m, by default the
        centre of mass.
        """
        volume, centre, second = shape.moments()

        def leaf(value: Any) -> Array:
            return jnp.asarray(value, dtype)

        return cls(
            shape=jax.tree.map(leaf, shape),
            rows=rows,
            mass=leaf(density * volume),
            inertia=leaf(density * np.asarray(second)),
            pivot=leaf(centre if pivot is None else pivot),
            centre=leaf(centre),
            joint=joint if isinstance(joint, AbstractJoint) else joint_of(len(centre), joint, dtype=dtype),
            name=name,
        )

    def start(self, dtype: Any) -> BodyMotion:
        """See `AbstractMovingSolid`: the body in its position at rest; `Mechanism.start` sets the pose."""
        q, rates = self.joint.start(dtype)
        none, rest = jnp.zeros(len(self.space.motions), dtype), self.space.at_rest(dtype)
        return BodyMotion(q, rates, rest, none, none, none, Tally.zero(dtype, none.shape))

    def entries(self):
        """See `AbstractPart`."""
        if not self.joint.driven:
            return {}
        words = f"work of the imposed motion of the {self.name}"
        return {self.called("body_drive"): Entry(words, Exchange.GIVEN)}

    def readings(self, dim):
        """See `AbstractPart`."""
        units = "N m-1, N m-1, N" if dim == 2 else "N, N, N, N m, N m, N m"
        pivot = "the pivot, by default the centroid" if self.fixed else "the pivot"
        force = f"the water's force on the {self.name}, and its moment about {pivot}"
        forces = {
            "body_force": Reading(units, force, "motion"),
            "body_force_mean": Reading(units, f"{force}, mean since the last sample", "motion"),
        }
        space = self.space
        units, names = ", ".join(f"{unit} s-1" for unit in space.units), ", ".join(space.motions)
        motion = {
            **{
                name: Reading(unit, WORDS[name].format(self.name))
                for name, unit in zip(space.motions, space.units, strict=True)
            },
            "body_velocity": Reading(units, f"velocities of {names}", "motion"),
            **{name: reading for name, (_, reading) in self._relative().items()},
        }
        return {self.called(name): reading for name, reading in self._told(motion, forces).items()}

    def oscillations(self, dim):
        """See `AbstractPart`."""
        force, moment = ("N/m", "N") if dim == 2 else ("N", "N m")
        units = dict(zip(self.space.motions, self.space.units, strict=True))
        motion = {
            name: Oscillation(
                self.called(name), f"{name} of the {self.name}", unit, None, True, True, name in ADRIFT
            )
            for (name, unit), moves in zip(units.items(), self.joint.moves, strict=True)
            if moves or self.joint.parent
        } | {
            name: Oscillation(self.called(name), reading.long_name, reading.units, None, True, True)
            for name, (_, reading) in self._relative().items()
        }
        (reading,) = self._told({}, {"body_force_mean": None})
        forces = {
            f"body_{name}": Oscillation(
                self.called(reading),
                f"{words} on the {self.name}",
                force if k < dim else moment,
                k,
                True,
                True,
                mean_is=MEANS.get(name, ""),
            )
            for k, (name, words) in enumerate(self.space.loads.items())
        }
        return {self.called(name): one for name, one in self._told(motion, forces).items()}

    def read(self, state, sampled):
        """See `AbstractPart`."""
        forces = {
            "body_force": state.force + state.contact,
            "body_force_mean": state.impulse.recent / sampled.interval,
        }
        motion = {
            **dict(zip(self.space.motions, self.space.coordinates(state.pose), strict=True)),
            "body_velocity": state.velocity,
            **{name: state.q[k] for name, (k, _) in self._relative().items()},
        }
        return {self.called(name): value for name, value in self._told(motion, forces).items()}

    def _relative(self) -> dict[str, tuple[int, Reading]]:
        """Index and reading of each free joint coordinate, by short name; none for a joint to the tank."""
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

    def mass_matrix(self, pose):
        """See `AbstractBody`."""
        return self.space.mass_matrix(self.mass, self.inertia, pose)

    def normals(self, motion, x):
        """See `AbstractBody`."""
        # evaluated at rest, since rounding of the pose must not decide between two equally near faces
        away, back = jax.vjp(self.shape.distance, jax.lax.stop_gradient(x))
        (normal,) = back(jnp.ones_like(away))
        normal = normal / jnp.sqrt(jnp.sum(normal**2, axis=1, keepdims=True) + 1e-12)
        return self.space.rotated(motion.pose, normal)

    def energy(self, motion, g):
        """See `AbstractBody`."""
        space, arm = self.space, self.centre - self.pivot
        moved = space.moved(motion.pose, arm)
        ways = space.directions(space.rotated(motion.pose, arm)[None])[:, 0]
        speeds = motion.velocity.at[: space.dim].set(motion.velocity @ ways)
        kinetic = 0.5 * speeds @ self.mass_matrix(moved) @ speeds
        return kinetic, -self.mass * jnp.sum(g * moved[: space.dim])
