"""Mirror images of the water in the walls of a tank, used instead of ghosts on a lattice.

A lattice of ghosts resists the sliding of water along a wall, even by a fraction of a spacing, and the
ghosts near the surface switch between wet and dry. Both effects generate short waves where the surface meets
a wall. An image instead lies at the mirrored position of its particle and has the particle's volume. The
water next to a plane wall therefore moves as if mirrored water were in the place of the wall. In a corner,
particles are also mirrored in all walls of the corner together. At the end of a wall, an image is weighted
with the fraction of its cell of side dx that lies within the wall's extent.

Plates and platforms have ghosts on a lattice. Images in their faces would appear and vanish as water flows
round an edge; in the OWC such images made the noise two to four times as large.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxsph.core.arrays import Array, Float, Int
from jaxsph.core.native.forms import true_indices
from jaxsph.solids.box import Box, Platform
from jaxsph.solids.divisions import PLAIN
from jaxsph.solids.placement import GhostSet, join

SPARE = 1.4
"""Ratio of the number of rows for images to the number of particles on a lattice (-).

The lattice fills the tank next to the walls up to their tops. A run stops if the water near a wall is denser
than this ratio allows.
"""

WIDEST_SKIN = 0.8
"""Largest margin of the neighbour search, in spacings, for which the rows for images suffice."""

Placed = Callable[[Float[Array, "M D"]], Float[Array, "M D"]]
"""Function from rest positions of points fixed to the moving ends (m) to their present positions (m)."""


class Plane(NamedTuple):
    """Plane wall normal to an axis."""

    axis: int
    at: float
    """Position along the axis, m."""
    side: float
    """Side of the plane on which the water is: 1 towards larger coordinates, -1 towards smaller
    coordinates."""
    moves: bool
    """Whether the wall is the paddle, or a far end that moves."""
    ends: tuple[tuple[int, float, float], ...]
    """Axes along which the wall has ends, each with the coordinates (m) of the low and the high end."""

    def meets(self, other: Plane) -> bool:
        """Whether two walls meet in a corner."""
        return self.axis != other.axis and self._reaches(other) and other._reaches(self)

    def _reaches(self, other: Plane) -> bool:
        """Whether this wall extends to the plane of the other wall."""
        return all(low <= other.at <= high for along, low, high in self.ends if along == other.axis)


class ImageSet(NamedTuple):
    """Images of the water in one wall, or in all walls of a corner together."""

    planes: tuple[Plane, ...]
    rows: tuple[int, int]
    """Index of the set's first image among all images, and of the image after the set's last one."""

    @property
    def moves(self) -> bool:
        """Whether the paddle is one of the walls."""
        return any(plane.moves for plane in self.planes)

    @property
    def windows(self) -> tuple[tuple[int, float, float], ...]:
        """Axes along which the extent of the images is limited, each with its low and high limit (m)."""
        axes = [plane.axis for plane in self.planes]
        return tuple(end for plane in self.planes for end in plane.ends if end[0] not in axes)

    def image(self, x: Float[Array, "M D"], paddle: Placed) -> Float[Array, "M D"]:
        """Positions (m) of the images of particles at x (m); `paddle`: see `Placed`.

        A particle is reflected in the paddle at rest, and the paddle's displacement is then applied to the
        result twice. This construction is exact for a translation normal to the paddle's face and for a
        rotation about an axis in the face.
        """
        for plane in self.planes:
            x = x.at[:, plane.axis].set(2.0 * plane.at - x[:, plane.axis])
        return paddle(paddle(x)) if self.moves else x

    def share(self, images: Float[Array, "M D"], dx: float) -> Float[Array, " M"]:
        """Fractions of the images' cells of side dx (m) that lie inside the windows, 0 to 1 (-)."""
        found = jnp.ones(len(images), images.dtype)
        for axis, low, high in self.windows:
            upper = jnp.minimum(images[:, axis] + 0.5 * dx, high)
            lower = jnp.maximum(images[:, axis] - 0.5 * dx, low)
            found = found * jnp.clip((upper - lower) / dx, 0.0, 1.0)
        return found


