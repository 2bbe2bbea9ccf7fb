"""Pressure equation of the incompressible scheme: its linear operator, its source and its unknowns.

The unknowns are the pressures of the water and the accelerations of the bodies. The pressure on a body
depends instantaneously on the body's acceleration. If the acceleration of the previous step were used, a
light body would oscillate without end. The pressure of a chamber's air is an unknown as well (`schemes.air`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.core.parts import Part
from jaxsph.core.slabs import Neighbours, Sources
from jaxsph.model.state import Failure, Pressures, State, Status
from jaxsph.schemes.bodies import BodiesCoupling, under_air
from jaxsph.schemes.kernels import LatticeSums
from jaxsph.schemes.poisson import AbstractSolver, Unknown

RESPONSE = 3.0
"""Ratio of the tolerance of the pressure solver to that of the response to the air (-).

A solution that starts from the response at the last search keeps the smooth part of that response's error.
In the built-in OWC the flow per Pa of air pressure then has an error of up to 1.3 % with the tolerance of the
pressure solver, and of up to 0.4 % with a third of this tolerance. A solution that starts from zero has an
error of up to 0.8 % with the tolerance of the pressure solver.
"""

RELAXATION = 1.5
"""Rate at which crowded particles are spread, as a multiple of sqrt(g/h) (-).

With projection alone disordered water expands, and the water level in a tank rises by 6 % in 6 s.
At half this rate waves lose twice as much energy, and the energy of still water grows. At twice this rate
the particles of still water do not come to rest.
"""

SECOND_ROW = 28.0
"""Rate of removing crowding in the second row below a free surface, as a multiple of `relaxation` dt g/h (-).

A rate proportional to dt acts as a spring whose stiffness does not depend on dt. The pressure pushes this row
out of place (`surface_stiffness`), and the spring counteracts the pressure. With the rate used elsewhere in
the water the spring would weaken as the time step grows. Neither a value of 40 nor the same rate in the third
row improves the result noticeably.
"""

MOST = 0.5
"""Largest share of the second row's crowding that is removed in one step (-)."""

MEAN_TIME = 3.0
"""Averaging time of the pressure from which the water level at dummies is computed, as a multiple of
sqrt(h/g) (-).

A dummy that becomes wet crowds the water next to it, and the pressure of that water makes the dummy wetter.
With the pressure of the last step, water below a leaning plate never comes to rest. A value of 1 is
sometimes too small; values of 2 and 6 are large enough. Every particle has its own mean, because a particle
stays at the same depth below the surface of waves.
"""

LEFT_OVER = 0.5
"""Share of the divergence left by the previous step that a projection removes (-).

The next step removes half of the remainder, and so on. If all of the divergence were removed at once, the
disorder left by one step would become a pressure in the next step. In Buchner's dam break the pressures on
the wall would then scatter by 0.4 rho g H.
"""


class Poisson(NamedTuple):
    """Pressure Poisson equation of one step, scaled by its diagonal."""

    weights: Float[Array, " E"]
    """Weights w_ij of the Laplacian lap p = sum_j w_ij (p_j - p_i), 1/m2, stored as for `weighted_sum`."""
    table: Neighbours
    """Neighbours of the water particles among water and ghosts."""
    scale: Float[Array, " N"]
    """Inverse of the matrix's diagonal, 1 / (`diagonal` + `extra`), m2; zero for particles whose pressure is
    not solved for."""
    diagonal: Float[Array, " N"]
    """Sum of the weights, 1/m2."""
    extra: Float[Array, " N"]
    """Increase of the diagonal for missing neighbours at the free surface, 1/m2."""
    free: Float[Array, " N"]
    """Mask of particles: 1 where the pressure is solved for, 0 elsewhere."""
    shrinking: Float[Array, " N"]
    """Source due to the velocities, proportional to minus their divergence and scaled to a pressure, Pa."""
    crowding: Float[Array, " N"]
    """Source that spreads crowded particles, scaled to a pressure, Pa."""
    held: Scalar
    """Number of particles whose crowding is outside the permitted range and is clipped."""

    def shown(self, q: Float[Array, " N"]) -> Sources:
        """Pressures of the water (Pa) as the field "f" of sources, fetched for all devices."""
        return self.table.slabs.fetch(Sources({"f": q}, {}))

    def neighbour_mean(self, q: Sources, q_ghosts: Float[Array, " G"]) -> Float[Array, " N"]:
        """Weighted mean, for each particle, of its neighbours' pressures (Pa) in the water and the walls.

        Missing neighbours at a free surface count as zero, with the weight `extra`. The result is zero for
        particles whose pressure is not solved for.
        `q`: sources with the water's pressures as their only field "f" (see `shown`).
        """
        return self.scale * self.table.weighted_sum(self.weights, q._replace(ghosts={"f": q_ghosts}))

    def closed(self) -> Array:
        """Whether there is no free surface; without a free surface the pressure is determined only up to a
        constant."""
        return jnp.sum(1.0 - self.free + self.extra) == 0.0


class Projection(NamedTuple):
    """Pressures from a projection, and the quality of the solution."""

    pressures: Pressures
    """Pressures of water and ghosts, and the resulting accelerations and forces of the bodies."""
    couplings: tuple[BodiesCoupling, ...]
    """Coupling of the bodies to the water; empty without bodies."""
    residual: Scalar
    """Residual of the linear system, relative to the right-hand side (-)."""
    converged: Array
    """Whether the residual is within the tolerance of the solver."""
    limited: dict[str, Scalar]
    """Number of particles at which each limiter acted."""


