"""Sections of a case file: every key with its type, range, default and meaning, in SI units.

`geometry` and `limits` check conditions on several sections, or on the spacing dx.
"""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Literal

from pydantic import Discriminator, Field, Tag, field_validator, model_validator

from jaxsph.case.air_sections import DEVICE_WALLS, AirSection, ChamberSection, DuctSection, PTOSection
from jaxsph.case.body_sections import BodySection, LinkSection
from jaxsph.case.mooring_sections import MooringSection
from jaxsph.case.section import (
    MOST_POINTS,
    NAME,
    Coordinate,
    Density,
    Length,
    Name,
    Point,
    Section,
    Speed,
    Time,
    kind_of,
)
from jaxsph.case.shape_sections import SolidSection
from jaxsph.case.wave_sections import WAVES, WavesSection
from jaxsph.core.kernels import AbstractKernel, Gaussian
from jaxsph.model.regularisation import HYPERVISCOSITY, SEPARATION
from jaxsph.schemes.kernels import KERNEL, NAMED, KernelName, usual_length
from jaxsph.schemes.projection import RELAXATION


class Fluid(Section):
    """Properties of the water: density, viscosity, and numerical speed of sound."""

    rho0: Density = 1000.0
    """Density at zero gauge pressure, kg/m3."""
    nu: float = Field(1.0e-6, ge=0, le=1e4)
    """Kinematic viscosity (Eq. 6), m2/s; used unless `scheme.alpha` is given."""
    c0: Speed | None = None
    """Numerical speed of sound, m/s; by default ten times the larger of the largest expected speed of the
    water and sqrt(g depth) (Eq. 2)."""


class WeaklyCompressible(Section):
    """Weakly compressible delta-SPH (Zhu et al. 2020): `kind = "weakly_compressible"`, the default."""

    kind: Literal["weakly_compressible"] = "weakly_compressible"
    """Kind of scheme; each kind has its own keys."""
    kernel: KernelName = "gaussian"
    """Smoothing kernel: the truncated Gaussian, Wendland's C2, the exponential of a semicircle, or the
    polynomial with the least spurious stress in a strained lattice."""
    h_over_dx: float = Field(1.2, ge=0.9, le=2.5)
    """Smoothing length divided by dx (-); Wendland's kernel has 1.5 times this smoothing length."""
    cut: float = Field(3.5, ge=2.5, le=4)
    """Ratio of the Gaussian's radius of truncation to its smoothing length (-); 3 in Zhu et al. 2020."""
    hyperviscosity: float = Field(HYPERVISCOSITY, ge=0, le=3)
    """Rate at which hyperviscosity damps the velocity's noise, divided by sqrt(g/h) (-), where h is the
    smoothing length; 0 turns hyperviscosity off."""
    separation: float = Field(SEPARATION, ge=0, le=10)
    """Rate at which particles closer than 0.6 dx are moved apart, divided by sqrt(g/h) (-), where h is the
    smoothing length; 0 turns the separation off."""
    delta: float = Field(0.1, ge=0, le=1)
    """Coefficient delta of the density diffusion (-; Eq. 8)."""
    alpha: float | None = Field(None, ge=0, le=1)
    """Coefficient alpha of the artificial viscosity (-; Eq. 4), which replaces `fluid.nu`."""
    integrator: Literal["symplectic", "predictor_corrector"] = "symplectic"
    """Time integrator: symplectic Euler, with one evaluation of the rates per step, or predictor-corrector,
    with two."""
    cfl: float | None = Field(None, ge=1e-6, le=1.5)
    """Courant number: the time step divided by h/c0, where h is `h_over_dx` dx with every kernel; by default
    0.5 (symplectic) or 0.25 (predictor_corrector)."""

    bytes_per_particle: ClassVar[dict[int, int]] = {2: 1000, 3: 2200}
    """Memory per particle of water or wall, bytes, by number of dimensions, from the growth of a run's peak
    memory with the number of particles. In two dimensions the number grew from 7,500 to 43,000 (neighbour
    tables of 52 slots), and in three dimensions from 14,500 to 63,000 (tables of 288 slots)."""

    @model_validator(mode="after")
    def _cut_gaussian(self) -> WeaklyCompressible:
        if self.kernel != "gaussian":
            self.refuse(("cut",), f'with kernel = "{self.kernel}"', 'choose kernel = "gaussian"')
        return self

    def support(self, dim: int) -> float:
        """Radius of the kernel's support, in spacings, for `dim` dimensions."""
        return self.smoothing_kernel(dim).reach * self.smoothing_length(dim)

    def smoothing_length(self, dim: int) -> float:
        """Smoothing length of the kernel, in spacings."""
        return self.h_over_dx * self.smoothing_kernel(dim).width

    def smoothing_kernel(self, dim: int) -> AbstractKernel:
        """Smoothing kernel."""
        return Gaussian(self.cut) if self.kernel == "gaussian" else NAMED[dim][self.kernel]


