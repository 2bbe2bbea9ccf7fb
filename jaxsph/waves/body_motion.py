"""Motion in time of bodies with links in waves, in JAX: linear theory of the water, and any law of a link.

The equation of the free coordinates is that of `waves.in_time`, with the additions of `waves.fast_bodies`.
Links have the laws with which they act in a run of the water: a latch, friction and end stops are possible.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.core.loop import every_block
from jaxsph.model.links import Link, LinkMotion
from jaxsph.waves.fast_bodies import BodyAdditions, BodySeries
from jaxsph.waves.fast_owc import Incident
from jaxsph.waves.in_time import Equation, Moving, Timeline

__all__ = ["BodyMotion", "Tie", "body_motion"]


class Tie(NamedTuple):
    """A link between bodies near their equilibrium."""

    link: Link
    way: Float[Array, " n"]
    """Change of its extension per unit change of each free coordinate."""
    rest: Scalar
    """Its extension at the equilibrium, m or rad."""
    stiffness: Scalar
    """The part of the stiffness in `BodySeries` that is the link's, N/m or N m."""


class BodyMotion(NamedTuple):
    """Motion of bodies in waves that have settled, per metre of width."""

    xi: Array
    """Ratio of absorbed to incident power (-)."""
    P_pto: Array
    """Mean absorbed power, W/m."""
    P_inc: Array
    """Mean incident power, W/m."""
    P_lost: Array
    """Mean power lost by drag, W/m."""
    t: Float[Array, " K"]
    """Times, s."""
    coordinates: Float[Array, "K n"]
    """Free coordinates relative to the equilibrium, m or rad."""
    sizes: Float[Array, " n"]
    """Complex amplitudes of the coordinates at the waves' frequency; in a sea sqrt(2) times their standard
    deviations, m or rad."""


def body_motion(
    water: BodySeries, added: BodyAdditions, ties: tuple[Tie, ...], waves: Incident
) -> BodyMotion:
    """Motion of bodies in incident waves."""
    time = Timeline.of(waves)
    force, equation = time.forces(water.at), _equation(water, added, ties, time)
    links = tuple(one.link.start(one.rest, time.t(jnp.zeros(()))) for one in ties)
    # weight and buoyancy balance the links at rest
    rest = sum(
        (jax.grad(one.link.law.stored, argnums=1)(own.own, one.rest) * one.way)
        for one, own in zip(ties, links, strict=True)
    )

    def step(state: Any, _: None) -> tuple[Any, Array]:
        at, motions, mean = state
        k = at.k
        given = time.drive(force, k) + rest
        at, motions, x, powers = _step(equation, ties, at, motions, time.t(k), given, time.dt)
        return (at, motions, mean + time.share(k) * powers), x

    start = Moving.at_rest(len(water.mass)), links, jnp.zeros(2)
    (*_, mean), x = every_block(step, start, time.count)
    P_inc, (P_pto, P_lost) = waves.power(water.depth, water.rho0, water.g), mean
    return BodyMotion(P_pto / P_inc, P_pto, P_inc, P_lost, time.times, time.settled(x), time.sizes(x))


def _equation(water: BodySeries, added: BodyAdditions, ties: tuple[Tie, ...], time: Timeline) -> Equation:
    """Equation of the bodies' motion without the forces of their links."""
    drag, inertia = (jnp.asarray(jnp.stack([*map(jnp.asarray, a)]), jnp.float32) for a in added)
    mass = water.mass + jnp.diag(inertia * jnp.diag(water.mass))
    stiffness = water.stiffness - sum(one.stiffness * jnp.outer(one.way, one.way) for one in ties)
    bare = Equation(mass, water.damping, stiffness, drag, jnp.zeros(()))
    return bare.with_memory(water.at, water.series.ends, time)


def _step(
    equation: Equation,
    ties: tuple[Tie, ...],
    at: Moving,
    motions: tuple[LinkMotion, ...],
    t: Scalar,
    drive: Array,
    dt: Scalar,
) -> tuple[Moving, tuple[LinkMotion, ...], Array, Array]:
    """Coordinates and links after a step whose middle is at t (s); coordinates there; harvested power and
    power lost by drag (W/m). `drive`: forces that do not depend on the motion."""
    x = at.middle(dt)
    force, matrix = equation.begin(at, drive, dt)
    pulls = []
    for one, motion in zip(ties, motions, strict=True):
        s = one.rest + one.way @ x
        pull = one.link.pull(motion, s, one.way[None], (one.way @ at.v)[None], t)
        force = force + pull.force
        matrix = matrix + pull.inertia(dt)
        pulls.append((s, pull))
    a = jnp.linalg.solve(matrix, force)
    after, harvested = [], jnp.zeros(())
    for one, motion, (s, pull) in zip(ties, motions, pulls, strict=True):
        done, taken = one.link.done(motion, s, pull, a, t, dt)
        after.append(done)
        if one.link.harvests:
            harvested = harvested + sum(taken.values(), jnp.zeros(())) / dt
    return at.moved(a, dt), tuple(after), x, jnp.stack([harvested, equation.lost(at, a, dt)])
