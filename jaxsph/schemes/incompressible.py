"""Incompressible SPH by projection (Yeylaghi et al. 2016, Eq. 7-17; Cummins and Rudman 1999), 2-D and 3-D.

Equation numbers refer to Yeylaghi et al. unless another source is named.
"""

from __future__ import annotations

from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Float, Scalar, columns, dot, stack
from jaxsph.core.kernels import AbstractKernel
from jaxsph.core.pairs import Pair, Period, Smoothing
from jaxsph.core.parts import Part
from jaxsph.core.slabs import Sources
from jaxsph.model import laws
from jaxsph.model.interfaces import AbstractGrip, Model
from jaxsph.model.meaning import Entry
from jaxsph.model.regularisation import HYPERVISCOSITY, SEPARATION, Regularisation, regularisations
from jaxsph.model.shifting import Shifting
from jaxsph.model.state import Particles, Pressures, Response, State, Tables, Tally
from jaxsph.model.viscosity import AbstractViscosity, PhysicalViscosity
from jaxsph.parts.chamber import BodyForceGrip
from jaxsph.schemes.air import correct_for_air, couple_airs, finish_airs, on_bodies
from jaxsph.schemes.base import AbstractParticleScheme
from jaxsph.schemes.bodies import couple_bodies, push_bodies, under_air
from jaxsph.schemes.kernels import KERNEL, STEP_LENGTH, LatticeSums, lattice_sums, usual_length
from jaxsph.schemes.poisson import AbstractSolver, AbstractSurface, BiCGStab, EmptyNeighbours
from jaxsph.schemes.projection import (
    LEFT_OVER,
    MEAN_TIME,
    RELAXATION,
    RESPONSE,
    Poisson,
    PressureEquation,
    Projection,
    checked_solution,
    undoing,
)
from jaxsph.schemes.step import (
    Changes,
    GhostFields,
    Interval,
    at_rest,
    book,
    damp,
    drift,
    exchanged,
    force_work,
    move_walls,
    wall_work,
)
from jaxsph.schemes.time_step import stable_dt
from jaxsph.solids.contact import spring_acceleration, stop_at_solids, touch_force


