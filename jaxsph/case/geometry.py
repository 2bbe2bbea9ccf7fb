"""Cases: a validated description in SI units, and `build`, which turns it into a model and a state.

Everything that fixes an array's shape is spent here, on the host. Lengths are snapped to the lattice of
spacing dx, and `Case.notices` says what became of each.
"""

from __future__ import annotations

import numpy as np

from jaxsph.case.sections import (
    BodySection,
    Device,
    Sections,
)
from jaxsph.errors import CaseError
from jaxsph.solids.box import Platform, WallPlate
from jaxsph.solids.divisions import (
    AbstractThinWall,
    DiagonalDivision,
    FivePartDivision,
    HorizontalDivision,
    MultiNodeGhosts,
    RegionalGhosts,
)
from jaxsph.solids.shapes import AbstractShape, Block, Disc, Polygon


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
        self.plate: WallPlate | None = None
        self.platform: Platform | None = None
        self.chamber_length = 0.0
        self.solid: AbstractShape | None = None

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
    def of(cls, case: Sections) -> Geometry:
        """Snaps every length of the case. **Raises** CaseError for what does not fit."""
        geometry = cls(case.dx)
        tank = case.tank
        geometry.depth = geometry.snap("tank.depth", tank.depth, least=4, slack=0.1)
        geometry.length = geometry.snap("tank.length", tank.length, least=4, slack=0.1)
        geometry.width = None
        if tank.width is not None:
            geometry.width = geometry.snap("tank.width", tank.width, least=4, slack=0.1)
        geometry._column(case)
        over = 0.1 + 0.1 * tank.depth
        if case.waves is not None:
            # in most waves the depth's: another height makes no other shapes
            over = max(tank.depth, 0.1 + 3.0 * case.waves.H)
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

    def _body(self, case: Sections) -> None:
        if case.body is None:
            return
        if case.device is not None:
            raise CaseError("body: a tank holds a body or a device with a chamber: remove one")
        if case.tank.walls == "mirror":
            raise CaseError('tank.walls = "mirror": a body needs "dummy" walls')
        self.solid = solid = _shape(case.body)
        points = solid.dummies(self.dx, case.layers)
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

    def _column(self, case: Sections) -> None:
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

    def _device(self, case: Sections) -> None:
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
        wall = thin_wall(device)
        thickness = device.wall_thickness
        try:
            wall.check(WallPlate(0.0, thickness, 0.0), self.dx, case.layers)
        except ValueError as error:
            raise CaseError(f"device.{error}") from None
        x1 = float(np.round(self.length - self.chamber_length, 12))
        x0 = float(np.round(x1 - thickness, 12))
        self.plate = WallPlate(x0, x1, self.depth - draught)
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
        self.platform = Platform(float(np.round(self.length - length, 12)), height)

    def _fits(self, case: Sections) -> None:
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


def thin_wall(device: Device) -> AbstractThinWall:
    """Way in which the ghosts of a device's plate are placed."""
    division = {
        "a": DiagonalDivision,
        "b": HorizontalDivision,
        "c": FivePartDivision,
    }[device.division]()
    return {
        "regional": RegionalGhosts,
        "multi_node": MultiNodeGhosts,
    }[device.thin_wall](division)


def _shape(body: BodySection) -> AbstractShape:
    if body.block is not None:
        return Block(body.block.low, body.block.high)
    if body.polygon is not None:
        return Polygon(body.polygon)
    return Disc(body.disc.centre, body.disc.radius)
