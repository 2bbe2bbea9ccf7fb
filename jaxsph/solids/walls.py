"""Ghost particles of all walls, and their pressures and velocities, computed from the fields of the water.

A ghost lies inside a wall. Either it is the mirror image of a particle near a plane wall, or its values are
interpolated from the water at its node. The node is the ghost's mirror image in the water, or the ghost's own
position. In each step the water's pressure and velocity are gathered from the particles, or interpolated at
the nodes, and assigned to the ghosts (Zhu et al. 2020, Eq. 18-20). The ghosts are then ordinary sources of
the pair sums.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxsph.core.arrays import Array, Components, Float, Int, columns, dot, on_device, stack
from jaxsph.core.pairs import (
    Pair,
    Period,
    Smoothing,
)
from jaxsph.core.points import at_points
from jaxsph.core.slabs import Chosen, PointNeighbours, Sources
from jaxsph.model.solids import AbstractSolid
from jaxsph.solids.box import Box, FreeSlip, NoSlip, Platform, WallPlate
from jaxsph.solids.brim import Brim, Full
from jaxsph.solids.divisions import (
    AbstractThinWall,
    RegionalGhosts,
    Regions,
    region_bits,
)
from jaxsph.solids.filling import (
    AbstractFilling,
    DummyParticles,
    MirrorImages,
    NodeFit,
    interpolation_weight,
)
from jaxsph.solids.fixed import PlatformBed, TankWalls, ThinPlate
from jaxsph.solids.images import Images
from jaxsph.solids.placement import (
    GhostSet,
    box_ghosts,
    cut_by_platform,
    join,
    plate_ghosts,
    platform_ghosts,
    sliding_velocity,
    solid_ghosts,
)
from jaxsph.solids.shapes import AbstractShape

AT_WALL = 1e-5
"""Distance (m) between a solid and a wall below which they count as in contact: a few rounding errors."""


class Ghosts(eqx.Module):
    """Ghost particles of all walls, their interpolation nodes, and the method that sets their fields.

    The leaves (positions at rest, masks, mirror factors) do not change in a run. `Model.walls_at` returns the
    present positions of the ghosts of moving solids. The images of particles come first; in these arrays the
    images lie on a lattice behind the walls and have no volume.
    """

    x: Float[Array, "G D"]
    """Positions at rest, m."""
    node: Float[Array, "G D"]
    """Interpolation nodes at rest, m."""
    mirror: Float[Array, "G D"]
    """Factors of the velocity's components: -1 normal to the wall, 1 along it (0 at a thin wall's tip); 0 for
    dummy particles."""
    shear: Float[Array, "G D"]
    """Factors of the velocity's components in the viscous force: `mirror`, with slip factors along walls."""
    brim: Brim
    """Kernel sums and mean water heights at the nodes in a full tank."""
    volume: Float[Array, " G"]
    """Volumes, m^D."""
    kind: Int[Array, " G"]
    """Kind bits, which determine the regions that see a ghost."""
    node_sees: Int[Array, " G"]
    """Bit mask, for each node, of the particles that the node uses."""
    regions: Regions
    """Regions of the water, with the particles and ghosts that each region sees."""
    paddle: tuple[int, ...] = eqx.field(static=True)
    """Index of the paddle's first ghost, and of the ghost after the paddle's last; () without a paddle."""
    low: tuple[float, ...] = eqx.field(static=True)
    """Low ends of the water's domain, m."""
    high: tuple[float, ...] = eqx.field(static=True)
    """High ends of the water's domain, m."""
    sides: tuple[str, ...] = eqx.field(static=True)
    """Kind of boundary of each axis, one of `solids.box.SIDES`."""
    sliding: Float[Array, "G D"]
    """Velocity of walls that slide in their own plane, m/s; zero for other walls."""
    filling: AbstractFilling
    """Method that computes the pressure and velocity of the ghosts from the fields of the water."""
    dummies: tuple[tuple[int, int], ...] = eqx.field(static=True)
    """For each solid made of dummy particles, index of its first ghost and of the ghost after its last."""
    images: Images = eqx.field(default_factory=Images)
    """Ghosts that are images of particles; empty unless the filling is `MirrorImages`."""

    @classmethod
    def build(
        cls,
        box: Box,
        dx: float,
        smoothing: Smoothing,
        slip: FreeSlip | NoSlip,
        plates: Sequence[WallPlate] = (),
        thin_wall: AbstractThinWall | None = None,
        dtype: np.dtype | type = np.float32,
        sliding: Mapping[tuple[int, int], Sequence[float]] | None = None,
        platform: Platform | None = None,
        filling: AbstractFilling | None = None,
        shapes: Sequence[AbstractShape] = (),
        fixed_shapes: Sequence[AbstractShape] = (),
    ) -> Ghosts:
        """Builds the ghosts of a tank and of the plates, platform and solids in it, on the host.

        **Arguments**: `dx`: spacing, m; `slip`: slip at the tank's walls and plates; `sliding`: velocities
        (m/s) of walls that slide in their own plane, keyed by (axis, end), where end is 0 (low) or 1 (high);
        these walls drag the water only with `NoSlip`; `platform`: a raised bed at the far end of a 2-D tank,
        with lengths in whole spacings; `filling`: by default `MirrorImages`; `shapes`: solids in the water,
        which need `DummyParticles`; `fixed_shapes`: further solids, which never move. The tank's ghosts
        behind a fixed shape belong to that shape, so that its force includes the force on these ghosts.
        **Raises** ValueError if a plate is too thin, or a sliding wall, platform or shape is not allowed.
        """
        layers = int(np.ceil(float(smoothing.radius) / dx - 0.5))
        thin_wall = RegionalGhosts() if thin_wall is None else thin_wall
        every = (*shapes, *fixed_shapes)
        regions = Regions.of(plates, thin_wall.division, platform, every)
        filling = _checked(MirrorImages() if filling is None else filling, shapes, every)
        images, tank = _tank(filling, box, regions, dx, layers, float(smoothing.radius))
        fixed = join([tank, *_in_the_tank(box, regions, thin_wall, dx, layers, images.count > 0)])
        solids = _of_solids(every, regions, box, dx, layers)
        parts = _with_walls_behind([fixed, *solids], box, fixed_shapes)
        ghosts, owner = _in_order(parts, images.count)
        ghosts = ghosts._replace(node=filling.nodes(ghosts.x, ghosts.node))
        node_sees = _seen_by_nodes(ghosts, regions)
        at = slice(images.count, None)  # images have no nodes
        # the water level is evaluated at ghosts that never move
        told = isinstance(filling, DummyParticles) & ~np.isin(owner, 1 + np.arange(len(shapes)))
        full = Full(box, regions, every, dx, (2 * layers - 1) * dx)
        return cls(
            x=on_device(ghosts.x, dtype),
            node=on_device(ghosts.node, dtype),
            mirror=on_device(ghosts.mirror, dtype),
            shear=on_device(_shear(ghosts, owner, slip), dtype),
            brim=Brim.of(ghosts.node[at], node_sees[at], told[at], full, smoothing, filling.least, dtype),
            volume=on_device(ghosts.volume, dtype),
            kind=on_device(ghosts.kind, jnp.int32),
            node_sees=on_device(node_sees, jnp.int32),
            regions=regions,
            paddle=(0, min([*images.far_end, int(ghosts.moves.sum())])) if box.paddle else (),
            low=box.low,
            high=box.high,
            sides=box.sides,
            sliding=on_device(sliding_velocity(ghosts.x, box, sliding or {}), dtype),
            filling=filling,
            dummies=_rows(parts),
            images=images,
        )

    @property
    def period(self) -> Period:
        """Periodic axes, each with its length (m)."""
        return Box(self.low, self.high, sides=self.sides).period

    @property
    def far_end(self) -> tuple[int, ...]:
        """First ghost of a far end that moves, and the ghost after its last; () if it is at rest."""
        return self.images.far_end

    @property
    def width(self) -> float:
        """Width of the tank, normal to x and z, m; 1 in two dimensions, where quantities are per metre."""
        return float(np.prod([b - a for a, b in zip(self.low[1:-1], self.high[1:-1], strict=True)]))

    def solids(self) -> tuple[AbstractSolid, ...]:
        """Solids at rest to which ghosts belong: the tank's walls, the plates and the platform."""
        tank = TankWalls(self.low, self.high, self.sides, bool(self.paddle), bool(self.far_end))
        return (tank, *map(ThinPlate, self.regions.plates), *map(PlatformBed, self.regions.platforms))

    @property
    def count(self) -> int:
        """Number of ghosts."""
        return self.x.shape[0]

    @property
    def at_nodes(self) -> slice:
        """Rows of the ghosts that interpolate at nodes: all but the images of particles."""
        return slice(self.images.count, None)

    def padded(self, more: int) -> Ghosts:
        """The ghosts, followed by `more` empty ones, which neither see nor are seen."""
        if not more:
            return self

        def longer(a: Array, mode: str) -> Array:
            # on the host, where another number of ghosts compiles nothing
            return jax.device_put(np.pad(a, [(0, more), *[(0, 0)] * (a.ndim - 1)], mode))  # pyright: ignore[reportArgumentType, reportCallIssue]

        def repeated(g: Ghosts) -> list[Any]:
            brim = g.brim
            return [g.x, g.node, g.mirror, g.shear, g.sliding, brim.full, brim.bottom, brim.top, brim.mean]

        def empty(g: Ghosts) -> list[Any]:
            return [g.volume, g.kind, g.node_sees]

        walls = eqx.tree_at(repeated, self, [longer(a, "edge") for a in repeated(self)])
        return eqx.tree_at(empty, walls, [longer(a, "constant") for a in empty(self)])

    def fit(
        self,
        nodes: Float[Array, "G D"],
        water: Sources,
        smoothing: Smoothing,
        images: Chosen,
        table: PointNeighbours,
        weight: Float[Array, " D"],
    ) -> NodeFit:
        """Coefficients that interpolate the water's fields to the nodes (m) from the nodes' neighbours.

        Ghosts that are images of particles need no coefficients; such a ghost is wet if `images` assigns a
        particle to it. `weight`: rho0 g, N/m3.
        """
        rows, none = self.at_nodes, jnp.zeros(self.images.count, nodes.dtype)
        wet, zeros = images.there.astype(nodes.dtype), (none,) * nodes.shape[1]
        alone = NodeFit(none, zeros, zeros, wet)
        if len(wet) == self.count:
            return alone
        found = self.filling.fit(nodes[rows], self.brim, water, smoothing, table, weight)
        return jax.tree.map(lambda a, b: jnp.concatenate([a, b]), alone, found)

    def carried(
        self,
        law,
        fit: NodeFit,
        nodes: Float[Array, "G D"],
        water: Sources,
        smoothing: Smoothing,
        images: Chosen,
        table: PointNeighbours,
    ):
        """Values of `law(j)` (a pytree of fields of the water) at the particle or the node of every ghost."""

        def weighted(pair: Pair, i, j):
            w = interpolation_weight(pair, i, j, smoothing.h)
            return jax.tree.map(lambda f: w * f, law(j))

        seen = images.fields(law(water.water))
        if self.images.count == self.count:
            return seen
        rows = self.at_nodes
        targets = {"x": columns(nodes[rows]), "a": fit.a[rows], "b": tuple(b[rows] for b in fit.b)}
        found = table.sum(weighted, smoothing, targets, water)
        return jax.tree.map(lambda a, b: jnp.concatenate([a, b]), seen, found)

    def carrier(
        self,
        fit: NodeFit,
        nodes: Float[Array, "G D"],
        water: Sources,
        smoothing: Smoothing,
        images: Chosen,
        table: PointNeighbours,
    ) -> Callable[[Sources], Float[Array, " G"]]:
        """Linear function that interpolates one field "f" of the water to all ghosts, as `carried` does.

        The value at a dry ghost is 0.
        """
        rows, wet = self.at_nodes, jnp.where(fit.wet > 0, 1.0, 0.0).astype(fit.wet.dtype)

        def law(pair: Pair, i, j):
            return (), i["wet"] * interpolation_weight(pair, i, j, smoothing.h)

        def seen(f: Sources) -> Float[Array, " I"]:
            return wet[: self.images.count] * images.fields(f.water)["f"]

        if self.images.count == self.count:
            return seen
        targets = {"x": columns(nodes[rows]), "a": fit.a[rows], "b": tuple(b[rows] for b in fit.b)}
        weights = table.weights(law, smoothing, targets | {"wet": wet[rows]}, water)[1]
        return lambda f: jnp.concatenate([seen(f), table.weighted_sum(weights, f)])

    def pressure(
        self,
        fit: NodeFit,
        at_node: Float[Array, " G"],
        x: Float[Array, "G D"],
        nodes: Float[Array, "G D"],
        body_force: Float[Array, "G D"],
    ) -> Float[Array, " G"]:
        """Pressure of the ghosts, Pa, the sum of the node pressure and a body-force part.

        The pressure gradient between a node and its ghost balances the body force (Zhu et al. 2020, Eq.
        19-20).

        **Arguments**: `at_node`: pressure at the nodes, Pa; `x`, `nodes`: positions of the ghosts and of
        their nodes, m; `body_force`: rho0 (f - a_wall), N/m3.
        """
        reach = tuple(g - n - o for g, n, o in zip(columns(x), columns(nodes), fit.offset, strict=True))
        return at_node + dot(columns(body_force), reach)

    def velocity(
        self, at_node: Components, wall: Components, mirror: Float[Array, "G D"]
    ) -> Float[Array, "G D"]:
        """Velocity of the ghosts, m/s: mirror u_node + (1 - mirror) u_wall in every component.

        Zhu et al. 2020, section 2.4. **Arguments**: `at_node`, `wall`: velocities (m/s) at the nodes and of
        the wall; `mirror`: factors of the components.
        """
        return stack([m * u + (1.0 - m) * w for m, u, w in zip(columns(mirror), at_node, wall, strict=True)])


