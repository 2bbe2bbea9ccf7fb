"""State of a run: everything that evolves from step to step, and the neighbour tables of one block of steps.

Units are SI. x runs along the tank from the wavemaker's rest position; the last axis points up, and z = 0 is
the bed. In two dimensions all quantities are per metre of width.
"""

from __future__ import annotations

import enum
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxsph.core.arrays import Array, Float, Int, Scalar, on_device
from jaxsph.core.search.base import AbstractSearch, Grid
from jaxsph.core.slabs import ONE, Chosen, Neighbours, PointNeighbours, Slabs

__all__ = [
    "Failure",
    "Particles",
    "Pressures",
    "Response",
    "Search",
    "State",
    "Status",
    "Tables",
    "Tally",
    "settle",
    "with_mass",
]


class Particles(eqx.Module):
    """Particles of the fluid at one time, in the order of the last sort by cell."""

    x: Float[Array, "N D"]
    """Positions, m."""
    x_carry: Float[Array, "N D"]
    """Rounding error of the positions, m, to be added to x (compensated summation)."""
    u: Float[Array, "N D"]
    """Velocities, m/s."""
    rho: Float[Array, " N"]
    """Deviation of the density from rho0, kg/m3. The density itself, stored in float32, would not
    resolve the pressure."""
    m: Float[Array, " N"]
    """Masses, kg (kg/m in two dimensions)."""
    id: Int[Array, " N"]
    """Index of the particle in the initial lattice; sorting does not change the particle's index."""
    p: Float[Array, " N"]
    """Gauge pressure, Pa, if the scheme solves for the pressure; zero if the pressure follows from the
    density."""
    p_mean: Float[Array, " N"]
    """Running mean of p, Pa, over the time `schemes.projection.MEAN_TIME` sqrt(h/g)."""
    p_air: dict[str, Float[Array, " N"]] = eqx.field(default_factory=dict)
    """Change of p per Pa of air pressure in each chamber at the last search (-), by the chamber's name; empty
    if the scheme does not compute it."""


def with_mass(new: Particles, old: Particles) -> Particles:
    """Particles after a step; those without mass, which have no effect on the others, stay at rest where they
    were before."""
    there = (new.m > 0.0)[:, None]
    x, carry = (jnp.where(there, a, b) for a, b in ((new.x, old.x), (new.x_carry, old.x_carry)))
    return eqx.tree_at(lambda p: (p.x, p.x_carry, p.u), new, (x, carry, jnp.where(there, new.u, 0.0)))


class Tally(eqx.Module):
    """Running sum of an amount, in two parts: up to the last sample, and since the last sample.

    The sum since the last sample is small, so that the amount of a step is not lost to rounding. At a sample
    the recent sum is added to the settled sum, and the rounding error of this addition is kept (Knuth's
    two-sum). A long run therefore loses nothing to rounding either.
    """

    recent: Float[Array, "..."]
    """Amount since the last sample."""
    settled: Float[Array, "..."]
    """Amount from the start of the run to the last sample."""
    carry: Float[Array, "..."]
    """Rounding error of `settled`, to be added to `settled`."""

    @classmethod
    def zero(cls, dtype: Any, shape: tuple[int, ...] = ()) -> Tally:
        """Tally with a sum of zero."""
        return cls(*(jnp.zeros(shape, dtype) for _ in range(3)))

    @property
    def total(self) -> Float[Array, "..."]:
        """Amount since the start of the run."""
        return self.settled + (self.carry + self.recent)

    def add(self, amount: Float[Array, "..."]) -> Tally:
        """Tally with the amount of one step added."""
        return Tally(self.recent + amount, self.settled, self.carry)

    def settle(self) -> Tally:
        """Tally with the same total at a sample: the recent amount is moved to the settled amount."""
        settled = self.settled + self.recent
        kept = settled - self.settled
        lost = (self.settled - (settled - kept)) + (self.recent - kept)
        return Tally(jnp.zeros_like(self.recent), settled, self.carry + lost)

    def over(self, share: float) -> Tally:
        """Tally with the same total: a fraction `share` of the recent amount stays recent, and the remainder
        is moved to the settled amount.

        `share`: ratio of the new sampling interval to the old one.
        """
        rest = Tally(self.recent * (1.0 - share), self.settled, self.carry).settle()
        return Tally(self.recent * share, rest.settled, rest.carry)


def settle(tree: Any, due: jax.Array) -> Any:
    """Pytree with every `Tally` settled if a sample is `due`."""

    def settled(tally):
        return jax.tree.map(lambda a, b: jnp.where(due, a, b), tally.settle(), tally)

    return map_tallies(settled, tree)


def map_tallies(change: Callable[[Tally], Tally], tree: Any) -> Any:
    """Pytree with `change` applied to every `Tally`."""
    return jax.tree.map(
        lambda leaf: change(leaf) if isinstance(leaf, Tally) else leaf,
        tree,
        is_leaf=lambda leaf: isinstance(leaf, Tally),
    )


class Failure(enum.IntFlag):
    """Flags of failures inside the time loop; failures are reported once, outside the loop."""

    NEIGHBOUR_OVERFLOW = 1
    """A neighbour table had too few slots."""
    STALE_TABLE = 2
    """A particle moved by more than half the skin since the last search."""
    NON_FINITE = 4
    """A position, velocity or density is not finite."""
    THROUGH_WALL = 8
    """A particle is inside a solid, or has left the tank."""
    CHAMBER_OVERFLOW = 16
    """A chamber's air acts on more particles than the chamber's table has entries for."""
    TOO_FAST = 32
    """A particle is faster than the scheme allows."""
    NOT_CONVERGED = 64
    """A linear solve for the pressure did not converge."""
    TOUCHING = 128
    """A body is too near to another solid."""


