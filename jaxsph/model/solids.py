"""Interfaces of solids that bound the water: at rest, with a prescribed motion, or rigid bodies.

A moving solid stores its motion in `state.parts` under its `name`. In two dimensions all quantities are per
metre of width.
"""

from __future__ import annotations

import abc
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.model.part import AbstractPart
from jaxsph.model.rigid import SPACES
from jaxsph.model.state import Particles

__all__ = [
    "AbstractBody",
    "AbstractJoint",
    "AbstractMovingSolid",
    "AbstractSolid",
    "AbstractWall",
]


class AbstractSolid(eqx.Module):
    """A solid that bounds the water: a wall of the tank, a plate, a paddle, a rigid body."""

    name: eqx.AbstractVar[str]
    """Key of the solid's motion in `State.parts`; empty for a solid at rest."""

    @abc.abstractmethod
    def push(self, motion: Any, x: Float[Array, "N D"], dx: Scalar, c0: Scalar) -> Float[Array, "N D"]:
        """Acceleration of particles at x (m) due to the contact spring of the solid's surface, m/s2.

        The spring (`solids.contact.spring`) keeps particles from touching the solid. **Arguments**: `motion`:
        the solid's state, `State.parts[name]`, or None at rest; `dx`: spacing, m; `c0`: speed that sets the
        stiffness of the spring, m/s.
        """

    @abc.abstractmethod
    def contains(self, motion: Any, x: Float[Array, "N D"], dx: Scalar) -> Array:
        """True for particles at x (m) that have entered the solid by more than half a spacing `dx` (m).

        In a thin plate a smaller depth counts.
        """

    def outline(self, far: float) -> np.ndarray:
        """Corners `[K, 2]` (x, z) (m) of the solid in drawings, at rest; empty by default.

        A solid that is unbounded, or extends beyond every drawing, is drawn up to the distance `far` (m).
        """
        del far
        return np.zeros((0, 2))


class AbstractMovingSolid(AbstractSolid, AbstractPart):
    """A moving solid, with ghosts that move with it."""

    rows: eqx.AbstractVar[tuple[int, int]]
    """Index of the solid's first ghost, and one more than the index of the solid's last ghost."""

    @abc.abstractmethod
    def start(self, dtype: Any) -> Any:
        """Motion of the solid at t = 0, stored as `State.parts[name]`."""

    @abc.abstractmethod
    def place(self, motion: Any, x: Float[Array, "B D"], nodes: Float[Array, "B D"]) -> tuple[Array, Array]:
        """Positions of the solid's ghosts and of their nodes, m, from those at rest, x and `nodes` (m)."""

    @abc.abstractmethod
    def velocity(self, motion: Any, x: Float[Array, "B D"]) -> Float[Array, "B D"]:
        """Velocity of the solid at points x (m) that move with it, m/s."""

    @abc.abstractmethod
    def touches(self, motion: Any, x: Float[Array, "N D"], dx: Scalar) -> Array:
        """True for particles at x (m) near enough to be stopped by the solid."""

    def pose(self, motion: Any) -> tuple[Array, Array]:
        """Displacement and rotation of the outline in pictures (m, rad), and the pivot (m) of its rotation.

        Displacement and rotation are surge, heave and pitch, or for a body in 3-D all six motions
        (`model.rigid`).
        """
        del motion
        return jnp.zeros(3), jnp.zeros(2)


class AbstractWall(AbstractMovingSolid):
    """A moving solid whose motion does not follow from the forces on the solid: a piston, a rocking bed."""

    @abc.abstractmethod
    def move(
        self, motion: Any, water: Particles, depth_volume: Float[Array, " N"], t: Scalar, dt: Scalar
    ) -> Any:
        """Motion of the wall at the time t + dt (s), from its `motion` at t.

        `depth_volume`: volumes of the particles per metre of the tank's width, m2.
        """

    @abc.abstractmethod
    def acceleration(self, old: Any, new: Any, x: Float[Array, "B D"], dt: Scalar) -> Float[Array, "B D"]:
        """Acceleration of the wall at its ghosts x (m), m/s2, in a step of dt (s) from `old` to `new`."""

    @abc.abstractmethod
    def halfway(self, old: Any, new: Any, dt: Scalar) -> Any:
        """Motion of the wall in the middle of a step of dt (s), between the motions `old` and `new`."""

    @abc.abstractmethod
    def with_velocity(self, motion: Any, after: Any) -> Any:
        """Motion of the wall with the position of `motion` and the velocity of `after`."""

    @abc.abstractmethod
    def cover(self, motion: Any, x: Float[Array, "G D"], dx: Scalar) -> Float[Array, " G"]:
        """Fraction (0 to 1) of each ghost that is on the water's side of the wall; `x`: positions of the
        ghosts of all solids, m."""