def _in_order(parts: Sequence[GhostSet], kept: int) -> tuple[GhostSet, np.ndarray]:
    """Ghosts of the walls and of solids, sorted, and for each ghost the index of its part.

    The first `kept` ghosts keep their order. Then come the paddle's ghosts, the other ghosts of the walls by
    column, and the solids' ghosts in their given order. In this order gathers are faster, since they read
    from nearby memory.
    """
    ghosts = join(parts)
    owner = np.repeat(np.arange(len(parts)), [len(part.x) for part in parts])
    first = np.minimum(np.arange(len(owner)), kept)
    # ghosts of a solid follow its outline and are not sorted, since rounding could swap two in one column
    column, row = (np.where(owner > 0, 0.0, ghosts.x[:, axis]) for axis in (0, -1))
    order = np.lexsort((row, column, ~ghosts.moves, owner, first))
    return GhostSet(*(a[order] for a in ghosts)), owner[order]


def _tank(
    filling: AbstractFilling, box: Box, regions: Regions, dx: float, layers: int, radius: float
) -> tuple[Images, GhostSet]:
    """Images and ghosts of a tank's walls, on a lattice behind the walls.

    With `MirrorImages`, these ghosts only fill the rows that are reserved for images of particles.

    **Raises** ValueError if a tank with a platform is not two-dimensional or lacks an end wall or a floor.
    """
    if regions.platforms and (len(box.low) != 2 or not box.walls[0, 1] or not box.walls[-1, 0]):
        raise ValueError(f"sides = {box.sides}: a platform needs a 2-D tank with an end wall and a floor")
    if isinstance(filling, MirrorImages):
        images = Images.of(box, regions.platforms, dx, radius)
        return images, images.empty_rows(box, radius)
    if box.far_moves:
        raise ValueError(f"filling = {type(filling).__name__}: a far end that moves needs MirrorImages")
    ghosts = box_ghosts(box, dx, layers)
    for platform in regions.platforms:
        ghosts = cut_by_platform(ghosts, box, platform, regions, dx, layers)
    return Images(), ghosts


