"""Sums over pairs of particles, and the small matrices that correct their gradients.

A neighbour table is slot-major, `[K, N]`: slot k of target i contains the index of a source. An empty slot
contains the index of the empty source, which is the last source, has no volume and is far away. A loop over
the K slots evaluates N pairs per slot, and gathers every field component separately. On a CPU this loop is
several times faster than operations on arrays `[N, K, D]`, because no array of that size is stored. The
number of slots per iteration of the loop depends on the backend (`SlotLoop`).
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.extend import core as jex

from jaxsph.core.arrays import Array, Components, Float, Int, Scalar, dot
from jaxsph.core.blocks import BlockedTable
from jaxsph.core.kernels import AbstractKernel
from jaxsph.core.native.pair_sums import Outcome, native_sums, native_weighted_sum
from jaxsph.core.transforms import any_lane, gather, gather_linearly, keep

Fields = Any
"""Mapping from names to arrays `[N]` or tuples of arrays `[N]`; the positions "x" are always included."""


SPARE = 1.15
"""Ratio of a table's number of slots to the largest number of neighbours when the table is allocated (-)."""


FAR = 1.0e3
"""Coordinate of the empty source, m. This position is outside every support, and its square fits into
float32."""


Period = tuple[tuple[int, float], ...]
"""Pairs (periodic axis of the domain, length of the period in m); empty if no axis is periodic."""


class SlotLoop(NamedTuple):
    """Form of the loop over a table's slots."""

    at_once: int
    """Number of slots per iteration of the loop."""
    skips_empty: bool
    """Whether a slot that is empty for all targets is skipped."""

    def over(self, add: Callable, start: Any, rows: Any) -> tuple[Any, Any]:
        """Final total and stacked outputs of a scan that calls `add(total, row)` for each row; `start`: total
        before the first row."""
        return jax.lax.scan(add, start, rows, unroll=self.at_once)


ONE_BY_ONE = SlotLoop(1, True)
"""Loop for a CPU, on which blocks of slots are three to seven times slower, since their sums are stored in
memory."""
IN_BLOCKS = SlotLoop(16, False)
"""Loop for an accelerator, on which every operation is a kernel launch and a branch waits for the host."""


def slot_loop() -> SlotLoop:
    """Loop over slots that suits the default backend."""
    return ONE_BY_ONE if jax.default_backend() == "cpu" else IN_BLOCKS


class Smoothing(eqx.Module):
    """Kernel, smoothing length and periodic axes of a pair sum."""

    kernel: AbstractKernel
    h: Scalar
    """Smoothing length, m."""
    period: Period = eqx.field(static=True, default=())
    """Periodic axes, along which distances are measured to the nearest image."""

    @property
    def radius(self) -> Scalar:
        """Support radius of the kernel, m."""
        return self.kernel.reach * self.h

    def gravity_rate(self, g: Float[Array, " D"]) -> Scalar:
        """Rate sqrt(g/h), 1/s, from the gravity g (m/s2) and the smoothing length h."""
        # the guard keeps the derivative finite without gravity
        return (jnp.sum(g**2) + 1e-30) ** 0.25 / jnp.sqrt(self.h)


def nearest_image(r: Components, period: Period) -> Components:
    """Separation x_i - x_j (m) to the nearest image of j, for positions at most one period apart.

    Separations of less than half a period are not changed. The change is one period at most, so that the
    empty source stays far away.
    """
    found = list(r)
    for axis, size in period:
        a, length = r[axis], jnp.asarray(size, r[axis].dtype)
        found[axis] = a - jnp.where(a > 0.5 * length, length, 0.0) + jnp.where(a < -0.5 * length, length, 0.0)
    return tuple(found)


class Pair(NamedTuple):
    """Geometry of a pair of particles i and j, the first argument of a pair law."""

    r: Components
    """Separation x_i - x_j, m."""
    r2: jax.Array
    """Square of the distance, m2."""
    F: jax.Array
    """Slope factor (dW/dr)/r of the kernel, m^-(D+2), zero outside the support: grad_i W_ij = F r."""
    W: jax.Array
    """Kernel, m^-D, zero outside the support."""


Law = Callable[[Pair, Fields, Fields], Any]
"""Pair law: the term of one pair in a sum, from its geometry and the fields of i and of j."""


