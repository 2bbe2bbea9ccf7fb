"""State of a run: what evolves from step to step, and the neighbour tables of one block of steps.

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
from jaxsph.core.search.base import AbstractSearch, Grid

__all__ = ["Failure", "Particles", "Search", "State", "Status", "Tables", "Tally", "settle"]


class Particles(eqx.Module):
    """The fluid's particles at time t, in the order of the last sort by cell."""

    x: Float[Array, "N D"]
    """Positions, m."""
    x_carry: Float[Array, "N D"]
    """Rounding error of x, m: what its type could not hold (compensated summation)."""
    u: Float[Array, "N D"]
    """Velocities, m/s."""
    rho: Float[Array, " N"]
    """Deviation of the density from rho0, kg/m3: a float32 of the whole would lose the pressure."""
    m: Float[Array, " N"]
    """Masses, kg (kg/m in two dimensions)."""
    id: Int[Array, " N"]
    """Place in the initial lattice: follows a particle through the sorts."""
    p: Float[Array, " N"]
    """Gauge pressure, Pa, of a scheme that solves for it; zero where it follows from the density."""


class Tally(eqx.Module):
    """Running sum of an amount: since the last sample, and since the start of the run.

    The sum over a sample is small, so that a step's amount is not lost in it; at a sample it is added to the
    sum before with its rounding error kept (Knuth's two-sum), so that a long run loses nothing either.
    """

    recent: Float[Array, "..."]
    """Amount since the last sample."""
    settled: Float[Array, "..."]
    """Amount from the start of the run to the last sample."""
    carry: Float[Array, "..."]
    """Rounding error of `settled`."""

    @classmethod
    def zero(cls, dtype: Any, shape: tuple[int, ...] = ()) -> Tally:
        """Sum of nothing."""
        return cls(*(jnp.zeros(shape, dtype) for _ in range(3)))

    @property
    def total(self) -> Float[Array, "..."]:
        """Amount since the start of the run."""
        return self.settled + (self.carry + self.recent)

    def add(self, amount: Float[Array, "..."]) -> Tally:
        """The sum with one step's amount."""
        return Tally(self.recent + amount, self.settled, self.carry)

    def settle(self) -> Tally:
        """The same sum at a sample: nothing is recent any more."""
        settled = self.settled + self.recent
        kept = settled - self.settled
        lost = (self.settled - (settled - kept)) + (self.recent - kept)
        return Tally(jnp.zeros_like(self.recent), settled, self.carry + lost)


def settle(tree: Any, due: jax.Array) -> Any:
    """Settles every `Tally` of a pytree where a sample is `due`."""

    def settled(leaf):
        if not isinstance(leaf, Tally):
            return leaf
        return jax.tree.map(lambda a, b: jnp.where(due, a, b), leaf.settle(), leaf)

    return jax.tree.map(settled, tree, is_leaf=lambda leaf: isinstance(leaf, Tally))


class Failure(enum.IntFlag):
    """What can go wrong inside the loop; reported once, outside it."""

    NEIGHBOUR_OVERFLOW = 1
    STALE_TABLE = 2
    NON_FINITE = 4
    THROUGH_WALL = 8
    CHAMBER_OVERFLOW = 16
    TOO_FAST = 32
    NOT_CONVERGED = 64


class Status(eqx.Module):
    """Failures so far, place and step of the first one, and what the tables and the solver needed."""

    bits: Int[Array, ""]
    """`Failure` flags."""
    step: Int[Array, ""]
    """Step of the first failure."""
    where: Float[Array, " D"]
    """Place of the first failure, m."""
    most: dict[str, Int[Array, ""]]
    """Largest number of slots that a table needed since the start, by the name of its capacity."""
    residual: Scalar
    """Largest residual that a linear solution was left with, over its right-hand side."""
    speed2: Scalar
    """Square of the largest speed up to the first failure, m2/s2."""

    @classmethod
    def sound(cls, dim: int, dtype: Any) -> Status:
        """Status without a failure."""
        zero = jnp.zeros((), jnp.int32)
        most = {name: zero for name in ("capacity", "node_capacity", "chamber_capacity")}
        none = jnp.zeros((), dtype)
        return cls(zero, zero, jnp.zeros(dim, dtype), most, none, none)

    def flag(self, failure: Failure, failed: jax.Array, step: jax.Array, where: jax.Array) -> Status:
        """The status with a failure added; step and place of the first one are kept."""
        first = failed & (self.bits == 0)
        return Status(
            self.bits | jnp.where(failed, int(failure), 0).astype(self.bits.dtype),
            jnp.where(first, step, self.step),
            jnp.where(first, where, self.where),
            self.most,
            self.residual,
            self.speed2,
        )


class State(eqx.Module):
    """Everything that evolves. Time is not accumulated: t = model.t0 + step * model.dt."""

    particles: Particles
    own: dict[str, Any]
    """States of the parts by their names: a paddle's motion, a body's, a chamber's air."""
    ledger: dict[str, Tally]
    """Energies exchanged, by name, J (J/m in 2-D); `Model.entries` says what each is."""
    limits: dict[str, Tally]
    """Particle steps in which a limiter of the scheme acted, by its name."""
    step: Int[Array, ""]
    status: Status


class Search(eqx.Module):
    """Shapes and cadence of the neighbour tables; found in `build`, grown by `run`."""

    grid: Grid
    """Cells that the particles are sorted by."""
    method: AbstractSearch
    """Who finds the neighbours."""
    capacity: int = eqx.field(static=True)
    """Slots per fluid particle."""
    node_capacity: int = eqx.field(static=True)
    """Slots per interpolation node."""
    chamber_capacity: int = eqx.field(static=True)
    """Particles under a chamber's air pressure, at most."""
    rebuild_every: int = eqx.field(static=True)
    """Steps between searches."""
    skin: float = eqx.field(static=True)
    """Distance (m) that the search radius adds to the support."""


class Tables(eqx.Module):
    """Neighbour tables of one block of steps, and the positions for which they were made."""

    fluid: Int[Array, "K N"]
    nodes: Int[Array, "Kn G"]
    around: dict[str, Int[Array, "Kp P"]]
    """Fluid around the ghosts of every moving wall, by its name, for the force on it."""
    chambers: dict[str, Int[Array, " C"]]
    """Particles that may feel a chamber's air, by its name; N stands for none."""
    x: Float[Array, "N D"]
