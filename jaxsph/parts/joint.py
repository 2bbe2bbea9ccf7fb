"""Joints of bodies to the tank or to another body."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.model.solids import AbstractJoint, turned
from jaxsph.parts.driven import AbstractPath

__all__ = ["MOTIONS", "PlanarJoint"]

MOTIONS = ("surge", "heave", "pitch")
"""Names of the coordinates of a planar joint, in order."""


class PlanarJoint(AbstractJoint):
    """Joint with the coordinates surge (m), heave (m) and pitch (rad), any of which may be free.

    With all three free the body floats, with pitch alone it is hinged, with surge or heave alone it slides,
    and with none it is fixed. Surge and heave are along the parent's axes, rotated by `angle`. A coordinate
    that is not free keeps its velocity. The coordinates are added to the `path`, a given motion.
    """

    free: tuple[bool, bool, bool] = eqx.field(static=True)
    """Whether surge, heave and pitch are free."""
    release: Scalar
    """Time at which the free motions are released, s."""
    parent: str = eqx.field(static=True, default="", kw_only=True)
    angle: float = eqx.field(static=True, default=0.0)
    """Inclination of the axis of surge to the x axis of the parent, rad, positive upwards."""
    velocity: tuple[float, float, float] = eqx.field(static=True, default=(0.0, 0.0, 0.0))
    """Velocities of surge, heave and pitch at t = 0, m/s, m/s, rad/s."""
    position: tuple[float, float, float] = eqx.field(static=True, default=(0.0, 0.0, 0.0))
    """Surge (m), heave (m) and pitch (rad) at t = 0."""
    path: tuple[AbstractPath, ...] = ()
    """Given motion of the body relative to its parent: one path, or an empty tuple for none."""

    @classmethod
    def of(cls, free: Sequence[str] = (), *, dtype: Any = jnp.float32, **options: Any) -> PlanarJoint:
        """Builds a joint with some of "surge", "heave" and "pitch" free; `options`: other fields by name."""
        release = jnp.asarray(options.pop("release", 0.0), dtype)
        surge, heave, pitch = (name in free for name in MOTIONS)
        return cls(free=(surge, heave, pitch), release=release, **options)

    @property
    def coordinates(self) -> tuple[tuple[str, str], ...]:
        """See `AbstractJoint`."""
        return tuple(zip(MOTIONS, ("m", "m", "rad"), strict=True))

    @property
    def driven(self) -> bool:
        """See `AbstractJoint`."""
        return bool(self.path) or any(
            v and not free for free, v in zip(self.free, self.velocity, strict=True)
        )

    @property
    def coasts(self) -> bool:
        """See `AbstractJoint`: True for a joint to the tank without a path, unless it turns and slides."""
        turns, slides = self.free[2] or self.velocity[2], any(self.free[:2])
        return not (self.parent or self.path or (turns and slides))

    @property
    def moves(self) -> tuple[bool, bool, bool]:
        """See `AbstractJoint`."""
        if self.path or (self.angle and any((*self.free[:2], *self.velocity[:2]))):
            return (True, True, any((self.path, self.free[2], self.velocity[2])))
        surge, heave, pitch = (bool(a or v) for a, v in zip(self.free, self.velocity, strict=True))
        return surge, heave, pitch

    def start(self, dtype):
        """See `AbstractJoint`."""
        return jnp.asarray(self.position, dtype), jnp.asarray(self.velocity, dtype)

    def pose(self, q, t):
        """See `AbstractJoint`."""
        if self.angle:
            # an angle is positive from x towards z, and a pitch from z towards x
            q = jnp.concatenate([turned(q[:2], jnp.asarray(-self.angle, q.dtype)), q[2:]])
        for path in self.path:
            q = q + path.pose(t)
        return q

    def movable(self, t) -> Float[Array, "3"]:
        """See `AbstractJoint`."""
        return jnp.asarray(self.free, t.dtype) * (t >= self.release).astype(t.dtype)
