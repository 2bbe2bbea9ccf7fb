"""Fields between particles, by a linear least-squares fit over the nearest particles."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy  # which imports its subpackages on first use
from numpy.typing import NDArray

Real = NDArray[np.floating]
"""Real numbers."""

NEIGHBOURS = {2: 14, 3: 42}
"""Number of nearest particles that a linear fit uses, by the number of dimensions.

A fit at the position of a particle includes this particle.
"""
FAR = 1.1
"""Distance to the nearest particle, in spacings, beyond which a point is regarded as outside the water.

The centre of a lattice cell is 0.71 spacings from the particles at the corners (0.87 in 3-D). In a disordered
arrangement the nearest particle is closer.
"""


class LinearFit(NamedTuple):
    """Values and gradients of fields at points."""

    value: Real
    """Values `[N, F]`, in the fields' units."""
    gradient: Real
    """Gradients `[N, D, F]`, in the fields' units per m."""
    nearest: Real
    """Distance from the nearest particle `[N]`, m."""


def linear_fit(particles: scipy.spatial.KDTree, f: Real, at: Real) -> LinearFit:
    """Fits fields f `[M, F]` of the M particles in a tree by linear functions at points `at` `[N, D]` (m).

    The fit is weighted by 1 - (r/R)^2, where R is the distance to the farthest neighbour. **Raises**
    ValueError for fewer particles than the fit needs.
    """
    axes, x = particles.m, particles.data
    near = min(NEIGHBOURS[axes], particles.n)
    if near < axes + 2:
        raise ValueError(f"{particles.n} particles are too few for a linear fit: give at least {axes + 2}")
    distance, index = particles.query(at, near)
    radius = np.maximum(distance[:, -1:], 1e-12)
    weight = (1.0 - (distance / radius) ** 2).clip(0.0) + 1e-3
    offset = (x[index] - at[:, None]) / radius[..., None]
    terms = np.concatenate([np.ones((*index.shape, 1)), offset], axis=2)
    left = np.einsum("nk,nki,nkj->nij", weight, terms, terms) + 1e-6 * np.eye(axes + 1)
    fit = np.linalg.solve(left, np.einsum("nk,nki,nkj->nij", weight, terms, f[index]))
    return LinearFit(fit[:, 0], fit[:, 1:] / radius[..., None], distance[:, 0])


def vorticity(gradient: Real) -> Real:
    """Vorticity normal to the x-z plane, du/dz - dw/dx, 1/s, from velocity gradients `[N, D, D]` (1/s)."""
    return gradient[:, -1, 0] - gradient[:, 0, -1]
