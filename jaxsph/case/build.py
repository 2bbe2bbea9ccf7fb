"""Cases: a validated description in SI units, and `build`, which turns it into a model and a state.

Everything that fixes an array's shape is spent here, on the host. Lengths are snapped to the lattice of
spacing dx, and `Case.notices` says what became of each.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxsph.case.assemble import SKIN, assemble
from jaxsph.case.case import Case
from jaxsph.case.geometry import Geometry, _layers, _smoothing_length, _thin_wall
from jaxsph.case.initial import (
    _initial_head,
    _initial_velocity,
    _outside,
    _search_speed,
    _speed_scale,
    _water,
)
from jaxsph.core.kernels import AbstractKernel, Gaussian, WendlandC2
from jaxsph.errors import CaseError
from jaxsph.model.background import Background
from jaxsph.model.interfaces import AbstractPTO, Model
from jaxsph.model.shifting import Shifting
from jaxsph.model.state import State
from jaxsph.model.viscosity import ArtificialViscosity, PhysicalViscosity
from jaxsph.parts.body import RigidBody
from jaxsph.parts.chamber import BodyForceGrip, Chamber, SurfaceGrip
from jaxsph.parts.paddle import AbsorbingMotion, Paddle, WaveMotion, column_depth
from jaxsph.parts.pto import (
    AbstractRotationalPTO,
    FreeHinge,
    PhasedPTO,
    PneumaticPTO,
    PrescribedPressure,
    RotationalPTO,
)
from jaxsph.parts.sponge import Sponge
from jaxsph.schemes import incompressible, weakly_compressible
from jaxsph.schemes.base import AbstractParticleScheme
from jaxsph.schemes.incompressible import ISPH
from jaxsph.schemes.integrators import PredictorCorrector, SymplecticEuler
from jaxsph.schemes.poisson import BiCGStab, EmptyNeighbours, Explicit, SurfaceParticles
from jaxsph.schemes.weakly_compressible import DeltaSPH
from jaxsph.solids.box import Box, FreeSlip, NoSlip
from jaxsph.solids.filling import DummyParticles, MirrorNodes
from jaxsph.solids.walls import Ghosts
from jaxsph.waves import theory
from jaxsph.waves.absorption import ActiveAbsorption
from jaxsph.waves.regular import RegularWaves, SecondOrderPiston

LONG_STEP_SKIN = 0.5
"""The same for steps in which a particle goes as far as a fifth of a spacing."""


def _kernel(case: Case) -> AbstractKernel:
    return {"gaussian": Gaussian, "wendland": WendlandC2}[case.scheme.kernel]()


def sound_speed(case: Case) -> float:
    """Eq. 2: ten times the larger of the wave's and the dam-break speed scale, m/s."""
    if case.fluid.c0 is not None:
        return case.fluid.c0
    return 10.0 * max(_speed_scale(case), float(np.sqrt(case.g * case.tank.depth)), 1e-3)


def _scheme(case: Case, geometry: Geometry, dim: int, leaf: Any) -> tuple[AbstractParticleScheme, float]:
    """The scheme, and the largest time step that it allows, s."""
    dtype = np.dtype(case.precision)
    if case.isph is not None:
        section = case.isph
        speed = section.speed or max(_speed_scale(case), float(np.sqrt(case.g * case.tank.depth)), 1e-3)
        if section.speed is None and case.tank.column is not None:
            speed = 1.5 * speed  # of the jet where the tip meets a wall
        solver = {"bicgstab": BiCGStab(section.tolerance), "explicit": Explicit()}
        surface = {
            "empty_neighbours": EmptyNeighbours(),
            "particles": SurfaceParticles(),
        }
        found = ISPH.of(
            case.dx,
            speed,
            dim=dim,
            rho0=case.fluid.rho0,
            viscosity=PhysicalViscosity(case.fluid.nu),
            h_over_dx=section.h_over_dx,
            solver=solver[section.solver],
            surface=surface[section.surface],
            relaxation=section.relaxation,
            shifting=None if section.shifting is None else Shifting(section.shifting),
            dtype=dtype,
        )
        return found, incompressible.stable_dt(found, case.g, section.cfl, dim)
    h, c0 = _smoothing_length(case), sound_speed(case)
    integrator = {
        "symplectic": SymplecticEuler,
        "predictor_corrector": PredictorCorrector,
    }[case.scheme.integrator]()
    scheme = DeltaSPH.of(
        case.dx,
        c0,
        rho0=case.fluid.rho0,
        delta=case.scheme.delta,
        viscosity=PhysicalViscosity(case.fluid.nu)
        if case.scheme.alpha is None
        else ArtificialViscosity(case.scheme.alpha),
        kernel=_kernel(case),
        h_over_dx=case.scheme.h_over_dx,
        integrator=integrator,
        dtype=dtype,
        background=_background(case, geometry, leaf),
    )
    cfl = case.scheme.cfl if case.scheme.cfl is not None else integrator.cfl
    # Eq. 10 speaks of the Gaussian's h: the step is set by the spacing, whatever the kernel's own h
    return scheme, weakly_compressible.stable_dt(
        scheme, case.g, cfl * case.scheme.h_over_dx * case.dx / h, dim
    )


