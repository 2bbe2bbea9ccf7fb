"""Interfaces of solids that bound the water: at rest, with a given motion, or rigid bodies.

A moving solid stores its motion in `state.parts` under its `name`. In two dimensions all quantities are per
metre of width.
"""

from __future__ import annotations

import abc
from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.model.part import AbstractPart
from jaxsph.model.state import Particles

__all__ = [
    "AbstractBody",
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
        the solid's state, `State.parts[name]`, or None at rest; `dx`: spacing, m; `c0`: speed of sound, m/s.
        """

    @abc.abstractmethod
    def contains(self, motion: Any, x: Float[Array, "N D"], dx: Scalar) -> Array:
        """True for particles at x (m) that are inside the solid by more than a rounding error."""

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
        """Positions of the solid's ghosts and of their nodes, m, from x and `nodes` (m) at rest."""

    @abc.abstractmethod
    def velocity(self, motion: Any, x: Float[Array, "B D"]) -> Float[Array, "B D"]:
        """Velocity of the solid at points x (m) that move with it, m/s."""

    @abc.abstractmethod
    def touches(self, motion: Any, x: Float[Array, "N D"], dx: Scalar) -> Array:
        """True for particles at x (m) near enough to be stopped by the solid."""

    def pose(self, motion: Any) -> tuple[Array, Array]:
        """Pose of the outline (surge and heave, m; pitch, rad), and the pivot `[2]` (m) of its rotation."""
        del motion
        return jnp.zeros(3), jnp.zeros(2)

    @abc.abstractmethod
    def halfway(self, old: Any, new: Any, dt: Scalar) -> Any:
        """Motion of the solid in the middle of a step of dt (s), between the motions `old` and `new`."""


class AbstractWall(AbstractMovingSolid):
    """A moving solid with a given motion: a piston, a rocking bed."""

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
    def with_velocity(self, motion: Any, after: Any) -> Any:
        """Motion of the wall with the position of `motion` and the velocity of `after`."""

    @abc.abstractmethod
    def cover(self, motion: Any, x: Float[Array, "G D"], dx: Scalar) -> Float[Array, " G"]:
        """Share of each ghost of all solids, at x (m), that is on the water's side of the wall, 0 to 1."""


class AbstractBody(AbstractMovingSolid):
    """A rigid body with three motions in the x-z plane: surge, heave and pitch.

    Each motion is free, or has a constant velocity.
    """

    @abc.abstractmethod
    def movable(self, t: Scalar) -> Float[Array, "3"]:
        """Mask of surge, heave and pitch: 1 for motions that are free at t (s), 0 at constant velocity."""

    @abc.abstractmethod
    def generalised_mass(self) -> Float[Array, "3"]:
        """Mass for surge and for heave (kg; kg/m in 2-D), and moment of inertia for pitch (kg m2; kg m
        in 2-D)."""

    @abc.abstractmethod
    def directions(self, motion: Any, x: Float[Array, "N D"]) -> Float[Array, "3 N D"]:
        """Velocity of the body at points x (m) per unit velocity of surge, heave (-) and pitch (m)."""

    @abc.abstractmethod
    def centripetal(self, motion: Any, x: Float[Array, "N D"]) -> Float[Array, "N D"]:
        """Centripetal acceleration of the body at points x (m), m/s2: the part due to constant rotation."""

    @abc.abstractmethod
    def external(self, motion: Any, g: Float[Array, " D"]) -> Float[Array, "3"]:
        """Forces along x and z (N) and moment (N m) on the body, except from water and linear damping.

        The forces are per metre of width in 2-D; g (m/s2): gravity.
        """

    @abc.abstractmethod
    def damping(self) -> Float[Array, "3"]:
        """Linear damping coefficients of surge, heave (N s/m) and pitch (N m s); per metre of width in 2-D.

        The damping force is minus the product of the coefficients and the velocities.
        """

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

    @abc.abstractmethod
    def absorbed(self, old: Any, new: Any, dt: Scalar) -> Scalar:
        """Energy taken by the body's power take-off in a step of dt (s), J (J/m in 2-D)."""

    @abc.abstractmethod
    def exchanges(self, taken: Scalar, driven: Scalar) -> Mapping[str, Scalar]:
        """Energies that the body adds to the ledger in a step, by name, J (J/m in 2-D).

        **Arguments**: `taken`: energy taken by the power take-off; `driven`: energy given to the body to
        maintain the constant velocity of motions that are not free.
        """
