"""Hints to JAX's transformations, which leave all values unchanged.

Under `jax.vmap` over whole runs, all lanes (one per run) share gathers and branches. For reverse mode, marks
select the arrays that a loop stores. All other arrays are recomputed.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax.ad_checkpoint import checkpoint_name

from jaxsph.core.arrays import Array, Int

_KEPT = "kept"


def keep(tree: Any) -> Any:
    """Marks arrays that are costly to compute, so that a function wrapped by `rematerialise` stores them."""
    return jax.tree.map(lambda a: checkpoint_name(a, _KEPT), tree)


def rematerialise(function: Callable) -> Callable:
    """Function whose intermediate arrays reverse mode recomputes instead of storing them.

    Only arrays marked by `keep` are stored.
    """
    return jax.checkpoint(function, policy=jax.checkpoint_policies.save_only_these_names(_KEPT))


@jax.custom_batching.custom_vmap
def any_lane(flag: jax.Array) -> jax.Array:
    """The flag itself; in a batch of lanes, whether the flag of any lane is set.

    With one flag for the batch, `jax.lax.cond` runs one branch only; with a flag per lane both branches would
    run.
    """
    return flag


@any_lane.def_vmap
def _(lanes, batched, flag):
    return jnp.any(flag), False


@jax.custom_jvp
def gather(a: Array, index: Int[Array, " N"]) -> Array:
    """Elements a[index]; every index must be in bounds.

    In a batch this function is a single gather over the concatenated lanes, which is twice as fast as
    separate gathers for the lanes.
    """
    return _taken_once(a, index)


@gather.defjvp
def _(primals, tangents):
    # a custom_vmap cannot be transposed: derivatives use the plain gather instead
    a, index = primals
    return gather(a, index), gather_linearly(tangents[0], index)


def gather_linearly(a: Array, index: Int[Array, " N"]) -> Array:
    """Elements a[index] by a gather that reverse mode can transpose, unlike the batched form of `gather`."""
    return a.at[index].get(mode="promise_in_bounds")


@jax.custom_batching.custom_vmap
def _taken(a, index):
    return gather_linearly(a, index)


_taken_once = jax.jit(_taken)
"""Function `_taken`, traced once per array shape because a step has hundreds of gathers."""


@_taken.def_vmap
def _(lanes, batched, a, index):
    if all(batched):
        index = index + (jnp.arange(lanes, dtype=index.dtype) * a.shape[1])[:, None]
        a = a.reshape(-1, *a.shape[2:])
    elif batched[0]:
        return jax.vmap(gather_linearly, in_axes=(0, None))(a, index), True
    return gather_linearly(a, index), True
