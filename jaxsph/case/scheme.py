"""Scheme of a case: an object of `schemes` built from the section `scheme`, and its time step."""

from __future__ import annotations

import numpy as np

from jaxsph.case.sections import Incompressible, Sections, WeaklyCompressible
from jaxsph.case.speeds import projection_speed, sound_speed
from jaxsph.model.background import Background
from jaxsph.model.shifting import Shifting
from jaxsph.model.viscosity import AbstractViscosity, ArtificialViscosity, PhysicalViscosity
from jaxsph.problem.trouble import Remedies, Trouble
from jaxsph.schemes.base import AbstractParticleScheme
from jaxsph.schemes.incompressible import ISPH
from jaxsph.schemes.integrators import AbstractIntegrator, PredictorCorrector, SymplecticEuler
from jaxsph.schemes.kernels import STEP_LENGTH
from jaxsph.schemes.poisson import BiCGStab, EmptyNeighbours, Explicit, SurfaceParticles
from jaxsph.schemes.time_step import stable_dt
from jaxsph.schemes.weakly_compressible import DeltaSPH


def make_scheme(case: Sections, background: tuple[Background, ...] = ()) -> AbstractParticleScheme:
    """Scheme of a case, in the case's precision.

    `background`: pressures that the weakly compressible scheme subtracts in its pair sums.
    """
    section = case.scheme
    if isinstance(section, Incompressible):
        return _incompressible(case, section)
    return _weakly_compressible(case, section, background)


def stable_time_step(case: Sections) -> float:
    """Largest stable time step of a case's scheme, s."""
    return _stable_dt(case, _kinematic_viscosity(case), case.g)


def shortest_limit(case: Sections) -> str:
    """Limit of the stable time step (speed, viscosity or gravity), and the keys to change, in words."""
    dt = stable_time_step(case)
    if dt == _stable_dt(case, 0.0, 0.0):
        if case.scheme.kind == "incompressible":
            return (
                f"the largest speed expected, {projection_speed(case):.3g} m/s: change scheme.speed, "
                "scheme.cfl or dx"
            )
        return f"the sound speed, {sound_speed(case):.3g} m/s: change fluid.c0, scheme.cfl or dx"
    if dt == _stable_dt(case, _kinematic_viscosity(case), 0.0):
        given = "fluid.nu" if getattr(case.scheme, "alpha", None) is None else "scheme.alpha"
        return f"the viscosity, {_kinematic_viscosity(case):.3g} m2/s: change {given} or dx"
    return "gravity on the scale of a spacing: change dx"


def remedies(case: Sections) -> Remedies:
    """Advice on which keys of a case to change if the run fails, by the kind of failure."""
    rim = "raise tank.height and continue with jaxsph resume FILE --set tank.height={higher}, "
    found = {
        Trouble.OVER_RIM: rim + 'or let water leave with tank.rim = "open"',
        Trouble.THROUGH_WALL: "reduce scheme.cfl or dx",
        Trouble.NOT_CONVERGED: (
            'raise scheme.tolerance, reduce scheme.cfl, or set scheme.solver = "explicit"'
        ),
        Trouble.TOO_DENSE: 'set tank.walls = "mirror"',
        Trouble.NO_TABLES: "reduce scheme.cfl or dx",
        Trouble.TOUCHING: (
            "reduce the body's density or mass, or restrain the body by a [link.NAME] or a [mooring.NAME]"
        ),
    }
    if isinstance(case.scheme, Incompressible):
        fast, unsteady = (
            "raise scheme.speed, or reduce scheme.cfl",
            "reduce scheme.cfl, or raise scheme.speed",
        )
    else:
        fast = (
            "raise fluid.c0, or reduce the waves' height; if a smaller scheme.cfl helps, the time step was "
            "too long"
        )
        unsteady = "reduce scheme.cfl, or raise scheme.alpha (0.01 to 0.05)"
    return found | {Trouble.TOO_FAST: fast, Trouble.NOT_FINITE: unsteady}


def _stable_dt(case: Sections, nu: float, g: float) -> float:
    """Stable time step (s) for the kinematic viscosity `nu` (m2/s) and gravity `g` (m/s2)."""
    h, section = case.smoothing_length, case.scheme
    if isinstance(section, Incompressible):
        return stable_dt(STEP_LENGTH[case.dim] * case.dx, projection_speed(case), nu, g, section.cfl)
    cfl = section.cfl if section.cfl is not None else _integrator(section).cfl
    # Eq. 10 holds for the Gaussian's h = h_over_dx dx, which therefore replaces the kernel's own h here
    share = cfl * section.h_over_dx * case.dx / h
    return stable_dt(h, sound_speed(case), nu, g, share)


def _integrator(section: WeaklyCompressible) -> AbstractIntegrator:
    kinds = {"symplectic": SymplecticEuler, "predictor_corrector": PredictorCorrector}
    return kinds[section.integrator]()


def _viscosity(case: Sections) -> AbstractViscosity:
    alpha = getattr(case.scheme, "alpha", None)
    return PhysicalViscosity(case.fluid.nu) if alpha is None else ArtificialViscosity(alpha)


def _kinematic_viscosity(case: Sections) -> float:
    """Kinematic viscosity to which the scheme's viscous term corresponds, m2/s."""
    c0 = sound_speed(case) if case.scheme.kind == "weakly_compressible" else 0.0
    return float(_viscosity(case).kinematic(case.smoothing_length, c0, case.dim))


def _weakly_compressible(
    case: Sections, section: WeaklyCompressible, background: tuple[Background, ...]
) -> DeltaSPH:
    return DeltaSPH.of(
        case.dx,
        sound_speed(case),
        rho0=case.fluid.rho0,
        delta=section.delta,
        viscosity=_viscosity(case),
        kernel=section.smoothing_kernel(case.dim),
        h_over_dx=section.h_over_dx,
        hyperviscosity=section.hyperviscosity,
        separation=section.separation,
        integrator=_integrator(section),
        dtype=np.dtype(case.precision),
        background=background,
    )


def _incompressible(case: Sections, section: Incompressible) -> ISPH:
    solvers = {"bicgstab": BiCGStab(section.tolerance), "explicit": Explicit()}
    surfaces = {"empty_neighbours": EmptyNeighbours(), "particles": SurfaceParticles()}
    return ISPH.of(
        case.dx,
        projection_speed(case),
        dim=case.dim,
        rho0=case.fluid.rho0,
        viscosity=_viscosity(case),
        kernel=section.smoothing_kernel(case.dim),
        h_over_dx=section.smoothing_length(case.dim),
        hyperviscosity=section.hyperviscosity,
        separation=section.separation,
        solver=solvers[section.solver],
        surface=surfaces[section.surface],
        relaxation=section.relaxation,
        shifting=None if section.shifting is None else Shifting(section.shifting),
        dtype=np.dtype(case.precision),
    )
