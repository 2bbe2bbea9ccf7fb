"""Notices of a case that can run, but is near a limit, or beyond a limit of theory or resolution."""

from __future__ import annotations

from jaxsph.case.basin import basin_notices
from jaxsph.case.geometry import Geometry
from jaxsph.case.limits import asked, breaking_height
from jaxsph.case.scheme import stable_time_step
from jaxsph.case.sections import Sections
from jaxsph.case.shapes import ends_at, inertia_of
from jaxsph.case.speeds import reference_speed, sound_speed
from jaxsph.case.wave_sections import WavesSection
from jaxsph.waves import theory

CHAMBER = 6
"""Length of a chamber, in spacings, below which a case gets a notice. The efficiency of the built-in OWC is
0.53 to 0.57 if the chamber is 3.2 spacings long, and 0.66 to 0.68 if the chamber is 6.5 spacings long."""
SAMPLE = 0.1
"""Ratio of the sampling interval to the waves' period above which a case gets a notice."""
SHORTER = 2.0
"""Factor by which the sampling interval may shorten the time step without a notice. A sampling interval has
at least two steps."""
GAUGE = 3.0
"""Half-width of the water column that a gauge measures, in spacings."""
GAP = 2.0
"""Gap between a body and the tank, in spacings, below which a case gets a notice. The vertical force on the
built-in flap is 2.5 % too small with 1.5 spacings between flap and bed, and 13 % with one spacing."""
RESOLVED = 3.0
"""Height of the waves, in spacings, below which a case gets a notice."""
SPONGE = 0.9
"""Length of the sponge, in wavelengths, below which a case gets a notice. In waves of 0.15 m the built-in
flap, whose sponge is 0.84 wavelengths long, absorbs 6 % more power with a sponge of 1.8 wavelengths."""
NEAR = 0.8
"""Ratio of the highest wave's height to the breaking height above which a case gets a notice."""


def limit_notices(case: Sections, geometry: Geometry) -> list[str]:
    """Notices of a case that can run, but is near a limit, or beyond a limit of theory or resolution."""
    notes = []
    if case.scheme.kind == "weakly_compressible" and sound_speed(case) < 3.0 * reference_speed(case):
        notes.append(
            f"fluid.c0 = {case.fluid.c0:g} m/s is less than three times the largest speed expected of "
            f"water and waves, {reference_speed(case):.3g} m/s: use a larger fluid.c0, because the run stops "
            "if water is faster than a third of fluid.c0"
        )
    for name, stretch in geometry.stretches.items():
        if stretch.narrowest < CHAMBER * case.dx:
            long = "long" if case.dim == 2 else "wide"
            key = f"chamber.{name}, whose water surface is {stretch.narrowest:.4g} m {long},"
            if case.is_device_chamber(name):
                key = f"device.chamber_length = {stretch.narrowest:g} m"
            notes.append(
                f"{key} is only {stretch.narrowest / case.dx:.1f} spacings {long}: expect an efficiency that "
                f"is a tenth to a fifth too low, or use a smaller dx ({CHAMBER} spacings or more are usual)"
            )
    if geometry.plate is not None and geometry.plate.thickness < 0.99 * case.dx:
        notes.append(
            f"device.wall_thickness = {geometry.plate.thickness:.3g} m is less than a spacing (dx = "
            f"{case.dx:g} m): the flow is noisy at the wall's tip, and the efficiency may be a tenth too "
            "low; use a smaller dx, or a thicker wall"
        )
    notes += _sinking(case, geometry)
    notes += _narrow_gaps(case, geometry)
    notes += basin_notices(case)
    notes += _gauge_notices(case, geometry)
    stable, sample = stable_time_step(case), case.output.sample_dt
    if SHORTER * 0.5 * sample < stable:
        notes.append(
            f"output.sample_dt = {sample:g} s limits the time step to {0.5 * sample:.3g} s, although "
            f"time steps of up to {stable:.3g} s are stable: use output.sample_dt = {2.0 * stable:.2g} s or "
            f"more; the run then takes {0.5 * sample / stable:.2g} times as long"
        )
    return notes if case.waves is None else notes + _wave_notices(case, case.waves, geometry)


