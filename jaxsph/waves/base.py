"""Waves as a wavemaker sees them: regular waves and seas of many waves behind one interface.

SI units; x from the paddle's rest position, positive into the tank. The paddle's displacement X is positive
into the tank, and its velocity U = (omega / Phi) eta makes the progressive elevation eta (Phi: `biesel`).
"""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from jaxsph.core.arrays import Scalar, real


class AbstractWaves(eqx.Module):
    """Waves that a piston makes, with a smooth start."""

    d: eqx.AbstractVar[Scalar]
    """Still water depth, m."""
    g: eqx.AbstractVar[Scalar]
    """Acceleration of gravity, m/s2."""
    ramp: eqx.AbstractVar[Scalar]
    """Duration of the start-up, s; 0 starts at once."""

    @property
    @abc.abstractmethod
    def omega(self) -> Scalar:
        """Angular frequency of the waves, or of their spectrum's peak, rad/s."""

    @property
    @abc.abstractmethod
    def k(self) -> Scalar:
        """Wavenumber at the frequency `omega`, rad/m."""

    @property
    @abc.abstractmethod
    def Phi(self) -> Scalar:
        """Transfer function of the piston at the frequency `omega` (-): wave height over stroke."""

    @abc.abstractmethod
    def paddle_displacement(self, t: ArrayLike) -> Float[Array, "..."]:
        """Displacement X of the paddle at t (s), m; with a ramp it is zero and at rest at t = 0."""

    @abc.abstractmethod
    def elevation(self, x: ArrayLike, t: ArrayLike) -> Float[Array, "..."]:
        """Elevation of the asked waves at x (m) from the paddle at rest and t (s), m, without ramp."""

    @abc.abstractmethod
    def delayed_elevation(self, x: ArrayLike, t: ArrayLike) -> Float[Array, "..."]:
        """Elevation of the asked progressive waves at x (m) near the paddle and t (s), m, with the ramp."""

    @abc.abstractmethod
    def near_field(self, x: float) -> Float[Array, "..."]:
        """Ratio of the evanescent elevation at x (m) to the displacement, of every wave (-); on the host."""

    @abc.abstractmethod
    def near_elevation(self, ratio: Float[Array, "..."], t: ArrayLike) -> Float[Array, "..."]:
        """Evanescent elevation at t (s), m, with the ramp; `ratio` to the displacement: `near_field`."""

    @abc.abstractmethod
    def at_peak(self, values: Float[Array, "..."]) -> Scalar:
        """Value that belongs to the frequency `omega`, of one for every wave."""

    @abc.abstractmethod
    def mean_displacement(self, t: ArrayLike) -> Float[Array, "..."]:
        """Displacement of the water at x = 0, a mean over the depth, at t (s), m, with the ramp.

        A wall that moves so gives the tank the waves' own flow, and needs a relaxation zone for the rest.
        """

    @abc.abstractmethod
    def velocity(self, x: Float[Array, " X"], z: Float[Array, " Z"], t: ArrayLike) -> Float[Array, "2 X Z"]:
        """Velocities (u, w) of the asked waves at all x and heights z over the bed (m), m/s, with the ramp.

        In a closed tank: the mean flow below the troughs carries back what waves carry along.
        """

    def ramp_factor(self, t: ArrayLike) -> Float[Array, "..."]:
        """Start-up factor at t (s), 0 to 1 (-): 10 s^3 - 15 s^4 + 6 s^5 with s = t / ramp.

        Its first two derivatives vanish at both ends: no jump of the acceleration.
        """
        t = real(t)
        # A ramp of 0 has s = 1 at once; the inner value keeps its derivative finite.
        length = jnp.where(self.ramp > 0.0, self.ramp, 1.0)
        s = jnp.where(self.ramp > 0.0, jnp.clip(t / length, 0.0, 1.0), 1.0)
        return s**3 * (10.0 - 15.0 * s + 6.0 * s**2)

    def paddle_velocity(self, t: ArrayLike) -> Float[Array, "..."]:
        """Velocity dX/dt of the paddle at t (s), m/s: the derivative of its displacement."""
        t = real(t)
        return jax.jvp(self.paddle_displacement, (t,), (jnp.ones_like(t),))[1]
