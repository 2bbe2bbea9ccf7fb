"""Cases: a validated description in SI units, and `build`, which turns it into a model and a state.

Everything that fixes an array's shape is spent here, on the host. Lengths are snapped to the lattice of
spacing dx, and `Case.notices` says what became of each.
"""

from __future__ import annotations

import difflib
import importlib.resources
import json
import math
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from jaxsph import (
    bodies,
    boundaries,
    devices,
    isph,
    kernels,
    neighbours,
    probes,
    schemes,
    shapes,
    waves,
    wcsph,
)
from jaxsph.errors import CaseError
from jaxsph.pairs import Smoothing
from jaxsph.state import (
    AbstractBody,
    AbstractForce,
    AbstractPTO,
    BodyState,
    Model,
    Particles,
    Search,
    State,
    Status,
    Work,
)

__all__ = ["Case", "Geometry", "assemble", "build", "built_in_cases", "check", "load_case", "make_probes"]

SKIN = 0.2
"""Skin of the neighbour tables over dx. What it saves in searches it costs in every pair sum: a step of the
OWC takes as long with 0.3 (`python -m experiments.bench_step`)."""
LONG_STEP_SKIN = 0.5
"""The same for steps in which a particle goes as far as a fifth of a spacing."""


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Fluid(_Section):
    """The water."""

    rho0: float = Field(1000.0, gt=0)
    """Density at zero gauge pressure, kg/m3."""
    nu: float = Field(1.0e-6, ge=0)
    """Kinematic viscosity of Eq. 6, m2/s; used where `scheme.alpha` is not given."""
    c0: float | None = Field(None, gt=0)
    """Numerical speed of sound, m/s; by default from Eq. 2."""


class SchemeSection(_Section):
    """Delta-SPH and its closures."""

    kernel: Literal["gaussian", "wendland"] = "gaussian"
    h_over_dx: float = Field(1.2, ge=0.9, le=2.5)
    delta: float = Field(0.1, ge=0, le=1)
    alpha: float | None = Field(None, ge=0, le=1)
    """Artificial viscosity of Eq. 4 in the place of nu."""
    integrator: Literal["symplectic", "predictor_corrector"] = "symplectic"
    cfl: float | None = Field(None, gt=0, le=1.5)
    """Share of h/c0 for the time step; by default the integrator's own."""


class ISPHSection(_Section):
    """Incompressible SPH in the place of `scheme` (Yeylaghi et al. 2016)."""

    h_over_dx: float | None = Field(None, ge=1.2, le=2.5)
    """Of Wendland's kernel, which reaches 2 h; by default 2 in two and 1.5 in three dimensions."""
    cfl: float = Field(0.25, gt=0, le=0.5)
    """Share of h over the largest speed to expect for the time step."""
    speed: float | None = Field(None, gt=0)
    """Largest speed to expect, m/s; by default from the waves, the water's depth and the body."""
    solver: Literal["bicgstab", "explicit"] = "bicgstab"
    tolerance: float = Field(3.0e-3, ge=1e-12, le=0.1)
    """Of the residual of the Poisson equation, over its right-hand side."""
    relaxation: float = Field(isph.RELAXATION, ge=0, le=4)
    """Rate at which crowding of particles is taken back, over sqrt(g/h)."""
    shifting: float | None = Field(None, gt=0, le=20)
    """Strength of particle shifting."""
    surface: Literal["empty_neighbours", "particles"] = "empty_neighbours"
    """Where the pressure is zero: beyond the surface, or at its particles (Eq. 23-24)."""


class Tank(_Section):
    """The basin; z = 0 is the bed, x = 0 the paddle at rest (or the end wall)."""

    length: float = Field(gt=0)
    depth: float = Field(gt=0)
    width: float | None = Field(None, gt=0)
    """Given, the case is three-dimensional."""
    height: float | None = Field(None, gt=0)
    """Top of the walls, m; by default enough for waves and a body, and four depths for a released column."""
    column: float | None = Field(None, gt=0)
    """Length of the water at the left end, m, released at t = 0 into the dry rest (a dam break)."""
    layer: float | None = Field(None, gt=0)
    """Depth of the water that the rest of the bed is wet with, m; with `column`."""
    slip: Literal["free_slip", "no_slip"] = "free_slip"
    walls: Literal["mirror", "dummy"] | None = None
    """Where walls take their pressure from: their mirror image (by default), or the water around them (with a
    body)."""


class WavesSection(_Section):
    """Regular waves from a piston at x = 0."""

    H: float = Field(gt=0)
    T: float = Field(gt=0)
    ramp_periods: float = Field(2.0, ge=0)
    second_order: bool = True
    absorption: bool = True


class SpongeSection(_Section):
    """Damping zone at the end of the tank (Eq. 27-28)."""

    length: float = Field(gt=0)
    strength: float = Field(10.0, gt=0)


class Device(_Section):
    """An onshore OWC: a plate that pierces the surface in front of the end wall."""

    chamber_length: float = Field(gt=0)
    wall_thickness: float = Field(gt=0)
    draught: float = Field(gt=0)
    """Depth of the plate's tip below still water, m."""
    thin_wall: Literal["regional", "multi_node"] = "regional"
    division: Literal["a", "b", "c"] = "b"
    """Regions around the plate (section 2.4.1.2)."""
    platform_length: float | None = Field(None, gt=0)
    """Length of a raised bed under the OWC, from the end wall, m; given with its height, or neither."""
    platform_height: float | None = Field(None, ge=0)
    """Height of that bed, m; 0 leaves the bed flat."""

    @model_validator(mode="after")
    def _whole_platform(self) -> Device:
        if (self.platform_length is None) != (self.platform_height is None):
            raise ValueError("give both device.platform_length and device.platform_height, or neither")
        return self


class PTOSection(_Section):
    """What the chamber's air does: a quadratic damping or a prescribed pressure."""

    K_dm: float | None = Field(None, ge=0, le=1.0e6)
    """Damping coefficient, kg^0.5 m^-2.5; 1e6 is a closed chamber for every purpose."""
    phase: list[float] | None = Field(None, min_length=2)
    """Cosine and sine of every harmonic of ln(K_dm(t)/K_dm) over the waves' phase, [a1, b1, a2, b2]."""
    P_a: float | None = None
    """Prescribed gauge pressure, Pa."""
    ramp: float = Field(0.0, ge=0)

    @model_validator(mode="after")
    def _one_law(self) -> PTOSection:
        if (self.K_dm is None) == (self.P_a is None):
            raise ValueError("give exactly one of pto.K_dm (a damping) and pto.P_a (a pressure)")
        if self.phase is not None and (self.K_dm is None or len(self.phase) % 2):
            raise ValueError(
                f"pto.phase = {self.phase}: needs pto.K_dm, and a cosine and a sine for every harmonic"
            )
        return self