class Incompressible(Section):
    """Incompressible SPH by projection (Yeylaghi et al. 2016): `kind = "incompressible"`."""

    kind: Literal["incompressible"] = "incompressible"
    """Kind of scheme; each kind has its own keys."""
    kernel: KernelName | None = None
    """Smoothing kernel: the polynomial with the least spurious stress in a strained lattice (default in two
    dimensions), the exponential of a semicircle (default in three), the truncated Gaussian, or Wendland's
    C2."""
    h_over_dx: float | None = Field(None, ge=0.9, le=2.5)
    """Smoothing length of the kernel divided by dx (-). By default, the polynomial and the semicircle have a
    support radius of 3.05 dx in two dimensions, and of 3.025 and 3 dx in three; the Gaussian has h = 1.2 dx
    (support 3.5 h), and Wendland's kernel h = 2 dx in two dimensions and 1.5 dx in three (support 2 h)."""
    hyperviscosity: float = Field(HYPERVISCOSITY, ge=0, le=3)
    """Rate at which hyperviscosity damps the velocity's noise, divided by sqrt(g/h) (-), where h is the
    smoothing length; 0 turns hyperviscosity off."""
    separation: float = Field(SEPARATION, ge=0, le=10)
    """Rate at which particles closer than 0.6 dx are moved apart, divided by sqrt(g/h) (-), where h is the
    smoothing length; 0 turns the separation off."""
    cfl: float = Field(0.25, ge=1e-6, le=0.5)
    """Courant number: time step times largest expected speed, divided by 1.2 dx (in three dimensions by
    1.5 dx)."""
    speed: Speed | None = None
    """Largest expected speed of the water, m/s; by default estimated from the waves, the depth and the
    body."""
    solver: Literal["bicgstab", "explicit"] = "bicgstab"
    """Solver of the pressure Poisson equation: iterative (BiCGStab) or explicit."""
    tolerance: float = Field(3.0e-3, ge=1e-12, le=0.1)
    """Largest residual of the Poisson equation, relative to its right-hand side (-)."""
    relaxation: float = Field(RELAXATION, ge=0, le=4)
    """Rate at which crowded particles are spread out, divided by sqrt(g/h) (-), where h is the smoothing
    length."""
    shifting: float | None = Field(None, ge=1e-6, le=20)
    """Strength of the particle shifting (-); by default particles are not shifted."""
    surface: Literal["empty_neighbours", "particles"] = "empty_neighbours"
    """Free-surface condition: zero pressure just beyond the surface (`empty_neighbours`), or at the surface
    particles (`particles`, Eq. 23-24)."""

    bytes_per_particle: ClassVar[dict[int, int]] = {2: 2100, 3: 1900}
    """Memory per particle of water or wall, bytes, by number of dimensions. Measured as for the weakly
    compressible scheme, with neighbour tables of 80 slots in two dimensions and 208 slots in three."""

    @model_validator(mode="after")
    def _solved_to(self) -> Incompressible:
        if self.solver != "bicgstab":
            self.refuse(("tolerance",), f'with solver = "{self.solver}"', 'choose solver = "bicgstab"')
        return self

    def support(self, dim: int) -> float:
        """Radius of the kernel's support, in spacings, for `dim` dimensions."""
        return self.smoothing_kernel(dim).reach * self.smoothing_length(dim)

    def smoothing_length(self, dim: int) -> float:
        """Smoothing length of the kernel, in spacings."""
        return usual_length(self.smoothing_kernel(dim), dim) if self.h_over_dx is None else self.h_over_dx

    def smoothing_kernel(self, dim: int) -> AbstractKernel:
        """Smoothing kernel."""
        return KERNEL[dim] if self.kernel is None else NAMED[dim][self.kernel]


