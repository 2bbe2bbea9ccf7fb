"""Mirror images of the water in the walls of a tank, in the place of ghosts on a lattice of their own.

A lattice of ghosts resists the water that slides past it by a share of a spacing, and its uppermost rows are
wet or dry: both send out short waves where the surface meets a wall. An image is where its particle is
mirrored, with the particle's volume, and the water beside a plane wall moves as in a tank twice as long
without the wall. In a corner particles are mirrored in all its walls together. Where a wall ends an image
counts for the share of its cell of dx that is within.

Plates and platforms have ghosts on a lattice: images, which come and go as water turns round an edge, made
two to four times the noise in the OWC.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxsph.core.arrays import Array, Float, Int
from jaxsph.solids.box import Box, Platform
from jaxsph.solids.divisions import PLAIN
from jaxsph.solids.placement import GhostSet, join

SPARE = 1.4
"""Rows of images over those that a lattice of water beside the walls takes, up to their tops (-).

Water so much more crowded is none.
"""

WIDEST_SKIN = 0.8
"""Widest margin of a neighbour search over the spacing for which there are rows of images (-)."""

Placed = Callable[[Float[Array, "M D"]], Float[Array, "M D"]]
"""Places (m) that points of the paddle, given as they are at rest (m), have now."""


class Plane(NamedTuple):
    """Plane wall across an axis."""

    axis: int
    at: float
    """Position along the axis, m."""
    side: float
    """Side of the water: 1 where it is above the plane along the axis, -1 where it is below."""
    moves: bool
    """Whether it is the paddle."""
    ends: tuple[tuple[int, float, float], ...]
    """Axes along which the wall ends, each with its ends (m)."""

    def meets(self, other: Plane) -> bool:
        """Whether two walls meet in a corner."""
        return self.axis != other.axis and self._reaches(other) and other._reaches(self)

    def _reaches(self, other: Plane) -> bool:
        """Whether this wall goes on as far as the other."""
        return all(low <= other.at <= high for along, low, high in self.ends if along == other.axis)


class ImageSet(NamedTuple):
    """Images of the water in one wall, or in the walls of a corner at once."""

    planes: tuple[Plane, ...]
    rows: tuple[int, int]
    """Index of the first image, and of the one after the last."""

    @property
    def moves(self) -> bool:
        """Whether the images are in the paddle."""
        return any(plane.moves for plane in self.planes)

    @property
    def windows(self) -> tuple[tuple[int, float, float], ...]:
        """Axes along which the images are cut off, each with the ends (m) between which they count."""
        axes = [plane.axis for plane in self.planes]
        return tuple(end for plane in self.planes for end in plane.ends if end[0] not in axes)

    def image(self, x: Float[Array, "M D"], paddle: Placed) -> Float[Array, "M D"]:
        """Images (m) of particles at x (m); `paddle` places its points.

        The reflection in the paddle where it is now is that at rest, moved twice as the paddle is: exact for
        a displacement across its face, and for a rotation about an axis in it.
        """
        for plane in self.planes:
            x = x.at[:, plane.axis].set(2.0 * plane.at - x[:, plane.axis])
        return paddle(paddle(x)) if self.moves else x

    def share(self, images: Float[Array, "M D"], dx: float) -> Float[Array, " M"]:
        """Shares of the images' cells of dx (m) that are inside the windows, 0 to 1."""
        found = jnp.ones(len(images), images.dtype)
        for axis, low, high in self.windows:
            upper = jnp.minimum(images[:, axis] + 0.5 * dx, high)
            lower = jnp.maximum(images[:, axis] - 0.5 * dx, low)
            found = found * jnp.clip((upper - lower) / dx, 0.0, 1.0)
        return found


