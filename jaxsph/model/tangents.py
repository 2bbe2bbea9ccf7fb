"""Filter of tangents, which averages derivatives over neighbours and leaves all values unchanged.

The motion of particles is chaotic. After a fraction of a second, an exact derivative through the time loop
describes the paths of individual particles and no longer the flow. A derivative that is averaged over
neighbours at regular intervals still describes the flow, but the averages remove a part of the flow's
response (`python -m experiments run filter_study`).
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxsph.core.arrays import Components, columns, dot, stack
from jaxsph.core.pairs import (
    Fields,
    Pair,
    Smoothing,
    outer_upper,
    symmetric_inverse,
    symmetric_product,
)
from jaxsph.core.slabs import Neighbours, Sources
from jaxsph.model import laws
from jaxsph.model.interfaces import AbstractTangents, Model
from jaxsph.model.state import State, Tables


class TangentFilter(AbstractTangents):
    """Filter of the tangents of positions and velocities by averages over neighbours.

    Every `interval` steps a tangent f becomes f - (1 - S)^order f, with the average S over neighbours
    (`Average`). S is exact for linear fields, and therefore does not distort tangents at the free surface.
    S treats the components tangential to a wall as even functions across the wall. One average multiplies a
    wave of wavenumber k by exp(-(k h)^2/4).

    The filter must act faster than exact tangents grow. Exact tangents grow because the rows of the square
    lattice slide over each other under pressure. At the bed of still water 0.4 m deep, with dx = 0.02 m,
    exact tangents grow by a factor of e in 0.23 s (`python -m experiments run lattice_growth`). In the OWC
    the default filter, order 1 at every fifth step, removes 10 to 17 % of the water's response to a change of
    the turbine damping (`python -m experiments run filter_study`), and half of it in the weakly compressible
    scheme. In that scheme a filter of order 3 at every step removed only a fifth of the response. But this
    filter did not suppress slow modes of the sliding rows, which grew thirtyfold per period in a tank 4 m
    long. Tangents of the densities need no filter, since they follow the tangents of positions and
    velocities.
    """

    order: int = eqx.field(static=True, default=1)
    """Order of the filter, 1 or more."""
    interval: int = eqx.field(static=True, default=5)
    """Number of steps between two applications of the filter."""

    def __check_init__(self) -> None:
        """**Raises** ValueError if the order or the interval is below 1."""
        if self.order < 1 or self.interval < 1:
            raise ValueError(f"order = {self.order} and interval = {self.interval}: both must be 1 or more")

    def filter(self, model, state, tables):
        """See `AbstractTangents.filter`."""
        p = state.particles

        def filtered(fields):
            average = average_of(*jax.lax.stop_gradient((model, state)), tables)
            return _filtered(self.order, fields, average)

        fields = (columns(p.x), columns(p.u))
        if self.interval > 1:
            due = state.step % self.interval == 0
            x, u = jax.lax.cond(due, filtered, lambda fields: fields, fields)
        else:
            x, u = filtered(fields)
        return eqx.tree_at(lambda s: (s.particles.x, s.particles.u), state, (stack(x), stack(u)))


class Average(NamedTuple):
    """Average over neighbours, a linear map of vector fields.

    A linear function is fitted around every particle with the kernel's weights; the average is the value of
    this function at the particle.
    """

    x: Components
    """Positions of the particles, m."""
    V: jax.Array
    """Volumes of the particles, m3 (m2 in 2-D)."""
    smoothing: Smoothing
    """Kernel of the weights."""
    table: Neighbours
    """Neighbours of every particle; ghosts do not contribute to an average."""
    self_weight: jax.Array
    """Weight of the particle itself (-)."""
    weight: jax.Array
    """Sum of all weights (-)."""
    centre: Components
    """Weighted mean position of the neighbours relative to the particle, divided by h (-)."""
    inverse: tuple[tuple[jax.Array, ...], ...]
    """Inverse of the ratio of the positions' covariance to h^2/2 (-), for every component of the field.

    Gradients across a wall are suppressed for components that are even across the wall.
    """

    def __call__(self, fields: tuple[Components, ...]) -> tuple[Components, ...]:
        """Averages of vector fields over neighbours, in the fields' units."""
        h = self.smoothing.h

        def law(pair: Pair, i: Fields, j: Fields):
            w = laws.volume(j) * pair.W
            there = tuple(-r / h for r in pair.r)
            return jax.tree.map(lambda f: (w * f, tuple(w * f * a for a in there)), j["f"])

        def summed(fields):
            sources = Sources({"x": self.x, "V": self.V, "f": fields}, {})
            return self.table.sum(law, self.smoothing, {"x": self.x}, sources)

        # the sum is linear, and so its own derivative, which reverse mode can transpose
        _, sums = jax.jvp(summed, (jax.tree.map(jnp.zeros_like, fields),), (fields,))

        def fitted(f, inverse, found):
            zeroth, first = found
            mean = (zeroth + self.self_weight * f) / self.weight
            slope = tuple(a / self.weight - c * mean for a, c in zip(first, self.centre, strict=True))
            return mean - 2.0 * dot(self.centre, symmetric_product(inverse, slope))

        return tuple(
            tuple(map(fitted, field, self.inverse, found)) for field, found in zip(fields, sums, strict=True)
        )


