"""Base of the schemes: neighbour tables, ghosts and their fields, coupling to bodies, failure flags."""

from __future__ import annotations

import abc
from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Float, columns, dot, stack
from jaxsph.core.pairs import FAR
from jaxsph.core.parts import Part
from jaxsph.core.search.cells import wrap
from jaxsph.core.search.tables import Seen, point_neighbours, sort_by_cell, water_neighbours
from jaxsph.core.slabs import Chosen, Sources
from jaxsph.core.transforms import any_lane
from jaxsph.model.interfaces import AbstractScheme, Model
from jaxsph.model.regularisation import Regularisation
from jaxsph.model.state import Failure, Particles, Response, State, Tables
from jaxsph.schemes.step import GhostFields, Interval, book, drift
from jaxsph.schemes.touching import touching

__all__ = [
    "AbstractParticleScheme",
]


class AbstractParticleScheme(AbstractScheme):
    """Scheme that advances particles of water, with walls represented by ghosts."""

    responds: ClassVar[bool] = False
    """Whether `respond` computes responses; the particles then keep them for the next search."""
    regularisation: eqx.AbstractVar[tuple[Regularisation, ...]]
    """Regularisation of the particles: empty, or one entry."""

    # ---------------------------------------------------------------- tables

    def prepare(self, model, state):
        """See `AbstractScheme.prepare`."""
        state, tables = self._search(model, state)
        responses = self.respond(model, state, tables)
        # the next search starts from these responses
        p_air = state.particles.p_air | {name: one.pressures.p for name, one in responses.items()}
        state = eqx.tree_at(lambda s: s.particles.p_air, state, p_air)
        return state, eqx.tree_at(lambda t: t.responses, tables, responses)

    @Part.SEARCH.scope()
    def _search(self, model: Model, state: State) -> tuple[State, Tables]:
        """State with its particles sorted by cell, and the neighbour tables, without responses to the air."""
        for outlet in model.outlets:
            state = outlet.drain(model, state)
        s, walls, p = model.search, model.walls, state.particles
        x, carry = wrap(p.x, p.x_carry, walls.low, self.smoothing.period)
        p = eqx.tree_at(lambda a: (a.x, a.x_carry), p, (x, carry))
        # particles without mass come last, so that a resumed run, to which they are added anew, has the same
        # order and adds in the same order
        p, astray = sort_by_cell(s.slabs, s.grid, p, p.x, p.m == 0.0)
        region, there = walls.regions.index(p.x), p.m > 0.0
        # no wall mirrors, and no air presses, particles without mass
        heavy = jnp.where(there[:, None], p.x, FAR)
        images, too_many = self._images(model, state.parts, heavy)
        ghosts, nodes, _ = model.ghosts_at(state.parts, p, images)
        imaged = images.there
        kind = walls.kind.at[: len(imaged)].multiply(imaged.astype(walls.kind.dtype))
        # the search puts escaped particles into the cells at the edge; `check` flags the failure
        # particles without mass neither see nor are seen
        bits, sees = (
            jnp.where(there, a, 0) for a in (walls.regions.kind(region), walls.regions.sees(region))
        )
        water, behind = Seen(p.x, bits), Seen(ghosts, kind)
        fluid, most, halo = water_neighbours(s.slabs, s.method, water, sees, behind, s.capacity)

        def around_points(points, sees):
            return point_neighbours(s.slabs, s.method, points, sees, water, s.node_capacity)

        at_nodes, most_at_nodes, crowd = around_points(nodes[walls.at_nodes], walls.node_sees[walls.at_nodes])
        around = {}
        for solid in model.moving:
            rows = slice(*solid.rows)
            every = jnp.full_like(walls.node_sees[rows], -1)
            around[solid.name], *found = around_points(ghosts[rows], every)
            most_at_nodes, crowd = map(jnp.maximum, (most_at_nodes, crowd), found)
        for body in model.bodies:
            rows = slice(*body.rows)
            around[body.name], *found = around_points(nodes[rows], walls.node_sees[rows])
            most_at_nodes, crowd = map(jnp.maximum, (most_at_nodes, crowd), found)
        chambers, most_in_chamber = {}, jnp.zeros((), jnp.int32)
        for chamber in model.chambers:
            x = chamber.frame.back(state.parts, columns(s.slabs.gather(heavy)))
            chambers[chamber.name], count = chamber.candidates(x, s.skin, s.chamber_capacity)
            most_in_chamber = jnp.maximum(most_in_chamber, count.astype(jnp.int32))
        found = {
            "capacity": most,
            "node_capacity": most_at_nodes,
            "chamber_capacity": most_in_chamber,
            "halo": jnp.where(astray, 2 * s.slabs.halo, halo),
            "points": crowd,
        }
        status = _checked_tables(state, s, found, too_many)
        near, where = touching(model, state.parts)
        status = status.flag(Failure.TOUCHING, near, state.step, where)
        state = eqx.tree_at(lambda a: (a.particles, a.status), state, (p, status))
        return state, Tables(fluid, images, at_nodes, around, chambers, p.x)

    def _images(
        self, model: Model, parts: Mapping[str, Any], x: Float[Array, "N D"]
    ) -> tuple[Chosen, jax.Array]:
        """Particles at x (m) that images mirror until the next search, and whether there are too many."""
        s = model.search
        x = jax.lax.stop_gradient(s.slabs.gather(x))
        paddle = model.paddle_at(jax.lax.stop_gradient(parts))
        rows, full = model.walls.images.choose(x, paddle, self.smoothing.radius, s.skin)
        return Chosen.of(rows, len(x), s.slabs), full

    @abc.abstractmethod
    def respond(self, model: Model, state: State, tables: Tables) -> dict[str, Response]:
        """Response of the water to a unit of air pressure in each chamber over a step, by the chamber's name.

        The response is computed at a search and kept until the next search. The laws of the power take-offs
        are satisfied exactly with any response. An inaccurate response only delays a part of a pressure
        change by a step.
        """

    @Part.REGULARISATION.scope()
    def regularise(self, model, state, tables):
        """See `AbstractScheme.regularise`."""
        every = model.search.rebuild_every
        searches = max(model.search.regularise_every // every, 1)

        def regularised(state):
            for one in self.regularisation:
                p = state.particles
                done = one.apply(self, model, p, tables, searches * every * model.dt)
                p = drift(eqx.tree_at(lambda a: a.u, p, done.u), done.moved)
                ledger = book(state.ledger, done.lost)
                state = eqx.tree_at(lambda s: (s.particles, s.ledger), state, (p, ledger))
            return state

        if searches == 1:
            return regularised(state)
        # all lanes of a batch are at the same step and take the same branch
        due = any_lane(state.step // every % searches == 0)
        return jax.lax.cond(due, regularised, lambda state: state, state)

    # ---------------------------------------------------------------- ghosts

    def water(self, p: Particles) -> Sources:
        """Fields of the water as sources for the nodes: positions, volumes, pressures and velocities (SI)."""
        fields = {"x": columns(p.x), "V": self.volume(p), "p": self.pressure(p), "u": columns(p.u)}
        return Sources(fields, {})

    def level_pressure(self, model: Model, state: State) -> dict[str, Float[Array, " N"]]:
        """Field "level_p": pressure (Pa) from which the water level at dummies is computed; empty if this
        pressure equals p."""
        del model, state
        return {}

    @Part.GHOSTS.scope()
    def place_ghosts(self, model: Model, state: State, tables: Tables) -> GhostFields:
        """Positions, volumes and interpolation coefficients of all ghosts; pressure and velocity are zero."""
        walls = model.walls
        x, nodes, volume = model.ghosts_at(state.parts, state.particles, tables.images)
        water = self.water(state.particles)
        water = Sources(water.water | self.level_pressure(model, state), water.ghosts)
        water = tables.fluid.slabs.fetch(water)
        weight = self.rho0 * model.g
        fit = walls.fit(nodes, water, self.smoothing, tables.images, tables.nodes, weight)
        here = fit.wet
        for wall in model.moving:
            # an image keeps its full volume, since its particle is in front of the wall
            cover = wall.cover(state.parts[wall.name], x, model.dx)
            here = here * cover.at[: walls.images.count].set(1.0)
        still = jnp.zeros_like(x)
        return GhostFields(x, nodes, still[:, 0], still, still, here * volume, fit, water)

    def carried(self, model: Model, law, ghosts: GhostFields, tables: Tables):
        """Values of `law(j)`, a pytree of fields of the water, at all ghosts: see `Ghosts.carried`."""
        return model.walls.carried(law, *self._seen(ghosts, tables))

    def carrier(
        self, model: Model, ghosts: GhostFields, tables: Tables
    ) -> Callable[[Sources], Float[Array, " G"]]:
        """Linear function that gives the values of one field "f" of the water at all ghosts."""
        return model.walls.carrier(*self._seen(ghosts, tables))

    def _seen(self, ghosts: GhostFields, tables: Tables):
        """Arguments of the methods `carried` and `carrier` of the walls."""
        return ghosts.fit, ghosts.nodes, ghosts.water, self.smoothing, tables.images, tables.nodes

    @Part.GHOSTS.scope()
    def ghosts(self, model: Model, state: State, tables: Tables, interval: Interval) -> GhostFields:
        """Positions, volumes and pressures of all ghosts for the state's water (Zhu et al. 2020, Eq. 18-20).

        The pressures include the effect of the walls' accelerations over the interval; velocities are zero.
        """
        ghosts, walls = self.place_ghosts(model, state, tables), model.walls
        at_node = self.carried(model, lambda j: j["p"], ghosts, tables)
        force = self.wall_force(model, state.parts, ghosts, interval)
        pressure = walls.pressure(ghosts.fit, at_node, ghosts.x, ghosts.nodes, force)
        # a dry ghost has no volume, but its pressure must be finite
        return ghosts._replace(p=jnp.where(ghosts.fit.wet > 0, pressure, 0.0))

    @Part.GHOSTS.scope()
    def wall_force(
        self, model: Model, parts: Mapping[str, Any], ghosts: GhostFields, interval: Interval
    ) -> Float[Array, "G D"]:
        """Pressure gradient across the walls at the ghosts, rho0 (f - a_wall), N/m3.

        `parts`: states of the parts by name. The acceleration that a body has without forces is included;
        `schemes.bodies` adds the acceleration due to forces.
        """
        force = jnp.broadcast_to(model.g, ghosts.x.shape) * self.rho0
        for field in model.forces:
            force = force + self.rho0 * field.acceleration(0.5 * (ghosts.x + ghosts.nodes), interval.middle)
        for wall in model.moving:
            rows = slice(*wall.rows)
            motion = interval.before[wall.name], interval.after[wall.name]
            a_wall = wall.acceleration(*motion, ghosts.x[rows], interval.dt)
            force = force.at[rows].add(-self.rho0 * a_wall)
        coasting = model.mechanism.coasting(parts, interval.middle)
        for body in model.bodies:
            rows, motion = slice(*body.rows), parts[body.name]
            there = body.centripetal(motion, ghosts.x[rows])
            if body.name in coasting:
                directions = body.directions(motion, ghosts.x[rows])
                there = there + jnp.einsum("knd,k->nd", directions, coasting[body.name])
            force = force.at[rows].add(-self.rho0 * there)
        return force

    @Part.GHOSTS.scope()
    def ghost_velocity(
        self, model: Model, parts: Mapping[str, Any], tables: Tables, ghosts: GhostFields
    ) -> GhostFields:
        """Ghosts with their velocities (m/s), which follow from the velocities of the water around the
        ghosts' nodes.

        The states in `parts` give the velocities of moving solids.
        """
        walls = model.walls
        at_node = self.carried(model, lambda j: j["u"], ghosts, tables)
        surface = walls.sliding
        for wall in model.moving:
            rows = slice(*wall.rows)
            surface = surface.at[rows].add(wall.velocity(parts[wall.name], ghosts.x[rows]))
        u_ghosts = walls.velocity(at_node, columns(surface), walls.mirror)
        u_shear = walls.velocity(at_node, columns(surface), walls.shear)
        for body in model.bodies:
            rows = slice(*body.rows)
            moving = columns(body.velocity(parts[body.name], ghosts.x[rows]))
            # mirror the normal component of the relative velocity: the water slips along the body
            normal = columns(body.normals(parts[body.name], walls.x[rows]))
            there = tuple(a[rows] for a in at_node)
            through = 2.0 * dot(tuple(a - b for a, b in zip(moving, there, strict=True)), normal)
            mirrored = tuple(a + through * n for a, n in zip(there, normal, strict=True))
            u_ghosts = u_ghosts.at[rows].set(stack(mirrored))
        return ghosts._replace(u=u_ghosts, u_shear=u_shear)

    # ---------------------------------------------------------------- failures

    @Part.CHECKS.scope()
    def check(self, model: Model, state: State, tables: Tables, x_old: jax.Array, x_used: jax.Array) -> State:
        """Flags failures in the state's status: outdated tables, non-finite values, escapes, high speeds.

        `x_old`: positions (m) at the beginning of the step; `x_used`: positions (m) at which the tables were
        used.
        """
        p, status = state.particles, state.status
        finite = jnp.isfinite(p.x).all(axis=1) & jnp.isfinite(p.u).all(axis=1) & jnp.isfinite(p.rho)
        out = jnp.zeros_like(finite)
        for solid in model.every_solid():
            out |= solid.contains(state.parts.get(solid.name), p.x, model.dx)
        out &= p.m > 0.0
        moved2, speed2 = (dot(columns(a), columns(a)) for a in (x_used - tables.x, p.u))
        values = moved2, speed2, (~finite).astype(speed2.dtype), out.astype(speed2.dtype)
        (moved2, speed2, bad, out), (_, fastest, first_bad, first_out) = model.search.slabs.largest(
            *jax.lax.stop_gradient((values, (p.x, p.x, x_old, p.x)))
        )
        stale = moved2 > (0.5 * model.search.skin) ** 2
        too_fast = speed2 > self.fastest(model.dt) ** 2
        # after a failure values may be meaningless: the largest speed is no longer updated
        speed = jnp.where(status.bits == 0, jnp.maximum(status.speed2, speed2), status.speed2)
        status = eqx.tree_at(lambda s: s.speed2, status, speed)
        status = status.flag(Failure.NON_FINITE, bad > 0.0, state.step, first_bad)
        status = status.flag(Failure.STALE_TABLE, stale, state.step, fastest)
        status = status.flag(Failure.THROUGH_WALL, out > 0.0, state.step, first_out)
        status = status.flag(Failure.TOO_FAST, too_fast, state.step, fastest)
        return eqx.tree_at(lambda a: a.status, state, status)


def _checked_tables(state: State, search, found: dict[str, jax.Array], too_many: jax.Array):
    """Status with the largest table sizes needed so far, and a flag if a table is too small.

    `too_many`: whether more particles are near a wall than there are ghosts for their images.
    """
    status = eqx.tree_at(
        lambda s: s.most, state.status, {k: jnp.maximum(v, found[k]) for k, v in state.status.most.items()}
    )
    nowhere = jnp.zeros_like(status.where)
    lost = (found["capacity"] > search.capacity) | (found["node_capacity"] > search.node_capacity)
    if search.slabs.count > 1:
        lost |= found["halo"] > search.slabs.halo
    if search.slabs.points:
        lost |= found["points"] > search.slabs.points
    lost |= too_many
    crowded = found["chamber_capacity"] > search.chamber_capacity
    status = status.flag(Failure.CHAMBER_OVERFLOW, crowded, state.step, nowhere)
    return status.flag(Failure.NEIGHBOUR_OVERFLOW, lost, state.step, nowhere)