class PressureEquation(NamedTuple):
    """Linear equation for the water's pressures and the bodies' accelerations."""

    poisson: Poisson
    """Equation of the water alone."""
    at_walls: Callable[[Sources], Float[Array, " G"]]
    """Function that gives the pressures of the ghosts (Pa) from the pressures of the water."""
    beyond: Float[Array, " G"]
    """Pressure difference from nodes to ghosts, due to forces and the walls' accelerations, Pa."""
    couplings: tuple[BodiesCoupling, ...]
    """Coupling of the bodies to the water; empty without bodies."""
    unit: Scalar
    """Factor that scales accelerations to pressures for the residual, Pa per m/s2."""

    def unforced(self) -> PressureEquation:
        """The equation without forces on walls and bodies; its solution is due to the source alone."""
        free = tuple(c._replace(outside=jnp.zeros_like(c.outside)) for c in self.couplings)
        return self._replace(beyond=jnp.zeros_like(self.beyond), couplings=free)

    def under(self, air: dict[str, Float[Array, " V"]]) -> PressureEquation:
        """The equation with the forces of the air on the bodies by name, N, N m (per metre in 2-D)."""
        return self._replace(couplings=under_air(self.couplings, air))

    @Part.SOLVER.scope()
    def solve(
        self, solver: AbstractSolver, source: Float[Array, " N"], start: Float[Array, " N"]
    ) -> tuple[Float[Array, " N"], Scalar, Array]:
        """Pressures of the water (Pa) for a source (Pa), the residual (-), and whether the solver converged.

        `start`: first guess of the pressures, Pa.
        """
        poisson, nothing = self.poisson, jnp.zeros_like(source)
        b = source + poisson.neighbour_mean(poisson.shown(nothing), self.beyond)
        # The weights are symmetric before they are scaled. In a closed box the equation is therefore solvable
        # only if the mean of the right-hand side, weighted by the diagonal, is zero.
        mean = jnp.sum(poisson.diagonal * b) / jnp.sum(poisson.diagonal)
        b = b - jnp.where(poisson.closed(), mean, 0.0)
        b_bodies = tuple(self.unit * c.acceleration(nothing, self.beyond) for c in self.couplings)
        begin = (poisson.free * start, jax.tree.map(jnp.zeros_like, b_bodies))
        (solved, _), residual, converged = solver.solve(self._operator, (b, b_bodies), begin)
        return poisson.free * solved, residual, converged

    def complete(self, pressure: Float[Array, " N"]) -> Pressures:
        """Ghost pressures, body accelerations and body forces that result from given water pressures (Pa)."""
        p_ghosts = self.at_walls(self.poisson.shown(pressure)) + self.beyond
        accelerations, forces = [], {}
        for coupling in self.couplings:
            accelerations.append(coupling.acceleration(pressure, p_ghosts))
            p_ghosts = coupling.press(p_ghosts, accelerations[-1])
            forces = coupling.forces(pressure, p_ghosts)
        accelerations = tuple(accelerations)
        return Pressures(pressure, p_ghosts, accelerations, forces)

    def _operator(self, unknown: Unknown) -> Unknown:
        """Left-hand side of the equation for the unknowns, in Pa."""
        poisson = self.poisson
        q, accelerations = poisson.free * unknown[0], unknown[1]
        near = poisson.shown(q)
        q_ghosts = both = self.at_walls(near)
        driven = []
        for coupling, acceleration in zip(self.couplings, accelerations, strict=True):
            both = coupling.press(both, acceleration / self.unit)
            driven.append(acceleration - self.unit * coupling.response(q, q_ghosts))
        return q - poisson.neighbour_mean(near, both) + (1.0 - poisson.free) * q, tuple(driven)


def checked_solution(state: State, projected: Projection) -> Status:
    """Status with the largest residual so far, and a flag if the solution did not converge."""
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
    """Rate of expansion that removes crowding, 1/s, and the number of particles whose crowding is clipped.

    Crowding is the relative excess of the particles' density. Crowding is negative where particles are too
    sparse, and is limited to the range that ordinary disorder causes. Particles with `filled` below 0.8 are
    at the surface and have no crowding. The second row of particles below the surface is recognised by the
    slope of the kernel sum. Crowding in this row is relative to the row's density on a lattice, and the rate
    of its removal grows with dt (`SECOND_ROW`).

    **Arguments**: `filled`: ratio of the kernel sum to the kernel sum of a full lattice (-); `edge`: slope
    |sum V grad W| of the kernel sum, times dx (-); `lattice`: sums of the kernel over a lattice;
    `relaxation`: see `RELAXATION`; `frequency`: sqrt(g/h), 1/s; `dt`: time step, s.
    """
    first, second = lattice.edges
    # 1 at the slope of the second row, 0 in a full lattice and at the first row
    row = jnp.clip(2.0 * edge / second - 0.5, 0.0, 1.0)
    row = row * jnp.clip(2.0 * (first - edge) / (first - second) - 0.5, 0.0, 1.0)
    inside = jnp.clip((filled - 0.8) / 0.1, 0.0, 1.0)
    usual = relaxation * frequency
    firm = jnp.minimum(SECOND_ROW * dt * frequency * usual, MOST / dt)
    excess = filled + row * lattice.lacks - 1.0
    within = jnp.clip(excess, -0.05, 0.2)
    limited = jnp.sum((inside == 1.0) & (within != excess))
    return jnp.maximum(usual, row * firm) * inside * within, limited.astype(filled.dtype)
