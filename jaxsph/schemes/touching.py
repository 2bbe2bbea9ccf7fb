"""Detection of bodies that are too near to other solids."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.model.interfaces import Model
from jaxsph.model.solids import AbstractBody, AbstractMovingSolid, AbstractSolid

NEAREST = 0.5
"""Gap between a body and another solid, in spacings, below which a run stops.

The particles cannot resolve a thinner film of water, and no force stops the body. Points at which the gap
is less than a spacing at rest, for example next to a hinge, are not considered.
"""


def touching(model: Model, parts: Mapping[str, Any]) -> tuple[Array, Float[Array, " D"]]:
    """Whether a point of a body is nearer than `NEAREST` to another solid, and this point's position (m).

    Bodies joined to each other may touch. Only bodies that translate are considered: a body that turns about
    a fixed pivot cannot sink. `parts`: states of the parts by name.
    """
    x = jax.lax.stop_gradient(model.walls.x)
    found, where = jnp.zeros((), bool), jnp.zeros(x.shape[1], x.dtype)
    for body in model.bodies:
        if not (body.joint.parent or any(body.joint.moves[: x.shape[1]])):
            continue
        start, dummies = body.start(x.dtype), x[slice(*body.rows)]
        # the points of the surface nearest to the dummies, at rest
        beneath = body.distance(start, dummies)
        surface = dummies - beneath[:, None] * body.normals(start, dummies)
        for solid in model.every_solid():
            if solid is body or _joined(body, solid):
                continue
            movers = (one for one in (body, solid) if isinstance(one, AbstractMovingSolid))
            at_rest = {one.name: one.start(x.dtype) for one in movers}
            at_first = _near(model, body, solid, at_rest, surface, model.dx)
            near = ~at_first & _near(model, body, solid, parts, surface, NEAREST * model.dx)
            here, there = jnp.any(near), body.carry(parts[body.name], surface)[jnp.argmax(near)]
            where, found = jnp.where(here & ~found, there, where), found | here
    return jax.lax.stop_gradient((found, where))


def _joined(body: AbstractBody, solid: AbstractSolid) -> bool:
    """Whether a joint connects a body and a solid."""
    return isinstance(solid, AbstractBody) and (
        body.joint.parent == solid.name or solid.joint.parent == body.name
    )


def _near(
    model: Model,
    body: AbstractBody,
    solid: AbstractSolid,
    parts: Mapping[str, Any],
    surface: Float[Array, "B D"],
    gap: Scalar,
) -> Array:
    """Mask of a body's points, at `surface` (m) at rest, within `gap` (m) of a solid along an axis."""
    dx, found = model.dx, jnp.zeros(len(surface), bool)
    x = body.carry(parts[body.name], surface)
    for axis, sign in itertools.product(range(x.shape[1]), (-1.0, 1.0)):
        # `contains` begins half a spacing inside the solid
        ahead = x.at[:, axis].add(sign * (gap + 0.5 * dx))
        # a body may rise above the walls of the tank
        ahead = ahead.at[:, -1].min(model.walls.high[-1])
        found = found | solid.contains(parts.get(solid.name), ahead, dx)
    return found