SCHEMES = {"weakly_compressible": WeaklyCompressible, "incompressible": Incompressible}
"""Sections of the schemes by `scheme.kind`; the first is the default."""
SchemeSection = Annotated[
    Annotated[WeaklyCompressible, Tag("weakly_compressible")]
    | Annotated[Incompressible, Tag("incompressible")],
    Discriminator(kind_of(SCHEMES)),
]
"""Section of the scheme; its `kind` determines its keys."""


class Tank(Section):
    """The tank; z = 0 is the bed, and x = 0 the paddle at rest or the near end wall."""

    length: Length
    """Length from the paddle at rest, or the near end wall, to the far end wall, m."""
    depth: Length
    """Still water depth, or depth of the released column, m."""
    width: Length | None = None
    """Width of the tank, m; if given, the case is three-dimensional."""
    height: Length | None = None
    """Height of the walls, m; by default high enough for waves, bodies and solids, or four depths with a
    released column."""
    rim: Literal["closed", "open"] = "closed"
    """Upper edge of the walls: water that splashes over it ends the run (`closed`), or leaves the tank and is
    counted as `spilt` (`open`)."""
    column: Length | None = None
    """Length of a column of water at x = 0, m, released at t = 0 into the otherwise dry tank (a dam
    break)."""
    layer: Length | None = None
    """Depth of a layer of water on the bed beyond the column, m; only with `column`."""
    slip: Literal["free_slip", "no_slip"] = "free_slip"
    """Boundary condition along the walls: free slip or no slip."""
    walls: Literal["images", "mirror", "dummy"] | None = None
    """Ghost particles of the walls: mirror images of the water particles (`images`, the default), or a
    lattice with the pressure of the water at mirrored nodes (`mirror`) or around each ghost (`dummy`, the
    default with a body or a solid)."""


class FlumeSection(Section):
    """Coarse part of the tank in front of the device: a flume of larger particles (incompressible, in two
    dimensions)."""

    length: Length
    """Length from the paddle at rest, or the near end wall, to the border at which the particles of spacing
    dx begin, m."""
    factor: int = Field(4, ge=2, le=8)
    """Spacing of the flume's particles, in spacings dx."""


class SpongeSection(Section):
    """Damping zone at the end of the tank and, without incident waves, along its other walls (Eq. 27-28)."""

    length: Length
    """Thickness of the layer at the far end, m."""
    near: Length | None = None
    """Thickness of the layer at the near end, x = 0, in a tank without incident waves, m."""
    sides: Length | None = None
    """Thickness of the layers along both side walls, in a tank with a width and without incident waves, m."""
    strength: float = Field(10.0, ge=1e-6, le=1e6)
    """Largest damping rate, which applies at the walls, 1/s."""


class Device(Section):
    """An onshore OWC: a plate that pierces the surface in front of the end wall."""

    chamber_length: Length
    """Length of the chamber from the plate to the end wall, m."""
    wall_thickness: Length
    """Thickness of the plate, m."""
    draught: Length
    """Depth of the plate's tip below still water, m."""
    thin_wall: Literal["regional", "multi_node"] = "regional"
    """Ghost particles of the plate: a separate set for the water in front of each face (`regional`), or one
    set inside the plate with a node per face (`multi_node`)."""
    division: Literal["a", "b", "c"] = "b"
    """Division of the water around the plate into regions (Zhu et al. 2020, section 2.4.1.2)."""
    platform_length: Length | None = None
    """Length of a raised bed under the OWC, from the end wall, m; give it together with `platform_height`."""
    platform_height: float | None = Field(None, ge=0, le=1e5)
    """Height of the raised bed, m; with 0 the bed is flat."""

    @model_validator(mode="after")
    def _whole_platform(self) -> Device:
        if (self.platform_length is None) != (self.platform_height is None):
            raise ValueError("give both device.platform_length and device.platform_height, or neither")
        return self


