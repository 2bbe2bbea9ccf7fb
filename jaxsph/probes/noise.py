"""Probe of the particles' noise: velocity of each particle minus the velocity of the flow around it."""

from __future__ import annotations

import jax.numpy as jnp

from jaxsph.core.arrays import Array, Bool, Components, Scalar, columns, dot
from jaxsph.core.pairs import (
    Fields,
    Pair,
    outer_upper,
    symmetric_inverse,
    symmetric_product,
    uncorrected,
)
from jaxsph.core.slabs import Sources
from jaxsph.model.interfaces import Model
from jaxsph.model.meaning import Reading
from jaxsph.model.probe import AbstractProbe
from jaxsph.model.state import State, Tables

__all__ = ["NoiseProbe"]

REACH = 3.0
"""Distance, in spacings, within which neighbours are used in a fit."""


WIDTH = 1.5
"""Distance, in spacings, at which a neighbour's weight has fallen to 1/e."""

ENOUGH = 4096
"""Number of particles whose noise is measured in a sample, if there are at least twice as many.

The particles differ from search to search. In the built-in OWC the noise of a sample differs by 13 % from
that of all particles, and the mean over 3 s by 0.2 %.
"""


class NoiseProbe(AbstractProbe):
    """Probe of the particles' noise: RMS of their velocities minus the velocity of the flow around them, m/s.

    The flow around a particle is a linear function of position, fitted by least squares to the velocities
    of the particle and its neighbours within 3 dx, with weights exp(-(r/(1.5 dx))^2). The neighbours come
    from the scheme's tables. A kernel with a support below 3 dx therefore limits the fit to this support.
    With at least twice `ENOUGH` particles the noise is that of every second, third, ... particle.

    Water that has left the tank over a rim is not included. A particle with too few neighbours, or with all
    neighbours on a line (in three dimensions on a plane), has no fit and is left out of the noise. A
    particle has no fit if the determinant of its neighbours' covariance, in units of dx^2, is at most
    `pairs.LEAST_DETERMINANT`. The determinant is about 1 well inside the water; in a corner of the water it
    is 0.2 in two dimensions and 0.08 in three.
    """

    def measure(self, model, state, tables):
        """See `AbstractProbe.measure`."""
        p = state.particles
        away, counted = deviation(model, state, tables)
        return {"noise": _rms(away, counted), "rms_speed": _rms(columns(p.u), p.m > 0.0)}

    def describe(self):
        """See `AbstractProbe.describe`."""
        fit = "a linear fit over their neighbours"
        return {
            "noise": Reading("m s-1", f"noise: RMS of the particles' velocities about {fit}"),
            "rms_speed": Reading("m s-1", "RMS of the particles' speeds"),
        }


def deviation(model: Model, state: State, tables: Tables) -> tuple[Components, Bool[Array, " R"]]:
    """Velocities of particles minus the fits to their neighbours, m/s, and mask of the particles that count.

    The R particles are evenly spread over the water: every particle, or every second, third, ... in the order
    of the cells. Particles without mass or without a fit do not count.
    """
    p, dx, smoothing = state.particles, model.dx, model.scheme.smoothing
    reach2 = jnp.minimum(REACH * dx, smoothing.radius) ** 2
    water = {"x": columns(p.x), "u": columns(p.u), "counts": (p.m > 0.0).astype(p.m.dtype)}

    def moments(pair: Pair, i: Fields, j: Fields):
        w = jnp.where(pair.r2 < reach2, j["counts"] * jnp.exp(-pair.r2 / (WIDTH * dx) ** 2), 0.0)
        there = tuple(-r / dx for r in pair.r)
        first = tuple(w * a for a in there)
        # use relative velocities, because rounding would hide the noise of particles in a fast flow
        faster = tuple(b - a for a, b in zip(i["u"], j["u"], strict=True))
        carried = tuple((w * f, tuple(a * f for a in first)) for f in faster)
        return w, first, outer_upper(first, there), carried

    sources = Sources(water, {})
    rows = jnp.arange(0, len(p.m), max(len(p.m) // ENOUGH, 1), dtype=jnp.int32)
    own = tables.fluid.slabs.take(water, rows)
    weight, first, second, carried = tables.fluid.sum_at(rows, moments, smoothing, own, sources)
    weight = weight + 1.0  # the particle itself, which contributes nothing to the other moments
    centre = tuple(a / weight for a in first)
    spread = tuple(a / weight - b for a, b in zip(second, outer_upper(centre, centre), strict=True))
    inverse = symmetric_inverse(spread)

    def away(zeroth, along):
        mean = zeroth / weight
        slope = symmetric_product(
            inverse, tuple(a / weight - c * mean for a, c in zip(along, centre, strict=True))
        )
        return dot(centre, slope) - mean

    return tuple(away(*found) for found in carried), ~uncorrected(spread) & (own["counts"] > 0.0)


def _rms(vector: Components, counted: Bool[Array, " N"]) -> Scalar:
    """RMS of a vector field over the `counted` particles, in the field's unit; 0 for no particles."""
    size2 = dot(vector, vector)
    square = jnp.sum(jnp.where(counted, size2, 0.0)) / jnp.maximum(jnp.sum(counted), 1).astype(size2.dtype)
    moves = square > 0.0  # the root has no derivative at zero; at rest derivatives must be finite
    return jnp.where(moves, jnp.sqrt(jnp.where(moves, square, 1.0)), 0.0)
