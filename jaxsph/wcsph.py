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
from jaxsph.neighbours import cell_order, search, wrapped
from jaxsph.pairs import (
    Fields,
    Pair,
    Period,
    Smoothing,
    pair_sum,
    symmetric_inverse,
    symmetric_product,
    trace_upper,
    with_empty,
)
from jaxsph.state import AbstractScheme, Failure, Model, Particles, State, Tables, Work

__all__ = [
    "AbstractIntegrator",
    "AbstractViscosity",
    "ArtificialViscosity",
    "Background",
    "DeltaSPH",
    "Dissipation",
    "LaplacianViscosity",
    "PhysicalViscosity",
    "PredictorCorrector",
    "Shifting",
    "SymplecticEuler",
    "stable_dt",
]


class AbstractViscosity(eqx.Module):
    """The viscous sum (Eq. 4 and 6): a pair law and its coefficient."""

    @abc.abstractmethod
    def coefficient(self, h: Scalar, c0: Scalar, dim: int) -> Scalar:
        """m2/s."""

    @abc.abstractmethod
    def kinematic(self, h: Scalar, c0: Scalar, dim: int) -> Scalar:
        """The kinematic viscosity it stands for (Eq. 5), m2/s."""

    @abc.abstractmethod
    def shear(self, pair: Pair, i: Fields, j: Fields, guard: Scalar) -> Components:
        """What the coefficient multiplies, per pair, 1/(m s)."""


class PhysicalViscosity(AbstractViscosity):
    """Eq. 6: 2 (dim + 2) nu. On a square lattice with h = 1.2 dx it is up to 9 % too large, whatever dx is
    (`python -m experiments.taylor_green`): see `LaplacianViscosity`."""

    nu: Scalar

    def coefficient(self, h, c0, dim):
        """See `AbstractViscosity`."""
        return 2 * (dim + 2) * self.nu

    def kinematic(self, h, c0, dim):
        """See `AbstractViscosity`."""
        return self.nu

    def shear(self, pair, i, j, guard):
        """See `AbstractViscosity`."""
        return laws.viscous_force(pair, i, j, guard)


class LaplacianViscosity(AbstractViscosity):
    """nu lap u as 2 nu sum (u_i - u_j) (r.grad W)/r^2 V_j (Morris et al. 1997, Eq. 22): exact viscosity.

    For flows that the physical viscosity governs. The weights of Monaghan's form are not smooth at r = 0,
    and a square lattice sums them 9 % off; here it need only sum the kernel's second moments. Angular
    momentum is not kept, and at a free surface it stands for du/dn = 0, not for no stress: it dissipates
    nu |grad u|^2, half of what it should in a wave.
    """

    nu: Scalar

    def coefficient(self, h, c0, dim):
        """See `AbstractViscosity`."""
        return 2 * self.nu

    def kinematic(self, h, c0, dim):
        """See `AbstractViscosity`."""
        return self.nu

    def shear(self, pair, i, j, guard):
        """See `AbstractViscosity`."""
        return laws.laplacian(pair, i, j)


class ArtificialViscosity(AbstractViscosity):
    """Eq. 4: alpha h c0."""

    alpha: Scalar

    def coefficient(self, h, c0, dim):
        """See `AbstractViscosity`."""
        return self.alpha * h * c0

    def kinematic(self, h, c0, dim):
        """See `AbstractViscosity`."""
        return self.alpha * h * c0 / (2 * (dim + 2))

    def shear(self, pair, i, j, guard):
        """See `AbstractViscosity`."""
        return laws.viscous_force(pair, i, j, guard)


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


