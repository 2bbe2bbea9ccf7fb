"""Types: what evolves (`State`), what stays (`Model`), what comes out (`Solution`), and the interfaces.

SI units. x runs along the tank from the wavemaker's rest position; the last axis points up and z = 0 is
the bed. In two dimensions everything is per metre of width.
"""

from __future__ import annotations

import enum
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Float, Int, Scalar
from jaxsph.core.search.cells import Grid


class Particles(eqx.Module):
    """The fluid's particles at time t, in the order of the last sort by cell."""

    x: Float[Array, "N D"]
    """Positions, m."""
    x_carry: Float[Array, "N D"]
    """What rounding x to its type has lost so far, m (compensated summation)."""
    u: Float[Array, "N D"]
    """Velocities, m/s."""
    rho: Float[Array, " N"]
    """Deviation of the density from rho0, kg/m3: a float32 of the whole would lose the pressure."""
    m: Float[Array, " N"]
    """Masses, kg (kg/m in two dimensions)."""
    id: Int[Array, " N"]
    """Place in the initial lattice: follows a particle through the sorts."""
    p: Float[Array, " N"] | None = None
    """Gauge pressure, Pa, of a scheme that solves for it; None where it follows from the density."""


class Work(eqx.Module):
    """What was exchanged since the last sample, summed over every step: energies, J (J/m in 2-D), air and
    momentum."""

    paddle: Scalar
    """Done on the water by the paddle, and by a body where it is not free."""
    pto: Scalar
    """Taken by the power take-off from the water."""
    sponge: Scalar
    """Taken by the sponge."""
    flow: Scalar
    """Volume of air driven out of the chamber, m3 (m2 in 2-D)."""
    contact: Scalar
    """Taken from the water that touches a solid: see `schemes.stopped`."""
    projection: Scalar
    """Taken by pressures from the water and given to no solid: what a projection leaves of the divergence."""
    impulse: Float[Array, "3"]
    """Of the water's force on the body, N s, N s, N m s (per metre in 2-D)."""

    @classmethod
    def zero(cls, dtype: Any) -> Work:
        """Nothing exchanged yet."""
        return cls(*(jnp.zeros((), dtype) for _ in range(6)), jnp.zeros(3, dtype))


class Failure(enum.IntFlag):
    """What can go wrong inside the loop; reported once, outside it."""

    NEIGHBOUR_OVERFLOW = 1
    STALE_TABLE = 2
    NON_FINITE = 4
    THROUGH_WALL = 8
    CHAMBER_OVERFLOW = 16
    TOO_FAST = 32


class Status(eqx.Module):
    """Failures so far, and where the first one was."""

    bits: Int[Array, ""]
    step: Int[Array, ""]
    where: Float[Array, " D"]

    @classmethod
    def sound(cls, dim: int, dtype: Any) -> Status:
        """No failure."""
        return cls(jnp.zeros((), jnp.int32), jnp.zeros((), jnp.int32), jnp.zeros(dim, dtype))

    def flag(self, failure: Failure, failed: jax.Array, step: jax.Array, where: jax.Array) -> Status:
        """Adds a failure; the step and place of the first one are kept."""
        first = failed & (self.bits == 0)
        return Status(
            self.bits | jnp.where(failed, int(failure), 0).astype(self.bits.dtype),
            jnp.where(first, step, self.step),
            jnp.where(first, where, self.where),
        )


class BodyState(eqx.Module):
    """A rigid body's surge (m), heave (m) and pitch (rad) from its place at rest, and what goes with them."""

    pose: Float[Array, "3"]
    velocity: Float[Array, "3"]
    force: Float[Array, "3"]
    """Of the water's pressure, N, N, N m (per metre in 2-D), in the last step."""
    contact: Float[Array, "3"]
    """Of water that touched it in the last step, likewise; the body feels it in the next."""

    @classmethod
    def at_rest(cls, dtype: Any, velocity: Any = (0.0, 0.0, 0.0), pose: Any = (0.0, 0.0, 0.0)) -> BodyState:
        """Not yet under any force of the water."""
        none = jnp.zeros(3, dtype)
        return cls(jnp.asarray(pose, dtype), jnp.asarray(velocity, dtype), none, none)


class State(eqx.Module):
    """All that evolves. Time is not accumulated: t = model.t0 + step * model.dt."""

    particles: Particles
    paddle: Float[Array, "4"]
    """Displacement (m) and velocity (m/s) of the wavemaker, its filtered absorption error and the slow
    mean of that (m)."""
    air: Float[Array, "2"]
    """Gauge pressure of the chamber's air (Pa) and flow out of it (m3/s, m2/s in 2-D)."""
    work: Work
    step: Int[Array, ""]
    status: Status
    body: BodyState | None = None


class Search(eqx.Module):
    """What fixes the neighbour tables' shapes and cadence; found in `build`, grown by `run`."""

    grid: Grid
    capacity: int = eqx.field(static=True)
    """Slots per fluid particle."""
    node_capacity: int = eqx.field(static=True)
    """Slots per interpolation node."""
    chamber_capacity: int = eqx.field(static=True)
    """Particles under the chamber's air pressure, at most."""
    rebuild_every: int = eqx.field(static=True)
    """Steps between searches."""
    skin: float = eqx.field(static=True)
    """What the search radius adds to the support, m."""


class Tables(eqx.Module):
    """Neighbour tables of one rebuild block, and the positions they were made for."""

    fluid: Int[Array, "K N"]
    nodes: Int[Array, "Kn G"]
    paddle: Int[Array, "Kp P"] | None
    """Fluid around each ghost of the paddle, for the force on it."""
    chamber: Int[Array, " C"] | None
    """Particles that may feel the chamber's air; N stands for none."""
    x: Float[Array, "N D"]
