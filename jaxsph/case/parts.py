"""Parts of a model from a case's sections: wavemaker, chambers, ducts, background pressure
and relaxation zone.

`leaf` converts a number to an array of the case's precision.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from jaxsph.case.air_sections import AirSection, DuctSection, PTOSection
from jaxsph.case.basin import has_basin, make_basin_zone, make_field, make_segmented
from jaxsph.case.geometry import PADDLE_GAUGE, Geometry
from jaxsph.case.sections import Sections
from jaxsph.model.air import AbstractPTO
from jaxsph.model.background import Background
from jaxsph.model.interfaces import AbstractDamper
from jaxsph.model.solids import AbstractBody
from jaxsph.parts.air import AbstractAirLaw, IncompressibleAir, IsentropicAir
from jaxsph.parts.chamber import Chamber
from jaxsph.parts.duct import Duct
from jaxsph.parts.paddle import AbsorbingMotion, AbstractPaddle, Paddle, WaveMotion, column_depth
from jaxsph.parts.pto import (
    AbstractTurbine,
    CharacteristicCurve,
    ClosedPTO,
    Constriction,
    LinearTurbine,
    PhasedPTO,
    PneumaticPTO,
    PrescribedPressure,
    ReliefValve,
    orifice_damping,
)
from jaxsph.parts.relaxation import FlowMotion, RelaxationZone
from jaxsph.solids.walls import Ghosts
from jaxsph.waves.absorption import ActiveAbsorption
from jaxsph.waves.base import AbstractWaves
from jaxsph.waves.regular import FirstOrderPiston, RegularWaves, SecondOrderPiston
from jaxsph.waves.seas import Sea


def make_waves(case: Sections, geometry: Geometry, leaf: Any) -> AbstractWaves:
    """Waves of a case, in water of the depth rounded to whole spacings."""
    section, depth = case.waves, geometry.depth
    ramp = section.ramp_periods * section.period
    if section.kind == "regular":
        order = SecondOrderPiston() if section.second_order else FirstOrderPiston()
        return RegularWaves(*(leaf(a) for a in (section.H, section.T, depth, case.g, ramp)), order)
    a, omega = section.sum_of_waves(depth, case.g)
    dtype = np.dtype(case.precision)
    return Sea.of(a, omega, depth, ramp, second_order_piston=section.second_order, g=case.g, dtype=dtype)


def make_paddle(
    case: Sections, geometry: Geometry, walls: Ghosts, water: tuple[np.ndarray, np.ndarray], leaf: Any
) -> AbstractPaddle:
    """Wavemaker of a case's waves; `water`: positions (m) of the particles at rest and their volumes
    per metre of the tank's width (m2); they give the still water depth at the paddle's gauge."""
    section, waves = case.waves, make_waves(case, geometry, leaf)
    if has_basin(case):
        return make_segmented(case, geometry, make_field(case, geometry, waves, leaf), walls.paddle, leaf)
    if section.zone is not None:
        return Paddle(motion=FlowMotion(waves), rows=walls.paddle)
    if not section.absorption:
        return Paddle(motion=WaveMotion(waves), rows=walls.paddle)
    distance, width = PADDLE_GAUGE * case.dx, 3.0 * case.dx
    # The drift correction is slow compared with the waves and fast compared with the drift. At a rate of
    # 0.01 omega the paddle drifted back 0.04 m in ten periods, because the gauge's mean is wrong by half a
    # millimetre.
    rate = 0.04 * float(waves.omega)
    absorption = ActiveAbsorption.at_gauge(waves, distance, drift_rate=rate)
    absorption = jax.tree.map(leaf, absorption)
    x, V = water
    given = (leaf(x[:, 0]), leaf(x[:, -1])), leaf(V), leaf(distance), leaf(width)
    still = jax.jit(column_depth)(*given)
    motion = AbsorbingMotion(waves, absorption, leaf(distance), leaf(width), still)
    return Paddle(motion=motion, rows=walls.paddle)


def make_chambers(
    case: Sections, geometry: Geometry, bodies: Sequence[AbstractBody], leaf: Any
) -> tuple[Chamber, ...]:
    """Chambers of a case, in the tank or in one of its `bodies`."""
    by_name, found = {body.name: body for body in bodies}, []
    for name, section in case.chambers.items():
        stretch = geometry.stretches[name]
        chamber = Chamber.of(
            ClosedPTO() if section.pto is None else make_pto(case, section.pto, leaf),
            between=stretch.walls,
            tip=stretch.tip,
            level=geometry.depth,
            dx=case.dx,  # a particle deeper than half of dx in a wall ends the run
            air=make_air(section.air, leaf),
            name=name,
            dtype=np.dtype(case.precision),
        )
        found.append(chamber.in_body(by_name[stretch.carrier]) if stretch.carrier else chamber)
    return tuple(found)


def make_ducts(case: Sections, leaf: Any) -> tuple[Duct, ...]:
    """Ducts between a case's chambers."""
    laws = ((name, one.between, _duct_law(case, one, leaf)) for name, one in case.duct.items())
    return tuple(Duct(between, law, name=name) for name, between, law in laws)