def pair_sum(
    law: Law, smoothing: Smoothing, targets: Fields, sources: Fields, table: Int[Array, "K N"]
) -> Any:
    """Sum of `law(pair, i, j)` over the sources j listed for every target i.

    **Arguments**: `law` is written for one pair with scalar components; `targets` and `sources` map names to
    `[N]` and `[M]` arrays (vectors: tuples of components); the last source is the empty one, and so is every
    source that a larger index refers to. **Returns** the law's pytree with `[N]` leaves.
    """
    scalar, groups = _scalar_law(law, smoothing, targets, sources)
    empty = sources["x"][0].shape[0] - 1
    # Reverse mode recomputes the terms, since storing the intermediate values needs 14 times the memory.
    terms = jax.checkpoint(lambda slot, *groups: _at_slot(scalar, jnp.minimum(slot, empty), *groups))
    shapes = jax.eval_shape(terms, table[0], *groups)

    def zero():
        return [jnp.zeros(a.shape, a.dtype) for a in shapes]

    def add(total, slot, *groups):
        return jax.tree.map(jnp.add, total, terms(slot, *groups))

    loop = slot_loop()

    def added(add, total, rows, *groups):
        return loop.over(lambda total, slot: (add(total, slot, *groups), None), total, rows)[0]

    def where_filled(add, total, rows, *groups):
        if not loop.skips_empty:
            return add(total, rows, *groups)
        # The last rows of a table are spare, and empty in most blocks.
        filled = any_lane(jnp.any(rows < empty))
        return jax.lax.cond(filled, add, lambda total, *_: total, total, rows, *groups)

    def by_jax(table, *groups):
        return added(functools.partial(where_filled, add), zero(), table, *groups)

    # All spare rows share one branch outside the loop. Reverse mode stores all inputs of a branch, and with a
    # branch inside the loop it would store the sources once for every row.
    def derived(table, *groups):
        own = int(len(table) / SPARE)
        add_rows = functools.partial(added, add)
        return where_filled(add_rows, add_rows(zero(), table[:own], *groups), table[own:], *groups)

    found = native_sums(scalar.law, groups, table, Outcome(len(shapes)), derived)
    found = found or _with_derivative(by_jax, derived)(table, *groups)
    return keep(jax.tree.unflatten(scalar.results, found))


def pair_weights(
    law: Law, smoothing: Smoothing, targets: Fields, sources: Fields, table: BlockedTable
) -> tuple[Any, Any]:
    """Sum over neighbours of the law's first result, and the law's second result for every slot, a pytree of
    arrays that `weighted_sum` uses.

    The second results are the weights of a sum that is evaluated many times. The arguments are those of
    `pair_sum`; the law returns a pair (term, weight).
    """
    scalar, groups = _scalar_law(law, smoothing, targets, sources)
    results = jax.tree.unflatten(scalar.results, range(scalar.results.num_leaves))
    outcome = Outcome(*(len(jax.tree.leaves(part)) for part in results))
    count = outcome.sums

    def by_jax(indices, *groups):
        def add(total, slot):
            found = _at_slot(scalar, slot, *groups)
            return jax.tree.map(jnp.add, total, found[:count]), found[count:]

        shapes = jax.eval_shape(lambda slot: _at_slot(scalar, slot, *groups)[:count], indices[0])
        start = [jnp.zeros(a.shape, a.dtype) for a in shapes]
        total, weights = slot_loop().over(add, start, indices)
        return total + [table.stored(a) for a in weights]

    found = native_sums(scalar.law, groups, table.indices, outcome, by_jax) if table.in_blocks else []
    return jax.tree.unflatten(scalar.results, found or by_jax(table.indices, *groups))


def weighted_sum(
    weights: Float[Array, " E"], f: Float[Array, " M"], table: BlockedTable
) -> Float[Array, " N"]:
    """Weighted sum over neighbours, sum_k weights[k] f[table[k]], linear in f; its unit is the product of the
    units of `weights` and f.

    The last of the M values of f belongs to the empty source. This value may be any number, because its
    weights are zero.
    """

    def by_jax(weights, f, table):
        def add(total, row):
            weight, slot = row
            return total + weight * gather_linearly(f, slot), None

        start = jnp.zeros(table.indices.shape[1], f.dtype)
        return slot_loop().over(add, start, (table.by_slot(weights), table.indices))[0]

    found = native_weighted_sum(weights, f, table, by_jax)
    return found[0] if found else by_jax(weights, f, table)


class ScalarLaw(NamedTuple):
    """Pair law as a function of the scalars of one pair."""

    law: Callable[[list[Any], list[Any], list[Any]], list[Any]]
    """Results as a list, from the fields of the target, those of the source, and the constants."""
    results: Any
    """Structure of the results as a pytree."""


def _scalar_law(law, smoothing, targets, sources):
    """Law as a function of scalars, and lists of the arrays of its targets, its sources and its constants."""
    leaves, fields = jax.tree.flatten((targets, sources))
    count = len(jax.tree.leaves(targets))
    results = None

    def one(*leaves):
        nonlocal results
        found, results = jax.tree.flatten(_term(law, smoothing, *jax.tree.unflatten(fields, leaves)))
        return found

    closed = jax.make_jaxpr(one)(*(jax.ShapeDtypeStruct((), a.dtype) for a in leaves))

    def of_groups(targets, sources, constants):
        return jex.jaxpr_as_fun(jex.ClosedJaxpr(closed.jaxpr, constants))(*targets, *sources)

    groups = leaves[:count], leaves[count:], list(map(jnp.asarray, closed.consts))
    return ScalarLaw(of_groups, results), groups


def _at_slot(law, slot, targets, sources, constants):
    """Law's results for every target and its source in one slot, from the arrays of the law's arguments."""
    here = [gather(a, slot) for a in sources]
    return jax.vmap(law.law, in_axes=(0, 0, None))(targets, here, constants)


