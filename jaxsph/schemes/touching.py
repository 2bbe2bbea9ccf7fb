"""Bodies that come too near to other solids."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.model.interfaces import Model
from jaxsph.model.solids import AbstractBody, AbstractMovingSolid, AbstractSolid

NEAREST = 0.5
"""Gap between a body and another solid, in spacings, below which a run stops.

The particles cannot resolve a thinner film of water, and no force stops the body. Places at which the gap is
less than a spacing at rest, for example beside a hinge, are not considered.
"""


def touching(model: Model, parts: Mapping[str, Any]) -> tuple[Array, Float[Array, " D"]]:
    """Whether a body is nearer than `NEAREST` to another solid, and a place (m) where it is.

    Bodies joined to each other may meet. Only bodies that translate are considered: a body that turns about a
    fixed pivot cannot sink. `parts`: states of the parts by name.
    """
    x = jax.lax.stop_gradient(model.walls.x)
    found, where = jnp.zeros((), bool), jnp.zeros(x.shape[1], x.dtype)
    for body in model.bodies:
        if not (body.joint.parent or any(body.joint.moves[:2])):
            continue
        dummies = x[slice(*body.rows)]
        for solid in model.every_solid():
            if solid is body or _joined(body, solid):
                continue
            movers = (one for one in (body, solid) if isinstance(one, AbstractMovingSolid))
            at_rest = {one.name: one.start(dummies.dtype) for one in movers}
            at_first, _ = _near(model, body, solid, at_rest, dummies, model.dx)
            near, surface = _near(model, body, solid, parts, dummies, NEAREST * model.dx)
            near = near & ~at_first
            here, there = jnp.any(near), surface[jnp.argmax(near)]
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
    dummies: Float[Array, "B D"],
    gap: Scalar,
) -> tuple[Array, Float[Array, "B D"]]:
    """Whether a solid is within `gap` (m), along x or z, of the points of a body's surface nearest to its
    dummies, and these points (m).

    `dummies`: positions at rest, m.
    """
    dx, found, motion = model.dx, jnp.zeros(len(dummies), bool), parts[body.name]
    x = body.carry(motion, dummies)
    x = x - body.distance(motion, x)[:, None] * body.normals(motion, dummies)
    for axis, sign in ((0, -1.0), (0, 1.0), (-1, -1.0), (-1, 1.0)):
        # `contains` begins half a spacing inside the solid
        ahead = x.at[:, axis].add(sign * (gap + 0.5 * dx))
        # a body may rise above the walls of the tank
        ahead = ahead.at[:, -1].min(model.walls.high[-1])
        found = found | solid.contains(parts.get(solid.name), ahead, dx)
    return found, x
