"""Packing of the water around solids before a run, by relaxing a lattice that the solids' surfaces cut."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy  # which imports its subpackages on first use

from jaxsph.solids.divisions import region_bits
from jaxsph.solids.walls import Ghosts

REACH = 3.0
"""Support radius of the packing's Gaussian, in spacings dx; its smoothing length is dx."""

EDGE = np.exp(-(REACH**2))
"""Value of the Gaussian at `REACH`, subtracted so that the Gaussian falls to zero without a jump."""

NEAR = 6.0
"""Distance from a solid within which particles move, in spacings; twice `REACH`."""

RATE = 0.5
"""Ratio of the displacement in an iteration to dx^2 grad C (-); above about 1 a lattice oscillates."""

LARGEST = 0.1
"""Largest displacement of a particle in an iteration, in spacings."""

SETTLED = 2.0e-3
"""Bound on the largest displacement in an iteration, in spacings; below this bound the packing has
settled."""

USUAL = 60
"""Smallest number of iterations; a disc and a tilted box settle in 20 to 60. With the same number of
iterations for every position of a solid, the packed water is a smooth function of that position."""

ITERATIONS = 300
"""Largest number of iterations."""

ROUNDS = 4
"""Number of rounds of settling and volume correction; a tenth of the volume error remains after these
rounds."""

SLACK = 0.5
"""Margin of the pair lists beyond the Gaussian's radius, in spacings."""


class Sight(NamedTuple):
    """Visibility of particles and ghosts across thin plates, as bits (`solids.divisions`)."""

    sees: np.ndarray
    """For each free particle, the bits of the particles and ghosts that it sees."""
    kind: np.ndarray
    """Kind bits of the free particles, of the other particles and ghosts, and of all their mirror images."""


def packed(
    x: np.ndarray, volume: np.ndarray, away: np.ndarray, walls: Ghosts, level: float, dx: float
) -> tuple[np.ndarray, np.ndarray]:
    """Positions `[N, D]` (m) and volumes `[N]` (m^D) of still water, packed evenly around solids.

    A lattice cut by a solid's surface has gaps and clusters, which the pressure would even out in the first
    steps of a run. Here every particle near a solid moves down the gradient of the concentration
    C_i = sum_j V_j W_ij of water and ghosts (Colagrossi, Bouscasse, Antuono and Marrone 2012), until the
    particles have settled. Then the volumes of all particles that moved are scaled by a common factor, so
    that the mean of C is 1. The water surface is a plane of symmetry and stays in place: all particles and
    ghosts below it have mirror images above.

    **Arguments**: `x`, `volume`: positions (m) and volumes (m^D) of the water on a lattice of spacing `dx`
    (m), up to the `level` (m); `away` `[N]`: distance from the nearest solid, m; `walls`: ghosts of the tank
    and of the solids.
    """
    free = away < NEAR * dx
    for axis, side in enumerate(walls.sides[:-1]):
        if side in ("open", "periodic"):  # the water beyond such an end is not known here
            margin = (REACH + SLACK) * dx
            free &= (x[:, axis] > walls.low[axis] + margin) & (x[:, axis] < walls.high[axis] - margin)
    if not free.any():
        return x, volume
    beside = ~free & (away < (NEAR + REACH + 2 * SLACK) * dx)
    ghosts, size = np.asarray(walls.x, float), np.asarray(walls.volume, float) / dx ** x.shape[1]
    kind, sees = region_bits(walls.regions, x)
    # a row for an image has no volume yet: it counts as one cell
    size = np.concatenate([np.ones(int(beside.sum())), np.where(size > 0.0, size, 1.0)])
    origin = np.append(x[free].mean(axis=0)[:-1], level)
    rest = (np.concatenate([x[beside], ghosts]) - origin) / dx
    before, share = (x[free] - origin) / dx, 1.0
    # only the part of a cell below the surface counts; its mirror image completes the cell
    below = size * np.clip(0.5 - rest[:, -1], 0.0, 1.0)
    # the walls of a long tank are mostly out of reach
    near = np.all((rest > before.min(axis=0) - NEAR) & (rest < before.max(axis=0) + NEAR), axis=1)
    seen = near & (below > 0)
    rest, below = rest[seen], below[seen]
    kinds = np.concatenate([kind[free], np.concatenate([kind[beside], np.asarray(walls.kind)])[seen]])
    sight = Sight(sees[free], np.tile(kinds, 2))
    places = before
    for _ in range(ROUNDS):
        places, crowding = _settled(places, rest, np.append(np.full(len(places), share), below), sight)
        share /= crowding
    x, volume = np.array(x), np.array(volume)
    volume[free] *= share
    x[free] += dx * (places - before)
    return x, volume


def _settled(
    free: np.ndarray, rest: np.ndarray, volume: np.ndarray, sight: Sight
) -> tuple[np.ndarray, float]:
    """Settled positions of the free particles, in spacings, and the mean of C over these particles.

    Heights are measured from the surface. `volume`: volumes of the free particles, then of the particles and
    ghosts at rest, in cells of the lattice.
    """
    V = np.tile(volume, 2) / _gaussian(np.sum(_whole(free.shape[1]) ** 2, axis=1)).sum()
    since = np.inf
    for iteration in range(ITERATIONS):
        every = _mirrored(free, rest)
        if 2.0 * since > SLACK:
            (i, j), since = _pairs(free, every, sight), 0.0
        r = free[i] - every[j]
        r2 = np.sum(r**2, axis=1)
        W = V[j] * _gaussian(r2)
        slope = [np.bincount(i, -2.0 * W * along, len(free)) for along in r.T]
        step = -RATE * np.stack(slope, axis=-1)
        size = np.sqrt(np.sum(step**2, axis=1, keepdims=True))
        if iteration >= USUAL and size.max() < SETTLED:
            break
        free = free + step * np.minimum(1.0, LARGEST / np.maximum(size, 1e-12))
        since += min(LARGEST, float(size.max()))
    return free, float(W.sum() / len(free))


def _gaussian(r2: np.ndarray) -> np.ndarray:
    """Gaussian (-) at squared distances (in spacings squared), shifted to fall to 0 at `REACH`."""
    return np.maximum(np.exp(-r2) - EDGE, 0.0)


def _whole(dim: int) -> np.ndarray:
    """Points `[K, D]` of a full lattice around the origin, up to the Gaussian's radius, in spacings."""
    line = np.arange(-REACH, REACH + 1)
    return np.stack(np.meshgrid(*dim * [line]), axis=-1).reshape(-1, dim)


def _mirrored(free: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """All positions below the surface, then their mirror images above the surface, in spacings."""
    below = np.concatenate([free, rest])
    above = np.array(below)
    above[:, -1] *= -1.0
    return np.concatenate([below, above])


def _pairs(free: np.ndarray, every: np.ndarray, sight: Sight) -> tuple[np.ndarray, np.ndarray]:
    """Indices of each pair: a free particle, and a particle or ghost nearby that it sees."""
    found = scipy.spatial.KDTree(free).sparse_distance_matrix(
        scipy.spatial.KDTree(every), REACH + SLACK, output_type="ndarray"
    )
    found = found[(sight.sees[found["i"]] & sight.kind[found["j"]]) != 0]
    return found["i"], found["j"]
