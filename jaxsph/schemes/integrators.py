"""Time integrators of the weakly compressible scheme, which build a step from evaluations of the rates."""

from __future__ import annotations

import abc
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Components, Float, Scalar, columns, stack
from jaxsph.core.slabs import Sources
from jaxsph.model.air import Air, AirCoupling
from jaxsph.model.interfaces import Model
from jaxsph.model.shifting import Shifting
from jaxsph.model.state import Particles, Pressures, State, Tables
from jaxsph.schemes.air import WaterLine, couple_airs, finish_airs, meet_laws, on_bodies
from jaxsph.schemes.base import AbstractParticleScheme
from jaxsph.schemes.bodies import BodyWork, couple_bodies, push_bodies, under_air
from jaxsph.schemes.step import (
    GhostFields,
    Interval,
    book,
    damp,
    drift,
    exchanged,
    force_work,
    move_walls,
    wall_work,
)
from jaxsph.solids.contact import spring_acceleration, touch_force

__all__ = ["AbstractIntegrator", "AbstractRateScheme", "PredictorCorrector", "Rates", "SymplecticEuler"]


class Rates(NamedTuple):
    """Rates from the first pass over the pairs."""

    acceleration: Components
    """Acceleration, m/s2."""
    grad_rho: Components
    """Gradient of the density, kg/m4."""
    position_divergence: Float[Array, " N"]
    """Divergence of position (Zhu et al. 2020, Eq. 15) (-)."""
    limited: dict[str, Scalar]
    """Number of particles at which each of the scheme's limiters acted."""


class AbstractRateScheme(AbstractParticleScheme):
    """Scheme of explicit rates, advanced by a time integrator."""

    c0: eqx.AbstractVar[Scalar]
    """Speed of sound, m/s."""
    shifting: eqx.AbstractVar[tuple[Shifting, ...]]
    """Particle shifting in addition to the drift: empty, or one entry."""

    @abc.abstractmethod
    def sources(self, ghosts: GhostFields, u_ghosts: Float[Array, "G D"]) -> Sources:
        """Sources of the pair sums: the water, and the ghosts with velocities `u_ghosts` (m/s)."""

    @abc.abstractmethod
    def momentum(self, model: Model, p: Particles, sources: Sources, tables: Tables) -> Rates:
        """First pass over the pairs: accelerations (m/s2) and the gradient of the density (kg/m4)."""

    @abc.abstractmethod
    def continuity(
        self, p: Particles, sources: Sources, grad_rho: Components, tables: Tables
    ) -> Float[Array, " N"]:
        """Second pass over the pairs: rate of change of the density, kg/m3/s."""


class AbstractIntegrator(eqx.Module):
    """Time integrator, which builds a time step from evaluations of the rates."""

    cfl: eqx.AbstractClassVar[float]
    """Default ratio of time step to h/c0 (Zhu et al. 2020, Eq. 10) (-). In tests the integrator is stable
    at this ratio, with a margin."""

    evaluations: eqx.AbstractClassVar[int]
    """Number of evaluations of the rates in a step."""

    @abc.abstractmethod
    def step(self, scheme: AbstractRateScheme, model: Model, state: State, tables: Tables) -> State:
        """Advances the state by one time step."""


class SymplecticEuler(AbstractIntegrator):
    """Symplectic Euler integrator: velocity from the forces at t, then density and position from velocity.

    Each step needs one evaluation. If each velocity is assigned to the time half a step before its position,
    the reversible part of the step is the leapfrog scheme. This part is of second order, and stable up to
    twice the time step of the predictor-corrector. Only the dissipative terms are of first order.
    """

    cfl: ClassVar[float] = 0.5
    evaluations: ClassVar[int] = 1

    def step(self, scheme, model, state, tables):
        """See `AbstractIntegrator.step`."""
        p, dt = state.particles, model.dt
        interval, ghosts, rates, u, bodies, airs, taken = _accelerate(
            scheme, model, state, state, tables, state.parts, dt
        )
        # the continuity equation uses the velocities of the solids after the step
        after = _with_velocities(model, state.parts, interval.after, bodies.motions)
        ghosts = scheme.ghost_velocity(model, after, tables, ghosts.seeing(tables, u=columns(u)))
        # positions in the middle of the drift, as in the leapfrog scheme; with positions at the start of the
        # drift, the density of water in waves would change at the relative rate dt |grad u|^2
        middle = eqx.tree_at(lambda a: a.x, p, p.x + 0.5 * dt * u)
        sources = scheme.sources(ghosts, ghosts.u).changing("x", columns(middle.x))
        rate = scheme.continuity(middle, sources, rates.grad_rho, tables)
        rho = p.rho + dt * rate
        work = wall_work(scheme, model, [interval.after], tables, ghosts, dt)
        # the bodies move with their velocities after the step, like the water
        moved = model.mechanism.drifted(bodies.motions, interval.t, dt)
        dx = dt * u
        for shifting in scheme.shifting:
            dx = dx + shifting.displacement(scheme, model, u, sources, tables, dt)
        new = drift(eqx.tree_at(lambda a: (a.u, a.rho), p, (u, rho)), dx)
        parts = {**interval.after, **bodies.motions, **moved, **airs}
        ledger = book(state.ledger, taken | work | bodies.amounts | force_work(model, p, new, interval))
        limits = book(state.limits, rates.limited)
        state = State(new, parts, ledger, limits, state.step + 1, state.status)
        return scheme.check(model, state, tables, p.x, new.x)


