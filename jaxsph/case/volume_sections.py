"""Case-file sections that describe three-dimensional shapes."""

from __future__ import annotations

import math

import numpy as np
from pydantic import Field, field_validator, model_validator

from jaxsph.case.meshes import FINE, MOST_POINTS, Triangles, mesh_of, thin_places
from jaxsph.case.plane_sections import AbstractShapeSection, Corners, Place, check_outline, poles
from jaxsph.case.section import Coordinate, Length
from jaxsph.errors import CaseError
from jaxsph.solids.composed import Placed
from jaxsph.solids.mesh import MARGIN
from jaxsph.solids.swept import Extrusion, Revolution
from jaxsph.solids.volumes import Capsule, Cylinder, Sphere

Range = tuple[Coordinate, Coordinate]

MOST_CORNERS = 1000
"""Largest number of corners of an outline."""


class SphereSection(AbstractShapeSection):
    """A sphere in a three-dimensional tank, in its position at rest."""

    centre: Place
    """Centre (x, y, z), m."""
    radius: Length
    """Radius, m."""

    def check(self, key, dx):
        """See `AbstractShapeSection.check`."""
        _check_radius(self.radius, key, dx)

    def shape(self, dx):
        """See `AbstractShapeSection.shape`."""
        return Sphere(self.centre, self.radius)

    def corners(self):
        """See `AbstractShapeSection.corners`."""
        return poles(self.centre, self.radius)


class CylinderSection(AbstractShapeSection):
    """A circular cylinder with flat ends in a three-dimensional tank, in its position at rest."""

    foot: Place
    """Middle (x, y, z) of one end, m."""
    head: Place
    """Middle (x, y, z) of the other end, m."""
    radius: Length
    """Radius, m."""

    @model_validator(mode="after")
    def _extent(self):
        if self.foot == self.head:
            raise ValueError(f"foot and head are the same point, {list(self.foot)}; move one of them")
        return self

    def check(self, key, dx):
        """See `AbstractShapeSection.check`."""
        _check_radius(self.radius, key, dx)
        if (length := math.dist(self.foot, self.head)) < dx:
            raise CaseError(
                f"{key} is {length:.4g} m long from foot to head, but must be at least one spacing long (dx "
                f"= {dx:g} m)"
            )

    def shape(self, dx):
        """See `AbstractShapeSection.shape`."""
        return Cylinder(self.foot, self.head, self.radius)

    def corners(self):
        """See `AbstractShapeSection.corners`."""
        return Cylinder(self.foot, self.head, self.radius).rims()


class CapsuleSection(CylinderSection):
    """A circular cylinder with hemispherical ends in a three-dimensional tank, in its position at rest."""

    foot: Place
    """Centre (x, y, z) of the hemisphere at one end, m."""
    head: Place
    """Centre (x, y, z) of the hemisphere at the other end, m."""

    def shape(self, dx):
        """See `AbstractShapeSection.shape`."""
        return Capsule(self.foot, self.head, self.radius)

    def corners(self):
        """See `AbstractShapeSection.corners`."""
        return np.concatenate([poles(end, self.radius) for end in (self.foot, self.head)])


class RevolutionSection(AbstractShapeSection):
    """A solid of revolution about an upright axis in a three-dimensional tank, in its position at rest."""

    profile: Corners = Field(min_length=3, max_length=MOST_CORNERS)
    """Corners (r, z) of the profile, m, in order along its outline: distance from the axis, and height."""
    axis: tuple[Coordinate, Coordinate]
    """Position (x, y) of the axis, m."""

    @model_validator(mode="after")
    def _side(self) -> RevolutionSection:
        if (least := min(r for r, _ in self.profile)) < 0.0:
            raise ValueError(f"profile has a corner at r = {least:g} m; r must not be negative")
        return self

    def check(self, key, dx):
        """See `AbstractShapeSection.check`."""
        # the check is conservative at the axis, where the solid is twice as thick as the profile
        check_outline(self.profile, f"{key}.profile", dx)

    def shape(self, dx):
        """See `AbstractShapeSection.shape`."""
        return Revolution(self.profile, self.axis)

    def corners(self):
        """See `AbstractShapeSection.corners`."""
        return Revolution(self.profile, self.axis).rims()