def average_of(model: Model, state: State, tables: Tables) -> Average:
    """Average over the neighbours in a state."""
    p, walls = state.particles, model.walls
    smoothing: Smoothing = model.scheme.smoothing
    h, dim = smoothing.h, p.x.shape[1]
    ghosts, _, volume = model.ghosts_at(state.parts, p, tables.images)
    V = model.scheme.volume(p)
    self_weight = V * smoothing.kernel.value(jnp.zeros_like(V), h, dim)
    none = jnp.zeros_like(volume)
    # pushes[k][a]: a ghost's volume if component k is even across its wall and axis a is normal to the wall,
    # otherwise 0
    normal, even = walls.mirror == -1.0, walls.mirror != -1.0
    pushes = tuple(
        tuple(jnp.where(even[:, k] & normal[:, a], volume, 0.0) for a in range(dim)) for k in range(dim)
    )
    nowhere = jax.tree.map(lambda _: jnp.zeros_like(V), pushes)
    sources = Sources(
        {"x": columns(p.x), "w": V, "push": nowhere}, {"x": columns(ghosts), "w": none, "push": pushes}
    )

    def moments(pair: Pair, i: Fields, j: Fields):
        w = j["w"] * pair.W
        there = tuple(-r / h for r in pair.r)
        first = tuple(w * a for a in there)
        return w, first, outer_upper(first, there), jax.tree.map(lambda a: a * pair.W, j["push"])

    x = columns(p.x)
    weight, first, second, push = tables.fluid.sum(moments, smoothing, {"x": x}, sources)
    weight = weight + self_weight
    centre = tuple(a / weight for a in first)
    spread = tuple(a / weight - b for a, b in zip(second, outer_upper(centre, centre), strict=True))
    inverse = tuple(symmetric_inverse(_held(spread, push[k], dim)) for k in range(dim))
    return Average(x, V, smoothing, tables.fluid, self_weight, weight, centre, inverse)


HOLD = 40.0
"""Ratio of the stiffness that suppresses a gradient to the covariance, with a support full of ghosts (-); any
large number is suitable."""


def _held(spread: tuple[jax.Array, ...], push: Components, dim: int) -> tuple[jax.Array, ...]:
    """Upper triangle of twice the covariance `spread`, plus a stiffness on the diagonal, proportional to
    `push`, that suppresses gradients (-)."""
    found, count = [], 0
    for row in range(dim):
        for column in range(row, dim):
            stiff = HOLD * push[row] if row == column else 0.0
            found.append(2.0 * spread[count] + stiff)
            count += 1
    return tuple(found)


@functools.partial(jax.custom_jvp, nondiff_argnums=(0,))
def _filtered(order: int, fields: tuple[Components, ...], average: Average) -> tuple[Components, ...]:
    """The fields, unchanged; their tangents f become f - (1 - S)^order f with the average S."""
    del order, average
    return fields


@_filtered.defjvp
def _(order, primals, tangents):
    fields, average = primals
    rest = tangents[0]
    for _ in range(order):
        rest = jax.tree.map(jnp.subtract, rest, average(rest))
    return fields, jax.tree.map(jnp.subtract, tangents[0], rest)
