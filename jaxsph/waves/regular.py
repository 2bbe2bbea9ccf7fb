"""Regular waves made by a piston: its motion of first or second order, and the elevation that it aims at.

Equation numbers are those of Zhu et al. (2020) unless another source is named. SI units; x from the paddle's
rest position, positive into the tank; a crest passes x = 0 at t = 0. The paddle's displacement X is positive
into the tank, and its velocity U = (omega / Phi) eta makes the progressive elevation eta (Phi: `biesel`).
"""

from __future__ import annotations

import abc

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from jaxsph.core.arrays import Scalar, real
from jaxsph.waves.base import AbstractWaves
from jaxsph.waves.near_field import near_field_ratio
from jaxsph.waves.theory import (
    GRAVITY,
    _sech2,
    _stokes2_amplitude,
    biesel,
    stokes2_elevation,
    stokes2_velocity,
    wavenumber,
)


def second_order_piston(H: ArrayLike, k: ArrayLike, d: ArrayLike) -> Float[Array, "..."]:
    """Amplitude e2 of the second harmonic of a piston's displacement, m.

    Source: Madsen (1971). With X = (S0 / 2) sin(omega t) + e2 sin(2 omega t) the paddle radiates (nearly) no
    free second harmonic. e2 = (H^2 / 32 d) (3 cosh kd / sinh^3 kd - 2 / Phi). Valid for
    an Ursell number H lambda^2 / d^3 below 8 pi^2 / 3, best in shallow water.
    """
    H, kd = real(H), real(k) * d
    sigma = jnp.tanh(kd)
    return H**2 / (32.0 * d) * (3.0 * _sech2(kd) / sigma**3 - 2.0 / biesel(k, d))


class AbstractGeneration(eqx.Module):
    """Order of wave generation: corrections of the piston's linear motion and of the linear wave."""

    @abc.abstractmethod
    def displacement(self, waves: "RegularWaves", t: ArrayLike) -> Float[Array, "..."]:
        """Correction of the paddle's displacement at t (s), m, without ramp."""

    @abc.abstractmethod
    def elevation(self, waves: "RegularWaves", t: ArrayLike) -> Float[Array, "..."]:
        """Correction of the elevation at x = 0 at t (s), m, without ramp."""


class FirstOrderPiston(AbstractGeneration):
    """First-order wave generation: the linear motion, without corrections."""

    def displacement(self, waves: "RegularWaves", t: ArrayLike) -> Float[Array, "..."]:
        """See `AbstractGeneration`."""
        del waves
        return jnp.zeros_like(real(t))

    def elevation(self, waves: "RegularWaves", t: ArrayLike) -> Float[Array, "..."]:
        """See `AbstractGeneration`."""
        del waves
        return jnp.zeros_like(real(t))


class SecondOrderPiston(AbstractGeneration):
    """Second-order wave generation: Madsen's (1971) second harmonic of the motion, and the wave's own."""

    def displacement(self, waves: "RegularWaves", t: ArrayLike) -> Float[Array, "..."]:
        """Second harmonic of the paddle's displacement at t (s), m, without ramp."""
        e2 = second_order_piston(waves.H, waves.k, waves.d)
        return e2 * jnp.sin(2.0 * waves.omega * real(t))

    def elevation(self, waves: "RegularWaves", t: ArrayLike) -> Float[Array, "..."]:
        """Bound second harmonic of the elevation at x = 0 at t (s), m, without ramp."""
        eta2 = _stokes2_amplitude(waves.H, waves.k, waves.d)
        return eta2 * jnp.cos(2.0 * waves.omega * real(t))


