"""Sections of rigid bodies with their links, take-offs and prescribed motions."""

from __future__ import annotations

import itertools
import math
import typing
from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from jaxsph.case.section import (
    MOST_POINTS,
    Coefficient,
    Coordinate,
    Density,
    Duration,
    Inertia,
    Length,
    Name,
    Point,
    Section,
    Time,
    Velocity,
)
from jaxsph.case.shape_sections import ShapeSection
from jaxsph.model.rigid import PLANE, SPACE

Motion = Literal["surge", "sway", "heave", "roll", "pitch", "yaw"]
"""Name of a motion of a body; in two dimensions only surge, heave and pitch."""
Position = Annotated[tuple[Coordinate, ...], Field(min_length=2, max_length=3)]
"""Position (x, z) or (x, y, z), m."""
Stiffness = Annotated[float, Field(ge=-1e15, le=1e15)]
"""Stiffness of a spring, which a controlled take-off may also make negative."""
Product = Annotated[float, Field(ge=-1e15, le=1e15)]
Tilt = Annotated[float, Field(ge=-1.6, le=1.6)]
MOTIONS = typing.get_args(Motion)
"""Names of all motions."""
PLANAR = PLANE.motions
"""Motions in the plane (x, z)."""
ROTATIONS = SPACE.motions[SPACE.dim :]
"""Motions about an axis."""


def _three_or_six(values: tuple[float, ...]) -> tuple[float, ...]:
    """The values, unchanged. **Raises** ValueError unless there are three or six."""
    if len(values) not in (3, 6):
        raise ValueError(
            "must have three values (surge, heave, pitch), or in three dimensions six (surge, sway, heave, "
            "roll, pitch, yaw)"
        )
    return values


Motions = Annotated[tuple[Coordinate, ...], AfterValidator(_three_or_six)]
"""Values of surge, heave and pitch, or of all six motions."""


def spatial(values: Sequence[float]) -> tuple[float, ...]:
    """Values of all six motions, from six values, or from three (surge, heave and pitch)."""
    if len(values) == 6:
        return tuple(values)
    surge, heave, pitch = values
    return surge, 0.0, heave, 0.0, pitch, 0.0


class RotationalPTOSection(Section):
    """Power take-off on a body's pitch; in two dimensions all moments are per metre of width."""

    damping: Coefficient = 0.0
    """Linear damping, N m s/rad."""
    coulomb: Coefficient = 0.0
    """Moment of the Coulomb friction, N m."""
    spring: Stiffness = 0.0
    """Stiffness of a spring that pulls the body back to zero pitch, N m/rad; negative in reactive control."""
    stop: float = Field(math.pi, ge=1e-6, le=1e3)
    """Pitch angle, to either side, at which the end stops engage, rad."""
    stop_stiffness: Coefficient = 0.0
    """Stiffness of the end stops, N m/rad."""

    @model_validator(mode="after")
    def _whole_stops(self) -> RotationalPTOSection:
        if not self.stop_stiffness:
            self.refuse(("stop",), "without stop_stiffness", "give a positive stop_stiffness")
        return self


