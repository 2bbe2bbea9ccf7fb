"""Prescribed motions of solids as functions of time: harmonic, and interpolated between samples."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np
import scipy  # which imports its subpackages on first use

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.parts.driven import AbstractPath
from jaxsph.waves.base import ramp_factor

__all__ = ["HarmonicPath", "SampledPath"]


class HarmonicPath(AbstractPath):
    """Harmonic motion, amplitude sin(omega t + phase), which grows smoothly over the `ramp`."""

    amplitude: Float[Array, " V"]
    """Amplitudes of surge (m), heave (m) and pitch (rad); in 3-D of all six motions."""
    omega: Scalar
    """Angular frequency, rad/s."""
    phase: Float[Array, " V"]
    """Phases of these motions, rad."""
    ramp: Scalar
    """Time over which the motion grows to its amplitude, s; 0 for no ramp."""

    def pose(self, t):
        """See `AbstractPath`."""
        return ramp_factor(t, self.ramp) * self.amplitude * jnp.sin(self.omega * t + self.phase)


class SampledPath(AbstractPath):
    """Motion interpolated by cubic splines between samples; at rest before the first sample and after the
    last."""

    t: Float[Array, " K"]
    """Times of the samples, s."""
    coefficients: Float[Array, "4 K-1 V"]
    """Coefficients of the cubics between samples (m, rad), in descending powers of the time (s) since the
    earlier sample."""

    @classmethod
    def of(cls, t: np.ndarray, poses: np.ndarray, dtype: Any = jnp.float32) -> SampledPath:
        """Builds the path through the motions `poses` `[K, V]` (m, rad) at increasing times t (s).

        The motion begins and ends with zero velocity.
        """
        spline = scipy.interpolate.CubicSpline(t, poses, bc_type="clamped")
        return cls(jnp.asarray(t, dtype), jnp.asarray(spline.c, dtype))

    def pose(self, t):
        """See `AbstractPath`."""
        within = jnp.clip(t, self.t[0], self.t[-1])
        piece = jnp.clip(jnp.searchsorted(self.t, within, side="right") - 1, 0, len(self.t) - 2)
        a, b, c, d = self.coefficients[:, piece]
        s = within - self.t[piece]
        return ((a * s + b) * s + c) * s + d
