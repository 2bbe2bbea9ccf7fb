"""Limits of a case beyond the ranges of its keys: breaking waves, too many steps, too many particles.

The checks use only the numbers of the case; no particles are placed before a case has passed them.
"""

from __future__ import annotations

import math
import os
from pathlib import Path

import jax
import numpy as np
import shapely

from jaxsph.case.absorbing import check_absorbing
from jaxsph.case.air_sections import ChamberSection
from jaxsph.case.basin import check_basin
from jaxsph.case.geometry import PADDLE_GAUGE, Geometry, walls_of
from jaxsph.case.names import check_names
from jaxsph.case.scheme import shortest_limit, stable_time_step
from jaxsph.case.section import choice
from jaxsph.case.sections import Sections
from jaxsph.case.speeds import wavenumber
from jaxsph.case.wave_section import AbstractWavesSection
from jaxsph.core.points import at_points
from jaxsph.errors import CaseError
from jaxsph.solids.images import Images
from jaxsph.solids.shapes import AbstractShape

MOST_STEPS = 1e8
"""Largest number of time steps of a run; this many steps take weeks even in the smallest tank."""
MOST_PARTICLES = 2**31 - 1
"""Largest number of lattice points of a case, because the particles are numbered by int32."""
BYTES_PER_PLACE = 150
"""Memory per lattice point of the tank, up to the top of the walls, while ghosts are placed on the host,
bytes. This memory is for three copies of the coordinates in float64, and a search tree."""
BYTES_AT_LEAST = 1e9
"""Memory of the program and of its compilation, bytes; measurements gave 0.65 to 1.1 GB."""
DEPTH_BREAKING = 0.78
"""Largest ratio of the wave height to the depth (McCowan 1894)."""
STEEPNESS_BREAKING = 0.142
"""Largest ratio of the wave height to the wavelength, divided by tanh(kd) (Miche 1944)."""
STANDING_BREAKING = 0.218
"""Largest ratio of the height of a standing wave to its wavelength (Penney and Price 1952)."""


def check_limits(case: Sections, geometry: Geometry) -> None:
    """**Raises** CaseError if a case cannot be run, for example with breaking waves or too many steps."""
    _check_waves(case, geometry)
    check_basin(case, geometry)
    _check_standing_wave(case, geometry)
    _check_places(case, geometry)
    check_names(case)
    for name, section in case.chambers.items():
        _check_air(case, geometry, name, section)
    _check_ducts(case)
    _check_probes(case, geometry)
    check_absorbing(case, geometry)
    _check_solids(case, geometry)
    _check_coast(case, geometry)
    _check_steps(case)


def breaking_height(T: float, d: float, g: float) -> tuple[float, str]:
    """Height (m) above which waves of period `T` (s) break in water of depth `d` (m), and the criterion
    in words."""
    k = wavenumber(T, d, g)
    by_depth = DEPTH_BREAKING * d
    by_steepness = STEEPNESS_BREAKING * 2.0 * np.pi / k * np.tanh(k * d)
    if by_depth < by_steepness:
        return by_depth, f"{DEPTH_BREAKING:g} of the depth of {d:g} m, McCowan 1894"
    length = 2.0 * np.pi / k
    return by_steepness, f"Miche's limit, {STEEPNESS_BREAKING:g} tanh(kd) times the wavelength {length:.3g} m"


def particle_counts(case: Sections, geometry: Geometry) -> tuple[int, int]:
    """Numbers of particles of water and of walls that `build` makes, to within a few per cent."""
    dx, layers = case.dx, case.layers
    across = 1 if geometry.width is None else _count(geometry.width, dx)
    wet = _count(geometry.column - case.near, dx) * _count(geometry.depth, dx)
    wet += _count(geometry.length - geometry.column, dx) * _count(geometry.layer, dx)
    shapes = geometry.shapes.values()
    in_place_of = sum(_under(shape, geometry.depth) for shape in shapes) / dx**case.dim
    long, high = _count(geometry.length - case.near, dx), _count(geometry.height, dx)
    behind = math.ceil(geometry.withdrawal / dx)
    wide = 1 if geometry.width is None else across + 2 * layers
    walls = (long + 2 * layers) * wide * (high + layers) - long * across * high + behind * wide * layers
    if walls_of(case) == "images":
        platforms = () if geometry.platform is None else (geometry.platform,)
        radius = case.scheme.support(case.dim) * dx
        walls = Images.of(geometry.box(case), platforms, dx, radius).count
        for platform in platforms:
            walls += layers * (_count(geometry.length - platform.start, dx) + _count(platform.height, dx))
    if geometry.plate is not None:
        walls += 2 * layers * _count(geometry.height - geometry.plate.tip, dx)
    walls += sum(_dummies(shape, dx, layers) for shape in shapes)
    return wet * across - round(in_place_of), walls