def _bodies(case: Case, geometry: Geometry, walls: Ghosts, leaf: Any) -> tuple[RigidBody, ...]:
    """The case's rigid body, if it has one."""
    section, solid = case.body, geometry.solid
    if section is None:
        return ()
    area, centroid, second = solid.moments()
    mass = section.mass if section.density is None else section.density * area
    centre = np.asarray(centroid if section.centre is None else section.centre)
    pivot = centre if section.pivot is None else np.asarray(section.pivot)
    inertia = section.inertia
    if section.density is not None:
        inertia = section.density * second + mass * float(np.sum((centre - pivot) ** 2))
    pto: AbstractRotationalPTO = FreeHinge()
    if section.pto is not None:
        pto = RotationalPTO.of(**section.pto.model_dump(), dtype=np.dtype(case.precision))
    try:
        body = RigidBody(
            free=tuple(name in section.free for name in ("surge", "heave", "pitch")),
            shape=solid,
            mass=leaf(mass or 1.0),  # what nothing moves needs no mass
            inertia=leaf(inertia or 1.0),
            pivot=leaf(pivot),
            centre=leaf(centre),
            release=leaf(section.release),
            pto=pto,
            rows=walls.dummies[0],
            initial_velocity=tuple(section.velocity),
            initial_pitch=section.angle,
        )
    except ValueError as error:
        raise CaseError(f"body.{error}") from None
    return (body,)


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
    dim = 2 if geometry.width is None else 3
    dx = case.dx

    def leaf(a: Any) -> jax.Array:
        return jnp.asarray(a, dtype)

    scheme, dt_limit = _scheme(case, geometry, dim, leaf)
    high = [geometry.length, geometry.height]
    if dim == 3:
        high = [geometry.length, geometry.width, geometry.height]
    box = Box((0.0,) * dim, tuple(high), case.waves is not None, _withdrawal(case, geometry))
    slip = FreeSlip() if case.tank.slip == "free_slip" else NoSlip()
    thin_wall = _thin_wall(case.device) if geometry.plate is not None else None
    dummies = case.tank.walls == "dummy" or case.body is not None
    walls = Ghosts.build(
        box,
        dx,
        scheme.smoothing,
        slip,
        () if geometry.plate is None else (geometry.plate,),
        thin_wall,
        dtype=dtype,
        platform=geometry.platform,
        filling=DummyParticles() if dummies else MirrorNodes(),
        shapes=() if geometry.solid is None else (geometry.solid,),
    )
    bodies = _bodies(case, geometry, walls, leaf)
    x, volume = _water(geometry, dx)
    for body in bodies:
        outside = _outside(np.asarray(body.distance(body.start(dtype), jnp.asarray(x, dtype))) / dx)
        x, volume = x[outside], volume[outside]
    g = np.zeros(dim)
    g[-1] = -case.g
    end = geometry.length
    sponges = ()
    if case.sponge is not None:
        sponges = (Sponge(leaf(end - case.sponge.length), leaf(end + dx), leaf(case.sponge.strength)),)
    V = volume / walls.width
    paddles = () if case.waves is None else (_paddle(case, geometry, walls, (x, V), leaf),)
    return assemble(
        x,
        _initial_velocity(case, geometry, x),
        scheme=scheme,
        walls=walls,
        dx=dx,
        sample_dt=case.output.sample_dt,
        p=case.fluid.rho0 * case.g * _initial_head(geometry, x),
        volume=volume,
        g=g,
        moving=paddles,
        bodies=bodies,
        chambers=_chambers(case, geometry, leaf),
        dampers=sponges,
        speed=_search_speed(case),
        dt_most=dt_limit,
        skin=SKIN if case.isph is None else LONG_STEP_SKIN,
        depth=geometry.depth,
        settings=settings,
    )