def _wave_notices(case: Sections, waves: WavesSection, geometry: Geometry) -> list[str]:
    """Notices about the waves of a case: their sampling, breaking, theory, resolution and repetition."""
    notes = []
    if case.output.sample_dt > SAMPLE * waves.period:
        notes.append(
            f"output.sample_dt = {case.output.sample_dt:g} s is more than a tenth of the waves' period of "
            f"{waves.period:g} s: peaks are missed, and the reflection analysis needs at least eight "
            f"samples per period; use {SAMPLE * waves.period:.3g} s or less"
        )
    H, T = waves.highest(geometry.depth, case.g), waves.period
    highest, why = breaking_height(T, geometry.depth, case.g)
    if H > NEAR * highest:
        which = "" if waves.kind == "regular" else f": the highest wave, {H:.3g} m high,"
        breaks = "is near breaking" if H <= highest else "is beyond breaking"
        notes.append(f"{asked(waves)}{which} {breaks}, which begins at a height of {highest:.3g} m ({why})")
    if waves.kind == "regular":
        notes += theory.theory_limits(H, T, geometry.depth, case.g)
    if waves.height < RESOLVED * case.dx * (1.0 - 1e-9):  # 4.8 m is below 3 * 1.6 m by rounding
        notes.append(
            f"{asked(waves)} is only {waves.height / case.dx:.1f} spacings high; "
            "expect a visible decay of the height along the tank, or use a smaller dx (five spacings or more "
            "are usual)"
        )
    if case.sponge is not None and case.sponge.length < SPONGE * (
        wavelength := float(theory.wavelength(T, geometry.depth, case.g))
    ):
        notes.append(
            f"sponge.length = {case.sponge.length:g} m: waves with a period of {T:.3g} s are "
            f"{wavelength:.3g} m long, so that the sponge reflects a part of them; use one wavelength or "
            "more, in a longer tank"
        )
    if waves.kind == "recorded" and waves.left_out > 0.02:
        notes.append(
            f"waves.{'X' if waves.eta is None else 'eta'}: components with {waves.left_out:.0%} of the "
            "variance are left out, because they are too long or too short for the paddle, or too small"
        )
    # at most one repetition of a sea or series is averaged, but the whole record of a group
    if waves.kind == "focused" and case.t1 > waves.repeats:
        notes.append(
            f"t1 = {case.t1:g} s: the wave group repeats after {waves.repeats:g} s; use a smaller t1"
        )
    return notes


def _gauge_notices(case: Sections, geometry: Geometry) -> list[str]:
    """Notices about gauges that are too close to a plate, body or solid that pierces the surface."""
    spans = []
    if geometry.plate is not None:
        spans.append(("the plate", geometry.plate.x0, geometry.plate.x1))
    for name, shape in geometry.shapes.items():
        # a submerged solid does not disturb a gauge, because the surface above is free
        ends = ends_at(shape, geometry.depth)
        spans += [] if ends is None else [(f"the {name}", *ends)]
    reach = GAUGE * case.dx - 1e-9
    return [
        f"probes.gauges[{index}] = {x:g} m: a gauge measures the water up to {reach:.3g} m to either side, "
        f"but {what} is in this range, from {low:.4g} to {high:.4g} m; move the gauge, because it would mix "
        "the levels of both sides, or read too low a level"
        for index, x in enumerate(geometry.gauges)
        for what, low, high in spans
        if low - reach < x < high + reach
    ]


def _narrow_gaps(case: Sections, geometry: Geometry) -> list[str]:
    """Notices about bodies that are at rest nearer to the bed or a wall than `GAP`, without touching it."""
    box, notes = geometry.box(case), []
    for name, shape in geometry.bodies.items():
        gaps = {}
        for axis, (low, high) in enumerate(zip(*shape.bounds(), strict=True)):
            floor, lid = box.walls[axis]
            vertical = axis == len(box.low) - 1
            gaps |= {"the bed" if vertical else "a wall": low - box.low[axis]} if floor else {}
            gaps |= {"a wall": box.high[axis] - high} if lid and not vertical else {}
        notes += [
            f"{case.body_key(name)} leaves a gap of {gap:.3g} m to {what}, {gap / case.dx:.1f} spacings: "
            f"the force of the water on this side may be a tenth off; use dx of at most {gap / GAP:.3g} m, "
            "or a wider gap"
            for what, gap in gaps.items()
            if 0.01 * case.dx < gap < (GAP - 0.01) * case.dx
        ]
    return notes


def _sinking(case: Sections, geometry: Geometry) -> list[str]:
    """Notices about bodies that sink: free in heave, heavier than the water they displace, and not held."""
    held = {one.joined_to for one in case.every_body.values()}
    for link in case.link.values():
        held |= {link.body, *(link.between or ())}
    held |= {mooring.body for mooring in case.mooring.values()}
    notes, per = [], "kg/m" if case.dim == 2 else "kg"
    for name, section in case.every_body.items():
        if "heave" not in section.free or section.joined_to or name in held:
            continue
        shape, key = geometry.bodies[name], case.body_key(name)
        mass, most = inertia_of(section, shape, key).mass, case.fluid.rho0 * shape.moments()[0]
        if mass > most:
            notes.append(
                f"{key} sinks: its mass of {mass:.4g} {per} is more than the {most:.4g} {per} of water that "
                "it can displace, and no link or mooring holds it; the run stops when the body is on the bed"
            )
    return notes
