"""Geometry of a case with particles of spacing dx: tank, plate, platform, solids and probes, in metres.

Lengths of the tank and the platform, and the plate's draught, are rounded to a whole number of spacings, and
`Geometry.notices` lists the changes. CaseError is raised if a length would change too much.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from typing import Any

import numpy as np

from jaxsph.case.chambers import Tank
from jaxsph.case.pools import WaterSurface, water_surfaces
from jaxsph.case.sections import DEVICE_CHAMBER, Device, Sections
from jaxsph.case.shape_sections import SolidSection
from jaxsph.case.shapes import (
    Points,
    carriers,
    check_apart,
    check_inside,
    in_order,
    inertia_of,
    initial_shape,
    shape_of,
    turned,
)
from jaxsph.errors import CaseError
from jaxsph.solids.box import Box, Platform, WallPlate
from jaxsph.solids.divisions import (
    AbstractThinWall,
    DiagonalDivision,
    FivePartDivision,
    HorizontalDivision,
    MultiNodeGhosts,
    RegionalGhosts,
    Regions,
)
from jaxsph.solids.shapes import AbstractShape, Block
from jaxsph.waves import theory

ON_WALL = 1e-6
"""Largest distance from a wall at which a probe is treated as a probe on the wall, m."""

PADDLE_GAUGE = 4.8
"""Distance from the paddle's face at which active absorption measures the elevation, in spacings."""


