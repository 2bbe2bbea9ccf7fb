"""Weakly compressible delta-SPH (Zhu et al. 2020, section 2; Antuono et al. 2012)."""

from __future__ import annotations

import abc
from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxsph import laws
from jaxsph._typing import Array, Components, Float, Scalar, columns, dot, stacked
from jaxsph.kernels import AbstractKernel, Gaussian
from jaxsph.pairs import (
    Pair,
    Period,
    Smoothing,
    pair_sum,
    symmetric_inverse,
    symmetric_product,
    trace_upper,
    with_empty,
)
from jaxsph.schemes import (
    AbstractParticleScheme,
    AbstractViscosity,
    Dissipation,
    GhostFields,
    PhysicalViscosity,
    Shifting,
    body_moved,
    damped,
    paddle_moved,
    pushed,
    touching,
    with_body_work,
    with_work,
)
from jaxsph.state import BodyState, Model, Particles, State, Tables

__all__ = [
    "AbstractIntegrator",
    "Background",
    "DeltaSPH",
    "PredictorCorrector",
    "SymplecticEuler",
    "stable_dt",
]


class Background(eqx.Module):
    """Still water's pressure R(z) below a level, taken out of the pair sums and put back as a body force.

    Water on both sides of a wall thinner than the kernel couples with the water below the tip, but not
    with itself. The sum (p_i + p_j) grad W then answers small displacements with accelerations that
    point outwards, in proportion to p: at rest, particles at the tip of a wall of one spacing gain speed
    without end (`python -m experiments.thin_wall`), where a wall as thick as the kernel reaches stays
    quiet. With (p_i - R_i) + (p_j - R_j) in the sum and -grad R beside it the gradient is the same
    to second order, and the sum sees little pressure at the tip.

    Pairs stay antisymmetric, and the exchange with the compression energy stays exact: the budget gains
    one term, sum V R(z), which is constant but for the unevenness of the particles.
    """

    x: Scalar
    """Middle of the wall, m."""
    inner: Scalar
    outer: Scalar
    """Horizontal distances from the wall up to which R is whole, and from which it is zero, m."""
    tip: Scalar
    top: Scalar
    """Levels below which R is whole, and above which it is zero, m."""
    weight: Scalar
    """rho0 g, Pa/m."""
    still: Scalar
    """Still water level less the head that is left in the sum, m."""

    def _beside(self, x: Float[Array, " N"]) -> Float[Array, " N"]:
        return _smooth_step((self.outer - jnp.abs(x - self.x)) / (self.outer - self.inner))

    def _below(self, z: Float[Array, " N"]) -> Float[Array, " N"]:
        return _smooth_step((self.top - z) / (self.top - self.tip)) * self.weight * (self.still - z)

    def pressure(self, x: Float[Array, "N D"]) -> Float[Array, " N"]:
        """R, Pa."""
        return self._beside(x[:, 0]) * self._below(x[:, -1])

    def force(self, x: Float[Array, "N D"], h: Scalar) -> tuple[Float[Array, " N"], Float[Array, " N"]]:
        """-grad R (x and z) as a kernel sum would see it: of R + h^2/4 lap R for the Gaussian, N/m3."""
        a, a1, a2, a3 = _derivatives(self._beside, x[:, 0])
        b, b1, b2, b3 = _derivatives(self._below, x[:, -1])
        wide = 0.25 * h * h
        return -(a1 * b + wide * (a3 * b + a1 * b2)), -(a * b1 + wide * (a * b3 + a2 * b1))


def _smooth_step(s: Float[Array, " N"]) -> Float[Array, " N"]:
    """0 below 0, 1 above 1, twice differentiable."""
    s = jnp.clip(s, 0.0, 1.0)
    return s**3 * (10.0 - 15.0 * s + 6.0 * s * s)


def _derivatives(f: Callable, x: Float[Array, " N"]) -> tuple[Float[Array, " N"], ...]:
    """An elementwise function and its first three derivatives."""

    def slope(f):
        return lambda x: jax.jvp(f, (x,), (jnp.ones_like(x),))[1]

    return f(x), slope(f)(x), slope(slope(f))(x), slope(slope(slope(f)))(x)


class Rates(NamedTuple):
    """One evaluation's first pass."""

    acceleration: Components
    grad_rho: Components
    position_divergence: Float[Array, " N"]


