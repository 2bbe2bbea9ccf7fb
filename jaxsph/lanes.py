"""What `jax.vmap` does not do well by itself when whole runs go side by side: gathers and choices.

Nothing here changes a value. Outside a batch these are the plain operations.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp

from jaxsph._typing import Array, Int

__all__ = ["in_any_lane", "taken"]


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
    return taken(a, index), _plain(tangents[0], index)


def _plain(a, index):
    return a.at[index].get(mode="promise_in_bounds")


@jax.custom_batching.custom_vmap
def _taken(a, index):
    return _plain(a, index)


@_taken.def_vmap
def _(lanes, batched, a, index):
    if all(batched):
        index = index + (jnp.arange(lanes, dtype=index.dtype) * a.shape[1])[:, None]
        a = a.reshape(-1, *a.shape[2:])
    elif batched[0]:
        return jax.vmap(_plain, in_axes=(0, None))(a, index), True
    return _plain(a, index), True