class BlockSection(_Section):
    """A box with faces across the axes, at rest."""

    low: tuple[float, ...]
    high: tuple[float, ...]

    @model_validator(mode="after")
    def _extent(self) -> BlockSection:
        if len(self.low) != len(self.high) or not all(
            a < b for a, b in zip(self.low, self.high, strict=True)
        ):
            raise ValueError(f"low = {self.low} must be below high = {self.high} along every axis")
        return self


class DiscSection(_Section):
    """A circular cylinder across a two-dimensional tank, at rest."""

    centre: tuple[float, float]
    radius: float = Field(gt=0)


class RotationalPTOSection(_Section):
    """Moment against the pitch; per metre in two dimensions."""

    damping: float = Field(0.0, ge=0)
    """N m s/rad."""
    coulomb: float = Field(0.0, ge=0)
    """N m."""
    spring: float = Field(0.0, ge=0)
    """N m/rad, about the upright."""
    stop: float = Field(math.pi, gt=0)
    """Angle to either side at which end stops begin, rad."""
    stop_stiffness: float = Field(0.0, ge=0)
    """N m/rad."""


class BodySection(_Section):
    """A rigid body; give one of block, polygon and disc."""

    block: BlockSection | None = None
    polygon: tuple[tuple[float, float], ...] | None = Field(None, min_length=3)
    """Corners (x, z), m."""
    disc: DiscSection | None = None
    free: tuple[Literal["surge", "heave", "pitch"], ...] = ()
    """Motions that the water drives; the others go on at their `velocity`."""
    mass: float | None = Field(None, gt=0)
    """kg (kg/m in 2-D)."""
    inertia: float | None = Field(None, gt=0)
    """About the pivot, kg m2 (kg m in 2-D)."""
    density: float | None = Field(None, gt=0)
    """kg/m3: gives mass and inertia in the place of both."""
    pivot: tuple[float, float] | None = None
    """(x, z) of the hinge, m; by default the centre of mass."""
    centre: tuple[float, float] | None = None
    """(x, z) of the centre of mass, m; by default that of the shape."""
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Surge (m/s), heave (m/s) and pitch (rad/s) at the start."""
    angle: float = Field(0.0, ge=-1.6, le=1.6)
    """Pitch at the start, rad."""
    release: float = Field(0.0, ge=0)
    """Time up to which it is held at rest, s: so long the water settles around it."""
    pto: RotationalPTOSection | None = None
    sensors: tuple[tuple[float, ...], ...] = ()
    """Points of pressure sensors on it, in its place at rest, m."""

    @model_validator(mode="after")
    def _whole(self) -> BodySection:
        if sum(one is not None for one in (self.block, self.polygon, self.disc)) != 1:
            raise ValueError("give exactly one of body.block, body.polygon and body.disc")
        if self.free and (self.density is None) == (self.mass is None):
            raise ValueError(
                "a body that is free needs body.density, or body.mass (and for pitch body.inertia)"
            )
        if "pitch" in self.free and self.density is None and self.inertia is None:
            raise ValueError("body.free has pitch: give body.inertia or body.density")
        if self.release and (not self.free or any(self.velocity)):
            raise ValueError("body.release lets go of a body that is free and at rest until then")
        if self.pto is not None and "pitch" not in self.free:
            raise ValueError("body.pto works on the pitch: add it to body.free")
        return self


class StandingWave(_Section):
    """Initial velocities of a standing wave that passes through the flat surface at t = 0."""

    amplitude: float = Field(gt=0)
    mode: int = Field(1, ge=1)


class ProbesSection(_Section):
    """Where to measure."""

    gauges: tuple[float, ...] = ()
    """x of the wave gauges, m: elevations averaged across the tank."""
    surface: tuple[tuple[float, ...], ...] = ()
    """Points, (x,) or (x, y), m, where the elevation is measured by both methods of Yeylaghi et al. 2016:
    interpolated density, and the surface's particles."""
    pressure: tuple[tuple[float, ...], ...] = ()
    """Points of the pressure sensors, m."""
    velocity: tuple[tuple[float, ...], ...] = ()
    """Points where the water's velocity is measured, m."""


class Output(_Section):
    """How often to record."""

    sample_dt: float = Field(0.01, gt=0)
    snapshot_dt: float = Field(0.2, gt=0)
    periods: int = Field(10, ge=1)
    """Whole periods at the end over which power and efficiency are averaged."""


class Case(_Section):
    """A whole case, in SI units. Immutable: `replace` gives a changed copy."""

    name: str = "case"
    description: str = ""
    dx: float = Field(gt=0)
    t1: float = Field(gt=0)
    g: float = Field(9.81, ge=0)
    precision: Literal["float32", "float64"] = "float32"
    fluid: Fluid = Fluid()
    scheme: SchemeSection = SchemeSection()
    tank: Tank
    waves: WavesSection | None = None
    sponge: SpongeSection | None = None
    device: Device | None = None
    pto: PTOSection | None = None
    start: StandingWave | None = None
    isph: ISPHSection | None = None
    body: BodySection | None = None
    probes: ProbesSection = ProbesSection()
    output: Output = Output()

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Case:
        """Validates a mapping. **Raises** CaseError that names field, value and what is allowed."""
        _known_keys(data, cls)
        try:
            case = cls.model_validate(data)
        except ValidationError as error:
            raise CaseError(_readable(error)) from None
        if case.pto is not None and case.pto.phase is not None and case.waves is None:
            raise CaseError(f"pto.phase = {case.pto.phase}: is over the phase of waves, and there are none")
        Geometry.of(case)  # refuses what does not fit the lattice
        return case

    def replace(self, changes: dict[str, Any]) -> Case:
        """A copy with fields changed, by dotted name: `case.replace({"pto.K_dm": 300.0})`."""
        data = self.model_dump(exclude_none=True, mode="json")
        for key, value in changes.items():
            *path, last = key.split(".")
            place = data
            for part in path:
                place = place.setdefault(part, {})
                if not isinstance(place, dict):
                    raise CaseError(f"{key}: {part} is a value, not a section")
            if value is None:
                place.pop(last, None)
            elif key == "pto.K_dm":
                place.pop("P_a", None)
                place[last] = value
            elif key == "pto.P_a":
                place.pop("K_dm", None)
                place.pop("phase", None)
                place[last] = value
            else:
                place[last] = value
        return Case.from_dict(data)

    def to_toml(self) -> str:
        """The whole case as TOML text, defaults included."""
        return _to_toml(self.model_dump(exclude_none=True, mode="json"))

    def notices(self) -> list[str]:
        """What was adjusted to the lattice, and limits of theory that the case oversteps."""
        notes = list(Geometry.of(self).notices)
        if self.waves is not None:
            notes += waves.theory_limits(self.waves.H, self.waves.T, self.tank.depth, self.g)
        if self.waves is not None and self.waves.H < 3 * self.dx:
            notes.append(
                f"waves.H = {self.waves.H:g} m is only {self.waves.H / self.dx:.1f} spacings high; "
                "expect visible decay along the tank (five or more are usual)"
            )
        return notes


