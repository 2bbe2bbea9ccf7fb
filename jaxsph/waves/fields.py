"""Waves over the plan of a basin: long-crested waves in any direction, and directional seas.

SI units. x is measured from the wavemaker's rest position, positive into the basin; y is measured across the
basin, and z is the height above the bed. Directions (rad) are the directions towards which waves travel,
measured from the x axis towards the y axis. Phases refer to the middle of the wavemaker.
"""

from __future__ import annotations

import abc
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float
from numpy.typing import NDArray

from jaxsph.core.arrays import Scalar, real
from jaxsph.waves import second_order
from jaxsph.waves.base import AbstractWaves, ramp_factor
from jaxsph.waves.theory import GRAVITY

__all__ = ["AbstractWaveField", "DirectionalSea", "LongCrestedWaves"]


class AbstractWaveField(eqx.Module):
    """Waves over the plan of a basin, with a smooth start."""

    middle: eqx.AbstractVar[Scalar]
    """Position y of the middle of the wavemaker, m."""

    @abc.abstractmethod
    def elevation(self, x: ArrayLike, y: ArrayLike, t: ArrayLike) -> Float[Array, "..."]:
        """Target elevation without the ramp (m) at x, y (m) and t (s); the arguments are broadcast."""

    @abc.abstractmethod
    def mean_displacement(self, y: Float[Array, " Y"], t: Scalar) -> Float[Array, " Y"]:
        """Depth-averaged displacement (m) along x of the water at x = 0, y (m) and t (s), with the ramp.

        A wall with this motion supplies the flow rate of the waves.
        """

    @abc.abstractmethod
    def velocity(
        self, x: Float[Array, " X"], y: Float[Array, " Y"], z: Float[Array, " Z"], t: ArrayLike
    ) -> Float[Array, "3 X Y Z"]:
        """Target velocities (u, v, w) at all x, y and heights z above the bed (m), m/s, with the ramp.

        As in a closed basin, a return current balances the waves' mass transport.
        """


class LongCrestedWaves(AbstractWaveField):
    """Long-crested waves that travel in one direction: the waves of a flume, turned about the vertical axis.

    The order of the theory is the order of `waves`.
    """

    waves: AbstractWaves
    """Waves as functions of the distance along their direction."""
    direction: Scalar
    """Direction of the waves, rad."""
    middle: Scalar
    lengthening: Scalar = eqx.field(converter=real, default=1.0)
    """Ratio of the actual wavelength to the wavelength of `waves` (-); higher waves are longer than linear
    waves. Without this ratio, relaxation zones would run out of phase with the water over several
    wavelengths."""

    def elevation(self, x, y, t):
        """See `AbstractWaveField.elevation`."""
        return self.waves.elevation(self._along(real(x), real(y)), t)

    def mean_displacement(self, y, t):
        """See `AbstractWaveField.mean_displacement`."""
        shift = self.lengthening * self.waves.mean_displacement(t, self._along(0.0, y))
        return self._start(t) * jnp.cos(self.direction) * shift

    def velocity(self, x, y, z, t):
        """See `AbstractWaveField.velocity`."""
        s = self._along(x[:, None], y)
        along, up = self._start(t) * self.waves.velocity(s.ravel(), z, t)
        along = self.lengthening * along  # longer waves of the same elevation carry more water
        cos, sin = jnp.cos(self.direction), jnp.sin(self.direction)
        return jnp.stack([cos * along, sin * along, up]).reshape(3, *s.shape, len(z))

    def _along(self, x, y):
        """Position in `waves` of the points x, y (m), m: their distance from the middle of the wavemaker
        along the waves' direction, divided by `lengthening`."""
        distance = x * jnp.cos(self.direction) + (y - self.middle) * jnp.sin(self.direction)
        return distance / self.lengthening

    def _start(self, t):
        """Additional start-up factor at t (s), which rises from 0 to 1 over the first period (-).

        The ramp of `waves` travels with the waves, and therefore begins before t = 0 on the side of the basin
        that the waves reach first.
        """
        return ramp_factor(real(t), 2.0 * jnp.pi / self.waves.omega)