class Geometry:
    """Lengths of a case (m), rounded to whole spacings; `notices` lists the lengths that rounding changed."""

    dx: float
    length: float
    depth: float
    height: float
    width: float | None
    """Width of the tank, m; None in two dimensions."""
    column: float
    """Length of the part of the tank that is filled to the full depth at the start, m."""
    layer: float
    """Depth of the water in the remaining part of the tank at the start, m; 0 if this part is dry."""
    stroke: float
    """Stroke of the paddle from end to end, m; 0 without waves."""
    withdrawal: float
    """Length of the bed behind the paddle at rest, m; 0 without waves. In most waves this length does not
    depend on the wave height, so that the shapes of arrays do not depend on the wave height either."""
    plate: WallPlate | None
    platform: Platform | None
    stretches: dict[str, WaterSurface]
    """Water surfaces below chambers, by the chambers' names."""
    bodies: dict[str, AbstractShape]
    """Shapes of the rigid bodies at rest, by name; a body comes after the body to which it is joined."""
    solids: dict[str, AbstractShape]
    """Shapes of the fixed solids, by name."""
    gauges: tuple[float, ...]
    surface: Points
    pressure: Points
    velocity: Points
    """Positions of the probes, m. Probes on a wall that rounding moved are moved with the wall."""
    notices: list[str]
    initial: dict[str, AbstractShape]
    """Shapes of all solids, and of the bodies at their initial angles, by name."""
    rounded: dict[str, float]
    """Lengths that are rounded to a whole number of spacings, by key, m."""

    def __init__(self, dx: float) -> None:
        """Empty geometry for the spacing dx (m)."""
        self.dx = dx
        self.notices, self.rounded, self.bodies, self.solids, self.stretches = [], {}, {}, {}, {}
        self.keys: dict[str, str] = {}
        self.length = self.depth = self.height = self.column = self.layer = self.stroke = 0.0
        self.withdrawal = 0.0
        self.width = self.plate = self.platform = None
        self.gauges = self.surface = self.pressure = self.velocity = ()

    @classmethod
    def of(cls, case: Sections) -> Geometry:
        """Geometry of a case. **Raises** CaseError if a part does not fit."""
        geometry = cls(case.dx)
        geometry._tank(case)
        geometry._column(case)
        geometry._device(case)
        geometry._bodies(case)
        geometry._solids(case)
        geometry._chambers(case)
        geometry._probes(case)
        if case.waves is not None:
            geometry.stroke = case.waves.stroke(geometry.depth, case.g)
        if case.near_end_moves:
            # the paddle needs more than half a stroke, for drift and absorption
            stroke = max(geometry.stroke, theory.largest_stroke(geometry.depth))
            geometry.withdrawal = 1.5 * stroke + 2 * case.dx
        return geometry

    @property
    def upper(self) -> list[float]:
        """Upper end of the tank along every axis, m; the lower end is 0."""
        return [self.length, *([] if self.width is None else [self.width]), self.height]

    def box(self, case: Sections) -> Box:
        """Box of the tank's walls."""
        sides = ("walls",) * (case.dim - 1) + ("spill" if case.tank.rim == "open" else "floor",)
        low = (case.near, *[0.0] * (case.dim - 1))
        return Box(low, tuple(self.upper), case.near_end_moves, self.withdrawal, sides)

    @property
    def front(self) -> float:
        """Length of the water in front of the device, m; without a device, length of the tank."""
        return self.length if self.plate is None else self.plate.x0

    def snap(self, name: str, value: float, least: int = 1, slack: float = 0.34) -> float:
        """Length `value` (m), rounded to a whole number of spacings that is at least `least`.

        **Raises** CaseError if rounding changes the length by more than the fraction `slack`.
        """
        count = max(int(np.floor(value / self.dx + 0.5 + 1e-9)), least)
        snapped = count * self.dx
        if abs(snapped - value) > slack * value:
            raise CaseError(
                f"{name} = {value:g} m does not fit dx = {self.dx:g} m: the length would be rounded "
                f"to {snapped:g} m; use dx of at most {value / least:.4g} m that divides this length"
            )
        if abs(snapped - value) > 1e-6 * value:
            self.notices.append(
                f"{name} = {value:g} m is not a whole number of spacings of {self.dx:g} m: "
                f"it becomes {snapped:.6g} m"
            )
        self.rounded[name] = float(np.round(snapped, 12))
        return self.rounded[name]

    def _rounded_up(self, height: float) -> float:
        """Height (m) rounded up to a whole number of spacings."""
        return float(np.ceil(height / self.dx - 1e-9) * self.dx)

    def _tank(self, case: Sections) -> None:
        """Sets the length, width, depth and height of the tank."""
        tank = case.tank
        self.depth = self.snap("tank.depth", tank.depth, least=4, slack=0.1)
        self.length = self.snap("tank.length", tank.length, least=4, slack=0.1)
        if tank.width is not None:
            self.width = self.snap("tank.width", tank.width, least=4, slack=0.1)
        over = 0.1 + 0.1 * tank.depth
        if case.waves is not None:
            # in most waves the depth is the larger value, so array shapes do not depend on the wave height
            over = max(tank.depth, 0.1 + 3.0 * case.waves.highest(tank.depth, case.g))
        if tank.column is not None:
            over = 3.0 * tank.depth  # the jet at the far wall reaches twice the depth if all energy is kept
        height = tank.height if tank.height is not None else tank.depth + max(over, 8 * case.dx)
        if height <= tank.depth:
            raise CaseError(f"tank.height = {height:g} m: must be more than tank.depth = {tank.depth:g} m")
        self.height = self._rounded_up(height)

    def _column(self, case: Sections) -> None:
        """Sets the length of the column, by default the length of the tank, and the depth of the layer."""
        self.column = self.length
        if case.tank.column is None:
            if case.tank.layer is not None:
                raise CaseError(
                    f"tank.layer = {case.tank.layer:g} m is the depth of water beyond a released "
                    "column: give tank.column too, or remove tank.layer"
                )
            return
        asked = f"tank.column = {case.tank.column:g} m"
        if case.tank.column > self.length:
            raise CaseError(f"{asked}: must be at most tank.length = {self.length:g} m")
        for name in ("waves", "device", "start"):
            if getattr(case, name) is not None:
                raise CaseError(
                    f"{asked} is the length of a released column, but [{name}] needs still water in the "
                    f"whole tank: remove tank.column or [{name}]"
                )
        self.column = min(self.snap("tank.column", case.tank.column, least=4, slack=0.1), self.length)
        if case.tank.layer is not None:
            self.layer = self.snap("tank.layer", case.tank.layer, slack=1.0)
            if self.layer >= self.depth:
                raise CaseError(
                    f"tank.layer = {case.tank.layer:g} m: must be less than the column's depth, "
                    f"tank.depth = {self.depth:g} m"
                )

    def _device(self, case: Sections) -> None:
        """Sets the plate and the platform of the OWC."""
        device = case.device
        if device is None:
            for key in ("pto", "air"):
                if getattr(case, key) is not None:
                    raise CaseError(
                        f"{key} is given, but there is no device with a chamber: give [device], or write "
                        f"[chamber.NAME.{key}] for a chamber between other walls"
                    )
            return
        if self.width is not None:
            raise CaseError(
                f"tank.width = {self.width:g} m: a device needs a two-dimensional tank; remove tank.width, "
                "or replace [device] by solids and a [chamber.NAME]"
            )
        if device.chamber_length < 3.0 * self.dx:
            raise CaseError(
                f"device.chamber_length = {device.chamber_length:g} m is "
                f"{device.chamber_length / self.dx:.1f} spacings of dx = {self.dx:g} m long, and must be at "
                f"least three: use dx of at most {device.chamber_length / 3:.4g} m"
            )
        draught = self.snap("device.draught", device.draught, 2)
        if draught > self.depth - 2 * self.dx:
            raise CaseError(
                f"device.draught = {device.draught:g} m: the plate must leave at least two spacings "
                f"of water below it; use at most {self.depth - 2 * self.dx:g} m"
            )
        thickness = device.wall_thickness
        try:
            thin_wall(device).check(WallPlate(0.0, thickness, 0.0), self.dx, case.layers)
        except ValueError as error:
            raise CaseError(f"device.{error}") from None
        x1 = float(np.round(self.length - device.chamber_length, 12))
        x0 = float(np.round(x1 - thickness, 12))
        self.plate = WallPlate(x0, x1, self.depth - draught)
        if self.plate.x0 < 4 * self.dx:
            raise CaseError(
                f"tank.length = {case.tank.length:g} m leaves less than four spacings of water in front of "
                "the device: use a larger tank.length, or a smaller device.chamber_length"
            )
        if device.platform_height:
            self._platform(device, device.platform_length, device.platform_height)

    def _platform(self, device: Device, length: float, height: float) -> None:
        """Sets the platform, a raised bed under the OWC."""
        length = self.snap("device.platform_length", length, least=4, slack=0.1)
        height = self.snap("device.platform_height", height, least=1, slack=0.1)
        if height > self.plate.tip - 2 * self.dx:
            raise CaseError(
                f"device.platform_height = {device.platform_height:g} m: must leave at least two spacings of "
                f"water under the plate; use at most {self.plate.tip - 2 * self.dx:g} m"
            )
        if length > self.length - 4 * self.dx:
            raise CaseError(
                f"device.platform_length = {device.platform_length:g} m: must leave at least four spacings "
                f"of water in front of the platform; use at most {self.length - 4 * self.dx:g} m"
            )
        self.platform = Platform(float(np.round(self.length - length, 12)), height)

    def _bodies(self, case: Sections) -> None:
        """Sets the shapes of the rigid bodies, in the order of their joints; they must be inside the tank."""
        sections = in_order(case)
        if sections and case.device is not None:
            keys = ", ".join(f"[{case.body_key(name)}]" for name in sections)
            raise CaseError(f"a tank has either bodies ({keys}) or a [device]: remove one of the two")
        for name, section in sections.items():
            key = self.keys[name] = case.body_key(name)
            for index, point in enumerate(section.sensors):
                if len(point) != case.dim:
                    raise CaseError(
                        f"{key}.sensors[{index}] = {list(point)}: must have {case.dim} coordinates"
                    )
            self.bodies[name] = shape_of(section, key, case.dim, self.dx)
            inertia_of(section, self.bodies[name], key)  # raises an error if the inertia is impossible
            corners, carried_by = section.corners(), carriers(sections, name)
            for carrier in carried_by:
                corners = turned(corners, carrier)
            self._heightened(case, corners)
            # a body's dummy particles are half a spacing inside its surface, and must be in the tank
            check_inside(corners, key, self.upper, 0.5 * self.dx)
            self.notices += section.notices(
                key, self.dx, any(np.any(carrier.angle) for carrier in carried_by)
            )

    def _solids(self, case: Sections) -> None:
        """Sets the shapes of the fixed solids, which must be inside the tank and must not overlap."""
        if (case.solid or case.every_body) and case.tank.walls not in (None, "dummy"):
            raise CaseError(
                f'tank.walls = "{case.tank.walls}": a body or a solid needs "dummy" walls; remove tank.walls'
            )
        walls = list(self._moved_walls(case))
        solids = {name: self._solid_with_walls(name, one, walls) for name, one in case.solid.items()}
        for name, section in solids.items():
            self.solids[name] = shape_of(section, f"solid.{name}", case.dim, self.dx)
            self._heightened(case, section.corners())
        for name, section in solids.items():
            check_inside(section.corners(), f"solid.{name}", self.upper, 1e-6)
            self.notices += section.notices(f"solid.{name}", self.dx, False)
        bodies = case.every_body
        carried = {key: carriers(bodies, name) for name, key in self.keys.items()}
        self.initial = {
            name: initial_shape(one, carried.get(name, ())) for name, one in self.named_shapes().items()
        }
        check_apart(self.initial, self.dx)
        self._check_regions(case)

    def _check_regions(self, case: Sections) -> None:
        """**Raises** CaseError if there are too many thin plates to distinguish the regions of water."""
        upright, division = () if self.plate is None else (self.plate,), thin_wall(case.device).division
        try:
            Regions.of(upright, division, self.platform, self.solids.values())
        except ValueError as error:
            raise CaseError(
                f"solid: {error}, or give a wall of three spacings or more as a block or a polygon"
            ) from None

    def _chambers(self, case: Sections) -> None:
        """Sets the stretches of the water surface below chambers."""
        if case.pto is not None and DEVICE_CHAMBER in case.chamber:
            raise CaseError(
                f"chamber.{DEVICE_CHAMBER}: [pto] belongs to the device's chamber, which already has this "
                "name; give this section another name"
            )
        if case.air is not None and case.pto is None:
            raise CaseError("air: compressible air needs a turbine in [pto]: give [pto], or remove [air]")
        shapes = self.named_shapes()
        tank = Tank(shapes, self.bodies, self.length, self.width, self.depth, self.height, self.dx)
        self.stretches = water_surfaces(case, tank)

    def _solid_with_walls(self, name: str, section: SolidSection, walls: list) -> SolidSection:
        """Section of a solid; corners on walls that rounding has shifted are shifted with the walls."""
        if section.polygon is not None:
            corners = (
                self._with_walls(f"solid.{name}.polygon[{index}]", corner, walls)
                for index, corner in enumerate(section.polygon)
            )
            return section.model_copy(update={"polygon": tuple(corners)})
        for shape, ends in (("block", ("low", "high")), ("plate", ("foot", "head"))):
            if (one := getattr(section, shape)) is not None:
                keys = ((end, f"solid.{name}.{shape}.{end}") for end in ends)
                moved = {end: self._with_walls(key, getattr(one, end), walls) for end, key in keys}
                return section.model_copy(update={shape: one.model_copy(update=moved)})
        return section

    @property
    def shapes(self) -> dict[str, AbstractShape]:
        """Shapes of the bodies and of the fixed solids, by name."""
        return self.bodies | self.solids

    @functools.cached_property
    def areas(self) -> dict[str, Any]:
        """Areas of the `initial` shapes in the x-z plane, by name, as geometries of `shapely`."""
        return {name: shape.region() for name, shape in self.initial.items()}

    def named_shapes(self) -> dict[str, AbstractShape]:
        """Shapes of all solids in the tank, by their names in a case."""
        found = {self.keys[name]: shape for name, shape in self.bodies.items()}
        found |= {f"solid.{name}": shape for name, shape in self.solids.items()}
        if self.plate is not None:
            found["device"] = Block((self.plate.x0, self.plate.tip), (self.plate.x1, self.height))
        if self.platform is not None:
            found["device.platform"] = Block((self.platform.start, 0.0), (self.length, self.platform.height))
        return found

    def _heightened(self, case: Sections, corners: np.ndarray) -> None:
        """Raises the tank's walls to four spacings above corners `[K, D]` (m), unless the case gives the
        height of the walls."""
        if case.tank.height is None:
            self.height = max(self.height, self._rounded_up(float(corners[:, -1].max()) + 4 * self.dx))

    def _probes(self, case: Sections) -> None:
        """Sets the positions of gauges and sensors; probes on a wall that rounding moved are moved too."""
        walls = list(self._moved_walls(case))
        upper = self.upper
        self.gauges = tuple(
            self._with_walls(f"probes.gauges[{index}]", (x,), walls)[0]
            for index, x in enumerate(case.probes.gauges)
        )
        for index, x in enumerate(self.gauges):
            if not 0 <= x <= self.length:
                raise CaseError(
                    f"probes.gauges[{index}] = {x:g} m is outside the tank (0 to {self.length:g} m): move "
                    "the gauge into the tank"
                )
        for name, most in (("surface", upper[:-1]), ("pressure", upper), ("velocity", upper)):
            points = []
            axes = ", ".join(("xz" if self.width is None else "xyz")[: len(most)])
            for index, point in enumerate(getattr(case.probes, name)):
                key = f"probes.{name}[{index}]"
                if len(point) != len(most):
                    raise CaseError(f"{key} = {list(point)}: must be a position ({axes}), m")
                place = self._with_walls(key, point, walls)
                if not all(0 <= a <= b for a, b in zip(place, most, strict=True)):
                    raise CaseError(
                        f"{key} = {list(point)} is not inside the tank: move the point into the tank, which "
                        f"extends from 0 to {most} m"
                    )
                points.append(place)
            setattr(self, name, tuple(points))

    def _moved_walls(self, case: Sections) -> Iterator[tuple[str, int, float, float]]:
        """Name, axis, given position (m) and rounded position (m) of every wall that rounding moved."""
        tank, plate, device = case.tank, self.plate, case.device
        walls = [("the end wall", 0, tank.length, self.length)]
        if tank.width is not None:
            walls.append(("the side wall", 1, tank.width, self.width))
        if plate is not None:
            asked = tank.length - device.chamber_length
            walls.append(("the plate's inner face", 0, asked, plate.x1))
            walls.append(("the plate's outer face", 0, asked - device.wall_thickness, plate.x0))
        if self.platform is not None:
            front = tank.length - device.platform_length
            walls.append(("the platform's front", 0, front, self.platform.start))
        yield from (wall for wall in walls if abs(wall[2] - wall[3]) > ON_WALL)

    def _with_walls(self, name: str, point: tuple[float, ...], walls: list) -> tuple[float, ...]:
        """Point (m), moved with a wall if the point is on the wall, or moved into the tank if rounding
        shortened the tank."""
        place = list(point)
        for wall, axis, asked, there in walls:
            if axis >= len(point):
                continue  # a gauge has no y
            on_wall = abs(point[axis] - asked) <= ON_WALL
            beyond = wall in ("the end wall", "the side wall") and there < point[axis] <= asked
            if on_wall or beyond:
                place[axis] = there
                self.notices.append(
                    f"{name}: {point[axis]:g} m is on {wall}, which was moved by rounding to whole spacings; "
                    f"the position becomes {there:g} m"
                    if on_wall
                    else f"{name}: {point[axis]:g} m is behind {wall}, which was moved by rounding to whole "
                    f"spacings; the position becomes {there:g} m"
                )
        return tuple(place)


def walls_of(case: Sections) -> str:
    """Kind of the walls' ghosts, as a value of `tank.walls`."""
    return case.tank.walls or ("dummy" if case.every_body or case.solid else "images")


def thin_wall(device: Device | None) -> AbstractThinWall:
    """Method that places the ghosts of thin plates: that of the device, or the default without a device."""
    if device is None:
        return RegionalGhosts()
    division = {"a": DiagonalDivision, "b": HorizontalDivision, "c": FivePartDivision}[device.division]()
    return {"regional": RegionalGhosts, "multi_node": MultiNodeGhosts}[device.thin_wall](division)
