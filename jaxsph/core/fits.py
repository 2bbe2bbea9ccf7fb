"""Polynomials of second degree that fit a field around every particle, by weighted least squares.

A polynomial is stored as the tuple of its coefficients: first those of the monomials of first degree in the
coordinates d = (x_j - x_i)/R of the neighbours j in the support of radius R, then those of second degree. The
polynomial has no constant term, because it describes the differences of the field from its value at the
particle.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import jax
import jax.numpy as jnp

from jaxsph.core.arrays import Components

__all__ = ["RIDGE", "moments", "monomials", "polynomials"]

RIDGE = 1e-6
"""Weight of the squared coefficients in the least-squares fit, in which the neighbours' weights sum to 1.

This weight makes the polynomial unique where a particle has too few neighbours to determine it, as in spray.
Where there are enough neighbours, the weight changes the polynomial by a relative amount of the order of
1e-6. The weight is about ten times the rounding error of float32.
"""


def _axes(dim: int, degrees: Sequence[int]) -> list[tuple[int, ...]]:
    """Axes whose coordinates are multiplied in each monomial of the given degrees."""
    return [a for n in degrees for a in itertools.combinations_with_replacement(range(dim), n)]


def monomials(d: Components) -> Components:
    """Monomials of first and second degree in the coordinates d (-)."""
    return (*d, *(d[a] * d[b] for a, b in _axes(len(d), (2,))))


def moments(w: jax.Array, d: Components) -> Components:
    """Monomials of second to fourth degree in the coordinates d (-), times the weight w of the neighbour."""
    return tuple(w * math.prod(d[a] for a in axes) for axes in _axes(len(d), (2, 3, 4)))


def polynomials(
    summed: Components, differences: tuple[Components, ...], dim: int, stiffness: jax.Array
) -> tuple[Components, ...]:
    """Polynomials that fit the differences of a field's components, from sums over the neighbours.

    **Arguments**: `summed`: sums of `moments`, with weights whose sum is about 1; `differences`: for every
    component of the field, the sums of w (f_j - f_i) times each of the `monomials`; `stiffness`: weight of
    the squared coefficients of second degree in the least-squares fit. With a stiffness of 0 the
    polynomial is quadratic; with a stiffness of 1 it is almost linear.
    """
    rows = _axes(dim, (1, 2))
    at = dict(zip(_axes(dim, (2, 3, 4)), summed, strict=True))
    matrix = [[at[tuple(sorted(a + b))] for b in rows[: k + 1]] for k, a in enumerate(rows)]
    for k in range(dim, len(rows)):
        matrix[k][k] = matrix[k][k] + stiffness
    L, pivots = _factors(matrix)
    return tuple(_solution(L, pivots, right) for right in differences)


def _factors(matrix: list[list[jax.Array]]) -> tuple[list[list[jax.Array]], list[jax.Array]]:
    """Factors L (without its diagonal) and D of L D L^T = A + RIDGE I, from the rows of A's lower
    triangle."""
    L: list[list[jax.Array]] = []
    pivots: list[jax.Array] = []
    for row in matrix:
        scaled: list[jax.Array] = []  # row of L times D
        for k, a in enumerate(row[:-1]):
            scaled.append(a - sum(s * one for s, one in zip(scaled, L[k], strict=True)))
        L.append([s / pivot for s, pivot in zip(scaled, pivots, strict=True)])
        pivot = row[-1] + RIDGE - sum(s * one for s, one in zip(scaled, L[-1], strict=True))
        pivots.append(jnp.maximum(pivot, RIDGE))  # rounding errors may make the pivot smaller
    return L, pivots


def _solution(L: list[list[jax.Array]], pivots: list[jax.Array], right: Components) -> Components:
    """Solution c of L D L^T c = right."""
    forward: list[jax.Array] = []
    for row, b in zip(L, right, strict=True):
        forward.append(b - sum(a * y for a, y in zip(row, forward, strict=True)))
    c = [y / pivot for y, pivot in zip(forward, pivots, strict=True)]
    for k in reversed(range(len(c))):
        c[k] = c[k] - sum(L[m][k] * c[m] for m in range(k + 1, len(c)))
    return tuple(c)
