"""Motion of rigid bodies that are joined to the tank and to each other, as one multibody system.

The generalised coordinates are the coordinates of all joints, followed by one time coordinate per joint. A
time coordinate has the constant rate 1, and prescribed motions are functions of the time coordinate. A
joint's coordinate that is not free also has a constant rate. The equations of motion are

    M q'' + c = sum over bodies of J^T F + forces along the joints,

with the mass matrix M = sum J_c^T m J_c and the inertial forces c = sum J_c^T (m (dJ_c/dt) q' + g). J and
J_c map the coordinates' rates to the velocities of the bodies' pivots and centres of mass, and g is the
gyroscopic moment. Velocities and forces of a body have V components (`model.rigid`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.model.links import Extension, Link, Places, Pull
from jaxsph.model.rigid import SPACES, AbstractSpace
from jaxsph.model.solids import AbstractBody

__all__ = ["Kinematics", "Mechanism", "inverse_where"]


RUNGE_KUTTA = ((0.0, 1.0 / 6.0), (0.5, 1.0 / 3.0), (0.5, 1.0 / 3.0), (1.0, 1.0 / 6.0))
"""Stages of the fourth-order Runge-Kutta method: time as a fraction of the step, and weight (-)."""


class Kinematics(NamedTuple):
    """Positions, velocities and accelerations of all bodies at one time, from the n generalised coordinates.

    The first axis of `poses`, `ways` and `bias` distinguishes the bodies' pivots (0) and centres of mass (1).
    """

    rates: Float[Array, " n"]
    """Rates of the coordinates, m/s, rad/s, or s/s."""
    poses: Float[Array, "2 B P"]
    """Poses (`model.rigid`)."""
    ways: Float[Array, "2 B V n"]
    """Velocities of pivots and centres of mass, per unit rate of each coordinate."""
    bias: Float[Array, "2 B V"]
    """Accelerations at constant rates of the coordinates, m/s2, rad/s2."""
    mass: Float[Array, "B V V"]
    """Mass matrices with respect to the centres of mass, kg, kg m2 (kg/m, kg m in 2-D)."""
    gyroscopic: Float[Array, "B V"]
    """Gyroscopic moments, N m."""
    movable: Float[Array, " n"]
    """Mask of the coordinates: 1 where the coordinate is free, 0 where its rate is constant."""

    @property
    def velocities(self) -> Float[Array, "2 B V"]:
        """Velocities of pivots and centres of mass, m/s, rad/s."""
        return self.ways @ self.rates

    @property
    def mass_matrix(self) -> Float[Array, "n n"]:
        """Mass matrix of the coordinates, in kg, kg m or kg m2 (per metre in 2-D)."""
        ways = self.ways[1]
        return jnp.einsum("bki,bkl,blj->ij", ways, self.mass, ways)

    @property
    def coasting(self) -> Float[Array, " n"]:
        """Accelerations of the coordinates without any force on the bodies, m/s2 or rad/s2."""
        return -inverse_where(self.movable, self.mass_matrix) @ self.inertial(self.bias[1])

    def inertial(self, accelerations: Float[Array, "B V"]) -> Float[Array, " n"]:
        """Generalised forces (N, N m) that cause the `accelerations` (m/s2, rad/s2) of the centres of
        mass."""
        loads = jnp.einsum("bkl,bl->bk", self.mass, accelerations) + self.gyroscopic
        return jnp.einsum("bki,bk->i", self.ways[1], loads)

    def accelerations(self, change: Float[Array, " n"]) -> Float[Array, "2 B V"]:
        """Accelerations of pivots and centres of mass, m/s2, rad/s2.

        `change`: accelerations (m/s2 or rad/s2) of the coordinates in addition to `coasting`.
        """
        return self.ways @ (self.coasting + change) + self.bias


class FreeStep(NamedTuple):
    """Bodies and links after a step without water, and the energies exchanged in this step."""

    parts: dict[str, Any]
    """States of bodies and links, by name."""
    taken: dict[str, Scalar]
    """Energy that each link absorbed, by ledger name, J (J/m in 2-D)."""
    given: dict[str, Scalar]
    """Energy that the drive of each body's joint delivered, by the body's name, J (J/m in 2-D)."""


class Mechanism(NamedTuple):
    """The bodies of a model as one multibody system; a body comes after the body that it is joined to."""

    bodies: Sequence[AbstractBody]
    """All bodies."""
    links: Sequence[Link] = ()
    """Forces between bodies, or between a body and the tank."""

    @property
    def space(self) -> AbstractSpace:
        """Space in which the bodies move."""
        return SPACES[len(self.bodies[0].pivot)]

    def check(self) -> None:
        """Checks bodies and links. **Raises** ValueError if a body precedes the body that it is joined to, or
        a link's body is unknown."""
        known = {""}
        for body in self.bodies:
            if body.joint.parent not in known:
                before = ", ".join(sorted(known - {""})) or "none"
                raise ValueError(
                    f"{body.name} is joined to {body.joint.parent}, which is not among the bodies listed "
                    f"before {body.name} ({before}): list the joint's parent before {body.name}"
                )
            known.add(body.name)
        for link in self.links:
            for name in link.ends.bodies:
                if name not in known:
                    raise ValueError(
                        f"the link {link.name} connects {name}, which is not among the bodies "
                        f"({', '.join(sorted(known - {''})) or 'none'}): give the name of a body"
                    )

    def start(self, dtype: Any) -> dict[str, Any]:
        """Motions of the bodies and states of the links at t = 0, by name."""
        return _start(self, np.dtype(dtype))

    def extension(self, link: Link, parts: Mapping[str, Any], t: Scalar) -> Extension:
        """Extension of a link (m or rad) at the time t (s); `parts`: states of the bodies by name."""
        return link.ends.extension(self._places(self._gathered(parts, t)[0]))

    def stored(self, parts: Mapping[str, Any], t: Scalar) -> Scalar:
        """Energy stored in all links at the time t (s), J (J/m in 2-D); `parts`: states by name."""
        each = (one.law.stored(parts[one.name].own, self.extension(one, parts, t)) for one in self.links)
        return sum(each, jnp.zeros_like(t))

    @property
    def coasts(self) -> bool:
        """Whether the rates of all coordinates stay constant if no forces act on the bodies."""
        return all(body.joint.coasts for body in self.bodies)

    def placed(self, parts: Mapping[str, Any], t: Scalar) -> dict[str, Any]:
        """Motions of the bodies by name, with poses and velocities that follow from the joints at t (s).

        `parts`: states of the parts by name, with coordinates and rates of the joints.
        """
        if not self.bodies:
            return {}
        z, rates = self._gathered(parts, t)
        return self._spread(parts, z, rates)

    def drawn(self, parts: Mapping[str, Any], t: Scalar) -> dict[str, Float[Array, "K D"]]:
        """Points (m) of the lines by which pictures show the links at the time t (s), by the link's name.

        Links along a joint are not shown.
        """
        places = self._places(self._gathered(parts, t)[0])
        lines = {link.name: link.drawn(parts[link.name], places) for link in self.links}
        return {name: line for name, line in lines.items() if len(line)}

    def kinematics(self, parts: Mapping[str, Any], t: Scalar) -> Kinematics:
        """Kinematics of the bodies at time t (s); `parts`: states of the parts by name."""
        return self._at(*self._gathered(parts, t), self._movable(t))

    def coasting(self, parts: Mapping[str, Any], t: Scalar) -> dict[str, Float[Array, " V"]]:
        """Accelerations (m/s2, rad/s2), by name, of the bodies if no forces act on them; empty if all are 0.

        These accelerations are due to prescribed motions, the inertia of joined bodies and gyroscopic
        moments.
        """
        if self.coasts:
            return {}
        kinematics = self.kinematics(parts, t)
        own = kinematics.accelerations(jnp.zeros_like(kinematics.rates))[0]
        return {body.name: a for body, a in zip(self.bodies, own, strict=True)}

    def drifted(self, parts: Mapping[str, Any], t: Scalar, dt: Scalar) -> dict[str, Any]:
        """Motions of the bodies, by name, at the time t + dt (s), if no forces act on them after t (s).

        `parts`: states of the parts by name at the time t.
        """
        if not self.bodies:
            return {}
        z, rates = self._gathered(parts, t)
        if self.coasts:
            return self._spread(parts, *self._regular(z + dt * rates, rates))
        movable = self._movable(t)

        def stage(carry, coefficients):
            (slope_z, slope_rates), (sum_z, sum_rates) = carry
            ahead, weight = coefficients
            at_rates = rates + ahead * dt * slope_rates
            slope = self._at(z + ahead * dt * slope_z, at_rates, movable).coasting
            return ((at_rates, slope), (sum_z + weight * at_rates, sum_rates + weight * slope)), None

        # the energy error of the fourth-order method in free motion is below single-precision rounding errors
        none = jnp.zeros_like(z)
        stages = jnp.asarray(RUNGE_KUTTA, z.dtype)
        (_, (by_z, by_rates)), _ = jax.lax.scan(stage, ((none, none), (none, none)), stages)
        return self._spread(parts, *self._regular(z + dt * by_z, rates + dt * by_rates))

    def kicked(self, parts: Mapping[str, Any], t: Scalar, change: Float[Array, " n"]) -> dict[str, Any]:
        """Motions of the bodies by name after a sudden `change` (m/s or rad/s) of the coordinates' rates.

        `parts`: states of the parts by name at the time t (s).
        """
        if not self.bodies:
            return {}
        z, rates = self._gathered(parts, t)
        return self._spread(parts, z, rates + change)

    def pulls(
        self, kinematics: Kinematics, parts: Mapping[str, Any], t: Scalar, g: Float[Array, " D"]
    ) -> tuple[Float[Array, " n"], dict[str, tuple[Extension, Pull]]]:
        """Generalised forces without the water's pressure, and extension and `Pull` of every link by name.

        The forces (N or N m) are the bodies' weights, the forces of the links, and the contact forces of the
        water in the last step.
        **Arguments**: `parts`: states of the parts by name at the time t (s); `g`: gravity, m/s2.
        """
        weight = kinematics.mass[:, 0, 0, None] * g
        contact = jnp.stack([parts[body.name].contact for body in self.bodies])
        forces = jnp.einsum("bki,bk->i", kinematics.ways[0], contact)
        forces = forces + jnp.einsum("bki,bk->i", kinematics.ways[1, :, : len(g)], weight)
        z, _ = self._gathered(parts, t)
        found = {}
        for link in self.links:

            def extension(z, ends=link.ends):
                s = ends.extension(self._places(z))
                return s.reshape(-1), s

            way, s = jax.jacrev(extension, has_aux=True)(z)
            pull = link.pull(parts[link.name], s, way, way @ kinematics.rates, t)
            forces = forces + pull.force
            found[link.name] = s, pull
        return forces, found

    def step(self, parts: Mapping[str, Any], t: Scalar, dt: Scalar, g: Float[Array, " D"]) -> FreeStep:
        """Bodies and links after a step of dt (s) from the time t (s), without water.

        The bodies move without forces for half the step, the forces change the velocities (kick), and the
        bodies move without forces for the other half, as in a step of a scheme.
        `parts`: states of bodies and links by name at the time t; `g`: gravity, m/s2.
        """
        middle = t + 0.5 * dt
        parts = {**parts, **self.drifted(parts, t, 0.5 * dt)}
        kinematics = self.kinematics(parts, middle)
        forces, pulls = self.pulls(kinematics, parts, middle, g)
        added = sum((pull.inertia(dt) for _, pull in pulls.values()), jnp.zeros_like(kinematics.mass_matrix))
        acceleration = inverse_where(kinematics.movable, kinematics.mass_matrix + added) @ forces
        given = self.given(kinematics, acceleration, forces - added @ acceleration)
        done, taken = {}, {}
        for link in self.links:
            done[link.name], lost = link.done(parts[link.name], *pulls[link.name], acceleration, middle, dt)
            taken |= lost
        parts = {**parts, **self.kicked(parts, middle, dt * acceleration), **done}
        parts = {**parts, **self.drifted(parts, middle, 0.5 * dt)}
        return FreeStep(parts, taken, {name: dt * power for name, power in given.items()})

    def given(
        self, kinematics: Kinematics, acceleration: Float[Array, " n"], others: Float[Array, " n"]
    ) -> dict[str, Scalar]:
        """Power that the drive of every body's joint gives to the bodies, by the body's name, W (W/m in 2-D).

        The drive of a joint moves the coordinates with constant rates, including the joint's time coordinate.
        **Arguments**: `acceleration`: accelerations of the coordinates in addition to `Kinematics.coasting`;
        `others`: generalised forces on the coordinates except those of the drives.
        """
        inertial = kinematics.inertial(kinematics.accelerations(acceleration)[1])
        power = (1.0 - kinematics.movable) * kinematics.rates * (inertial - others)
        return {name: jnp.sum(own) + at_time for name, (own, at_time) in self.split(power).items()}

    def along(self, by_body: Mapping[str, Float[Array, " k"]]) -> Float[Array, " n"]:
        """Joins the coordinate values of the bodies' joints, given by body name, into one vector.

        The entries of the time coordinates are 0.
        """
        values = [by_body[body.name] for body in self.bodies]
        return jnp.concatenate([*values, jnp.zeros(len(self.bodies), values[0].dtype)])

    def split(self, values: Float[Array, " n"]) -> dict[str, tuple[Float[Array, " k"], Scalar]]:
        """Values of the coordinates of each body's joint and of the joint's time coordinate, by body name."""
        found, first = {}, 0
        for index, body in enumerate(self.bodies):
            last = first + body.joint.size
            # the compiler for CPUs aborts on slices without elements
            own = values[first:last] if last > first else jnp.zeros(0, values.dtype)
            found[body.name] = own, values[index - len(self.bodies)]
            first = last
        return found

    def _gathered(self, parts: Mapping[str, Any], t: Scalar) -> tuple[Array, Array]:
        """Coordinates of all joints followed by the time coordinates, and the rates of both."""
        motions = [parts[body.name] for body in self.bodies]
        times = jnp.broadcast_to(t, (len(motions),))
        z = jnp.concatenate([*(motion.q for motion in motions), times])
        return z, jnp.concatenate([*(motion.rates for motion in motions), jnp.ones_like(times)])

    def _regular(self, z: Array, rates: Array) -> tuple[Array, Array]:
        """Coordinates and rates of all joints, replaced by equivalent ones near a singularity."""
        q, q_rates = self.split(z), self.split(rates)
        both = [body.joint.regular(q[body.name][0], q_rates[body.name][0]) for body in self.bodies]
        times = len(z) - len(self.bodies)
        return (
            jnp.concatenate([*(own for own, _ in both), z[times:]]),
            jnp.concatenate([*(own for _, own in both), rates[times:]]),
        )

    def _spread(self, parts: Mapping[str, Any], z: Array, rates: Array) -> dict[str, Any]:
        """Motions of the bodies by name, for the coordinates z and their `rates`."""
        poses, changes = jax.jvp(lambda z: self._poses(z)[0], (z,), (rates,))
        velocities = self.space.velocity(poses, changes)
        q, q_rates = self.split(z), self.split(rates)
        return {
            body.name: eqx.tree_at(
                lambda m: (m.q, m.rates, m.pose, m.velocity),
                parts[body.name],
                (q[body.name][0], q_rates[body.name][0], pose, velocity),
            )
            for body, pose, velocity in zip(self.bodies, poses, velocities, strict=True)
        }

    def _movable(self, t: Scalar) -> Float[Array, " n"]:
        """Mask of all coordinates at the time t (s): 1 if a coordinate is free, 0 if its rate is constant."""
        return self.along({body.name: body.joint.movable(t) for body in self.bodies})

    def _places(self, z: Float[Array, " n"]) -> Places:
        """Positions and joint coordinates of the bodies (`Places`) for the coordinates z."""
        poses: dict[str, Array] = {}
        pivots = {body.name: body.pivot for body in self.bodies}
        q = self.split(z)
        for body in self.bodies:
            above, arm, carrier = self.space.at_rest(z.dtype), body.pivot, body.joint.parent
            if carrier:
                above, arm = poses[carrier], body.pivot - pivots[carrier]
            poses[body.name] = body.joint.place(above, arm, *q[body.name])
        return Places(poses, pivots, {name: own for name, (own, _) in q.items()})

    def _poses(self, z: Float[Array, " n"]) -> Float[Array, "2 B P"]:
        """Poses of pivots and centres of mass for the coordinates z."""
        poses = jnp.stack(list(self._places(z).poses.values()))
        arms = jnp.stack([body.centre - body.pivot for body in self.bodies])
        return jnp.stack([poses, self.space.moved(poses, arms)])

    def _at(self, z: Array, rates: Array, movable: Array) -> Kinematics:
        """Kinematics for coordinates, rates and the mask of the coordinates."""

        def velocities(z):
            return self.space.velocity(*jax.jvp(self._poses, (z,), (rates,)))

        poses, (velocity, bias) = self._poses(z), jax.jvp(velocities, (z,), (rates,))
        changes = jax.jacfwd(self._poses)(z)
        ways = jax.vmap(self.space.velocity, in_axes=(None, -1), out_axes=-1)(poses, changes)
        mass = jnp.stack([body.mass_matrix(pose) for body, pose in zip(self.bodies, poses[0], strict=True)])
        gyroscopic = self.space.gyroscopic(mass, velocity[1])
        return Kinematics(rates, poses, ways, bias, mass, gyroscopic, movable)


def inverse_where(mask: Float[Array, " n"], matrix: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """Inverse of the submatrix of the rows and columns at which the mask is 1; zero elsewhere."""
    both = mask[:, None] * mask
    return both * jnp.linalg.inv(jnp.where(both > 0, matrix, jnp.eye(len(mask), dtype=matrix.dtype)))


@eqx.filter_jit
def _start(mechanism: Mechanism, dtype: np.dtype) -> dict[str, Any]:
    """Motions of the bodies and states of the links at t = 0, by name; compiled as one function."""
    t = jnp.zeros((), dtype)
    parts = mechanism.placed({body.name: body.start(dtype) for body in mechanism.bodies}, t)
    for link in mechanism.links:
        parts[link.name] = link.start(mechanism.extension(link, parts, t), t)
    return parts