class Images(eqx.Module):
    """All images of the water in a tank's walls: rows of ghosts, each for a particle near its wall."""

    sets: tuple[ImageSet, ...] = eqx.field(static=True, default=())
    """Sets of images, those in the paddle first."""
    dx: float = eqx.field(static=True, default=0.0)
    """Spacing, m."""

    @classmethod
    def of(cls, box: Box, platforms: Sequence[Platform], dx: float, radius: float) -> Images:
        """Images of the water in the walls of a tank, up to where a platform is.

        `radius`: that of the kernel's support, m.
        """
        walls = list(_walls(box, platforms))
        corners = [corner for k, wall in enumerate(walls) for corner in _corners((wall,), walls[k + 1 :])]
        corners.sort(key=lambda planes: not any(plane.moves for plane in planes))
        sets, start = [], 0
        for planes in corners:
            count = _count(ImageSet(planes, (0, 0)), box, dx, radius)
            sets.append(ImageSet(planes, (start, start + count)))
            start += count
        return cls(tuple(sets), dx)

    @property
    def count(self) -> int:
        """Number of rows."""
        return self.sets[-1].rows[1] if self.sets else 0

    def image(self, x: Float[Array, "I D"], paddle: Placed) -> Float[Array, "I D"]:
        """Images (m) of the particles at x (m), one for every row; `paddle` places its points."""
        return jnp.concatenate([x[:0], *(one.image(x[slice(*one.rows)], paddle) for one in self.sets)])

    def share(self, images: Float[Array, "I D"]) -> Float[Array, " I"]:
        """Shares of the images (m) that count, 0 to 1."""
        shares = (one.share(images[slice(*one.rows)], self.dx) for one in self.sets)
        return jnp.concatenate([images[:0, 0], *shares])

    def choose(
        self, x: Float[Array, "N D"], paddle: Placed, radius: float | Array, skin: float | Array
    ) -> tuple[Int[Array, " I"], Array]:
        """Particle of every row, N for none, and whether a set has too few rows.

        **Arguments**: positions x (m) of the water; `paddle` places its points; `radius` of the kernel's
        support, m; `skin`, the margin of the search, of which a particle moves half at most, m.
        """
        n, rows, full = len(x), [jnp.zeros(0, jnp.int32)], jnp.zeros((), bool)
        for one in self.sets:
            images = one.image(x, paddle)
            near = jnp.ones(n, bool)
            for plane in one.planes:
                gap = 0.5 * plane.side * (x - images)[:, plane.axis]
                near &= (gap < radius + 0.5 * skin) & (gap > -self.dx)
            for axis, low, high in one.windows:
                margin = 0.5 * (self.dx + skin)
                near &= (images[:, axis] > low - margin) & (images[:, axis] < high + margin)
            size = one.rows[1] - one.rows[0]
            rows.append(jnp.nonzero(near, size=size, fill_value=n)[0].astype(jnp.int32))
            full |= jnp.sum(near) > size
        return jnp.concatenate(rows), full

    def empty_rows(self, box: Box, radius: float) -> GhostSet:
        """Rows as they are while they have no particle, on a lattice behind their walls.

        `radius`: that of the kernel's support, m.
        """
        x, none = np.zeros((0, len(box.low))), np.zeros(0, int)
        nothing = GhostSet(x, x, x, none, none, np.zeros(0, bool), np.zeros(0))
        return join([nothing, *(_rows(one, box, self.dx, radius) for one in self.sets)])


def _walls(box: Box, platforms: Sequence[Platform]) -> Iterator[Plane]:
    """Walls of a tank: where a platform is the bed ends, and the end wall begins at its top."""
    top = len(box.low) - 1
    for axis, (floor, lid) in enumerate(box.walls):
        for there, at, side in ((floor, box.low[axis], 1.0), (lid, box.high[axis], -1.0)):
            ends: tuple[tuple[int, float, float], ...] = ()
            for platform in platforms:
                if axis == top and side > 0:
                    ends = ((0, -np.inf, platform.start),)
                elif axis == 0 and side < 0:
                    ends = ((top, platform.height, np.inf),)
            if there:
                yield Plane(axis, float(at), side, box.paddle and axis == 0 and side > 0, ends)


def _corners(planes: tuple[Plane, ...], walls: Sequence[Plane]) -> Iterator[tuple[Plane, ...]]:
    """These walls, and every corner that they have with the others."""
    yield planes
    for k, wall in enumerate(walls):
        if all(plane.meets(wall) for plane in planes):
            yield from _corners((*planes, wall), walls[k + 1 :])


def _extent(one: ImageSet, box: Box, axis: int) -> tuple[float, float]:
    """Ends (m) of the images along an axis that no plane of theirs is across."""
    ends = [end[1:] for end in one.windows if end[0] == axis]
    behind = box.stroke if axis == 0 else 0.0
    return max([box.low[axis] - behind, *(low for low, _ in ends)]), min(
        [box.high[axis], *(b for _, b in ends)]
    )


def _count(one: ImageSet, box: Box, dx: float, radius: float) -> int:
    """Number of rows of a set."""
    cells, planes = SPARE, [plane.axis for plane in one.planes]
    for axis in range(len(box.low)):
        low, high = (0.0, radius + 0.5 * WIDEST_SKIN * dx) if axis in planes else _extent(one, box, axis)
        cells *= (high - low) / dx + (0.5 if axis in planes else 2.0)
    return int(np.ceil(cells))


def _rows(one: ImageSet, box: Box, dx: float, radius: float) -> GhostSet:
    """Rows of a set while they have no particle."""
    axes, planes = [], {plane.axis: plane for plane in one.planes}
    for axis in range(len(box.low)):
        if axis in planes:
            axes.append(planes[axis].at - planes[axis].side * np.arange(0.5 * dx, radius + dx, dx))
        else:
            low, high = _extent(one, box, axis)
            axes.append(np.arange(low + 0.5 * dx, max(high, low + dx), dx))
    places = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, len(axes))
    count = one.rows[1] - one.rows[0]
    x = np.resize(places, (count, len(axes)))
    mirror = np.ones_like(x)
    mirror[:, list(planes)] = -1.0
    nothing, plain = np.zeros(count), np.full(count, PLAIN, np.int32)
    return GhostSet(x, x, mirror, plain, np.zeros(count, int), np.full(count, one.moves), nothing)