def _duct_law(case: Sections, section: DuctSection, leaf: Any) -> AbstractPTO:
    """Law of the pressure drop in a duct: a turbine, or the loss downstream of the smallest cross-section."""
    if section.pto is not None:
        return make_pto(case, section.pto, leaf)
    assert section.area is not None
    return Constriction(leaf(orifice_damping(section.area, section.discharge, section.density)))


def make_pto(case: Sections, section: PTOSection, leaf: Any) -> AbstractPTO:
    """Power take-off of a chamber or a duct."""
    if not section.is_turbine:
        return PrescribedPressure(leaf(section.P_a), leaf(section.ramp))
    turbine: AbstractTurbine | PhasedPTO
    if section.phase is not None:
        omega = 2.0 * np.pi / case.waves.period
        turbine = PhasedPTO(leaf(section.K_dm), leaf(section.phase), leaf(omega))
    elif section.quadratic is not None:
        turbine = PneumaticPTO(leaf(section.quadratic))
    elif section.resistance is not None:
        turbine = LinearTurbine(leaf(section.resistance))
    else:
        q, P_a = np.array(section.points).T
        turbine = CharacteristicCurve(leaf(q), leaf(P_a))
    if not section.has_relief:
        return turbine
    over, under = (np.inf if p is None else p for p in (section.relief, section.suction))
    return ReliefValve(turbine, leaf(over), leaf(under))


def make_air(section: AirSection | None, leaf: Any) -> AbstractAirLaw:
    """Air of a chamber."""
    if section is None:
        return IncompressibleAir()
    return IsentropicAir(leaf(section.volume), leaf(section.pressure), leaf(section.gamma))


def make_background(case: Sections, geometry: Geometry, leaf: Any) -> tuple[Background, ...]:
    """Background pressure around the device's thin plate; empty if the case has none."""
    plate = geometry.plate
    if plate is None or not plate.is_thin(case.dx, case.layers):
        return ()
    draught = geometry.depth - plate.tip
    # Largest fall of the surface at the plate, in standing waves or under a sudden air pressure.
    fall = case.waves.highest(geometry.depth, case.g) if case.waves is not None else 0.0
    fall = max([fall, *(abs(P_a) / (case.fluid.rho0 * case.g) for P_a in case.prescribed)])
    # These fractions were found by runs at rest and in waves. The background must end below the surface,
    # because it would act as a false pressure there. If the background leaves much more head in the pair
    # sums, the flow at the tip becomes noisy; if it leaves no head, nothing keeps the particles in order. The
    # steeper gradients of a narrower background disturb the particles. With a background over the whole tank
    # the waves lost 40 % of their height.
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


ZONE_STRENGTH = 1.0
"""Ratio of the largest relaxation rate in a zone to the waves' angular frequency.

The wave height was compared with the target height for waves 1.5 spacings high and a wall that reflects all
waves. In a zone of one wavelength the wave height is 0.99 of the target height at this rate, and 1.03 at half
of this rate. In a zone of three quarters of a wavelength it is 0.95 of the target height at this rate, and
0.89 at four times this rate.
"""


def make_zones(case: Sections, geometry: Geometry, leaf: Any) -> tuple[AbstractDamper, ...]:
    """Relaxation zone at the near end of a case's tank, and along its sides; empty if the case has none."""
    if case.waves is None or case.waves.zone is None:
        return ()
    waves, length = make_waves(case, geometry, leaf), case.waves.zone
    strength = ZONE_STRENGTH * 2.0 * np.pi / case.waves.period
    if has_basin(case):
        field = make_field(case, geometry, waves, leaf)
        return (make_basin_zone(case, geometry, field, strength, leaf),)
    # velocities are interpolated linearly on a grid of two spacings, which begins behind the paddle's stroke
    # and ends beyond the zone
    x, z = (
        np.arange(low, high + 2.0 * case.dx, 2.0 * case.dx)
        for low, high in ((-geometry.withdrawal, length), (0.0, geometry.height))
    )
    return (RelaxationZone(waves, *(leaf(a) for a in (length, strength, x, z))),)
