"""Neighbour tables in blocks of targets, in which native loops read the weights of sums."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp

from jaxsph.core.arrays import Array, Float, Int

BLOCK = 64
"""Number of targets in a block, whose weighted sums are computed together.

Memory is read faster in long pieces. In a table by slot, the entries of 64 targets are adjacent; in blocks,
the entries of all their slots are. A step of 80,000 particles in three dimensions takes 0.8 times as long.
"""


class BlockedTable(NamedTuple):
    """Neighbour table by slot and, for native loops, in blocks of targets.

    The last block ends with the last target. If the number of targets is no multiple of `BLOCK`, this block
    contains targets of the block before once more.
    """

    indices: Int[Array, "K N"]
    """Index of the source in each slot."""
    blocks: Int[Array, " E"]
    """The same indices in blocks, `[blocks, K, BLOCK]`; empty without native loops."""

    @property
    def in_blocks(self) -> bool:
        """Whether weights for this table are in blocks."""
        return self.blocks.size > 0

    def stored(self, weights: Float[Array, "K N"]) -> Float[Array, " E"]:
        """Weights by slot in the order in which they are stored: in blocks, or by slot."""
        slots, n = weights.shape
        if not self.in_blocks:
            return weights.reshape(-1)
        full = (block_count(n) - 1) * BLOCK
        columns = jnp.concatenate([weights[:, :full], weights[:, n - BLOCK :]], axis=1)
        return columns.reshape(slots, -1, BLOCK).swapaxes(0, 1).reshape(-1)

    def by_slot(self, weights: Float[Array, " E"]) -> Float[Array, "K N"]:
        """Stored weights by slot."""
        slots, n = self.indices.shape
        if not self.in_blocks:
            return weights.reshape(slots, n)
        columns = weights.reshape(-1, slots, BLOCK).swapaxes(0, 1).reshape(slots, -1)
        full = (block_count(n) - 1) * BLOCK
        return jnp.concatenate([columns[:, :full], columns[:, columns.shape[1] - (n - full) :]], axis=1)


def block_count(n: int) -> int:
    """Number of blocks of n targets."""
    return -(-n // BLOCK)
