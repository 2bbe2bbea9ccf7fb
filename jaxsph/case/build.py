"""Model and initial state of a case, from its geometry, scheme, walls, water and parts.

Everything that determines the shape of an array is fixed here, on the host.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxsph.case.absorbing import make_sponges
from jaxsph.case.assemble import SKIN, assemble, cadence
from jaxsph.case.bodies import make_bodies, make_links
from jaxsph.case.flume import make_border
from jaxsph.case.geometry import Geometry, thin_wall, walls_of
from jaxsph.case.initial import around_solids, at_rest, initial_head, initial_velocity, water
from jaxsph.case.limits import check_memory
from jaxsph.case.moorings import make_moorings
from jaxsph.case.parts import (
    make_background,
    make_chambers,
    make_ducts,
    make_paddle,
    make_zones,
)
from jaxsph.case.scheme import make_scheme, stable_time_step
from jaxsph.case.sections import Sections
from jaxsph.case.speeds import search_speed
from jaxsph.core.arrays import on_device
from jaxsph.core.points import at_points
from jaxsph.core.search import jax_md
from jaxsph.core.search.base import AbstractSearch
from jaxsph.core.search.cells import Cells
from jaxsph.errors import CaseError
from jaxsph.model.interfaces import AbstractDamper, Model
from jaxsph.model.mechanism import Mechanism
from jaxsph.model.state import State
from jaxsph.parts.body import BodyMotion, RigidBody
from jaxsph.parts.paddle import AbstractPaddle
from jaxsph.schemes.base import AbstractParticleScheme
from jaxsph.solids.box import FreeSlip, NoSlip
from jaxsph.solids.filling import DummyParticles, MirrorImages, MirrorNodes
from jaxsph.solids.walls import Ghosts

FILLINGS = {"images": MirrorImages(), "mirror": MirrorNodes(), "dummy": DummyParticles()}
"""Methods that fill the walls with ghosts, by the value of `tank.walls`."""

LONG_STEP_SKIN = {2: 0.7, 3: 0.5}
"""Skin of the neighbour tables for the incompressible scheme, in spacings dx, by number of dimensions. In a
step of this scheme a particle moves up to 0.3 spacings (0.375 in three dimensions). In two dimensions a run
of the OWC with a skin of 0.7 and a search every fourth step takes a fifth less time than with a skin of 0.5
and a search every second step. In three dimensions a narrower skin is used, because each slot of the tables
costs more."""


def build(case: Sections, settings: dict[str, int] | None = None) -> tuple[Model, State]:
    """Builds the model and the initial state of a case.

    `settings`: sizes of the neighbour tables and number of steps between searches (see `model.state.Search`),
    which replace the values computed here. A run passes `settings` when the run is resumed or its tables have
    grown. **Raises** CaseError if the case cannot be built.
    """
    if case.precision == "float64" and jnp.result_type(float) != np.float64:
        raise CaseError(
            'precision = "float64" needs jax.config.update("jax_enable_x64", True) at the start of '
            "the program (the command line does this automatically)"
        )
    dtype = np.dtype(case.precision)
    geometry = Geometry.of(case)

    def leaf(a: Any) -> jax.Array:
        return on_device(a, dtype)

    check_memory(case, geometry)
    scheme = make_scheme(case, make_background(case, geometry, leaf))
    walls = _walls(case, geometry, scheme)
    bodies = make_bodies(case, geometry, walls.dummies, leaf)
    x, volume = water(geometry, case.dx, walls.low)
    motions = Mechanism(bodies).start(dtype)
    away = [at_points(eqx.Partial(body.distance, motions[body.name]), x, dtype) for body in bodies]
    level = geometry.depth if geometry.column == geometry.length else None
    x, volume = around_solids(x, volume, away, _at_start(walls, bodies, motions), level, case.dx)
    if level is not None and case.scheme.kind == "incompressible":
        x = at_rest(x, level, case.dx, scheme.smoothing.kernel)
    if not len(x):
        solids = ", ".join(geometry.named_shapes())
        raise CaseError(f"solids ({solids}) fill the whole tank and leave no water in it: make them smaller")
    g = np.zeros(case.dim)
    g[-1] = -case.g
    still = (x, volume / walls.width)
    skin = LONG_STEP_SKIN[case.dim] if case.scheme.kind == "incompressible" else SKIN
    moving, zones = _near_end(case, geometry, walls, still, skin, leaf)
    return assemble(
        x,
        initial_velocity(case, geometry, x),
        scheme=scheme,
        walls=walls,
        dx=case.dx,
        sample_dt=case.output.sample_dt,
        p=case.fluid.rho0 * case.g * initial_head(geometry, x),
        volume=volume,
        g=g,
        moving=moving,
        bodies=bodies,
        links=make_links(case, bodies, leaf) + make_moorings(case, leaf),
        chambers=make_chambers(case, geometry, bodies, leaf),
        ducts=make_ducts(case, leaf),
        dampers=zones + make_sponges(case, geometry, leaf),
        speed=search_speed(case),
        dt_most=stable_time_step(case),
        skin=skin,
        depth=geometry.depth,
        settings=settings,
        search_by=_search_method(case),
    )


def _near_end(
    case: Sections,
    geometry: Geometry,
    walls: Ghosts,
    still: tuple[np.ndarray, np.ndarray],
    skin: float,
    leaf: Any,
) -> tuple[tuple[AbstractPaddle, ...], tuple[AbstractDamper, ...]]:
    """Wall that moves at the near end, a paddle or the border of a flume, and the relaxation zones there.

    **Arguments**: `still`: positions (m) of the particles at rest and their volumes per metre of the tank's
    width (m2); `skin` of the neighbour tables, in spacings; `leaf`: converts a number to an array.
    """
    if case.flume is not None:
        steps = cadence(case.output.sample_dt, stable_time_step(case), search_speed(case), skin * case.dx)
        return (make_border(case, geometry, walls, still, case.output.sample_dt / math.prod(steps)),), ()
    if case.waves is None:
        return (), ()
    return (make_paddle(case, geometry, walls, still, leaf),), make_zones(case, geometry, leaf)


_placed = eqx.filter_jit(RigidBody.place)
"""Computes the positions (m) of a body's ghosts and nodes; compiled as one function."""


