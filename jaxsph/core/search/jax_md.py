"""Neighbour search by jax-md (Schoenholz & Cubuk 2020), selected by `search = "jax_md"`; requires
the extra `jaxsph[jax-md]`.

jax-md lists the neighbours of every particle within one set of particles. jax-md has no masks, and wraps
coordinates around at the sides of a box. Here targets and sources are therefore searched as one set, in a box
wider than the region of the particles. Sources with which a target must not interact are then removed from
the target's list. The slots are in the order of the sources' indices.
"""

from __future__ import annotations

from types import ModuleType

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxsph.core.arrays import Array, Float, Int
from jaxsph.core.search.base import AbstractSearch, Grid, Table

CROWDING = 1.25
"""Ratio of a cell's capacity to the number of particles in the fullest cell of the initial state (-)."""


LISTED = 3
"""Ratio of the capacity of jax-md's lists to the table's number of slots (-). The lists are longer because
they include masked sources."""


class JaxMD(AbstractSearch):
    """Neighbour search by `jax_md.partition.neighbor_list`, in its dense format."""

    origin: tuple[float, ...] = eqx.field(static=True)
    """Low corner of the box, m."""
    box: tuple[float, ...] = eqx.field(static=True)
    """Sides of the box, m. Each side is longer than four search radii: if a side were shorter than three
    search radii, jax-md would test all pairs."""
    radius: float = eqx.field(static=True)
    """Search radius (support plus skin), m."""
    cell_capacity: tuple[int, int] = eqx.field(static=True)
    """Capacities of a cell, in particles, for searches around the water and for searches around other
    points."""

    @classmethod
    def of(cls, grid: Grid, water: np.ndarray, nodes: np.ndarray) -> JaxMD:
        """See `AbstractSearch.of`. **Raises** ValueError if the grid has periodic axes."""
        if grid.period:
            raise ValueError(
                f'search = "jax_md" does not support periodic axes, and the grid has period = {grid.period}: '
                "use the default search"
            )
        md = partition()
        # This margin keeps all coordinates positive, and particles away from their periodic images.
        margin = 2.0 * grid.radius
        low = np.asarray(grid.origin) - margin
        box = np.asarray(grid.shape) * grid.cell + 2.0 * margin

        def room(x: np.ndarray) -> int:
            shifted = jnp.asarray(np.asarray(x, float) - low, jnp.float32)
            count = md.count_cell_filling(shifted, box.reshape(1, -1), grid.radius)
            return int(np.ceil(CROWDING * int(np.max(count))))

        sides = tuple(float(a) for a in box)
        return cls(tuple(float(a) for a in low), sides, grid.radius, (room(water), room(nodes)))

    def table(self, targets, sources, capacity, sees, kind, same):
        """See `AbstractSearch.table`."""
        targets, sources = jax.lax.stop_gradient((targets, sources))
        n, m = len(targets), len(sources)
        everything = sources if same else jnp.concatenate([targets, sources])
        found, lost = self._lists(everything, self.cell_capacity[0 if same else 1], LISTED * capacity)
        source = found[:n] if same else found[:n] - n
        # indices beyond the last source are jax-md's empty slots
        real = (source >= 0) & (source < m)
        seen = (sees[:, None] & kind[jnp.clip(source, 0, m - 1)]) != 0
        keep = real & seen
        count = jnp.sum(keep, axis=1, dtype=jnp.int32)
        slot = jnp.where(keep, jnp.cumsum(keep, axis=1, dtype=jnp.int32) - 1, capacity)
        rows = jnp.full((n, capacity + 1), m, jnp.int32)
        # the slot after the table receives the excess
        rows = rows.at[jnp.arange(n)[:, None], jnp.minimum(slot, capacity)].set(source)[:, :capacity]
        most = jnp.max(count, initial=0)
        return Table(jnp.sort(rows, axis=1).T, jnp.where(lost, jnp.maximum(most, capacity + 1), most))

    def grown(self):
        """See `AbstractSearch.grown`; the cells have larger capacities."""
        water, nodes = (int(1.25 * count) + 1 for count in self.cell_capacity)
        return JaxMD(self.origin, self.box, self.radius, (water, nodes))

    def _lists(self, x: Float[Array, "N D"], room: int, most: int) -> tuple[Int[Array, "N L"], Array]:
        """jax-md's lists of one set of particles, and whether a list or a cell has overflowed."""
        md = partition()
        from jax_md import space

        box, n = np.asarray(self.box), len(x)
        displacement, _ = space.free()
        functions = md.neighbor_list(displacement, box, self.radius)
        # `allocate` would find these sizes from the positions, but cannot be called in a compiled function.
        width = min(most, 3 ** x.shape[1] * room)
        lists = md.NeighborList(
            idx=jnp.full((n, width), n, jnp.int32),
            reference_position=x,
            error=md.PartitionError(jnp.zeros((), jnp.uint8)),
            cell_list_capacity=room,
            max_occupancy=width,
            format=md.NeighborListFormat.Dense,
            cell_size=self.radius,
            cell_list_fn=md.cell_list(box, self.radius),
            update_fn=functions.update,
        ).update(x - jnp.asarray(self.origin, x.dtype))
        return lists.idx.astype(jnp.int32), lists.did_buffer_overflow != 0


def partition() -> ModuleType:
    """Module `jax_md.partition`. **Raises** ImportError, which names the extra to install, without jax-md."""
    try:
        from jax_md import partition
    except ImportError as error:
        raise ImportError(
            'search = "jax_md" needs jax-md, which is not installed: run pip install "jaxsph[jax-md]", or '
            "use the default search, which needs no extra package"
        ) from error
    return partition
