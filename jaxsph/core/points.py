"""Evaluation of laws at points on the host while a problem is built, with few compilations."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxsph.core.arrays import on_device


def at_points(law: Callable[[jax.Array], Any], x: np.ndarray, dtype: Any = jnp.float32) -> Any:
    """Values `[N, ...]` of `law`, in the law's unit, at points x `[N]` or `[N, D]` on the host.

    The law is compiled as a whole, once for all N between two successive powers of two. `law` is a method
    of a module, or an `eqx.Partial` of a method or function. The arrays in `law` become arguments of the
    compiled function, and everything else is constant.
    """
    count = len(x)
    padded = np.zeros((1 << max(count - 1, 0).bit_length(), *x.shape[1:]))
    padded[:count] = x
    return jax.tree.map(lambda a: np.asarray(a)[:count], _values(law, on_device(padded, dtype)))


@eqx.filter_jit
def _values(law: Callable[[jax.Array], Any], x: jax.Array) -> Any:
    return law(x)
