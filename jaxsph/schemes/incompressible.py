"""Incompressible SPH by projection (Yeylaghi et al. 2016, Eq. 7-17; Cummins and Rudman 1999), 2-D and 3-D.
Equation numbers are those of Yeylaghi et al. unless another source is named."""

from __future__ import annotations

from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxsph.core.arrays import Array, Float, Scalar, columns, stacked
from jaxsph.core.kernels import AbstractKernel, WendlandC2
from jaxsph.core.pairs import Pair, Period, Smoothing, pair_sum, pair_weights, weighted_sum, with_empty
from jaxsph.model import laws
from jaxsph.model.interfaces import Model
from jaxsph.model.shifting import Shifting
from jaxsph.model.state import BodyState, Particles, State, Tables
from jaxsph.model.viscosity import AbstractViscosity, PhysicalViscosity
from jaxsph.schemes.base import (
    AbstractParticleScheme,
    Dissipation,
    GhostFields,
    body_moved,
    damped,
    paddle_moved,
    pushed,
    stopped,
    touching,
    with_body_work,
    with_work,
)
from jaxsph.schemes.poisson import (
    AbstractSolver,
    AbstractSurface,
    BiCGStab,
    EmptyNeighbours,
)

H_OVER_DX = {2: 2.0, 3: 1.5}
"""Smoothing length over the spacing, by dimensions. In two a square lattice under pressure is quiet with 2,
and its rows slide with 1.3 to 1.85 and with 2.2: still water moves at 0.2 %, or 2 to 6 %, of sqrt(g d). In
three it is the paper's (section 2)."""


RELAXATION = 1.5
"""Rate at which crowding of the particles is taken back, over sqrt(g/h). Projection leaves disordered water
expanding: with none the level of a tank rises by 6 % in 6 s. With a half of this waves lose twice as much
and the energy of still water grows; with twice this still water is restless."""


