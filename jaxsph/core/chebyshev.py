"""Chebyshev series of a function of one variable, which is split into ranges."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxsph.core.arrays import Array, Float, Scalar

__all__ = ["NODES", "Series"]

NODES = 16
"""Number of values from which a series is made, in each range."""


class Series(eqx.Module):
    """Chebyshev series of real functions in successive ranges of one variable."""

    coefficients: Float[Array, "P C *F"]
    """Coefficients of each range and order, for all functions."""
    ends: tuple[float, ...] = eqx.field(static=True)
    """Bounds of the ranges, ascending."""

    @classmethod
    def of(cls, function: Callable[[np.ndarray], np.ndarray], ends: tuple[float, ...]) -> Series:
        """Series of functions whose values `[C, ...]` at C points `function` returns, in double precision."""
        places = np.cos(np.pi * (np.arange(NODES) + 0.5) / NODES)
        basis = np.cos(np.arange(NODES)[:, None] * np.arccos(places)) * (2.0 / NODES)
        basis[0] *= 0.5
        found = []
        for low, high in itertools.pairwise(ends):
            values = function(0.5 * (low + high) + 0.5 * (high - low) * places)
            found.append(np.tensordot(basis, values, 1))
        return cls(jnp.asarray(np.array(found), jnp.float32), ends)

    def __call__(self, x: Scalar) -> Float[Array, " *F"]:
        """Values of all functions at x."""
        bounds = jnp.asarray(self.ends)
        piece = jnp.searchsorted(bounds[1:-1], x)
        series, low, high = self.coefficients[piece], bounds[piece], bounds[piece + 1]
        s = (2.0 * x - low - high) / (high - low)
        before, last = jnp.zeros_like(series[0]), jnp.zeros_like(series[0])
        for k in range(NODES - 1, 0, -1):  # Clenshaw's recurrence
            before, last = last, 2.0 * s * last - before + series[k]
        return s * last - before + series[0]
