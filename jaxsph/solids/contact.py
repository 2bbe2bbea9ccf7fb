"""Contact of water particles with solids: repulsive springs, inelastic impact, and the force on bodies."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Float, Scalar, columns, dot
from jaxsph.model.interfaces import Model
from jaxsph.model.solids import AbstractBody
from jaxsph.model.state import Particles

__all__ = [
    "TOUCH",
    "corner_push",
    "push_off",
    "spring",
    "spring_acceleration",
    "stop_at_solids",
    "touch_force",
]

TOUCH = 0.4
"""Distance from a solid's surface, in spacings, below which its contact spring acts."""


def spring(gap: jax.Array, dx: Scalar, c0: Scalar) -> jax.Array:
    """Acceleration (m/s2) away from a solid's surface due to a contact spring, at the distance `gap` (m).

    Mirrored pressures alone do not keep particles off a wall, because the nearer a particle comes to its
    image, the less the image repels the particle. Without the spring, some particles in the vortex at a
    plate's tip entered the plate and stayed there. The spring is conservative and acts up to 0.4 spacings
    `dx` (m) from the surface. The spring stops a particle whose normal speed is a tenth of `c0` (m/s), and is
    stable at a Courant number of 3.
    """
    reach = TOUCH * dx
    return (0.1 * c0 / reach) ** 2 * jnp.maximum(reach - gap, 0.0)


def push_off(distance: Callable, x: Float[Array, "N D"], dx: Scalar, c0: Scalar) -> Float[Array, "N D"]:
    """Acceleration (m/s2) of particles at x (m) due to a contact spring, along the gradient of `distance`.

    `distance` gives the distances `[N]` (m) of points from the solid's surface.
    """
    away, back = jax.vjp(distance, x)
    (normal,) = back(jnp.ones_like(away))
    return spring(away, dx, c0)[:, None] * normal


def corner_push(beside: jax.Array, beyond: jax.Array, away: Callable) -> tuple[jax.Array, jax.Array]:
    """Acceleration (m/s2) away from a solid with an outer edge, as components normal to the edge's two faces.

    **Arguments**: `beside`, `beyond`: distances (m) in front of the two faces, negative behind a face;
    `away`: acceleration (m/s2) as a function of the distance (m) from the solid.
    """
    corner = (beside > 0) & (beyond > 0)
    distance = jnp.sqrt(jnp.where(corner, beside**2 + beyond**2, 1.0))
    out = away(jnp.where(corner, distance, jnp.maximum(beside, beyond)))
    return (
        out * jnp.where(corner, beside / distance, (beside > beyond).astype(beside.dtype)),
        out * jnp.where(corner, beyond / distance, (beside <= beyond).astype(beside.dtype)),
    )


def spring_acceleration(
    model: Model, parts: Mapping[str, Any], water: Particles, c0: Scalar
) -> Float[Array, "N D"]:
    """Acceleration of the water due to the contact springs of all solids, m/s2.

    **Arguments**: `parts`: states of the parts by name; `c0`: speed (m/s) that sets the springs' stiffness.
    """
    total = jnp.zeros_like(water.x)
    for solid in model.every_solid():
        total = total + solid.push(parts.get(solid.name), water.x, model.dx, c0)
    return total


def stop_at_solids(
    model: Model,
    parts: Mapping[str, Any],
    water: Particles,
    u: Float[Array, "N D"],
    push: Float[Array, "N D"],
    c0: Scalar,
) -> Float[Array, "N D"]:
    """Removes from velocities (m/s) the component towards a solid whose contact spring pushes the particle.

    Spray that hits a solid therefore stays at the solid; the spring alone would reflect the spray at the same
    speed. The removed share grows with the spring's force, and is 1 for a particle that is a tenth of a
    spacing or more inside the spring's range.

    **Arguments**: velocities `u` (m/s) before the contact; `push`: the result of `spring_acceleration` with
    the same `c0` (m/s).
    """
    wall = jnp.zeros_like(u)
    for solid in (*model.moving, *model.bodies):
        motion = parts[solid.name]
        near = solid.touches(motion, water.x, model.dx)
        wall = jnp.where(near[:, None], solid.velocity(motion, water.x), wall)
    size2 = dot(columns(push), columns(push))[:, None]
    touching = size2 > 0.0
    normal = push / jnp.sqrt(jnp.where(touching, size2, 1.0))
    towards = jnp.minimum(dot(columns(u - wall), columns(normal))[:, None], 0.0)
    share = jnp.sqrt(jnp.where(touching, size2, 1.0)) / spring((TOUCH - 0.1) * model.dx, model.dx, c0)
    return u - jnp.where(touching, jnp.minimum(share, 1.0) * towards, 0.0) * normal


def touch_force(
    model: Model, body: AbstractBody, motion: Any, water: Particles, kick: Float[Array, "N D"], dt: Scalar
) -> Float[Array, " V"]:
    """Contact force of the water on a body, N, N m (per metre in 2-D).

    The force is minus the rate of change of the momentum of the touching water. `kick`: change (m/s) of the
    water's velocities due to contact in a step of dt (s).
    """
    near = body.touches(motion, water.x, model.dx)
    momentum = jnp.where(near, water.m, 0.0)[:, None] * kick
    return -jnp.einsum("knd,nd->k", body.directions(motion, water.x), momentum) / dt
