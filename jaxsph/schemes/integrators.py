"""Weakly compressible delta-SPH (Zhu et al. 2020, section 2; Antuono et al. 2012)."""

from __future__ import annotations

import abc
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Components, Float, Scalar, columns, dot, stacked
from jaxsph.core.pairs import (
    with_empty,
)
from jaxsph.model.interfaces import Model
from jaxsph.model.state import BodyState, State, Tables
from jaxsph.schemes.base import (
    AbstractParticleScheme,
    GhostFields,
    body_moved,
    damped,
    paddle_moved,
    pushed,
    touching,
    with_body_work,
    with_work,
)


class AbstractIntegrator(eqx.Module):
    """How a step is made of evaluations."""

    cfl: eqx.AbstractClassVar[float]
    """Default share of h/c0 (Eq. 10) for dt, found by measurement to be stable with room to spare."""

    @abc.abstractmethod
    def step(self, scheme: AbstractParticleScheme, model: Model, state: State, tables: Tables) -> State:
        """One time step."""


class SymplecticEuler(AbstractIntegrator):
    """One evaluation a step: the velocity with the forces of t, then density and position with it.

    Velocities are those of the half step before the positions', so the reversible part is the leapfrog,
    second order, and stable to twice the step of the predictor-corrector; only the dissipative terms are
    first order.
    """

    cfl: ClassVar[float] = 0.5

    def step(self, scheme, model, state, tables):
        """See `AbstractIntegrator`."""
        p, dt, t = state.particles, model.dt, model.time(state)
        x_old = p.x
        paddle, a_wall = paddle_moved(scheme, model, state, dt)
        push = pushed(model, state, scheme.c0)
        ghosts, body = _with_body(scheme, model, state, state, tables, a_wall, push, dt)
        ghosts = scheme.ghost_velocity(model, state, tables, ghosts, p.u)
        sources = scheme.sources(ghosts, p, p.u, ghosts.u_shear)
        rates = scheme.momentum(model, p, sources, tables)
        u = p.u + dt * (stacked(rates.acceleration) + _by_no_pair(model, state, push))
        u, air, work = _air(scheme, model, state, tables, sources, u, dt, t)
        u, sponge = damped(model, p, u, dt)
        before = state
        state = eqx.tree_at(lambda a: a.paddle, state, state.paddle.at[1].set(paddle[1]))
        if body is not None:
            state = eqx.tree_at(lambda a: a.body.velocity, state, body.velocity)
        ghosts = scheme.ghost_velocity(model, state, tables, ghosts, u)
        sources = scheme.sources(ghosts, p, u, ghosts.u)
        rho = p.rho + dt * scheme.continuity(p, sources, rates.grad_rho, tables)
        work = with_work(scheme, model, tables, ghosts, work, sponge, paddle[1], dt)
        if body is not None:
            work, *_ = with_body_work(model, before, work, body, dt)
            # as the water: with the velocity after the step
            body = eqx.tree_at(lambda b: b.pose, body, before.body.pose + dt * body.velocity)
        p = eqx.tree_at(lambda a: (a.u, a.rho), p, (u, rho))
        dx = dt * u
        if scheme.shifting is not None:
            dx = dx + scheme.shifting.displacement(scheme, model, u, sources, tables, dt)
        p = scheme.drift(p, dx)
        state = State(p, paddle, air, work, state.step + 1, state.status, body)
        return scheme.check(model, state, tables, x_old)


