"""Joints of bodies to the tank or to another body."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.model.rigid import PLANE, SPACE, AbstractSpace
from jaxsph.model.solids import AbstractJoint
from jaxsph.parts.driven import AbstractPath

__all__ = ["PlanarJoint", "SpatialJoint", "joint_of"]


class AbstractMotionsJoint(AbstractJoint):
    """Joint whose coordinates are the motions of `space`, any of which may be free.

    With all motions free the body floats, with one rotation alone it is hinged, with one displacement alone
    it slides, and with none it is fixed. The displacements are along the parent's axes, rotated by `angle`. A
    coordinate that is not free keeps its velocity. The coordinates are added to the `path`, a prescribed
    motion.
    """

    space: ClassVar[AbstractSpace]
    """Space of the motions."""
    free: tuple[bool, ...] = eqx.field(static=True)
    """Whether each motion is free."""
    release: Scalar
    """Time at which the free motions are released, s."""
    parent: str = eqx.field(static=True, default="", kw_only=True)
    angle: float = eqx.field(static=True, default=0.0)
    """Inclination of the axis of surge to the x axis of the parent, rad, positive upwards."""
    velocity: tuple[float, ...] = eqx.field(static=True, default=())
    """Velocities of the motions at t = 0, m/s, rad/s; zero by default."""
    position: tuple[float, ...] = eqx.field(static=True, default=())
    """Coordinates at t = 0, m, rad; zero by default."""
    path: tuple[AbstractPath, ...] = ()
    """Prescribed motion of the body relative to its parent: one path, or an empty tuple for none."""

    @classmethod
    def of(cls, free: Sequence[str] = (), *, dtype: Any = jnp.float32, **options: Any):
        """Builds a joint with the motions named in `free`; `options`: other fields by name."""
        release = jnp.asarray(options.pop("release", 0.0), dtype)
        return cls(free=tuple(name in free for name in cls.space.motions), release=release, **options)

    @property
    def coordinates(self) -> tuple[tuple[str, str], ...]:
        """See `AbstractJoint`."""
        return tuple(zip(self.space.motions, self.space.units, strict=True))

    @property
    def _rates(self) -> tuple[float, ...]:
        """Velocities of the motions at t = 0, m/s, rad/s."""
        return self.velocity or (0.0,) * self.size

    @property
    def driven(self) -> bool:
        """See `AbstractJoint`."""
        return bool(self.path) or any(v and not free for free, v in zip(self.free, self._rates, strict=True))

    @property
    def _moving(self) -> tuple[list[bool], list[bool]]:
        """Whether each displacement and each rotation is free or has a given velocity."""
        moving = [bool(a or v) for a, v in zip(self.free, self._rates, strict=True)]
        return moving[: self.space.dim], moving[self.space.dim :]

    @property
    def coasts(self) -> bool:
        """See `AbstractJoint`: True for a joint to the tank that has no path and only slides, or only
        turns about one axis."""
        slides, turns = self._moving
        alone = sum(turns) == 0 or (sum(turns) == 1 and not any(slides))
        return alone and not (self.parent or self.path)

    @property
    def moves(self) -> tuple[bool, ...]:
        """See `AbstractJoint`."""
        if self.path:
            return (True,) * self.size
        slides, turns = self._moving
        if self.angle and (slides[0] or slides[-1]):
            slides[0] = slides[-1] = True
        return (*slides, *turns)

    def start(self, dtype):
        """See `AbstractJoint`."""
        position = self.position or (0.0,) * self.size
        return jnp.asarray(position, dtype), jnp.asarray(self._rates, dtype)

    def pose(self, q, t):
        """See `AbstractJoint`."""
        if self.angle:
            # an angle is positive from x towards z, and a pitch from z towards x
            dim = self.space.dim
            tilt = jnp.zeros_like(q).at[self.space.motions.index("pitch")].set(-self.angle)
            q = jnp.concatenate([self.space.rotated(self.space.pose(tilt), q[:dim]), q[dim:]])
        for path in self.path:
            q = q + path.pose(t)
        return self.space.pose(q)

    def movable(self, t) -> Float[Array, " V"]:
        """See `AbstractJoint`."""
        return jnp.asarray(self.free, t.dtype) * (t >= self.release).astype(t.dtype)


class PlanarJoint(AbstractMotionsJoint):
    """Joint in the plane (x, z) with the coordinates surge (m), heave (m) and pitch (rad)."""

    space = PLANE


class SpatialJoint(AbstractMotionsJoint):
    """Joint in space with the coordinates surge, sway, heave (m), roll, pitch and yaw (rad).

    Roll, pitch and yaw are the components of the rotation vector (`model.rigid`). If several rotations are
    free, a vector longer than pi is replaced by the opposite, shorter vector of the same rotation.
    """

    space = SPACE

    def regular(self, q, rates):
        """See `AbstractJoint`."""
        if sum(self._moving[1]) < 2:
            return q, rates

        def shortened(q):
            length2 = jnp.sum(q[3:] ** 2)
            long = length2 > np.pi**2
            length = jnp.sqrt(jnp.where(long, length2, 1.0))
            return q.at[3:].multiply(jnp.where(long, 1.0 - 2.0 * np.pi / length, 1.0))

        return jax.jvp(shortened, (q,), (rates,))


def joint_of(dim: int, free: Sequence[str] = (), **options: Any) -> AbstractMotionsJoint:
    """Joint in `dim` dimensions with the motions named in `free`; `options`: other fields by name."""
    kind = next(one for one in (PlanarJoint, SpatialJoint) if one.space.dim == dim)
    return kind.of(free, **options)
