"""Coupling of rigid bodies to the water in a step, and the energies that the bodies exchange."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Components, Float, Scalar, columns, stack
from jaxsph.core.pairs import Pair
from jaxsph.core.parts import Part
from jaxsph.core.slabs import PointNeighbours, Sources
from jaxsph.model import laws
from jaxsph.model.interfaces import AbstractScheme, Model
from jaxsph.model.links import Extension, Pull
from jaxsph.model.mechanism import Kinematics, inverse_where
from jaxsph.model.solids import AbstractBody
from jaxsph.model.state import Pressures, Tables
from jaxsph.schemes.step import GhostFields

__all__ = ["BodiesCoupling", "BodyGrip", "BodyHold", "BodyWork", "body_grip", "couple_bodies", "push_bodies"]


class BodyGrip(NamedTuple):
    """Linear map from pressures to the force on a body.

    The map is minus the sum of the pair law that accelerates the water, so that the forces on body and water
    are equal and opposite.
    """

    arms: Float[Array, "V B D"]
    """Volume (m3; m2 in 2-D) of every dummy times its velocity per unit of the body's velocity."""
    sums: Float[Array, "B D"]
    """Weight of every dummy's own pressure: the sum of its `weights`."""
    weights: Components
    """Weights of the water's pressures around every dummy, one component per axis, stored as for
    `weighted_sum`."""
    table: PointNeighbours
    """Neighbours of the dummies in the water."""

    def force(self, p: Float[Array, " N"], p_body: Float[Array, " B"]) -> Float[Array, " V"]:
        """Generalised force due to the pressures (Pa) of water and dummies, N, N m (per metre in 2-D)."""
        around = stack([self.table.weighted_sum(w, Sources({"f": p}, {})) for w in self.weights])
        return jnp.einsum("kbd,bd->k", self.arms, around + p_body[:, None] * self.sums)


class BodyHold(NamedTuple):
    """Linear maps between a body's accelerations, the pressure of its dummies, and the force on the body."""

    grip: BodyGrip
    """Map from pressures to the force on the body."""
    slopes: Float[Array, "V B"]
    """Pressure (Pa) of the dummies per unit of each of the body's accelerations (m/s2, rad/s2)."""
    ways: Float[Array, "V n"]
    """Velocity of the body per unit rate of each coordinate of the bodies."""
    rows: tuple[int, int]
    """Index of the body's first ghost, and one more than the index of its last ghost."""

    def force(self, p: Float[Array, " N"], p_ghosts: Float[Array, " G"]) -> Float[Array, " V"]:
        """Generalised force of the pressures (Pa) on the body, N, N m (per metre in 2-D)."""
        return self.grip.force(p, p_ghosts[slice(*self.rows)])