class Shifting(eqx.Module):
    """Fickian shifting of particles, down the gradient of their concentration (Lind et al. 2012; the sum of
    Sun et al. 2017, Eq. 6, which also keeps particles from pairing).

    dr_i = -strength h U dt sum_j (1 + 0.2 (W_ij/W(dx))^4) grad W_ij V_j, with U the largest speed, at most
    U dt/2. Near a free surface, where the kernel is not full, it fades out: there the gradient is the
    surface's own. Velocities and densities stay with their particles, so angular momentum is not kept, and a
    free surface creeps outwards: use it where pressures are negative (`experiments.rotating_square`), not
    where they are positive anyway (`experiments.oscillating_drop`).

    A flow that stretches the lattice needs it: in the Taylor-Green vortex at Re = 100 half of the energy is
    lost within 0.4 s without, when the particles fall out of line (`python -m experiments.taylor_green`).
    """

    strength: Scalar
    """1; 12 keeps the particles of the exact tests in order, with 3 some energy is still lost. As a diffusion
    it is stable while strength U is below c0."""

    def displacement(
        self,
        scheme: DeltaSPH,
        model: Model,
        u: Float[Array, "N D"],
        sources: dict,
        tables: Tables,
        dt: Scalar,
    ) -> Float[Array, "N D"]:
        """By how much each particle is moved in a step of dt (s), m."""
        dim = u.shape[1]
        h, kernel = scheme.smoothing.h, scheme.smoothing.kernel
        W_dx = kernel.value(model.dx**2, h, dim)

        def law(pair: Pair, i, j):
            w = laws.volume(j) * pair.F
            crowded = w * (1.0 + 0.2 * (pair.W / W_dx) ** 4)
            return tuple(crowded * r for r in pair.r), -w * pair.r2

        n = u.shape[0]
        targets = jax.tree.map(lambda a: a[:n], sources)
        gradient, trace = pair_sum(law, scheme.smoothing, targets, with_empty(sources), tables.fluid)
        speed = jnp.sqrt(jnp.max(jnp.sum(u**2, axis=1)))
        # a full kernel gives dim within a few per cent, half a one half of it
        inside = jnp.clip((trace / dim - 0.8) / 0.15, 0.0, 1.0)
        move = self.strength * h * stacked(gradient) * inside[:, None]
        # the guard is for the derivative at zero
        size = jnp.sqrt(jnp.sum(move**2, axis=1, keepdims=True) + 1e-12)
        return -speed * dt * move * jnp.minimum(1.0, 0.5 / size)


class Rates(NamedTuple):
    """One evaluation's first pass."""

    acceleration: Components
    grad_rho: Components
    position_divergence: Float[Array, " N"]


class Dissipation(NamedTuple):
    """Power taken by the scheme's own dissipative terms, W (W/m in 2-D); positive is a loss."""

    viscous: Scalar
    diffusive: Scalar


