"""What every scheme does at a step beside its own equations: tables, walls filled, moving particles without
losing what rounding takes, and flags of what has gone wrong."""

from __future__ import annotations

import abc
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Components, Float, Int, Scalar, columns, dot, stacked
from jaxsph.core.pairs import Pair, Smoothing, pair_sum, pair_weights, weighted_sum, with_empty
from jaxsph.core.search.cells import cell_order, search, wrapped
from jaxsph.model import laws
from jaxsph.model.interfaces import AbstractScheme, Model
from jaxsph.model.state import BodyState, Failure, Particles, State, Tables, Work
from jaxsph.solids.contact import spring


class Dissipation(NamedTuple):
    """Power taken by the scheme's own dissipative terms, W (W/m in 2-D); positive is a loss."""

    viscous: Scalar
    diffusive: Scalar


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


class BodyGrip(NamedTuple):
    """How the water's pressure holds on to a body: the negated sum of the law that moves the water."""

    arms: Float[Array, "3 B D"]
    """Volume of every dummy times its velocity per unit of every motion."""
    own: Float[Array, "B D"]
    weights: Components
    table: Int[Array, "K B"]

    def force(self, p: Float[Array, " N"], p_body: Float[Array, " B"]) -> Float[Array, "3"]:
        """Generalised force for the water's and the dummies' pressures (Pa), N, N, N m (per metre in 2-D)."""
        p = jnp.append(p, 0.0)
        around = stacked([weighted_sum(w, p, self.table) for w in self.weights])
        return jnp.einsum("kbd,bd->k", self.arms, around + p_body[:, None] * self.own)


class BodyCoupling(NamedTuple):
    """How a body and the water's pressure around it accelerate each other.

    The pressure of the body's dummies depends on its acceleration at once: part of the water's inertia is
    added to the body's own mass here, and the rest is in the water's pressure.
    """

    grip: BodyGrip
    slopes: Float[Array, "3 B"]
    """Pressure (Pa) of the dummies per unit of every acceleration."""
    inverse: Float[Array, "3 3"]
    """Accelerations per unit of force, with the damping over a step; none where the body is not free."""
    outside: Float[Array, "3"]
    """Force that is not of the water's pressure."""

    def driven(self, p: Float[Array, " N"], p_body: Float[Array, " B"]) -> Float[Array, "3"]:
        """Acceleration by the water's pressures alone, and the dummies' without its own part (Pa)."""
        return self.inverse @ self.grip.force(p, p_body)

    def accelerated(self, p: Float[Array, " N"], p_body: Float[Array, " B"]) -> Float[Array, "3"]:
        """The same by every force."""
        return self.driven(p, p_body) + self.inverse @ self.outside

    def pressures(self, acceleration: Float[Array, "3"]) -> Float[Array, " B"]:
        """What an acceleration adds to the dummies' pressures, Pa."""
        return acceleration @ self.slopes


