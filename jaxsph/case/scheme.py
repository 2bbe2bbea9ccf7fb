"""The scheme of a case: the section `scheme` as an object of `schemes`, with its largest stable time step."""

from __future__ import annotations

import numpy as np

from jaxsph.case.case import Case
from jaxsph.case.speeds import projection_speed, sound_speed
from jaxsph.core.kernels import Gaussian, WendlandC2
from jaxsph.model.background import Background
from jaxsph.model.shifting import Shifting
from jaxsph.model.viscosity import ArtificialViscosity, PhysicalViscosity
from jaxsph.schemes import incompressible, weakly_compressible
from jaxsph.schemes.base import AbstractParticleScheme
from jaxsph.schemes.incompressible import ISPH
from jaxsph.schemes.integrators import AbstractIntegrator, PredictorCorrector, SymplecticEuler
from jaxsph.schemes.poisson import BiCGStab, EmptyNeighbours, Explicit, SurfaceParticles
from jaxsph.schemes.weakly_compressible import DeltaSPH


def make_scheme(case: Case, background: tuple[Background, ...] = ()) -> tuple[AbstractParticleScheme, float]:
    """Scheme of a case in its precision, and the largest stable time step, s.

    `background`: pressures that the weakly compressible scheme takes out of its pair sums.
    """
    if case.scheme.kind == "incompressible":
        return _incompressible(case)
    return _weakly_compressible(case, background)


def _integrator(case: Case) -> AbstractIntegrator:
    kinds = {"symplectic": SymplecticEuler, "predictor_corrector": PredictorCorrector}
    return kinds[case.scheme.integrator]()


def _weakly_compressible(case: Case, background: tuple[Background, ...]) -> tuple[DeltaSPH, float]:
    section, integrator = case.scheme, _integrator(case)
    viscosity = (
        PhysicalViscosity(case.fluid.nu) if section.alpha is None else ArtificialViscosity(section.alpha)
    )
    scheme = DeltaSPH.of(
        case.dx,
        sound_speed(case),
        rho0=case.fluid.rho0,
        delta=section.delta,
        viscosity=viscosity,
        kernel={"gaussian": Gaussian, "wendland": WendlandC2}[section.kernel](),
        h_over_dx=section.h_over_dx,
        integrator=integrator,
        dtype=np.dtype(case.precision),
        background=background,
    )
    cfl = section.cfl if section.cfl is not None else integrator.cfl
    # Eq. 10 speaks of the Gaussian's h: the step is set by the spacing, whatever the kernel's own h
    share = cfl * section.h_over_dx * case.dx / case.smoothing_length
    return scheme, weakly_compressible.stable_dt(scheme, case.g, share, case.dim)


def _incompressible(case: Case) -> tuple[ISPH, float]:
    section = case.scheme
    solvers = {"bicgstab": BiCGStab(section.tolerance), "explicit": Explicit()}
    surfaces = {"empty_neighbours": EmptyNeighbours(), "particles": SurfaceParticles()}
    scheme = ISPH.of(
        case.dx,
        projection_speed(case),
        dim=case.dim,
        rho0=case.fluid.rho0,
        viscosity=PhysicalViscosity(case.fluid.nu),
        h_over_dx=section.h_over_dx,
        solver=solvers[section.solver],
        surface=surfaces[section.surface],
        relaxation=section.relaxation,
        shifting=None if section.shifting is None else Shifting(section.shifting),
        dtype=np.dtype(case.precision),
    )
    return scheme, incompressible.stable_dt(scheme, case.g, section.cfl, case.dim)
