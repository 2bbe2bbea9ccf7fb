"""Section of a mooring: a line from an anchor to a fairlead on a body."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field, model_validator

from jaxsph.case.body_sections import Position
from jaxsph.case.section import Length, Name, Section

PerLength = Annotated[float, Field(ge=1e-6, le=1e7)]
Shape = Annotated[float, Field(ge=0, le=100)]
Bedding = Annotated[float, Field(ge=0, le=1e12)]


class MooringSection(Section):
    """A mooring line from an anchor to a fairlead on a body.

    The properties describe a single line. `lines` is the number of identical lines (per metre of width in two
    dimensions).
    """

    kind: Literal["catenary", "line"] = "catenary"
    """Model of the line: static equilibrium at every time, or lumped masses with inertia and drag."""
    body: Name = "body"
    """Name of the body with the fairlead."""
    at: Position
    """Position (x, z) or (x, y, z) of the fairlead with the body at rest, m."""
    anchor: Position
    """Position (x, z) or (x, y, z) of the anchor, m; with z = 0, a part of the line may lie on the bed.
    Without y, fairlead and anchor have the y of the body's pivot."""
    length: Length
    """Length of the line without tension, m."""
    axial_stiffness: float = Field(ge=1e-3, le=1e13)
    """Axial stiffness EA, the tension per strain, N."""
    weight: PerLength | None = None
    """Weight per length in water, N/m; give it instead of mass and diameter."""
    mass: PerLength | None = None
    """Mass per length, kg/m; the weight in water follows from it and the diameter."""
    diameter: Length | None = None
    """Diameter of a circular section with the same displacement and drag as the line, m."""
    lines: float = Field(1.0, ge=1e-3, le=1e4)
    """Number of identical lines, in two dimensions per metre of width."""
    segments: int = Field(20, ge=2, le=400)
    """Number of segments of a line of lumped masses."""
    damping: float = Field(0.5, ge=0, le=10)
    """Internal damping of a segment, divided by l sqrt(EA m) (-), where l is the segment's length, EA the
    axial stiffness and m the mass per length."""
    drag: tuple[Shape, Shape] | None = None
    """Drag coefficients across and along the line (-)."""
    added_mass: tuple[Shape, Shape] = (1.0, 0.0)
    """Added mass coefficients across and along the line (-)."""
    bed_stiffness: Bedding = 3.0e6
    """Pressure of the bed on the line, divided by the line's depth below the bed's surface, Pa/m."""
    bed_damping: Bedding = 3.0e5
    """Pressure of the bed on the line, divided by the line's vertical speed, Pa s/m."""

    @model_validator(mode="after")
    def _whole_mooring(self) -> MooringSection:
        if (self.weight is None) == (self.mass is None) or (self.mass is None) != (self.diameter is None):
            raise ValueError("give either weight, or mass and diameter")
        dynamic = "segments", "damping", "drag", "added_mass", "bed_stiffness", "bed_damping"
        if self.kind == "catenary":
            self.refuse(dynamic, 'with kind = "catenary"', 'set kind = "line"')
        if self.kind == "line" and (self.mass is None or self.drag is None):
            raise ValueError('kind = "line" needs mass, diameter and drag; give all three')
        return self

    @property
    def area(self) -> float:
        """Area of the section, m2; zero if the diameter is not given."""
        return 0.25 * math.pi * (self.diameter or 0.0) ** 2

    def weight_in_water(self, rho0: float, g: float) -> float:
        """Weight per length (N/m) of one line in water of the density rho0 (kg/m3)."""
        if self.mass is None:
            return self.weight or 0.0
        return (self.mass - rho0 * self.area) * g
