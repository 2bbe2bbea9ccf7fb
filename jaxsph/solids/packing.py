"""Packing of the water around solids before a run: a lattice cut by their surfaces, relaxed until it fits."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from jaxsph.solids.divisions import region_bits
from jaxsph.solids.walls import Ghosts

REACH = 3.0
"""Radius of the packing's Gaussian over dx; its smoothing length is dx."""

EDGE = np.exp(-(REACH**2))
"""Value of the Gaussian there, which is taken off it: no pair may come or go with a jump."""

NEAR = 6.0
"""Distance from a solid in spacings within which particles move: two reaches."""

RATE = 0.5
"""Share of dx^2 grad C by which an iteration moves a particle; a lattice trembles from about 1 on."""

LARGEST = 0.1
"""Largest displacement of an iteration, in spacings."""

SETTLED = 2.0e-3
"""Displacement of an iteration in spacings, the largest of all, at which the packing is done."""

USUAL = 60
"""Iterations that every packing takes: a disc and a tilted box settle in 20 to 60. That their number does not
depend on a solid's place is what makes the water a smooth function of it."""

ITERATIONS = 300
"""Bound of the number of iterations."""

ROUNDS = 4
"""Number of times that the particles settle, and share what their number is off: a tenth is left of it."""

SLACK = 0.5
"""Reach of the lists of pairs beyond the Gaussian's, in spacings."""


class Sight(NamedTuple):
    """What particles beside thin plates see of each other and of ghosts, as bits (`solids.divisions`)."""

    sees: np.ndarray
    """Bits of what every free particle sees."""
    kind: np.ndarray
    """Kind bits of the free particles, of the others, and of the mirror images of both."""


def packed(
    x: np.ndarray, volume: np.ndarray, away: np.ndarray, walls: Ghosts, level: float, dx: float
) -> tuple[np.ndarray, np.ndarray]:
    """Positions `[N, D]` (m) and volumes `[N]` (m^D) of still water, packed evenly around solids.

    A lattice that a solid's surface cuts has gaps and crowds along it, which the pressures of a run's first
    steps would shake out. Here every particle near a solid moves down the gradient of the concentration
    C_i = sum_j V_j W_ij of water and ghosts (Colagrossi, Bouscasse, Antuono and Marrone 2012), until none
    moves on; then all that moved share what their number is off the space that they have, so that C is 1.
    The surface is a plane of symmetry: everything below has its mirror image above, and it stays where it is.

    **Arguments**: positions `x` (m) and volumes (m^D) of the water on a lattice of spacing `dx` (m) up to a
    `level` (m); `away` `[N]`: distance from the nearest solid, m; `walls`: ghosts of the tank, and of the
    solids.
    """
    free = away < NEAR * dx
    for axis, side in enumerate(walls.sides[:-1]):
        if side in ("open", "periodic"):  # what is beyond such an end is not known here
            margin = (REACH + SLACK) * dx
            free &= (x[:, axis] > walls.low[axis] + margin) & (x[:, axis] < walls.high[axis] - margin)
    if not free.any():
        return x, volume
    beside = ~free & (away < (NEAR + REACH + 2 * SLACK) * dx)
    ghosts, size = np.asarray(walls.x, float), np.asarray(walls.volume, float) / dx ** x.shape[1]
    kind, sees = region_bits(walls.regions, x)
    # an image stands for a cell, and has no volume while it has no particle
    size = np.concatenate([np.ones(int(beside.sum())), np.where(size > 0.0, size, 1.0)])
    origin = np.append(x[free].mean(axis=0)[:-1], level)
    rest = (np.concatenate([x[beside], ghosts]) - origin) / dx
    before, share = (x[free] - origin) / dx, 1.0
    # of a layer across the surface the part below it, which its mirror image makes whole
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
    """Places of free particles among others at rest where C is even, in spacings from the surface; its mean.

    `volume`: of the free particles and of the others, in cells of the lattice.
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
    """Gaussian of squared distances in spacings, without a jump at its end."""
    return np.maximum(np.exp(-r2) - EDGE, 0.0)


def _whole(dim: int) -> np.ndarray:
    """Points `[K, D]` of the lattice around one of them, as far as the Gaussian reaches, in spacings."""
    line = np.arange(-REACH, REACH + 1)
    return np.stack(np.meshgrid(*dim * [line]), axis=-1).reshape(-1, dim)


def _mirrored(free: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """All places below the surface and their mirror images above it."""
    below = np.concatenate([free, rest])
    above = np.array(below)
    above[:, -1] *= -1.0
    return np.concatenate([below, above])


def _pairs(free: np.ndarray, every: np.ndarray, sight: Sight) -> tuple[np.ndarray, np.ndarray]:
    """Indices of the free particles and of what each of them sees around it."""
    found = KDTree(free).sparse_distance_matrix(KDTree(every), REACH + SLACK, output_type="ndarray")
    found = found[(sight.sees[found["i"]] & sight.kind[found["j"]]) != 0]
    return found["i"], found["j"]