def _term(law, smoothing, i, j):
    """Law's result for pairs with these fields of the target i and the source j."""
    kernel, h = smoothing.kernel, smoothing.h
    r = nearest_image(tuple(a - b for a, b in zip(i["x"], j["x"], strict=True)), smoothing.period)
    r2 = dot(r, r)
    inside = r2 < smoothing.radius**2
    slope, value = _kernel_at(kernel, r2, h, len(r))
    return law(Pair(r, r2, jnp.where(inside, slope, 0.0), jnp.where(inside, value, 0.0)), i, j)


def _with_derivative(function: Callable, derived: Callable) -> Callable:
    """The function, whose derivative is that of `derived`."""
    found = jax.custom_jvp(function)

    @found.defjvp
    def _(primals, tangents):
        return jax.jvp(derived, primals, tangents)

    return found


@functools.partial(jax.jit, static_argnums=3)
def _kernel_at(kernel, r2, h, dim):
    """Slope factor and value of a kernel. A single trace for all sums shortens the start of a run by a tenth.

    The compiler removes the value if the law does not use it.
    """
    return kernel.slope(r2, h, dim), kernel.value(r2, h, dim)


def with_empty(fields: Fields) -> Fields:
    """Fields with the empty source appended: position `FAR` (m), volume and every other field zero."""

    def append(value, a):
        return jnp.concatenate([a, jnp.full((1,), value, a.dtype)])

    return {
        name: jax.tree.map(lambda a, v=(FAR if name == "x" else 0.0): append(v, a), field)
        for name, field in fields.items()
    }


LEAST_DETERMINANT = 0.05
"""Determinant at or below which a correction matrix M = sum_j V_j (x_j - x_i) (grad W_ij) is not used.

If neighbours fill a wedge of angle a, M has the eigenvalues (a +- sin a)/(2 pi), and in three dimensions also
a/(2 pi). The determinant is 1 in the water. In two dimensions it is 1/4 at a flat surface and 0.037 in a
corner of 90 degrees. The threshold corresponds to a wedge of 98 degrees, where the correction amplifies
errors of the gradient 8.6 times (the inverse of the smallest eigenvalue). In three dimensions the determinant
is 1/8 at a flat surface and 0.009 in a corner, and the threshold corresponds to a wedge of 137 degrees and an
amplification of 3.7 times. Flat surfaces are thus always corrected.
"""


def symmetric_inverse(M: tuple[jax.Array, ...]) -> tuple[jax.Array, ...]:
    """Inverses of symmetric 2x2 (xx, xy, yy) or 3x3 (xx, xy, xz, yy, yz, zz) matrices, in the same order.

    A matrix is close to singular (`uncorrected`) if a particle has few neighbours, all on one side. Then the
    identity is returned, which leaves the gradient uncorrected.
    """
    determinant, cofactors = _determinant(M)
    sound = determinant > LEAST_DETERMINANT
    inverse = 1.0 / jnp.where(sound, determinant, 1.0)
    identity = (1.0, 0.0, 1.0) if len(M) == 3 else (1.0, 0.0, 0.0, 1.0, 0.0, 1.0)
    return tuple(jnp.where(sound, c * inverse, e) for c, e in zip(cofactors, identity, strict=True))


def uncorrected(M: tuple[jax.Array, ...]) -> jax.Array:
    """True where a matrix is so close to singular that `symmetric_inverse` returns the identity."""
    return ~(_determinant(M)[0] > LEAST_DETERMINANT)


def _determinant(M: tuple[jax.Array, ...]) -> tuple[jax.Array, tuple[jax.Array, ...]]:
    """Determinant and cofactors of symmetric matrices."""
    if len(M) == 3:
        xx, xy, yy = M
        return xx * yy - xy * xy, (yy, -xy, xx)
    xx, xy, xz, yy, yz, zz = M
    cofactors = (
        yy * zz - yz * yz,
        xz * yz - xy * zz,
        xy * yz - xz * yy,
        xx * zz - xz * xz,
        xy * xz - xx * yz,
        xx * yy - xy * xy,
    )
    return xx * cofactors[0] + xy * cofactors[1] + xz * cofactors[2], cofactors


def symmetric_product(M: tuple[jax.Array, ...], v: Components) -> Components:
    """Product M v of symmetric matrices, stored as their upper triangles row by row, and vectors."""
    dim = len(v)
    index = {}
    count = 0
    for row in range(dim):
        for column in range(row, dim):
            index[row, column] = index[column, row] = count
            count += 1
    return tuple(dot(tuple(M[index[row, k]] for k in range(dim)), v) for row in range(dim))


def outer_upper(a: Components, b: Components) -> tuple[jax.Array, ...]:
    """Upper triangle, row by row, of the outer product of a and b, which must be symmetric."""
    return tuple(a[row] * b[column] for row in range(len(a)) for column in range(row, len(a)))


def trace_upper(M: tuple[jax.Array, ...], dim: int) -> jax.Array:
    """Trace of symmetric matrices stored as their upper triangles; `dim`: 2 or 3."""
    return M[0] + M[2] if dim == 2 else M[0] + M[3] + M[5]