def _known_keys(data: dict[str, Any], section: type[BaseModel], prefix: str = "") -> None:
    for key, value in data.items():
        fields = section.model_fields
        if key not in fields:
            everything = _all_keys(Case)
            near = [k for k in everything if k.lower() == (prefix + key).lower()]
            near = near or difflib.get_close_matches(prefix + key, everything, n=1, cutoff=0.5)
            near = near or [k for k in everything if k.rsplit(".", 1)[-1] == key]
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise CaseError(f"unknown key {prefix + key!r}{hint} (keys here: {', '.join(sorted(fields))})")
        inner = _section_type(fields[key].annotation)
        if inner is not None and isinstance(value, dict):
            _known_keys(value, inner, f"{prefix}{key}.")


def _section_type(annotation: Any) -> type[BaseModel] | None:
    for option in getattr(annotation, "__args__", (annotation,)):
        if isinstance(option, type) and issubclass(option, BaseModel):
            return option
    return None


def _all_keys(section: type[BaseModel], prefix: str = "") -> list[str]:
    keys = []
    for name, field in section.model_fields.items():
        inner = _section_type(field.annotation)
        keys.append(prefix + name)
        if inner is not None:
            keys += _all_keys(inner, f"{prefix}{name}.")
    return keys


def _readable(error: ValidationError) -> str:
    lines = []
    for item in error.errors():
        field = ".".join(str(part) for part in item["loc"]) or "case"
        value = (
            "" if item["type"] == "missing" or isinstance(item["input"], dict) else (f" = {item['input']!r}")
        )
        lines.append(f"{field}{value}: {item['msg']}")
    return "\n".join(lines)


def _to_toml(data: dict[str, Any], prefix: str = "") -> str:
    own = [f"{k} = {_toml_value(v)}" for k, v in data.items() if not isinstance(v, dict)]
    text = "\n".join(own) + "\n" if own else ""
    for key, value in data.items():
        if isinstance(value, dict):
            text += f"\n[{prefix}{key}]\n" + _to_toml(value, f"{prefix}{key}.")
    return text


def _toml_value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_toml_value(v) for v in value) + "]"
    return repr(value)


# --------------------------------------------------------------------------- files and built-ins


def built_in_cases() -> dict[str, str]:
    """Name and description of every built-in case."""
    found = {}
    for entry in sorted(
        importlib.resources.files("jaxsph").joinpath("cases").iterdir(), key=lambda e: e.name
    ):
        if entry.name.endswith(".toml"):
            found[entry.name[:-5]] = tomllib.loads(entry.read_text())["description"]
    return found