class ISPH(AbstractParticleScheme):
    """Incompressible SPH scheme: projection onto divergence-free velocities."""

    too_fast: ClassVar[str] = "a particle moves more than 0.6 spacings in a step"
    grip: ClassVar[AbstractGrip] = BodyForceGrip()
    responds: ClassVar[bool] = True
    smoothing: Smoothing
    """Kernel, smoothing length and periodic axes."""
    dx: Scalar
    """Particle spacing, m."""
    rho0: Scalar
    """Density of water, kg/m3."""
    speed: Scalar
    """Largest expected speed, m/s."""
    lattice: LatticeSums
    """Sums of the kernel over a lattice."""
    viscosity: AbstractViscosity
    """Law of the viscous force."""
    solver: AbstractSolver
    """Solver of the pressure Poisson equation."""
    surface: AbstractSurface
    """Free-surface condition of the pressure Poisson equation."""
    relaxation: Scalar
    """Rate at which crowded particles are spread, as a multiple of sqrt(g/h) (-)."""
    least: Scalar
    """Lowest gauge pressure of water with a free surface, Pa; with 0 the water bears no tension."""
    regularisation: tuple[Regularisation, ...] = eqx.field(default=(), kw_only=True)
    """Regularisation of the particles: empty, or one entry."""
    shifting: tuple[Shifting, ...] = eqx.field(default=(), kw_only=True)
    """Particle shifting in addition to the drift: empty, or one entry."""

    @classmethod
    def of(
        cls,
        dx: float,
        speed: float,
        *,
        dim: int,
        rho0: float = 1000.0,
        viscosity: AbstractViscosity | None = None,
        kernel: AbstractKernel | None = None,
        h_over_dx: float | None = None,
        solver: AbstractSolver | None = None,
        surface: AbstractSurface | None = None,
        relaxation: float = RELAXATION,
        least: float = 0.0,
        period: Period = (),
        hyperviscosity: float = HYPERVISCOSITY,
        separation: float = SEPARATION,
        shifting: Shifting | None = None,
        dtype: Any = jnp.float32,
        **options: Any,
    ) -> ISPH:
        """Builds the incompressible scheme from plain numbers, in the precision `dtype`.

        **Arguments**: `dx`, spacing (m); `speed`, largest expected speed (m/s); `dim`, 2 or 3; `viscosity`,
        by default that of water; `kernel` and its smoothing length `h_over_dx` dx, by default from `KERNEL`
        and `usual_length`; `least`, the lowest pressure (Pa); `period`, the periodic axes (`Box.period`);
        `hyperviscosity`, `separation`, regularisation strengths (set both to 0 to disable it); `options`,
        further fields by name.
        """
        kernel = KERNEL[dim] if kernel is None else kernel
        viscosity = PhysicalViscosity(1.0e-6) if viscosity is None else viscosity
        surface = EmptyNeighbours() if surface is None else surface
        h_over_dx = usual_length(kernel, dim) if h_over_dx is None else h_over_dx

        def leaf(a):
            return jnp.asarray(a, dtype)

        return cls(
            smoothing=Smoothing(kernel, leaf(h_over_dx * dx), period),
            dx=leaf(dx),
            rho0=leaf(rho0),
            speed=leaf(speed),
            lattice=jax.tree.map(leaf, lattice_sums(kernel, h_over_dx, dim)),
            viscosity=jax.tree.map(leaf, viscosity),
            solver=BiCGStab() if solver is None else solver,
            surface=jax.tree.map(leaf, surface),
            relaxation=leaf(relaxation),
            least=leaf(least),
            regularisation=regularisations(hyperviscosity, separation, leaf),
            shifting=() if shifting is None else (jax.tree.map(leaf, shifting),),
            **jax.tree.map(leaf, options),
        )

    # ---------------------------------------------------------------- interface of a scheme

    def pressure(self, p):
        """See `AbstractScheme.pressure`."""
        return p.p

    def with_pressure(self, p, pressure):
        """See `AbstractScheme.with_pressure`."""
        return eqx.tree_at(lambda a: (a.p, a.p_mean), p, (pressure, pressure))

    def level_pressure(self, model, state):
        """See `AbstractParticleScheme.level_pressure`: the mean pressure."""
        return {"level_p": state.particles.p_mean} if model.walls.dummies else {}

    def stable_dt(self, g, dim):
        """See `AbstractScheme.stable_dt`."""
        nu = float(self.viscosity.kinematic(self.smoothing.h, 0.0, dim))
        return stable_dt(STEP_LENGTH[dim] * float(self.dx), float(self.speed), nu, g, 0.25)

    def description(self):
        """See `AbstractScheme.description`."""
        return f"incompressible, speeds up to {float(self.speed):.3g} m/s"

    def cost(self, dx, dim):
        """See `AbstractScheme.cost`: 2.2 us plus 30 ns per neighbour in two dimensions and 62 ns in three,
        including the solver's iterations; measured with and without bodies."""
        return 2.2e-6 + (30e-9 if dim == 2 else 62e-9) * self.neighbours(dx, dim)

    def fastest(self, dt):
        """See `AbstractScheme.fastest`: 0.6 spacings in a time step."""
        return 0.6 * self.dx / dt

    def compression(self, p):
        """See `AbstractScheme.compression`: zero."""
        return jnp.zeros((), p.x.dtype)

    def entries(self):
        """See `AbstractScheme.entries`."""
        return {
            "viscous": Entry("energy lost by viscosity"),
            "contact": Entry("energy lost in the contact of water with solids"),
            "projection": Entry("pressure work that neither water nor solids receive; may be negative"),
            **{name: entry for one in self.regularisation for name, entry in one.entries().items()},
        }

    def limiters(self):
        """See `AbstractScheme.limiters`."""
        return {
            "tension": "pressure below the lowest allowed pressure, raised to this limit",
            "crowding": "crowding stronger than that of ordinary disorder, limited",
            "response": "particles whose response to a chamber's air is raised to its lower bound",
        }

    # ---------------------------------------------------------------- one step

    def step(self, model, state, tables):
        """See `AbstractScheme.step`."""
        p, dt = state.particles, model.dt
        interval = move_walls(self, model, state, dt)
        push = spring_acceleration(model, state.parts, p, self._contact(model))
        ghosts = self.place_ghosts(model, state, tables)
        sheared = dt * self._viscous(model, state, tables, ghosts)
        u = p.u + sheared + dt * push
        # start from the air pressure of the previous step; the change follows after the projection
        airs = couple_airs(self, model, p, ghosts.water, tables, state.parts)
        before = {name: state.parts[name].P_a for name in airs}
        for name, air in airs.items():
            u = air.push(u, dt * before[name])
        # Eq. 7-8. `later`: share of the divergence of p.u left to the next step; divergence is linear in u.
        # The ghosts gain velocity from gravity and body forces as the water does, and the ghosts' pressure
        # contains the walls' acceleration. A divergence-free field is therefore divergence-free at walls too.
        later = 1.0 - LEFT_OVER
        eased = (u - later * p.u) / LEFT_OVER
        ghosts = self.ghost_velocity(model, state.parts, tables, ghosts.seeing(tables, u=columns(eased)))
        u_star = u + dt * (model.g + model.acceleration(p.x, interval.middle))
        u_left = LEFT_OVER * ghosts.u + dt * (model.g + model.acceleration(ghosts.x, interval.middle))
        # Yeylaghi et al. predict positions a whole step ahead; the pressures there damp waves at the rate
        # omega^2 dt/4. With positions half a step ahead, waves lose no energy to second order.
        at = self._halfway(model, state, interval, p.u, u_star - later * p.u)
        ghosts = self.place_ghosts(model, at, tables)
        sources = self._sources(ghosts, u_left)
        equation = self._equation(model, at, tables, ghosts, sources, interval)
        projected = self._projected(equation.under(on_bodies(airs, before)), at.particles.p)
        pressures = projected.pressures
        ghosts, sources, acceleration = self._pressed(pressures, ghosts, sources, tables)
        pressed = dt * acceleration
        met = u_star + pressed
        u_new = stop_at_solids(model, state.parts, p, met, push, self._contact(model))
        touched = u_new - met + dt * push
        u_new, damped = damp(model, p, u_new, interval)
        started = {body.name: at.parts[body.name].velocity for body in model.bodies}
        found = correct_for_air(
            model, airs, tables.responses, interval, projected.couplings, started, pressures, u_new
        )
        pressures, u_new, pressed = found.pressures, found.u, pressed + found.pressed
        if airs:
            ghosts = ghosts.seeing(tables, p=pressures.p)._replace(p=pressures.p_ghosts)
        changes = Changes(u_new, sheared, pressed, touched, damped)
        couplings = under_air(projected.couplings, found.on_bodies)
        projected = projected._replace(pressures=pressures, couplings=couplings)
        parts, ledger = self._exchange(model, state, at, tables, ghosts, interval, projected, changes)
        both = {name: (air.flow(p.u, started), found.flows[name]) for name, air in airs.items()}
        finished, taken = finish_airs(model, state.parts, found.met, both, dt)
        parts, ledger = parts | finished, book(ledger, taken)
        dx = dt * 0.5 * (u_new + p.u)  # Eq. 17
        for shifting in self.shifting:
            dx = dx + shifting.displacement(self, model, u_new, sources, tables, dt)
        share = -jnp.expm1(-dt * self.smoothing.gravity_rate(model.g) / MEAN_TIME)
        p_mean = p.p_mean + share * (pressures.p - p.p_mean)
        new = eqx.tree_at(lambda a: (a.u, a.p, a.p_mean), drift(p, dx), (u_new, pressures.p, p_mean))
        ledger = book(ledger, force_work(model, p, new, interval))
        limits = book(state.limits, projected.limited | {"response": found.limited})
        state = State(new, parts, ledger, limits, state.step + 1, checked_solution(state, projected))
        return self.check(model, state, tables, p.x, at.particles.x)

    def _halfway(
        self, model: Model, state: State, interval: Interval, drifting: jax.Array, u: jax.Array
    ) -> State:
        """State in the middle of the step, with the particles moved by the velocities `drifting` (m/s).

        The velocities of the state are u (m/s).
        """
        dt, parts = interval.dt, dict(state.parts)
        for wall in model.moving:
            parts[wall.name] = wall.halfway(parts[wall.name], interval.after[wall.name], dt)
        parts |= model.mechanism.drifted(parts, interval.t, 0.5 * dt)
        particles = eqx.tree_at(lambda p: p.u, drift(state.particles, 0.5 * dt * drifting), u)
        return eqx.tree_at(lambda s: (s.particles, s.parts), state, (particles, parts))

    def _exchange(
        self,
        model: Model,
        state: State,
        at: State,
        tables: Tables,
        ghosts: GhostFields,
        interval: Interval,
        projected: Projection,
        changes: Changes,
    ) -> tuple[dict[str, Any], dict[str, Tally]]:
        """States of the parts after the step, and the ledger with the step's energies (J, J/m in 2-D).

        `at`: state in the middle of the step, on which the projected pressures act.
        """
        p, dt, parts = state.particles, interval.dt, dict(interval.after)
        # the pressure acts over the whole step, in which the velocities change linearly
        work = wall_work(self, model, [interval.before, interval.after], tables, ghosts, dt)
        done = push_bodies(model, at.parts, interval.middle, dt, projected.couplings, projected.pressures)
        parts |= done.motions
        for body in model.bodies:
            contact = touch_force(model, body, state.parts[body.name], p, changes.touched, dt)
            parts[body.name] = eqx.tree_at(lambda b: b.contact, parts[body.name], contact)
        parts |= model.mechanism.drifted(parts, interval.middle, 0.5 * dt)
        given = done.by_pressure - sum(work.values(), jnp.zeros_like(dt))  # to solids, by pressure
        mean = 0.5 * (changes.u + p.u)
        viscous, contact, lost = (
            -jnp.sum(p.m * dot(columns(mean), columns(change)))
            for change in (changes.sheared, changes.touched, changes.pressed)
        )
        amounts = {"viscous": viscous, "contact": contact - done.by_touch, "projection": lost - given}
        amounts |= work | done.amounts | exchanged(model, p, mean, changes.damped)
        return parts, book(state.ledger, amounts)

    def _sources(self, ghosts: GhostFields, u_ghosts: Float[Array, "G D"]) -> Sources:
        """Sources of the pair sums: the water, and the ghosts with velocities `u_ghosts` (m/s)."""
        return ghosts.water.behind({"x": columns(ghosts.x), "V": -ghosts.V, "u": columns(u_ghosts)})

    def _sum(self, law, sources: Sources, tables: Tables):
        """Sum of a pair law over water and ghosts, for every water particle."""
        return tables.fluid.sum(law, self.smoothing, sources.water, sources)

    @staticmethod
    def _contact(model: Model) -> Scalar:
        """Speed (m/s) that sets the stiffness of the contact springs.

        The projection stops the water at solids; the springs stop particles that still come too close.
        """
        return 0.5 * model.dx / model.dt

    @Part.VISCOSITY.scope()
    def _viscous(
        self, model: Model, state: State, tables: Tables, ghosts: GhostFields
    ) -> Float[Array, "N D"]:
        """Viscous acceleration of the water, nu lap u, m/s2."""
        p = state.particles
        ghosts = self.ghost_velocity(model, state.parts, tables, ghosts)
        guard = laws.GUARD * self.smoothing.h**2
        sources = self._sources(ghosts, ghosts.u_shear)
        shear = self._sum(lambda pair, i, j: self.viscosity.shear(pair, i, j, guard), sources, tables)
        return self.viscosity.coefficient(self.smoothing.h, 0.0, p.x.shape[1]) * stack(shear)

    # ---------------------------------------------------------------- projection

    @Part.AIR.scope()
    def respond(self, model, state, tables):
        """See `AbstractParticleScheme.respond`: solves the pressure equation for the air's force, starting
        from the response at the last search."""
        solver = self.solver.tightened(RESPONSE)
        p, dt, still = state.particles, model.dt, jnp.zeros_like(state.particles.u)
        interval = at_rest(model, state)
        ghosts = self.place_ghosts(model, state, tables)
        resting = self.ghost_velocity(model, state.parts, tables, ghosts.seeing(tables, u=columns(still)))
        responses = {}
        for name, air in couple_airs(self, model, p, ghosts.water, tables, state.parts).items():
            kicked = ghosts.seeing(tables, u=columns(air.push(still, dt)))
            kicked = self.ghost_velocity(model, state.parts, tables, kicked)
            # use only the part of the ghosts' velocities that depends on the water's velocities
            sources = self._sources(kicked, kicked.u - resting.u)
            equation = self._equation(model, state, tables, kicked, sources, interval)
            equation = equation.unforced().under(air.reaction)
            pressure, _, _ = equation.solve(solver, equation.poisson.shrinking, p.p_air[name])
            pressures = equation.complete(pressure)
            _, _, acceleration = self._pressed(pressures, kicked, sources, tables)
            responses[name] = Response(pressures, dt * acceleration)
        return responses

    @Part.PRESSURE.scope()
    def _pressed(
        self, pressures: Pressures, ghosts: GhostFields, sources: Sources, tables: Tables
    ) -> tuple[GhostFields, Sources, Float[Array, "N D"]]:
        """Ghosts and sources with the given pressures, and the resulting acceleration of the water, m/s2."""
        ghosts = ghosts.seeing(tables, p=pressures.p)._replace(p=pressures.p_ghosts)
        sources = ghosts.water.behind({**sources.ghosts, "p": ghosts.p})
        return ghosts, sources, stack(self._sum(laws.pressure_force, sources, tables)) / self.rho0

    def _equation(
        self,
        model: Model,
        at: State,
        tables: Tables,
        ghosts: GhostFields,
        sources: Sources,
        interval: Interval,
    ) -> PressureEquation:
        """Pressure equation for the water of the state `at`, with the velocities of the sources."""
        walls = model.walls
        poisson = self._poisson(model, at.particles, ghosts, sources, tables)
        force = self.wall_force(model, at.parts, ghosts, interval)
        nowhere = jnp.zeros_like(ghosts.p)
        beyond = walls.pressure(ghosts.fit, nowhere, ghosts.x, ghosts.nodes, force)
        couplings = couple_bodies(self, model, at.parts, interval.middle, interval.dt, ghosts, tables)
        return PressureEquation(
            poisson,
            self.carrier(model, ghosts, tables),
            jnp.where(ghosts.fit.wet > 0, beyond, 0.0),
            couplings,
            self.rho0 * self.smoothing.h,
        )

    def _projected(self, equation: PressureEquation, start: Float[Array, " N"]) -> Projection:
        """Pressures that remove the velocities' divergence, and the accelerations of the bodies due to these
        pressures and all other forces.

        `start`: pressures (Pa) from which the solution starts.
        """
        poisson = equation.poisson
        source = poisson.shrinking + poisson.crowding
        pressure, residual, converged = equation.solve(self.solver, source, start)
        closed = poisson.closed()
        cut = ~closed & (pressure < self.least)
        pressure = jnp.where(closed, pressure - jnp.mean(pressure), jnp.maximum(pressure, self.least))
        # complete from the limited pressure: a tension that the water cannot bear must not act on a body
        limited = {"tension": jnp.sum(cut).astype(pressure.dtype), "crowding": poisson.held}
        return Projection(equation.complete(pressure), equation.couplings, residual, converged, limited)

    @Part.EQUATION.scope()
    def _poisson(
        self, model: Model, p: Particles, ghosts: GhostFields, sources: Sources, tables: Tables
    ) -> Poisson:
        """Weights, diagonal and source of the pressure Poisson equation (Eq. 9-12)."""
        h, walls = self.smoothing.h, model.walls
        guard = (0.1 * h) ** 2

        def law(pair: Pair, i, j):
            w = laws.laplacian_weight(pair, j, guard)
            V = laws.volume(j)
            return (laws.divergence(pair, i, j), V * pair.W, tuple(V * pair.F * r for r in pair.r), w), w

        (shrinking, fill, slope, diagonal), weights = tables.fluid.weights(
            law, self.smoothing, sources.water, sources
        )
        itself = self.volume(p) * self.smoothing.kernel.value(jnp.zeros_like(fill), h, p.x.shape[1])
        filled = (fill + itself) / self.lattice.full
        free = self.surface.free(filled)
        extra = self.surface.missing(filled) * jnp.maximum(self.lattice.weights / h**2 - diagonal, 0.0)
        if all(side == "periodic" for side in walls.sides):
            # a periodic box has no surface, although disorder may lower the kernel's sums
            free, extra = jnp.ones_like(free), jnp.zeros_like(free)
        scale = free / jnp.maximum(diagonal + extra, 1e-6 / h**2)
        # crowding relaxes on the time scale of gravity, sqrt(h/g)
        frequency, dt = self.smoothing.gravity_rate(model.g), model.dt
        edge = jnp.sqrt(sum((self.dx * a) ** 2 for a in slope) + 1e-12)
        spread, held = undoing(filled, edge, self.lattice, self.relaxation, frequency, dt)
        gain = scale * self.rho0 / dt
        both = gain * shrinking, gain * spread
        return Poisson(weights, tables.fluid, scale, diagonal, extra, free, *both, held)

    # ---------------------------------------------------------------- diagnostics

    def divergence(self, model: Model, state: State, tables: Tables) -> Float[Array, " N"]:
        """Divergence of the water's velocity at every particle, 1/s."""
        ghosts = self.place_ghosts(model, state, tables)
        ghosts = self.ghost_velocity(model, state.parts, tables, ghosts)
        return -self._sum(laws.divergence, self._sources(ghosts, ghosts.u), tables)