class AbstractParticleScheme(AbstractScheme):
    """A scheme on water particles between walls of ghosts."""

    smoothing: eqx.AbstractVar[Smoothing]
    rho0: eqx.AbstractVar[Scalar]
    too_fast: eqx.AbstractClassVar[tuple[str, str]]
    """Words for a particle beyond `fastest`: what happened, and which keys of a case to change."""
    steadier: eqx.AbstractClassVar[str]
    """Words for values that are no longer finite: which keys of a case to change."""

    @abc.abstractmethod
    def pressure(self, p: Particles) -> Float[Array, " N"]:
        """Gauge pressure of every particle, Pa."""

    @abc.abstractmethod
    def started(self, p: Particles, pressure: Float[Array, " N"]) -> Particles:
        """Particles with this gauge pressure (Pa), and the masses that their volumes then have."""

    @abc.abstractmethod
    def stable_dt(self, g: float, dim: int) -> float:
        """Largest stable time step, s, in a gravity of g (m/s2)."""

    @abc.abstractmethod
    def fastest(self, dt: Scalar | float) -> Scalar:
        """Speed beyond which the scheme no longer holds with time steps of dt (s), m/s."""

    @abc.abstractmethod
    def described(self) -> str:
        """What it is and how fast, for people."""

    @abc.abstractmethod
    def cost(self, dim: int) -> float:
        """About the time of a step per particle of water on one core of a current CPU, s."""

    @abc.abstractmethod
    def compression(self, p: Particles) -> Scalar:
        """Energy stored by compression, J (J/m in 2-D)."""

    @abc.abstractmethod
    def dissipation(self, model: Model, state: State, tables: Tables) -> Dissipation:
        """Power of the scheme's own dissipative terms."""

    def volume(self, p: Particles) -> Float[Array, " N"]:
        """Volume of every particle, m3 (m2 in 2-D)."""
        return p.m / (self.rho0 + p.rho)

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
        ghosts, nodes = model.walls_at(state)
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

    def water(self, model: Model, p: Particles) -> dict:
        """The fluid as a source for nodes (volumes, pressure, velocity)."""
        fields = {"x": columns(p.x), "V": self.volume(p), "p": self.pressure(p), "u": columns(p.u)}
        return with_empty(fields)

    def ghosts(self, model: Model, state: State, tables: Tables, a_wall: Scalar) -> GhostFields:
        """Positions, pressure and volume of all ghosts for the state's fluid (Eq. 18-20)."""
        ghosts, walls = self.placed(model, state, tables), model.walls
        at_node = walls.at_nodes(
            lambda j: j["p"], ghosts.fit, ghosts.nodes, ghosts.water, self.smoothing, tables.nodes
        )
        force = self.wall_force(model, state, ghosts, a_wall)
        pressure = walls.pressure(ghosts.fit, at_node, ghosts.x, ghosts.nodes, force)
        # a dry ghost has no volume; its pressure must still be a number
        return ghosts._replace(p=jnp.where(ghosts.fit.wet > 0, pressure, 0.0))

    def placed(self, model: Model, state: State, tables: Tables) -> GhostFields:
        """Positions and volumes of all ghosts, and how they see the state's fluid; nothing else yet."""
        walls = model.walls
        x, nodes = model.walls_at(state)
        water = self.water(model, state.particles)
        fit = walls.fit(nodes, water, self.smoothing, tables.nodes)
        here = fit.wet * walls.behind_paddle(x, state.paddle[0], model.dx)
        still = jnp.zeros_like(x)
        return GhostFields(x, nodes, still[:, 0], still, still, here * walls.volume, fit, water)

    def wall_force(
        self, model: Model, state: State, ghosts: GhostFields, a_wall: Scalar
    ) -> Float[Array, "G D"]:
        """rho0 (f - a_wall) at the ghosts, N/m3: the pressure's gradient across a wall.

        A body's own acceleration is not in it, but for the centripetal one: see `body_slopes`.
        """
        force = jnp.broadcast_to(model.g, ghosts.x.shape) * self.rho0
        if model.force is not None:
            force = force + self.rho0 * model.force.acceleration(0.5 * (ghosts.x + ghosts.nodes))
        force = force.at[:, 0].add(-self.rho0 * a_wall * model.walls.moves)
        if model.body is None:
            return force
        rows = slice(*model.walls.solid)
        return force.at[rows].add(-self.rho0 * model.body.centripetal(ghosts.x[rows], state.body))

    def body_slopes(self, model: Model, state: State, ghosts: GhostFields) -> Float[Array, "3 B"]:
        """Pressure (Pa) of the body's dummies per unit of every acceleration of the body."""
        rows = slice(*model.walls.solid)
        fit = jax.tree.map(lambda a: a[rows], ghosts.fit)
        x, nodes, zero = ghosts.x[rows], ghosts.nodes[rows], jnp.zeros_like(fit.wet)

        def slope(direction):
            return model.walls.pressure(fit, zero, x, nodes, -self.rho0 * direction)

        return jnp.where(fit.wet > 0, jax.vmap(slope)(model.body.directions(x, state.body)), 0.0)

    def body_grip(self, model: Model, state: State, ghosts: GhostFields, tables: Tables) -> BodyGrip:
        """The water around the body's dummies, for the force on it."""
        rows = slice(*model.walls.solid)
        x = ghosts.x[rows]

        def law(pair: Pair, i, j):
            w = tuple(-laws.volume(j) * pair.F * r for r in pair.r)
            return w, w

        summed, weights = pair_weights(
            law, self.smoothing, {"x": columns(x)}, ghosts.water, tables.nodes[:, rows]
        )
        arms = model.body.directions(x, state.body) * ghosts.V[rows, None]
        return BodyGrip(arms, stacked(summed), weights, tables.nodes[:, rows])

    def body_coupling(
        self, model: Model, state: State, body: BodyState, ghosts: GhostFields, tables: Tables, dt: Scalar
    ) -> BodyCoupling:
        """The coupling in the pose of `state`, for a step of dt (s) that begins with `body`."""
        grip, slopes = self.body_grip(model, state, ghosts, tables), self.body_slopes(model, state, ghosts)
        free = model.body.movable(model.time(state))
        damping = model.body.damping()
        mass = jnp.diag(model.body.generalised_mass() + dt * damping)
        still = jnp.zeros_like(state.particles.m)
        mass = mass - jax.vmap(lambda slope: grip.force(still, slope))(slopes).T
        both = free[:, None] * free
        inverse = both * jnp.linalg.inv(jnp.where(both > 0, mass, jnp.eye(3, dtype=mass.dtype)))
        here = BodyState(state.body.pose, body.velocity, body.force, body.contact)
        outside = model.body.external(here, model.g) - damping * body.velocity + body.contact
        return BodyCoupling(grip, slopes, inverse, outside)

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
        u_ghosts = walls.velocity(at_node, wall, walls.mirror)
        if model.body is not None:
            rows = slice(*walls.solid)
            own = columns(model.body.velocity(ghosts.x[rows], state.body))
            # mirrored in the plane across the normal: the water slips along the body
            normal = columns(model.body.normals(walls.x[rows], state.body))
            there = tuple(a[rows] for a in at_node)
            through = 2.0 * dot(tuple(a - b for a, b in zip(own, there, strict=True)), normal)
            mirrored = tuple(a + through * n for a, n in zip(there, normal, strict=True))
            u_ghosts = u_ghosts.at[rows].set(stacked(mirrored))
        return ghosts._replace(u=u_ghosts, u_shear=walls.velocity(at_node, wall, walls.shear))

    def drift(self, p: Particles, dx: Float[Array, "N D"]) -> Particles:
        """Moves particles by dx without losing what is smaller than the rounding of x (Kahan)."""
        dx = dx + p.x_carry
        x = p.x + dx
        return eqx.tree_at(lambda a: (a.x, a.x_carry), p, (x, dx - (x - p.x)))

    def check(
        self,
        model: Model,
        state: State,
        tables: Tables,
        x_old: jax.Array,
        x_used: jax.Array | None = None,
    ) -> State:
        """Flags what makes the tables or the numbers untrustworthy.

        `x_used`: where the tables were used in the step; by default they will be where it ended.
        """
        p = state.particles
        moved2 = jnp.max(jnp.sum(((p.x if x_used is None else x_used) - tables.x) ** 2, axis=1))
        speed2 = jnp.sum(p.u**2, axis=1)
        fastest = jnp.argmax(speed2)
        finite = jnp.isfinite(p.x).all(axis=1) & jnp.isfinite(p.u).all(axis=1)
        bad = ~(finite & jnp.isfinite(p.rho))
        out = model.walls.entered(p.x, state.paddle[0], model.dx)
        if model.body is not None:
            out |= model.body.distance(p.x, state.body) < -0.5 * model.dx
        status = state.status
        status = status.flag(Failure.NON_FINITE, bad.any(), state.step, x_old[jnp.argmax(bad)])
        status = status.flag(
            Failure.STALE_TABLE, moved2 > (0.5 * model.search.skin) ** 2, state.step, p.x[fastest]
        )
        status = status.flag(Failure.THROUGH_WALL, jnp.any(out), state.step, p.x[jnp.argmax(out)])
        status = status.flag(
            Failure.TOO_FAST,
            speed2[fastest] > self.fastest(model.dt) ** 2,
            state.step,
            p.x[fastest],
        )
        return eqx.tree_at(lambda a: a.status, state, status)


