"""Pressure equation of the incompressible scheme: its linear operator, and its unknowns beside the pressures.

The unknowns are the pressures of the water and the accelerations of the bodies, since the pressure on a body
depends on its acceleration at once: with that of the step before a light body would swing without end. The
pressure of a chamber's air is an unknown as well (`schemes.air`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.core.slabs import Neighbours, Sources
from jaxsph.model.state import Failure, Pressures, State, Status
from jaxsph.schemes.base import BodyCoupling
from jaxsph.schemes.kernels import LatticeSums
from jaxsph.schemes.poisson import AbstractSolver, Unknown

RELAXATION = 1.5
"""Rate at which crowding of the particles is undone, over sqrt(g/h).

Projection alone leaves disordered water expanding: without relaxation the level of a tank rises by 6 % in
6 s. With half of this rate waves lose twice as much and the energy of still water grows; with twice this rate
still water is restless.
"""

SECOND_ROW = 28.0
"""Rate at which crowding of the second row under a free surface is undone, over `relaxation` dt g/h.

In a step of dt such a rate is a spring of as much g/h. It stands against pressure, which pushes that row
away from where it is (`surface_stiffness`); with the rate of other water the spring would be weaker the
longer the step. With 40 the row is not held much better, nor with the third row held too.
"""

MOST = 0.5
"""Largest share of the second row's crowding that a step undoes (-)."""

MEAN_TIME = 3.0
"""Time over which the pressure is averaged that tells dummies of the level, over sqrt(h/g).

A dummy that becomes wet crowds the water beside it, whose pressure then makes it wetter: with the pressure of
the last step the water under a leaning plate is never still. A mean over 1 is too quick at times, 2 and 6 are
not. It goes with the particles, which in waves stay as far under the surface as they are.
"""

LEFT_OVER = 0.5
"""Share of the divergence left over from the step before that a projection takes out.

The next step takes half of the rest, and so on. Were all of it taken out at once, the disorder that one step
leaves would be a pressure in the next, and pressures on a wall would scatter by 0.4 rho g H in Buchner's dam
break.
"""


class Poisson(NamedTuple):
    """Pressure Poisson equation of one step, scaled by its diagonal."""

    weights: Float[Array, "K N"]
    """Weights w_ij of sum w_ij (p_j - p_i) = lap p, 1/m2, by slot of the table."""
    table: Neighbours
    """Neighbours of the water among water and ghosts."""
    scale: Float[Array, " N"]
    """Inverse of the diagonal, m2; zero for particles whose pressure is not solved for."""
    diagonal: Float[Array, " N"]
    """Sum of the weights, 1/m2."""
    extra: Float[Array, " N"]
    """Weight of missing neighbours at the free surface, 1/m2."""
    free: Float[Array, " N"]
    """Mask of particles: 1 where the pressure is solved for, 0 elsewhere."""
    shrinking: Float[Array, " N"]
    """Source of the velocities, minus their divergence, as a pressure, Pa."""
    crowding: Float[Array, " N"]
    """Source of the crowding of the particles, as a pressure, Pa."""
    held: Scalar
    """Number of particles at which the limit of crowding acts."""

    def shown(self, q: Float[Array, " N"]) -> Sources:
        """Pressures of the water (Pa) as the field "f" of sources, for walls and water."""
        return self.table.slabs.fetch(Sources({"f": q}, {}))

    def neighbour_mean(self, q: Sources, q_ghosts: Float[Array, " G"]) -> Float[Array, " N"]:
        """Weighted mean of the pressures (Pa) of every particle's neighbours in the water and the walls.

        The water's pressures q are the one field "f".
        """
        return self.scale * self.table.weighted_sum(self.weights, q._replace(ghosts={"f": q_ghosts}))

    def closed(self) -> Array:
        """Whether there is no free surface: the pressure is then known up to a constant."""
        return jnp.sum(1.0 - self.free + self.extra) == 0.0


class Projection(NamedTuple):
    """Pressures that a projection finds, and the quality of the solution."""

    pressures: Pressures
    """Pressures of water and ghosts, and the accelerations of the bodies under them."""
    residual: Scalar
    """Residual of the linear solution over its right-hand side."""
    converged: Array
    """Whether the residual is as small as the solver promises."""
    limited: dict[str, Scalar]
    """Number of particles at which each limiter acted."""


