"""Solid walls: fixed ghost particles with interpolation nodes, and the regional sets of thin walls.

A ghost stands in the wall; its node is its mirror image in the water. Each step the water's pressure and
velocity are interpolated at the nodes and carried to the ghosts (Zhu et al. 2020, Eq. 18-20), which are
from then on ordinary sources of the pair sums. Around a wall thinner than the kernel the water is divided
into regions that see different ghosts and not each other (their section 2.4.1). Which region sees which
set is a static matrix of booleans, packed into bit masks that the neighbour search applies.
"""

from __future__ import annotations

from dataclasses import dataclass

import equinox as eqx
import jax
import numpy as np

from jaxsph.core.arrays import Components
from jaxsph.core.pairs import (
    Period,
)


class FreeSlip(eqx.Module):
    """The tangential velocity is carried to the ghost as it is."""

    tangential: float = eqx.field(static=True, default=1.0)


class NoSlip(eqx.Module):
    """The tangential velocity is reversed, so that it vanishes at the wall."""

    tangential: float = eqx.field(static=True, default=-1.0)


@dataclass(frozen=True)
class WallPlate:
    """A vertical plate that pierces the surface: x0 <= x <= x1, from its tip upwards (m)."""

    x0: float
    x1: float
    tip: float

    @property
    def thickness(self) -> float:
        """Plate thickness, m."""
        return self.x1 - self.x0

    @property
    def middle(self) -> float:
        """x half-way between the faces, m."""
        return 0.5 * (self.x0 + self.x1)

    def is_thin(self, dx: float, layers: int) -> bool:
        """Whether the kernel, of so many layers, reaches through it: it needs what a thin wall needs."""
        return self.thickness <= layers * dx


@dataclass(frozen=True)
class Platform:
    """A raised bed: solid for x >= start and z <= height (m), to the end of the tank."""

    start: float
    height: float

    def in_front(self, x: Components) -> jax.Array:
        """True for what is beside its front rather than above its top: particles pressed a little into it
        stay under the ghosts of the face that they entered."""
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
"""What may bound an axis, and whether that is a wall at its low and at its high end."""


@dataclass(frozen=True)
class Box:
    """The domain, low <= x <= high (m), and what bounds it along each axis.

    **Raises** ValueError for a side that there is not, or an empty extent.
    """

    low: tuple[float, ...]
    high: tuple[float, ...]
    paddle: bool = False
    """Whether the first axis' low wall moves."""
    stroke: float = 0.0
    """Largest displacement of the paddle towards negative x, m: the bed reaches that far."""
    sides: tuple[str, ...] = ()
    """One of `SIDES` for every axis; by default a tank's: walls, and along the last axis a floor. Where there
    is no wall the box only says how far the fluid may go."""

    def __post_init__(self) -> None:
        """Fills in the default sides and checks them."""
        if not self.sides:
            object.__setattr__(self, "sides", ("walls",) * (len(self.low) - 1) + ("floor",))
        wrong = [side for side in self.sides if side not in SIDES]
        if wrong or len(self.sides) != len(self.low):
            raise ValueError(f"sides = {self.sides}: one of {', '.join(SIDES)} for every axis")
        if not all(a < b for a, b in zip(self.low, self.high, strict=True)):
            raise ValueError(f"low = {self.low} must be below high = {self.high} along every axis")

    @property
    def walls(self) -> np.ndarray:
        """`[D, 2]`, True where there is a wall at the low and the high end of an axis."""
        return np.array([SIDES[side] for side in self.sides])

    @property
    def period(self) -> Period:
        """Every periodic axis with its length, m."""
        sides = enumerate(zip(self.low, self.high, self.sides, strict=True))
        return tuple((axis, float(b - a)) for axis, (a, b, side) in sides if side == "periodic")
