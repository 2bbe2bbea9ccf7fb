"""Wave field over the plan of a basin, its relaxation zones and wavemaker, and checks of their keys.

A case has a basin if its waves are oblique, or if it has relaxation zones along the side walls.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from jaxsph.case.geometry import Geometry
from jaxsph.case.sections import Sections
from jaxsph.case.settling import given_waves
from jaxsph.case.speeds import wavenumber
from jaxsph.case.wave_section import AbstractWavesSection
from jaxsph.case.wave_sections import RegularWavesSection
from jaxsph.errors import CaseError
from jaxsph.parts.relaxation import BasinZone
from jaxsph.parts.segmented import SegmentedPaddle
from jaxsph.waves.base import AbstractWaves
from jaxsph.waves.fields import AbstractWaveField, DirectionalSea, LongCrestedWaves
from jaxsph.waves.theory import stokes3_wavenumber

SIDE_STRENGTH = 4.0
"""Ratio of the largest relaxation rate in the zones along the side walls to the waves' angular frequency.

The side walls reflect oblique waves. A high rate damps the reflected waves within the zones, but also
reflects a part of the waves that enter the zones. The linear shallow-water equations were solved with zones
half a wavelength wide, at ratios of 2, 4 and 8. Waves at 20 degrees differ from the target by up to 10, 11
and 8 % of the amplitude, and by 2, 2 and 1 % on average. For waves that meet the zones at right angles the
reflection coefficient is 0.11, 0.25 and 0.33.
"""
LEAST_WIDTH = 0.25
"""Smallest width of the zones along the side walls, in wavelengths."""


def has_basin(case: Sections) -> bool:
    """Whether a case has a basin: oblique waves, or relaxation zones along the side walls."""
    waves = case.waves
    return waves is not None and (waves.oblique or waves.side_zones is not None)


def make_field(case: Sections, geometry: Geometry, waves: AbstractWaves, leaf: Any) -> AbstractWaveField:
    """Wave field over the plan of a basin; `waves`: the case's waves, travelling along x."""
    section, middle = given_waves(case), 0.5 * _width(geometry)
    if getattr(section, "spreading", None) is None:
        longer = 1.0
        if isinstance(section, RegularWavesSection):
            third = stokes3_wavenumber(section.H, section.T, geometry.depth, case.g)
            longer = wavenumber(section.T, geometry.depth, case.g) / float(third)
        return LongCrestedWaves(
            waves=waves, direction=leaf(section.direction), middle=leaf(middle), lengthening=leaf(longer)
        )
    a, omega = section.sum_of_waves(geometry.depth, case.g)
    return DirectionalSea.of(
        a,
        omega,
        section.directions(len(omega)),
        geometry.depth,
        ramp=section.ramp_periods * section.period,
        middle=middle,
        g=case.g,
        dtype=np.dtype(case.precision),
    )


def make_segmented(
    case: Sections, geometry: Geometry, field: AbstractWaveField, rows: tuple[int, int], leaf: Any
) -> SegmentedPaddle:
    """Segmented wavemaker behind the relaxation zone of a basin, with segments one spacing wide."""
    joints = np.linspace(0.0, _width(geometry), round(_width(geometry) / case.dx) + 1)
    return SegmentedPaddle(field=field, y=leaf(joints), rows=rows)


def make_basin_zone(
    case: Sections, geometry: Geometry, field: AbstractWaveField, strength: float, leaf: Any
) -> BasinZone:
    """Relaxation zone of a basin; `strength`: relaxation rate at the near end, 1/s."""
    section, dx, width = given_waves(case), case.dx, _width(geometry)
    assert section.zone is not None, "`check_basin` has found a zone"
    # grid points one spacing apart keep the error of linear interpolation below one per cent; the grid begins
    # behind the wavemaker's stroke
    ends = (
        (-geometry.withdrawal, section.zone if section.side_zones is None else geometry.length),
        (0.0, width),
        (0.0, geometry.height),
    )
    nodes = (np.arange(low, high + dx, dx) for low, high in ends)
    omega = 2.0 * np.pi / section.period
    side = 0.0 if section.side_zones is None else SIDE_STRENGTH * omega
    sides = case.dx if section.side_zones is None else section.side_zones
    numbers = (section.zone, sides, width, strength, side)
    return BasinZone(field, *(leaf(a) for a in (*numbers, *nodes)))


def check_basin(case: Sections, geometry: Geometry) -> None:
    """**Raises** CaseError for oblique waves or side zones in a tank that cannot have them."""
    waves = case.waves
    if waves is None or not has_basin(case):
        return
    key, value = _key(waves)
    if geometry.width is None:
        raise CaseError(f"{value} needs a tank in three dimensions: give tank.width, or remove waves.{key}")
    if waves.zone is None:
        why = "the paddle makes only waves along the tank" if waves.oblique else "the zones need waves.zone"
        raise CaseError(
            f"{value}: {why}; give waves.zone, the length of a relaxation zone in front of the paddle, or "
            f"remove waves.{key}"
        )
    if waves.oblique and geometry.gauges:
        raise CaseError(
            f"probes.gauges = {list(case.probes.gauges)}: these gauges measure averages across the tank, "
            f"which have no meaning in oblique waves ({value}); use probes.surface, which has points (x, y)"
        )
    if waves.side_zones is not None:
        _check_sides(case, geometry, waves.side_zones)


def _key(waves: AbstractWavesSection) -> tuple[str, str]:
    """Key in the section `waves` that needs a basin, and this key with its value as text."""
    if waves.direction != 0.0:
        return "direction", f"waves.direction = {waves.direction:g} rad"
    if waves.oblique:
        return "spreading", f"waves.spreading = {getattr(waves, 'spreading', 0.0):g}"
    return "side_zones", f"waves.side_zones = {waves.side_zones:g} m"


def _check_sides(case: Sections, geometry: Geometry, width: float) -> None:
    """**Raises** CaseError for zones along the side walls that are too narrow or too wide."""
    whole = _width(geometry)
    value = f"waves.side_zones = {width:g} m"
    length = 2.0 * np.pi / wavenumber(given_waves(case).period, geometry.depth, case.g)
    if width < LEAST_WIDTH * length:
        raise CaseError(
            f"{value}: must be at least a quarter of a wavelength, {LEAST_WIDTH * length:.3g} m; half a "
            "wavelength is better"
        )
    if width > 0.45 * whole:
        raise CaseError(
            f"{value}: the two zones would leave less than a tenth of the width of {whole:g} m free; use a "
            f"larger tank.width, or waves.side_zones of at most {0.45 * whole:.3g} m"
        )


def _width(geometry: Geometry) -> float:
    """Width of a basin, m."""
    assert geometry.width is not None, "`check_basin` has found a width"
    return geometry.width


def basin_notices(case: Sections) -> list[str]:
    """Notice of oblique waves between side walls that reflect them."""
    waves = case.waves
    if waves is None or not waves.oblique or waves.side_zones is not None:
        return []
    return [
        f"{_key(waves)[1]}: the side walls reflect oblique waves; give waves.side_zones to let the oblique "
        "waves pass"
    ]
