"""Array types and the small vector algebra on tuples of components that the pair laws use."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

__all__ = ["Array", "Bool", "Components", "Float", "Int", "Scalar", "columns", "dot", "stacked"]

Scalar: TypeAlias = Float[Array, ""]


Components: TypeAlias = tuple[jax.Array, ...]
"""A vector field as one array per component: the layout in which XLA runs the pair loop fastest."""


def columns(vector: Float[Array, "N D"]) -> Components:
    """The D components of a field of vectors."""
    return tuple(vector[:, k] for k in range(vector.shape[1]))


def stacked(components: Sequence[jax.Array]) -> Float[Array, "N D"]:
    """The inverse of `columns`."""
    return jnp.stack(tuple(components), axis=-1)


def dot(a: Sequence[jax.Array], b: Sequence[jax.Array]) -> jax.Array:
    """Scalar product of two tuples of components."""
    total = a[0] * b[0]
    for left, right in zip(a[1:], b[1:], strict=True):
        total = total + left * right
    return total