def load_case(name: str | Path) -> Case:
    """The case of a TOML file, or a built-in one by its name.

    **Raises** CaseError where there is no such case, or it is not valid.
    """
    path = Path(name)
    if path.suffix == ".toml":
        if not path.is_file():
            raise CaseError(f"no case file {str(path)!r}")
        text, default = path.read_text(), path.stem
    else:
        names = built_in_cases()
        if str(name) not in names:
            near = difflib.get_close_matches(str(name), names, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise CaseError(
                f"no built-in case {str(name)!r}{hint} (there are {', '.join(names)}; "
                "a file's name ends in .toml)"
            )
        resource = importlib.resources.files("jaxsph").joinpath("cases", f"{name}.toml")
        text, default = resource.read_text(), str(name)
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise CaseError(f"{path}: not a TOML file: {error}") from None
    return Case.from_dict({"name": default} | data)


# --------------------------------------------------------------------------- geometry


class Geometry:
    """The case's lengths on the lattice, and what became of each."""

    def __init__(self, dx: float) -> None:
        """An empty record for spacing dx (m)."""
        self.dx = dx
        self.notices: list[str] = []
        self.length = self.depth = self.height = 0.0
        self.width: float | None = None
        self.column = 0.0
        """Length that the water fills at the start, m."""
        self.layer = 0.0
        """Depth of water on the rest of the bed, m."""
        self.plate: boundaries.WallPlate | None = None
        self.platform: boundaries.Platform | None = None
        self.chamber_length = 0.0
        self.solid: shapes.AbstractShape | None = None

    def snap(self, name: str, value: float, least: int = 1, slack: float = 0.34) -> float:
        """`value` as a whole number of spacings; refused where that changes it by more than `slack`."""
        count = max(int(np.floor(value / self.dx + 0.5 + 1e-9)), least)
        snapped = count * self.dx
        if abs(snapped - value) > slack * value:
            raise CaseError(
                f"{name} = {value:g} m does not fit dx = {self.dx:g} m: the lattice would make it "
                f"{snapped:g} m; use dx of at most {value / least:.4g} m that divides it"
            )
        if abs(snapped - value) > 1e-6 * value:
            self.notices.append(
                f"{name} = {value:g} m is not a whole number of spacings of {self.dx:g} m: "
                f"it becomes {snapped:.6g} m"
            )
        return float(np.round(snapped, 12))

    @classmethod
    def of(cls, case: Case) -> Geometry:
        """Snaps every length of the case. **Raises** CaseError for what does not fit."""
        geometry = cls(case.dx)
        tank = case.tank
        geometry.depth = geometry.snap("tank.depth", tank.depth, least=4, slack=0.1)
        geometry.length = geometry.snap("tank.length", tank.length, least=4, slack=0.1)
        geometry.width = None
        if tank.width is not None:
            geometry.width = geometry.snap("tank.width", tank.width, least=4, slack=0.1)
        geometry._column(case)
        over = 0.1 + (3.0 * case.waves.H if case.waves is not None else 0.1 * tank.depth)
        if tank.column is not None:
            over = 3.0 * tank.depth  # the jet at the far wall: twice the depth where all energy is kept
        height = tank.height if tank.height is not None else tank.depth + max(over, 8 * case.dx)
        if height <= tank.depth:
            raise CaseError(
                f"tank.height = {height:g} m: must be above the water, tank.depth = {tank.depth:g} m"
            )
        geometry.height = float(np.ceil(height / case.dx - 1e-9) * case.dx)
        geometry._device(case)
        geometry._body(case)
        geometry._fits(case)
        return geometry

    def _body(self, case: Case) -> None:
        if case.isph is not None:
            if case.scheme != SchemeSection():
                raise CaseError("isph takes the place of scheme: remove one of the sections")
            if case.device is not None:
                raise CaseError("device: an OWC needs the scheme of the section scheme: remove isph")
        if case.body is None:
            return
        if case.device is not None:
            raise CaseError("body: a tank holds a body or a device with a chamber: remove one")
        if case.tank.walls == "mirror":
            raise CaseError('tank.walls = "mirror": a body needs "dummy" walls')
        self.solid = solid = _shape(case.body)
        points = solid.dummies(self.dx, _layers(case))
        dim = 2 if self.width is None else 3
        if points.shape[1] != dim:
            raise CaseError(f"body: its shape has {points.shape[1]} dimensions, and the tank {dim}")
        for index, point in enumerate(case.body.sensors):
            if len(point) != dim:
                raise CaseError(f"body.sensors[{index}] = {list(point)}: must have {dim} coordinates")
        if case.tank.height is None:
            top = float(points[:, -1].max()) + 4 * self.dx
            self.height = max(self.height, float(np.ceil(top / self.dx - 1e-9) * self.dx))
        upper = [self.length, self.height] if dim == 2 else [self.length, self.width, self.height]
        out = ((points < 0) | (points > upper)).any(axis=1)
        if out.any():
            at = ", ".join(f"{a:.4g}" for a in points[out][0])
            raise CaseError(f"body: reaches out of the tank (0 to {upper} m) at ({at})")

    def _column(self, case: Case) -> None:
        """The released column's length; the whole tank's where there is none."""
        self.column = self.length
        if case.tank.column is None:
            if case.tank.layer is not None:
                raise CaseError("tank.layer wets the bed beside a released column: give tank.column too")
            return
        asked = f"tank.column = {case.tank.column:g} m"
        if case.tank.column > self.length:
            raise CaseError(f"{asked}: must be at most tank.length = {self.length:g} m")
        for name in ("waves", "device", "start"):
            if getattr(case, name) is not None:
                raise CaseError(f"{asked} leaves the tank's end dry, and {name} needs it full: remove one")
        self.column = min(self.snap("tank.column", case.tank.column, least=4, slack=0.1), self.length)
        if case.tank.layer is not None:
            self.layer = self.snap("tank.layer", case.tank.layer, slack=1.0)

    def _device(self, case: Case) -> None:
        device = case.device
        if device is None:
            if case.pto is not None:
                raise CaseError("pto is given, but there is no device with a chamber")
            return
        if self.width is not None:
            raise CaseError("tank.width: a device needs a two-dimensional tank (no width)")
        self.chamber_length = device.chamber_length
        if device.chamber_length < 3.0 * self.dx:
            raise CaseError(
                f"device.chamber_length = {device.chamber_length:g} m holds "
                f"{device.chamber_length / self.dx:.1f} spacings of dx = {self.dx:g} m; three are the least: "
                f"use dx of at most {device.chamber_length / 3:.4g} m"
            )
        draught = self.snap("device.draught", device.draught, 2)
        if draught > self.depth - 2 * self.dx:
            raise CaseError(
                f"device.draught = {device.draught:g} m: the plate must leave at least two spacings "
                f"of water below it, so at most {self.depth - 2 * self.dx:g} m here"
            )
        wall = _thin_wall(device)
        thickness = device.wall_thickness
        try:
            wall.check(boundaries.WallPlate(0.0, thickness, 0.0), self.dx, _layers(case))
        except ValueError as error:
            raise CaseError(f"device.{error}") from None
        x1 = float(np.round(self.length - self.chamber_length, 12))
        x0 = float(np.round(x1 - thickness, 12))
        self.plate = boundaries.WallPlate(x0, x1, self.depth - draught)
        if self.plate.x0 < 4 * self.dx:
            raise CaseError(f"tank.length = {case.tank.length:g} m leaves no water in front of the device")
        if device.platform_height:
            self._platform(device, device.platform_length, device.platform_height)

    def _platform(self, device: Device, length: float, height: float) -> None:
        length = self.snap("device.platform_length", length, least=4, slack=0.1)
        height = self.snap("device.platform_height", height, least=1, slack=0.1)
        if height > self.plate.tip - 2 * self.dx:
            raise CaseError(
                f"device.platform_height = {device.platform_height:g} m: must leave at least two spacings of "
                f"water under the plate, so at most {self.plate.tip - 2 * self.dx:g} m here"
            )
        if length > self.length - 4 * self.dx:
            raise CaseError(
                f"device.platform_length = {device.platform_length:g} m: must leave water in front of it, so "
                f"at most {self.length - 4 * self.dx:g} m here"
            )
        self.platform = boundaries.Platform(float(np.round(self.length - length, 12)), height)

    def _fits(self, case: Case) -> None:
        for index, x in enumerate(case.probes.gauges):
            if not 0 <= x <= self.length:
                raise CaseError(
                    f"probes.gauges[{index}] = {x:g} m is outside the tank (0 to {self.length:g} m)"
                )
        upper = [self.length, *([] if self.width is None else [self.width]), self.height]
        for name, most in (("surface", upper[:-1]), ("pressure", upper), ("velocity", upper)):
            for index, point in enumerate(getattr(case.probes, name)):
                inside = len(point) == len(most) and all(
                    0 <= a <= b for a, b in zip(point, most, strict=True)
                )
                if not inside:
                    raise CaseError(
                        f"probes.{name}[{index}] = {list(point)} is not a point of the tank "
                        f"({len(most)} coordinates between 0 and {most})"
                    )
        if case.sponge is not None and case.sponge.length >= self.length:
            raise CaseError(
                f"sponge.length = {case.sponge.length:g} m: must be shorter than the tank ({self.length:g} m)"
            )
        if case.start is not None and case.waves is not None:
            raise CaseError("start and waves exclude each other: remove one of the sections")


def _thin_wall(device: Device) -> boundaries.AbstractThinWall:
    division = {
        "a": boundaries.DiagonalDivision,
        "b": boundaries.HorizontalDivision,
        "c": boundaries.FivePartDivision,
    }[device.division]()
    return {
        "regional": boundaries.RegionalGhosts,
        "multi_node": boundaries.MultiNodeGhosts,
    }[device.thin_wall](division)


def _shape(body: BodySection) -> shapes.AbstractShape:
    if body.block is not None:
        return shapes.Block(body.block.low, body.block.high)
    if body.polygon is not None:
        return shapes.Polygon(body.polygon)
    return shapes.Disc(body.disc.centre, body.disc.radius)


def _kernel(case: Case) -> kernels.AbstractKernel:
    return {"gaussian": kernels.Gaussian, "wendland": kernels.WendlandC2}[case.scheme.kernel]()


def _smoothing_length(case: Case) -> float:
    """h, m. For Wendland's kernel h is half the support; the support is the same 3 h_over_dx dx."""
    if case.isph is not None:
        return _isph_ratio(case) * case.dx
    h = case.scheme.h_over_dx * case.dx
    return h if case.scheme.kernel == "gaussian" else 1.5 * h


def _isph_ratio(case: Case) -> float:
    """h over dx of the incompressible scheme."""
    return case.isph.h_over_dx or isph.H_OVER_DX[2 if case.tank.width is None else 3]


def _layers(case: Case) -> int:
    reach = 3.0 * case.scheme.h_over_dx if case.isph is None else 2.0 * _isph_ratio(case)
    return int(np.ceil(reach - 0.5))


# --------------------------------------------------------------------------- build


def sound_speed(case: Case) -> float:
    """Eq. 2: ten times the larger of the wave's and the dam-break speed scale, m/s."""
    if case.fluid.c0 is not None:
        return case.fluid.c0
    return 10.0 * max(_speed_scale(case), float(np.sqrt(case.g * case.tank.depth)), 1e-3)


def _speed_scale(case: Case) -> float:
    """Largest speed to expect, m/s."""
    shallow = float(np.sqrt(case.g * case.tank.depth))
    if case.tank.column is not None:
        return 2.0 * shallow  # the tip of a dam break in shallow water (Ritter 1892)
    if case.body is not None and any(case.body.velocity[:2]):
        # the jet of a wedge of 30 degrees: twice its spray root's speed, pi/2 V/tan(30 degrees)
        return 6.0 * float(np.hypot(*case.body.velocity[:2]))
    if case.start is not None:
        return 0.1 * shallow
    if case.waves is None:
        pressure = abs(case.pto.P_a) if case.pto is not None and case.pto.P_a else 0.0
        # a level suddenly pushed down by P_a/(rho g) swings with at most g A / omega ~ sqrt(P/rho)
        return 0.05 * shallow + 0.5 * float(np.sqrt(2.0 * pressure / case.fluid.rho0))
    omega = 2 * np.pi / case.waves.T
    k = float(waves.wavenumber(omega, case.tank.depth, case.g))
    surface = 0.5 * case.waves.H * omega / np.tanh(k * case.tank.depth)
    return float(surface * (2.5 if case.device is not None else 1.5))


def _initial_velocity(case: Case, geometry: Geometry, x: np.ndarray) -> np.ndarray:
    u = np.zeros_like(x)
    if case.start is None:
        return u
    k = case.start.mode * np.pi / geometry.length
    omega = np.sqrt(case.g * k * np.tanh(k * geometry.depth))
    scale = case.start.amplitude * omega / np.sinh(k * geometry.depth)
    u[:, 0] = -scale * np.sin(k * x[:, 0]) * np.cosh(k * x[:, -1])
    u[:, -1] = scale * np.cos(k * x[:, 0]) * np.sinh(k * x[:, -1])
    return u


def _water(geometry: Geometry, dx: float) -> tuple[np.ndarray, np.ndarray]:
    """Places (m) and volumes (m3, m2 in 2-D) of the particles at the start."""
    across = () if geometry.width is None else (geometry.width,)
    low = (0.0,) * (2 + len(across))
    x, volume = boundaries.lattice(
        low, (geometry.column, *across, geometry.depth), dx, geometry.plate, geometry.platform
    )
    if not geometry.layer:
        return x, volume
    rest, more = boundaries.lattice(
        (geometry.column, *low[1:]), (geometry.length, *across, geometry.layer), dx
    )
    return np.concatenate([x, rest]), np.concatenate([volume, more])


def _outside(away: np.ndarray) -> np.ndarray:
    """Which particles are not in the place of a body, by their distances from its surface over dx.

    The lattice need not fit the body. As much water gives way as the body has volume in it, counted by the
    share of every cell that it covers: with a threshold on the distance the surface would fall, or rise, for
    a lattice cut raggedly. Particles at one distance, as those of two symmetric faces, go together.
    """
    away = np.round(away, 4)
    levels, count = np.unique(away, return_counts=True)
    taken = np.concatenate([[0], np.cumsum(count)])
    cut = int(np.argmin(np.abs(taken - np.sum(np.clip(0.5 - away, 0.0, 1.0)))))
    most = levels[cut - 1] if cut else -np.inf
    return away > min(max(most, -0.3), 0.45)


def _initial_head(geometry: Geometry, x: np.ndarray) -> np.ndarray:
    """Pressure at t = 0 over rho0 g, m: hydrostatic, or that of a column in the instant of its release.

    Taking the gate away makes p = 0 on the released face at once: in incompressible water the pressure is
    from then on the solution of lap p = 0 with p = 0 there and at the surface, dp/dx = 0 at the back wall
    and dp/dz = -rho0 g on the bed. Weakly compressible water that started from the hydrostatic pressure
    would get there by sound waves from the face, and ring: in a column of 15 x 30 the pressure then swung by
    rho0 g H until it had run out.
    With k_n = (n + 1/2) pi/H and L the column's length,
        p/(rho0 g) = H - z - sum_n 2/(H k_n^2) cos(k_n z) cosh(k_n x)/cosh(k_n L).
    """
    H, L, z = geometry.depth, geometry.column, x[:, -1]
    if L >= geometry.length:
        return H - z
    # the nearest column of particles is half a spacing from the face: what is left out is below exp(-10 pi)
    k = (np.arange(int(20 * H / geometry.dx)) + 0.5) * np.pi / H
    xs, column = np.unique(x[:, 0], return_inverse=True)
    zs, row = np.unique(z, return_inverse=True)
    a = (
        np.exp(-np.outer(np.maximum(L - xs, 0.0), k))
        * (1 + np.exp(-2 * np.outer(xs, k)))
        / (1 + np.exp(-2 * k * L))
    )
    released = (2 / (H * k**2) * a) @ np.cos(np.outer(k, zs))
    head = H - z - released[column, row]
    return np.where(x[:, 0] < L, head, np.maximum(geometry.layer - z, 0.0))


def _scheme(
    case: Case, geometry: Geometry, dim: int, leaf: Any
) -> tuple[schemes.AbstractParticleScheme, float]:
    """The scheme, and the largest time step that it allows, s."""
    dtype = np.dtype(case.precision)
    if case.isph is not None:
        section = case.isph
        speed = section.speed or max(_speed_scale(case), float(np.sqrt(case.g * case.tank.depth)), 1e-3)
        if section.speed is None and case.tank.column is not None:
            speed = 1.5 * speed  # of the jet where the tip meets a wall
        solver = {"bicgstab": isph.BiCGStab(section.tolerance), "explicit": isph.Explicit()}
        surface = {
            "empty_neighbours": isph.EmptyNeighbours(),
            "particles": isph.SurfaceParticles(),
        }
        found = isph.ISPH.of(
            case.dx,
            speed,
            dim=dim,
            rho0=case.fluid.rho0,
            viscosity=schemes.PhysicalViscosity(case.fluid.nu),
            h_over_dx=section.h_over_dx,
            solver=solver[section.solver],
            surface=surface[section.surface],
            relaxation=section.relaxation,
            shifting=None if section.shifting is None else schemes.Shifting(section.shifting),
            dtype=dtype,
        )
        return found, isph.stable_dt(found, case.g, section.cfl, dim)
    h, c0 = _smoothing_length(case), sound_speed(case)
    integrator = {
        "symplectic": wcsph.SymplecticEuler,
        "predictor_corrector": wcsph.PredictorCorrector,
    }[case.scheme.integrator]()
    scheme = wcsph.DeltaSPH.of(
        case.dx,
        c0,
        rho0=case.fluid.rho0,
        delta=case.scheme.delta,
        viscosity=schemes.PhysicalViscosity(case.fluid.nu)
        if case.scheme.alpha is None
        else schemes.ArtificialViscosity(case.scheme.alpha),
        kernel=_kernel(case),
        h_over_dx=case.scheme.h_over_dx,
        integrator=integrator,
        dtype=dtype,
        background=_background(case, geometry, leaf),
    )
    cfl = case.scheme.cfl if case.scheme.cfl is not None else integrator.cfl
    # Eq. 10 speaks of the Gaussian's h: the step is set by the spacing, whatever the kernel's own h
    return scheme, wcsph.stable_dt(scheme, case.g, cfl * case.scheme.h_over_dx * case.dx / h, dim)


def _body(case: Case, geometry: Geometry, leaf: Any) -> tuple[bodies.RigidBody | None, BodyState | None]:
    section, solid = case.body, geometry.solid
    if section is None:
        return None, None
    area, centroid, second = solid.moments()
    mass = section.mass if section.density is None else section.density * area
    centre = np.asarray(centroid if section.centre is None else section.centre)
    pivot = centre if section.pivot is None else np.asarray(section.pivot)
    inertia = section.inertia
    if section.density is not None:
        inertia = section.density * second + mass * float(np.sum((centre - pivot) ** 2))
    pto = None
    if section.pto is not None:
        pto = bodies.RotationalPTO.of(**section.pto.model_dump(), dtype=np.dtype(case.precision))
    try:
        body = bodies.RigidBody(
            free=tuple(name in section.free for name in ("surge", "heave", "pitch")),
            shape=solid,
            mass=leaf(mass or 1.0),  # what nothing moves needs no mass
            inertia=leaf(inertia or 1.0),
            pivot=leaf(pivot),
            centre=leaf(centre),
            release=leaf(section.release),
            pto=pto,
        )
    except ValueError as error:
        raise CaseError(f"body.{error}") from None
    start = BodyState.at_rest(np.dtype(case.precision), section.velocity, (0.0, 0.0, section.angle))
    return body, start


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
    stroke = 0.0
    if case.waves is not None:
        k = float(waves.wavenumber(2 * np.pi / case.waves.T, case.tank.depth, case.g))
        stroke = case.waves.H / float(waves.biesel(k, case.tank.depth))
    high = [geometry.length, geometry.height]
    if dim == 3:
        high = [geometry.length, geometry.width, geometry.height]
    box = boundaries.Box((0.0,) * dim, tuple(high), case.waves is not None, 1.5 * stroke + 2 * dx)
    slip = boundaries.FreeSlip() if case.tank.slip == "free_slip" else boundaries.NoSlip()
    thin_wall = _thin_wall(case.device) if geometry.plate is not None else None
    dummies = case.tank.walls == "dummy" or case.body is not None
    walls = boundaries.Ghosts.build(
        box,
        dx,
        scheme.smoothing,
        slip,
        geometry.plate,
        thin_wall,
        dtype=dtype,
        platform=geometry.platform,
        filling=boundaries.DummyParticles() if dummies else boundaries.MirrorNodes(),
        solid=geometry.solid,
    )
    body, body_state = _body(case, geometry, leaf)
    x, volume = _water(geometry, dx)
    if body is not None:
        outside = _outside(np.asarray(body.distance(jnp.asarray(x, dtype), body_state)) / dx)
        x, volume = x[outside], volume[outside]
    g = np.zeros(dim)
    g[-1] = -case.g
    wavemaker = _wavemaker(case, geometry, leaf, _smoothing_length(case))
    sponge = None
    if case.sponge is not None:
        end = geometry.length
        sponge = waves.Sponge(leaf(end - case.sponge.length), leaf(end + dx), leaf(case.sponge.strength))
    model, state = assemble(
        x,
        _initial_velocity(case, geometry, x),
        scheme=scheme,
        walls=walls,
        dx=dx,
        sample_dt=case.output.sample_dt,
        p=case.fluid.rho0 * case.g * _initial_head(geometry, x),
        volume=volume,
        g=g,
        wavemaker=wavemaker,
        sponge=sponge,
        chamber=_chamber(case, geometry, leaf),
        body=body,
        body_state=body_state,
        speed=_speed_scale(case),
        dt_most=dt_limit,
        skin=SKIN if case.isph is None else LONG_STEP_SKIN,
        depth=geometry.depth,
        stroke=stroke,
        settings=settings,
    )
    particles = state.particles
    if wavemaker is not None:
        V = scheme.volume(particles) / walls.width
        still = devices.column_depth(
            (particles.x[:, 0], particles.x[:, -1]), V, wavemaker.gauge, 3.0 * model.dx
        )
        model = eqx.tree_at(lambda a: a.wavemaker.still, model, still)
    return model, state


def assemble(
    x: np.ndarray,
    u: np.ndarray,
    *,
    scheme: schemes.AbstractParticleScheme,
    walls: boundaries.Ghosts,
    dx: float,
    sample_dt: float,
    p: np.ndarray | None = None,
    volume: np.ndarray | float | None = None,
    g: Sequence[float] | None = None,
    force: AbstractForce | None = None,
    wavemaker: devices.Wavemaker | None = None,
    sponge: waves.Sponge | None = None,
    chamber: devices.Chamber | None = None,
    body: AbstractBody | None = None,
    body_state: BodyState | None = None,
    speed: float | None = None,
    dt_most: float | None = None,
    skin: float = SKIN,
    depth: float | None = None,
    stroke: float = 0.0,
    settings: dict[str, int] | None = None,
) -> tuple[Model, State]:
    """Model and initial state from arrays: any fluid in any box, where `build` makes the tanks of cases.

    **Arguments**: `x` `[N, D]` (m) and `u` `[N, D]` (m/s); the numbers have the scheme's precision.
    `p` `[N]`, the gauge pressure (Pa), by default none. `volume` (m3; m2 in 2-D): each particle's, by
    default dx^D.
    `walls`: `boundaries.Ghosts.build` of a `boundaries.Box`, whose `period` the scheme's smoothing must have.
    `g` `[D]` (m/s2), by default none; `force`: a field beside it. `body`: a rigid body whose dummies are the
    walls' `solid`, in the state `body_state`, by default at rest.
    `sample_dt` (s): the time step divides it, and is at most `dt_most`, by default what is stable.
    `speed` (m/s): the largest to expect, from which follows how often neighbours are searched; by default
    that of `u`, or at rest three tenths of the largest that the scheme allows. `skin`, over dx, of the
    tables: a wider one costs pairs and saves searches, which pays where particles move far in a step.
    `depth` (m): for depth-averaged results, by default the box's height. `stroke` (m) of the wavemaker.
    `settings`: as for `build`.
    **Raises** ValueError for shapes that do not fit, another period than the walls', a
    period that dx does not divide or that is shorter than 2.5 search radii, and fluid outside the box.
    """
    dtype = np.dtype(scheme.smoothing.h.dtype)
    x, u = np.asarray(x, float), np.asarray(u, float)
    n, dim = _checked(x, u, p, scheme, walls, dx)

    def leaf(a: Any) -> jax.Array:
        return jnp.asarray(a, dtype)

    m = float(scheme.rho0) * np.broadcast_to(dx**dim if volume is None else volume, n)
    g = np.zeros(dim) if g is None else np.asarray(g, float)
    bounded = dt_most is None
    if dt_most is None:
        dt_most = scheme.stable_dt(float(np.linalg.norm(g)), dim)
    if speed is None:
        speed = float(np.sqrt(np.max(np.sum(u**2, axis=1)))) or 0.3 * float(scheme.fastest(dt_most))
    skin = skin * dx
    if bounded:
        # nor may a step take a particle out of what a table holds
        dt_most = min(dt_most, 0.4 * skin / speed)
    # A table is good while no particle has moved half a skin. A sample is a whole number of blocks of
    # an even number of steps, so that there are shorter ones for a table that goes stale.
    needed = sample_dt / dt_most
    most = max(2.0, 0.5 * skin / (speed * dt_most))
    blocks = int(np.ceil(needed / most))
    block = 2 * int(np.ceil(needed / blocks / 2))
    particles = Particles(
        x=leaf(x),
        x_carry=leaf(x - np.asarray(x, dtype)),
        u=leaf(u),
        rho=jnp.zeros(n, dtype),
        m=leaf(m),
        id=jnp.arange(n, dtype=jnp.int32),
    )
    particles = scheme.started(particles, leaf(np.zeros(n) if p is None else p))
    state = State(
        particles=particles,
        paddle=jnp.zeros(4, dtype),
        air=jnp.zeros(2, dtype),
        work=Work.zero(dtype),
        step=jnp.zeros((), jnp.int32),
        status=Status.sound(dim, dtype),
        body=BodyState.at_rest(dtype) if body is not None and body_state is None else body_state,
    )
    if (body is None) != (not walls.solid):
        raise ValueError("a body and walls with its dummies (`solid`) go together: give both or neither")
    model = Model(
        scheme=scheme,
        walls=walls,
        wavemaker=wavemaker,
        sponge=sponge,
        chamber=chamber,
        g=leaf(g),
        dx=leaf(dx),
        dt=leaf(sample_dt / (blocks * block)),
        t0=leaf(0.0),
        depth=leaf(walls.high[-1] - walls.low[-1] if depth is None else depth),
        z0=leaf(x[:, -1]),
        search=_search(walls, x, scheme.smoothing, skin, stroke, block, chamber, settings),
        force=force,
        body=body,
    )
    return model, state


def _checked(x, u, p, scheme, walls, dx) -> tuple[int, int]:
    """Number of particles and dimensions; ValueError where what is given does not fit together."""
    if x.ndim != 2 or x.shape[1] != len(walls.low) or u.shape != x.shape:
        raise ValueError(f"x and u must be [N, {len(walls.low)}], not {x.shape} and {u.shape}")
    if p is not None and np.shape(p) != x.shape[:1]:
        raise ValueError(f"p must be [{len(x)}], not {np.shape(p)}")
    if scheme.smoothing.period != walls.period:
        raise ValueError(
            f"the smoothing's period, {scheme.smoothing.period}, must be that of the box, {walls.period}"
        )
    for axis, length in enumerate(walls.period or ()):
        if length is not None and abs(length / dx - round(length / dx)) > 1e-6 * length / dx:
            raise ValueError(f"dx = {dx:g} m does not divide the period {length:g} m of axis {axis}")
    slack = 1e-6 * (np.asarray(walls.high) - np.asarray(walls.low))
    if (x < walls.low - slack).any() or (x > walls.high + slack).any():
        raise ValueError(f"particles are outside the box from {walls.low} to {walls.high} m")
    return x.shape


def _chamber(case: Case, geometry: Geometry, leaf: Any) -> devices.Chamber | None:
    if case.device is None or case.pto is None:
        return None
    pto: AbstractPTO
    if case.pto.K_dm is None:
        pto = devices.PrescribedPressure(leaf(case.pto.P_a), leaf(case.pto.ramp))
    elif case.pto.phase is None:
        pto = devices.PneumaticPTO(leaf(case.pto.K_dm))
    else:
        omega = 2.0 * np.pi / case.waves.T
        pto = devices.PhasedPTO(leaf(case.pto.K_dm), leaf(case.pto.phase), leaf(omega))
    plate = geometry.plate
    draught = geometry.depth - plate.tip
    return devices.Chamber(
        pto,
        leaf(plate.x1),
        leaf(geometry.length),
        leaf(plate.tip),
        leaf(plate.tip + 0.5 * draught),
        leaf(geometry.depth),
    )


def _background(case: Case, geometry: Geometry, leaf: Any) -> wcsph.Background | None:
    plate = geometry.plate
    if plate is None or not plate.is_thin(case.dx, _layers(case)):
        return None
    draught = geometry.depth - plate.tip
    # How far the surface may fall at the plate: standing waves, or an air pressure put on at once.
    fall = case.waves.H if case.waves is not None else 0.0
    if case.pto is not None and case.pto.P_a is not None:
        fall = max(fall, abs(case.pto.P_a) / (case.fluid.rho0 * case.g))
    # Measured at rest and in waves. R must end below the surface, where it would be a false pressure. With
    # much more head left in the sum the tip grows unquiet, with none nothing keeps the particles in order; a
    # narrower zone's own gradients disturb them, and over the whole tank the waves lost 40 % of their height.
    return wcsph.Background(
        x=leaf(plate.middle),
        inner=leaf(0.2 * draught),
        outer=leaf(2.0 * draught),
        tip=leaf(plate.tip),
        top=leaf(geometry.depth - 0.1 * draught),
        weight=leaf(case.fluid.rho0 * case.g),
        still=leaf(geometry.depth - min(max(0.3 * draught, fall), 0.5 * draught)),
    )


def _wavemaker(case: Case, geometry: Geometry, leaf: Any, h: float) -> devices.Wavemaker | None:
    section = case.waves
    if section is None:
        return None
    regular = waves.RegularWaves(
        leaf(section.H),
        leaf(section.T),
        leaf(geometry.depth),
        leaf(case.g),
        leaf(section.ramp_periods * section.T),
        waves.SecondOrderPiston() if section.second_order else None,
    )
    distance = 4.0 * h
    absorption = None
    if section.absorption:
        # Slow against the waves, quick against the drift: with 0.01 omega the paddle crept 0.04 m back
        # in ten periods, on the half millimetre by which the gauge's mean is off.
        rate = 0.04 * float(regular.omega)
        absorption = waves.ActiveAbsorption.at_gauge(regular, distance, drift_rate=rate)
        absorption = jax.tree.map(leaf, absorption)
    return devices.Wavemaker(regular, absorption, leaf(distance), leaf(0.0))


def _search(
    walls: boundaries.Ghosts,
    x: np.ndarray,
    smoothing: Smoothing,
    skin: float,
    stroke: float,
    block: int,
    chamber: devices.Chamber | None,
    settings: dict[str, int] | None,
) -> Search:
    radius = float(smoothing.radius) + skin
    everything = np.concatenate([np.asarray(walls.x), x])
    low, high = everything.min(axis=0), everything.max(axis=0)
    low[0] -= stroke
    high[0] += stroke
    for axis, side in enumerate(walls.sides):
        # what no wall holds may go anywhere in the box; cells along a period begin at its low end
        if side in ("open", "periodic"):
            low[axis], high[axis] = walls.low[axis], walls.high[axis]
    grid = neighbours.grid_over(low, high, radius, walls.period)
    found = dict(settings or {})
    if "capacity" not in found:
        fluid, nodes = _fullest(walls, jnp.asarray(x, walls.x.dtype), grid)
        found["capacity"] = neighbours.needed_capacity(fluid)
        found["node_capacity"] = neighbours.needed_capacity(nodes)
        found["chamber_capacity"] = 1
        if chamber is not None:
            _, count = chamber.candidates(jnp.asarray(x, walls.x.dtype), skin, 1)
            found["chamber_capacity"] = int(1.5 * int(count)) + 32
        found["rebuild_every"] = block
    return Search(
        grid=grid,
        capacity=int(found["capacity"]),
        node_capacity=int(found["node_capacity"]),
        chamber_capacity=int(found["chamber_capacity"]),
        rebuild_every=int(found["rebuild_every"]),
        skin=skin,
    )


def _fullest(walls: boundaries.Ghosts, x: jax.Array, grid: neighbours.Grid) -> tuple[int, int]:
    """Largest number of neighbours of any particle and of any node in the initial state."""
    region = walls.regions.index(x)
    kind = walls.regions.kind(region)
    count = jax.jit(neighbours.search, static_argnums=(2, 3, 6))
    fluid = count(
        x,
        jnp.concatenate([x, walls.x]),
        grid,
        1,
        walls.regions.sees(region),
        jnp.concatenate([kind, walls.kind]),
        True,
    )
    nodes = count(walls.node, x, grid, 1, walls.node_sees, kind, False)
    return int(fluid.most), int(nodes.most)


# --------------------------------------------------------------------------- probes and check


def make_probes(case: Case, model: Model, state: State) -> tuple[Any, ...]:
    """The probes that a case asks for, zeroed in its initial state."""
    dtype = model.dt.dtype
    sample_dt = jnp.asarray(case.output.sample_dt, dtype)
    found: list[Any] = [probes.EnergyProbe.over(model, state, sample_dt)]
    if case.probes.gauges:
        at = jnp.asarray(case.probes.gauges, dtype)
        gauge = probes.WaveGauge(at, jnp.zeros_like(at))
        still = gauge.measure(model, state, None)["eta"]
        found.append(probes.WaveGauge(at, still))
    if case.probes.surface:
        at, top = np.asarray(case.probes.surface), model.walls.high[-1]
        levels = np.arange(0.0, top, 0.5 * case.dx)
        at, levels, half = (jnp.asarray(a, dtype) for a in (at, levels, 0.5 * case.dx))
        found.append(probes.InterpolatedGauge(at, levels, model.depth))
        found.append(probes.ParticleGauge(at, model.depth - half))
    if case.probes.pressure:
        found.append(probes.PressureProbe(jnp.asarray(case.probes.pressure, dtype)))
    if case.probes.velocity:
        found.append(probes.VelocityProbe(jnp.asarray(case.probes.velocity, dtype)))
    if model.chamber is not None:
        found.append(probes.ChamberProbe(sample_dt))
    if model.body is not None:
        found.append(probes.BodyProbe(sample_dt, state.particles.x.shape[1]))
        if case.body.sensors:
            found.append(probes.BodyPressureProbe(jnp.asarray(case.body.sensors, dtype)))
    return tuple(found)


def steps_per_sample(case: Case, model: Model) -> int:
    """Steps between two samples (dt was chosen to divide it)."""
    return int(round(case.output.sample_dt / float(model.dt)))


def check(case: Case) -> list[tuple[str, str]]:
    """What a run of this case will be: labels and values, for people."""
    model, state = build(case)
    n, ghosts = state.particles.x.shape[0], model.walls.count
    steps = int(np.ceil(case.t1 / float(model.dt) - 1e-3))
    rows = [
        ("case", f"{case.name}: {case.description}"),
        ("particles", f"{n:,} of water, {ghosts:,} ghosts, dx = {case.dx:g} m"),
        ("scheme", model.scheme.described()),
        ("time step", f"{float(model.dt):.3e} s, {steps:,} steps to t1 = {case.t1:g} s"),
    ]
    if case.waves is not None:
        omega = 2 * np.pi / case.waves.T
        k = float(waves.wavenumber(omega, case.tank.depth, case.g))
        power = waves.incident_power(case.waves.H, case.waves.T, case.tank.depth, case.fluid.rho0, case.g)
        rows += [
            ("wavelength", f"{2 * np.pi / k:.4g} m (kd = {k * case.tank.depth:.3g})"),
            ("paddle stroke", f"{case.waves.H / float(waves.biesel(k, case.tank.depth)):.4g} m"),
            ("incident power", f"{float(power):.4g} W per metre of width"),
        ]
    search = model.search
    rows += [
        (
            "neighbours",
            f"{search.capacity} slots, searched every {search.rebuild_every} steps",
        ),
        (
            "wall time",
            f"about {_duration(n * steps * model.scheme.cost(len(model.g)))} on one core of a current CPU",
        ),
    ]
    return rows


def _duration(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