class BodiesCoupling(NamedTuple):
    """Linear maps between the accelerations of all bodies and the water's pressure around them.

    The unknowns are the accelerations of the n coordinates of the bodies (`Mechanism`) due to forces. The
    pressure of the dummies depends instantaneously on these accelerations. The added mass due to this
    dependence is included in the mass matrix here; the remainder acts through the water's pressure.
    """

    holds: dict[str, BodyHold]
    """Linear maps between accelerations, pressures and force of every body, by name."""
    inverse: Float[Array, "n n"]
    """Accelerations of the coordinates per unit generalised force, with the stiffness and damping of the
    links over a step; 0 for coordinates that are not free."""
    outside: Float[Array, " n"]
    """Generalised force, excluding that of the water pressure, N or N m (per metre in 2-D)."""
    pulls: dict[str, tuple[Extension, Pull]]
    """Extension (m or rad) and force of every link, by name."""
    kinematics: Kinematics
    """Kinematics of the bodies, with their velocities before the forces of the step act."""
    air: dict[str, Float[Array, " V"]]
    """Forces of the air on the bodies that carry chambers, N, N m (per metre in 2-D), by body."""

    @property
    def driving(self) -> Float[Array, " n"]:
        """Generalised force of all loads except the water's pressure, N or N m (per metre in 2-D)."""
        return self.outside + sum(self.holds[name].ways.T @ force for name, force in self.air.items())

    def response(self, p: Float[Array, " N"], p_ghosts: Float[Array, " G"]) -> Float[Array, " n"]:
        """Accelerations (m/s2 or rad/s2) due to the pressures (Pa) of the water and the ghosts.

        The pressures of the ghosts exclude the part that these accelerations add (`press`).
        """
        return self.inverse @ sum(h.ways.T @ h.force(p, p_ghosts) for h in self.holds.values())

    def acceleration(self, p: Float[Array, " N"], p_ghosts: Float[Array, " G"]) -> Float[Array, " n"]:
        """Accelerations (m/s2 or rad/s2) due to all forces, with the pressures (Pa) of `response`."""
        return self.response(p, p_ghosts) + self.inverse @ self.driving

    def press(self, p_ghosts: Float[Array, " G"], acceleration: Float[Array, " n"]) -> Float[Array, " G"]:
        """Pressures of the ghosts (Pa); the pressures of the dummies include the part due to the
        accelerations."""
        for hold in self.holds.values():
            added = (hold.ways @ (self.kinematics.movable * acceleration)) @ hold.slopes
            p_ghosts = p_ghosts.at[slice(*hold.rows)].add(added)
        return p_ghosts

    def forces(self, p: Float[Array, " N"], p_ghosts: Float[Array, " G"]) -> dict[str, Float[Array, " V"]]:
        """Generalised forces of the pressures (Pa) on the bodies by name, N, N m (per metre in 2-D)."""
        return {name: hold.force(p, p_ghosts) for name, hold in self.holds.items()}


@Part.BODIES.scope()
def couple_bodies(
    scheme: AbstractScheme,
    model: Model,
    parts: Mapping[str, Any],
    t: Scalar,
    dt: Scalar,
    ghosts: GhostFields,
    tables: Tables,
) -> tuple[BodiesCoupling, ...]:
    """Coupling of the bodies to the water for a step of dt (s); empty without bodies.

    **Arguments**: `parts`: states of the parts by name, with the bodies in their poses at the time t (s) of
    the `ghosts`, and with their velocities before the forces of the step act.
    """
    if not model.bodies:
        return ()
    mechanism, kinematics = model.mechanism, model.mechanism.kinematics(parts, t)
    outside, pulls = mechanism.pulls(kinematics, parts, t, model.g)
    mass, holds = kinematics.mass_matrix, {}
    for _, pull in pulls.values():
        mass = mass + pull.inertia(dt)
    still = jnp.zeros_like(tables.x[:, 0])
    for body, way in zip(model.bodies, kinematics.ways[0], strict=True):
        motion = parts[body.name]
        grip = body_grip(scheme, body, motion, ghosts, tables)
        slopes = _slopes(scheme, model, body, motion, ghosts)
        holds[body.name] = BodyHold(grip, slopes, way, body.rows)
        if not body.fixed:
            added = jax.vmap(lambda slope, grip=grip: grip.force(still, slope))(slopes).T
            mass = mass - way.T @ added @ way
    inverse = inverse_where(kinematics.movable, mass)
    return (BodiesCoupling(holds, inverse, outside, pulls, kinematics, {}),)


def under_air(
    couplings: tuple[BodiesCoupling, ...], air: dict[str, Float[Array, " V"]]
) -> tuple[BodiesCoupling, ...]:
    """The couplings, with forces of the air on the bodies added by name, N, N m (per metre in 2-D)."""
    return tuple(coupling._replace(air=air) for coupling in couplings)


def velocity_changes(
    couplings: tuple[BodiesCoupling, ...], accelerations: tuple[Float[Array, " n"], ...], dt: Scalar
) -> dict[str, Float[Array, " V"]]:
    """Changes of the bodies' velocities (m/s, rad/s) in a step of dt (s), by body.

    `accelerations`: accelerations of the bodies' coordinates, m/s2 or rad/s2.
    """
    return {
        name: dt * (hold.ways @ acceleration)
        for coupling, acceleration in zip(couplings, accelerations, strict=True)
        for name, hold in coupling.holds.items()
    }


