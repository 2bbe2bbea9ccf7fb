"""Active absorption of reflected waves by a piston wavemaker, Eq. 23 of Zhu et al. (2020).

SI units; x from the paddle's rest position, positive into the tank. The paddle's displacement X is positive
into the tank, and its velocity U = (omega / Phi) eta makes the progressive elevation eta (Phi:
`theory.biesel`).
"""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from jaxsph.core.arrays import Scalar, real
from jaxsph.waves.base import AbstractWaves


class ActiveAbsorption(eqx.Module):
    """Active absorption: a piston that makes the target waves and absorbs reflected ones, Eq. 23.

    Eq. 23, U = (omega / Phi)(2 eta - eta_sph), is feed-forward plus feedback,
    (omega / Phi) eta + (omega / Phi)(eta - eta_sph). Here the feed-forward is the
    paddle's own velocity (with its second-order part) and the feedback compares the
    gauge with what it would read without reflection:

        U = U_target + gain (omega / Phi)(eta_gauge - eta_sph) - drift_rate (X - X_target)
        eta_gauge = eta_progressive(distance, t) + near_field X_1(t)

    The defaults are Eq. 23 as printed. A gauge a few h away lags the paddle by
    k * distance and sees the piston's evanescent modes, which Eq. 23 as printed takes
    for a reflection; `at_gauge` allows for both. The near field is that of the TARGET
    motion: with the actual X any slow drift would feed itself at the rate
    near_field * omega / Phi, though a slow paddle raises no elevation.

    A constant error of the gauge moves the paddle until the displaced water makes up for the
    error (closed tank) or until drift_rate holds it, at (omega / Phi) error / drift_rate.
    """

    gain: Scalar = eqx.field(converter=real, default=1.0)
    """Gain of the feedback (-): 1 is Eq. 23, 0 is no absorption."""
    drift_rate: Scalar = eqx.field(converter=real, default=0.0)
    """Rate at which the paddle returns to its target position, 1/s; keep << omega."""
    distance: Scalar = eqx.field(converter=real, default=0.0)
    """Distance of the gauge from the paddle, m."""
    near_field: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    """Ratio of the evanescent elevation at the gauge to the paddle's displacement, of every wave (-)."""

    @classmethod
    def at_gauge(
        cls,
        waves: AbstractWaves,
        distance: float,
        gain: ArrayLike = 1.0,
        drift_rate: ArrayLike = 0.0,
    ) -> "ActiveAbsorption":
        """Absorption with a gauge `distance` (m) in front of the paddle.

        The near field is summed on the host for the present periods and depth of `waves`; it is a leaf,
        constant under differentiation with respect to them. **Arguments**: `gain` (-);
        `drift_rate` (1/s).
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
        gauge over the still water level (m).
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

        The gauge meets the arriving wave k * distance early, and the near field of the
        absorbing motion adds near_field / Phi to that. A first-order filter of this time
        constant on (gauge_elevation - eta_measured) lags by their sum: for T = 1.2 s,
        d = 0.5 m and a gauge at 0.06 m the residual reflection falls from 14 % to 1 %.
        """
        lead = waves.k * self.distance + waves.at_peak(self.near_field) / waves.Phi
        return jnp.tan(lead) / waves.omega