def pushed(model: Model, state: State, c0: Scalar) -> Float[Array, "N D"]:
    """Acceleration that is no pair's: off the walls and the body, m/s2."""
    x = state.particles.x
    push = model.walls.push(x, state.paddle[0], model.dx, c0)
    if model.body is None:
        return push
    away, back = jax.vjp(lambda x: model.body.distance(x, state.body), x)
    (normal,) = back(jnp.ones_like(away))
    return push + spring(away, model.dx, c0)[:, None] * normal


def stopped(
    model: Model, state: State, u: Float[Array, "N D"], push: Float[Array, "N D"], c0: Scalar
) -> Float[Array, "N D"]:
    """Velocities without what goes on towards a solid that `push` (by `pushed`, with this c0) keeps off.

    Spray that hits a solid stays there, where a spring alone would throw it back as fast as it came.

    The whole of it is gone a tenth of a spacing after the spring begins.
    """
    x = state.particles.x
    wall = jnp.zeros_like(u)
    if model.walls.paddle:
        gap = x[:, 0] - model.walls.low[0] - state.paddle[0]
        wall = wall.at[:, 0].set(jnp.where(gap < 0.4 * model.dx, state.paddle[1], 0.0))
    if model.body is not None:
        near = model.body.distance(x, state.body) < 0.4 * model.dx
        wall = jnp.where(near[:, None], model.body.velocity(x, state.body), wall)
    size2 = jnp.sum(push**2, axis=1, keepdims=True)
    touching = size2 > 0.0
    normal = push / jnp.sqrt(jnp.where(touching, size2, 1.0))
    towards = jnp.minimum(jnp.sum((u - wall) * normal, axis=1, keepdims=True), 0.0)
    share = jnp.sqrt(jnp.where(touching, size2, 1.0)) / spring(0.3 * model.dx, model.dx, c0)
    return u - jnp.where(touching, jnp.minimum(share, 1.0) * towards, 0.0) * normal


