"""Sections of solids: their shapes, the body that the water moves, and solids that do not move."""

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
    """A box with faces across the axes, at rest."""

    low: Point
    """Corner of least coordinates, (x, z) or (x, y, z), m."""
    high: Point
    """Corner of largest coordinates, m."""

    @model_validator(mode="after")
    def _extent(self) -> BlockSection:
        if len(self.low) != len(self.high) or not all(
            a < b for a, b in zip(self.low, self.high, strict=True)
        ):
            raise ValueError(f"low = {self.low} must be below high = {self.high} along every axis")
        return self


class DiscSection(Section):
    """A circular cylinder across a two-dimensional tank, at rest."""

    centre: tuple[Coordinate, Coordinate]
    """Centre (x, z), m."""
    radius: Length
    """Radius, m."""


class RotationalPTOSection(Section):
    """Power take-off on a body's pitch; in two dimensions its values are per metre of width."""

    damping: Coefficient = 0.0
    """Linear damping, N m s/rad."""
    coulomb: Coefficient = 0.0
    """Moment of Coulomb friction, N m."""
    spring: Coefficient = 0.0
    """Stiffness of a spring about the upright, N m/rad."""
    stop: float = Field(math.pi, ge=1e-6, le=1e3)
    """Angle to either side at which end stops begin, rad."""
    stop_stiffness: Coefficient = 0.0
    """Stiffness of the end stops, N m/rad."""


class ShapeSection(Section):
    """A shape at rest: one of block, polygon and disc."""

    shapes: ClassVar[tuple[str, ...]] = ("block", "polygon", "disc")
    """Keys of the shapes, of which a section has one."""

    block: BlockSection | None = None
    polygon: tuple[tuple[Coordinate, Coordinate], ...] | None = Field(None, min_length=3, max_length=1000)
    """Corners (x, z) of a polygon, in order around it, m."""
    disc: DiscSection | None = None

    @model_validator(mode="after")
    def _one_shape(self):
        if sum(getattr(self, shape) is not None for shape in self.shapes) != 1:
            *first, last = self.shapes
            raise ValueError(f"give exactly one of {', '.join(first)} and {last}")
        return self


class PlateSection(Section):
    """A straight thin plate of any direction, whose two sides do not see each other's water."""

    foot: tuple[Coordinate, Coordinate]
    """Middle (x, z) of one end, m."""
    head: tuple[Coordinate, Coordinate]
    """Middle (x, z) of the other end, m."""
    thickness: Length
    """Thickness, half a spacing or more, m."""


class SolidSection(ShapeSection):
    """A solid that does not move, by the name that the case gives it: a sloping bed, a breakwater, a step, a
    caisson, a screen; give one of block, polygon, disc and plate."""

    shapes: ClassVar[tuple[str, ...]] = (*ShapeSection.shapes, "plate")

    plate: PlateSection | None = None


class BodySection(ShapeSection):
    """A rigid body; give one of block, polygon and disc."""

    free: tuple[Literal["surge", "heave", "pitch"], ...] = ()
    """Motions that the water's forces drive; the others go on at their `velocity`."""
    mass: Inertia | None = None
    """Mass, kg (kg/m in 2-D)."""
    inertia: Inertia | None = None
    """Moment of inertia about the pivot, kg m2 (kg m in 2-D)."""
    density: Density | None = None
    """Density of the body, kg/m3, which gives mass and inertia in the place of both."""
    pivot: tuple[Coordinate, Coordinate] | None = None
    """Place (x, z) of the hinge, m; by default the centre of mass."""
    centre: tuple[Coordinate, Coordinate] | None = None
    """Centre of mass (x, z), m; by default that of the shape."""
    velocity: tuple[Velocity, Velocity, Velocity] = (0.0, 0.0, 0.0)
    """Velocities of surge (m/s), heave (m/s) and pitch (rad/s) at the start."""
    angle: float = Field(0.0, ge=-1.6, le=1.6)
    """Pitch at the start, rad."""
    release: Duration = 0.0
    """Time up to which the body is held at rest while the water settles around it, s."""
    pto: RotationalPTOSection | None = None
    sensors: tuple[Point, ...] = Field((), max_length=MOST_POINTS)
    """Points of the pressure sensors on the body in its place at rest, m."""

    @model_validator(mode="after")
    def _whole(self) -> BodySection:
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