class DeltaSPH(AbstractScheme):
    """Eq. 17 with its closures; the integrator is an object of its own."""

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
            Smoothing(kernel, leaf(h_over_dx * dx * (3.0 / kernel.reach)), period),
            leaf(c0),
            leaf(rho0),
            leaf(delta),
            jax.tree.map(leaf, viscosity),
            SymplecticEuler() if integrator is None else integrator,
            **jax.tree.map(leaf, options),
        )

    # ---------------------------------------------------------------- tables

    def prepare(self, model, state):
        """See `AbstractScheme`."""
        s, walls, p = model.search, model.walls, state.particles
        x, carry = wrapped(p.x, p.x_carry, walls.low, self.smoothing.period)
        p = eqx.tree_at(lambda a: (a.x, a.x_carry), p, (x, carry))
        order = cell_order(p.x, s.grid)
        p = jax.tree.map(lambda a: a[order], p)
        region = walls.regions.index(p.x)
        kind = walls.regions.kind(region)
        ghosts, nodes = walls.moved(state.paddle[0])
        # an escaped particle must not poison the search: the failure is flagged below
        sources = jnp.concatenate([p.x, ghosts])
        fluid = search(
            p.x,
            sources,
            s.grid,
            s.capacity,
            walls.regions.sees(region),
            jnp.concatenate([kind, walls.kind]),
            same=True,
        )
        at_nodes = search(nodes, p.x, s.grid, s.node_capacity, walls.node_sees, kind, same=False)
        overflow = fluid.overflow | at_nodes.overflow
        paddle = None
        if walls.paddle:
            first, last = walls.paddle
            every = jnp.full(last - first, -1, jnp.int32)
            around = search(ghosts[first:last], p.x, s.grid, s.node_capacity, every, kind, same=False)
            paddle, overflow = around.indices, overflow | around.overflow
        status, chamber = state.status, None
        if model.chamber is not None:
            chamber, count = model.chamber.candidates(p.x, s.skin, s.chamber_capacity)
            status = status.flag(
                Failure.CHAMBER_OVERFLOW,
                count > s.chamber_capacity,
                state.step,
                jnp.zeros_like(model.g),
            )
        status = status.flag(Failure.NEIGHBOUR_OVERFLOW, overflow, state.step, jnp.zeros_like(model.g))
        state = eqx.tree_at(lambda a: (a.particles, a.status), state, (p, status))
        return state, Tables(fluid.indices, at_nodes.indices, paddle, chamber, p.x)

    # ---------------------------------------------------------------- sources

    def water(self, model: Model, p: Particles) -> dict:
        """The fluid as a source for nodes (volumes, pressure, velocity)."""
        V = p.m / (self.rho0 + p.rho)
        pressure = laws.pressure(p.rho, self.c0)
        return with_empty({"x": columns(p.x), "V": V, "p": pressure, "u": columns(p.u)})

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

    def ghosts(self, model: Model, state: State, tables: Tables, a_wall: Scalar) -> GhostFields:
        """Positions, pressure, velocity and volume of all ghosts for the state's fluid (Eq. 18-20)."""
        walls, p = model.walls, state.particles
        x, nodes = walls.moved(state.paddle[0])
        water = self.water(model, p)
        fit = walls.fit(nodes, water, self.smoothing, tables.nodes)
        at_node = walls.at_nodes(lambda j: j["p"], fit, nodes, water, self.smoothing, tables.nodes)
        force = jnp.broadcast_to(model.g, x.shape) * self.rho0
        if model.force is not None:
            force = force + self.rho0 * model.force.acceleration(0.5 * (x + nodes))
        force = force.at[:, 0].add(-self.rho0 * a_wall * walls.moves)
        pressure = walls.pressure(fit, at_node, x, nodes, force)
        here = fit.wet * walls.behind_paddle(x, state.paddle[0], model.dx)
        # a dry ghost has no volume; its pressure must still be a number
        return GhostFields(
            x,
            nodes,
            jnp.where(fit.wet > 0, pressure, 0.0),
            jnp.zeros_like(x),
            jnp.zeros_like(x),
            here * walls.volume,
            fit,
            water,
        )

    def ghost_velocity(
        self, model: Model, state: State, tables: Tables, ghosts: GhostFields, u: jax.Array
    ) -> GhostFields:
        """The same ghosts with velocities for the fluid's velocities u."""
        walls = model.walls
        water = ghosts.water | {"u": with_empty({"u": columns(u)})["u"]}
        at_node = walls.at_nodes(
            lambda j: j["u"], ghosts.fit, ghosts.nodes, water, self.smoothing, tables.nodes
        )
        zero = jnp.zeros_like(walls.moves)
        wall = (walls.moves * state.paddle[1],) + (zero,) * (len(at_node) - 1)
        if walls.sliding is not None:
            wall = tuple(a + b for a, b in zip(wall, columns(walls.sliding), strict=True))
        return ghosts._replace(
            u=walls.velocity(at_node, wall, walls.mirror), u_shear=walls.velocity(at_node, wall, walls.shear)
        )

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

    def drift(self, p: Particles, dx: Float[Array, "N D"]) -> Particles:
        """Moves particles by dx without losing what is smaller than the rounding of x (Kahan)."""
        dx = dx + p.x_carry
        x = p.x + dx
        return eqx.tree_at(lambda a: (a.x, a.x_carry), p, (x, dx - (x - p.x)))

    def check(self, model: Model, state: State, tables: Tables, x_old: jax.Array) -> State:
        """Flags what makes the tables or the numbers untrustworthy."""
        p = state.particles
        moved2 = jnp.max(jnp.sum((p.x - tables.x) ** 2, axis=1))
        speed2 = jnp.sum(p.u**2, axis=1)
        fastest = jnp.argmax(speed2)
        finite = jnp.isfinite(p.x).all(axis=1) & jnp.isfinite(p.u).all(axis=1)
        bad = ~(finite & jnp.isfinite(p.rho))
        out = model.walls.entered(p.x, state.paddle[0], model.dx)
        status = state.status
        status = status.flag(Failure.NON_FINITE, bad.any(), state.step, x_old[jnp.argmax(bad)])
        status = status.flag(
            Failure.STALE_TABLE, moved2 > (0.5 * model.search.skin) ** 2, state.step, p.x[fastest]
        )
        status = status.flag(Failure.THROUGH_WALL, jnp.any(out), state.step, p.x[jnp.argmax(out)])
        # beyond a third of the sound speed the fluid is no longer weakly compressible
        status = status.flag(
            Failure.TOO_FAST,
            speed2[fastest] > (0.33 * self.c0) ** 2,
            state.step,
            p.x[fastest],
        )
        return eqx.tree_at(lambda a: a.status, state, status)

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