class AbstractJoint(eqx.Module):
    """Joint of a body to the tank or to another body: the body's relative pose as a function of coordinates.

    Velocities and accelerations follow by differentiation.
    """

    parent: eqx.AbstractVar[str]
    """Name of the joint's parent body; empty for the tank."""
    free: eqx.AbstractVar[tuple[bool, ...]]
    """Whether each of the k coordinates is free, at least from some time on."""

    @property
    @abc.abstractmethod
    def coordinates(self) -> tuple[tuple[str, str], ...]:
        """Names and units (m or rad) of the k coordinates."""

    @property
    def size(self) -> int:
        """Number k of coordinates."""
        return len(self.coordinates)

    @property
    @abc.abstractmethod
    def moves(self) -> tuple[bool, ...]:
        """Whether the body can make each of the V motions of `model.rigid` while its parent is at rest."""

    @property
    def coasts(self) -> bool:
        """Whether every coordinate keeps its rate if no force acts, whatever the inertia of the body.

        If True, steps are cheaper. False is always correct.
        """
        return False

    @property
    @abc.abstractmethod
    def driven(self) -> bool:
        """Whether the joint has a prescribed motion, whose drive does work."""

    @abc.abstractmethod
    def start(self, dtype: Any) -> tuple[Float[Array, " k"], Float[Array, " k"]]:
        """Coordinates (m, rad) at t = 0, and their rates (m/s, rad/s)."""

    @abc.abstractmethod
    def pose(self, q: Float[Array, " k"], t: Scalar) -> Float[Array, " P"]:
        """Pose of the body (`model.rigid`) relative to the parent, along axes that turn with the parent.

        In 2-D the pose is the displacement of the pivot along x and z (m), and the pitch (rad).
        **Arguments**: `q`: coordinates; `t`: time, s, for prescribed motions.
        """

    def place(
        self, above: Float[Array, " P"], arm: Float[Array, " D"], q: Float[Array, " k"], t: Scalar
    ) -> Float[Array, " P"]:
        """Pose of the body in the tank.

        Override this method in a closed chain, where the pose relative to the parent depends on the parent's
        pose. **Arguments**: `above`: pose of the parent; `arm`: vector from the parent's pivot to the body's
        pivot at rest, m; `q` and `t` as for `pose`.
        """
        return SPACES[len(arm)].carried(above, arm, self.pose(q, t))

    def regular(
        self, q: Float[Array, " k"], rates: Float[Array, " k"]
    ) -> tuple[Float[Array, " k"], Float[Array, " k"]]:
        """Coordinates (m, rad) and rates (m/s, rad/s) that describe the same pose and velocity as `q` and
        `rates`; they differ from `q` and `rates` only if q is near a singularity."""
        return q, rates

    @abc.abstractmethod
    def movable(self, t: Scalar) -> Float[Array, " k"]:
        """Mask of the coordinates: 1 if a coordinate is free at t (s), 0 if its rate is constant."""


class AbstractBody(AbstractMovingSolid):
    """A rigid body with V motions: surge, heave and pitch in 2-D, six motions in 3-D (`model.rigid`).

    Its state in `State.parts` has the fields `q` and `rates` (coordinates of the joint and their rates),
    `pose` and `velocity` (of the pivot, and of the rotation about it), `force` (of the water's pressure and
    the air of the body's chambers) and `contact` (of the water's contact), both in the last step and with
    moments about the pivot, and `impulse` (time integral of both forces).
    """

    joint: eqx.AbstractVar[AbstractJoint]
    """Joint to the tank or to another body."""
    pivot: eqx.AbstractVar[Float[Array, " D"]]
    """Pivot at rest, m: the point at which the joint is attached, and the reference point of moments."""
    centre: eqx.AbstractVar[Float[Array, " D"]]
    """Centre of mass at rest, m."""

    @property
    def fixed(self) -> bool:
        """Whether the body never moves."""
        return not (self.joint.parent or any(self.joint.moves))

    @abc.abstractmethod
    def mass_matrix(self, pose: Float[Array, " P"]) -> Float[Array, "V V"]:
        """Mass matrix with respect to the centre of mass, in a pose, kg and kg m2 (kg/m and kg m in 2-D)."""

    @abc.abstractmethod
    def directions(self, motion: Any, x: Float[Array, "N D"]) -> Float[Array, "V N D"]:
        """Velocity of the body at points x (m) per unit of each component of its velocity (-, m)."""

    @abc.abstractmethod
    def centripetal(self, motion: Any, x: Float[Array, "N D"]) -> Float[Array, "N D"]:
        """Centripetal acceleration of the body at points x (m), m/s2: the part due to constant rotation."""

    @abc.abstractmethod
    def carry(self, motion: Any, x: Float[Array, "N D"]) -> Float[Array, "N D"]:
        """Positions (m), in the body's present pose, of points with positions x (m) on the body at rest."""

    @abc.abstractmethod
    def normals(self, motion: Any, x: Float[Array, "N D"]) -> Float[Array, "N D"]:
        """Outward unit normals (-), in the body's present pose, of the surface nearest to points x.

        The points x (m) are positions on the body at rest.
        """

    @abc.abstractmethod
    def distance(self, motion: Any, x: Float[Array, "N D"]) -> Float[Array, " N"]:
        """Distance of points x (m) from the body's surface, m; negative inside."""

    @abc.abstractmethod
    def energy(self, motion: Any, g: Float[Array, " D"]) -> tuple[Scalar, Scalar]:
        """Kinetic energy of the body, and potential energy relative to the position at rest, J (J/m
        in 2-D)."""
