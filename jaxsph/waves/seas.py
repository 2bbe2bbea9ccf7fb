"""Seas of many waves made by a piston: irregular seas, groups, focused waves and recorded series.

All are one sum of waves, Re sum_n a_n exp(i (omega_n t - k_n x)), which is made on the host in double
precision. The piston's motion and the elevation at a gauge are then sums of harmonics.
"""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Int
from numpy.typing import NDArray

from jaxsph.core.arrays import Scalar, real
from jaxsph.waves import second_order
from jaxsph.waves.base import AbstractWaves
from jaxsph.waves.near_field import near_field_ratio
from jaxsph.waves.second_order import Harmonics
from jaxsph.waves.theory import GRAVITY

__all__ = ["Sea", "WaveSum"]


class WaveSum(eqx.Module):
    """Sum of waves travelling along +x, Re sum_n (real + i imag)_n exp(i (omega_n t - k_n x))."""

    real: Float[Array, " N"]
    """Real parts of the complex amplitudes at x = 0, in the unit of the sum."""
    imag: Float[Array, " N"]
    """Imaginary parts of the complex amplitudes."""
    omega: Float[Array, " N"]
    """Angular frequencies, rad/s."""
    k: Float[Array, " N"]
    """Wavenumbers, rad/m."""

    @classmethod
    def of(cls, sum_of: Harmonics, dtype: Any) -> WaveSum:
        """Builds a sum from its complex amplitudes in double precision."""
        a, omega, k = sum_of
        return cls(*(jnp.asarray(part, dtype) for part in (a.real, a.imag, omega, k)))

    def turned(self) -> WaveSum:
        """The sum with sines for cosines: its integral over the phase of every wave."""
        return WaveSum(self.imag, -self.real, self.omega, self.k)

    def at(self, x: ArrayLike, t: ArrayLike, weight: ArrayLike = 1.0) -> Float[Array, "..."]:
        """Value of the sum at x (m) and t (s), which broadcast; `weight` of every wave."""
        angle = self.omega * real(t)[..., None] - self.k * real(x)[..., None]
        return jnp.sum(weight * (self.real * jnp.cos(angle) - self.imag * jnp.sin(angle)), axis=-1)


class Sea(AbstractWaves):
    """Sea of many waves that a piston makes, with a smooth start.

    Numbers are float leaves; what follows from them (wavenumbers, the second order) is constant under
    differentiation.
    """

    d: Scalar
    g: Scalar
    ramp: Scalar
    peak: Int[Array, ""]
    """Index of the wave that stands for the sea where one frequency is asked for."""
    waves: WaveSum
    """Waves of first order, elevations in m."""
    displacement: WaveSum
    """First-order displacement of the paddle, m, wave by wave."""
    correction: WaveSum
    """Second-order displacement of the paddle, m; empty for a wavemaker of first order."""
    bound: WaveSum
    """Second-order elevation bound to the waves near the paddle, m; empty for a wavemaker of first order."""

    @classmethod
    def of(
        cls,
        amplitude: NDArray[np.complex128],
        omega: NDArray[np.float64],
        d: float,
        ramp: float = 0.0,
        *,
        second_order_piston: bool = True,
        g: float = GRAVITY,
        dtype: Any = jnp.float32,
    ) -> Sea:
        """Builds a sea from its waves' complex amplitudes (m) at the paddle and frequencies (rad/s).

        The wave that stands for the sea is the one nearest to the mean frequency by the energy's square,
        which is near the peak's and does not jump with the bins.
        """
        amplitude, omega = np.asarray(amplitude, complex), np.asarray(omega, float)
        energy = np.abs(amplitude) ** 4
        middle = float(np.sum(energy * omega) / np.sum(energy))
        none = Harmonics(np.zeros(0, complex), np.zeros(0), np.zeros(0))
        correction = bound = none
        if second_order_piston:
            correction = second_order.second_order_displacement(amplitude, omega, d, g)
            bound = second_order.second_order_elevation(amplitude, omega, d, 0.0, g)
        waves = Harmonics(amplitude, omega, second_order.wavenumbers(omega, d, g))
        motion = second_order.displacement(amplitude, omega, d, g)
        waves, motion, correction, bound = (
            WaveSum.of(one, dtype) for one in (waves, motion, correction, bound)
        )
        return cls(
            jnp.asarray(d, dtype),
            jnp.asarray(g, dtype),
            jnp.asarray(ramp, dtype),
            jnp.asarray(np.argmin(np.abs(omega - middle)), jnp.int32),
            waves,
            motion,
            correction,
            bound,
        )

    @property
    def omega(self) -> Scalar:
        """See `AbstractWaves`."""
        return self.at_peak(self.waves.omega)

    @property
    def k(self) -> Scalar:
        """See `AbstractWaves`."""
        return self.at_peak(self.waves.k)

    @property
    def Phi(self) -> Scalar:
        """See `AbstractWaves`."""
        size = [jnp.hypot(one.real, one.imag) for one in (self.waves, self.displacement)]
        return self.at_peak(size[0] / size[1])

    def at_peak(self, values):
        """See `AbstractWaves`."""
        return values[self.peak]

    def paddle_displacement(self, t):
        """See `AbstractWaves`: the correction has the ramp's square, as the second order has."""
        ramp = self.ramp_factor(t)
        return ramp * self.displacement.at(0.0, t) + ramp**2 * self.correction.at(0.0, t)

    def elevation(self, x, t):
        """See `AbstractWaves`: to first order; `waves.second_order.second_order_elevation` has the rest."""
        return self.waves.at(x, t)

    def delayed_elevation(self, x, t):
        """See `AbstractWaves`."""
        ramp = self.ramp_factor(real(t) - self.k * x / self.omega)
        return ramp * self.waves.at(x, t) + ramp**2 * self.bound.at(x, t)

    def mean_displacement(self, t):
        """See `AbstractWaves`: elevation times the phase speed is flow, of bound waves too."""
        t, ramp = real(t), self.ramp_factor(t)
        first, second = (one.turned().at(0.0, t, 1.0 / (one.k * self.d)) for one in (self.waves, self.bound))
        return ramp * first + ramp**2 * second

    def velocity(self, x, z, t):
        """See `AbstractWaves`: of first order."""
        w = self.waves
        kz, kd = w.k[:, None] * z, (w.k * self.d)[:, None]
        rise, bed = jnp.exp(kz - kd), -jnp.expm1(-2.0 * kd)
        cosh, sinh = (rise * (1.0 + sign * jnp.exp(-2.0 * kz)) / bed for sign in (1.0, -1.0))
        angle = w.omega * real(t) - w.k * x[:, None]
        along = w.omega * (w.real * jnp.cos(angle) - w.imag * jnp.sin(angle))
        up = -w.omega * (w.real * jnp.sin(angle) + w.imag * jnp.cos(angle))
        back = 0.5 * self.g * jnp.sum((w.real**2 + w.imag**2) * w.k / w.omega) / self.d
        ramp = self.ramp_factor(real(t) - self.k * x / self.omega)[:, None]
        return jnp.stack([ramp * (along @ cosh) - ramp**2 * back, ramp * (up @ sinh)])

    def near_field(self, x):
        """See `AbstractWaves`."""
        d, g = float(self.d), float(self.g)
        return jnp.asarray([near_field_ratio(x, float(omega), d, g) for omega in self.waves.omega])

    def near_elevation(self, ratio, t):
        """See `AbstractWaves`."""
        return self.ramp_factor(t) * self.displacement.at(0.0, t, ratio)