def _rows(parts: Sequence[GhostSet]) -> tuple[tuple[int, int], ...]:
    """Index of the first ghost, and of the ghost after the last, of every part but the first."""
    ends = [int(end) for end in np.cumsum([len(part.x) for part in parts])]
    return tuple(itertools.pairwise(ends))


def _checked(
    filling: AbstractFilling, moving: Sequence[AbstractShape], every: Sequence[AbstractShape]
) -> AbstractFilling:
    """Checks that the filling suits the solids, and returns the filling.

    **Raises** ValueError if there are solids and the filling is not `DummyParticles`, or if a thin plate is
    among the moving shapes.
    """
    if every and not isinstance(filling, DummyParticles):
        raise ValueError(
            f"filling = {type(filling).__name__}: solids need DummyParticles, since ghosts of solids have "
            "no mirror images in the water"
        )
    if any(shape.dividers() for shape in moving):
        raise ValueError("shapes: a thin plate cannot move; pass it in fixed_shapes")
    return filling


def _of_solids(
    shapes: Sequence[AbstractShape], regions: Regions, box: Box, dx: float, layers: int
) -> Iterator[GhostSet]:
    """Yields the dummy particles of every solid, as ghosts."""
    for shape in shapes:
        others = [one for one in shapes if one is not shape]
        yield solid_ghosts(shape, regions, box, others, dx, layers)


