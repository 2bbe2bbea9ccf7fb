"""Solids at rest: the walls of the tank, a plate that pierces the surface, a raised bed."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp

from jaxsph.model.solids import AbstractSolid
from jaxsph.solids.box import SIDES, Platform, WallPlate
from jaxsph.solids.contact import corner_push, spring
from jaxsph.solids.shapes import box_corners

__all__ = ["PlatformBed", "TankWalls", "ThinPlate"]


class TankWalls(AbstractSolid):
    """Walls of a tank at rest.

    A moving wall at an end of the first axis is a separate solid, and is not included.
    """

    low: tuple[float, ...] = eqx.field(static=True)
    """Low ends of the water's domain along each axis, m."""
    high: tuple[float, ...] = eqx.field(static=True)
    """High ends of the water's domain along each axis, m."""
    sides: tuple[str, ...] = eqx.field(static=True)
    """Kind of boundary along each axis, one of `solids.box.SIDES`.

    At an end without a wall, `low` or `high` is only a limit that the water must not pass.
    """
    paddle: bool = eqx.field(static=True, default=False)
    """Whether the wall at the low end of the first axis moves."""
    far_moves: bool = eqx.field(static=True, default=False)
    """Whether the wall at the high end of the first axis moves."""
    name: str = eqx.field(static=True, default="", kw_only=True)

    def push(self, motion, x, dx, c0):
        """See `AbstractSolid`."""
        del motion
        low, high = jnp.asarray(self.low, x.dtype), jnp.asarray(self.high, x.dtype)
        ends = [SIDES[side] for side in self.sides]
        floor = [float(end[0] and not (self.paddle and axis == 0)) for axis, end in enumerate(ends)]
        lid = [float(end[1] and not (self.far_moves and axis == 0)) for axis, end in enumerate(ends)]
        return jnp.asarray(floor, x.dtype) * spring(x - low, dx, c0) - jnp.asarray(lid, x.dtype) * spring(
            high - x, dx, c0
        )

    def contains(self, motion, x, dx):
        """See `AbstractSolid`."""
        del motion
        low, high = jnp.asarray(self.low, x.dtype), jnp.asarray(self.high, x.dtype)
        under = x < low - 0.5 * dx
        if self.paddle:
            under = under.at[:, 0].set(False)
        over = x > high + 0.5 * dx
        if self.far_moves:
            over = over.at[:, 0].set(False)
        # water above an open rim counts as leaving the tank, not as inside a wall, even beside the tank
        gone = over[:, -1] & (self.sides[-1] == "spill")
        return jnp.any(under | over, axis=1) & ~gone


class ThinPlate(AbstractSolid):
    """Vertical plate at rest that pierces the water's surface."""

    plate: WallPlate
    """Geometry of the plate."""
    name: str = eqx.field(static=True, default="", kw_only=True)

    def push(self, motion, x, dx, c0):
        """See `AbstractSolid`."""
        del motion
        plate = self.plate
        beside = jnp.abs(x[:, 0] - plate.middle) - 0.5 * plate.thickness
        side = jnp.where(x[:, 0] < plate.middle, -1.0, 1.0)
        along, up = corner_push(beside, plate.tip - x[:, -1], lambda gap: spring(gap, dx, c0))
        return jnp.zeros_like(x).at[:, 0].add(side * along).at[:, -1].add(-up)

    def contains(self, motion, x, dx):
        """See `AbstractSolid`."""
        del motion
        plate = self.plate
        depth = jnp.minimum(x[:, 0] - plate.x0, plate.x1 - x[:, 0])
        return (depth > 0.4 * plate.thickness) & (x[:, -1] > plate.tip + 0.5 * dx)

    def outline(self, far):
        """See `AbstractSolid`."""
        return box_corners((self.plate.x0, self.plate.tip), (self.plate.x1, far))


class PlatformBed(AbstractSolid):
    """Raised bed at rest at the tank's far end."""

    platform: Platform = eqx.field(static=True)
    """Geometry of the bed."""
    name: str = eqx.field(static=True, default="", kw_only=True)

    def push(self, motion, x, dx, c0):
        """See `AbstractSolid`."""
        del motion
        platform = self.platform
        beside, above = platform.start - x[:, 0], x[:, -1] - platform.height
        along, up = corner_push(beside, above, lambda gap: spring(gap, dx, c0))
        return jnp.zeros_like(x).at[:, 0].add(-along).at[:, -1].add(up)

    def contains(self, motion, x, dx):
        """See `AbstractSolid`."""
        del motion
        inside = jnp.minimum(x[:, 0] - self.platform.start, self.platform.height - x[:, -1])
        return inside > 0.5 * dx

    def outline(self, far):
        """See `AbstractSolid`."""
        return box_corners((self.platform.start, -far), (far, self.platform.height))