class PredictorCorrector(AbstractIntegrator):
    """The paper's scheme (Monaghan 1989): a half step, then a whole one with the rates found there."""

    cfl: ClassVar[float] = 0.25

    def step(self, scheme, model, state, tables):
        """See `AbstractIntegrator`."""
        half = self._advance(scheme, model, state, state, tables, 0.5 * model.dt)
        full = self._advance(scheme, model, state, half, tables, model.dt)
        full = eqx.tree_at(lambda a: a.step, full, state.step + 1)
        return scheme.check(model, full, tables, state.particles.x)

    @staticmethod
    def _advance(
        scheme: AbstractParticleScheme, model: Model, start: State, at: State, tables: Tables, dt: Scalar
    ) -> State:
        """`start` advanced by dt with the rates of `at`."""
        p0, p, t = start.particles, at.particles, model.time(start)
        paddle, a_wall = paddle_moved(scheme, model, start, dt)
        push = pushed(model, at, scheme.c0)
        ghosts, body = _with_body(scheme, model, start, at, tables, a_wall, push, dt)
        ghosts = scheme.ghost_velocity(model, at, tables, ghosts, p.u)
        sources = scheme.sources(ghosts, p, p.u, ghosts.u_shear)
        rates = scheme.momentum(model, p, sources, tables)
        sources = scheme.sources(ghosts, p, p.u, ghosts.u)
        rate = scheme.continuity(p, sources, rates.grad_rho, tables)
        u = p0.u + dt * (stacked(rates.acceleration) + _by_no_pair(model, at, push))
        u, air, work = _air(scheme, model, start, tables, sources, u, dt, t)
        u, sponge = damped(model, p0, u, dt)
        work = with_work(scheme, model, tables, ghosts, work, sponge, at.paddle[1], dt)
        if body is not None:
            work, *_ = with_body_work(model, start, work, body, dt)
        new = eqx.tree_at(lambda a: (a.u, a.rho), p0, (u, p0.rho + dt * rate))
        # trapezoidal in the positions: with the rates of the half step this is the midpoint rule
        dx = dt * p.u
        if scheme.shifting is not None:
            dx = dx + scheme.shifting.displacement(scheme, model, p.u, sources, tables, dt)
        new = scheme.drift(new, dx)
        return State(new, paddle, air, work, start.step, start.status, body)


def _with_body(
    scheme: AbstractParticleScheme,
    model: Model,
    start: State,
    at: State,
    tables: Tables,
    a_wall: Scalar,
    push: Float[Array, "N D"],
    dt: Scalar,
) -> tuple[GhostFields, BodyState | None]:
    """All ghosts for the water of `at`, which solids push off so, and the body of `start` after dt under its
    pressure."""
    ghosts = scheme.ghosts(model, at, tables, a_wall)
    if model.body is None:
        return ghosts, None
    rows = slice(*model.walls.solid)
    coupling = scheme.body_coupling(model, at, start.body, ghosts, tables, dt)
    p = scheme.pressure(at.particles)
    acceleration = coupling.accelerated(p, ghosts.p[rows])
    ghosts = ghosts._replace(p=ghosts.p.at[rows].add(coupling.pressures(acceleration)))
    body = body_moved(start.body, acceleration, dt)
    force = coupling.grip.force(p, ghosts.p[rows])
    contact = touching(model, at, dt * push, dt)
    return ghosts, eqx.tree_at(lambda b: (b.force, b.contact), body, (force, contact))


def _by_no_pair(model: Model, state: State, push: Float[Array, "N D"]) -> Float[Array, "N D"]:
    """Acceleration that is no pair's: `push` off the solids, and the force field's, m/s2."""
    return push if model.force is None else push + model.force.acceleration(state.particles.x)


def _air(scheme, model, state, tables, sources, u, dt, t):
    """The chamber's air on velocities that have had every other force."""
    work = state.work
    if model.chamber is None:
        return u, state.air, work
    grip, m = model.chamber.grip(
        state.particles, with_empty(sources), tables.fluid, tables.chamber, scheme.smoothing
    )
    u, P_a, q_free, q = model.chamber.kick(u, grip, m, tables.chamber, dt, t)
    q_old = -jnp.sum(dot(grip, _at(state.particles.u, tables.chamber)))
    # force times mean velocity over the step: exactly the kinetic energy that the kick takes
    taken = dt * P_a * 0.5 * (q_old + q)
    work = eqx.tree_at(lambda w: (w.pto, w.flow), work, (work.pto + taken, work.flow + dt * q))
    return u, jnp.stack([P_a, q]), work


def _at(u: jax.Array, index: jax.Array) -> Components:
    return columns(u[jnp.minimum(index, u.shape[0] - 1)])
