"""Cases: a validated description in SI units, and `build`, which turns it into a model and a state.

Everything that fixes an array's shape is spent here, on the host. Lengths are snapped to the lattice of
spacing dx, and `Case.notices` says what became of each.
"""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxsph.case.assemble import SKIN, assemble
from jaxsph.case.case import Case
from jaxsph.case.geometry import Geometry, thin_wall
from jaxsph.case.initial import initial_head, initial_velocity, outside_body, water
from jaxsph.case.parts import make_body, make_wavemaker
from jaxsph.case.scheme import make_scheme
from jaxsph.case.speeds import speed_scale
from jaxsph.errors import CaseError
from jaxsph.model.background import Background
from jaxsph.model.interfaces import AbstractPTO, Model
from jaxsph.model.state import State
from jaxsph.parts.chamber import Chamber
from jaxsph.parts.paddle import column_depth
from jaxsph.parts.pto import PhasedPTO, PneumaticPTO, PrescribedPressure
from jaxsph.parts.sponge import Sponge
from jaxsph.solids.box import Box, FreeSlip, NoSlip
from jaxsph.solids.filling import DummyParticles, MirrorNodes
from jaxsph.solids.walls import Ghosts
from jaxsph.waves import theory

LONG_STEP_SKIN = 0.5
"""The same for steps in which a particle goes as far as a fifth of a spacing."""


def build(case: Case, settings: dict[str, int] | None = None) -> tuple[Model, State]:
    """Model and initial state of a case.

    `settings` overrides the capacities and the cadence found here (see `state.Search`): a resumed or
    regrown run passes the ones that it had. **Raises** CaseError for a case that cannot be built.
    """
    if case.precision == "float64" and not jax.config.jax_enable_x64:
        raise CaseError(
            'precision = "float64" needs jax.config.update("jax_enable_x64", True) at the start of '
            "the program (the command line does it by itself)"
        )
    dtype = np.dtype(case.precision)
    geometry = Geometry.of(case)
    dim = case.dim
    dx = case.dx

    def leaf(a: Any) -> jax.Array:
        return jnp.asarray(a, dtype)

    scheme, dt_limit = make_scheme(case, _background(case, geometry, leaf))
    stroke = 0.0
    if case.waves is not None:
        k = float(theory.wavenumber(2 * np.pi / case.waves.T, case.tank.depth, case.g))
        stroke = case.waves.H / float(theory.biesel(k, case.tank.depth))
    high = [geometry.length, geometry.height]
    if dim == 3:
        high = [geometry.length, geometry.width, geometry.height]
    box = Box((0.0,) * dim, tuple(high), case.waves is not None, 1.5 * stroke + 2 * dx)
    slip = FreeSlip() if case.tank.slip == "free_slip" else NoSlip()
    dummies = case.tank.walls == "dummy" or case.body is not None
    walls = Ghosts.build(
        box,
        dx,
        scheme.smoothing,
        slip,
        geometry.plate,
        thin_wall(case.device) if geometry.plate is not None else None,
        dtype=dtype,
        platform=geometry.platform,
        filling=DummyParticles() if dummies else MirrorNodes(),
        solid=geometry.solid,
    )
    body, body_state = make_body(case, geometry, leaf)
    x, volume = water(geometry, dx)
    if body is not None:
        outside = outside_body(np.asarray(body.distance(jnp.asarray(x, dtype), body_state)) / dx)
        x, volume = x[outside], volume[outside]
    g = np.zeros(dim)
    g[-1] = -case.g
    wavemaker = make_wavemaker(case, geometry, leaf)
    sponge = None
    if case.sponge is not None:
        end = geometry.length
        sponge = Sponge(leaf(end - case.sponge.length), leaf(end + dx), leaf(case.sponge.strength))
    model, state = assemble(
        x,
        initial_velocity(case, geometry, x),
        scheme=scheme,
        walls=walls,
        dx=dx,
        sample_dt=case.output.sample_dt,
        p=case.fluid.rho0 * case.g * initial_head(geometry, x),
        volume=volume,
        g=g,
        wavemaker=wavemaker,
        sponge=sponge,
        chamber=_chamber(case, geometry, leaf),
        body=body,
        body_state=body_state,
        speed=speed_scale(case),
        dt_most=dt_limit,
        skin=LONG_STEP_SKIN if case.scheme.kind == "incompressible" else SKIN,
        depth=geometry.depth,
        stroke=stroke,
        settings=settings,
    )
    particles = state.particles
    if wavemaker is not None:
        V = scheme.volume(particles) / walls.width
        still = column_depth((particles.x[:, 0], particles.x[:, -1]), V, wavemaker.gauge, 3.0 * model.dx)
        model = eqx.tree_at(lambda a: a.wavemaker.still, model, still)
    return model, state


def _chamber(case: Case, geometry: Geometry, leaf: Any) -> Chamber | None:
    if case.device is None or case.pto is None:
        return None
    pto: AbstractPTO
    if case.pto.K_dm is None:
        pto = PrescribedPressure(leaf(case.pto.P_a), leaf(case.pto.ramp))
    elif case.pto.phase is None:
        pto = PneumaticPTO(leaf(case.pto.K_dm))
    else:
        omega = 2.0 * np.pi / case.waves.T
        pto = PhasedPTO(leaf(case.pto.K_dm), leaf(case.pto.phase), leaf(omega))
    plate = geometry.plate
    draught = geometry.depth - plate.tip
    return Chamber(
        pto,
        leaf(plate.x1),
        leaf(geometry.length),
        leaf(plate.tip),
        leaf(plate.tip + 0.5 * draught),
        leaf(geometry.depth),
    )


def _background(case: Case, geometry: Geometry, leaf: Any) -> Background | None:
    plate = geometry.plate
    if plate is None or not plate.is_thin(case.dx, case.layers):
        return None
    draught = geometry.depth - plate.tip
    # How far the surface may fall at the plate: standing waves, or an air pressure put on at once.
    fall = case.waves.H if case.waves is not None else 0.0
    if case.pto is not None and case.pto.P_a is not None:
        fall = max(fall, abs(case.pto.P_a) / (case.fluid.rho0 * case.g))
    # Measured at rest and in waves. R must end below the surface, where it would be a false pressure. With
    # much more head left in the sum the tip grows unquiet, with none nothing keeps the particles in order; a
    # narrower zone's own gradients disturb them, and over the whole tank the waves lost 40 % of their height.
    return Background(
        x=leaf(plate.middle),
        inner=leaf(0.2 * draught),
        outer=leaf(2.0 * draught),
        tip=leaf(plate.tip),
        top=leaf(geometry.depth - 0.1 * draught),
        weight=leaf(case.fluid.rho0 * case.g),
        still=leaf(geometry.depth - min(max(0.3 * draught, fall), 0.5 * draught)),
    )
