"""Kernel sums at the ghosts' nodes in a full tank, from which the wetness of the ghosts is found."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import scipy  # which imports its subpackages on first use

from jaxsph.core.arrays import Array, Float, Scalar, on_device
from jaxsph.core.kernels import AbstractKernel
from jaxsph.core.pairs import Smoothing
from jaxsph.core.points import at_points
from jaxsph.solids.box import Box
from jaxsph.solids.divisions import Regions, region_bits
from jaxsph.solids.placement import lattice
from jaxsph.solids.shapes import AbstractShape

PAIRS = 1_000_000
"""Largest number of pairs in memory at a time; each pair takes 24 bytes."""

NOWHERE = 1.0e3
"""Height far above every tank, m. This height is used at nodes that see no water and at nodes whose level is
not evaluated."""

SLACK = 0.05
"""Error of a mean height due to the disorder of the particles, in smoothing lengths h."""

TELLS = 0.2
"""Rise of the mean height, in smoothing lengths h, above which the mean height alone gives the level.

The rise is the mean height in a full tank minus the mean height with the level at the top of the node's cell.
If the rise is smaller, the pressure head is used as well.
"""

FEW = 1.0e-4
"""Kernel sum of V W (-) below which a point counts as a point without water."""


@dataclass(frozen=True)
class Full:
    """Water that fills a tank to the brim and extends somewhat beyond every end without a wall."""

    box: Box
    regions: Regions
    shapes: Sequence[AbstractShape]
    """Solids in the tank."""
    side: float
    """Lattice spacing of the water, m."""
    beyond: float
    """Distance by which the water extends beyond an end without a wall, m."""

    def finer(self) -> Full:
        """Returns this water at half the spacing in 2-D, and unchanged in 3-D.

        Next to an inclined wall, the finer lattice better resolves the volume of water below a given level.
        """
        return replace(self, side=0.5 * self.side) if len(self.box.low) == 2 else self

    def seen(self, bits: int) -> tuple[np.ndarray, np.ndarray]:
        """Positions (m) and volumes (m^D) of the water whose kind bit is in the mask `bits`."""
        x, volume, kind = self._particles
        return x[(kind & bits) != 0], volume[(kind & bits) != 0]

    @functools.cached_property
    def _particles(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Positions (m), volumes (m^D) and kind bits of all the water."""
        over = np.where(self.box.walls.T, 0.0, self.beyond)
        ends = tuple(self.box.low - over[0]), tuple(self.box.high + over[1])
        x, volume = lattice(*ends, self.side, self.regions.plates, self.regions.platforms)
        for shape in self.shapes:
            outside = at_points(shape.distance, x) > 0
            x, volume = x[outside], volume[outside]
        return x, volume, region_bits(self.regions, x)[0]


class Brim(eqx.Module):
    """Kernel sums and mean heights of the water at the nodes of ghosts in a full tank.

    A mean height (m) is measured upwards from the node and averaged over the water that the node sees.
    """

    full: Float[Array, " G"]
    """Kernel sum of V W at the nodes in a full tank (-)."""
    bottom: Float[Array, " G"]
    """Mean height with the water level at the bottom of the node's cell, m."""
    top: Float[Array, " G"]
    """Mean height with the water level at the top of the node's cell, m."""
    mean: Float[Array, " G"]
    """Mean height in a full tank, m."""
    cell: Scalar
    """Height of a cell, equal to the spacing of the water, m."""

    @classmethod
    def of(
        cls,
        nodes: np.ndarray,
        sees: np.ndarray,
        told: np.ndarray,
        water: Full,
        smoothing: Smoothing,
        least: float,
        dtype: Any,
    ) -> Brim:
        """Computes kernel sums and mean heights at `nodes` (m) in a tank full of `water`, on the host.

        **Arguments**: `sees`: bits of the water that each node uses; `told`: mask of the nodes whose water
        level is evaluated; `least`: lower bound of the kernel sum in a full tank.
        """
        full = np.ones(len(nodes))
        # a node whose level is not evaluated counts as below the level
        heights = np.tile([-NOWHERE, -NOWHERE, NOWHERE], (len(nodes), 1))
        fine = water.finer() if told.any() else water
        for mask in np.unique(sees).tolist():
            here = sees == mask
            full[here] = kernel_fill(nodes[here], *water.seen(mask), smoothing.kernel, float(smoothing.h))
            here = here & told
            if here.any():
                heights[here] = _mean_heights(nodes[here], fine, mask, smoothing, water.side)
        found = (np.maximum(full, least), *heights.T, np.asarray(water.side))
        return cls(*(on_device(a, dtype) for a in found))

    def below_level(
        self, height: Float[Array, " G"], head: Float[Array, " G"], h: Scalar
    ) -> Float[Array, " G"]:
        """Fraction (0 to 1) of each node's cell below the level of the water seen by the node.

        A ghost above that level is behind a dry wall, even if its kernel reaches the water below. The level
        is found from the mean height of the water, the quantity that the particles determine most accurately.
        At two kinds of nodes the level is found from the pressure head instead: under a roof, where more
        water could not raise the mean height, and far below the level, where the mean height scatters.

        **Arguments**: `height`: mean height of the water above the node, m; `head`: hydrostatic pressure head
        at the node, found from the water around the node, m; `h`: smoothing length, m.
        """
        slack = SLACK * h
        # the slack avoids 0 / 0 where both levels have the same mean height
        share = jnp.clip((height - self.bottom + slack) / (self.top - self.bottom + slack), 0.0, 1.0)
        cells = head / self.cell
        share = jnp.maximum(share, jnp.clip(cells - 0.5, 0.0, 1.0))
        tells = jnp.clip((self.mean - self.top) / (TELLS * h), 0.0, 1.0)
        return tells * share + (1.0 - tells) * jnp.clip(cells + 0.5, 0.0, 1.0)


