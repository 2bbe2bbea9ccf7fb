"""Sections that have a shape: the keys of all shapes, and fixed solids."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np
from pydantic import Field, model_validator

from jaxsph.case.plane_sections import (
    AbstractShapeSection,
    BlockSection,
    Corners,
    DiscSection,
    OutlineSection,
    PlateSection,
)
from jaxsph.case.section import Angle, Section
from jaxsph.case.volume_sections import (
    MOST_CORNERS,
    CapsuleSection,
    CylinderSection,
    ExtrusionSection,
    MeshSection,
    RevolutionSection,
    SphereSection,
)
from jaxsph.solids.composed import Placed
from jaxsph.solids.shapes import AbstractShape


class ShapeSection(Section):
    """A shape in its position at rest: a block, a polygon, a disc, or in three dimensions a sphere, a
    cylinder, a capsule, a solid of revolution, a prism or the inside of a mesh."""

    shapes: ClassVar[tuple[str, ...]] = (
        "block",
        "polygon",
        "disc",
        "sphere",
        "cylinder",
        "capsule",
        "revolution",
        "extrusion",
        "mesh",
    )
    """Keys of the shapes; a section gives exactly one of these keys."""

    block: BlockSection | None = None
    polygon: Corners | None = Field(None, min_length=3, max_length=MOST_CORNERS)
    """Corners (x, z) of a polygon in order along its outline, m."""
    disc: DiscSection | None = None
    sphere: SphereSection | None = None
    cylinder: CylinderSection | None = None
    capsule: CapsuleSection | None = None
    revolution: RevolutionSection | None = None
    extrusion: ExtrusionSection | None = None
    mesh: MeshSection | None = None
    turned: tuple[Angle, Angle, Angle] | None = None
    """Angles about the x-, y- and z-axis by which a three-dimensional shape is turned about the middle of its
    extent, in this order, rad; positive from y towards z, from z towards x, and from x towards y."""

    @model_validator(mode="after")
    def _one_shape(self):
        if sum(getattr(self, shape) is not None for shape in self.shapes) != 1:
            *first, last = self.shapes
            raise ValueError(f"give exactly one of {', '.join(first)} and {last}")
        if self.turned is not None and self.given.dim != 3:
            raise ValueError("turned is only for shapes in three dimensions; remove turned")
        return self

    @property
    def given(self) -> AbstractShapeSection:
        """Parameters of the shape that the section gives."""
        found = getattr(self, self.shape_key)
        return found if isinstance(found, AbstractShapeSection) else OutlineSection(outline=found)

    @property
    def shape_key(self) -> str:
        """Key of the shape that the section gives."""
        return next(key for key in self.shapes if getattr(self, key) is not None)

    def notices(self, name: str, dx: float, inclined: bool) -> list[str]:
        """Notices about a shape that the particles of spacing dx (m) resolve badly.

        `name` of the section; `inclined`: whether a body's initial angle turns the shape.
        """
        if self.block is not None and (inclined or self.turned is not None):
            return []  # the faces of such a block are not meant to fit the lattice
        return self.given.notices(f"{name}.{self.shape_key}", dx)

    def placed(self, dx: float) -> AbstractShape:
        """Shape at rest, turned by `turned`; `dx`: spacing of the particles, m."""
        return self.given.shape(dx) if self.turned is None else self.given.turned(self.turned, dx)

    def corners(self) -> np.ndarray:
        """Points `[K, D]` (m) that span the extent of the shape at rest."""
        corners = self.given.corners()
        if self.turned is None:
            return corners
        return Placed.about_middle(self.given.shape(math.inf), self.turned).moved(corners)


class SolidSection(ShapeSection):
    """A fixed solid, for example a sloping bed, a breakwater, a step, a caisson or a screen; you choose its
    name. It has exactly one shape."""

    shapes: ClassVar[tuple[str, ...]] = (*ShapeSection.shapes, "plate")

    plate: PlateSection | None = None
