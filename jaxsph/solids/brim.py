"""What ghosts would see of the water were the tank full to the brim, and by it how wet they are."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from scipy.spatial import KDTree
from scipy.special import gamma

from jaxsph.core.arrays import Array, Float, Scalar
from jaxsph.core.kernels import AbstractKernel
from jaxsph.core.pairs import Smoothing
from jaxsph.core.points import at_points
from jaxsph.solids.box import Box
from jaxsph.solids.divisions import Regions, region_bits
from jaxsph.solids.placement import lattice
from jaxsph.solids.shapes import AbstractShape

PAIRS = 1_000_000
"""Number of pairs held at a time, 24 bytes each."""

NOWHERE = 1.0e3
"""Height that stands for that of no water, m: below every ghost, or above where nothing is to be told."""

SLACK = 0.05
"""Error of a mean height over h: what disorder of the particles makes of it."""

TELLS = 0.2
"""Height over h by which more water than to a cell's top must raise the mean height, to tell the level."""

FEW = 1.0e-4
"""Kernel's sum V W below which there is no water to speak of."""


@dataclass(frozen=True)
class Full:
    """Water that fills a tank to the brim, and a little beyond every end without a wall."""

    box: Box
    regions: Regions
    shapes: Sequence[AbstractShape]
    """Solids that stand in it."""
    side: float
    """Spacing of its lattice, m."""
    beyond: float
    """How far it goes beyond an end without a wall, m."""

    def finer(self) -> Full:
        """The same on half the spacing, where a level cuts a slanting wall's cells better; in 2-D alone."""
        return replace(self, side=0.5 * self.side) if len(self.box.low) == 2 else self

    def seen(self, bits: int) -> tuple[np.ndarray, np.ndarray]:
        """Positions (m) and volumes (m^D) of the water whose kind is among the bits."""
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
    """Kernel's sums at nodes were the tank full, and mean heights of the water that they would see.

    Heights are over the node, m.
    """

    full: Float[Array, " G"]
    """Kernel's sum V W (-)."""
    bottom: Float[Array, " G"]
    """Mean height with the level at the bottom of the node's cell, m."""
    top: Float[Array, " G"]
    """Mean height with the level at the top of the node's cell, m."""
    mean: Float[Array, " G"]
    """Mean height in a full tank, m."""
    cell: Scalar
    """Height of a cell, the spacing of the lattice, m."""

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
        """Brim of nodes (m) in a tank full of `water`, found on the host.

        **Arguments**: `sees`: bits of the water that every node uses; `told`: mask of the nodes of which the
        level is told; `least` sum V W that counts as full.
        """
        full = np.ones(len(nodes))
        # a node of which no level is told is below it
        heights = np.tile([-NOWHERE, -NOWHERE, NOWHERE], (len(nodes), 1))
        fine = water.finer() if told.any() else water
        for mask in np.unique(sees).tolist():
            here = sees == mask
            full[here] = kernel_fill(nodes[here], *water.seen(mask), smoothing.kernel, float(smoothing.h))
            here = here & told
            if here.any():
                heights[here] = _mean_heights(nodes[here], fine, mask, smoothing, water.side)
        found = (np.maximum(full, least), *heights.T, np.asarray(water.side))
        return cls(*(jnp.asarray(a, dtype) for a in found))

    def below_level(
        self, height: Float[Array, " G"], head: Float[Array, " G"], h: Scalar
    ) -> Float[Array, " G"]:
        """Share of each node's cell that is below the level of the water which it sees, 0 to 1.

        A ghost above that level is behind a dry wall, though its kernel reaches the water below. The level
        follows from the mean height of the water: that is what the particles show most exactly. Under a roof
        no more water than there is could raise it, and far below the level it scatters: there the pressure
        head at the ghost tells, which is the level's height over it.

        **Arguments**: `height`: mean height of the water over the node, m; `head`: pressure head of still
        water at the node, as the water around it has it, m; `h`: smoothing length, m.
        """
        slack = SLACK * h
        # the guard is for two levels that see the same water
        share = jnp.clip((height - self.bottom + slack) / (self.top - self.bottom + slack), 0.0, 1.0)
        cells = head / self.cell
        share = jnp.maximum(share, jnp.clip(cells - 0.5, 0.0, 1.0))
        tells = jnp.clip((self.mean - self.top) / (TELLS * h), 0.0, 1.0)
        return tells * share + (1.0 - tells) * jnp.clip(cells + 0.5, 0.0, 1.0)


def kernel_fill(
    points: np.ndarray, water: np.ndarray, volume: np.ndarray, kernel: AbstractKernel, h: float
) -> np.ndarray:
    """Kernel's sum V W at points (m) in the `water`.

    **Arguments**: positions (m) and volumes (m^D) of the water; the kernel's smoothing length `h`, m.
    """
    total = np.zeros(len(points))
    for i, _, weight in _weights(points, water, volume, kernel, h):
        total += np.bincount(i, weight, len(points))
    return total


def _mean_heights(points: np.ndarray, water: Full, bits: int, smoothing: Smoothing, dx: float) -> np.ndarray:
    """Mean heights `[K, 3]` (m) over points of the water of the bits that they see, by the kernel's weights.

    With the level half a spacing dx (m) under and over each point, and above all. Where there is no water it
    is -`NOWHERE`.
    """
    (x, volume), side = water.seen(bits), water.side
    total = np.zeros((3, 2, len(points)))
    for i, j, weight in _weights(points, x, volume, smoothing.kernel, float(smoothing.h)):
        # a level cuts the cells of the water
        bottom = x[j, -1] - points[i, -1] - 0.5 * side
        for sums, level in zip(total, (-0.5 * dx, 0.5 * dx, np.inf), strict=True):
            wet = np.clip(level - bottom, 0.0, side)
            sums += [np.bincount(i, weight * wet / side * a, len(points)) for a in (1.0, bottom + 0.5 * wet)]
    fill, first = np.moveaxis(total, 1, 0)
    return np.where(fill > FEW, first / np.maximum(fill, FEW), -NOWHERE).T


def _weights(
    points: np.ndarray, water: np.ndarray, volume: np.ndarray, kernel: AbstractKernel, h: float
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Indices of points and of the water around them, and the weights V W, by parts of the points."""
    if not len(water):
        return
    dim, reach, tree = points.shape[1], kernel.reach, KDTree(water)
    # pairs of one point at most
    most = np.pi ** (dim / 2) / gamma(dim / 2 + 1) * (reach * h) ** dim / volume.min()
    rows = max(1, int(PAIRS / most))
    law = eqx.Partial(kernel.value, h=jnp.asarray(h), dim=dim)
    for start in range(0, len(points), rows):
        some = KDTree(points[start : start + rows])
        pairs = some.sparse_distance_matrix(tree, reach * h, output_type="ndarray")
        # a pair at the very edge of the support has no weight, whatever its rounding
        inside = pairs["v"] < (1.0 - 1e-6) * reach * h
        value = at_points(law, pairs["v"] ** 2, float)
        yield pairs["i"] + start, pairs["j"], volume[pairs["j"]] * np.where(inside, value, 0.0)