class ISPH(AbstractParticleScheme):
    """Projection onto velocities without divergence."""

    too_fast: ClassVar[tuple[str, str]] = (
        "a particle goes farther than half a smoothing length in a step",
        "raise scheme.speed, or reduce scheme.cfl",
    )
    steadier: ClassVar[str] = "reduce scheme.cfl, or raise scheme.speed"
    smoothing: Smoothing
    rho0: Scalar
    speed: Scalar
    """Largest speed to expect, m/s."""
    full: Scalar
    """sum V W on the lattice."""
    full_weights: Scalar
    """Sum of the Laplacian's weights on the lattice, times h^2."""
    viscosity: AbstractViscosity
    solver: AbstractSolver
    surface: AbstractSurface
    relaxation: Scalar
    """Rate at which crowding of the particles is taken back, over sqrt(g/h)."""
    least: Scalar
    """Least gauge pressure that water bears where there is a free surface, Pa; 0: none that pulls."""
    shifting: Shifting | None = None

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
        period: Period = None,
        dtype: Any = jnp.float32,
        **options: Any,
    ) -> ISPH:
        """The scheme from plain numbers, in the precision `dtype`.

        **Arguments**: `dx`, spacing (m); `speed`, the largest to expect (m/s); `dim`, 2 or 3; `viscosity`, by
        default water's; `kernel`, by default Wendland's, of smoothing length `h_over_dx` dx, by default
        `H_OVER_DX`; `period`: `Box.period`; `options`: further objects by name.
        """
        kernel = WendlandC2() if kernel is None else kernel
        viscosity = PhysicalViscosity(1.0e-6) if viscosity is None else viscosity
        surface = EmptyNeighbours() if surface is None else surface
        h_over_dx = H_OVER_DX[dim] if h_over_dx is None else h_over_dx

        def leaf(a):
            return jnp.asarray(a, dtype)

        full, full_weights = _lattice_sums(kernel, h_over_dx, dim)
        return cls(
            smoothing=Smoothing(kernel, leaf(h_over_dx * dx), period),
            rho0=leaf(rho0),
            speed=leaf(speed),
            full=leaf(full),
            full_weights=leaf(full_weights),
            viscosity=jax.tree.map(leaf, viscosity),
            solver=BiCGStab() if solver is None else solver,
            surface=jax.tree.map(leaf, surface),
            relaxation=leaf(relaxation),
            least=leaf(least),
            **jax.tree.map(leaf, options),
        )

    # ---------------------------------------------------------------- what a scheme is asked

    def pressure(self, p):
        """See `AbstractParticleScheme`."""
        return p.p

    def started(self, p, pressure):
        """See `AbstractParticleScheme`."""
        return eqx.tree_at(lambda a: a.p, p, pressure, is_leaf=lambda a: a is None)

    def stable_dt(self, g, dim):
        """See `AbstractParticleScheme`."""
        return stable_dt(self, g, 0.25, dim)

    def described(self):
        """See `AbstractParticleScheme`."""
        return f"incompressible, speeds up to {float(self.speed):.3g} m/s"

    def cost(self, dim):
        """See `AbstractParticleScheme`: of the flap in waves, and of the column's dam break (bench_isph)."""
        return 4e-6 if dim == 2 else 15e-6

    def fastest(self, dt):
        """See `AbstractParticleScheme`: a particle that crosses half a smoothing length in a step."""
        return 0.5 * self.smoothing.h / dt

    def compression(self, p):
        """See `AbstractParticleScheme`: none."""
        return jnp.zeros((), p.x.dtype)

    # ---------------------------------------------------------------- one step

    def step(self, model, state, tables):
        """See `AbstractScheme`."""
        p, dt = state.particles, model.dt
        paddle, a_wall = paddle_moved(self, model, state, dt)
        push = pushed(model, state, self._contact(model))
        ghosts = self.placed(model, state, tables)
        u = p.u + dt * (self._viscous(model, state, tables, ghosts) + push)
        # Eq. 7-8. Walls carry gravity and forces as the water does, and their own acceleration goes into
        # their pressure: so that of a field without divergence none is seen at a wall either.
        ghosts = self.ghost_velocity(model, state, tables, ghosts, u)
        u_star = u + dt * self._body_force(model, p.x)
        # The paper has a whole step. With half of one water swings without a loss to second order,
        # where pressures of a whole step damp a wave by omega^2 dt/4.
        half = 0.5 * dt
        middle = paddle.at[0].set(0.5 * (state.paddle[0] + paddle[0]))
        at = eqx.tree_at(lambda s: (s.particles, s.paddle), state, (self.drift(p, half * u_star), middle))
        if model.body is not None:
            still = jnp.zeros(3, dt.dtype)
            at = eqx.tree_at(lambda s: s.body, at, body_moved(state.body, still, half))
        u_ghosts = ghosts.u + dt * self._body_force(model, ghosts.x)
        ghosts = self.placed(model, at, tables)
        sources = self._sources(at.particles, ghosts, u_star, u_ghosts)
        pressure, p_ghosts, body = self._projected(model, at, state, tables, ghosts, sources, a_wall)
        sources = sources | {"p": jnp.concatenate([pressure, p_ghosts])}
        pressed = dt / self.rho0 * stacked(self._sum(laws.pressure_force, sources, tables))
        met = u_star + pressed
        u_new = stopped(model, state, met, push, self._contact(model))
        touched = u_new - met + dt * push
        u_new, sponge = damped(model, p, u_new, dt)
        ghosts = ghosts._replace(p=p_ghosts, water=ghosts.water | {"p": with_empty({"p": pressure})["p"]})
        work = with_work(self, model, tables, ghosts, state.work, sponge, paddle[1], dt)
        given = state.work.paddle - work.paddle  # to solids, by pressures
        given_touching = jnp.zeros_like(dt)
        if body is not None:
            body = eqx.tree_at(lambda b: b.contact, body, touching(model, state, touched, dt))
            work, by_pressure, given_touching = with_body_work(model, state, work, body, dt)
            given = given + by_pressure
        mean = 0.5 * (u_new + p.u)
        contact, lost = (-jnp.sum(p.m * jnp.sum(mean * change, axis=1)) for change in (touched, pressed))
        work = eqx.tree_at(
            lambda w: (w.contact, w.projection),
            work,
            (work.contact + contact - given_touching, work.projection + lost - given),
        )
        dx = dt * mean  # Eq. 17
        if self.shifting is not None:
            dx = dx + self.shifting.displacement(self, model, u_new, sources, tables, dt)
        new = eqx.tree_at(lambda a: (a.u, a.p), self.drift(p, dx), (u_new, pressure))
        state = State(new, paddle, state.air, work, state.step + 1, state.status, body)
        return self.check(model, state, tables, p.x, at.particles.x)

    def _sources(self, p: Particles, ghosts: GhostFields, u, u_ghosts) -> dict:
        return {
            "x": columns(jnp.concatenate([p.x, ghosts.x])),
            "V": jnp.concatenate([self.volume(p), -ghosts.V]),
            "u": columns(jnp.concatenate([u, u_ghosts])),
        }

    def _sum(self, law, sources: dict, tables: Tables):
        n = tables.fluid.shape[1]
        targets = jax.tree.map(lambda a: a[:n], sources)
        return pair_sum(law, self.smoothing, targets, with_empty(sources), tables.fluid)

    def _body_force(self, model: Model, x: Float[Array, "N D"]) -> Float[Array, "N D"]:
        g = jnp.broadcast_to(model.g, x.shape)
        return g if model.force is None else g + model.force.acceleration(x)

    @staticmethod
    def _contact(model: Model) -> Scalar:
        """c0 of the spring off the walls, m/s: the projection stops the water, and this what it missed."""
        return 0.5 * model.dx / model.dt

    def _viscous(
        self, model: Model, state: State, tables: Tables, ghosts: GhostFields
    ) -> Float[Array, "N D"]:
        """nu lap u, m/s2."""
        p = state.particles
        ghosts = self.ghost_velocity(model, state, tables, ghosts, p.u)
        guard = laws.GUARD * self.smoothing.h**2
        sources = self._sources(p, ghosts, p.u, ghosts.u_shear)
        shear = self._sum(lambda pair, i, j: self.viscosity.shear(pair, i, j, guard), sources, tables)
        return self.viscosity.coefficient(self.smoothing.h, 0.0, p.x.shape[1]) * stacked(shear)

    def _projected(
        self,
        model: Model,
        at: State,
        before: State,
        tables: Tables,
        ghosts: GhostFields,
        sources: dict,
        a_wall: Scalar,
    ) -> tuple[Float[Array, " N"], Float[Array, " G"], BodyState | None]:
        """Pressure (Pa) of the water and of the ghosts that takes the divergence out of the velocities, and
        the body as that pressure moves it.

        A body's accelerations are unknowns beside the pressures: its own pressure depends on them at once,
        and a light body would swing without end were they taken from the step before.
        """
        p, walls, h = at.particles, model.walls, self.smoothing.h
        n = p.x.shape[0]
        guard = (0.1 * h) ** 2
        targets = jax.tree.map(lambda a: a[:n], sources)

        def law(pair: Pair, i, j):
            w = laws.laplacian_weight(pair, j, guard)
            return (laws.divergence(pair, i, j), laws.volume(j) * pair.W, w), w

        (shrinking, fill, diagonal), weights = pair_weights(
            law, self.smoothing, targets, with_empty(sources), tables.fluid
        )
        own = self.volume(p) * self.smoothing.kernel.value(jnp.zeros_like(fill), h, p.x.shape[1])
        filled = (fill + own) / self.full
        free = self.surface.free(filled)
        fixed = 1.0 - free
        extra = self.surface.missing(filled) * jnp.maximum(self.full_weights / h**2 - diagonal, 0.0)
        if all(side == "periodic" for side in walls.sides):
            # whatever disorder makes of the sums, there is no surface
            free, fixed, extra = jnp.ones_like(free), jnp.zeros_like(free), jnp.zeros_like(free)
        scale = free / jnp.maximum(diagonal + extra, 1e-6 / h**2)
        at_nodes = walls.node_weights(ghosts.fit, ghosts.nodes, ghosts.water, self.smoothing, tables.nodes)

        def at_walls(q):
            return weighted_sum(at_nodes, jnp.append(q, 0.0), tables.nodes)

        def pulled(q, q_ghosts):
            every = jnp.concatenate([q, q_ghosts, jnp.zeros(1, q.dtype)])
            return scale * weighted_sum(weights, every, tables.fluid)

        force = self.wall_force(model, at, ghosts, a_wall)
        beyond = walls.pressure(
            ghosts.fit, jnp.zeros_like(fill, shape=ghosts.p.shape), ghosts.x, ghosts.nodes, force
        )
        beyond = jnp.where(ghosts.fit.wet > 0, beyond, 0.0)
        nothing = jnp.zeros_like(fill)
        # as fast as weight sorts what stands too close, whatever the step is
        rate = self.relaxation * (jnp.sum(model.g**2) + 1e-12) ** 0.25 / jnp.sqrt(h)
        b = scale * (self.rho0 / model.dt * (shrinking + rate * _crowding(filled))) + pulled(nothing, beyond)
        closed = jnp.sum(fixed + extra) == 0.0
        # Without a surface the pressure is known but for a constant, and the weights, which are symmetric
        # before they are scaled, can only give what has no mean under their diagonal.
        b = b - jnp.where(closed, jnp.sum(diagonal * b) / jnp.sum(diagonal), 0.0)
        start = free * p.p

        if model.body is None:

            def operator(q):
                q = free * q
                return q - pulled(q, at_walls(q)) + fixed * q

            pressure = free * self.solver.solve(operator, b, start)
            without_surface = pressure - jnp.mean(pressure)
            pressure = jnp.where(closed, without_surface, jnp.maximum(pressure, self.least))
            return pressure, at_walls(pressure) + beyond, None

        rows = slice(*walls.solid)
        coupling = self.body_coupling(model, at, before.body, ghosts, tables, model.dt)
        movable = model.body.movable(model.time(at))
        unit = self.rho0 * h  # Pa per m/s2: accelerations as large as pressures in the residual

        def by_body(a):
            return ghosts.p.at[rows].set(coupling.pressures(movable * a))

        def operator(unknown):
            q, a = free * unknown[0], unknown[1]
            q_ghosts = at_walls(q)
            both = q_ghosts + by_body(a / unit)
            driven = unit * coupling.driven(q, q_ghosts[rows])
            return q - pulled(q, both) + fixed * q, a - driven

        b_body = unit * coupling.accelerated(nothing, beyond[rows])
        pressure, _ = self.solver.solve(operator, (b, b_body), (start, jnp.zeros_like(b_body)))
        pressure = jnp.maximum(free * pressure, self.least)
        # what the water does not bear, the body does not feel
        q_ghosts = at_walls(pressure) + beyond
        acceleration = coupling.accelerated(pressure, q_ghosts[rows])
        p_ghosts = q_ghosts + by_body(acceleration)
        new = body_moved(before.body, acceleration, model.dt)
        water = coupling.grip.force(pressure, p_ghosts[rows])
        return pressure, p_ghosts, eqx.tree_at(lambda s: s.force, new, water)

    # ---------------------------------------------------------------- diagnostics

    def dissipation(self, model, state, tables):
        """See `AbstractParticleScheme`: of the viscosity."""
        p = state.particles
        force = self._viscous(model, state, tables, self.placed(model, state, tables))
        return Dissipation(-jnp.sum(p.m * jnp.sum(p.u * force, axis=1)), jnp.zeros_like(model.dt))

    def divergence(self, model: Model, state: State, tables: Tables) -> Float[Array, " N"]:
        """div u of every particle, 1/s."""
        p = state.particles
        ghosts = self.ghost_velocity(model, state, tables, self.placed(model, state, tables), p.u)
        return -self._sum(laws.divergence, self._sources(p, ghosts, p.u, ghosts.u), tables)