def kernel_fill(
    points: np.ndarray, water: np.ndarray, volume: np.ndarray, kernel: AbstractKernel, h: float
) -> np.ndarray:
    """Kernel sum of V W at `points` (m) over the water (-).

    **Arguments**: `water`, `volume`: positions (m) and volumes (m^D) of the water; `h`: smoothing length, m.
    """
    total = np.zeros(len(points))
    for i, _, weight in _weights(points, water, volume, kernel, h):
        total += np.bincount(i, weight, len(points))
    return total


def _mean_heights(points: np.ndarray, water: Full, bits: int, smoothing: Smoothing, dx: float) -> np.ndarray:
    """Mean heights `[K, 3]` (m), above each point, of the water whose kind bit is in `bits`.

    The means are kernel-weighted. The columns are for a level half a spacing dx (m) below each point, half a
    spacing above it, and a full tank. A point without water has the height -`NOWHERE`.
    """
    (x, volume), side = water.seen(bits), water.side
    total = np.zeros((3, 2, len(points)))
    for i, j, weight in _weights(points, x, volume, smoothing.kernel, float(smoothing.h)):
        # only the part of a cell below the level counts
        bottom = x[j, -1] - points[i, -1] - 0.5 * side
        for sums, level in zip(total, (-0.5 * dx, 0.5 * dx, np.inf), strict=True):
            wet = np.clip(level - bottom, 0.0, side)
            sums += [np.bincount(i, weight * wet / side * a, len(points)) for a in (1.0, bottom + 0.5 * wet)]
    fill, first = np.moveaxis(total, 1, 0)
    return np.where(fill > FEW, first / np.maximum(fill, FEW), -NOWHERE).T


def _weights(
    points: np.ndarray, water: np.ndarray, volume: np.ndarray, kernel: AbstractKernel, h: float
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Yields indices of points, indices of the water around them, and their weights V W, in blocks."""
    if not len(water):
        return
    dim, reach, tree = points.shape[1], kernel.reach, scipy.spatial.KDTree(water)
    # largest number of pairs of one point
    most = np.pi ** (dim / 2) / scipy.special.gamma(dim / 2 + 1) * (reach * h) ** dim / volume.min()
    rows = max(1, int(PAIRS / most))
    law = eqx.Partial(kernel.value, h=jnp.asarray(h), dim=dim)
    for start in range(0, len(points), rows):
        some = scipy.spatial.KDTree(points[start : start + rows])
        pairs = some.sparse_distance_matrix(tree, reach * h, output_type="ndarray")
        # a pair at the very edge of the support has no weight, however its distance is rounded
        inside = pairs["v"] < (1.0 - 1e-6) * reach * h
        value = at_points(law, pairs["v"] ** 2, float)
        yield pairs["i"] + start, pairs["j"], volume[pairs["j"]] * np.where(inside, value, 0.0)
