"""Switch of native forms, and native forms of the loops of a neighbour search and of tables in blocks.

Native forms need a CPU and the package llvmlite (`jaxsph[native]`). On other devices, without llvmlite, and
for pair laws with operations that cannot be translated, JAX's forms are used. The neighbours are the same;
the sums agree up to rounding, because the order of summation and the fusing of products and sums differ.
"""

from __future__ import annotations

import contextlib
import importlib.util
import sys
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxsph.core.arrays import Array
from jaxsph.core.blocks import BLOCK, BlockedTable, block_count

SHARE = 0.35
"""Ratio of the wall time of a step with native forms to that with JAX's forms (-); 0.27 to 0.45 in
`python -m experiments run bench_native`."""

_switch = {"on": importlib.util.find_spec("llvmlite") is not None}


def available() -> bool:
    """Whether native forms are used."""
    return installed() and jax.default_backend() == "cpu"


def installed() -> bool:
    """Whether native forms are used on a CPU; JAX need not have been used before."""
    return _switch["on"]


def advice() -> str:
    """Note for a run on a CPU on which llvmlite is not installed; empty otherwise."""
    if importlib.util.find_spec("llvmlite") or jax.default_backend() != "cpu":
        return ""
    return "a time step takes 0.25 to 0.45 times as long with native loops: pip install 'jaxsph[native]'"


def int32(a: Array) -> Array:
    """Integers in the type that native code reads; in float64 programs they may have 64 bits."""
    return a.astype(jnp.int32)


@contextlib.contextmanager
def switched(on: bool) -> Iterator[None]:
    """Context in which functions are traced with or without native forms."""
    before = _switch["on"]
    try:
        _switch["on"] = on
        yield
    finally:
        _switch["on"] = before


def used() -> list[str]:
    """Names of the native functions of this process, which a stored program may call."""
    functions = sys.modules.get("jaxsph.core.native.functions")
    return functions.registered() if functions else []


def restored(names: Sequence[str]) -> bool:
    """Whether the native functions that a stored program calls are available; loads them from their files."""
    if not names:
        return True
    if not available():
        return False
    from jaxsph.core.native.functions import load

    return load(names)


def native_order(cells: Array, count: int) -> tuple[Array, Array] | None:
    """Order of points by the numbers `[M]` of their cells, and the position at which each cell begins.

    `count`: number of cells; the second array has the length `count` + 1. Points of one cell keep their
    order. **Returns** None if there is no native form.
    """
    if not available():
        return None
    from jaxsph.core.native.functions import register
    from jaxsph.core.native.searches import CellOrder

    order, starts = (jax.ShapeDtypeStruct((n,), jnp.int32) for n in (len(cells), count + 1))
    name = register(CellOrder().module)
    called = jax.ffi.ffi_call(name, (order, starts, starts), vmap_method="sequential")
    found = called(int32(cells))
    return found[0], found[1]


def true_indices(mask: Array, size: int) -> Array:
    """Indices `[size]` of the true elements of a mask `[N]`, in order; the other entries are N.

    True elements beyond the first `size` are left out.
    """
    count = len(mask)
    if found := native_order(~mask, 2):
        order, starts = found
        order = jnp.pad(order, (0, max(size - count, 0)))[:size]
        return jnp.where(jnp.arange(size) < starts[1], order, count)
    return jnp.nonzero(mask, size=size, fill_value=count)[0].astype(jnp.int32)


class Candidates(NamedTuple):
    """Targets of a search, their cells, and the sources by cell."""

    x: Sequence[Array]
    """Coordinates of the targets, an array `[N]` per axis, m."""
    sees: Array
    """Bit masks of the kinds of sources that each target sees, `[N]`."""
    own: Array
    """Index of the source that each target must not find, `[N]`; -1 for none."""
    lane: Array
    """Number of the first cell of each target's lane, `[N]`; the cells are numbered from lane to lane."""
    home: Array
    """Index of each target's cell along every axis, `[N, D]`."""
    sources: Sequence[Array]
    """Coordinates of the sources by cell, an array `[M]` per axis, m."""
    kinds: Array
    """Bit masks of the sources' kinds, `[M]`."""
    indices: Array
    """Indices of the sources, `[M]`."""
    start: Array
    """Position of the first source of each cell, and M at the end, `[C + 1]`."""
    radius2: Array
    """Square of the search radius, m2."""


def native_neighbours(
    among: Candidates,
    shape: tuple[int, ...],
    width: int,
    period: tuple[tuple[int, float], ...],
    capacity: int,
) -> tuple[Array, Array] | None:
    """Indices `[capacity, N]` of the targets' neighbours, and their number `[N]`.

    The number may exceed `capacity`. Unused entries contain the number of sources.
    **Arguments**: `shape`: number of cells along every axis; `width`: number of cells on either side of a
    target's cell that may contain its neighbours; `period`: periodic axes and their lengths (m). **Returns**
    None if there is no native form.
    """
    if not available() or not among.x[0].size:
        return None
    from jaxsph.core.native.functions import register
    from jaxsph.core.native.searches import CandidateLoop

    count = len(among.x[0])
    loop = CandidateLoop(np.dtype(among.x[0].dtype), shape, width, period)
    results = [jax.ShapeDtypeStruct(a, jnp.int32) for a in ((capacity, count), (count,))]
    called = jax.ffi.ffi_call(register(loop.module), results, vmap_method="sequential")
    sees, own, lane, kinds, indices, start, *home = map(
        int32, (among.sees, among.own, among.lane, among.kinds, among.indices, among.start, *among.home.T)
    )
    # the last vector of a cell may extend beyond the last source
    of_sources = (jnp.pad(a, (0, loop.lanes)) for a in (*among.sources, kinds, indices))
    found = called(among.radius2, *among.x, sees, own, lane, *home, *of_sources, start)
    return found[0], found[1]


def blocked(table: Array) -> BlockedTable:
    """Neighbour table `[K, N]` with its blocks, if there are native loops."""
    slots, n = table.shape
    if not available() or n < BLOCK:
        return BlockedTable(table, jnp.zeros(0, jnp.int32))
    from jaxsph.core.native.functions import register
    from jaxsph.core.native.sums import BlockLoop

    result = jax.ShapeDtypeStruct((block_count(n) * BLOCK * slots,), jnp.int32)
    call = jax.ffi.ffi_call(register(BlockLoop().module), result, vmap_method="sequential")
    return BlockedTable(table, call(int32(table)))
