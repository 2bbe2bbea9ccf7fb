"""Panels on the boundary of the water in a section, and exact integrals of potentials over them.

On a panel a function is a polynomial through its values at the panel's Gauss points (nodes). A point is
the complex number z, in coordinates in which the panel is the interval [-1, 1] of the real axis. The
integrals of the Legendre polynomials P_n over the panel are

    int P_n(t) / (z - t) dt = 2 Q_n(z),
    int P_n(t) ln(z - t) dt = 2 (Q_{n+1}(z) - Q_{n-1}(z)) / (2n + 1) for n >= 1,

with the Legendre functions of the second kind Q_n. These integrals give the potentials of sources (ln r) and
of dipoles along the normal on the panel. The recursion for Q_n loses digits away from the panel, where
Gauss's rule is used instead. Source of the formulas: NIST Digital Library of Mathematical Functions, 14.7 and
14.10.
"""

from __future__ import annotations

import functools
import itertools
from typing import NamedTuple

import numpy as np
import scipy  # which imports its subpackages on first use
from numpy.typing import NDArray

from jaxsph.waves.section import RADIATING, Edge, Section, edges

__all__ = ["Boundary", "Resolution"]

FAR = 1e8
"""Growth factor of rounding errors in the recursion for Q_n (-) above which Gauss's rule is used instead; at
this value the error of either method is about 1e-8."""


class Resolution(NamedTuple):
    """Resolution of the boundary."""

    nodes: int = 6
    """Number of nodes on a panel."""
    levels: int = 7
    """Number of reductions in panel length towards a corner at which the velocity is singular."""
    ratio: float = 0.3
    """Ratio of panel lengths in each of these reductions (-)."""
    largest: float = 1.0
    """Multiplier of the default largest panel length (-)."""


class Boundary(NamedTuple):
    """Boundary of the water, divided into P panels with N nodes in all."""

    x: NDArray[np.floating]
    """Nodes (x, z) `[N, 2]`, m."""
    normal: NDArray[np.floating]
    """Unit normals `[N, 2]` at the nodes, pointing out of the water."""
    weight: NDArray[np.floating]
    """Weights `[N]` for integrals along the boundary, m."""
    owner: NDArray[np.str_]
    """Name of the hull or chamber that each node belongs to, or `FREE` or `RADIATING`, `[N]`."""
    source: NDArray[np.floating]
    """Integrals `[N, N]` of ln r over the panels, at each node (row) per unit value at a node (column), m."""
    dipole: NDArray[np.floating]
    """Integrals `[N, N]` of the derivative of ln r along the normal (-)."""

    @classmethod
    def of(cls, section: Section, k: float, resolution: Resolution) -> Boundary:
        """Boundary of a section for waves of the wavenumber k (rad/m)."""
        parts = [part for edge in _divided(section, k, resolution) for part in edge]
        each = [_nodes(part) for part in parts]
        x, normal, weight = (np.concatenate(one) for one in zip(*each, strict=True))
        owner = np.concatenate([np.repeat(part.owner, part.nodes) for part in parts])
        source, dipole = _integrals(parts, x, section)
        return cls(x, normal, weight, owner, source, dipole)


class Panel(NamedTuple):
    """Straight panel with the water on its left."""

    a: NDArray[np.floating]
    """Beginning (x, z), m."""
    b: NDArray[np.floating]
    """End (x, z), m."""
    owner: str
    """See `Edge.owner`."""
    nodes: int
    """Number of nodes."""


CORNER_LEVELS = 3
"""Number of reductions in panel length towards a corner at which the velocity is finite."""
APART = 2.0
"""Largest ratio of a panel's length to its distance from the corners of hulls, except corners at which the
panel's edge ends (-). On the free surface the distance from the sides of hulls is used instead, because waves
over a submerged hull are shorter."""
UPRIGHT = 6
"""Number of panels of equal length at a radiating end; these panels resolve the evanescent modes."""


def _divided(section: Section, k: float, resolution: Resolution) -> list[list[Panel]]:
    """Panels of every edge of the boundary."""
    every = edges(section)
    hulls = [edge for edge in every if edge.owner in {hull.name for hull in section.hulls}]
    largest = resolution.largest * min(0.5 * np.pi / k, section.depth / 2.0)
    extent = {hull.name: _extent([e for e in hulls if e.owner == hull.name]) for hull in section.hulls}
    sides = np.array([(edge.a, edge.b) for edge in hulls]).reshape(-1, 2, 2)
    found = []
    for edge in every:
        most, nodes, solid = largest, resolution.nodes, edge.owner in extent
        if solid:
            most = min(largest, 0.5 * resolution.largest * extent[edge.owner])
            nodes = _order(edge.length, most, nodes)
        if edge.owner == RADIATING:
            at = _upright(edge, k, resolution)
        elif nodes == 1:
            at = np.array([0.0, 1.0])
        else:
            at = _apart(edge, _breaks(edge, most, resolution), sides, solid, resolution)
        corners = edge.a + at[:, None] * (edge.b - edge.a)
        found.append([Panel(*ends, edge.owner, nodes) for ends in itertools.pairwise(corners)])
    return found


