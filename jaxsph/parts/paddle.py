"""Piston wavemaker, which is the moving wall at the tank's near end, and laws of the piston's motion."""

from __future__ import annotations

import abc
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxsph.core.arrays import Array, Components, Float, Scalar, columns
from jaxsph.model.meaning import Entry, Exchange, Reading
from jaxsph.model.solids import AbstractWall
from jaxsph.solids.contact import TOUCH, spring
from jaxsph.solids.shapes import box_corners
from jaxsph.waves.absorption import ActiveAbsorption
from jaxsph.waves.base import AbstractWaves

__all__ = [
    "AbsorbingMotion",
    "AbstractGivenMotion",
    "AbstractMotion",
    "AbstractPaddle",
    "Paddle",
    "Piston",
    "WaveMotion",
    "column_depth",
]


class Piston(eqx.Module):
    """Motion of a piston at time t."""

    X: Scalar
    """Displacement from rest, m, positive into the tank."""
    U: Scalar
    """Velocity, m/s."""
    error: Scalar
    """Filtered error of the elevation at the gauge, expected minus measured, m; zero without absorption."""
    mean: Scalar
    """Slowly varying mean of `error`, m."""


class AbstractMotion(eqx.Module):
    """Law of a piston's motion."""

    @abc.abstractmethod
    def move(self, motion: Piston, x: Components, V: Float[Array, " N"], t: Scalar, dt: Scalar) -> Piston:
        """Motion of the piston at t + dt (s), from its `motion` at t.

        **Arguments**: `x`, `V`: positions (m) of the water's particles at t, and their volumes per metre of
        the tank's width (m2), for a motion that reacts to the water.
        """


class AbstractGivenMotion(AbstractMotion):
    """Motion of a piston as a function of time alone.

    Implement `displacement`; the velocity follows by differentiation.
    """

    @abc.abstractmethod
    def displacement(self, t: Scalar) -> Scalar:
        """Displacement X(t) from rest, m, positive into the tank; zero at t = 0."""

    def move(self, motion, x, V, t, dt):
        """See `AbstractMotion`."""
        del x, V
        X, U = jax.jvp(self.displacement, (t + dt,), (jnp.ones_like(t),))
        return Piston(X, U, jnp.zeros_like(motion.error), jnp.zeros_like(motion.mean))


class WaveMotion(AbstractGivenMotion):
    """Motion of a piston that generates waves, without absorption (Zhu et al. 2020, Eq. 22)."""

    waves: AbstractWaves
    """Waves that the motion generates."""

    def displacement(self, t):
        """See `AbstractGivenMotion`."""
        return self.waves.paddle_displacement(t)


class AbsorbingMotion(AbstractMotion):
    """Motion of a piston that generates waves and absorbs reflected waves (Zhu et al. 2020, Eq. 23)."""

    waves: AbstractWaves
    """Waves that the motion generates."""
    absorption: ActiveAbsorption
    """Law of the absorption."""
    gauge: Scalar
    """Distance (m) from the paddle's face at which the elevation is measured."""
    width: Scalar
    """Half-width (m) of the column that the gauge measures."""
    still: Scalar
    """Depth (m) that the gauge reads in still water."""

    def move(self, motion, x, V, t, dt):
        """See `AbstractMotion`."""
        elevation = column_depth(x, V, motion.X + self.gauge, self.width) - self.still
        # The filter removes noise, and its lag compensates for the gauge's distance from the paddle.
        expected = self.absorption.gauge_elevation(self.waves, t)
        lag = self.absorption.filter_time(self.waves)
        error = motion.error + dt / (lag + dt) * (expected - elevation - motion.error)
        # Standing waves lower the mean level by a fraction of a millimetre. The paddle would drift if it
        # absorbed this change.
        mean = motion.mean + dt * self.absorption.drift_rate * (error - motion.mean)
        eta = self.absorption.gauge_elevation(self.waves, t + dt) - (error - mean)
        U = self.absorption.velocity(self.waves, motion.X, t + dt, eta)
        return Piston(motion.X + dt * U, U, error, mean)


