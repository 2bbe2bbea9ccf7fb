"""What JAX's transformations are told beyond what they do by themselves. Nothing here changes a value.

For `jax.vmap`, where whole runs go side by side: gathers and choices. For reverse mode: what is kept of a
loop that is otherwise rematerialised.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax.ad_checkpoint import checkpoint_name

from jaxsph.core.arrays import Array, Int

_KEPT = "kept"


def kept(tree: Any) -> Any:
    """Arrays that took long to make, and that `rematerialised` functions keep for reverse mode."""
    return jax.tree.map(lambda a: checkpoint_name(a, _KEPT), tree)


def rematerialised(function: Callable) -> Callable:
    """A function that reverse mode runs again, but for what is `kept`, where it would store all of it."""
    return jax.checkpoint(function, policy=jax.checkpoint_policies.save_only_these_names(_KEPT))


@jax.custom_batching.custom_vmap
def in_any_lane(flag: jax.Array) -> jax.Array:
    """A flag; in a batch, whether it is up in any of the lanes: so that a `cond` on it remains a choice."""
    return flag


@in_any_lane.def_vmap
def _(lanes, batched, flag):
    return jnp.any(flag), False


@jax.custom_jvp
def taken(a: Array, index: Int[Array, " N"]) -> Array:
    """a[index], all of them in bounds; in a batch one gather over the lanes laid end to end, which takes
    half of the time of one for each."""
    return _taken(a, index)


@taken.defjvp
def _(primals, tangents):
    # a custom_vmap has no transpose: derivatives go through the plain gather
    a, index = primals
    return taken(a, index), plainly_taken(tangents[0], index)


def plainly_taken(a: Array, index: Int[Array, " N"]) -> Array:
    """`taken` for what is transposed itself."""
    return a.at[index].get(mode="promise_in_bounds")


@jax.custom_batching.custom_vmap
def _taken(a, index):
    return plainly_taken(a, index)


@_taken.def_vmap
def _(lanes, batched, a, index):
    if all(batched):
        index = index + (jnp.arange(lanes, dtype=index.dtype) * a.shape[1])[:, None]
        a = a.reshape(-1, *a.shape[2:])
    elif batched[0]:
        return jax.vmap(plainly_taken, in_axes=(0, None))(a, index), True
    return plainly_taken(a, index), True
