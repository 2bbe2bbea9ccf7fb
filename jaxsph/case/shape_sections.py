"""Sections of solids: shapes, the body that the water moves, and fixed solids."""

from __future__ import annotations

import math
from typing import ClassVar, Literal

from pydantic import Field, model_validator

from jaxsph.case.section import (
    MOST_POINTS,
    Coefficient,
    Coordinate,
    Density,
    Duration,
    Inertia,
    Length,
    Point,
    Section,
    Velocity,
)


class BlockSection(Section):
    """A box with its faces normal to the axes, in its position at rest."""

    low: Point
    """Corner with the smallest coordinates, (x, z) or (x, y, z), m."""
    high: Point
    """Corner with the largest coordinates, m."""

    @model_validator(mode="after")
    def _extent(self) -> BlockSection:
        if len(self.low) != len(self.high) or not all(
            a < b for a, b in zip(self.low, self.high, strict=True)
        ):
            raise ValueError(f"low = {self.low} must be below high = {self.high} along every axis")
        return self


class DiscSection(Section):
    """A circular cylinder across a two-dimensional tank, in its position at rest."""

    centre: tuple[Coordinate, Coordinate]
    """Centre (x, z), m."""
    radius: Length
    """Radius, m."""


class RotationalPTOSection(Section):
    """Power take-off on a body's pitch; in two dimensions all values are per metre of width."""

    damping: Coefficient = 0.0
    """Linear damping, N m s/rad."""
    coulomb: Coefficient = 0.0
    """Moment of the Coulomb friction, N m."""
    spring: Coefficient = 0.0
    """Stiffness of a spring that pulls the body back to zero pitch, N m/rad."""
    stop: float = Field(math.pi, ge=1e-6, le=1e3)
    """Pitch angle, to either side, at which the end stops engage, rad."""
    stop_stiffness: Coefficient = 0.0
    """Stiffness of the end stops, N m/rad."""


class ShapeSection(Section):
    """A shape in its position at rest: a block, a polygon or a disc."""

    shapes: ClassVar[tuple[str, ...]] = ("block", "polygon", "disc")
    """Keys of the shapes; a section gives exactly one of these keys."""

    block: BlockSection | None = None
    polygon: tuple[tuple[Coordinate, Coordinate], ...] | None = Field(None, min_length=3, max_length=1000)
    """Corners (x, z) of a polygon in order along its outline, m."""
    disc: DiscSection | None = None

    @model_validator(mode="after")
    def _one_shape(self):
        if sum(getattr(self, shape) is not None for shape in self.shapes) != 1:
            *first, last = self.shapes
            raise ValueError(f"give exactly one of {', '.join(first)} and {last}")
        return self


class PlateSection(Section):
    """A straight thin plate of any inclination; water on one side does not act on water on the other."""

    foot: tuple[Coordinate, Coordinate]
    """Midpoint (x, z) of one end, m."""
    head: tuple[Coordinate, Coordinate]
    """Midpoint (x, z) of the other end, m."""
    thickness: Length
    """Thickness, m; at least half a spacing."""


class SolidSection(ShapeSection):
    """A fixed solid, for example a sloping bed, a breakwater, a step, a caisson or a screen; the case chooses
    its name. Give one of block, polygon, disc and plate."""

    shapes: ClassVar[tuple[str, ...]] = (*ShapeSection.shapes, "plate")

    plate: PlateSection | None = None


class BodySection(ShapeSection):
    """A rigid body. Give one of block, polygon and disc."""

    free: tuple[Literal["surge", "heave", "pitch"], ...] = ()
    """Motions that the water drives; in the others the body keeps its initial `velocity`."""
    mass: Inertia | None = None
    """Mass, kg (kg/m in 2-D)."""
    inertia: Inertia | None = None
    """Moment of inertia about the pivot, kg m2 (kg m in 2-D)."""
    density: Density | None = None
    """Density of the body, kg/m3; give it instead of mass and inertia, which then follow from the shape."""
    pivot: tuple[Coordinate, Coordinate] | None = None
    """Position (x, z) of the hinge, m; by default the centre of mass."""
    centre: tuple[Coordinate, Coordinate] | None = None
    """Centre of mass (x, z), m; by default the centroid of the shape."""
    velocity: tuple[Velocity, Velocity, Velocity] = (0.0, 0.0, 0.0)
    """Initial velocities in surge (m/s), heave (m/s) and pitch (rad/s)."""
    angle: float = Field(0.0, ge=-1.6, le=1.6)
    """Initial pitch, rad."""
    release: Duration = 0.0
    """Time until which the body is held at rest while the water settles around it, s."""
    pto: RotationalPTOSection | None = None
    sensors: tuple[Point, ...] = Field((), max_length=MOST_POINTS)
    """Points of the pressure sensors on the body in its position at rest, m."""

    @model_validator(mode="after")
    def _whole(self) -> BodySection:
        if self.free and (self.density is None) == (self.mass is None):
            raise ValueError(
                "a body with free motions needs either body.density or body.mass (and body.inertia for pitch)"
            )
        if "pitch" in self.free and self.density is None and self.inertia is None:
            raise ValueError("body.free includes pitch: give body.inertia or body.density")
        if self.release and (not self.free or any(self.velocity)):
            raise ValueError("body.release needs a body with free motions and no initial body.velocity")
        if self.pto is not None and "pitch" not in self.free:
            raise ValueError("body.pto acts on the pitch: add pitch to body.free")
        return self
