"""Displacements of rigid bodies in the plane (x, z), with three motions, and in space, with six.

Surge, sway and heave (m) are positive along x, y and z. Roll, pitch and yaw (rad) are positive by the
right-hand rule about x, y and z, so that a positive pitch turns z towards x. A pose is the displacement of a
body's pivot and the body's rotation, from the position at rest. The velocity of a body is the velocity of
its pivot, followed by the angular velocity.
"""

from __future__ import annotations

import abc
from typing import Any, ClassVar

import jax.numpy as jnp

from jaxsph.core.arrays import Array, Float, Scalar

__all__ = ["PLANE", "SPACE", "SPACES", "AbstractSpace", "space_with"]


class AbstractSpace(abc.ABC):
    """Space of D dimensions in which rigid bodies have V motions, and poses of P numbers.

    Arguments whose shape is marked by `*A` may have additional leading axes.
    """

    dim: int
    """Number D of dimensions."""
    motions: tuple[str, ...]
    """Names of the V motions: first the displacements, then the rotations."""
    loads: dict[str, str]
    """Descriptions of the V forces and moments, by name."""

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the motions."""
        return tuple("m" if k < self.dim else "rad" for k in range(len(self.motions)))

    def at_rest(self, dtype: Any) -> Float[Array, " P"]:
        """Pose of a body in its position at rest."""
        return self.pose(jnp.zeros(len(self.motions), dtype))

    @abc.abstractmethod
    def pose(self, q: Float[Array, "*A V"]) -> Float[Array, "*A P"]:
        """Pose with the displacement and the rotation q (m, rad)."""

    @abc.abstractmethod
    def coordinates(self, pose: Float[Array, "*A P"]) -> Float[Array, "*A V"]:
        """Displacement and rotation (m, rad) of a pose; in 3-D the rotation vector is at most pi long."""

    @abc.abstractmethod
    def rotated(self, pose: Float[Array, "*A P"], r: Float[Array, "*A D"]) -> Float[Array, "*A D"]:
        """Vectors r, rotated from the position at rest to the pose."""

    @abc.abstractmethod
    def rotated_back(self, pose: Float[Array, "*A P"], r: Float[Array, "*A D"]) -> Float[Array, "*A D"]:
        """Vectors r, rotated from the pose to the position at rest."""

    @abc.abstractmethod
    def carried(
        self, above: Float[Array, " P"], arm: Float[Array, " D"], own: Float[Array, " P"]
    ) -> Float[Array, " P"]:
        """Absolute pose of a body, from its pose `own` relative to another body.

        **Arguments**: `above`: pose of the other body; `arm`: vector (m) at rest from the other body's pivot
        to the body's pivot.
        """

    def moved(self, pose: Float[Array, "*A P"], arm: Float[Array, "*A D"]) -> Float[Array, "*A P"]:
        """Pose of the same body with a new pivot; `arm`: vector (m) at rest from the old to the new pivot."""
        shift = pose[..., : self.dim] + self.rotated(pose, arm) - arm
        return jnp.concatenate([shift, pose[..., self.dim :]], axis=-1)

    @abc.abstractmethod
    def velocity(self, pose: Float[Array, "*A P"], change: Float[Array, "*A P"]) -> Float[Array, "*A V"]:
        """Velocity (m/s, rad/s) of a body whose pose changes at the rate `change`.

        The rate is in m/s for the displacements, and in 1/s for the rotation.
        """

    @abc.abstractmethod
    def directions(self, r: Float[Array, "N D"]) -> Float[Array, "V N D"]:
        """Velocities of points at r (m) from the pivot, per unit of each component of the body's
        velocity (-, m)."""

    @abc.abstractmethod
    def centripetal(self, velocity: Float[Array, " V"], r: Float[Array, "N D"]) -> Float[Array, "N D"]:
        """Centripetal acceleration (m/s2) of points at r (m) from the pivot."""

    @abc.abstractmethod
    def mass_matrix(self, mass: Scalar, inertia: Array, pose: Float[Array, " P"]) -> Float[Array, "V V"]:
        """Mass matrix of a body in a pose, kg and kg m2 (kg/m and kg m in 2-D).

        **Arguments**: `mass` (kg; kg/m in 2-D); `inertia` about the centre of mass at rest, a number (kg m)
        in 2-D and a tensor `[3, 3]` (kg m2) in 3-D.
        """

    @abc.abstractmethod
    def gyroscopic(
        self, matrix: Float[Array, "*A V V"], velocity: Float[Array, "*A V"]
    ) -> Float[Array, "*A V"]:
        """Forces and moments (N, N m) that keep a body with the mass `matrix` at a constant velocity."""


class _Plane(AbstractSpace):
    """Plane (x, z); a pose is surge (m), heave (m) and pitch (rad)."""

    dim = 2
    motions = ("surge", "heave", "pitch")
    loads: ClassVar = {"force_x": "force along the tank", "force_z": "force upwards", "moment": "moment"}

    def pose(self, q):
        """See `AbstractSpace`."""
        return q

    def coordinates(self, pose):
        """See `AbstractSpace`."""
        return pose

    def rotated(self, pose, r):
        """See `AbstractSpace`."""
        c, s = jnp.cos(pose[..., 2]), jnp.sin(pose[..., 2])
        return jnp.stack([c * r[..., 0] + s * r[..., 1], c * r[..., 1] - s * r[..., 0]], axis=-1)

    def rotated_back(self, pose, r):
        """See `AbstractSpace`."""
        return self.rotated(-pose, r)

    def carried(self, above, arm, own):
        """See `AbstractSpace`."""
        return jnp.concatenate([self.moved(above, arm + own[:2])[:2] + own[:2], above[2:] + own[2:]])

    def velocity(self, pose, change):
        """See `AbstractSpace`."""
        del pose
        return change

    def directions(self, r):
        """See `AbstractSpace`."""
        x, z = r[:, 0], r[:, 1]
        zero, one = jnp.zeros_like(x), jnp.ones_like(x)
        return jnp.stack([jnp.stack(pair, axis=1) for pair in ((one, zero), (zero, one), (z, -x))])

    def centripetal(self, velocity, r):
        """See `AbstractSpace`."""
        return -(velocity[2] ** 2) * r

    def mass_matrix(self, mass, inertia, pose):
        """See `AbstractSpace`."""
        del pose
        return jnp.diag(jnp.stack([mass, mass, inertia]))

    def gyroscopic(self, matrix, velocity):
        """See `AbstractSpace`."""
        del matrix
        return jnp.zeros_like(velocity)


SMALL = 0.04
"""Square of the angle (rad2) below which a rotation is computed by series, which are differentiable at 0."""


class _Space(AbstractSpace):
    """Space (x, y, z); a pose is the displacement (m) and the unit quaternion of the rotation.

    As coordinates, roll, pitch and yaw are the components of the rotation vector. The direction of this
    vector is the axis of the rotation, and its length is the angle (rad). For a rotation about one coordinate
    axis, the component along this axis is the usual angle.
    """

    dim = 3
    motions = ("surge", "sway", "heave", "roll", "pitch", "yaw")
    loads: ClassVar = {
        "force_x": "force along the tank",
        "force_y": "force across the tank",
        "force_z": "force upwards",
        "moment_x": "moment in roll",
        "moment_y": "moment in pitch",
        "moment_z": "moment in yaw",
    }

    def pose(self, q):
        """See `AbstractSpace`."""
        vector = q[..., 3:]
        t = jnp.sum(vector**2, axis=-1, keepdims=True)
        # series of cos(a/2) and sin(a/2)/a, to rounding errors of float64 below SMALL
        near_w = 1.0 - t / 8.0 * (1.0 - t / 48.0 * (1.0 - t / 120.0 * (1.0 - t / 224.0)))
        near_s = 0.5 * (1.0 - t / 24.0 * (1.0 - t / 80.0 * (1.0 - t / 168.0 * (1.0 - t / 288.0))))
        angle = jnp.sqrt(jnp.where(t < SMALL, 1.0, t))
        w = jnp.where(t < SMALL, near_w, jnp.cos(0.5 * angle))
        s = jnp.where(t < SMALL, near_s, jnp.sin(0.5 * angle) / angle)
        return jnp.concatenate([q[..., :3], w, s * vector], axis=-1)

    def coordinates(self, pose):
        """See `AbstractSpace`."""
        w, v = pose[..., 3:4], pose[..., 4:]
        w, v = jnp.abs(w), jnp.where(w < 0.0, -v, v)
        sine2 = jnp.sum(v**2, axis=-1, keepdims=True)
        sine = jnp.sqrt(jnp.where(sine2 < 1e-6, 1.0, sine2))
        # ratio of the angle to the sine of half the angle; its series is 2 + sine^2 / 3
        ratio = jnp.where(sine2 < 1e-6, 2.0 + sine2 / 3.0, 2.0 * jnp.arctan2(sine, w) / sine)
        return jnp.concatenate([pose[..., :3], ratio * v], axis=-1)

    def rotated(self, pose, r):
        """See `AbstractSpace`."""
        w, v = pose[..., 3:4], pose[..., 4:]
        twice = 2.0 * _cross(v, r)
        return r + w * twice + _cross(v, twice)

    def rotated_back(self, pose, r):
        """See `AbstractSpace`."""
        return self.rotated(pose.at[..., 4:].multiply(-1.0), r)

    def carried(self, above, arm, own):
        """See `AbstractSpace`."""
        shift = self.moved(above, arm + own[:3])[:3] + own[:3]
        (w, v), (a, b) = (above[3], above[4:]), (own[3], own[4:])
        return jnp.concatenate([shift, (w * a - v @ b)[None], w * b + a * v + _cross(v, b)])

    def velocity(self, pose, change):
        """See `AbstractSpace`."""
        w, v, dw, dv = pose[..., 3:4], pose[..., 4:], change[..., 3:4], change[..., 4:]
        return jnp.concatenate([change[..., :3], 2.0 * (w * dv - dw * v + _cross(v, dv))], axis=-1)

    def directions(self, r):
        """See `AbstractSpace`."""
        unit = jnp.broadcast_to(jnp.eye(3, dtype=r.dtype)[:, None], (3, *r.shape))
        return jnp.concatenate([unit, _cross(unit, r)])

    def centripetal(self, velocity, r):
        """See `AbstractSpace`."""
        return _cross(velocity[3:], _cross(velocity[3:], r))

    def mass_matrix(self, mass, inertia, pose):
        """See `AbstractSpace`."""
        R = self.rotated(pose, jnp.eye(3, dtype=pose.dtype)).T
        none = jnp.zeros((3, 3), pose.dtype)
        return jnp.block([[mass * jnp.eye(3, dtype=pose.dtype), none], [none, R @ inertia @ R.T]])

    def gyroscopic(self, matrix, velocity):
        """See `AbstractSpace`."""
        spin = velocity[..., 3:]
        moment = jnp.einsum("...ij,...j->...i", matrix[..., 3:, 3:], spin)
        return jnp.concatenate([jnp.zeros_like(spin), _cross(spin, moment)], axis=-1)


def _cross(a: Float[Array, "*A 3"], b: Float[Array, "*A 3"]) -> Float[Array, "*A 3"]:
    """Vector product a x b."""
    (ax, ay, az), (bx, by, bz) = ([v[..., k] for k in range(3)] for v in (a, b))
    return jnp.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


PLANE, SPACE = _Plane(), _Space()
SPACES: dict[int, AbstractSpace] = {space.dim: space for space in (PLANE, SPACE)}
"""Spaces by their numbers of dimensions."""


def space_with(motions: int) -> AbstractSpace:
    """Space in which rigid bodies have `motions` motions: 3 in the plane, 6 in space."""
    return next(space for space in SPACES.values() if len(space.motions) == motions)