class DeltaSPH(AbstractParticleScheme):
    """Eq. 17 with its closures; the integrator is an object of its own."""

    section: ClassVar[str] = "scheme"
    smoothing: Smoothing
    c0: Scalar
    rho0: Scalar
    delta: Scalar
    viscosity: AbstractViscosity
    integrator: AbstractIntegrator
    background: Background | None = None
    shifting: Shifting | None = None

    @classmethod
    def of(
        cls,
        dx: float,
        c0: float,
        *,
        rho0: float = 1000.0,
        delta: float = 0.1,
        viscosity: AbstractViscosity | None = None,
        kernel: AbstractKernel | None = None,
        h_over_dx: float = 1.2,
        integrator: AbstractIntegrator | None = None,
        period: Period = None,
        dtype: Any = jnp.float32,
        **options: Any,
    ) -> DeltaSPH:
        """The scheme from plain numbers, in the precision `dtype`.

        **Arguments**: `dx`, spacing (m); `c0`, numerical speed of sound (m/s), ten times the largest speed or
        more; `viscosity`, by default water's; `kernel`, by default the Gaussian: the support is
        3 `h_over_dx` dx whichever it is; `period`: `Box.period`; `options`: further objects by name.
        """
        kernel = Gaussian() if kernel is None else kernel
        viscosity = PhysicalViscosity(1.0e-6) if viscosity is None else viscosity

        def leaf(a):
            return jnp.asarray(a, dtype)

        return cls(
            smoothing=Smoothing(kernel, leaf(h_over_dx * dx * (3.0 / kernel.reach)), period),
            c0=leaf(c0),
            rho0=leaf(rho0),
            delta=leaf(delta),
            viscosity=jax.tree.map(leaf, viscosity),
            integrator=SymplecticEuler() if integrator is None else integrator,
            **jax.tree.map(leaf, options),
        )

    # ---------------------------------------------------------------- what a scheme is asked

    def pressure(self, p):
        """See `AbstractParticleScheme`."""
        return laws.pressure(p.rho, self.c0)

    def started(self, p, pressure):
        """See `AbstractParticleScheme`."""
        rho = laws.density_deviation(pressure, self.c0)
        m = p.m / (self.rho0 + p.rho) * (self.rho0 + rho)
        return eqx.tree_at(lambda a: (a.rho, a.m), p, (rho, m))

    def stable_dt(self, g, dim):
        """See `AbstractParticleScheme`."""
        # Eq. 10 speaks of the Gaussian's h, a third of the support, whatever the kernel's own h
        share = self.integrator.cfl * float(self.smoothing.radius) / 3.0 / float(self.smoothing.h)
        return stable_dt(self, g, share, dim)

    def described(self):
        """See `AbstractParticleScheme`."""
        return f"weakly compressible, sound speed {float(self.c0):.3g} m/s"

    def cost(self, dim):
        """See `AbstractParticleScheme`: 20 ns a pair, measured in two dimensions (bench_step)."""
        return 20e-9 * (40 if dim == 2 else 200)

    def fastest(self, dt):
        """See `AbstractParticleScheme`: beyond a third of c0 water is no longer weakly compressible."""
        return self.c0 / 3.0

    def compression(self, p):
        """See `AbstractParticleScheme`: sum m c0^2 (ln(rho/rho0) + rho0/rho - 1)."""
        # Series of the exact expression: in float32 that is a difference of ones.
        s = p.rho / self.rho0
        return jnp.sum(p.m * s * s * (0.5 - s * (2.0 / 3.0) + s * s * 0.75)) * self.c0**2

    # ---------------------------------------------------------------- sources

    def sources(
        self, ghosts: GhostFields, p: Particles, u: Float[Array, "N D"], u_ghosts: Float[Array, "G D"]
    ) -> dict:
        """Fluid and ghosts, with these velocities, as one set of sources; p is over the background."""
        # the walls take no part in the density's diffusion or gradient: their deviation is not used
        rho = jnp.concatenate([p.rho, jnp.zeros_like(ghosts.p)])
        V = jnp.concatenate([p.m / (self.rho0 + p.rho), -ghosts.V])
        x = jnp.concatenate([p.x, ghosts.x])
        pressure = jnp.concatenate([ghosts.water["p"][:-1], ghosts.p])
        if self.background is not None:
            pressure = pressure - self.background.pressure(x)
        return {
            "x": columns(x),
            "rho": rho,
            "p": pressure,
            "V": V,
            "u": columns(jnp.concatenate([u, u_ghosts])),
        }

    # ---------------------------------------------------------------- the two passes

    def momentum(self, model: Model, p: Particles, sources: dict, tables: Tables) -> Rates:
        """First pass: acceleration (Eq. 3, 4 or 6, gravity) and the renormalised density gradient (9)."""
        dim = p.x.shape[1]
        guard = laws.GUARD * self.smoothing.h**2
        viscous = self.rho0 * self.viscosity.coefficient(self.smoothing.h, self.c0, dim)

        def law(pair: Pair, i, j):
            force = laws.pressure_force(pair, i, j)
            shear = self.viscosity.shear(pair, i, j, guard)
            total = tuple(a + viscous * b for a, b in zip(force, shear, strict=True))
            return total, laws.moment_matrix(pair, i, j), laws.density_gradient(pair, i, j)

        n = p.x.shape[0]
        targets = jax.tree.map(lambda a: a[:n], sources)
        force, M, b = pair_sum(law, self.smoothing, targets, with_empty(sources), tables.fluid)
        rho = self.rho0 + p.rho
        if self.background is not None:
            along, up = self.background.force(p.x, self.smoothing.h)
            force = (force[0] + along, *force[1:-1], force[-1] + up)
        acceleration = [f / rho + g for f, g in zip(force, model.g, strict=True)]
        grad_rho = symmetric_product(symmetric_inverse(M), b)
        return Rates(tuple(acceleration), grad_rho, trace_upper(M, dim))

    def continuity(
        self, p: Particles, sources: dict, grad_rho: Components, tables: Tables
    ) -> Float[Array, " N"]:
        """Second pass: d rho/dt (Eq. 7 and 8-9), kg/m3/s."""
        n = p.x.shape[0]
        guard = laws.GUARD * self.smoothing.h**2
        diffusion = self.delta * self.smoothing.h * self.c0
        count = sources["V"].shape[0] - n
        padded = tuple(jnp.concatenate([g, jnp.zeros(count, g.dtype)]) for g in grad_rho)
        sources = sources | {"grad_rho": padded}
        targets = jax.tree.map(lambda a: a[:n], sources)
        rho0 = self.rho0

        def law(pair: Pair, i, j):
            rate = (rho0 + i["rho"]) * laws.divergence(pair, i, j)
            return rate + diffusion * laws.density_diffusion(pair, i, j, guard)

        return pair_sum(law, self.smoothing, targets, with_empty(sources), tables.fluid)

    # ---------------------------------------------------------------- one step

    def step(self, model, state, tables):
        """See `AbstractScheme`."""
        return self.integrator.step(self, model, state, tables)

    # ---------------------------------------------------------------- diagnostics

    def dissipation(self, model: Model, state: State, tables: Tables) -> Dissipation:
        """Power of the viscous and density-diffusion terms (Antuono et al. 2015, energy balance)."""
        ghosts = self.ghosts(model, state, tables, jnp.zeros_like(model.dt))
        ghosts = self.ghost_velocity(model, state, tables, ghosts, state.particles.u)
        p = state.particles
        sources = self.sources(ghosts, p, p.u, ghosts.u_shear)
        grad_rho = self.momentum(model, p, sources, tables).grad_rho
        n = p.x.shape[0]
        guard = laws.GUARD * self.smoothing.h**2
        count = sources["V"].shape[0] - n
        padded = tuple(jnp.concatenate([g, jnp.zeros(count, g.dtype)]) for g in grad_rho)
        sources = sources | {"grad_rho": padded}
        targets = jax.tree.map(lambda a: a[:n], sources)

        def law(pair: Pair, i, j):
            return (
                self.viscosity.shear(pair, i, j, guard),
                laws.density_diffusion(pair, i, j, guard),
            )

        shear, diffusion = pair_sum(law, self.smoothing, targets, with_empty(sources), tables.fluid)
        dim = p.x.shape[1]
        viscous = self.rho0 * self.viscosity.coefficient(self.smoothing.h, self.c0, dim)
        V = targets["V"]
        rho = self.rho0 + p.rho
        loss_viscous = -jnp.sum(V * viscous * dot(columns(p.u), shear))
        rate = self.delta * self.smoothing.h * self.c0 * diffusion
        # d(e_c)/dt = p / rho^2 d rho/dt per unit mass
        loss_diffusive = -jnp.sum(V * laws.pressure(p.rho, self.c0) / rho * rate)
        return Dissipation(loss_viscous, loss_diffusive)

    def surface(self, model: Model, state: State, tables: Tables) -> Float[Array, " N"]:
        """Position divergence of Eq. 15: dim inside, below `SURFACE` (1.89 of 2) at the surface."""
        ghosts = self.ghosts(model, state, tables, jnp.zeros_like(model.dt))
        p = state.particles
        sources = self.sources(ghosts, p, p.u, ghosts.u_shear)
        return self.momentum(model, p, sources, tables).position_divergence


SURFACE = 1.89 / 2.0
"""Eq. 15's criterion as a share of the ideal value (2 in two dimensions)."""


# --------------------------------------------------------------------------- time


class AbstractIntegrator(eqx.Module):
    """How a step is made of evaluations."""

    cfl: eqx.AbstractClassVar[float]
    """Default share of h/c0 (Eq. 10) for dt, found by measurement to be stable with room to spare."""

    @abc.abstractmethod
    def step(self, scheme: DeltaSPH, model: Model, state: State, tables: Tables) -> State:
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
        scheme: DeltaSPH, model: Model, start: State, at: State, tables: Tables, dt: Scalar
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
    scheme: DeltaSPH,
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


def stable_dt(scheme: DeltaSPH, g: float, cfl: float, dim: int) -> float:
    """The least of Eq. 10 (with the share cfl), 11 and 12, s."""
    h, c0 = float(scheme.smoothing.h), float(scheme.c0)
    nu = float(scheme.viscosity.kinematic(scheme.smoothing.h, scheme.c0, dim))
    limits = [cfl * h / c0]
    if nu > 0:
        limits.append(0.125 * h * h / nu)
    if g > 0:
        limits.append(0.25 * (h / g) ** 0.5)
    return min(limits)