def _extent(hull: list[Edge]) -> float:
    """Larger side of the box around the wetted edges of a hull, m; 0 for a dry hull."""
    ends = np.array([end for edge in hull for end in (edge.a, edge.b)])
    return float(np.max(np.ptp(ends, axis=0))) if len(ends) else 0.0


def _order(length: float, largest: float, nodes: int) -> int:
    """Number of nodes on each panel of a hull's edge; fewer where short edges approximate a curve."""
    return 1 if length < largest / 16.0 else min(nodes, 3) if length < largest / 4.0 else nodes


def _breaks(edge: Edge, largest: float, resolution: Resolution) -> NDArray:
    """Ends of an edge's panels, from 0 to 1 along the edge, in geometric progression towards corners."""
    first, last = (
        resolution.levels if sharp else CORNER_LEVELS if corner else 0
        for sharp, corner in zip(edge.sharp, edge.corner, strict=True)
    )
    middle = 0.5 if first and last else 1.0 if first else 0.0
    low = middle * resolution.ratio ** np.arange(first, -1, -1.0)
    high = 1.0 - (1.0 - middle) * resolution.ratio ** np.arange(0.0, last + 1)
    at = np.unique(np.concatenate([[0.0], low, high, [1.0]]))
    at = at[np.append(np.diff(at) > 1e-12, True)]
    parts = np.ceil(np.diff(at) * edge.length / largest - 1e-9).astype(int)
    inner = [
        np.linspace(a, b, n, endpoint=False)
        for a, b, n in zip(at, at[1:], np.maximum(parts, 1), strict=False)
    ]
    return np.append(np.concatenate(inner), 1.0)


def _upright(edge: Edge, k: float, resolution: Resolution) -> NDArray:
    """Ends of the panels at a radiating end, from 0 to 1; the panels resolve the wave's decay with depth."""
    at = np.linspace(0.0, 1.0, int(np.ceil(UPRIGHT / resolution.largest)) + 1)
    top = 1.0 - at[-2]
    fine = 1.0 - top * 0.5 ** np.arange(1.0, max(1.0, np.log2(0.5 * k * top * edge.length) + 1.0))
    at = np.unique(np.concatenate([at, fine]))
    return at if edge.b[1] > edge.a[1] else 1.0 - at[::-1]


def _apart(edge: Edge, at: NDArray, hulls: NDArray, solid: bool, resolution: Resolution) -> NDArray:
    """Ends of an edge's panels, from 0 to 1, with further divisions where hulls are near (see `APART`).

    `hulls`: beginnings and ends of all edges of hulls, `[K, 2, 2]`, m.
    """
    a, b = hulls[:, 0], hulls[:, 1]
    apart = ~np.any([_meet(edge, end) for end in (a, b)], axis=0)
    if not apart.any():
        return at
    a, b = a[apart], b[apart]
    found, waiting = [], list(itertools.pairwise(at))
    while waiting:
        low, high = waiting.pop()
        ends = edge.a + np.array([[low], [0.5 * (low + high)], [high]]) * (edge.b - edge.a)
        away = min(_distance(end, a, a if solid else b) for end in ends)
        if (high - low) * edge.length > APART * resolution.largest * away and high - low > 1e-4:
            waiting += [(low, 0.5 * (low + high)), (0.5 * (low + high), high)]
        else:
            found += [low]
    return np.append(np.sort(found), 1.0)


def _meet(edge: Edge, point: NDArray) -> NDArray[np.bool_]:
    """Whether an edge begins or ends at each of the points `[K, 2]` (m)."""
    return np.min([np.hypot(*(point - end).T) for end in (edge.a, edge.b)], axis=0) < 1e-6 * edge.length


def _distance(point: NDArray, a: NDArray, b: NDArray) -> float:
    """Distance of a point from the nearest of the line segments from a to b `[K, 2]`, m."""
    side, there = b - a, point - a
    square = np.maximum(np.sum(side**2, axis=1), 1e-300)
    along = np.clip(np.sum(there * side, axis=1) / square, 0.0, 1.0)
    return float(np.min(np.hypot(*(there - along[:, None] * side).T)))