class AbstractPaddle(AbstractWall):
    """Wall at an end of the x axis, usually the near one, which moves along x: a wavemaker.

    Implement `shift` and `speed` for the wall's motion.
    """

    side: ClassVar[float] = 1.0
    """Side of the wall on which the water is: 1 towards larger x, -1 at the far end."""
    face: eqx.AbstractVar[float]
    """Position x of the paddle's face at rest, m."""

    @abc.abstractmethod
    def shift(self, motion: Any, x: Float[Array, "N D"]) -> Float[Array, "..."]:
        """Displacement of the paddle beside points x (m), m, positive into the tank; `[N]`, or one number for
        all points."""

    @abc.abstractmethod
    def speed(self, motion: Any, x: Float[Array, "N D"]) -> Float[Array, "..."]:
        """Velocity of the paddle beside points x (m), m/s, in the same form as `shift`."""

    def entries(self):
        """See `AbstractPart`."""
        return {self.name: Entry(f"work of the {self.name} on the water", Exchange.GIVEN)}

    def outline(self, far):
        """See `AbstractSolid`."""
        low, high = sorted((-self.side * far, self.face))
        return box_corners((low, -far), (high, far))

    def readings(self, dim):
        """See `AbstractPart`."""
        return {self.name: Reading("m", f"displacement of the {self.name}")}

    def place(self, motion, x, nodes):
        """See `AbstractMovingSolid`."""
        shift = jnp.zeros_like(x).at[:, 0].set(self.shift(motion, x))
        return x + shift, nodes + shift

    def velocity(self, motion, x):
        """See `AbstractMovingSolid`."""
        return jnp.zeros_like(x).at[:, 0].set(self.speed(motion, x))

    def acceleration(self, old, new, x, dt):
        """See `AbstractWall`."""
        return jnp.zeros_like(x).at[:, 0].set((self.speed(new, x) - self.speed(old, x)) / dt)

    def gap(self, motion: Any, x: Float[Array, "N D"]) -> Float[Array, " N"]:
        """Distance of particles at x (m) from the paddle's face, m; negative behind the face."""
        return self.side * (x[:, 0] - (jnp.asarray(self.face, x.dtype) + self.shift(motion, x)))

    def push(self, motion, x, dx, c0):
        """See `AbstractSolid`."""
        return jnp.zeros_like(x).at[:, 0].set(self.side * spring(self.gap(motion, x), dx, c0))

    def contains(self, motion, x, dx):
        """See `AbstractSolid`."""
        return self.gap(motion, x) < -0.5 * dx

    def touches(self, motion, x, dx):
        """See `AbstractMovingSolid`."""
        return self.gap(motion, x) < TOUCH * dx

    def cover(self, motion, x, dx):
        """See `AbstractWall`: the paddle hides all other ghosts behind its face."""
        return jnp.clip(self.gap(motion, x) / dx + 0.5, 0.0, 1.0).at[slice(*self.rows)].set(1.0)


class Paddle(AbstractPaddle):
    """Piston wavemaker at the tank's near end: the wall at the low end of the x axis, which moves along x."""

    motion: AbstractMotion
    """Law of the piston's motion."""
    rows: tuple[int, int] = eqx.field(static=True)
    face: float = eqx.field(static=True, default=0.0, kw_only=True)
    name: str = eqx.field(static=True, default="paddle", kw_only=True)

    def start(self, dtype: Any) -> Piston:
        """See `AbstractMovingSolid`: a piston at rest."""
        return Piston(*(jnp.zeros((), dtype) for _ in range(4)))

    def pose(self, motion):
        """See `AbstractMovingSolid`."""
        return jnp.stack([motion.X, 0.0 * motion.X, 0.0 * motion.X]), jnp.zeros(2)

    def read(self, state, sampled):
        """See `AbstractPart`."""
        return {self.name: state.X}

    def move(self, motion, water, depth_volume, t, dt):
        """See `AbstractWall`."""
        return self.motion.move(motion, columns(water.x), depth_volume, t, dt)

    def halfway(self, old, new, dt):
        """See `AbstractWall`."""
        del dt
        return Piston(0.5 * (old.X + new.X), old.U, old.error, old.mean)

    def with_velocity(self, motion, after):
        """See `AbstractWall`."""
        return Piston(motion.X, after.U, motion.error, motion.mean)

    def shift(self, motion, x):
        """See `AbstractPaddle`."""
        return motion.X

    def speed(self, motion, x):
        """See `AbstractPaddle`."""
        return motion.U


def column_depth(x: Components, V: Float[Array, " N"], at: Scalar, width: Scalar) -> Scalar:
    """Depth of water (m) at x = `at` (m), from the volume of water in a column around this position.

    A cosine bell of half-width `width` (m) weights the particles' volumes V per metre of the tank's width
    (m2). The depth is smooth in the positions `x` and conserves volume. If `width` is a whole number of
    spacings, the depth of a lattice does not depend on the gauge's position. The measured amplitude of a
    wave of wavenumber k is reduced by the fraction 0.065 (k width)^2, which is 0.1 % at k width = 0.12.
    """
    s = (x[0] - at) / width
    bell = jnp.where(jnp.abs(s) < 1.0, 0.5 * (1.0 + jnp.cos(jnp.pi * s)), 0.0) / width
    return jnp.sum(V * bell)
