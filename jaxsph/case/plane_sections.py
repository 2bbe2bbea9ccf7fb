"""Sections of shapes: base class, blocks, and shapes in the x-z plane."""

from __future__ import annotations

import abc
import math

import numpy as np
import shapely
from pydantic import model_validator
from shapely.validation import explain_validity

from jaxsph.case.section import Coordinate, Length, Point, Section
from jaxsph.errors import CaseError
from jaxsph.solids.composed import Placed
from jaxsph.solids.plate import Plate
from jaxsph.solids.shapes import AbstractShape, Block, Disc, Polygon, box_corners_of

Place = tuple[Coordinate, Coordinate, Coordinate]
Corners = tuple[tuple[Coordinate, Coordinate], ...]


class AbstractShapeSection(Section):
    """Parameters of one shape in its position at rest."""

    @property
    def dim(self) -> int:
        """Number of dimensions of the shape."""
        return 3

    @abc.abstractmethod
    def check(self, key: str, dx: float) -> None:
        """**Raises** CaseError, which names `key`, if no particle of spacing dx (m) fits in the shape."""

    @abc.abstractmethod
    def shape(self, dx: float) -> AbstractShape:
        """Shape with the parameters of this section; `dx`: spacing of the particles, m."""

    def turned(self, angles: Place, dx: float) -> AbstractShape:
        """Shape turned about the middle of its extent by three angles (rad); see `ShapeSection.turned`."""
        return Placed.about_middle(self.shape(dx), angles)

    def notices(self, key: str, dx: float) -> list[str]:
        """Notices about a shape that the particles of spacing dx (m) resolve badly; empty by default."""
        return []

    def corners(self) -> np.ndarray:
        """Points `[K, D]` (m) that span the extent of the shape: by default the corners of its bounds."""
        low, high = self.shape(math.inf).bounds()
        return box_corners_of(low, high)


class BlockSection(AbstractShapeSection):
    """A box with its faces normal to the axes, in its position at rest."""

    low: Point
    """Corner with the smallest coordinates, (x, z) or (x, y, z), m."""
    high: Point
    """Corner with the largest coordinates, m."""

    @model_validator(mode="after")
    def _extent(self) -> BlockSection:
        given = f"low = {list(self.low)} and high = {list(self.high)}"
        if len(self.low) != len(self.high):
            raise ValueError(f"{given} must have the same number of coordinates")
        if not all(a < b for a, b in zip(self.low, self.high, strict=True)):
            raise ValueError(f"every coordinate of low must be less than that of high, but {given}")
        return self

    @property
    def dim(self):
        """See `AbstractShapeSection.dim`."""
        return len(self.low)

    def check(self, key, dx):
        """See `AbstractShapeSection.check`."""
        least = min(b - a for a, b in zip(self.low, self.high, strict=True))
        if least < 0.5 * dx:
            raise CaseError(
                f"{key} is {least:g} m thick, but must be at least half a spacing, {0.5 * dx:g} m"
            )

    def shape(self, dx):
        """See `AbstractShapeSection.shape`."""
        return Block(self.low, self.high)

    def notices(self, key, dx):
        """Notice if a face does not lie midway between two particles; the notice proposes a dx that fits all
        faces, if such a dx exists."""
        faces = np.array([*self.low, *self.high])
        off = np.abs(faces / dx - np.round(faces / dx)) * dx
        if off.max() < 1e-3 * dx:
            return []
        worst = int(off.argmax())
        # the largest spacing that divides all faces, found in whole micrometres
        common = math.gcd(*(round(face * 1e6) for face in faces)) * 1e-6
        fits = f"no dx close to {dx:g} m fits all faces of the block"
        if common >= 0.25 * dx:
            fits = f"dx = {common / max(1, math.ceil(common / dx - 1e-9)):.4g} m fits all faces of the block"
        return [
            f"{key}: the face at {faces[worst]:g} m is {off[worst]:.3g} m from the nearest plane midway "
            f"between particles of the lattice (dx = {dx:g} m): the particles next to the face are not half "
            f"a spacing from it, although the volume of the water is correct; {fits}"
        ]


