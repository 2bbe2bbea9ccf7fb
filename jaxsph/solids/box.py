"""Geometry of a tank in plain numbers (box, thin plates, raised bed), and slip conditions at its walls."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxsph.core.arrays import Components
from jaxsph.core.pairs import Period


class FreeSlip(eqx.Module):
    """Free slip at a wall. In the viscous force, ghosts have the water's tangential velocity."""

    tangential: float = eqx.field(static=True, default=1.0)
    """Ratio of a ghost's tangential velocity to the water's, both relative to the wall (-)."""


class NoSlip(eqx.Module):
    """No slip at a wall. In the viscous force, ghosts have the water's reversed tangential velocity.

    The tangential velocity at the wall is then zero.
    """

    tangential: float = eqx.field(static=True, default=-1.0)
    """Ratio of a ghost's tangential velocity to the water's, both relative to the wall (-)."""


class WallPlate(eqx.Module):
    """Vertical plate through the water's surface, at x0 <= x <= x1 (m) and z >= tip (m).

    The lengths are leaves of the model, so that plates of different lengths share a program.
    """

    x0: float | Any
    x1: float | Any
    tip: float | Any

    @property
    def thickness(self) -> float | Any:
        """Plate thickness, m."""
        return self.x1 - self.x0

    @property
    def middle(self) -> float | Any:
        """Position x of the plate's middle plane, m."""
        return 0.5 * (self.x0 + self.x1)

    def is_thin(self, dx: float, layers: int) -> bool:
        """Whether the kernel, which spans `layers` spacings of `dx` (m), reaches through the plate.

        If so, the water on the two sides must be kept apart (`solids.divisions`).
        """
        return self.thickness <= layers * dx

    def across(self, x: Components) -> jax.Array:
        """Distance of points x (m) from the plate's middle plane, m; negative on the plate's left."""
        return x[0] - self.middle

    def past(self, x: Components) -> jax.Array:
        """Distance of points x (m) below the plate's tip, m; negative above the tip's level."""
        return self.tip - x[-1]


@dataclass(frozen=True)
class LeaningPlate:
    """Plate at any inclination in the x-z plane; water may pass one end, both ends or neither."""

    foot: tuple[float, float]
    """Middle (x, z) of one end of the plate, m."""
    head: tuple[float, float]
    """Middle (x, z) of the plate's other end, m."""
    thickness: float
    """Plate thickness, m."""

    @property
    def length(self) -> float:
        """Length of the plate from its foot to its head, m."""
        return math.dist(self.foot, self.head)

    @property
    def along(self) -> tuple[float, float]:
        """Unit vector (x, z) from the foot to the head; `across` is positive on the right of this vector."""
        (x0, z0), (x1, z1) = self.foot, self.head
        return (x1 - x0) / self.length, (z1 - z0) / self.length

    def across(self, x: Components) -> jax.Array:
        """Distance of points x (m) from the plate's middle plane, m; negative on the plate's left."""
        (ex, ez), (x0, z0) = self.along, self.foot
        return ez * (x[0] - x0) - ex * (x[-1] - z0)

    def past(self, x: Components) -> jax.Array:
        """Distance of points x (m) past the nearer end, measured along the plate, m; negative between the
        ends."""
        (ex, ez), (x0, z0) = self.along, self.foot
        return jnp.abs(ex * (x[0] - x0) + ez * (x[-1] - z0) - 0.5 * self.length) - 0.5 * self.length


AnyPlate = WallPlate | LeaningPlate
"""Type of a thin plate that keeps the water on its two sides apart."""


@dataclass(frozen=True)
class Platform:
    """Raised bed that fills x >= start, z <= height (m), up to the far end of the tank."""

    start: float
    height: float

    def in_front(self, x: Components) -> jax.Array:
        """Mask of points x (m): True in front of the platform's front face, False above its top.

        A particle pressed slightly into the platform keeps the ghosts of the face that it entered.
        """
        below = self.height - x[-1]
        return (below > 0) & (x[0] - self.start < below)


SIDES = {
    "walls": (True, True),
    "floor": (True, False),
    "spill": (True, False),
    "lid": (False, True),
    "open": (False, False),
    "periodic": (False, False),
}
"""Kinds of boundary along an axis. The two values state whether the low and the high end have a wall."""


@dataclass(frozen=True)
class Box:
    """Domain of the water, low <= x <= high (m), and the kind of boundary along each axis.

    **Raises** ValueError for an unknown kind of boundary, or if `low` is not below `high` along every axis.
    """

    low: tuple[float, ...]
    high: tuple[float, ...]
    paddle: bool = False
    """Whether the wall at the low end of the first axis moves."""
    stroke: float = 0.0
    """Largest displacement of the paddle towards negative x, m. The bed extends this far behind `low`."""
    sides: tuple[str, ...] = ()
    """Kind of boundary along each axis, one of `SIDES`; by default "floor" along the last axis and "walls"
    along the others.

    At an end without a wall, `low` or `high` is only a limit that the water must not pass.
    """

    far_moves: bool = False
    """Whether the wall at the high end of the first axis moves. The bed then extends by `stroke` behind
    `high`."""

    def __post_init__(self) -> None:
        """Fills in the default `sides`, and checks the sides and the extents."""
        if not self.sides:
            object.__setattr__(self, "sides", ("walls",) * (len(self.low) - 1) + ("floor",))
        wrong = [side for side in self.sides if side not in SIDES]
        if wrong or len(self.sides) != len(self.low):
            raise ValueError(f"sides = {self.sides}: give one of {', '.join(SIDES)} for every axis")
        if not all(a < b for a, b in zip(self.low, self.high, strict=True)):
            raise ValueError(f"low = {self.low} must be below high = {self.high} along every axis")

    @property
    def walls(self) -> np.ndarray:
        """Mask `[D, 2]` of the ends of the axes (low, high), True at an end with a wall."""
        return np.array([SIDES[side] for side in self.sides])

    @property
    def period(self) -> Period:
        """Periodic axes, each with its length (m)."""
        sides = enumerate(zip(self.low, self.high, self.sides, strict=True))
        return tuple((axis, float(b - a)) for axis, (a, b, side) in sides if side == "periodic")
