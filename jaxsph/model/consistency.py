"""Initial states of a model's parts, and checks that the parts fit together."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxsph.model.interfaces import Model

__all__ = ["RESERVED", "check_parts", "part_states"]

RESERVED = ("id", "p", "step", "time", "u", "x")
"""Names that no moving part and no link may have, because a snapshot stores the fields of the particles, the
time and the step under these names, and the poses of the parts and the points of the links under theirs."""


def part_states(model: Model, dtype: np.dtype | type) -> dict[str, Any]:
    """States at t = 0 of all parts that evolve, by name."""
    parts = (*model.moving, *model.chambers, *model.ducts, *model.outlets)
    return {part.name: part.start(dtype) for part in parts} | model.mechanism.start(dtype)


def check_parts(model: Model) -> None:
    """Checks that the parts of a model are consistent.

    **Raises** ValueError if two parts have the same name or an energy of the same name, a part has a name of
    `RESERVED`, a duct ends at an unknown chamber, a model with body forces has a movable body, or the ghosts
    of moving solids do not match the ghosts of the walls.
    """
    names = [part.name for part in model.parts]
    energies = [name for part in (*model.parts, model.scheme) for name in part.entries()]
    for given, what in ((names, "name"), (energies, "energy in the ledger")):
        twice = sorted({name for name in given if given.count(name) > 1})
        if twice:
            raise ValueError(
                f"two or more parts have the same {what} ({', '.join(twice)}): give every part its own name"
            )
    taken = sorted({part.name for part in (*model.movers(), *model.links)} & set(RESERVED))
    if taken:
        raise ValueError(
            f"parts have the names {', '.join(taken)}, but a snapshot needs {', '.join(RESERVED)} for other "
            "arrays: rename the parts"
        )
    ends = {end for duct in model.ducts for end in duct.between} - {one.name for one in model.chambers}
    if ends:
        raise ValueError(
            f"ducts end at {', '.join(sorted(ends))}, but must end at chambers of the model: "
            + (
                f"choose from {', '.join(one.name for one in model.chambers)}"
                if model.chambers
                else "the model has none; add chambers, or remove the ducts"
            )
        )
    at_last = jnp.asarray(jnp.inf)
    afloat = [body.name for body in model.bodies if model.forces and np.any(body.joint.movable(at_last))]
    if afloat:
        raise ValueError(
            f"body forces act only on the water, but {', '.join(afloat)} can move: "
            "remove the body forces, or fix the bodies"
        )
    model.mechanism.check()
    given = sorted(solid.rows for solid in (*model.moving, *model.bodies))
    ends = (rows for rows in (model.walls.paddle, model.walls.far_end) if rows)
    needed = sorted((*ends, *model.walls.dummies))
    if given != needed:
        raise ValueError(
            f"moving walls and bodies have the ghosts with indices {given}, but the walls need {needed}: "
            "give a paddle if the box has one, and one body or driven solid for each of the walls' `dummies`"
        )