class AbstractPlaneSection(AbstractShapeSection):
    """Parameters of one shape in the x-z plane, in its position at rest."""

    @property
    def dim(self):
        """See `AbstractShapeSection.dim`."""
        return 2


class OutlineSection(AbstractPlaneSection):
    """Corners of a polygon in the x-z plane, in order along its outline."""

    outline: Corners
    """Corners (x, z), m."""

    def check(self, key, dx):
        """See `AbstractShapeSection.check`."""
        check_outline(self.outline, key, dx)

    def shape(self, dx):
        """See `AbstractShapeSection.shape`."""
        return Polygon(self.outline)

    def corners(self):
        """See `AbstractShapeSection.corners`."""
        return np.asarray(self.outline)


class DiscSection(AbstractPlaneSection):
    """A circular cylinder across a two-dimensional tank, in its position at rest."""

    centre: tuple[Coordinate, Coordinate]
    """Centre (x, z), m."""
    radius: Length
    """Radius, m."""

    def check(self, key, dx):
        """See `AbstractShapeSection.check`."""
        if self.radius <= 0.5 * dx:
            raise CaseError(
                f"{key}.radius = {self.radius:g} m: must be more than half a spacing (dx = {dx:g} m)"
            )

    def shape(self, dx):
        """See `AbstractShapeSection.shape`."""
        return Disc(self.centre, self.radius)

    def corners(self):
        """See `AbstractShapeSection.corners`."""
        return poles(self.centre, self.radius)


class PlateSection(AbstractPlaneSection):
    """A straight thin plate of any inclination; water on one side does not act on water on the other side."""

    foot: tuple[Coordinate, Coordinate]
    """Midpoint (x, z) of one end, m."""
    head: tuple[Coordinate, Coordinate]
    """Midpoint (x, z) of the other end, m."""
    thickness: Length
    """Thickness, m; at least half a spacing."""

    def check(self, key, dx):
        """See `AbstractShapeSection.check`. The plate must be large enough for the ghosts on its faces."""
        length = math.dist(self.foot, self.head)
        if length < max(2.0 * dx, self.thickness):
            raise CaseError(
                f"{key} is {length:.4g} m long from foot to head; the length must be at least the "
                f"thickness, and at least two spacings of {dx:g} m"
            )
        if self.thickness < 0.45 * dx:
            raise CaseError(
                f"{key}.thickness = {self.thickness:g} m is less than half a spacing of {dx:g} m: the "
                "plate would not act on the particles beyond its ends; use dx of at most "
                f"{2 * self.thickness:g} m"
            )

    def shape(self, dx):
        """See `AbstractShapeSection.shape`."""
        return Plate(self.foot, self.head, self.thickness)

    def corners(self):
        """See `AbstractShapeSection.corners`."""
        return np.array([self.foot, self.head])


def check_outline(corners: Corners, key: str, dx: float) -> None:
    """**Raises** CaseError, which names `key`, if sides between the corners cross or touch, or if the
    enclosed area is too thin to contain a particle of spacing dx (m)."""
    sides = np.roll(corners, -1, axis=0) - np.asarray(corners)
    lengths = np.hypot(*sides.T)
    if lengths.min() < 1e-3 * dx:
        here = int(lengths.argmin())
        raise CaseError(
            f"{key}: corners {here} and {(here + 1) % len(corners)} are at the same place, "
            f"{list(corners[here])}; remove one of them (the outline closes by itself)"
        )
    whole = shapely.Polygon(corners)
    if not whole.is_valid:
        raise CaseError(f"{key}: the sides must not cross or touch each other ({explain_validity(whole)})")
    if whole.buffer(-0.5 * dx, join_style="mitre", mitre_limit=20.0).is_empty:
        raise CaseError(
            f"{key} is everywhere thinner than a spacing (dx = {dx:g} m), and contains no particle: "
            "use a thicker shape, or a smaller dx"
        )


def poles(centre: tuple[float, ...], radius: float) -> np.ndarray:
    """Ends `[2 D, D]` (m) of the diameters of a disc or sphere along the axes; `centre` and `radius` in m."""
    axes = np.eye(len(centre))
    return np.asarray(centre) + radius * np.concatenate([axes, -axes])