@functools.cache
def _gauss(nodes: int) -> tuple[NDArray, NDArray, NDArray]:
    """Gauss points and weights on [-1, 1], and the matrix `[n, node]` from values to Legendre terms."""
    t, w = np.polynomial.legendre.leggauss(nodes)
    n = np.arange(nodes)[:, None]
    return t, w, (n + 0.5) * w * scipy.special.eval_legendre(n, t)


def _nodes(panel: Panel) -> tuple[NDArray, NDArray, NDArray]:
    """Nodes (m), normals out of the water and weights (m) of a panel."""
    t, w, _ = _gauss(panel.nodes)
    half = 0.5 * (panel.b - panel.a)
    size = float(np.hypot(*half))
    normal = np.array([half[1], -half[0]]) / size
    return 0.5 * (panel.a + panel.b) + t[:, None] * half, np.tile(normal, (panel.nodes, 1)), w * size


def _integrals(panels: list[Panel], x: NDArray, section: Section) -> tuple[NDArray, NDArray]:
    """`Boundary.source` and `Boundary.dipole`, with the mirror images at the bed and the end wall.

    The image of a panel acts on a point as the panel acts on the image of the point.
    """
    nodes = np.array([panel.nodes for panel in panels])
    first = np.cumsum(nodes) - nodes
    source, dipole = np.zeros((len(x), len(x))), np.zeros((len(x), len(x)))
    mirrored = [x, np.stack([x[:, 0], -2.0 * section.depth - x[:, 1]], axis=-1)]
    for wall in section.walls:
        mirrored += [np.stack([2.0 * wall - one[:, 0], one[:, 1]], axis=-1) for one in mirrored]
    for count in np.unique(nodes):
        of = np.flatnonzero(nodes == count)
        columns = (first[of][:, None] + np.arange(count)).ravel()
        ends = np.array([(panels[p].a, panels[p].b) for p in of]) @ np.array([1.0, 1.0j])
        for points in mirrored:
            each = _potentials(points @ np.array([1.0, 1.0j]), ends, int(count))
            source[:, columns] += each[0].reshape(len(x), -1)
            dipole[:, columns] += each[1].reshape(len(x), -1)
    return source, dipole


def _potentials(points: NDArray, ends: NDArray, nodes: int) -> tuple[NDArray, NDArray]:
    """Integrals `[N, P, node]` of ln r (m) and of its normal derivative over P panels of `nodes` nodes.

    `points` `[N]` and `ends` `[P, 2]` (m) are complex numbers x + iz.
    """
    middle, half = ends.mean(axis=1), 0.5 * (ends[:, 1] - ends[:, 0])
    z, size = (points[:, None] - middle) / half, np.abs(half)[:, None]
    t, w, legendre = _gauss(nodes)
    apart = np.abs(z + np.sqrt(z - 1.0) * np.sqrt(z + 1.0))
    near = np.maximum(apart, 1.0 / apart) ** (2 * nodes) < FAR
    logs, poles = np.empty((*z.shape, nodes)), np.empty((*z.shape, nodes))
    far = z[~near][:, None] - t
    logs[~near], poles[~near] = w * np.log(np.abs(far)), w * (1.0 / far).imag
    by_log, by_pole = _legendre_integrals(z[near], nodes)
    logs[near], poles[near] = by_log @ legendre, by_pole @ legendre
    return size * (logs + w * np.log(size)), -poles


def _legendre_integrals(z: NDArray, nodes: int) -> tuple[NDArray, NDArray]:
    """Integrals of P_n(t) ln|z - t| and of Im P_n(t) / (z - t) over [-1, 1], `[..., n]`, for n < `nodes`.

    On the panel itself the second integral is set to zero, the mean of its values on both sides.
    """
    above, below = np.log(z + 1.0), np.log(z - 1.0)
    # the difference of the logarithms would have a branch cut at z < -1
    first: NDArray = np.log((z + 1.0) / (z - 1.0))
    q = [first, z * first - 2.0]
    for n in range(1, nodes):
        q.append(((2 * n + 1) * z * q[n] - n * q[n - 1]) / (n + 1))
    logs = [((z + 1.0) * above - (z - 1.0) * below - 2.0).real]
    logs += [(q[n + 1] - q[n - 1]).real / (2 * n + 1) for n in range(1, nodes)]
    poles = np.stack([np.imag(one) for one in q[:nodes]], axis=-1)
    on_panel = (np.abs(np.imag(z)) < 1e-7) & (np.abs(np.real(z)) < 1.0)
    poles[on_panel] = 0.0
    return np.stack(logs, axis=-1), poles
