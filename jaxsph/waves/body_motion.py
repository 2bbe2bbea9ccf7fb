"""Motion of bodies with links in waves, in time, in JAX: linear theory of the water, and any law of a link.

The free coordinates x of the bodies, relative to equilibrium, follow from the equation of Cummins (1962),

    (M + A) x'' + integral of R(s) x'(t - s) ds + C x' + K x + d |x'| x' = F(t) + forces of the links,

with the memory R of the waves that the bodies radiate, which is a cosine transform of their damping by
radiation, and the added mass A at infinite frequency. The additions of `waves.fast_bodies` are included.
Links have the laws with which they act in a run of the water: a latch, friction and end stops are possible.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.core.loop import every_block
from jaxsph.model.links import Link, LinkMotion
from jaxsph.waves import theory
from jaxsph.waves.fast_bodies import BodyAdditions, BodySeries
from jaxsph.waves.fast_owc import COMPONENTS, Incident
from jaxsph.waves.spectra import HIGHEST, LOWEST

__all__ = ["BodyMotion", "Tie", "body_motion"]

STEPS = 200
"""Number of time steps in a wave period, in a sea in its peak period."""
PERIODS = 4
"""Number of periods of regular waves over which results are averaged."""
REPEAT = round((COMPONENTS - 1) / (HIGHEST - LOWEST))
"""Number of peak periods after which a sea repeats, over which its results are averaged."""
BEFORE = 12
"""Number of periods before the average begins."""
RAMP = 3
"""Number of periods in which the waves grow to their height."""
MEMORY = 3
"""Number of periods after which the memory of radiated waves ends."""
GRID = 400
"""Number of frequencies from which the memory is found."""


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
    """Motion of bodies in incident waves. The waves of a sea have fixed random phases."""
    omega, regular = waves.omega, len(waves.omega) == 1
    # a sea, whose frequencies are equally spaced, repeats after this number of periods
    periods = PERIODS if regular else REPEAT
    dt = 2.0 * jnp.pi / (STEPS * (omega[0] if regular else REPEAT * (omega[1] - omega[0])))
    first, count = BEFORE * STEPS, (BEFORE + periods) * STEPS
    force = jax.vmap(water.at)(omega)[1]
    t = dt * (jnp.arange(count) + 0.5)
    turn = jnp.exp(-1j * (omega * t[:, None] - _phases(len(omega))))
    drive = jnp.real(turn @ (waves.amplitude[:, None] * force))
    drive = drive * jnp.minimum(t / t[RAMP * STEPS], 1.0)[:, None]
    equation, none = _Water.of(water, added, ties, waves, dt), jnp.zeros(len(water.mass))
    links = tuple(one.link.start(one.rest, t[0]) for one in ties)
    start = _State(jnp.zeros((), int), none, none, links, jnp.zeros((MEMORY * STEPS, len(none))))

    def step(state: _State, _: None) -> tuple[_State, Any]:
        return equation.step(ties, state, t[state.k], drive[state.k], dt)

    _, (x, harvested, lost) = every_block(step, start, count)
    x, P_pto = x[first:], jnp.mean(harvested[first:])
    each = theory.incident_power(
        2.0 * waves.amplitude, 2.0 * jnp.pi / omega, water.depth, water.rho0, water.g
    )
    P_inc = jnp.sum(each)
    if regular:
        sizes = 2.0 * jnp.mean(jnp.conj(turn[first:]) * x, axis=0)
    else:
        sizes = math.sqrt(2.0) * jnp.std(x, axis=0) + 0j
    return BodyMotion(P_pto / P_inc, P_pto, P_inc, jnp.mean(lost[first:]), t[first:], x, sizes)


class _State(NamedTuple):
    """Bodies and links at one time."""

    k: Array
    """Number of steps before it."""
    x: Float[Array, " n"]
    v: Float[Array, " n"]
    links: tuple[LinkMotion, ...]
    past: Float[Array, "L n"]
    """Rates in the last L steps; the place of step k is k modulo L."""


class _Water(NamedTuple):
    """Equation of motion of bodies in the water, for one time step."""

    mass: Float[Array, "n n"]
    damping: Float[Array, "n n"]
    stiffness: Float[Array, "n n"]
    """Stiffness without that of the links."""
    drag: Float[Array, " n"]
    memory: Float[Array, "twice_L n n"]
    """Damping by the rates of earlier steps, in reverse order, twice."""

    @classmethod
    def of(
        cls, water: BodySeries, added: BodyAdditions, ties: tuple[Tie, ...], waves: Incident, dt: Scalar
    ) -> _Water:
        """Equation for steps of dt (s)."""
        drag, inertia = (jnp.asarray(jnp.stack([*map(jnp.asarray, a)]), jnp.float32) for a in added)
        low, _, high = water.series.ends
        grid = (jnp.arange(GRID) + 0.5) * (high / GRID)
        # waves longer than those of the series have little effect on motions in shorter ones
        radiated = jnp.real(jax.vmap(lambda w: water.at(jnp.maximum(w, low))[0])(grid))
        age = dt * jnp.arange(MEMORY * STEPS)
        fading = jnp.cos(0.5 * jnp.pi * jnp.arange(MEMORY * STEPS) / (MEMORY * STEPS)) ** 2
        kernel = (2.0 / jnp.pi * high / GRID) * jnp.tensordot(jnp.cos(age[:, None] * grid), radiated, 1)
        weights = dt * fading[:, None, None] * kernel
        weights = weights.at[0].multiply(0.5)
        # constant damping and mass correct the impedance of this memory in the waves
        shares = waves.amplitude**2 / jnp.sum(waves.amplitude**2)
        exact = jax.vmap(lambda w: water.at(w)[0])(waves.omega)
        off = exact - jnp.tensordot(jnp.exp(1j * waves.omega[:, None] * age), weights, 1)
        damping = jnp.tensordot(shares, jnp.real(off), 1)
        mass = jnp.tensordot(shares, -jnp.imag(off) / waves.omega[:, None, None], 1)
        stiffness = water.stiffness - sum(one.stiffness * jnp.outer(one.way, one.way) for one in ties)
        older = weights.at[0].set(0.0)[-jnp.arange(len(age))]
        return cls(
            water.mass + jnp.diag(inertia * jnp.diag(water.mass)) + mass,
            water.damping + damping + weights[0],
            stiffness,
            drag,
            jnp.concatenate([older, older]),
        )

    def step(
        self, ties: tuple[Tie, ...], state: _State, t: Scalar, drive: Array, dt: Scalar
    ) -> tuple[_State, tuple[Array, Array, Array]]:
        """State after a step whose middle is at t (s); coordinates there, harvested power and power lost by
        drag (W/m). `drive`: forces of the waves."""
        length, k = len(state.past), state.k
        x, v = state.x + 0.5 * dt * state.v, state.v
        weights = jax.lax.dynamic_slice_in_dim(self.memory, (-k) % length, length)
        force = drive - self.stiffness @ x - self.damping @ v - self.drag * jnp.abs(v) * v
        force = force - jnp.einsum("lij,lj->i", weights, state.past)
        # forces at the end of the step are linear in the acceleration
        matrix = self.mass + 0.5 * dt * (self.damping + jnp.diag(2.0 * self.drag * jnp.abs(v)))
        pulls = []
        for one, motion in zip(ties, state.links, strict=True):
            s = one.rest + one.way @ x
            pull = one.link.pull(motion, s, one.way[None], (one.way @ v)[None], t)
            at_rest = jax.grad(one.link.law.stored, argnums=1)(motion.own, one.rest)
            force = force + pull.force + at_rest * one.way
            matrix = matrix + pull.inertia(dt)
            pulls.append((s, pull))
        a = jnp.linalg.solve(matrix, force)
        links, harvested = [], jnp.zeros(())
        for one, motion, (s, pull) in zip(ties, state.links, pulls, strict=True):
            done, taken = one.link.done(motion, s, pull, a, t, dt)
            links.append(done)
            if one.link.harvests:
                harvested = harvested + sum(taken.values(), jnp.zeros(())) / dt
        mean, end = v + 0.5 * dt * a, v + dt * a
        past = jax.lax.dynamic_update_index_in_dim(state.past, mean, k % length, 0)
        lost = jnp.sum(self.drag * jnp.abs(mean) ** 3)
        return _State(k + 1, x + 0.5 * dt * end, end, tuple(links), past), (x, harvested, lost)


def _phases(count: int) -> Float[Array, " N"]:
    """Phases of the waves of a sea (rad), which are random but always the same; 0 for a single wave."""
    turns = np.random.default_rng(0).random(count) if count > 1 else np.zeros(1)
    return jnp.asarray(2.0 * np.pi * turns, jnp.float32)
