"""Cases from which the added mass, damping and excitation of a case's bodies are found.

In still water one motion of one body is prescribed and all others are held; in regular waves all bodies are
held.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from jaxsph.analysis.coefficients import MOTIONS, Mode, worst_separation
from jaxsph.case.case import Case
from jaxsph.case.geometry import Geometry
from jaxsph.case.hydrostatics import submerged
from jaxsph.case.shapes import inertia_of
from jaxsph.case.speeds import wavenumber
from jaxsph.errors import CaseError
from jaxsph.waves import theory

SAMPLES = 50
"""Number of samples in a period."""
STILL = 1e-6
"""Height of the waves in runs with a prescribed motion, m. This height is negligible, but a case with
waves has a paddle, which absorbs the radiated waves that reach it."""
RAMP = 2.0
"""Number of periods over which the motion or the waves are ramped up."""
LEAST_LENGTH = 20
"""Smallest ratio of the wavelength to the spacing. Shorter waves decay so fast that the computed damping is
no longer the radiation damping."""
LEAST_SPONGE = 0.5
"""Smallest length of the sponge, in wavelengths."""
SHARE = 0.1
"""Ratio of a prescribed motion's amplitude to the draught, or to the height of the wet part of the body."""
PLACES = (0.0, 0.13, 0.31, 0.58, 1.0)
"""Positions of the gauges, as fractions of their row's length; unevenly spaced, to separate waves of all
lengths."""
LARGEST_CONDITION = 10.0
"""Largest condition number of the equations that separate the waves at the gauges (-), as in
`analysis.reflection`."""


@dataclass(frozen=True)
class Forcing:
    """Amplitude, wave height and duration of the runs from which coefficients are found."""

    amplitude: float | None = None
    """Amplitude of a prescribed motion, m; for pitch, the amplitude of the wet point farthest from the pivot.
    By default a tenth of the draught (or of the height of the wet part), but at least half a spacing."""
    height: float | None = None
    """Height of the waves in runs with all bodies held, m. By default `waves.H`; without regular waves in
    the case, twice the smallest default amplitude of the prescribed motions."""
    cycles: int = 5
    """Number of periods that are averaged."""

    def __post_init__(self) -> None:
        """**Raises** CaseError for sizes that are not positive, and for fewer than two periods."""
        for name in ("amplitude", "height"):
            value = getattr(self, name)
            if value is not None and not (value > 0.0 and math.isfinite(value)):
                raise CaseError(f"{name} = {value}: must be a positive number, in m")
        if self.cycles < 2:
            raise CaseError(f"cycles = {self.cycles}: must be 2 or more, to compute a standard deviation")


def find_modes(
    case: Case, asked: Mapping[str, Sequence[str]] | Sequence[str] | None = None
) -> tuple[Mode, ...]:
    """Modes of a case: all motions in which bodies are free or are carried, or the requested motions.

    `asked`: names of the requested motions, for all bodies with free motions, or by the body's name. A body
    on an inclined slider has both surge and heave. A body joined to another is carried by the other and has
    the motions of both; a body joined to a pitching body has all three. **Raises** CaseError if the case has
    no such motions.
    """
    _check_case(case)
    free = {name: _moves(case, name) for name in case.every_body}
    free = {name: found for name, found in free.items() if found}
    if not free:
        keys = " or ".join(f"{case.body_key(name)}.free" for name in case.every_body)
        raise CaseError(f'no body has a free motion: give {keys}, for example free = ["heave"]')
    if asked is None:
        asked = free
    elif not isinstance(asked, Mapping):
        asked = {name: asked for name in free}
    modes = []
    for body, motions in asked.items():
        if body not in case.every_body:
            raise CaseError(f"body {body!r}: there is no such body; choose from {', '.join(case.every_body)}")
        for motion in motions:
            if motion not in MOTIONS:
                raise CaseError(f"motion {motion!r}: must be one of {', '.join(MOTIONS)}")
        modes += [Mode(body, motion) for motion in MOTIONS if motion in motions]
    if not modes:
        raise CaseError(f"no motion is requested: give at least one of {', '.join(MOTIONS)}")
    return tuple(modes)