def _at_start(walls: Ghosts, bodies: Iterable[RigidBody], motions: Mapping[str, BodyMotion]) -> Ghosts:
    """Ghosts in their initial positions, for the initial `motions` of the bodies by name."""
    x = walls.x
    for body in bodies:
        rows = slice(*body.rows)
        there, _ = _placed(body, motions[body.name], x[rows], walls.node[rows])
        x = x.at[rows].set(there)
    return eqx.tree_at(lambda ghosts: ghosts.x, walls, x)


def _walls(case: Sections, geometry: Geometry, scheme: AbstractParticleScheme) -> Ghosts:
    """Ghosts of the tank's walls, the device's plate and platform, the bodies and the fixed solids."""
    return Ghosts.build(
        geometry.box(case),
        case.dx,
        scheme.smoothing,
        FreeSlip() if case.tank.slip == "free_slip" else NoSlip(),
        () if geometry.plate is None else (geometry.plate,),
        None if geometry.plate is None or case.device is None else thin_wall(case.device),
        dtype=np.dtype(case.precision),
        platform=geometry.platform,
        filling=FILLINGS[walls_of(case)],
        shapes=tuple(geometry.bodies.values()),
        fixed_shapes=tuple(geometry.solids.values()),
    )


def _search_method(case: Sections) -> type[AbstractSearch]:
    """Class of a case's neighbour search. **Raises** CaseError if jax-md is needed but not installed."""
    if case.search == "cells":
        return Cells
    try:
        jax_md.partition()
    except ImportError as error:
        raise CaseError(str(error)) from None
    return jax_md.JaxMD
