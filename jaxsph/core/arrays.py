"""Array types, and vector algebra on tuples of components for the pair laws."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float, Int

__all__ = [
    "Array",
    "Bool",
    "Components",
    "Float",
    "Int",
    "Scalar",
    "columns",
    "dot",
    "on_device",
    "real",
    "stack",
]

Scalar: TypeAlias = Float[Array, ""]
"""A real number as an array without dimensions."""


Components: TypeAlias = tuple[jax.Array, ...]
"""A vector field as one array `[N]` per component: the layout in which XLA runs the pair loop fastest."""


def real(value: ArrayLike) -> Float[Array, "..."]:
    """Value converted to a floating-point array; a floating-point array keeps its precision.

    A Python number becomes a weakly typed array. An operation with a second array then keeps the precision of
    the second array: float32 stays float32 even if `jax_enable_x64` is on.
    """
    if isinstance(value, bool | int | float):
        return jnp.asarray(float(value))
    array = jnp.asarray(value)
    return array if jnp.issubdtype(array.dtype, jnp.floating) else array.astype(float)


def on_device(value: ArrayLike | Sequence[Any], dtype: Any) -> jax.Array:
    """Array on the device with a value from the host; the unit is unchanged.

    The value is converted to `dtype` on the host. With `jnp.asarray`, JAX would load a program for every
    shape each time Python starts.
    """
    return jax.device_put(np.asarray(value, dtype))


def columns(vector: Float[Array, "N D"]) -> Components:
    """The D components `[N]` of a vector field `[N, D]`."""
    return tuple(vector[:, k] for k in range(vector.shape[1]))


def stack(components: Sequence[jax.Array]) -> Float[Array, "N D"]:
    """Vector field `[N, D]` of D components `[N]`: the inverse of `columns`."""
    return jnp.stack(tuple(components), axis=-1)


def dot(a: Sequence[jax.Array], b: Sequence[jax.Array]) -> jax.Array:
    """Scalar product of two tuples of components."""
    total = a[0] * b[0]
    for left, right in zip(a[1:], b[1:], strict=True):
        total = total + left * right
    return total
