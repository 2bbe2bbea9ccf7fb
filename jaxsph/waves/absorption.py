"""Active absorption of reflected waves by a piston wavemaker, Eq. 23 of Zhu et al. (2020).

SI units. The position x and the displacement X of the paddle are measured from the paddle's rest position,
positive into the tank. A paddle velocity U = (omega / Phi) eta generates the progressive elevation eta, with
Phi from `theory.biesel`.
"""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from jaxsph.core.arrays import Scalar, real
from jaxsph.waves.base import AbstractWaves


class ActiveAbsorption(eqx.Module):
    """Active absorption: a piston that generates the target waves and absorbs reflected waves, Eq. 23.

    Eq. 23, U = (omega / Phi)(2 eta - eta_sph), is feed-forward plus feedback,
    (omega / Phi) eta + (omega / Phi)(eta - eta_sph). Here the feed-forward is the
    target velocity of the paddle (with its second-order part), and the feedback compares
    the gauge reading eta_sph with the elevation eta_gauge expected there without reflected waves:

        U = U_target + gain (omega / Phi)(eta_gauge - eta_sph) - drift_rate (X - X_target)
        eta_gauge = eta_progressive(distance, t) + near_field X_1(t)

    The defaults give Eq. 23 as printed. A gauge a few smoothing lengths h away lags the paddle by
    k * distance and measures the piston's evanescent modes. With Eq. 23 as printed, the lag and these modes
    act like a reflection; `at_gauge` corrects for the lag and the modes. The near field is computed from the
    first-order TARGET displacement X_1. With the actual displacement X, a slow drift would amplify itself at
    the rate gain * near_field * omega / Phi, although a slow paddle has no near field.

    A constant error of the gauge moves the paddle until the displaced water compensates for the
    error (closed tank), or until drift_rate stops the paddle at an offset of
    gain (omega / Phi) error / drift_rate.
    """

    gain: Scalar = eqx.field(converter=real, default=1.0)
    """Gain of the feedback (-): 1 gives Eq. 23, 0 gives no absorption."""
    drift_rate: Scalar = eqx.field(converter=real, default=0.0)
    """Rate at which the paddle returns to its target position, 1/s; should be much smaller than omega."""
    distance: Scalar = eqx.field(converter=real, default=0.0)
    """Distance of the gauge from the paddle, m."""
    near_field: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    """Ratio of the evanescent elevation at the gauge to the paddle's displacement, for every wave (-)."""

    @classmethod
    def at_gauge(
        cls,
        waves: AbstractWaves,
        distance: float,
        gain: ArrayLike = 1.0,
        drift_rate: ArrayLike = 0.0,
    ) -> "ActiveAbsorption":
        """Absorption with a gauge `distance` (m) in front of the paddle.

        The near field is computed on the host from the present periods and depth of `waves`. Derivatives with
        respect to periods and depth treat the near field as constant. **Arguments**: `gain` (-); `drift_rate`
        (1/s).
        """
        return cls(gain, drift_rate, distance, waves.near_field(distance))

    def gauge_elevation(self, waves: AbstractWaves, t: ArrayLike) -> Float[Array, "..."]:
        """Elevation at the gauge at t (s) without reflected waves, m."""
        near = waves.near_elevation(self.near_field, t)
        return waves.delayed_elevation(self.distance, t) + near

    def velocity(
        self, waves: AbstractWaves, X: ArrayLike, t: ArrayLike, eta_measured: ArrayLike
    ) -> Float[Array, "..."]:
        """Velocity U of the paddle at t (s), m/s, Eq. 23.

        **Arguments**: `X`: displacement of the paddle (m); `eta_measured`: elevation at the
        gauge above the still water level (m).
        """
        feedback = self.gauge_elevation(waves, t) - eta_measured
        drift = X - waves.paddle_displacement(t)
        return (
            waves.paddle_velocity(t)
            + self.gain * waves.omega / waves.Phi * feedback
            - self.drift_rate * drift
        )

    def filter_time(self, waves: AbstractWaves) -> Scalar:
        """Time constant of a low-pass filter on the feedback that suits this gauge, s.

        An arriving wave passes the gauge with a phase lead of k * distance over the paddle, and
        the near field of the absorbing motion adds a lead of near_field / Phi. A first-order
        filter with this time constant, applied to (gauge_elevation - eta_measured), lags by
        the sum of both. For T = 1.2 s, a depth of 0.5 m and a gauge 0.06 m from the paddle, the
        filter reduces the residual reflection from 14 % to 1 %.
        """
        lead = waves.k * self.distance + waves.at_peak(self.near_field) / waves.Phi
        return jnp.tan(lead) / waves.omega
