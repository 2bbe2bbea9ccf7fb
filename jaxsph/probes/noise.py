"""Probe of the particles' own noise: what a velocity differs by from the flow of its neighbours."""

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
"""Distance over the spacing within which neighbours take part in a fit (-)."""


WIDTH = 1.5
"""Distance over the spacing at which a neighbour's weight has fallen to 1/e (-)."""


class NoiseProbe(AbstractProbe):
    """Probe of the noise of the particles: RMS of their velocities less the flow around them, m/s.

    The flow around a particle is a linear function of position, fitted by least squares to the velocities of
    its neighbours within 3 dx and its own, with weights exp(-(r/(1.5 dx))^2). Neighbours are those of the
    scheme's tables: where the kernel's support is less than 3 dx, that is as far as the fit goes.

    Only water counts, without what has left over a rim. A particle whose neighbours are too few, or on a line
    (in three dimensions on a plane), has no fit and takes no part in the noise; it does so at once, where
    the determinant of the neighbours' covariance over dx^2, about 1 in the water and 0.2 or 0.1 in a corner,
    is `pairs.LEAST_DETERMINANT` or less.
    """

    def measure(self, model, state, tables):
        """See `AbstractProbe`."""
        p = state.particles
        water = p.m > 0.0
        away, fitted = deviation(model, state, tables)
        u = columns(p.u)
        return {"noise": _rms(away, water & fitted), "rms_speed": _rms(u, water)}

    def describe(self):
        """See `AbstractProbe`."""
        fit = "a linear fit over their neighbours"
        return {
            "noise": Reading("m s-1", f"noise: RMS of the particles' velocities less {fit}"),
            "rms_speed": Reading("m s-1", "RMS of the particles' speeds"),
        }


def deviation(model: Model, state: State, tables: Tables) -> tuple[Components, Bool[Array, " N"]]:
    """Velocity of every particle less the fit to its neighbours', m/s, and where there is such a fit."""
    p, dx, smoothing = state.particles, model.dx, model.scheme.smoothing
    reach2 = jnp.minimum(REACH * dx, smoothing.radius) ** 2
    water = {"x": columns(p.x), "u": columns(p.u), "counts": (p.m > 0.0).astype(p.m.dtype)}

    def moments(pair: Pair, i: Fields, j: Fields):
        w = jnp.where(pair.r2 < reach2, j["counts"] * jnp.exp(-pair.r2 / (WIDTH * dx) ** 2), 0.0)
        there = tuple(-r / dx for r in pair.r)
        first = tuple(w * a for a in there)
        # differences to the particle's own velocity: the fit of a fast flow would lose its noise to rounding
        faster = tuple(b - a for a, b in zip(i["u"], j["u"], strict=True))
        carried = tuple((w * f, tuple(a * f for a in first)) for f in faster)
        return w, first, outer_upper(first, there), carried

    sources = Sources(water, {})
    weight, first, second, carried = tables.fluid.of_water().sum(moments, smoothing, water, sources)
    weight = weight + 1.0  # the particle's own, which adds nothing to the other moments
    centre = tuple(a / weight for a in first)
    spread = tuple(a / weight - b for a, b in zip(second, outer_upper(centre, centre), strict=True))
    inverse = symmetric_inverse(spread)

    def away(zeroth, along):
        mean = zeroth / weight
        slope = symmetric_product(
            inverse, tuple(a / weight - c * mean for a, c in zip(along, centre, strict=True))
        )
        return dot(centre, slope) - mean

    return tuple(away(*found) for found in carried), ~uncorrected(spread)


def _rms(vector: Components, counted: Bool[Array, " N"]) -> Scalar:
    """RMS of a vector field over the particles that are counted, in its unit; 0 where none is."""
    square = jnp.sum(jnp.where(counted, dot(vector, vector), 0.0)) / jnp.maximum(jnp.sum(counted), 1)
    moves = square > 0.0  # the root has no slope at zero, and at rest a derivative must be a number
    return jnp.where(moves, jnp.sqrt(jnp.where(moves, square, 1.0)), 0.0)