class PressureEquation(NamedTuple):
    """Linear equation for the water's pressures and the bodies' accelerations."""

    poisson: Poisson
    """Equation of the water alone."""
    at_walls: Callable[[Sources], Float[Array, " G"]]
    """Pressures of the ghosts (Pa), from those of the water."""
    beyond: Float[Array, " G"]
    """Pressure of the ghosts over that at their nodes, by forces and the walls' accelerations, Pa."""
    couplings: dict[str, BodyCoupling]
    """Couplings of the bodies by name."""
    unit: Scalar
    """Pressure per acceleration, Pa per m/s2: in the residual, accelerations are as large as pressures."""

    def unforced(self) -> PressureEquation:
        """The equation without forces on walls and bodies: pressures by a source alone."""
        free = {n: c._replace(outside=jnp.zeros_like(c.outside)) for n, c in self.couplings.items()}
        return self._replace(beyond=jnp.zeros_like(self.beyond), couplings=free)

    def solve(
        self, solver: AbstractSolver, source: Float[Array, " N"], start: Float[Array, " N"]
    ) -> tuple[Float[Array, " N"], Scalar, Array]:
        """Pressures of the water (Pa) for a source (Pa), their residual, and whether it is small enough.

        `start`: pressures to begin with, Pa.
        """
        poisson, nothing = self.poisson, jnp.zeros_like(source)
        b = source + poisson.neighbour_mean(poisson.shown(nothing), self.beyond)
        # The weights, symmetric before they are scaled, can only give a right-hand side whose mean, weighted
        # by the diagonal, is zero in a closed box.
        mean = jnp.sum(poisson.diagonal * b) / jnp.sum(poisson.diagonal)
        b = b - jnp.where(poisson.closed(), mean, 0.0)
        b_bodies = {
            name: self.unit * coupling.acceleration(nothing, self.beyond)
            for name, coupling in self.couplings.items()
        }
        begin = (poisson.free * start, jax.tree.map(jnp.zeros_like, b_bodies))
        (solved, _), residual, converged = solver.solve(self._operator, (b, b_bodies), begin)
        return poisson.free * solved, residual, converged

    def complete(self, pressure: Float[Array, " N"]) -> Pressures:
        """Pressures of the ghosts, and accelerations of the bodies, that go with the water's (Pa)."""
        p_ghosts = self.at_walls(self.poisson.shown(pressure)) + self.beyond
        accelerations = {n: c.acceleration(pressure, p_ghosts) for n, c in self.couplings.items()}
        for name, coupling in self.couplings.items():
            p_ghosts = coupling.press(p_ghosts, coupling.movable * accelerations[name])
        forces = {name: coupling.force(pressure, p_ghosts) for name, coupling in self.couplings.items()}
        return Pressures(pressure, p_ghosts, accelerations, forces)

    def _operator(self, unknown: Unknown) -> Unknown:
        """Left-hand side of the equation for the unknowns, in Pa."""
        poisson = self.poisson
        q, accelerations = poisson.free * unknown[0], unknown[1]
        near = poisson.shown(q)
        q_ghosts = both = self.at_walls(near)
        driven = {}
        for name, coupling in self.couplings.items():
            both = coupling.press(both, coupling.movable * (accelerations[name] / self.unit))
            driven[name] = accelerations[name] - self.unit * coupling.response(q, q_ghosts)
        return q - poisson.neighbour_mean(near, both) + (1.0 - poisson.free) * q, driven


def checked_solution(state: State, projected: Projection) -> Status:
    """Status with the largest residual so far, and a flag where a solution did not converge."""
    status = state.status
    residual = jnp.maximum(status.residual, projected.residual)
    status = eqx.tree_at(lambda s: s.residual, status, residual)
    failed = ~projected.converged
    return status.flag(Failure.NOT_CONVERGED, failed, state.step, jnp.zeros_like(status.where))


def undoing(
    filled: Float[Array, " N"],
    edge: Float[Array, " N"],
    lattice: LatticeSums,
    relaxation: Scalar,
    frequency: Scalar,
    dt: Scalar,
) -> tuple[Float[Array, " N"], Scalar]:
    """Rate of expansion that undoes crowding, 1/s, and the number of particles at the limits of crowding.

    Crowding, the relative excess of the particles' density, is negative where they are too loose; the limits
    hold it within what disorder makes. Particles whose kernel is filled to less than 0.8 are at the surface
    and have none. The second row under the surface, told by the slope of the kernel's sum, is at rest with
    what it lacks on a lattice, and is held the firmer the longer the step is.

    **Arguments**: `filled`: the kernel's sum over that of a lattice; `edge`: its slope |sum V grad W|, times
    dx; `lattice`: the sums of a lattice; `relaxation`: see `RELAXATION`; `frequency`: sqrt(g/h), 1/s; time
    step dt, s.
    """
    first, second = lattice.edges
    # whole at the second row's own slope, nothing in a whole lattice and at the first row
    row = jnp.clip(2.0 * edge / second - 0.5, 0.0, 1.0)
    row = row * jnp.clip(2.0 * (first - edge) / (first - second) - 0.5, 0.0, 1.0)
    inside = jnp.clip((filled - 0.8) / 0.1, 0.0, 1.0)
    usual = relaxation * frequency
    firm = jnp.minimum(SECOND_ROW * dt * frequency * usual, MOST / dt)
    excess = filled + row * lattice.lacks - 1.0
    within = jnp.clip(excess, -0.05, 0.2)
    limited = jnp.sum((inside == 1.0) & (within != excess))
    return jnp.maximum(usual, row * firm) * inside * within, limited.astype(filled.dtype)