class Images(eqx.Module):
    """All images of the water in a tank's walls.

    Each row of an array is for the image of one particle near a wall; unused rows are empty.
    """

    sets: tuple[ImageSet, ...] = eqx.field(static=True, default=())
    """Sets of images; sets whose walls include the paddle come first, then those of a far end that moves."""
    dx: float = eqx.field(static=True, default=0.0)
    """Spacing, m."""

    @classmethod
    def of(cls, box: Box, platforms: Sequence[Platform], dx: float, radius: float) -> Images:
        """Builds the images of the water in a tank's walls, except in the parts of walls behind a platform.

        `radius`: radius of the kernel's support, m.
        """
        walls = list(_walls(box, platforms))
        corners = [corner for k, wall in enumerate(walls) for corner in _corners((wall,), walls[k + 1 :])]

        def order(planes: tuple[Plane, ...]) -> list[bool]:
            return [not any(plane.moves and plane.side == side for plane in planes) for side in (1.0, -1.0)]

        corners.sort(key=order)
        sets, start = [], 0
        for planes in corners:
            count = _count(ImageSet(planes, (0, 0)), box, dx, radius)
            sets.append(ImageSet(planes, (start, start + count)))
            start += count
        return cls(tuple(sets), dx)

    @property
    def count(self) -> int:
        """Number of rows, including empty ones."""
        return self.sets[-1].rows[1] if self.sets else 0

    @property
    def far_end(self) -> tuple[int, ...]:
        """First and last row of the sets whose walls include a far end that moves; () without such an end."""
        rows = [one.rows for one in self.sets if any(p.moves and p.side < 0 for p in one.planes)]
        return (rows[0][0], rows[-1][1]) if rows else ()

    def image(self, x: Float[Array, "I D"], paddle: Placed) -> Float[Array, "I D"]:
        """Positions (m) of the images of all rows, whose particles are at x (m); `paddle`: see `Placed`."""
        return jnp.concatenate([x[:0], *(one.image(x[slice(*one.rows)], paddle) for one in self.sets)])

    def share(self, images: Float[Array, "I D"]) -> Float[Array, " I"]:
        """Weights of images at these positions (m), 0 to 1 (-): see `ImageSet.share`."""
        shares = (one.share(images[slice(*one.rows)], self.dx) for one in self.sets)
        return jnp.concatenate([images[:0, 0], *shares])

    def choose(
        self, x: Float[Array, "N D"], paddle: Placed, radius: float | Array, skin: float | Array
    ) -> tuple[Int[Array, " I"], Array]:
        """Index of each row's particle (N for an empty row), and whether a set has too few rows.

        **Arguments**: `x`: positions of the water, m; `paddle`: see `Placed`; `radius`: radius of the
        kernel's support, m; `skin`: margin of the search, m; until the next search a particle may
        move at most half of this margin.
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
            rows.append(true_indices(near, size))
            full |= jnp.sum(near) > size
        return jnp.concatenate(rows), full

    def empty_rows(self, box: Box, radius: float) -> GhostSet:
        """Ghosts on a lattice behind the walls, which fill all rows until particles are assigned to the rows.

        `radius`: radius of the kernel's support, m.
        """
        x, none = np.zeros((0, len(box.low))), np.zeros(0, int)
        nothing = GhostSet(x, x, x, none, none, np.zeros(0, bool), np.zeros(0))
        return join([nothing, *(_rows(one, box, self.dx, radius) for one in self.sets)])


def _walls(box: Box, platforms: Sequence[Platform]) -> Iterator[Plane]:
    """Yields the walls of a tank.

    The bed ends at a platform's front, and the end wall begins at the platform's top.
    """
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
                moves = axis == 0 and (box.paddle if side > 0 else box.far_moves)
                yield Plane(axis, float(at), side, moves, ends)


def _corners(planes: tuple[Plane, ...], walls: Sequence[Plane]) -> Iterator[tuple[Plane, ...]]:
    """Yields `planes`, and every corner that they form with further `walls`."""
    yield planes
    for k, wall in enumerate(walls):
        if all(plane.meets(wall) for plane in planes):
            yield from _corners((*planes, wall), walls[k + 1 :])


def _extent(one: ImageSet, box: Box, axis: int) -> tuple[float, float]:
    """Low and high end (m) of a set's images along an axis to which none of its walls is normal."""
    ends = [end[1:] for end in one.windows if end[0] == axis]
    behind = box.stroke if axis == 0 else 0.0
    beyond = behind if box.far_moves else 0.0
    return max([box.low[axis] - behind, *(low for low, _ in ends)]), min(
        [box.high[axis] + beyond, *(b for _, b in ends)]
    )


def _count(one: ImageSet, box: Box, dx: float, radius: float) -> int:
    """Number of rows (one per image) to reserve for a set."""
    cells, planes = SPARE, [plane.axis for plane in one.planes]
    for axis in range(len(box.low)):
        low, high = (0.0, radius + 0.5 * WIDEST_SKIN * dx) if axis in planes else _extent(one, box, axis)
        cells *= (high - low) / dx + (0.5 if axis in planes else 2.0)
    return int(np.ceil(cells))


def _rows(one: ImageSet, box: Box, dx: float, radius: float) -> GhostSet:
    """Ghosts on a lattice behind the walls, which fill a set's rows until particles are assigned to them."""
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