class StandingWave(Section):
    """Initial velocities of a standing wave whose surface is flat at t = 0."""

    amplitude: float = Field(ge=1e-6, le=1e5)
    """Amplitude of the standing wave's elevation, m."""
    mode: int = Field(1, ge=1, le=10**6)
    """Number of half wavelengths along the tank."""


class ProbesSection(Section):
    """Positions of gauges and sensors."""

    gauges: tuple[Coordinate, ...] = Field((), max_length=MOST_POINTS)
    """Positions x of the wave gauges, m; the elevations are averages across the tank."""
    surface: tuple[Point, ...] = Field((), max_length=MOST_POINTS)
    """Points (x,) or (x, y), m, at which the elevation is measured in two ways: by the wet length of a
    vertical wire, and by the interpolated density (Yeylaghi et al. 2016)."""
    pressure: tuple[Point, ...] = Field((), max_length=MOST_POINTS)
    """Points of the pressure sensors, m."""
    velocity: tuple[Point, ...] = Field((), max_length=MOST_POINTS)
    """Points at which the water's velocity is measured, m."""
    overtopping: tuple[Name, ...] = ()
    """Names of solids whose overtopping is measured: the water that passes over the crest."""
    run_up: tuple[Name, ...] = ()
    """Names of solids whose run-up is measured: the highest wet level on the seaward face."""


class Output(Section):
    """Recording intervals, and number of periods over which results are averaged."""

    sample_dt: Time = 0.01
    """Time between two samples (readings of all probes), s; at most t1."""
    snapshot_dt: Time = 0.2
    """Time between two snapshots of all particles, s; rounded to a whole number of sampling intervals."""
    periods: int = Field(10, ge=1, le=10**6)
    """Largest number of whole wave periods (of bichromatic waves: wave groups) at the end of the run over
    which power and efficiency are averaged; a sea is averaged over one repetition."""


ONLY_BODY = "body"
"""Name of the body that the section `body` describes."""
TANK = "tank"
"""Name of the tank in `link.NAME.between`."""
BODY_KEYS = (ONLY_BODY, f"bodies.{NAME}")
"""Sections of rigid bodies, with `NAME` for the name chosen in a case."""
DEVICE_CHAMBER = "chamber"
"""Name of the device's chamber."""
KINDS: dict[str, dict[str, type[Section]]] = {"scheme": SCHEMES, "waves": WAVES}
"""Sections that have several kinds, by name and `kind`; the first kind is the default."""