class RegularWaves(AbstractWaves):
    """Regular waves made by a piston, with a smooth start.

    Every number is a float leaf. k, omega and Phi are computed from H, T, d and g at each use, so that
    derivatives with respect to T and d are complete.
    """

    H: Scalar = eqx.field(converter=real)
    """Wave height, crest to trough, m."""
    T: Scalar = eqx.field(converter=real)
    """Wave period, s."""
    d: Scalar = eqx.field(converter=real)
    """Still water depth, m."""
    g: Scalar = eqx.field(converter=real, default=GRAVITY)
    """Acceleration of gravity, m/s2."""
    ramp: Scalar = eqx.field(converter=real, default=0.0)
    """Duration of the start-up, s; 0 starts at once."""
    correction: AbstractGeneration = FirstOrderPiston()
    """Order of wave generation."""

    @property
    def omega(self) -> Scalar:
        """Angular frequency of the waves, rad/s."""
        return 2.0 * jnp.pi / self.T

    @property
    def k(self) -> Scalar:
        """Wavenumber of the waves, rad/m."""
        return wavenumber(self.omega, self.d, self.g)

    @property
    def Phi(self) -> Scalar:
        """Transfer function H / S0 of the piston (-), Eq. 22."""
        return biesel(self.k, self.d)

    def first_order_displacement(self, t: ArrayLike) -> Float[Array, "..."]:
        """First-order part of the paddle's displacement at t (s), m, with the ramp."""
        t = real(t)
        return self.ramp_factor(t) * 0.5 * self.H / self.Phi * jnp.sin(self.omega * t)

    def paddle_displacement(self, t: ArrayLike) -> Float[Array, "..."]:
        """Displacement X of the paddle at t (s), m; with a ramp it is zero and at rest at t = 0.

        X = (S0 / 2) sin(omega t), S0 = H / Phi, plus the correction, both times the ramp.
        """
        X = self.first_order_displacement(t)
        return X + self.ramp_factor(t) * self.correction.displacement(self, t)

    def elevation(self, x: ArrayLike, t: ArrayLike) -> Float[Array, "..."]:
        """Target elevation at x (m) from the paddle's rest position and t (s), m, to second order.

        The wave is in phase with the paddle. It has no ramp: compare it with a simulation
        only once the front, travelling at the group velocity, has passed x.
        """
        return stokes2_elevation(x, t, self.H, self.T, self.d, self.g)

    def paddle_elevation(self, t: ArrayLike) -> Float[Array, "..."]:
        """Linear target elevation at the paddle at t (s), m, with the ramp: the eta of Eq. 23."""
        t = real(t)
        return self.ramp_factor(t) * 0.5 * self.H * jnp.cos(self.omega * t)

    def delayed_elevation(self, x: ArrayLike, t: ArrayLike) -> Float[Array, "..."]:
        """Target elevation of the progressive wave at x (m) near the paddle and t (s), m, with the ramp.

        The paddle's elevation one travel time k x / omega ago, with the bound second
        harmonic where the waves have one. The ramp travels at the phase speed, which is
        near enough within a fraction of a wavelength.
        """
        t = real(t) - self.k * x / self.omega
        eta = self.paddle_elevation(t)
        return eta + self.ramp_factor(t) ** 2 * self.correction.elevation(self, t)

    def mean_displacement(self, t: ArrayLike) -> Float[Array, "..."]:
        """See `AbstractWaves`: elevation times the phase speed is flow, of a bound harmonic too."""
        t, ramp = real(t), self.ramp_factor(t)
        first = 0.5 * self.H * jnp.sin(self.omega * t)
        quarter = 0.25 * self.T  # a sine in the place of the second harmonic's cosine
        second = 0.5 * self.correction.elevation(self, t - 0.5 * quarter)
        return (ramp * first + ramp**2 * second) / (self.k * self.d)

    def velocity(self, x: Float[Array, " X"], z: Float[Array, " Z"], t: ArrayLike) -> Float[Array, "2 X Z"]:
        """See `AbstractWaves`: of second order."""
        found = stokes2_velocity(x[:, None], z, t, self.H, self.T, self.d, self.g)
        back = 0.125 * self.g * self.H**2 * self.k / (self.omega * self.d)
        ramp = self.ramp_factor(real(t) - self.k * x / self.omega)[:, None]
        return jnp.stack([ramp * found[..., 0] - ramp**2 * back, ramp * found[..., 1]])

    def near_field(self, x: float) -> Scalar:
        """See `AbstractWaves`: constant under differentiation with respect to T and d."""
        ratio = near_field_ratio(float(x), float(self.omega), float(self.d), float(self.g))
        return jnp.asarray(ratio, real(self.T).dtype)

    def near_elevation(self, ratio: Float[Array, "..."], t: ArrayLike) -> Float[Array, "..."]:
        """See `AbstractWaves`."""
        return ratio * self.first_order_displacement(t)

    def at_peak(self, values: Float[Array, "..."]) -> Scalar:
        """See `AbstractWaves`: the one value."""
        return values
