"""Sections of a case file: every key with its type, range, default and meaning, in SI units.

What follows from several sections, and from the lattice of spacing dx, is checked in `geometry` and `limits`.
"""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Literal

from pydantic import Discriminator, Field, Tag, field_validator, model_validator

from jaxsph.case.air_sections import DEVICE_WALLS, AirSection, ChamberSection, DuctSection, PTOSection
from jaxsph.case.section import (
    MOST_POINTS,
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
from jaxsph.case.shape_sections import BodySection, SolidSection
from jaxsph.case.wave_sections import WAVES, WavesSection
from jaxsph.core.kernels import AbstractKernel, Gaussian
from jaxsph.model.regularisation import HYPERVISCOSITY, SEPARATION
from jaxsph.schemes.kernels import KERNEL, NAMED, KernelName, usual_length
from jaxsph.schemes.projection import RELAXATION


class Fluid(Section):
    """Properties of the water: density, viscosity, numerical speed of sound."""

    rho0: Density = 1000.0
    """Density at zero gauge pressure, kg/m3."""
    nu: float = Field(1.0e-6, ge=0, le=1e4)
    """Kinematic viscosity of Eq. 6, m2/s; used where `scheme.alpha` is not given."""
    c0: Speed | None = None
    """Numerical speed of sound, m/s; by default from Eq. 2."""


class WeaklyCompressible(Section):
    """Weakly compressible delta-SPH (Zhu et al. 2020): `kind = "weakly_compressible"`, or no kind."""

    kind: Literal["weakly_compressible"] = "weakly_compressible"
    """Kind of the scheme; another kind has other keys."""
    kernel: KernelName = "gaussian"
    """Smoothing kernel: the Gaussian, cut off, Wendland's C2, the exponential of a semicircle, or the
    polynomial that a lattice resists least."""
    h_over_dx: float = Field(1.2, ge=0.9, le=2.5)
    """Smoothing length of the Gaussian over dx; Wendland's is 1.5 times as long."""
    cut: float = Field(3.5, ge=2.5, le=4)
    """Radius of the Gaussian's support over its smoothing length; 3 in Zhu et al. 2020."""
    hyperviscosity: float = Field(HYPERVISCOSITY, ge=0, le=3)
    """Rate at which the noise of particles is taken out of the velocity, over sqrt(g/h)."""
    separation: float = Field(SEPARATION, ge=0, le=10)
    """Rate at which particles nearer than 0.6 dx are moved apart, over sqrt(g/h)."""
    delta: float = Field(0.1, ge=0, le=1)
    """Coefficient delta of the density diffusion (Eq. 8)."""
    alpha: float | None = Field(None, ge=0, le=1)
    """Coefficient alpha of the artificial viscosity (Eq. 4), in the place of fluid.nu."""
    integrator: Literal["symplectic", "predictor_corrector"] = "symplectic"
    """Time integrator, with one evaluation of the water a step (symplectic Euler) or two."""
    cfl: float | None = Field(None, ge=1e-6, le=1.5)
    """Courant number, the time step's share of h/c0; by default the integrator's own."""

    bytes_per_particle: ClassVar[dict[int, int]] = {2: 1000, 3: 2200}
    """Memory of a particle of water or wall by dimensions, bytes: growth of a run's largest memory between
    7,500 and 43,000 particles in two and 14,500 and 63,000 in three dimensions (tables of 52 and 288
    slots)."""

    def support(self, dim: int) -> float:
        """Radius of the kernel's support over dx, in `dim` dimensions."""
        return self.smoothing_kernel(dim).reach * self.smoothing_length(dim)

    def smoothing_length(self, dim: int) -> float:
        """Smoothing length of the kernel over dx."""
        return self.h_over_dx * self.smoothing_kernel(dim).width

    def smoothing_kernel(self, dim: int) -> AbstractKernel:
        """Smoothing kernel."""
        return Gaussian(self.cut) if self.kernel == "gaussian" else NAMED[dim][self.kernel]


class Incompressible(Section):
    """Incompressible SPH by projection (Yeylaghi et al. 2016): `kind = "incompressible"`."""

    kind: Literal["incompressible"] = "incompressible"
    """Kind of the scheme; another kind has other keys."""
    kernel: KernelName | None = None
    """Smoothing kernel: by default the polynomial that a lattice resists least in two, the exponential of a
    semicircle in three dimensions; or the Gaussian, cut off, or Wendland's C2."""
    h_over_dx: float | None = Field(None, ge=0.9, le=2.5)
    """Smoothing length of the kernel over dx; by default such that polynomial and semicircle reach 3.05 dx in
    two and 3 dx in three dimensions (the polynomial 3.025 dx), 1.2 of the Gaussian, which reaches 3.5 h, and
    2 in two and 1.5 in three dimensions of Wendland's, which reaches 2 h."""
    hyperviscosity: float = Field(HYPERVISCOSITY, ge=0, le=3)
    """Rate at which the noise of particles is taken out of the velocity, over sqrt(g/h)."""
    separation: float = Field(SEPARATION, ge=0, le=10)
    """Rate at which particles nearer than 0.6 dx are moved apart, over sqrt(g/h)."""
    cfl: float = Field(0.25, ge=1e-6, le=0.5)
    """Courant number, the time step's share of 1.2 dx (1.5 dx in 3-D) over the largest speed to expect."""
    speed: Speed | None = None
    """Largest speed to expect, m/s; by default from the waves, the water's depth and the body."""
    solver: Literal["bicgstab", "explicit"] = "bicgstab"
    """Solution of the Poisson equation: iterative (BiCGStab), or explicit."""
    tolerance: float = Field(3.0e-3, ge=1e-12, le=0.1)
    """Largest residual of the Poisson equation over its right-hand side."""
    relaxation: float = Field(RELAXATION, ge=0, le=4)
    """Rate at which crowding of particles is taken back, over sqrt(g/h)."""
    shifting: float | None = Field(None, ge=1e-6, le=20)
    """Strength of particle shifting; by default there is none."""
    surface: Literal["empty_neighbours", "particles"] = "empty_neighbours"
    """Place of zero pressure: beyond the surface, or at its particles (Eq. 23-24)."""

    bytes_per_particle: ClassVar[dict[int, int]] = {2: 2100, 3: 1900}
    """Memory of a particle of water or wall by dimensions, bytes: measured as the other scheme's (80 and
    208 slots)."""

    def support(self, dim: int) -> float:
        """Radius of the kernel's support over dx, in `dim` dimensions."""
        return self.smoothing_kernel(dim).reach * self.smoothing_length(dim)

    def smoothing_length(self, dim: int) -> float:
        """Smoothing length of the kernel over dx."""
        return usual_length(self.smoothing_kernel(dim), dim) if self.h_over_dx is None else self.h_over_dx

    def smoothing_kernel(self, dim: int) -> AbstractKernel:
        """Smoothing kernel."""
        return KERNEL[dim] if self.kernel is None else NAMED[dim][self.kernel]


SCHEMES = {"weakly_compressible": WeaklyCompressible, "incompressible": Incompressible}
"""Sections of the schemes by `scheme.kind`; the first where none is given."""
SchemeSection = Annotated[
    Annotated[WeaklyCompressible, Tag("weakly_compressible")]
    | Annotated[Incompressible, Tag("incompressible")],
    Discriminator(kind_of(SCHEMES)),
]
"""The scheme: one section, whose `kind` says which keys it has."""


class Tank(Section):
    """The basin; z = 0 is the bed, x = 0 the paddle at rest (or the end wall)."""

    length: Length
    """Length from the paddle at rest, or the near end wall, to the far end wall, m."""
    depth: Length
    """Depth of still water, or of a released column, m."""
    width: Length | None = None
    """Width of the tank, m; given, the case is three-dimensional."""
    height: Length | None = None
    """Height of the walls' top, m; by default enough for waves and a body, and four depths for a released
    column."""
    rim: Literal["closed", "open"] = "closed"
    """Whether water that splashes over the walls ends the run, or leaves and is counted (`spilt`)."""
    column: Length | None = None
    """Length of the water at the left end, m, released at t = 0 into the dry rest (a dam break)."""
    layer: Length | None = None
    """Depth of the water that the rest of the bed is wet with, m; with `column`."""
    slip: Literal["free_slip", "no_slip"] = "free_slip"
    """Slip of the water along the walls: free, or none."""
    walls: Literal["images", "mirror", "dummy"] | None = None
    """Ghosts of the walls: mirror images of the water's particles (by default), or a lattice, whose pressures
    are those of the water at its mirror images or around it (`dummy`; by default with a body)."""


class SpongeSection(Section):
    """Damping zone at the end of the tank (Eq. 27-28)."""

    length: Length
    """Length of the zone, from the end wall, m."""
    strength: float = Field(10.0, ge=1e-6, le=1e6)
    """Largest rate of damping, 1/s."""


class Device(Section):
    """An onshore OWC: a plate that pierces the surface in front of the end wall."""

    chamber_length: Length
    """Length of the chamber, from the plate to the end wall, m."""
    wall_thickness: Length
    """Thickness of the plate, m."""
    draught: Length
    """Depth of the plate's tip below still water, m."""
    thin_wall: Literal["regional", "multi_node"] = "regional"
    """Ghosts of the plate: of each face for its own region of water, or in the plate with a node per face."""
    division: Literal["a", "b", "c"] = "b"
    """Division of the water around the plate into regions (section 2.4.1.2)."""
    platform_length: Length | None = None
    """Length of a raised bed under the OWC, from the end wall, m; given with its height, or neither."""
    platform_height: float | None = Field(None, ge=0, le=1e5)
    """Height of the raised bed, m; 0 leaves the bed flat."""

    @model_validator(mode="after")
    def _whole_platform(self) -> Device:
        if (self.platform_length is None) != (self.platform_height is None):
            raise ValueError("give both device.platform_length and device.platform_height, or neither")
        return self


class StandingWave(Section):
    """Initial velocities of a standing wave that passes through the flat surface at t = 0."""

    amplitude: float = Field(ge=1e-6, le=1e5)
    """Amplitude of the elevation that the velocities lead to, m."""
    mode: int = Field(1, ge=1, le=10**6)
    """Number of half wavelengths along the tank."""


class ProbesSection(Section):
    """Places of gauges and sensors."""

    gauges: tuple[Coordinate, ...] = Field((), max_length=MOST_POINTS)
    """Places x of the wave gauges, m; their elevations are averaged across the tank."""
    surface: tuple[Point, ...] = Field((), max_length=MOST_POINTS)
    """Points, (x,) or (x, y), m, where the elevation is measured by the wet length of a wire, and by
    interpolated density (Yeylaghi et al. 2016)."""
    pressure: tuple[Point, ...] = Field((), max_length=MOST_POINTS)
    """Points of the pressure sensors, m."""
    velocity: tuple[Point, ...] = Field((), max_length=MOST_POINTS)
    """Points where the water's velocity is measured, m."""
    overtopping: tuple[Name, ...] = ()
    """Names of solids over whose crest the water is measured that goes over it."""
    run_up: tuple[Name, ...] = ()
    """Names of solids on whose seaward face the level is measured up to which water wets it."""


class Output(Section):
    """Intervals of recording, and periods over which results are averaged."""

    sample_dt: Time = 0.01
    """Time between two readings, s; at most t1."""
    snapshot_dt: Time = 0.2
    """Time between two snapshots of all particles, s, as a whole number of readings."""
    periods: int = Field(10, ge=1, le=10**6)
    """Number of whole periods at the end over which power and efficiency are averaged."""


DEVICE_CHAMBER = "chamber"
"""Name of the device's chamber."""
KINDS: dict[str, dict[str, type[Section]]] = {"scheme": SCHEMES, "waves": WAVES}
"""Sections of several kinds, by the section's name and its `kind`; the first where none is given."""


class Sections(Section):
    """All sections of a case, in SI units."""

    name: str = Field("case", min_length=1, max_length=100, pattern=r"^[^/\\\x00-\x1f\x7f]+$")
    """Name of the case, without slashes: a run's file is named after it."""
    description: str = Field("", max_length=10_000)
    """What is run and after whom, in the user's own words."""
    dx: Length
    """Spacing of the particles, m."""
    t1: Time
    """End of the run, s."""
    g: float = Field(9.81, ge=0, le=1e3)
    """Acceleration of gravity, m/s2: 0, or at least 0.001."""
    precision: Literal["float32", "float64"] = "float32"
    """Floating-point type of the model's and the state's numbers."""
    search: Literal["cells", "jax_md"] = "cells"
    """Neighbour search: the solver's own, or jax-md's (the extra `jaxsph[jax-md]`)."""
    fluid: Fluid = Fluid.model_validate({})
    scheme: SchemeSection = WeaklyCompressible.model_validate({})
    tank: Tank
    waves: WavesSection | None = None
    sponge: SpongeSection | None = None
    device: Device | None = None
    pto: PTOSection | None = None
    air: AirSection | None = None
    start: StandingWave | None = None
    body: BodySection | None = None
    solid: dict[Name, SolidSection] = Field({})
    """Solids that do not move, by their names."""
    chamber: dict[Name, ChamberSection] = Field({})
    """Chambers of air between any two walls, by their names."""
    duct: dict[Name, DuctSection] = Field({})
    """Ducts between chambers, by their names."""
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
        """Chambers by their names: those that the case names, and the device's, whose power take-off is `pto`
        and whose air is `air`."""
        if self.pto is None:
            return self.chamber
        own = ChamberSection(between=DEVICE_WALLS, pto=self.pto, air=self.air)
        return {DEVICE_CHAMBER: own, **self.chamber}

    def is_device_chamber(self, name: str) -> bool:
        """Whether a chamber is the device's, whose keys are those of the short form."""
        return name == DEVICE_CHAMBER and self.pto is not None

    @property
    def turbines(self) -> list[PTOSection]:
        """Power take-offs of chambers and ducts that take power: all but prescribed pressures."""
        ptos = (one.pto for one in (*self.chambers.values(), *self.duct.values()))
        return [pto for pto in ptos if pto is not None and pto.is_turbine]

    @property
    def prescribed(self) -> list[float]:
        """Prescribed pressures of chambers, Pa."""
        found = [one.pto.P_a for one in self.chambers.values() if one.pto is not None]
        return [P_a for P_a in found if P_a is not None]

    @property
    def dim(self) -> int:
        """Dimensions: three where the tank has a width."""
        return 2 if self.tank.width is None else 3

    @property
    def smoothing_length(self) -> float:
        """Smoothing length h of the scheme's kernel, m."""
        return self.scheme.smoothing_length(self.dim) * self.dx

    @property
    def layers(self) -> int:
        """Layers of ghosts, a spacing apart, that the kernel of a particle at a wall reaches."""
        return math.ceil(self.scheme.support(self.dim) - 0.5)
