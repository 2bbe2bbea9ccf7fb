"""Filling of ghosts: how the pressure and velocity of ghosts follow from the water.

A ghost is the image of one particle (`MirrorImages`), or it interpolates from the water at its node. The node
is the ghost's mirror image in the water (`MirrorNodes`) or the ghost's own position (`DummyParticles`).
"""

from __future__ import annotations

import abc
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxsph.core.arrays import Array, Components, Float, Scalar, columns, dot
from jaxsph.core.pairs import (
    Pair,
    Smoothing,
    outer_upper,
    symmetric_inverse,
    symmetric_product,
)
from jaxsph.core.slabs import PointNeighbours, Sources
from jaxsph.model import laws
from jaxsph.solids.brim import Brim


class NodeFit(NamedTuple):
    """Coefficients of the interpolation sum_j w_j (a + b.r_j) f_j of a field f.

    The weight w_j is V_j W; r_j is the vector from the node to the particle j, in smoothing lengths. The
    interpolation is exact for linear fields, unless b is zero (Shepard sum).
    """

    a: Float[Array, " G"]
    """Constant coefficient."""
    b: Components
    """Coefficients of r_j along every axis."""
    offset: Components
    """Weighted mean of x_j - x_node, m; zero where the interpolation is exact for linear fields.

    The offset differs from zero for a Shepard sum: with `DummyParticles`, and with `MirrorNodes` where too
    little water is nearby to fit a gradient.
    """
    wet: Float[Array, " G"]
    """Wetness of the node: 1 in water, 0 where dry, smooth in between."""


class AbstractFilling(eqx.Module):
    """Method by which the pressure and velocity of ghosts follow from the water."""

    least: eqx.AbstractClassVar[float]
    """Lower bound of a node's kernel sum of V W in a full tank (-)."""
    effort: ClassVar[float] = 1.0
    """Computing time of a ghost divided by that of a water particle (-)."""

    @abc.abstractmethod
    def nodes(self, ghosts: np.ndarray, mirrored: np.ndarray) -> np.ndarray:
        """Interpolation nodes `[G, D]` (m) of `ghosts` (m) with the mirror images `mirrored` (m)."""

    @abc.abstractmethod
    def fit(
        self,
        nodes: Float[Array, "G D"],
        brim: Brim,
        water: Sources,
        smoothing: Smoothing,
        table: PointNeighbours,
        weight: Float[Array, " D"],
    ) -> NodeFit:
        """Interpolation coefficients at the nodes.

        **Arguments**: `nodes` (m); `brim`: kernel sums of the nodes in a full tank; `water`: water
        fields as sources; "level_p" is the pressure that gives the water level, and is omitted if equal to
        "p"; `table`: the nodes' neighbours; `weight`: rho0 g, N/m3.
        """


class MirrorNodes(AbstractFilling):
    """Filling from a ghost's mirror image in the water (Zhu et al. 2020, section 2.3).

    First-order moving least squares replace the Shepard sum of Eq. 18. The least squares are exact for linear
    fields where enough water is nearby. Wherever the kernel is truncated (at corners, at a plate's tip, at
    the surface), the error of the Shepard sum is the field's gradient times the offset of the weighted
    centre. The Shepard sum is used only where there is too little water to fit a gradient.
    """

    least: ClassVar[float] = 0.05

    def nodes(self, ghosts, mirrored):
        """See `AbstractFilling`."""
        return mirrored

    def fit(self, nodes, brim, water, smoothing, table, weight):
        """See `AbstractFilling`."""
        dim = nodes.shape[1]
        h = smoothing.h

        def moments(pair: Pair, i, j):
            w = laws.volume(j) * pair.W
            r = tuple(-c / h for c in pair.r)  # from the node to the particle
            return w, tuple(w * c for c in r), outer_upper(r, tuple(w * c for c in r))

        zeroth, first, second = table.sum(moments, smoothing, {"x": columns(nodes)}, water)
        norm = 1.0 / jnp.maximum(zeroth, 1e-6)
        mean = tuple(c * norm for c in first)
        product = outer_upper(mean, mean)
        covariance = tuple(s * norm - p for s, p in zip(second, product, strict=True))
        determinant, inverse = _flat_inverse(covariance)
        ratio = zeroth / brim.full
        # A fully supported Gaussian has a covariance of 1/2 per axis. A gradient would extrapolate noise if
        # the determinant is below a tenth of this Gaussian's determinant, or if the node is farther from the
        # water's centre than the water is wide.
        slope = symmetric_product(inverse, mean)
        sound = (determinant > 0.1 * 0.5**dim) & (dot(slope, mean) < 1.5) & (ratio > 0.5)
        a = norm * (1.0 + jnp.where(sound, dot(slope, mean), 0.0))
        b = tuple(-norm * jnp.where(sound, c, 0.0) for c in slope)
        offset = tuple(jnp.where(sound, 0.0, c * h) for c in mean)
        wet = jnp.clip((ratio - 0.3) / 0.4, 0.0, 1.0)
        return NodeFit(a, b, offset, wet)


