"""Motion in time in water that remembers the waves which it radiates, for fast models, in JAX.

The coordinates x of a device, bodies or the water column of a chamber, follow from the equation of Cummins
(1962),

    (M + A) x'' + integral of R(s) x'(t - s) ds + C x' + K x + d |x'| x' = F(t) + other forces,

with the memory R, a cosine transform of the damping by radiation, and the added mass A at infinite frequency.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.waves.fast_owc import COMPONENTS, Incident
from jaxsph.waves.spectra import HIGHEST, LOWEST

__all__ = ["Equation", "Moving", "Timeline"]

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

Response = Callable[[Scalar], tuple[Array, Array]]
"""Impedance of the water `[n, n]` and exciting force per metre of amplitude `[n]` at an angular frequency
(rad/s), as in `fast_bodies.BodySeries.at`."""


class Timeline(NamedTuple):
    """Time steps in which the motion in some waves is found. The waves of a sea have fixed random phases."""

    waves: Incident
    dt: Scalar
    """Time step, s."""

    @classmethod
    def of(cls, waves: Incident) -> Timeline:
        """Steps until the waves have settled and been averaged."""
        # a sea, whose frequencies are equally spaced, repeats after REPEAT periods
        lowest = waves.omega[0] if len(waves.omega) == 1 else REPEAT * (waves.omega[1] - waves.omega[0])
        return cls(waves, 2.0 * jnp.pi / (STEPS * lowest))

    @property
    def averaged(self) -> int:
        """Number of steps over which results are averaged."""
        return STEPS * (PERIODS if len(self.waves.omega) == 1 else REPEAT)

    @property
    def count(self) -> int:
        """Number of steps."""
        return BEFORE * STEPS + self.averaged

    def t(self, k: Array) -> Array:
        """Middle of step k, s."""
        return self.dt * (k + 0.5)

    def share(self, k: Array) -> Array:
        """Weight of step k in an average (-)."""
        return jnp.where(k < BEFORE * STEPS, 0.0, 1.0 / self.averaged)

    def drive(self, force: Float[Array, "N n"], k: Array) -> Float[Array, " n"]:
        """Forces of the waves in step k; `force`: complex amplitude for each wave, see `forces`."""
        omega = self.waves.omega
        turns = np.random.default_rng(0).random(len(omega)) * (len(omega) > 1)
        turn = jnp.exp(-1j * (omega * self.t(k) - jnp.asarray(2.0 * np.pi * turns, jnp.float32)))
        return jnp.real(turn @ force) * jnp.minimum((k + 0.5) / (RAMP * STEPS), 1.0)

    def forces(self, response: Response) -> Float[Array, "N n"]:
        """Complex amplitudes of the forces of all waves."""
        return self.waves.amplitude[:, None] * jax.vmap(response)(self.waves.omega)[1]

    def settled(self, series: Array) -> Array:
        """Part of a series of all steps over which results are averaged."""
        return series[BEFORE * STEPS :]

    @property
    def times(self) -> Array:
        """Times of the settled part of a series, s."""
        return self.t(jnp.arange(BEFORE * STEPS, self.count))

    def sizes(self, series: Array) -> Array:
        """Complex amplitudes at the waves' frequency of the columns of a series `[K, ...]` of all steps; in a
        sea sqrt(2) times their standard deviations."""
        kept = self.settled(series)
        if len(self.waves.omega) == 1:
            return 2.0 * jnp.tensordot(jnp.exp(1j * self.waves.omega[0] * self.times), kept, 1) / len(kept)
        return math.sqrt(2.0) * jnp.std(kept, axis=0) + 0j


class Moving(NamedTuple):
    """Coordinates at one time."""

    k: Array
    """Number of steps before it."""
    x: Float[Array, " n"]
    v: Float[Array, " n"]
    past: Float[Array, "L n"]
    """Rates in the last L steps; the place of step k is k modulo L."""

    @classmethod
    def at_rest(cls, n: int) -> Moving:
        """n coordinates at rest."""
        return cls(jnp.zeros((), int), jnp.zeros(n), jnp.zeros(n), jnp.zeros((MEMORY * STEPS, n)))

    def middle(self, dt: Scalar) -> Float[Array, " n"]:
        """Coordinates in the middle of a step of dt (s), in which all forces act."""
        return self.x + 0.5 * dt * self.v

    def moved(self, a: Float[Array, " n"], dt: Scalar) -> Moving:
        """Coordinates after a step of dt (s) with accelerations a."""
        end, place = self.v + dt * a, self.k % len(self.past)
        past = jax.lax.dynamic_update_index_in_dim(self.past, self.v + 0.5 * dt * a, place, 0)
        return Moving(self.k + 1, self.middle(dt) + 0.5 * dt * end, end, past)


class Equation(NamedTuple):
    """Equation of motion in the water, for one time step."""

    mass: Float[Array, "n n"]
    damping: Float[Array, "n n"]
    stiffness: Float[Array, "n n"]
    drag: Float[Array, " n"]
    """Quadratic drag d."""
    memory: Float[Array, "twice_L n n"]
    """Damping by the rates of earlier steps, in reverse order, twice."""

    def with_memory(self, response: Response, ends: tuple[float, ...], time: Timeline) -> Equation:
        """The equation with the memory of the water, for a response that is known between the first and the
        last of `ends` (rad/s)."""
        low, high, waves, age = ends[0], ends[-1], time.waves, time.dt * jnp.arange(MEMORY * STEPS)
        grid = (jnp.arange(GRID) + 0.5) * (high / GRID)
        # waves longer than the known ones have little effect on motions in shorter ones
        radiated = jnp.real(jax.vmap(lambda w: response(jnp.maximum(w, low))[0])(grid))
        fading = jnp.cos(0.5 * jnp.pi * jnp.arange(MEMORY * STEPS) / (MEMORY * STEPS)) ** 2
        kernel = (2.0 / jnp.pi * high / GRID) * jnp.tensordot(jnp.cos(age[:, None] * grid), radiated, 1)
        weights = (time.dt * fading[:, None, None] * kernel).at[0].multiply(0.5)
        # constant damping and mass correct the impedance of this memory in the waves
        shares = waves.amplitude**2 / jnp.sum(waves.amplitude**2)
        exact = jax.vmap(lambda w: response(w)[0])(waves.omega)
        off = exact - jnp.tensordot(jnp.exp(1j * waves.omega[:, None] * age), weights, 1)
        damping = jnp.tensordot(shares, jnp.real(off), 1)
        mass = jnp.tensordot(shares, -jnp.imag(off) / waves.omega[:, None, None], 1)
        older = weights.at[0].set(0.0)[-jnp.arange(len(age))]
        return self._replace(
            mass=self.mass + mass,
            damping=self.damping + damping + weights[0],
            memory=jnp.concatenate([older, older]),
        )

    def begin(self, at: Moving, drive: Float[Array, " n"], dt: Scalar) -> tuple[Array, Array]:
        """Forces in a step of dt (s) at constant rates, and the inertia matrix by which they, and any further
        forces, accelerate the coordinates. `drive`: forces of the waves."""
        length, v = len(at.past), at.v
        weights = jax.lax.dynamic_slice_in_dim(self.memory, (-at.k) % length, length)
        force = drive - self.stiffness @ at.middle(dt) - self.damping @ v - self.drag * jnp.abs(v) * v
        force = force - jnp.einsum("lij,lj->i", weights, at.past)
        slope = self.damping + jnp.diag(2.0 * self.drag * jnp.abs(v))
        return force, self.mass + 0.5 * dt * slope

    def lost(self, at: Moving, a: Float[Array, " n"], dt: Scalar) -> Scalar:
        """Power lost by drag (W/m) in a step of dt (s) with accelerations a."""
        return jnp.sum(self.drag * jnp.abs(at.v + 0.5 * dt * a) ** 3)