class PredictorCorrector(AbstractIntegrator):
    """Predictor-corrector (Zhu et al. 2020; Monaghan 1989): half a step, then a full step.

    The full step uses the rates at the end of the half step.
    """

    cfl: ClassVar[float] = 0.25
    evaluations: ClassVar[int] = 2

    def step(self, scheme, model, state, tables):
        """See `AbstractIntegrator.step`."""
        half = self._advance(scheme, model, state, state, tables, 0.5 * model.dt)
        full = self._advance(scheme, model, state, half, tables, model.dt)
        full = eqx.tree_at(lambda a: a.step, full, state.step + 1)
        return scheme.check(model, full, tables, state.particles.x, full.particles.x)

    @staticmethod
    def _advance(
        scheme: AbstractRateScheme, model: Model, start: State, at: State, tables: Tables, dt: Scalar
    ) -> State:
        """Advances the state `start` by dt (s), with the rates evaluated in the state `at`."""
        p0, p = start.particles, at.particles
        t, mechanism = model.time(start), model.mechanism
        halfway = {**start.parts, **mechanism.drifted(start.parts, t, 0.5 * dt)}
        interval, ghosts, rates, u, bodies, airs, taken = _accelerate(
            scheme, model, start, at, tables, halfway, dt
        )
        moved = mechanism.drifted(bodies.motions, t + 0.5 * dt, 0.5 * dt)
        sources = scheme.sources(ghosts, ghosts.u)
        rate = scheme.continuity(p, sources, rates.grad_rho, tables)
        work = wall_work(scheme, model, [at.parts], tables, ghosts, dt)
        new = eqx.tree_at(lambda a: (a.u, a.rho), p0, (u, p0.rho + dt * rate))
        # positions move with the velocity of `at`: in the full step this is the midpoint rule
        dx = dt * p.u
        for shifting in scheme.shifting:
            dx = dx + shifting.displacement(scheme, model, p.u, sources, tables, dt)
        new = drift(new, dx)
        parts = {**interval.after, **bodies.motions, **moved, **airs}
        ledger = book(start.ledger, taken | work | bodies.amounts | force_work(model, p0, new, interval))
        limits = book(start.limits, rates.limited)
        return State(new, parts, ledger, limits, start.step, start.status)


class _Accelerated(NamedTuple):
    """Water, solids and air at the end of an interval, before the water drifts."""

    interval: Interval
    ghosts: GhostFields
    """Ghosts at the time at which `rates` are evaluated, with their velocities."""
    rates: Rates
    u: Float[Array, "N D"]
    """Velocities, m/s."""
    bodies: BodyWork
    """Motions of the bodies after the forces acted on them, and the energies that they exchanged."""
    airs: dict[str, Air]
    """Air of the chambers and ducts, by name."""
    taken: dict[str, Scalar]
    """Energies (J, J/m in 2-D) exchanged with the air and the dampers, by ledger name."""