def _check_case(case: Any) -> None:
    """**Raises** CaseError for a case whose coefficients cannot be found."""
    if not isinstance(case, Case):
        raise CaseError("coefficients need a case, such as a TOML file, not a function of your own")
    if not case.every_body:
        raise CaseError("there is no body: added mass and damping need a section [body] or [bodies.NAME]")
    if case.tank.width is not None:
        raise CaseError(
            f"tank.width = {case.tank.width:g} m: coefficients are found in two dimensions only; remove the "
            "key (values are then per metre of width)"
        )
    if case.g == 0.0:
        raise CaseError("g = 0: coefficients need waves, and waves need gravity; use a positive g")
    if case.chambers or case.tank.column is not None:
        what = "tank.column" if case.tank.column is not None else f"chamber.{next(iter(case.chambers))}"
        raise CaseError(
            f"{what}: coefficients can only be computed for bodies in open, still water; remove {what}"
        )


def _moves(case: Case, name: str) -> tuple[str, ...]:
    """Motions of a body in the x-z plane: those of its own joint, and those of a body that carries it."""
    section = case.every_body[name]
    own = set(section.free)
    if section.incline and own & {"surge", "heave"}:
        own |= {"surge", "heave"}
    if section.joined_to is not None:
        above = _moves(case, section.joined_to)
        own |= set(MOTIONS if "pitch" in above else above)
    return tuple(one for one in MOTIONS if one in own)


def reference(case: Case, modes: Sequence[Mode]) -> float:
    """Position at which the phase of the waves is zero, m from the paddle: the pivot of the first
    mode's body."""
    first = modes[0].body
    shape = Geometry.of(case).bodies[first]
    return float(inertia_of(case.every_body[first], shape, case.body_key(first)).pivot[0])


def usual_amplitude(case: Case, geometry: Geometry, body: str) -> float:
    """Default amplitude of the prescribed motions of a body, m."""
    wet = submerged(geometry.bodies[body].region(), geometry.depth)
    _, low, _, high = wet.bounds
    return max(0.5 * case.dx, SHARE * (high - low))


def forced(case: Case, mode: Mode, T: float, forcing: Forcing) -> Case:
    """Case in which a body makes one harmonic motion of period T (s) in still water; other motions are held.

    The paddle, or the relaxation zone of the case, absorbs the waves that reach it.
    """
    geometry = Geometry.of(case)
    size = usual_amplitude(case, geometry, mode.body) if forcing.amplitude is None else forcing.amplitude
    if mode.motion == "pitch":
        shape = geometry.bodies[mode.body]
        pivot = inertia_of(case.every_body[mode.body], shape, case.body_key(mode.body)).pivot
        corners = shapely.get_coordinates(submerged(shape.region(), geometry.depth))
        size /= float(np.max(np.hypot(*(corners - pivot).T)))
    amplitude = tuple(size if one == mode.motion else 0.0 for one in MOTIONS)
    begin = RAMP * T + T + 2.0 * _front(geometry) / _group_velocity(geometry, T, case.g)
    return _held(case, geometry, T, STILL, begin, forcing.cycles, {mode.body: amplitude})


def in_waves(case: Case, modes: Sequence[Mode], T: float, forcing: Forcing) -> Case:
    """Case with regular waves of the period T (s), in which all bodies are held."""
    geometry, height = Geometry.of(case), forcing.height
    if height is None and case.waves is not None and case.waves.kind == "regular":
        height = case.waves.H
    if height is None:
        height = 2.0 * min(usual_amplitude(case, geometry, mode.body) for mode in modes)
    ways = max(geometry.length, 3.0 * _front(geometry))
    begin = RAMP * T + ways / _group_velocity(geometry, T, case.g)
    return _held(case, geometry, T, height, begin, forcing.cycles, {})