SIZES = ("capacity", "node_capacity", "chamber_capacity", "halo", "points")
"""Names of the table sizes of a search, which are fields of `Search` and `slabs.Slabs`."""


class Status(eqx.Module):
    """Failures so far, with position and step of the first failure, and the largest table sizes and
    residual."""

    bits: Int[Array, ""]
    """`Failure` flags."""
    step: Int[Array, ""]
    """Step of the first failure."""
    where: Float[Array, " D"]
    """Position of the first failure, m."""
    most: dict[str, Int[Array, ""]]
    """Largest size that a table has needed since the start, by the name of the size (`SIZES`)."""
    residual: Scalar
    """Largest residual of a linear solve so far, relative to its right-hand side (-)."""
    speed2: Scalar
    """Square of the largest speed up to the first failure, m2/s2."""

    @classmethod
    def sound(cls, dim: int, dtype: Any) -> Status:
        """Status without a failure."""
        zero = on_device(0, np.int32)
        most = {name: zero for name in SIZES}
        none = on_device(0.0, dtype)
        return cls(zero, zero, on_device(np.zeros(dim), dtype), most, none, none)

    def flag(self, failure: Failure, failed: jax.Array, step: jax.Array, where: jax.Array) -> Status:
        """Status with a failure added if `failed`; step and position of the first failure are kept."""
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
    """State of a run: everything that evolves. Time is not accumulated: t = model.t0 + step * model.dt."""

    particles: Particles
    """Particles of the fluid."""
    parts: dict[str, Any]
    """States of the parts by their names, for example the motion of a paddle or body, or a chamber's air."""
    ledger: dict[str, Tally]
    """Energies exchanged, by name, J (J/m in 2-D); `Model.entries` describes them."""
    limits: dict[str, Tally]
    """Number of particle steps in which a limiter of the scheme acted, by the limiter's name."""
    step: Int[Array, ""]
    """Number of steps since t = model.t0."""
    status: Status
    """Failures, and the largest table sizes and residual."""


class Search(eqx.Module):
    """Neighbour search, with the sizes of its tables and its interval.

    Sizes and interval are set when the model is built, and adjusted during a run.
    """

    grid: Grid
    """Cells by which the particles are sorted."""
    method: AbstractSearch
    """Neighbour search that fills the tables."""
    capacity: int = eqx.field(static=True)
    """Number of neighbour slots per fluid particle."""
    node_capacity: int = eqx.field(static=True)
    """Number of neighbour slots per interpolation node."""
    chamber_capacity: int = eqx.field(static=True)
    """Largest number of particles on which a chamber's air acts."""
    rebuild_every: int = eqx.field(static=True)
    """Number of steps between two searches."""
    regularise_every: int = eqx.field(static=True)
    """Number of steps between two regularisations of the particles.

    This interval stays the same if stale tables require more frequent searches, so that the results of a run
    do not depend on the search interval.
    """
    skin: float = eqx.field(static=True)
    """Difference between the search radius and the kernel's support radius, m."""
    slabs: Slabs = eqx.field(default=ONE)
    """Devices among which the particles are divided."""


class Pressures(eqx.Module):
    """Pressures of water and ghosts, the forces of these pressures on the bodies, and the accelerations of
    the bodies' coordinates."""

    p: Float[Array, " N"]
    """Pressure of the water, Pa."""
    p_ghosts: Float[Array, " G"]
    """Pressure of the ghosts, Pa."""
    accelerations: tuple[Float[Array, " n"], ...]
    """Accelerations of the bodies' coordinates due to all forces, m/s2 or rad/s2; empty without bodies."""
    forces: dict[str, Float[Array, " V"]]
    """Generalised forces of the pressures on the bodies (N, N m; per metre in 2-D), by the body's name."""

    def plus(self, factor: Scalar, other: Pressures) -> Pressures:
        """Sum of these pressures and `factor` times the pressures `other`."""
        return jax.tree.map(lambda a, b: a + factor * b, self, other)


class Response(eqx.Module):
    """Response of the incompressible water to the air of one chamber, per Pa of the air's pressure in a
    step."""

    pressures: Pressures
    """Pressures that keep the water free of divergence, Pa/Pa."""
    u: Float[Array, "N D"]
    """Change of the water's velocity due to these pressures, m/s/Pa, without the direct force of the air."""


class Tables(eqx.Module):
    """Neighbour tables of one block of steps, and the positions at which they were made."""

    fluid: Neighbours
    """Particles and ghosts around every particle."""
    images: Chosen
    """Particles that the ghosts of plane walls mirror; these ghosts come first among all ghosts."""
    nodes: PointNeighbours
    """Particles around the interpolation nodes of the other ghosts."""
    around: dict[str, PointNeighbours]
    """Particles around the ghosts of every moving wall and body, by the solid's name, for the force on the
    solid."""
    chambers: dict[str, Int[Array, " C"]]
    """Indices of the particles on which a chamber's air may act, by the chamber's name; N marks an unused
    entry."""
    x: Float[Array, "N D"]
    """Positions of the particles at the search, m."""
    responses: dict[str, Response] = eqx.field(default_factory=dict)
    """Response of the water to the air in each chamber, by the chamber's name; empty for compressible
    schemes."""
