"""Joined bodies without water, and Lagrange's equations of the same bodies with only angles as unknowns.

The bodies are a double pendulum and a slider-crank of rectangular bars, in two dimensions. Two joints of the
slider-crank have no coordinate: they compute the pose of a body from that of its parent body. In the crank's
equation the crank angle is positive from x towards z; the crank's pitch is positive from z towards x and has
the opposite sign.
"""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

import jaxsph as js
from jaxsph.model.rigid import PLANE
from jaxsph.model.solids import AbstractJoint
from jaxsph.parts.body import RigidBody
from jaxsph.parts.joint import PlanarJoint

G, RHO = 9.81, 500.0
WIDTH = 0.1
"""Width of all bars, m."""
UPPER, LOWER = 1.0, 0.8
"""Lengths of the bars of the double pendulum, m."""
ANGLES = (0.7, 0.3)
"""Angles of the double pendulum's bars from the vertical at t = 0, rad."""
SWING = float(RHO * WIDTH * G * ((1.0 - np.cos(ANGLES)) @ [UPPER * (UPPER / 2 + LOWER), LOWER**2 / 2]))
"""Potential energy of the double pendulum at t = 0, relative to hanging straight down, J/m."""
CRANK, ROD, PISTON = 0.3, 1.0, 0.2
"""Lengths of crank and connecting rod, and side of the piston, m."""


def body(name: str, shape: js.Block, joint: AbstractJoint, pivot: Any, dtype: Any) -> RigidBody:
    """A body of half the water's density; `pivot`: position of its joint, m."""
    return RigidBody.of(shape, (0, 0), joint, density=RHO, pivot=pivot, name=name, dtype=dtype)


def bar(x: float, length: float) -> js.Block:
    """A bar along the x axis, from x (m) to x + `length` (m)."""
    return js.Block((x, -0.5 * WIDTH), (x + length, 0.5 * WIDTH))


def hanging(z: float, length: float) -> js.Block:
    """A bar of this `length` (m) that hangs down from z (m)."""
    return js.Block((-0.5 * WIDTH, z - length), (0.5 * WIDTH, z))


def double_pendulum(dtype: Any) -> tuple[RigidBody, ...]:
    """Two bars, hinged at (0, 0) and at the end of the first, with the angles `ANGLES` at t = 0."""
    relative = {"upper": (ANGLES[0], ""), "lower": (ANGLES[1] - ANGLES[0], "upper")}
    upper, lower = (
        PlanarJoint.of(["pitch"], position=(0.0, 0.0, angle), parent=parent, dtype=dtype)
        for angle, parent in relative.values()
    )
    return (
        body("upper", hanging(0.0, UPPER), upper, (0.0, 0.0), dtype),
        body("lower", hanging(-UPPER, LOWER), lower, (0.0, -UPPER), dtype),
    )


def pendulum_equations(t: float, y: np.ndarray) -> list[float]:
    """Rates of change of the double pendulum's angles from the vertical (rad/s) and of the angular velocities
    (rad/s2)."""
    a, b, va, vb = y
    m1, m2 = RHO * WIDTH * UPPER, RHO * WIDTH * LOWER
    i1, i2 = (m * (length**2 + WIDTH**2) / 12.0 for m, length in ((m1, UPPER), (m2, LOWER)))
    both, c, s = 0.5 * m2 * UPPER * LOWER, np.cos(a - b), np.sin(a - b)
    mass = [[i1 + m1 * UPPER**2 / 4 + m2 * UPPER**2, both * c], [both * c, i2 + m2 * LOWER**2 / 4]]
    force = [
        -both * s * vb**2 - (m1 / 2 + m2) * G * UPPER * np.sin(a),
        both * s * va**2 - m2 * G * LOWER / 2 * np.sin(b),
    ]
    return [va, vb, *np.linalg.solve(mass, force)]


class Rod(AbstractJoint):
    """Joint of a connecting rod to its crank; the rod's far end stays on the line z = 0."""

    parent: str = eqx.field(static=True, default="crank")
    free: tuple[bool, ...] = eqx.field(static=True, default=())
    coordinates = ()
    moves = (True, True, True)
    driven = False

    def start(self, dtype):
        """See `AbstractJoint`."""
        return jnp.zeros(0, dtype), jnp.zeros(0, dtype)

    def pose(self, q, t):
        """See `AbstractJoint`."""
        raise NotImplementedError("the rod's pose follows from the crank's: see `place`")

    def place(self, above, arm, q, t):
        """See `AbstractJoint`."""
        pin = PLANE.rotated(above, arm)
        return jnp.stack([*(pin - arm), jnp.arcsin(pin[1] / ROD)])

    def movable(self, t):
        """See `AbstractJoint`."""
        return jnp.zeros(0, t.dtype)


class Piston(Rod):
    """Joint of a piston to the far end of the rod."""

    parent: str = eqx.field(static=True, default="rod")

    def place(self, above, arm, q, t):
        """See `AbstractJoint`."""
        end = above[0] + ROD * (jnp.cos(above[2]) - 1.0)
        return jnp.stack([end, 0.0 * end, 0.0 * end])


def slider_crank(dtype: Any) -> tuple[RigidBody, ...]:
    """Crank, connecting rod and piston in a row along x; the crank is hinged at (0, 0)."""
    end, half = CRANK + ROD, 0.5 * PISTON
    return (
        body("crank", bar(0.0, CRANK), PlanarJoint.of(["pitch"], dtype=dtype), (0.0, 0.0), dtype),
        body("rod", bar(CRANK, ROD), Rod(), (CRANK, 0.0), dtype),
        body("piston", js.Block((end - half, -half), (end + half, half)), Piston(), (end, 0.0), dtype),
    )


def crank_equation(t: float, y: np.ndarray) -> list[float]:
    """Rates of change (rad/s, rad/s2) of the crank's angle, from x towards z, and of its angular velocity."""
    m_crank, m_rod, m_piston = RHO * WIDTH * CRANK, RHO * WIDTH * ROD, RHO * PISTON**2
    i_crank, i_rod = m_crank * (CRANK**2 / 3 + WIDTH**2 / 12), m_rod * (ROD**2 + WIDTH**2) / 12

    def parts(a):
        """Effective moment of inertia (kg m) and potential energy (J/m) at the crank angle a (rad)."""
        b = np.arcsin(CRANK / ROD * np.sin(a))
        db = CRANK / ROD * np.cos(a) / np.cos(b)
        rod = np.array([-CRANK * np.sin(a) - ROD / 2 * np.sin(b) * db, CRANK * np.cos(a) / 2])
        piston = -CRANK * np.sin(a) - ROD * np.sin(b) * db
        mass = i_crank + i_rod * db**2 + m_rod * rod @ rod + m_piston * piston**2
        return mass, G * (m_crank + m_rod) * 0.5 * CRANK * np.sin(a)

    a, v = y
    (mass, _), h = parts(a), 1e-5
    slope, pull = ((np.array(parts(a + h)) - np.array(parts(a - h))) / (2 * h)).tolist()
    return [v, (-pull - 0.5 * slope * v**2) / mass]
