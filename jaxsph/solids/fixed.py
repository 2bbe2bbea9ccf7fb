"""Solids at rest: the walls of the tank, a plate that pierces the surface, a raised bed."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp

from jaxsph.model.interfaces import AbstractSolid
from jaxsph.solids.box import SIDES, Platform, WallPlate
from jaxsph.solids.contact import corner_push, spring

__all__ = ["PlatformBed", "TankWalls", "ThinPlate"]


class TankWalls(AbstractSolid):
    """Walls of a tank at rest: a moving wall at its low end of the first axis is another solid."""

    low: tuple[float, ...] = eqx.field(static=True)
    high: tuple[float, ...] = eqx.field(static=True)
    """Extent of the water's domain, m."""
    sides: tuple[str, ...] = eqx.field(static=True)
    """Bounds of every axis, as in `Box`: where there is no wall the extent only says how far the fluid may
    go."""
    paddle: bool = eqx.field(static=True, default=False)
    """Whether the low wall of the first axis is a moving one."""
    name: str = eqx.field(static=True, default="", kw_only=True)

    def push(self, own, x, dx, c0):
        """See `AbstractSolid`."""
        del own
        low, high = jnp.asarray(self.low, x.dtype), jnp.asarray(self.high, x.dtype)
        ends = [SIDES[side] for side in self.sides]
        floor = [float(end[0] and not (self.paddle and axis == 0)) for axis, end in enumerate(ends)]
        lid = [float(end[1]) for end in ends]
        return jnp.asarray(floor, x.dtype) * spring(x - low, dx, c0) - jnp.asarray(lid, x.dtype) * spring(
            high - x, dx, c0
        )

    def entered(self, own, x, dx):
        """See `AbstractSolid`."""
        del own
        low, high = jnp.asarray(self.low, x.dtype), jnp.asarray(self.high, x.dtype)
        under = x < low - 0.5 * dx
        if self.paddle:
            under = under.at[:, 0].set(False)
        over = x > high + 0.5 * dx
        # over an open rim water is on its way out, beside the tank too
        gone = over[:, -1] & (self.sides[-1] == "spill")
        return jnp.any(under | over, axis=1) & ~gone


class ThinPlate(AbstractSolid):
    """A vertical plate that pierces the surface."""

    plate: WallPlate = eqx.field(static=True)
    name: str = eqx.field(static=True, default="", kw_only=True)

    def push(self, own, x, dx, c0):
        """See `AbstractSolid`."""
        del own
        plate = self.plate
        beside = jnp.abs(x[:, 0] - plate.middle) - 0.5 * plate.thickness
        side = jnp.where(x[:, 0] < plate.middle, -1.0, 1.0)
        along, up = corner_push(beside, plate.tip - x[:, -1], lambda gap: spring(gap, dx, c0))
        return jnp.zeros_like(x).at[:, 0].add(side * along).at[:, -1].add(-up)

    def entered(self, own, x, dx):
        """See `AbstractSolid`."""
        del own
        plate = self.plate
        depth = jnp.minimum(x[:, 0] - plate.x0, plate.x1 - x[:, 0])
        return (depth > 0.4 * plate.thickness) & (x[:, -1] > plate.tip + 0.5 * dx)


class PlatformBed(AbstractSolid):
    """A raised bed at the tank's far end."""

    platform: Platform = eqx.field(static=True)
    name: str = eqx.field(static=True, default="", kw_only=True)

    def push(self, own, x, dx, c0):
        """See `AbstractSolid`."""
        del own
        platform = self.platform
        beside, above = platform.start - x[:, 0], x[:, -1] - platform.height
        along, up = corner_push(beside, above, lambda gap: spring(gap, dx, c0))
        return jnp.zeros_like(x).at[:, 0].add(-along).at[:, -1].add(up)

    def entered(self, own, x, dx):
        """See `AbstractSolid`."""
        del own
        inside = jnp.minimum(x[:, 0] - self.platform.start, self.platform.height - x[:, -1])
        return inside > 0.5 * dx