def body_moved(body: BodyState, acceleration: Float[Array, "3"], dt: Scalar) -> BodyState:
    """The body after dt."""
    velocity = body.velocity + dt * acceleration
    pose = body.pose + 0.5 * dt * (body.velocity + velocity)
    return BodyState(pose, velocity, body.force, body.contact)


def touching(model: Model, state: State, kick: Float[Array, "N D"], dt: Scalar) -> Float[Array, "3"]:
    """Force on the body of the water that touches it: what turned that water's velocities by `kick` (m/s) in
    a step of dt (s), with the other sign."""
    p, body = state.particles, state.body
    near = model.body.distance(p.x, body) < 0.4 * model.dx
    momentum = jnp.where(near, p.m, 0.0)[:, None] * kick
    return -jnp.einsum("knd,nd->k", model.body.directions(p.x, body), momentum) / dt


def with_body_work(
    model: Model, state: State, work: Work, new: BodyState, dt: Scalar
) -> tuple[Work, Scalar, Scalar]:
    """`work` with what a step of dt (s) from `state` adds: the force's impulse, what the power take-off
    took, and what drives it where it is not free; and the work on the body of pressure and of the water that
    touches it, J (J/m in 2-D).
    """
    old = state.body
    moved = 0.5 * dt * (old.velocity + new.velocity)
    force = new.force + old.contact  # as the body felt it in this step
    driven = -jnp.sum((1.0 - model.body.movable(model.time(state))) * force * moved)
    work = eqx.tree_at(
        lambda w: (w.pto, w.paddle, w.impulse),
        work,
        (
            work.pto + model.body.absorbed(old, new, dt),
            work.paddle + driven,
            work.impulse + dt * force,
        ),
    )
    return work, jnp.sum(new.force * moved), jnp.sum(old.contact * moved)


def paddle_moved(
    scheme: AbstractParticleScheme, model: Model, state: State, dt: Scalar
) -> tuple[jax.Array, Scalar]:
    """Paddle at t + dt, and its acceleration over the step."""
    if model.wavemaker is None:
        return state.paddle, jnp.zeros_like(dt)
    p = state.particles
    V = scheme.volume(p) / model.walls.width
    elevation = model.wavemaker.elevation(columns(p.x), V, state.paddle, 3.0 * model.dx)
    new = model.wavemaker.move(state.paddle, model.time(state), dt, elevation)
    return new, (new[1] - state.paddle[1]) / dt


def damped(model: Model, p: Particles, u: jax.Array, dt: Scalar) -> tuple[jax.Array, Scalar]:
    """Eq. 27-28, and the kinetic energy that it takes."""
    if model.sponge is None:
        return u, jnp.zeros_like(dt)
    factor = model.sponge.factor(p.x[:, 0], dt)
    taken = 0.5 * jnp.sum(p.m * (1.0 - factor**2) * jnp.sum(u**2, axis=1))
    return u * factor[:, None], taken


def with_work(
    scheme: AbstractParticleScheme,
    model: Model,
    tables: Tables,
    ghosts: GhostFields,
    work: Work,
    sponge: Scalar,
    velocity: Scalar,
    dt: Scalar,
) -> Work:
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