class Sections(Section):
    """All sections of a case, in SI units."""

    name: str = Field("case", min_length=1, max_length=100, pattern=r"^[^/\\\x00-\x1f\x7f]+$")
    """Name of the case, without slashes; the run file is named after it."""
    description: str = Field("", max_length=10_000)
    """Free text: what the case models, and the source of its data."""
    dx: Length
    """Spacing of the particles, m."""
    t1: Time
    """End time of the run, s."""
    g: float = Field(9.81, ge=0, le=1e3)
    """Gravitational acceleration, m/s2; 0, or at least 0.001."""
    precision: Literal["float32", "float64"] = "float32"
    """Floating-point type of the model and the state."""
    search: Literal["cells", "jax_md"] = "cells"
    """Neighbour search: the built-in cell list, or that of jax-md (needs the extra `jaxsph[jax-md]`)."""
    fluid: Fluid = Fluid.model_validate({})
    scheme: SchemeSection = WeaklyCompressible.model_validate({})
    tank: Tank
    flume: FlumeSection | None = None
    waves: WavesSection | None = None
    sponge: SpongeSection | None = None
    device: Device | None = None
    pto: PTOSection | None = None
    air: AirSection | None = None
    start: StandingWave | None = None
    body: BodySection | None = None
    """Rigid body with the name `body`: the short form for a case with a single body."""
    bodies: dict[Name, BodySection] = Field({})
    """Rigid bodies, by name."""
    link: dict[Name, LinkSection] = Field({})
    """Springs, dampers, power take-offs and other forces on bodies, by name."""
    mooring: dict[Name, MooringSection] = Field({})
    """Mooring lines between bodies and anchors, by name."""
    solid: dict[Name, SolidSection] = Field({})
    """Fixed solids, by name."""
    chamber: dict[Name, ChamberSection] = Field({})
    """Air chambers between walls or in hollows of bodies, by name."""
    duct: dict[Name, DuctSection] = Field({})
    """Ducts between chambers, by name."""
    probes: ProbesSection = ProbesSection.model_validate({})
    output: Output = Output.model_validate({})

    @field_validator("g")
    @classmethod
    def _some_gravity(cls, g: float) -> float:
        if 0 < g < 1e-3:
            raise ValueError("must be 0 or at least 0.001 m/s2")
        return g

    @property
    def chambers(self) -> dict[str, ChamberSection]:
        """Chambers by name: all sections `chamber.NAME`, and the device's chamber, which has the power
        take-off `pto` and the air `air`."""
        if self.pto is None:
            return self.chamber
        own = ChamberSection(between=DEVICE_WALLS, pto=self.pto, air=self.air)
        return {DEVICE_CHAMBER: own, **self.chamber}

    @property
    def every_body(self) -> dict[str, BodySection]:
        """Rigid bodies by name: `body`, and all sections `bodies.NAME`."""
        return ({} if self.body is None else {ONLY_BODY: self.body}) | self.bodies

    @property
    def has_take_off(self) -> bool:
        """Whether a body has a power take-off, as `pto` or as a link."""
        return any(one.pto is not None for one in self.every_body.values()) or any(
            one.take_off for one in self.link.values()
        )

    @property
    def pto_names(self) -> dict[str, str]:
        """Names of the links that represent the bodies' power take-offs, by the body's name."""
        with_pto = (name for name, one in self.every_body.items() if one.pto is not None)
        return {name: "pto" if name == ONLY_BODY else f"pto_{name}" for name in with_pto}

    def body_key(self, name: str) -> str:
        """Dotted name of the section of a body."""
        return ONLY_BODY if name == ONLY_BODY and self.body is not None else f"bodies.{name}"

    def is_device_chamber(self, name: str) -> bool:
        """Whether a chamber is the device's chamber, given in short form by `pto` and `air`."""
        return name == DEVICE_CHAMBER and self.pto is not None

    def chamber_key(self, name: str, key: str) -> str:
        """Dotted name of a key of a chamber's section; the device's chamber has its keys `pto` and `air` at
        the top of the case."""
        return key if self.is_device_chamber(name) else f"chamber.{name}.{key}"

    @property
    def ptos(self) -> dict[str, PTOSection]:
        """Power take-offs of chambers and ducts, by the dotted names of their sections."""
        found = {self.chamber_key(name, "pto"): one.pto for name, one in self.chambers.items()}
        found |= {f"duct.{name}.pto": one.pto for name, one in self.duct.items()}
        return {key: pto for key, pto in found.items() if pto is not None}

    @property
    def turbines(self) -> list[PTOSection]:
        """Turbines of chambers and ducts: all power take-offs except prescribed pressures."""
        return [pto for pto in self.ptos.values() if pto.is_turbine]

    @property
    def prescribed(self) -> list[float]:
        """Prescribed pressures of chambers, Pa."""
        found = [one.pto.P_a for one in self.chambers.values() if one.pto is not None]
        return [P_a for P_a in found if P_a is not None]

    @property
    def dim(self) -> int:
        """Number of dimensions: three if the tank has a width."""
        return 2 if self.tank.width is None else 3

    @property
    def near(self) -> float:
        """Position x of the near end of the water of spacing dx, m: 0, or the border of the flume."""
        if self.flume is None:
            return 0.0
        spacing = self.flume.factor * self.dx
        return round(round(self.flume.length / spacing) * spacing, 12)

    @property
    def near_end_moves(self) -> bool:
        """Whether the near end of the water of spacing dx is a wavemaker, or the border of a flume."""
        return self.waves is not None or self.flume is not None

    @property
    def smoothing_length(self) -> float:
        """Smoothing length h of the scheme's kernel, m."""
        return self.scheme.smoothing_length(self.dim) * self.dx

    @property
    def layers(self) -> int:
        """Number of layers of ghosts, one spacing apart, in the kernel's support of a particle at a wall."""
        return math.ceil(self.scheme.support(self.dim) - 0.5)