def _accelerate(
    scheme: AbstractRateScheme,
    model: Model,
    start: State,
    at: State,
    tables: Tables,
    moving: Mapping[str, Any],
    dt: Scalar,
) -> _Accelerated:
    """Advances water, solids and air from `start` by dt (s), with all forces evaluated in the state `at`.

    `moving`: states of the parts by name, with the motions of the bodies before the forces act.
    """
    p0, p = start.particles, at.particles
    interval = move_walls(scheme, model, start, dt)
    push = spring_acceleration(model, at.parts, p, scheme.c0)
    ghosts = scheme.ghosts(model, at, tables, interval)
    # the air's force uses positions of the same time as the rates
    airs = couple_airs(scheme, model, p, scheme.sources(ghosts, ghosts.u), tables, at.parts)
    # the previous step's air pressure acts on the bodies, because within a step a change of the air
    # pressure moves only the water on which the air acts directly
    air = on_bodies(airs, {name: interval.before[name].P_a for name in airs})
    ghosts, bodies = _with_bodies(scheme, model, at, tables, interval, ghosts, air, moving)
    for body in model.bodies:
        contact = touch_force(model, body, at.parts[body.name], p, dt * push, dt)
        bodies.motions[body.name] = eqx.tree_at(lambda b: b.contact, bodies.motions[body.name], contact)
    ghosts = scheme.ghost_velocity(model, at.parts, tables, ghosts)
    rates = scheme.momentum(model, p, scheme.sources(ghosts, ghosts.u_shear), tables)
    u = p0.u + dt * (stack(rates.acceleration) + push + model.acceleration(p.x, interval.middle))
    before, after = (
        {body.name: motions[body.name].velocity for body in model.bodies}
        for motions in (moving, bodies.motions)
    )
    unpressed = {name: air.flow(u, after) for name, air in airs.items()}
    met = meet_laws(model, interval.before, _line_of(airs, unpressed, dt), interval)
    for name, air in airs.items():
        u = air.push(u, dt * met.chambers[name].P_a)
    flows = {name: (air.flow(p0.u, before), air.flow(u, after)) for name, air in airs.items()}
    finished, taken = finish_airs(model, interval.before, met, flows, dt)
    free, (u, changes) = u, damp(model, p0, u, interval)
    damped = exchanged(model, p0, 0.5 * (free + u), changes)
    return _Accelerated(interval, ghosts, rates, u, bodies, finished, taken | damped)


def _line_of(airs: Mapping[str, AirCoupling], flows: Mapping[str, Scalar], dt: Scalar) -> WaterLine:
    """Flows out of the chambers over a step of dt (s), as linear functions of the chambers' pressures.

    `flows`: flows if all pressures were zero, m3/s (m2/s in 2-D). Sound takes several steps to reach the
    water below: in one step the air moves only the water on which it acts directly.
    """
    moved = {name: dt * air.mobility() for name, air in airs.items()}
    return WaterLine(flows, {(a, b): moved[a] if a == b else jnp.zeros_like(dt) for a in airs for b in airs})


def _with_bodies(
    scheme: AbstractRateScheme,
    model: Model,
    at: State,
    tables: Tables,
    interval: Interval,
    ghosts: GhostFields,
    air: dict[str, Float[Array, " V"]],
    moving: Mapping[str, Any],
) -> tuple[GhostFields, BodyWork]:
    """Ghosts for the water of the state `at`, and the bodies after the water's pressure has acted on them.

    **Arguments**: `air`: forces of the air on the bodies by name, N, N m (per metre in 2-D); `moving`:
    states of the parts by name, with the motions of the bodies before the forces act.
    """
    p, dt = scheme.pressure(at.particles), interval.dt
    held = dict(moving)
    for body in model.bodies:
        before = moving[body.name]
        held[body.name] = eqx.tree_at(
            lambda m: (m.rates, m.contact), at.parts[body.name], (before.rates, before.contact)
        )
    couplings = couple_bodies(scheme, model, held, interval.t, dt, ghosts, tables)
    couplings = under_air(couplings, air)
    accelerations = tuple(coupling.acceleration(p, ghosts.p) for coupling in couplings)
    forces: dict[str, Array] = {}
    for coupling, acceleration in zip(couplings, accelerations, strict=True):
        ghosts = ghosts._replace(p=coupling.press(ghosts.p, acceleration))
        forces = coupling.forces(p, ghosts.p)
    pressures = Pressures(p, ghosts.p, accelerations, forces)
    return ghosts, push_bodies(model, moving, interval.t, dt, couplings, pressures)


def _with_velocities(
    model: Model, parts: Mapping[str, Any], walls: Mapping[str, Any], bodies: Mapping[str, Any]
) -> dict[str, Any]:
    """States of the parts with positions before the step, and velocities of the solids after the step."""
    moved = {wall.name: wall.with_velocity(parts[wall.name], walls[wall.name]) for wall in model.moving}
    turned = {
        body.name: eqx.tree_at(lambda b: b.velocity, parts[body.name], bodies[body.name].velocity)
        for body in model.bodies
    }
    return {**parts, **moved, **turned}