class DummyParticles(AbstractFilling):
    """Filling by a Shepard sum over the water within the ghost's kernel (Yeylaghi et al. 2016, Eq. 22).

    The distance from that water's weighted centre to the ghost gives the hydrostatic part of the ghost's
    pressure (Adami et al. 2012). No mirror image is needed, so the solid may have any shape and may move.
    """

    least: ClassVar[float] = 1.0e-3

    def nodes(self, ghosts, mirrored):
        """See `AbstractFilling`."""
        return ghosts

    def fit(self, nodes, brim, water, smoothing, table, weight):
        """See `AbstractFilling`."""
        h = smoothing.h

        def moments(pair: Pair, i, j):
            w = laws.volume(j) * pair.W
            return w, tuple(-w * c / h for c in pair.r), w * j.get("level_p", j["p"])

        zeroth, first, pressure = table.sum(moments, smoothing, {"x": columns(nodes)}, water)
        # the bound is far below the sum of a single particle near the kernel's edge
        norm = 1.0 / jnp.maximum(zeroth, 1e-6)
        offset = tuple(c * norm * h for c in first)
        wet = jnp.clip((zeroth / brim.full - 0.05) / 0.2, 0.0, 1.0)
        heavy = jnp.sqrt(jnp.sum(weight**2) + 1e-30)
        still = pressure * norm - dot(tuple(weight), offset)
        below = brim.below_level(offset[-1], still / heavy, h)
        # without gravity there is no level
        wet = wet * jnp.where(jnp.sum(weight**2) > 0.0, below, 1.0)
        none = tuple(jnp.zeros_like(norm) for _ in first)
        return NodeFit(norm, none, offset, wet)


class MirrorImages(MirrorNodes):
    """Filling of the tank's walls by mirror images of the water's particles (`solids.images`).

    The ghosts of plates and platforms lie on a lattice and are filled from their mirror nodes.
    """

    effort: ClassVar[float] = 0.1
    """See `AbstractFilling.effort`: an image copies one particle and interpolates nothing."""


def interpolation_weight(pair: Pair, i, j, h: Scalar) -> jax.Array:
    """Weight w_j (a + b.r_j) of the particle j in the interpolation at the node i: see `NodeFit`."""
    r = tuple(-c / h for c in pair.r)
    return laws.volume(j) * pair.W * (i["a"] + dot(i["b"], r))


def _flat_inverse(C: tuple[jax.Array, ...]) -> tuple[jax.Array, tuple[jax.Array, ...]]:
    """Determinant and inverse of covariance matrices whose entries are of order one half."""
    scaled = tuple(2.0 * c for c in C)
    if len(C) == 3:
        determinant = scaled[0] * scaled[2] - scaled[1] ** 2
        dim = 2
    else:
        xx, xy, xz, yy, yz, zz = scaled
        determinant = xx * (yy * zz - yz * yz) - xy * (xy * zz - xz * yz) + xz * (xy * yz - xz * yy)
        dim = 3
    return determinant * 0.5**dim, tuple(2.0 * c for c in symmetric_inverse(scaled))
