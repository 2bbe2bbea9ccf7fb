"""Solid walls: fixed ghost particles with interpolation nodes, and the regional sets of thin walls.

A ghost stands in the wall; its node is its mirror image in the water. Each step the water's pressure and
velocity are interpolated at the nodes and carried to the ghosts (Zhu et al. 2020, Eq. 18-20), which are
from then on ordinary sources of the pair sums. Around a wall thinner than the kernel the water is divided
into regions that see different ghosts and not each other (their section 2.4.1). Which region sees which
set is a static matrix of booleans, packed into bit masks that the neighbour search applies.
"""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp

from jaxsph.core.arrays import Scalar


def spring(gap: jax.Array, dx: Scalar, c0: Scalar) -> jax.Array:
    """Acceleration (m/s2) away from a wall at the distance `gap` (m): see `Ghosts.push`."""
    reach = 0.4 * dx
    return (0.1 * c0 / reach) ** 2 * jnp.maximum(reach - gap, 0.0)


def _off_edge(beside: jax.Array, beyond: jax.Array, away: Callable) -> tuple[jax.Array, jax.Array]:
    """What `away` (of a gap, m) gives off a solid's outer edge, along both normals: from the distances
    (m) beside one face and beyond the other, negative behind them."""
    corner = (beside > 0) & (beyond > 0)
    distance = jnp.sqrt(jnp.where(corner, beside**2 + beyond**2, 1.0))
    out = away(jnp.where(corner, distance, jnp.maximum(beside, beyond)))
    return (
        out * jnp.where(corner, beside / distance, beside > beyond),
        out * jnp.where(corner, beyond / distance, beside <= beyond),
    )