class LinkSection(Section):
    """A force between two points of bodies or the tank, or along one motion of a body's joint. The forces of
    all keys add up; in two dimensions they are per metre of width."""

    body: Name | None = None
    """Name of the body along whose joint the link acts; give it together with `motion`."""
    motion: Motion | None = None
    """Motion along which the link acts, relative to the body or tank to which the body is joined. With a
    rotation, forces are moments (N m), extensions are angles (rad), and speeds are in rad/s."""
    between: tuple[Name, Name] | None = None
    """Two bodies between which the link acts; "tank" stands for the tank. Give it together with `at`."""
    at: tuple[Position, Position] | None = None
    """Positions of the link's ends with all bodies at rest, m: (x, z), or in three dimensions (x, y, z);
    an end without y has the y of the body's pivot."""
    rest: Length | None = None
    """Length at which the link between two points is not extended, m; by default the distance between its
    ends with all bodies at rest."""
    stiffness: Stiffness = 0.0
    """Stiffness of a spring, N/m; negative only for a take-off with reactive control."""
    pretension: float = Field(0.0, ge=-1e12, le=1e12)
    """Tension of the spring at zero extension, N."""
    damping: Coefficient = 0.0
    """Linear damping, N s/m."""
    quadratic: Coefficient = 0.0
    """Quadratic damping, N s2/m2."""
    friction: Coefficient = 0.0
    """Force of Coulomb friction, N."""
    slack: bool = False
    """Whether the link is a rope, which becomes slack instead of pushing; damping then acts only while the
    rope is taut."""
    stops: tuple[Coordinate, Coordinate] | None = None
    """Smallest and largest extension at which no end stop acts, m; give it together with `stop_stiffness`."""
    stop_stiffness: Coefficient = 0.0
    """Stiffness of the end stops, N/m."""
    latch: Duration | None = None
    """Time for which a latch holds the link whenever its motion reverses, s; needs `latch_damping`."""
    latch_damping: Coefficient = 0.0
    """Linear damping of the latch while it holds the link, N s/m; choose it much larger than the body's
    mass divided by the time step."""
    take_off: bool = False
    """Whether the link is a power take-off, whose power counts as power of the device."""

    @model_validator(mode="after")
    def _whole_link(self) -> LinkSection:
        along = self.body is not None and self.motion is not None
        between = self.between is not None and self.at is not None
        parts = (self.body, self.motion), (self.between, self.at)
        if along == between or any((a is None) != (b is None) for a, b in parts):
            raise ValueError("give either body and motion, or between and at")
        if self.rest is not None and not between:
            raise ValueError(
                "rest needs between and at, because a link along a joint has no length; remove rest"
            )
        if self.between is not None and self.between[0] == self.between[1]:
            raise ValueError(
                f"between = {list(self.between)}: the two ends must be on different bodies, or one on the "
                "tank"
            )
        if (self.stops is None) != (self.stop_stiffness == 0.0):
            raise ValueError("give both stops and a positive stop_stiffness, or neither")
        if self.stops is not None and self.stops[0] >= self.stops[1]:
            raise ValueError(f"stops = {list(self.stops)} must be an increasing pair")
        if (self.latch is None) != (self.latch_damping == 0.0):
            raise ValueError(
                "a latch needs both latch (its holding time) and a positive latch_damping; give both, or "
                "neither"
            )
        others = (self.quadratic, self.friction, self.stop_stiffness, self.latch_damping)
        if self.stiffness < 0.0 and not self.take_off:
            raise ValueError(
                f"stiffness = {self.stiffness:g}: must not be negative without take_off, because only a "
                "controlled take-off can push outwards; give take_off = true, or a positive stiffness"
            )
        if self.slack and (not between or self.stiffness <= 0.0 or any(others)):
            raise ValueError(
                "slack needs between, at and stiffness; the only other forces allowed are pretension "
                "and damping"
            )
        if not any((self.stiffness, self.pretension, *self.losses, self.stop_stiffness)):
            raise ValueError("the link has no force; give stiffness, damping, friction or another key")
        if self.take_off and not any(self.losses):
            raise ValueError(
                "take_off needs a force that absorbs energy; give damping, quadratic or friction, or remove "
                "take_off"
            )
        return self

    @property
    def losses(self) -> tuple[float, ...]:
        """Coefficients of all forces that absorb energy."""
        return self.damping, self.quadratic, self.friction, self.latch_damping


class MotionSection(Section):
    """A prescribed motion of a body: harmonic, or the columns t, surge, heave and pitch of a CSV file, in
    three dimensions also sway, roll and yaw."""

    amplitude: Motions | None = None
    """Amplitudes of surge (m), heave (m) and pitch (rad) of a harmonic motion, or in three dimensions of
    surge, sway, heave (m), roll, pitch and yaw (rad)."""
    period: Time | None = None
    """Period of the harmonic motion, s."""
    phase: Motions = (0.0, 0.0, 0.0)
    """Phases of the harmonic motions, which are amplitude * sin(2 pi t / period + phase), rad."""
    ramp: Duration | None = None
    """Time over which a harmonic motion grows to its amplitude, s; by default one period."""
    t: tuple[Duration, ...] = Field((), max_length=50_000)
    """Times of a sampled motion, s, from 0 on; between them the motion is interpolated by cubic splines, and
    after the last time the body keeps its position."""
    surge: tuple[Coordinate, ...] = Field((), max_length=50_000)
    """Samples of the surge, m."""
    heave: tuple[Coordinate, ...] = Field((), max_length=50_000)
    """Samples of the heave, m."""
    pitch: tuple[Coordinate, ...] = Field((), max_length=50_000)
    """Samples of the pitch, rad."""
    sway: tuple[Coordinate, ...] = Field((), max_length=50_000)
    """Samples of the sway, m."""
    roll: tuple[Coordinate, ...] = Field((), max_length=50_000)
    """Samples of the roll, rad."""
    yaw: tuple[Coordinate, ...] = Field((), max_length=50_000)
    """Samples of the yaw, rad."""

    @model_validator(mode="after")
    def _one_motion(self) -> MotionSection:
        harmonic = self.amplitude is not None and self.period is not None
        if harmonic == bool(self.t) or (self.amplitude is None) != (self.period is None):
            raise ValueError(
                "give either amplitude and period, or a file with the columns t, surge, heave, pitch"
            )
        sampled = any(getattr(self, name) for name in MOTIONS)
        if (harmonic and sampled) or (self.t and (any(self.phase) or self.ramp is not None)):
            raise ValueError(
                "give phase and ramp only with amplitude and period, and samples (surge, heave, ...) only "
                "with t"
            )
        if self.t:
            given = {name: len(one) for name in MOTIONS if (one := getattr(self, name))}
            if not given:
                raise ValueError("give samples of at least one motion (surge, heave, ...) together with t")
            for name, count in given.items():
                if count != len(self.t):
                    raise ValueError(
                        f"{name} has {count} values, but t has {len(self.t)}; give one value for each time"
                    )
            if len(self.t) < 4 or self.t[0] != 0.0 or any(a >= b for a, b in itertools.pairwise(self.t)):
                raise ValueError("t must have at least 4 increasing values, the first of which is 0")
        return self

    @property
    def samples(self) -> np.ndarray:
        """Samples `[K, 3]` of surge (m), heave (m) and pitch (rad), or `[K, 6]` of all motions if the
        section gives samples of another motion; zero for motions without samples."""
        still, planar = (0.0,) * len(self.t), not (self.sway or self.roll or self.yaw)
        names = PLANAR if planar else MOTIONS
        return np.stack([getattr(self, name) or still for name in names], axis=1)

    def top_speed(self, arm: float) -> float:
        """Largest speed of a point of the body at the distance `arm` (m) from its pivot, m/s (estimate)."""
        if self.amplitude is not None and self.period is not None:
            rates = 2.0 * np.pi / self.period * np.abs(self.amplitude)
        else:
            rates = np.abs(np.diff(self.samples, axis=0) / np.diff(self.t)[:, None]).max(axis=0)
        rates = np.asarray(spatial(tuple(rates)))
        return float(np.linalg.norm(rates[:3]) + arm * np.linalg.norm(rates[3:]))


