"""Contact of particles with solids: a spring off the surface, and water that stays where it meets one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.model.interfaces import AbstractBody, Model
from jaxsph.model.state import Particles

__all__ = ["TOUCH", "corner_push", "spring", "spring_acceleration", "stop_at_solids", "touch_force"]

TOUCH = 0.4
"""Distance from a surface, over dx, at which the spring begins."""


def spring(gap: jax.Array, dx: Scalar, c0: Scalar) -> jax.Array:
    """Acceleration (m/s2) away from a surface at the distance `gap` (m).

    Mirrored pressures do not keep particles off a wall: one that comes near its own image feels less and less
    of it, and in a vortex at a wall's tip some entered the plate, and stayed. The spring starts at 0.4
    spacings, is conservative, and stops a normal speed of a tenth of c0 (stable at Courant 3).
    """
    reach = TOUCH * dx
    return (0.1 * c0 / reach) ** 2 * jnp.maximum(reach - gap, 0.0)


def corner_push(beside: jax.Array, beyond: jax.Array, away: Callable) -> tuple[jax.Array, jax.Array]:
    """Acceleration off a solid's outer edge along the normals of its two faces, from the distances (m) beside
    one face and beyond the other, negative behind them; `away` gives it (m/s2) for one gap (m)."""
    corner = (beside > 0) & (beyond > 0)
    distance = jnp.sqrt(jnp.where(corner, beside**2 + beyond**2, 1.0))
    out = away(jnp.where(corner, distance, jnp.maximum(beside, beyond)))
    return (
        out * jnp.where(corner, beside / distance, (beside > beyond).astype(beside.dtype)),
        out * jnp.where(corner, beyond / distance, (beside <= beyond).astype(beside.dtype)),
    )


def spring_acceleration(
    model: Model, own: Mapping[str, Any], water: Particles, c0: Scalar
) -> Float[Array, "N D"]:
    """Acceleration of the water by the springs of all solids, m/s2."""
    total = jnp.zeros_like(water.x)
    for solid in model.every_solid():
        total = total + solid.push(own.get(solid.name), water.x, model.dx, c0)
    return total


def stop_at_solids(
    model: Model,
    own: Mapping[str, Any],
    water: Particles,
    u: Float[Array, "N D"],
    push: Float[Array, "N D"],
    c0: Scalar,
) -> Float[Array, "N D"]:
    """Velocities u (m/s) without the part that goes on towards a solid whose spring pushes the particle.

    Spray that hits a solid stays there, where a spring alone would throw it back as fast as it came. All of
    that part is gone a tenth of a spacing after the spring begins. `push`: the acceleration of
    `spring_acceleration` with this c0.
    """
    wall = jnp.zeros_like(u)
    for solid in (*model.moving, *model.bodies):
        motion = own[solid.name]
        near = solid.touched(motion, water.x, model.dx)
        wall = jnp.where(near[:, None], solid.velocity(motion, water.x), wall)
    size2 = jnp.sum(push**2, axis=1, keepdims=True)
    touching = size2 > 0.0
    normal = push / jnp.sqrt(jnp.where(touching, size2, 1.0))
    towards = jnp.minimum(jnp.sum((u - wall) * normal, axis=1, keepdims=True), 0.0)
    share = jnp.sqrt(jnp.where(touching, size2, 1.0)) / spring((TOUCH - 0.1) * model.dx, model.dx, c0)
    return u - jnp.where(touching, jnp.minimum(share, 1.0) * towards, 0.0) * normal


def touch_force(
    model: Model, body: AbstractBody, own: Any, water: Particles, kick: Float[Array, "N D"], dt: Scalar
) -> Float[Array, "3"]:
    """Force on a body of the water that touches it, N, N, N m (per metre in 2-D): opposite to what turned
    that water's velocities by `kick` (m/s) in a step of dt (s)."""
    near = body.touched(own, water.x, model.dx)
    momentum = jnp.where(near, water.m, 0.0)[:, None] * kick
    return -jnp.einsum("knd,nd->k", body.directions(own, water.x), momentum) / dt