def _crowding(filled: Float[Array, " N"]) -> Float[Array, " N"]:
    """By how much particles stand too close, as a share of the density; negative where they are too loose.

    Held within what comes from disorder; what is filled to less than 0.8 is at the surface.
    """
    inside = jnp.clip((filled - 0.8) / 0.1, 0.0, 1.0)
    return inside * jnp.clip(filled - 1.0, -0.05, 0.2)


def stable_dt(scheme: ISPH, g: float, cfl: float, dim: int) -> float:
    """The least of cfl h/speed, a quarter of sqrt(h/g) and an eighth of h^2/nu, s."""
    h = float(scheme.smoothing.h)
    nu = float(scheme.viscosity.kinematic(scheme.smoothing.h, 0.0, dim))
    limits = [cfl * h / float(scheme.speed)]
    if nu > 0:
        limits.append(0.125 * h * h / nu)
    if g > 0:
        limits.append(0.25 * (h / g) ** 0.5)
    return min(limits)


def _lattice_sums(kernel: AbstractKernel, h_over_dx: float, dim: int) -> tuple[float, float]:
    """sum V W with the particle itself, and h^2 times the sum of the Laplacian's weights, on a lattice."""
    reach = int(np.ceil(kernel.reach * h_over_dx))
    axes = np.meshgrid(*(np.arange(-reach, reach + 1.0),) * dim)
    r2 = sum(a**2 for a in axes)
    r2 = jnp.asarray(r2[r2 < (kernel.reach * h_over_dx) ** 2])
    pair = Pair((), r2, kernel.slope(r2, h_over_dx, dim), kernel.value(r2, h_over_dx, dim))
    weights = laws.laplacian_weight(pair, {"V": 1.0}, (0.1 * h_over_dx) ** 2)
    return float(jnp.sum(pair.W)), float(jnp.sum(weights)) * h_over_dx**2