class BodySection(ShapeSection):
    """A rigid body. It has exactly one shape."""

    free: tuple[Motion, ...] = ()
    """Motions that result from the forces: surge, heave and pitch for a floating body, in three dimensions
    also sway, roll and yaw; "pitch" alone for a hinge, "surge" or "heave" alone for a slider. In its other
    motions the body keeps its initial `velocity`."""
    joined_to: Name | None = None
    """Name of the body to which this body is joined; by default the tank. All motions are then relative to
    that body."""
    incline: float = Field(0.0, ge=-1.6, le=1.6)
    """Upward inclination of the axis of surge, rad; heave is at right angles to it."""
    motion: MotionSection | None = None
    """Prescribed motion, which is added to the free motions."""
    mass: Inertia | None = None
    """Mass, kg (kg/m in 2-D)."""
    inertia: Inertia | Annotated[tuple[Product, ...], Field(min_length=3, max_length=6)] | None = None
    """Moment of inertia about the pivot, kg m2 (kg m in 2-D). In three dimensions a single number is the
    moment of inertia in pitch; a body that also rolls or yaws needs [I_xx, I_yy, I_zz], or [I_xx, I_yy, I_zz,
    I_xy, I_xz, I_yz] with the off-diagonal elements of the inertia tensor."""
    density: Density | None = None
    """Density of the body, kg/m3; give it instead of mass and inertia, which then follow from the shape."""
    pivot: Position | None = None
    """Position (x, z) or (x, y, z) of the hinge or joint, m; by default the centre of mass."""
    centre: Position | None = None
    """Centre of mass (x, z) or (x, y, z), m; by default the centroid of the shape."""
    velocity: Annotated[tuple[Velocity, ...], AfterValidator(_three_or_six)] = (0.0, 0.0, 0.0)
    """Initial velocities in surge (m/s), heave (m/s) and pitch (rad/s), or in three dimensions in surge,
    sway, heave (m/s), roll, pitch and yaw (rad/s)."""
    angle: Tilt | tuple[Tilt, Tilt, Tilt] = 0.0
    """Initial pitch, rad; in three dimensions alternatively the angles of three rotations about the x-, y-
    and z-axis, made in this order."""
    release: Duration = 0.0
    """Time until which the body is held at rest while the water settles around it, s."""
    pto: RotationalPTOSection | None = None
    sensors: tuple[Point, ...] = Field((), max_length=MOST_POINTS)
    """Points of the pressure sensors on the body in its position at rest, m."""

    @model_validator(mode="after")
    def _whole(self) -> BodySection:
        carried = bool(self.free) or self.joined_to is not None
        if carried and (self.density is None) == (self.mass is None):
            raise ValueError(
                "a body that is free or joined to another needs either density, or mass and (if the "
                "body turns) inertia"
            )
        turns = any(one in self.free for one in ROTATIONS) or self.joined_to is not None
        if turns and self.density is None and self.inertia is None:
            raise ValueError(
                "a body that turns needs inertia or density; give inertia, or give density instead of mass"
            )
        if self.density is not None:
            self.refuse(("inertia",), "with density", "give mass instead of density")
        if self.release and not self.free:
            raise ValueError(
                f"release = {self.release:g} s needs a free motion; give free, or remove release"
            )
        if self.release and any(self.velocity):
            raise ValueError(
                f"until release = {self.release:g} s the body is at rest; remove velocity, or remove release"
            )
        if self.pto is not None and "pitch" not in self.free:
            raise ValueError('pto acts on the pitch; add "pitch" to free, or remove pto')
        return self