def check_memory(case: Sections, geometry: Geometry) -> None:
    """**Raises** CaseError if a case needs more memory than the machine, or the accelerator, has."""
    available = machine_memory()
    water, walls = particle_counts(case, geometry)
    each = case.scheme.bytes_per_particle[case.dim]
    needed = BYTES_AT_LEAST + each * (water + walls) + BYTES_PER_PLACE * _places(geometry)
    columns = (
        50
        + sum(len(a) for a in (geometry.gauges, geometry.surface, geometry.pressure))
        + len(geometry.velocity) * case.dim
    )
    series = 8.0 * columns * case.t1 / case.output.sample_dt
    needed += series
    if needed > available:
        long = series > 0.5 * needed
        remedy = "a larger output.sample_dt, or a smaller t1" if long else "a larger dx, or a smaller tank"
        raise CaseError(
            f"dx = {case.dx:g} m makes about {water:.3g} particles of water and {walls:.3g} of walls, which "
            f"need about {needed / 1e9:.3g} GB ({each} bytes per particle, {BYTES_PER_PLACE} per point of "
            f"the lattice, {series / 1e9:.2g} GB for recorded series), but {available / 1e9:.3g} GB are "
            f"available: use {remedy}"
        )


def machine_memory() -> float:
    """Smallest of the memories of the machine, its control group and the accelerator in use, bytes."""
    found = [math.inf]
    try:
        found.append(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    except (AttributeError, OSError, ValueError):
        pass  # the system does not report its memory
    try:
        found.append(float(Path("/sys/fs/cgroup/memory.max").read_text()))
    except (OSError, ValueError):
        pass  # no control group, or a control group without a limit
    found += [
        stats["bytes_limit"]
        for device in jax.local_devices()[:1]
        if (stats := device.memory_stats()) and "bytes_limit" in stats
    ]
    return min(found)


def _count(length: float, dx: float) -> int:
    return round(length / dx)


def _places(geometry: Geometry) -> float:
    """Number of lattice points of a tank up to the top of its walls."""
    return math.prod(length / geometry.dx for length in geometry.upper)


def _under(shape: AbstractShape, level: float) -> float:
    """Volume of a shape (m3; m2 in 2-D) below a level (m)."""
    low, high = shape.bounds()
    if len(low) == 3:
        filled = shape.moments()[0] / float(np.prod(high - low))
        return filled * float(np.prod(np.maximum(np.minimum(high, [*high[:2], level]) - low, 0.0)))
    return shape.region().intersection(shapely.box(low[0], low[1], high[0], max(level, low[1]))).area


def _dummies(shape: AbstractShape, dx: float, layers: int) -> int:
    """Number of dummy particles of a solid: as many as its layers contain, but no more than fit inside."""
    low, high = shape.bounds()
    if len(low) == 2:
        whole = shape.region()
        return round(min(whole.area / dx**2, layers * whole.length / dx))
    sides = (high - low) / dx + 1
    return round(min(float(np.prod(sides)), layers * float(2 * np.sum(np.prod(sides) / sides))))


def _check_places(case: Sections, geometry: Geometry) -> None:
    places = _places(geometry) + particle_counts(case, geometry)[1]
    if places > MOST_PARTICLES:
        raise CaseError(
            f"dx = {case.dx:g} m makes a lattice of {places:.3g} points in a tank of "
            f"{' x '.join(f'{a:g}' for a in geometry.upper)} m: at most {MOST_PARTICLES:.3g} can be "
            "numbered. Use a larger dx, or a smaller tank"
        )
    longest = max(geometry.upper)
    resolved = longest * 2.0**-23
    if case.precision == "float32" and case.dx < 30.0 * resolved:
        raise CaseError(
            f"dx = {case.dx:g} m: float32 resolves positions in a tank of {longest:g} m to {resolved:.2g} m; "
            f'use dx of at least {30 * resolved:.2g} m, or precision = "float64"'
        )


def _check_standing_wave(case: Sections, geometry: Geometry) -> None:
    start = case.start
    if start is None:
        return
    if case.waves is not None:
        raise CaseError("start and waves exclude each other: remove [start] or [waves]")
    if case.g == 0.0:
        raise CaseError(
            "start: a standing wave needs gravity, but g = 0; use a positive g, or remove [start]"
        )
    half = geometry.length / start.mode
    if half < 2 * case.dx:
        raise CaseError(
            f"start.mode = {start.mode}: half a wavelength, {half:.3g} m, is less than two spacings of "
            f"{case.dx:g} m; use a mode of at most {int(geometry.length / (2 * case.dx))}"
        )
    highest = STANDING_BREAKING * half
    if start.amplitude > min(highest, geometry.depth):
        raise CaseError(
            f"start.amplitude = {start.amplitude:g} m: a standing wave with this amplitude and a "
            f"wavelength of {2 * half:.3g} m breaks in a depth of {geometry.depth:g} m; use an amplitude of "
            f"at most {min(highest, geometry.depth):.3g} m"
        )


def _check_waves(case: Sections, geometry: Geometry) -> None:
    waves = case.waves
    if waves is None:
        for key, pto in case.ptos.items():
            if pto.phase is not None:
                raise CaseError(
                    f"{key}.phase = {list(pto.phase)}: the damping follows the phase of the waves, but the "
                    "case has no waves; give [waves], or remove this key"
                )
        return
    if case.g == 0.0:
        raise CaseError("waves need gravity, but g = 0: use a positive g, or remove [waves]")
    key = waves.period_key
    period = (
        f"waves.t (mean period {waves.period:.3g} s)" if key == "t" else f"waves.{key} = {waves.period:g} s"
    )
    highest, why = breaking_height(waves.period, geometry.depth, case.g)
    if waves.height > highest:
        other = "a longer period" if "Miche" in why else "a larger tank.depth"
        raise CaseError(
            f"{asked(waves)}: waves with a period of {waves.period:.4g} s in a depth of {geometry.depth:g} m "
            f"break above a height of {highest:.3g} m ({why}); use a smaller height, or {other}"
        )
    length = 2.0 * np.pi / wavenumber(waves.period, geometry.depth, case.g)
    if length < waves.least_length * case.dx:
        number = "four" if waves.least_length == 4 else f"{waves.least_length}"
        raise CaseError(
            f"{period}: the wavelength, {length:.3g} m, is less than {number} spacings (dx = {case.dx:g} m); "
            f"use a longer period, or dx of at most {length / waves.least_length:.3g} m"
        )
    if geometry.stroke > 0.5 * geometry.front:
        raise CaseError(
            f"{period}, {asked(waves)}: the paddle would need a stroke of {geometry.stroke:.3g} m, more than "
            f"half of the {geometry.front:g} m of water in front of the paddle; use a shorter period, a "
            "smaller height or a longer tank"
        )
    if waves.zone is not None:
        _check_zone(waves.zone, length, geometry)
        return
    gauge = (PADDLE_GAUGE + 2) * case.dx
    if waves.absorption and gauge > geometry.front:
        raise CaseError(
            f"tank.length = {case.tank.length:g} m: the paddle's gauge needs {gauge:.3g} m of water in "
            f"front of the paddle, but there are only {geometry.front:g} m; use a longer tank, or a "
            "smaller dx"
        )


def _check_zone(zone: float, length: float, geometry: Geometry) -> None:
    """**Raises** CaseError if a relaxation zone is too short for its waves, or fills the whole tank."""
    if zone < 0.5 * length:
        raise CaseError(
            f"waves.zone = {zone:g} m: must be at least half a wavelength, {0.5 * length:.3g} m; use a "
            "longer zone, or active absorption (remove waves.zone)"
        )
    if zone > 0.9 * geometry.front:
        raise CaseError(
            f"waves.zone = {zone:g} m leaves less than a tenth of the {geometry.front:g} m of water free: "
            "use a larger tank.length, or a shorter zone"
        )


def asked(waves: AbstractWavesSection) -> str:
    """Key that sets the wave height, and its value, as text; with the significant height if the value is not
    this height."""
    key, sea = waves.height_key, f"(significant height {waves.height:.3g} m)"
    value = getattr(waves, key)
    if value is None:  # the height follows from the peak period, or from the paddle's displacement
        return f"waves.{waves.period_key if key == 'Hs' else 'X'} {sea}"
    if isinstance(value, float):
        return f"waves.{key} = {value:g} m" + ("" if value == waves.height else f" {sea}")
    return f"waves.{key} = {list(value)} m {sea}" if len(value) == 2 else f"waves.{key} {sea}"


def _check_air(case: Sections, geometry: Geometry, name: str, section: ChamberSection) -> None:
    """**Raises** CaseError if the air would escape under a wall, if suction would lift the water above the
    walls, if the water could fill the volume of air, or if waves could overtop the walls."""
    of_device = case.is_device_chamber(name)
    key, stretch = "" if of_device else f"chamber.{name}.", geometry.stretches[name]
    rise = case.waves.highest(geometry.depth, case.g) if case.waves is not None else 0.0
    room = min(stretch.top, geometry.height) - geometry.depth
    higher = "a higher roof" if stretch.carrier else "higher walls" if key else "a larger tank.height"
    if rise > room + 1e-9:
        asked = stretch.given if key else f"tank.height = {geometry.height:g} m"
        what = "the roof is" if stretch.carrier else "a wall ends"
        raise CaseError(
            f"{asked}: {what} {room:.4g} m above the water, and waves are {rise:.4g} m high; use {higher}, "
            "or lower waves"
        )
    if section.air is not None:
        if section.pto is not None and not section.pto.is_turbine:
            raise CaseError(
                f"{key}air: compressible air needs a turbine, not a prescribed pressure; change [{key}pto], "
                f"or remove [{key}air]"
            )
        if section.air.volume < stretch.surface * rise:
            size = f"{stretch.surface:g} m long" if case.dim == 2 else f"of {stretch.surface:g} m2"
            volume = "m2" if case.dim == 2 else "m3"
            raise CaseError(
                f"{key}air.volume = {section.air.volume:g} {volume}: waves {rise:.3g} m high may fill the "
                f"chamber; a chamber with a water surface {size} needs at least {stretch.surface * rise:.3g} "
                f"{volume}"
            )
    elif section.pto is None and not any(name in duct.between for duct in case.duct.values()):
        raise CaseError(
            f"chamber.{name}: the air has no outlet; give [chamber.{name}.pto], a duct, or "
            f"[chamber.{name}.air] for compressible air"
        )
    if section.pto is None or not section.pto.P_a:
        return
    asked = f"{key}pto.P_a = {section.pto.P_a:g} Pa"
    if case.g == 0.0:
        raise CaseError(
            f"{asked}: without gravity (g = 0) the water cannot balance the air's pressure; use a positive "
            "g, or another power take-off"
        )
    # the water that leaves one side raises the other; a change of level is inversely proportional to the area
    whole = geometry.length * (1.0 if geometry.width is None else geometry.width)
    front = geometry.front if of_device else whole - stretch.surface
    share = front / (front + stretch.surface)
    fall = share * section.pto.P_a / (case.fluid.rho0 * case.g)
    draught = geometry.depth - stretch.tip
    if fall > draught:
        raise CaseError(
            f"{asked} would lower the chamber's level by {fall:.3g} m, but the wall ends {draught:g} m "
            f"below still water: use at most {section.pto.P_a * draught / fall:.4g} Pa"
        )
    if -fall > room:
        raise CaseError(
            f"{asked} would raise the chamber's level by {-fall:.3g} m, but "
            f"{'the roof is' if stretch.carrier else 'the walls end'} {room:.3g} m above the water: use at "
            f"least {section.pto.P_a * room / -fall:.4g} Pa, or {higher}"
        )


def _check_ducts(case: Sections) -> None:
    """**Raises** CaseError for ducts that do not join two chambers, or have a prescribed pressure."""
    for name, duct in case.duct.items():
        asked = f"duct.{name}.between = {list(duct.between)}"
        for end in duct.between:
            if end not in case.chambers:
                raise CaseError(f"{asked}: there is no chamber {end!r}; {choice(case.chambers, 'chambers')}")
        if duct.between[0] == duct.between[1]:
            raise CaseError(f"{asked}: a duct needs two different chambers")
        if duct.pto is not None and not duct.pto.is_turbine:
            raise CaseError(
                f"duct.{name}.pto.P_a = {duct.pto.P_a:g} Pa: the pressure drop of a duct follows from its "
                "flow; give K_dm, resistance, area or curve instead"
            )


def _check_probes(case: Sections, geometry: Geometry) -> None:
    """**Raises** CaseError for probes inside a plate, a platform, a solid or a body at rest."""
    plate, slack = geometry.plate, 0.01 * case.dx
    if plate is not None:
        for index, x in enumerate(geometry.gauges):
            if plate.x0 + slack < x < plate.x1 - slack:
                raise CaseError(
                    f"probes.gauges[{index}] = {x:g} m is inside the plate, which is between {plate.x0:g} "
                    f"and {plate.x1:g} m: move the gauge out of the plate"
                )
    for name in ("pressure", "velocity"):
        for index, point in enumerate(getattr(geometry, name)):
            solid = _solid_at(geometry, point, slack)
            if solid is not None:
                raise CaseError(
                    f"probes.{name}[{index}] = {list(point)} m is inside the {solid}: move the point out of "
                    f"the {solid}, or onto its boundary"
                )


def _solid_at(geometry: Geometry, point: tuple[float, ...], slack: float) -> str | None:
    """Name of the solid that contains a point (m) more than `slack` (m) below the solid's surface; None for a
    point in water or air."""
    x, z = point[0], point[-1]
    plate, platform = geometry.plate, geometry.platform
    if plate is not None and plate.x0 + slack < x < plate.x1 - slack and z > plate.tip + slack:
        return "plate"
    if platform is not None and x > platform.start + slack and z < platform.height - slack:
        return "platform"
    for name, shape in geometry.shapes.items():
        if at_points(shape.distance, np.asarray([point]))[0] < -slack:
            return name
    return None


def _check_solids(case: Sections, geometry: Geometry) -> None:
    """**Raises** CaseError for solids in the relaxation zone, or too close to the paddle."""
    clear = 0.5 * geometry.stroke + 4.0 * case.dx
    zone = 0.0 if case.waves is None else case.waves.zone or 0.0
    for name, shape in geometry.solids.items():
        first = float(shape.bounds()[0][0])
        if case.waves is not None and first < max(clear, zone):
            what = (
                f"relaxation zone ends at {zone:g} m" if zone > clear else f"paddle needs {clear:.3g} m free"
            )
            raise CaseError(
                f"solid.{name} begins at x = {first:.4g} m, but the {what}: move the solid away from "
                "the paddle"
            )


def _check_coast(case: Sections, geometry: Geometry) -> None:
    """**Raises** CaseError for a probe of overtopping or run-up, unless its solid exists and has a crest
    above still water."""
    for key in ("overtopping", "run_up"):
        for name in getattr(case.probes, key):
            if name not in geometry.solids:
                raise CaseError(
                    f"probes.{key}: there is no solid {name!r}; {choice(geometry.solids, 'solids')}"
                )
            top = float(geometry.solids[name].bounds()[1][-1])
            if top <= geometry.depth:
                raise CaseError(
                    f"probes.{key}: the crest of {name}, at z = {top:g} m, must be above still water, at "
                    f"z = {geometry.depth:g} m; make the solid higher, or remove the probe"
                )


def _check_steps(case: Sections) -> None:
    if case.output.sample_dt > case.t1:
        raise CaseError(
            f"output.sample_dt = {case.output.sample_dt:g} s: must be at most t1 = {case.t1:g} s; otherwise "
            "nothing is recorded"
        )
    stable, sample = stable_time_step(case), case.output.sample_dt
    dt = min(stable, 0.5 * sample)  # a sampling interval has two steps or more
    if not case.t1 / dt <= MOST_STEPS:
        why = shortest_limit(case) if stable <= dt else f"output.sample_dt = {sample:g} s: use a longer one"
        raise CaseError(
            f"t1 = {case.t1:g} s takes {case.t1 / dt:.3g} time steps of {dt:.3g} s, but at most "
            f"{MOST_STEPS:.0e} are allowed. The step is limited by {why}"
        )