class DirectionalSea(AbstractWaveField):
    """Sea of linear waves of many frequencies, each in its own direction, with a smooth start.

    Waves of one frequency but several directions would form a pattern fixed in space, whose height differs
    from place to place. With one direction for each frequency, the height is the same everywhere (Miles and
    Funke 1989).
    """

    real: Float[Array, " N"]
    """Real parts of the complex amplitudes of the waves' elevations at the middle of the wavemaker, m."""
    imag: Float[Array, " N"]
    """Imaginary parts of these amplitudes, m."""
    omega: Float[Array, " N"]
    """Angular frequencies, rad/s."""
    k: Float[Array, "N 2"]
    """Wavenumbers along x and y, rad/m."""
    d: Scalar
    """Still water depth, m."""
    g: Scalar
    """Acceleration of gravity, m/s2."""
    ramp: Scalar
    """Duration of the start-up, s; with 0 the waves start at once."""
    middle: Scalar

    @classmethod
    def of(
        cls,
        amplitude: NDArray[np.complexfloating],
        omega: NDArray[np.floating],
        directions: NDArray[np.floating],
        d: float,
        *,
        ramp: float = 0.0,
        middle: float = 0.0,
        g: float = GRAVITY,
        dtype: Any = jnp.float32,
    ) -> DirectionalSea:
        """Builds a sea from its waves' complex amplitudes (m), angular frequencies (rad/s) and directions
        (rad)."""
        k = second_order.wavenumbers(omega, d, g)
        k = np.stack([k * np.cos(directions), k * np.sin(directions)], axis=-1)
        every = {"real": np.real(amplitude), "imag": np.imag(amplitude), "omega": omega, "k": k}
        every |= {"d": d, "g": g, "ramp": ramp, "middle": middle}
        return cls(**{name: jnp.asarray(value, dtype) for name, value in every.items()})

    def elevation(self, x, y, t):
        """See `AbstractWaveField.elevation`."""
        cos, sin = self._phases(real(x), real(y), t)
        return cos @ self.real - sin @ self.imag

    def mean_displacement(self, y, t):
        """See `AbstractWaveField.mean_displacement`: the flow rate is the elevation times the phase
        speed."""
        cos, sin = self._phases(jnp.zeros_like(y), y, t)
        share = self.k[:, 0] / (jnp.sum(self.k**2, axis=1) * self.d)
        return ramp_factor(real(t), self.ramp) * (cos @ (share * self.imag) + sin @ (share * self.real))

    def velocity(self, x, y, z, t):
        """See `AbstractWaveField.velocity`."""
        size = jnp.hypot(self.k[:, 0], self.k[:, 1])[:, None]
        kz, kd = size * z, size * self.d
        rise, bed = jnp.exp(kz - kd), -jnp.expm1(-2.0 * kd)
        cosh, sinh = (rise * (1.0 + sign * jnp.exp(-2.0 * kz)) / bed for sign in (1.0, -1.0))
        cos, sin = self._phases(x[:, None], y, t)
        along = self.omega * (self.real * cos - self.imag * sin)
        up = -self.omega * (self.real * sin + self.imag * cos)
        unit = (self.k / size).T
        # the return current of each wave, against its direction
        energy = (self.real**2 + self.imag**2) / self.omega
        back = 0.5 * self.g * jnp.sum(energy * self.k.T, axis=1) / self.d
        ramp = ramp_factor(real(t), self.ramp)
        level = jnp.stack([(along * part) @ cosh for part in unit])
        level = ramp * level - ramp**2 * back[:, None, None, None]
        return jnp.concatenate([level, ramp * (up @ sinh)[None]])

    def _phases(self, x, y, t):
        """Cosine and sine of every wave's phase at x, y (m) and t (s), as arrays `[..., N]`."""
        at = jnp.stack(jnp.broadcast_arrays(x, y - self.middle), axis=-1)
        angle = self.omega * real(t)[..., None] - at @ self.k.T
        return jnp.cos(angle), jnp.sin(angle)
