"""Solid walls: fixed ghost particles with interpolation nodes, and the regional sets of thin walls.

A ghost stands in the wall; its node is its mirror image in the water. Each step the water's pressure and
velocity are interpolated at the nodes and carried to the ghosts (Zhu et al. 2020, Eq. 18-20), which are
from then on ordinary sources of the pair sums. Around a wall thinner than the kernel the water is divided
into regions that see different ghosts and not each other (their section 2.4.1). Which region sees which
set is a static matrix of booleans, packed into bit masks that the neighbour search applies.
"""

from __future__ import annotations

import abc
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxsph.core.arrays import Array, Components, Float, Int, Scalar, columns, dot
from jaxsph.core.pairs import (
    Pair,
    Smoothing,
    outer_upper,
    pair_sum,
    symmetric_inverse,
    symmetric_product,
)
from jaxsph.model import laws


class NodeFit(NamedTuple):
    """Weights of an interpolation that is exact for linear fields: sum_j w_j (a + b.r_j) f_j."""

    a: Float[Array, " G"]
    b: Components
    offset: Components
    """Weighted mean of x_j - x_node that is left, m: zero except where too little water is near."""
    wet: Float[Array, " G"]
    """1 where the node is in water, 0 where it is dry, smooth between."""


class AbstractFilling(eqx.Module):
    """From where in the water a ghost takes its pressure and velocity, and how."""

    least: eqx.AbstractClassVar[float]
    """Least that a node counts as full, of sum V W."""

    @abc.abstractmethod
    def nodes(self, ghosts: np.ndarray, mirrored: np.ndarray) -> np.ndarray:
        """Interpolation nodes `[G, D]` (m) of ghosts whose mirror images are these."""

    @abc.abstractmethod
    def fit(
        self,
        nodes: Float[Array, "G D"],
        full: Float[Array, " G"],
        water: dict,
        smoothing: Smoothing,
        table: Int[Array, "K G"],
    ) -> NodeFit:
        """Interpolation weights at the nodes; `full`: sum V W there were the tank full."""


class MirrorNodes(AbstractFilling):
    """From its mirror image in the water (Zhu et al. 2020, section 2.3), exact for linear fields where enough
    water is near.

    Moving least squares of first order in the place of Eq. 18's Shepard sum, which is wrong by a
    slope times the offset of the weighted centre wherever the kernel is cut: at corners, the tip
    and the surface. Where the second moments are too flat for a slope, Shepard's sum is left.
    """

    least: ClassVar[float] = 0.05

    def nodes(self, ghosts, mirrored):
        """See `AbstractFilling`."""
        return mirrored

    def fit(self, nodes, full, water, smoothing, table):
        """See `AbstractFilling`."""
        dim = nodes.shape[1]
        h = smoothing.h

        def moments(pair: Pair, i, j):
            w = laws.volume(j) * pair.W
            r = tuple(-c / h for c in pair.r)  # from the node to the particle
            return w, tuple(w * c for c in r), outer_upper(r, tuple(w * c for c in r))

        zeroth, first, second = pair_sum(moments, smoothing, {"x": columns(nodes)}, water, table)
        norm = 1.0 / jnp.maximum(zeroth, 1e-6)
        mean = tuple(c * norm for c in first)
        product = outer_upper(mean, mean)
        covariance = tuple(s * norm - p for s, p in zip(second, product, strict=True))
        determinant, inverse = _flat_inverse(covariance)
        ratio = zeroth / full
        # A fully supported Gaussian has covariance 1/2 per axis; below a tenth of that volume, or for a
        # node farther from its water than that water is wide, a slope would be extrapolated from noise.
        slope = symmetric_product(inverse, mean)
        sound = (determinant > 0.1 * 0.5**dim) & (dot(slope, mean) < 1.5) & (ratio > 0.5)
        a = norm * (1.0 + jnp.where(sound, dot(slope, mean), 0.0))
        b = tuple(-norm * jnp.where(sound, c, 0.0) for c in slope)
        offset = tuple(jnp.where(sound, 0.0, c * h) for c in mean)
        wet = jnp.clip((ratio - 0.3) / 0.4, 0.0, 1.0)
        return NodeFit(a, b, offset, wet)


class DummyParticles(AbstractFilling):
    """From the water that its own kernel reaches, by Shepard's sum; what that water is away from it makes the
    hydrostatic part of its pressure (Yeylaghi et al. 2016, Eq. 22; Adami et al. 2012).

    It needs no mirror image, so solids of any shape may have it, and move.
    """

    least: ClassVar[float] = 1.0e-3

    def nodes(self, ghosts, mirrored):
        """See `AbstractFilling`."""
        return ghosts

    def fit(self, nodes, full, water, smoothing, table):
        """See `AbstractFilling`."""
        h = smoothing.h

        def moments(pair: Pair, i, j):
            w = laws.volume(j) * pair.W
            return w, tuple(-w * c / h for c in pair.r)

        zeroth, first = pair_sum(moments, smoothing, {"x": columns(nodes)}, water, table)
        # far below what a single particle at the kernel's edge gives
        norm = 1.0 / jnp.maximum(zeroth, 1e-6)
        wet = jnp.clip((zeroth / full - 0.05) / 0.2, 0.0, 1.0)
        none = tuple(jnp.zeros_like(norm) for _ in first)
        return NodeFit(norm, none, tuple(c * norm * h for c in first), wet)


def interpolation_weight(pair: Pair, i, j, h: Scalar) -> jax.Array:
    """Weight of the particle j in an interpolation at the node i that is exact for linear fields."""
    r = tuple(-c / h for c in pair.r)
    return laws.volume(j) * pair.W * (i["a"] + dot(i["b"], r))


def _flat_inverse(C: tuple[jax.Array, ...]) -> tuple[jax.Array, tuple[jax.Array, ...]]:
    """Determinant and inverse of covariances of order one half; see `symmetric_inverse`."""
    scaled = tuple(2.0 * c for c in C)
    if len(C) == 3:
        determinant = scaled[0] * scaled[2] - scaled[1] ** 2
        dim = 2
    else:
        xx, xy, xz, yy, yz, zz = scaled
        determinant = xx * (yy * zz - yz * yz) - xy * (xy * zz - xz * yz) + xz * (xy * yz - xz * yy)
        dim = 3
    return determinant * 0.5**dim, tuple(2.0 * c for c in symmetric_inverse(scaled))