class ExtrusionSection(AbstractShapeSection):
    """A prism along the x-, y- or z-axis of a three-dimensional tank, in its position at rest."""

    outline: Corners = Field(min_length=3, max_length=MOST_CORNERS)
    """Corners of the cross-section in order along its outline, m: (y, z), (x, z) or (x, y), the two
    coordinates across the prism."""
    x: Range | None = None
    """First and last x (m) of a prism along x; give one of x, y and z."""
    y: Range | None = None
    """First and last y (m) of a prism along y."""
    z: Range | None = None
    """First and last z (m) of an upright prism."""

    @model_validator(mode="after")
    def _one_axis(self) -> ExtrusionSection:
        given = [name for name in "xyz" if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError("give exactly one of x, y and z: the ends of the prism along its axis")
        low, high = getattr(self, given[0])
        if low >= high:
            raise ValueError(f"{given[0]} = {[low, high]} must be an increasing pair")
        return self

    @property
    def along(self) -> tuple[int, float, float]:
        """Number of the axis (0 for x), and first and last coordinate (m) along it."""
        axis = next(n for n, name in enumerate("xyz") if getattr(self, name) is not None)
        return axis, *getattr(self, "xyz"[axis])

    def check(self, key, dx):
        """See `AbstractShapeSection.check`."""
        check_outline(self.outline, f"{key}.outline", dx)
        axis, low, high = self.along
        if high - low < 0.5 * dx:
            raise CaseError(
                f"{key}.{'xyz'[axis]}: the prism is {high - low:.4g} m long, and must be at least half a "
                f"spacing long, {0.5 * dx:g} m"
            )

    def shape(self, dx):
        """See `AbstractShapeSection.shape`."""
        axis, *ends = self.along
        return Extrusion(self.outline, ends, axis)

    def corners(self):
        """See `AbstractShapeSection.corners`."""
        axis, *ends = self.along
        return np.concatenate([np.insert(self.outline, axis, end, axis=1) for end in ends])


class MeshSection(AbstractShapeSection):
    """A closed surface of triangles, read from an STL or OBJ file that is given as `file`."""

    packed: str
    """Positions and triangles of the surface as compressed text, made from `file`."""

    @field_validator("packed")
    @classmethod
    def _whole(cls, text: str) -> str:
        Triangles.unpacked(text)
        return text

    def check(self, key, dx):
        """See `AbstractShapeSection.check`."""
        extent = np.ptp(Triangles.unpacked(self.packed).vertices, axis=0)
        if (least := float(extent.min())) < dx:
            raise CaseError(
                f"{key} extends over {least:.4g} m along one axis, but must extend over at least one "
                f"spacing: use dx of at most {least:.3g} m, or correct scale (scale gives the metres per "
                "unit of the file)"
            )
        points = float(np.prod(extent / (FINE * dx) + 2 * MARGIN))
        if points > MOST_POINTS:
            raise CaseError(
                f"{key}: the grid of distances would have {points:.3g} points, but at most "
                f"{MOST_POINTS:.3g} are allowed; use a larger dx, or correct scale (scale gives the metres "
                "per unit of the file)"
            )

    def shape(self, dx):
        """See `AbstractShapeSection.shape`."""
        return mesh_of(self.packed, dx)

    def turned(self, angles, dx):
        """See `AbstractShapeSection.turned`. The corners of the triangles are turned."""
        vertices, faces = Triangles.unpacked(self.packed)
        turn = Placed.about_middle(self.shape(math.inf), angles)
        return mesh_of(Triangles(turn.moved(vertices), faces).packed(), dx)

    def corners(self):
        """See `AbstractShapeSection.corners`."""
        return Triangles.unpacked(self.packed).vertices

    def notices(self, key, dx):
        """See `AbstractShapeSection.notices`."""
        thin = thin_places(self.packed, dx)
        if not len(thin):
            return []
        place = ", ".join(f"{a:.3g}" for a in thin[0])
        return [
            f"{key} is thinner than two spacings near ({place}) m: water on the two sides of such a wall "
            "interacts; use a smaller dx, or thicken the wall"
        ]


def _check_radius(radius: float, key: str, dx: float) -> None:
    if radius < dx:
        raise CaseError(f"{key}.radius = {radius:g} m: must be at least one spacing (dx = {dx:g} m)")