def body_grip(
    scheme: AbstractScheme, body: AbstractBody, motion: Any, ghosts: GhostFields, tables: Tables
) -> BodyGrip:
    """Map from pressures to the force on a body, from the weights of the water around its dummies."""
    rows = slice(*body.rows)
    x = ghosts.x[rows]

    def law(pair: Pair, i, j):
        w = tuple(-laws.volume(j) * pair.F * r for r in pair.r)
        return w, w

    table = tables.around[body.name]
    summed, weights = table.weights(law, scheme.smoothing, {"x": columns(x)}, ghosts.water)
    arms = body.directions(motion, x) * ghosts.V[rows, None]
    return BodyGrip(arms, stack(summed), weights, table)


def _slopes(
    scheme: AbstractScheme, model: Model, body: AbstractBody, motion: Any, ghosts: GhostFields
) -> jax.Array:
    """Pressure (Pa) of the dummies per unit acceleration in each of the body's V motions, `[V, B]`."""
    rows = slice(*body.rows)
    fit = jax.tree.map(lambda a: a[rows], ghosts.fit)
    x, nodes, zero = ghosts.x[rows], ghosts.nodes[rows], jnp.zeros_like(fit.wet)

    def slope(direction):
        return model.walls.pressure(fit, zero, x, nodes, -scheme.rho0 * direction)

    return jnp.where(fit.wet > 0, jax.vmap(slope)(body.directions(motion, x)), 0.0)


class BodyWork(NamedTuple):
    """Bodies after the forces of a step changed their velocities, and the energies that they exchanged."""

    motions: dict[str, Any]
    """Motions of the bodies, with the impulse of water (contact included) and air in this step added, and
    states of the links, by name."""
    amounts: dict[str, Scalar]
    """Energies absorbed by links and given by drives, by ledger name, J (J/m in 2-D)."""
    by_pressure: Scalar
    """Work of the water's pressure on the bodies, J (J/m in 2-D)."""
    by_touch: Scalar
    """Work of the water's contact forces on the bodies, J (J/m in 2-D)."""


@Part.BODIES.scope()
def push_bodies(
    model: Model,
    before: Mapping[str, Any],
    t: Scalar,
    dt: Scalar,
    couplings: tuple[BodiesCoupling, ...],
    pressures: Pressures,
) -> BodyWork:
    """Bodies with velocities changed by the forces of a step of dt (s), and with unchanged poses.

    **Arguments**: `before`: states of the parts by name at the time t (s) of the forces; `pressures`:
    pressures of water and ghosts, with the accelerations and forces of the bodies that result from
    `couplings`. The contact forces of the previous step act in this step.
    """
    nothing, forces = jnp.zeros_like(dt), pressures.forces
    done = BodyWork({}, {}, nothing, nothing)
    for coupling, acceleration in zip(couplings, pressures.accelerations, strict=True):
        after = model.mechanism.kicked(before, t, dt * acceleration)
        others = coupling.driving + sum(h.ways.T @ forces[name] for name, h in coupling.holds.items())
        for _, pull in coupling.pulls.values():
            others = others - pull.inertia(dt) @ acceleration
        given = model.mechanism.given(coupling.kinematics, acceleration, others)
        for body in model.bodies:
            old, new = before[body.name], after[body.name]
            moved = 0.5 * dt * (old.velocity + new.velocity)
            force = forces[body.name] + coupling.air.get(body.name, 0.0)
            impulse = new.impulse.add(dt * (force + old.contact))
            motion = eqx.tree_at(lambda m: (m.force, m.impulse), new, (force, impulse))
            done = BodyWork(
                done.motions | {body.name: motion},
                done.amounts | dict.fromkeys(body.entries(), dt * given[body.name]),
                done.by_pressure + jnp.sum(forces[body.name] * moved),
                done.by_touch + jnp.sum(old.contact * moved),
            )
        for link in model.links:
            motion, taken = link.done(before[link.name], *coupling.pulls[link.name], acceleration, t, dt)
            done.motions[link.name] = motion
            done.amounts.update(taken)
    return done