def _with_walls_behind(
    parts: list[GhostSet], box: Box, fixed_shapes: Sequence[AbstractShape]
) -> list[GhostSet]:
    """Assigns the tank's ghosts behind a fixed solid to that solid, for each fixed solid that touches a wall.

    `parts`: ghosts of the tank, of the solids that may move, and of the `fixed_shapes`, in this order.
    """
    parts = list(parts)
    for k, shape in enumerate(fixed_shapes, len(parts) - len(fixed_shapes)):
        tank = parts[0]
        on_wall = np.clip(tank.x, box.low, box.high)
        behind = (np.abs(on_wall - tank.x).max(axis=1) > 0) & ~tank.moves
        behind &= at_points(shape.distance, on_wall) < AT_WALL
        parts[0] = GhostSet(*(a[~behind] for a in tank))
        parts[k] = join([parts[k], GhostSet(*(a[behind] for a in tank))])
    return parts


def _in_the_tank(
    box: Box, regions: Regions, thin_wall: AbstractThinWall, dx: float, layers: int, imaged: bool
) -> Iterator[GhostSet]:
    """Yields the ghosts of the platform and plates.

    If the tank's walls have mirror images (`imaged`), the ghosts in the corners between the platform and the
    walls are included.

    **Raises** ValueError if a plate is too thin.
    """
    for platform in regions.platforms:
        yield platform_ghosts(box, platform, regions, dx, layers)
        if imaged:  # an image in these corners would be that of a lattice ghost of the platform, not of water
            whole = cut_by_platform(box_ghosts(box, dx, layers), box, platform, regions, dx, layers)
            behind = (whole.x[:, 0] > platform.start) & (whole.x[:, -1] < platform.height)
            yield GhostSet(*(a[behind] for a in whole))
    for plate in regions.plates:
        yield plate_ghosts(box, plate, thin_wall, regions, dx, layers)


def _seen_by_nodes(ghosts: GhostSet, regions: Regions) -> np.ndarray:
    """Bit mask, for each node, of the particles that the node uses.

    If the `node_sees` of a ghost is -1, its node uses the particles that the node's region sees.
    """
    _, sees = region_bits(regions, ghosts.node)
    plain = sees & ((1 << regions.count) - 1)
    return np.where(ghosts.node_sees < 0, plain, ghosts.node_sees)


def _shear(ghosts: GhostSet, owner: np.ndarray, slip: FreeSlip | NoSlip) -> np.ndarray:
    """Factors `[G, D]` of the velocity in the viscous force.

    The paddle and solids are free-slip whatever the slip at the walls (Zhu et al. 2020, section 2.4).
    """
    tangential = np.where(owner[:, None] > 0, 1.0, np.minimum(ghosts.mirror, slip.tangential))
    normal = (ghosts.mirror == -1.0) | ghosts.moves[:, None]
    return np.where(normal, ghosts.mirror, tangential)