class GhostFields(NamedTuple):
    """All ghosts, filled."""

    x: Float[Array, "G D"]
    nodes: Float[Array, "G D"]
    p: Float[Array, " G"]
    u: Float[Array, "G D"]
    u_shear: Float[Array, "G D"]
    """Velocity that the viscous force sees: a wall without slip must not look like a moving one to the
    continuity equation."""
    V: Float[Array, " G"]
    fit: tuple
    water: dict


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
        paddle, a_wall = _paddle(scheme, model, state, dt)
        ghosts = scheme.ghosts(model, state, tables, a_wall)
        ghosts = scheme.ghost_velocity(model, state, tables, ghosts, p.u)
        sources = scheme.sources(ghosts, p, p.u, ghosts.u_shear)
        rates = scheme.momentum(model, p, sources, tables)
        u = p.u + dt * (stacked(rates.acceleration) + _push(scheme, model, p, state.paddle[0]))
        u, air, work = _air(scheme, model, state, tables, sources, u, dt, t)
        u, sponge = _sponge(model, p, u, dt)
        state = eqx.tree_at(lambda a: a.paddle, state, state.paddle.at[1].set(paddle[1]))
        ghosts = scheme.ghost_velocity(model, state, tables, ghosts, u)
        sources = scheme.sources(ghosts, p, u, ghosts.u)
        rho = p.rho + dt * scheme.continuity(p, sources, rates.grad_rho, tables)
        work = _paddle_work(scheme, model, tables, p, ghosts, work, sponge, paddle[1], dt)
        p = eqx.tree_at(lambda a: (a.u, a.rho), p, (u, rho))
        dx = dt * u
        if scheme.shifting is not None:
            dx = dx + scheme.shifting.displacement(scheme, model, u, sources, tables, dt)
        p = scheme.drift(p, dx)
        state = State(p, paddle, air, work, state.step + 1, state.status)
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
        paddle, a_wall = _paddle(scheme, model, start, dt)
        ghosts = scheme.ghosts(model, at, tables, a_wall)
        ghosts = scheme.ghost_velocity(model, at, tables, ghosts, p.u)
        sources = scheme.sources(ghosts, p, p.u, ghosts.u_shear)
        rates = scheme.momentum(model, p, sources, tables)
        sources = scheme.sources(ghosts, p, p.u, ghosts.u)
        rate = scheme.continuity(p, sources, rates.grad_rho, tables)
        u = p0.u + dt * (stacked(rates.acceleration) + _push(scheme, model, p, at.paddle[0]))
        u, air, work = _air(scheme, model, start, tables, sources, u, dt, t)
        u, sponge = _sponge(model, p0, u, dt)
        work = _paddle_work(scheme, model, tables, p, ghosts, work, sponge, at.paddle[1], dt)
        new = eqx.tree_at(lambda a: (a.u, a.rho), p0, (u, p0.rho + dt * rate))
        # trapezoidal in the positions: with the rates of the half step this is the midpoint rule
        dx = dt * p.u
        if scheme.shifting is not None:
            dx = dx + scheme.shifting.displacement(scheme, model, p.u, sources, tables, dt)
        new = scheme.drift(new, dx)
        return State(new, paddle, air, work, start.step, start.status)


def _push(scheme: DeltaSPH, model: Model, p: Particles, displacement: Scalar) -> Float[Array, "N D"]:
    """Acceleration that is no pair's: off the walls, and by the body force, m/s2."""
    push = model.walls.push(p.x, displacement, model.dx, scheme.c0)
    return push if model.force is None else push + model.force.acceleration(p.x)


def _paddle(scheme: DeltaSPH, model: Model, state: State, dt: Scalar) -> tuple[jax.Array, Scalar]:
    """Paddle at t + dt, and its acceleration over the step."""
    if model.wavemaker is None:
        return state.paddle, jnp.zeros_like(dt)
    p = state.particles
    V = p.m / (scheme.rho0 + p.rho)
    elevation = model.wavemaker.elevation(columns(p.x), V, state.paddle, 3.0 * model.dx)
    new = model.wavemaker.move(state.paddle, model.time(state), dt, elevation)
    return new, (new[1] - state.paddle[1]) / dt


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


def _sponge(model: Model, p: Particles, u: jax.Array, dt: Scalar) -> tuple[jax.Array, Scalar]:
    """Eq. 27-28, and the kinetic energy that it takes."""
    if model.sponge is None:
        return u, jnp.zeros_like(dt)
    factor = model.sponge.factor(p.x[:, 0], dt)
    taken = 0.5 * jnp.sum(p.m * (1.0 - factor**2) * jnp.sum(u**2, axis=1))
    return u * factor[:, None], taken


def _paddle_work(scheme, model, tables, p, ghosts, work: Work, sponge, velocity, dt) -> Work:
    """Adds what the sponge took and what the paddle did: minus the water's force on it, times U."""
    work = eqx.tree_at(lambda w: w.sponge, work, work.sponge + sponge)
    if tables.paddle is None:
        return work
    first, last = model.walls.paddle
    own = {
        "x": columns(ghosts.x[first:last]),
        "p": ghosts.p[first:last],
    }
    force = pair_sum(
        lambda pair, i, j: laws.pressure_force(pair, i, j)[0],
        scheme.smoothing,
        own,
        ghosts.water,
        tables.paddle,
    )
    on_paddle = jnp.sum(force * ghosts.V[first:last])
    return eqx.tree_at(lambda w: w.paddle, work, work.paddle - dt * velocity * on_paddle)


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