def _held(
    case: Case,
    geometry: Geometry,
    T: float,
    H: float,
    begin: float,
    cycles: int,
    amplitudes: Mapping[str, tuple[float, ...]],
) -> Case:
    """Case with every body held or, if `amplitudes` names it, moved with these amplitudes, in waves of
    height H (m) and period T (s).

    `cycles` whole periods follow the time `begin` (s). A held body has a motion of zero amplitude. All runs
    therefore have the same parts, share a compiled program, and can form one batch on an accelerator.
    """
    data = case.model_dump(exclude_none=True, mode="json")
    for gone in ("link", "start"):
        data.pop(gone, None)
    for name, section in case.every_body.items():
        place = data["body"] if case.body_key(name) == "body" else data["bodies"][name]
        turns = bool(_moves(case, name)) or section.motion is not None
        for gone in ("free", "joined_to", "incline", "motion", "velocity", "release", "pto", "sensors"):
            place.pop(gone, None)
        if turns:
            place.pop("angle", None)  # the initial pitch of a body that turns; a fixed body keeps its angle
        amplitude = amplitudes.get(name, (0.0, 0.0, 0.0))
        place["motion"] = {"amplitude": amplitude, "period": T, "ramp": RAMP * T}
    kept = data.get("waves", {})
    waves = {"kind": "regular", "H": H, "T": T, "ramp_periods": RAMP}
    data["waves"] = waves | {key: kept[key] for key in ("zone", "second_order") if key in kept}
    t1 = T * (math.ceil(begin / T - 1e-9) + cycles)
    data["t1"] = t1
    data["probes"] = {"gauges": gauges(geometry, T, case.g, None if case.waves is None else case.waves.zone)}
    # a snapshot and a checkpoint in every period; a killed run continues from its last checkpoint
    data["output"] = {"sample_dt": T / SAMPLES, "snapshot_dt": T, "periods": cycles}
    return Case.from_dict(data)


def check_period(case: Case, T: float) -> None:
    """**Raises** CaseError if the tank cannot resolve, absorb or measure waves of the period T (s)."""
    geometry = Geometry.of(case)
    length = 2.0 * math.pi / wavenumber(T, geometry.depth, case.g)
    asked = f"period = {T:g} s: the wavelength of {length:.3g} m"
    if length < LEAST_LENGTH * case.dx:
        raise CaseError(
            f"{asked} is less than {LEAST_LENGTH} spacings (dx = {case.dx:g} m); use a longer period, or "
            f"dx of at most {length / LEAST_LENGTH:.3g} m"
        )
    if case.sponge is not None and case.sponge.length < LEAST_SPONGE * length:
        raise CaseError(
            f"{asked} is more than twice sponge.length = {case.sponge.length:g} m, and a large part "
            "of the waves would return; use a shorter period, or a sponge of at least "
            f"{LEAST_SPONGE * length:.3g} m"
        )
    row = gauges(geometry, T, case.g, None if case.waves is None else case.waves.zone)
    if worst_separation(row, 2.0 * math.pi / length) > LARGEST_CONDITION:
        raise CaseError(
            f"{asked} is too long for the {_front(geometry):.3g} m between the paddle and the first body or "
            "solid, because gauges over so short a distance cannot separate incident waves from reflected "
            "and radiated ones; place the bodies farther from the paddle, or use a shorter period"
        )


def gauges(geometry: Geometry, T: float, g: float, zone: float | None) -> list[float]:
    """Positions of five gauges in front of the solids, m, over 0.45 wavelengths of the period T (s) if there
    is room.

    The gauges are at least one depth from the solids, and at least one depth from the paddle or beyond the
    relaxation `zone` (m), because there are evanescent waves closer to the solids and the paddle.
    **Raises** CaseError if there is no room.
    """
    first, last = zone or geometry.depth, _front(geometry) - geometry.depth
    if last - first < 8.0 * geometry.dx:
        begin = f"beyond waves.zone = {zone:g} m" if zone else "one depth or more from the paddle"
        raise CaseError(
            f"tank: the first body or solid is {_front(geometry):.3g} m from the paddle, which leaves less "
            f"than eight spacings for gauges {begin} and one depth ({geometry.depth:g} m) or more from this "
            "body or solid; move the bodies away from the paddle by "
            f"{8.0 * geometry.dx - (last - first):.3g} m or more"
        )
    span = min(last - first, 0.45 * 2.0 * math.pi / wavenumber(T, geometry.depth, g))
    return [round(last - span * (1.0 - place), 9) for place in PLACES]


def _front(geometry: Geometry) -> float:
    """Distance of the first body or solid in the water from the paddle, m."""
    return min(float(shape.bounds()[0][0]) for shape in geometry.shapes.values())


def _group_velocity(geometry: Geometry, T: float, g: float) -> float:
    """Group velocity of waves of the period T (s), m/s."""
    return float(theory.group_velocity(2.0 * math.pi / T, geometry.depth, g))