def _withdrawal(case: Case, geometry: Geometry) -> float:
    """Distance (m) behind the paddle's place at rest to which the bed goes on.

    It follows from the depth, so that another wave within the limits of the theory makes no other shapes.
    """
    if case.waves is None:
        return 0.0
    k = float(theory.wavenumber(2 * np.pi / case.waves.T, geometry.depth, case.g))
    stroke = case.waves.H / float(theory.biesel(k, geometry.depth))
    # The drift and the absorption ask for more than half a stroke.
    return 1.5 * max(stroke, theory.largest_stroke(geometry.depth)) + 2 * case.dx


def _chambers(case: Case, geometry: Geometry, leaf: Any) -> tuple[Chamber, ...]:
    """The case's chamber, if it has one."""
    if case.device is None or case.pto is None:
        return ()
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
    grip = SurfaceGrip() if case.isph is None else BodyForceGrip()
    return (
        Chamber(
            pto=pto,
            x0=leaf(plate.x1),
            x1=leaf(geometry.length),
            fade_low=leaf(plate.tip),
            fade_high=leaf(plate.tip + 0.5 * draught),
            still=leaf(geometry.depth),
            beyond=leaf(0.5 * case.dx),  # a particle deeper in the end wall ends the run
            grip=grip,
        ),
    )


def _background(case: Case, geometry: Geometry, leaf: Any) -> tuple[Background, ...]:
    """Background pressure of the case's thin wall, if it has one."""
    plate = geometry.plate
    if plate is None or not plate.is_thin(case.dx, _layers(case)):
        return ()
    draught = geometry.depth - plate.tip
    # How far the surface may fall at the plate: standing waves, or an air pressure put on at once.
    fall = case.waves.H if case.waves is not None else 0.0
    if case.pto is not None and case.pto.P_a is not None:
        fall = max(fall, abs(case.pto.P_a) / (case.fluid.rho0 * case.g))
    # Measured at rest and in waves. R must end below the surface, where it would be a false pressure. With
    # much more head left in the sum the tip grows unquiet, with none nothing keeps the particles in order; a
    # narrower zone's own gradients disturb them, and over the whole tank the waves lost 40 % of their height.
    background = Background(
        x=leaf(plate.middle),
        inner=leaf(0.2 * draught),
        outer=leaf(2.0 * draught),
        tip=leaf(plate.tip),
        top=leaf(geometry.depth - 0.1 * draught),
        weight=leaf(case.fluid.rho0 * case.g),
        still=leaf(geometry.depth - min(max(0.3 * draught, fall), 0.5 * draught)),
    )
    return (background,)


def _paddle(
    case: Case, geometry: Geometry, walls: Ghosts, water: tuple[np.ndarray, np.ndarray], leaf: Any
) -> Paddle:
    """Piston wavemaker of the case's waves; `water`: places (m) of the particles and their volumes per metre
    of the tank's width (m2), which its gauge reads at rest."""
    section = case.waves
    regular = RegularWaves(
        leaf(section.H),
        leaf(section.T),
        leaf(geometry.depth),
        leaf(case.g),
        leaf(section.ramp_periods * section.T),
        SecondOrderPiston() if section.second_order else None,
    )
    if not section.absorption:
        return Paddle(motion=WaveMotion(regular), rows=walls.paddle)
    distance, width = 4.0 * _smoothing_length(case), 3.0 * case.dx
    # Slow against the waves, quick against the drift: with 0.01 omega the paddle crept 0.04 m back
    # in ten periods, on the half millimetre by which the gauge's mean is off.
    rate = 0.04 * float(regular.omega)
    absorption = ActiveAbsorption.at_gauge(regular, distance, drift_rate=rate)
    absorption = jax.tree.map(leaf, absorption)
    x, V = (leaf(a) for a in water)
    still = column_depth((x[:, 0], x[:, -1]), V, leaf(distance), leaf(width))
    motion = AbsorbingMotion(regular, absorption, leaf(distance), leaf(width), still)
    return Paddle(motion=motion, rows=walls.paddle)
