"""Solid walls: fixed ghost particles with interpolation nodes, and the regional sets of thin walls.

A ghost stands in the wall; its node is its mirror image in the water. Each step the water's pressure and
velocity are interpolated at the nodes and carried to the ghosts (Zhu et al. 2020, Eq. 18-20), which are
from then on ordinary sources of the pair sums. Around a wall thinner than the kernel the water is divided
into regions that see different ghosts and not each other (their section 2.4.1). Which region sees which
set is a static matrix of booleans, packed into bit masks that the neighbour search applies.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxsph.core.arrays import Array, Components, Float, Int, columns, dot, stacked
from jaxsph.core.pairs import (
    Pair,
    Period,
    Smoothing,
    pair_sum,
    pair_weights,
)
from jaxsph.model import laws
from jaxsph.model.interfaces import AbstractSolid
from jaxsph.solids.box import Box, FreeSlip, NoSlip, Platform, WallPlate
from jaxsph.solids.divisions import (
    AbstractThinWall,
    RegionalGhosts,
    Regions,
)
from jaxsph.solids.filling import (
    AbstractFilling,
    DummyParticles,
    MirrorNodes,
    NodeFit,
    interpolation_weight,
)
from jaxsph.solids.fixed import PlatformBed, TankWalls, ThinPlate
from jaxsph.solids.placement import (
    GhostSet,
    box_ghosts,
    cut_by_platform,
    joined,
    kernel_fill,
    lattice,
    plate_ghosts,
    platform_ghosts,
    sliding_velocity,
    solid_ghosts,
)
from jaxsph.solids.shapes import AbstractShape


class Ghosts(eqx.Module):
    """Ghost particles of all walls, their nodes, and how to fill them.

    Leaves never evolve: positions at rest, masks, mirror factors. Moving solids place their own rows anew at
    every step (`Model.walls_at`).
    """

    x: Float[Array, "G D"]
    node: Float[Array, "G D"]
    mirror: Float[Array, "G D"]
    """-1 for components normal to the wall, 1 for tangential ones (0 at a thin wall's tip)."""
    shear: Float[Array, "G D"]
    """The same with the slip factor for tangential components: what the viscous force sees."""
    full: Float[Array, " G"]
    """sum V W at the node were the tank full."""
    volume: Float[Array, " G"]
    """m^D."""
    kind: Int[Array, " G"]
    node_sees: Int[Array, " G"]
    regions: Regions
    paddle: tuple[int, ...] = eqx.field(static=True)
    """First and last index of the paddle's ghosts (they are stored together); () without one."""
    low: tuple[float, ...] = eqx.field(static=True)
    high: tuple[float, ...] = eqx.field(static=True)
    sides: tuple[str, ...] = eqx.field(static=True)
    """What bounds each axis, as in `Box`."""
    sliding: Float[Array, "G D"]
    """Velocity of walls that move along themselves, m/s; zero for others."""
    filling: AbstractFilling
    dummies: tuple[tuple[int, int], ...] = eqx.field(static=True)
    """For every solid of dummy particles, the index of its first ghost and of the one after its last."""

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
    ) -> Ghosts:
        """Places the ghosts of a tank and of plates in it, on the host; none where it has no walls.

        **Arguments**: `sliding`: velocities (m/s) of walls that move along themselves, by (axis, 0 for the
        low or 1 for the high end); only walls without slip drag the fluid with them. `platform`: a raised
        bed at the far end of a two-dimensional tank, its lengths whole numbers of spacings. `filling`: by
        default `MirrorNodes`. `shapes`: solids in the water, which need `DummyParticles`.
        (An argument for each thing that walls can be made of.)
        **Raises** ValueError for a plate too thin for the method chosen, or a wall that cannot slide so.
        """
        layers = int(np.ceil(float(smoothing.radius) / dx - 0.5))
        thin_wall = RegionalGhosts() if thin_wall is None else thin_wall
        regions = Regions(tuple(plates), thin_wall.division, () if platform is None else (platform,))
        filling = MirrorNodes() if filling is None else filling
        if shapes and not isinstance(filling, DummyParticles):
            raise ValueError("a solid needs walls of DummyParticles: its dummies have no mirror image")
        fixed = _fixed_ghosts(box, regions, thin_wall, dx, layers)
        dummies = [solid_ghosts(shape.dummies(dx, layers), dx) for shape in shapes]
        ghosts = joined([fixed, *dummies])
        ghosts = ghosts._replace(node=filling.nodes(ghosts.x, ghosts.node))
        # 0 for walls, 1 for the first solid of dummies, ...
        owner = np.repeat(np.arange(1 + len(shapes)), [len(part.x) for part in (fixed, *dummies)])
        # solids' last, the paddle's first, then by column: a gather from neighbours in memory is cheaper
        order = np.lexsort((ghosts.x[:, -1], ghosts.x[:, 0], ~ghosts.moves, owner))
        ghosts = GhostSet(*(a[order] for a in ghosts))
        # The paddle is free-slip whatever the tank's walls are (section 2.4), and so are dummies.
        tangential = np.where(owner[order, None] > 0, 1.0, np.minimum(ghosts.mirror, slip.tangential))
        normal = (ghosts.mirror == -1.0) | ghosts.moves[:, None]
        node_sees = _seen_by_nodes(ghosts, regions)
        full = _full(ghosts, node_sees, _brimful(box, regions, shapes, dx, layers), regions, smoothing)
        ends = [int(end) for end in np.cumsum([len(part.x) for part in (fixed, *dummies)])]
        count = int(ghosts.moves.sum())
        return cls(
            x=jnp.asarray(ghosts.x, dtype),
            node=jnp.asarray(ghosts.node, dtype),
            mirror=jnp.asarray(ghosts.mirror, dtype),
            shear=jnp.asarray(np.where(normal, ghosts.mirror, tangential), dtype),
            full=jnp.asarray(np.maximum(full, filling.least), dtype),
            volume=jnp.asarray(ghosts.volume, dtype),
            kind=jnp.asarray(ghosts.kind, jnp.int32),
            node_sees=jnp.asarray(node_sees, jnp.int32),
            regions=regions,
            paddle=(0, count) if count else (),
            low=box.low,
            high=box.high,
            sides=box.sides,
            sliding=jnp.asarray(sliding_velocity(ghosts.x, box, sliding or {}), dtype),
            filling=filling,
            dummies=tuple(itertools.pairwise(ends)),
        )

    @property
    def period(self) -> Period:
        """As `Box.period`."""
        return Box(self.low, self.high, sides=self.sides).period

    @property
    def width(self) -> float:
        """Of the tank across x and z, m; 1 in two dimensions, where everything is per metre."""
        return float(np.prod([b - a for a, b in zip(self.low[1:-1], self.high[1:-1], strict=True)]))

    def solids(self) -> tuple[AbstractSolid, ...]:
        """Solids at rest whose ghosts these are."""
        tank = TankWalls(self.low, self.high, self.sides, bool(self.paddle))
        return (tank, *map(ThinPlate, self.regions.plates), *map(PlatformBed, self.regions.platforms))

    @property
    def count(self) -> int:
        """Number of ghosts."""
        return self.x.shape[0]

    def fit(
        self,
        nodes: Float[Array, "G D"],
        water: dict,
        smoothing: Smoothing,
        table: Int[Array, "K G"],
    ) -> NodeFit:
        """Interpolation weights at the nodes."""
        return self.filling.fit(nodes, self.full, water, smoothing, table)

    def at_nodes(
        self,
        law,
        fit: NodeFit,
        nodes: Float[Array, "G D"],
        water: dict,
        smoothing: Smoothing,
        table: Int[Array, "K G"],
    ):
        """Interpolated values of `law(j)` (a pytree of fields of the water) at the nodes."""

        def weighted(pair: Pair, i, j):
            w = interpolation_weight(pair, i, j, smoothing.h)
            return jax.tree.map(lambda f: w * f, law(j))

        targets = {"x": columns(nodes), "a": fit.a, "b": fit.b}
        return pair_sum(weighted, smoothing, targets, water, table)

    def node_weights(
        self,
        fit: NodeFit,
        nodes: Float[Array, "G D"],
        water: dict,
        smoothing: Smoothing,
        table: Int[Array, "K G"],
    ) -> Float[Array, "K G"]:
        """The weights of `at_nodes`, zero at dry nodes, for `pairs.weighted_sum`."""

        def law(pair: Pair, i, j):
            return (), i["wet"] * interpolation_weight(pair, i, j, smoothing.h)

        wet = jnp.where(fit.wet > 0, 1.0, 0.0).astype(fit.wet.dtype)
        targets = {"x": columns(nodes), "a": fit.a, "b": fit.b, "wet": wet}
        return pair_weights(law, smoothing, targets, water, table)[1]

    def pressure(
        self,
        fit: NodeFit,
        at_node: Float[Array, " G"],
        x: Float[Array, "G D"],
        nodes: Float[Array, "G D"],
        body_force: Float[Array, "G D"],
    ) -> Float[Array, " G"]:
        """Eq. 19-20: the node's pressure plus the slope that balances the body force, Pa.

        `body_force` is rho0 (f - a_wall), N/m3.
        """
        reach = tuple(g - n - o for g, n, o in zip(columns(x), columns(nodes), fit.offset, strict=True))
        return at_node + dot(columns(body_force), reach)

    def velocity(
        self, at_node: Components, wall: Components, mirror: Float[Array, "G D"]
    ) -> Float[Array, "G D"]:
        """u_ghost = mirror u_node + (1 - mirror) u_wall, component by component (section 2.4)."""
        return stacked(
            [m * u + (1.0 - m) * w for m, u, w in zip(columns(mirror), at_node, wall, strict=True)]
        )


def _fixed_ghosts(
    box: Box, regions: Regions, thin_wall: AbstractThinWall, dx: float, layers: int
) -> GhostSet:
    """Ghosts of a tank's walls, of its platform and of its plates."""
    parts = [box_ghosts(box, dx, layers)]
    for platform in regions.platforms:
        if len(box.low) != 2 or not box.walls[0, 1] or not box.walls[-1, 0]:
            raise ValueError("a platform needs a two-dimensional tank with an end wall and a floor")
        parts = [
            cut_by_platform(parts[0], box, platform, regions, dx, layers),
            platform_ghosts(box, platform, regions, dx, layers),
        ]
    return joined([*parts, *(plate_ghosts(box, p, thin_wall, regions, dx, layers) for p in regions.plates)])


def _seen_by_nodes(ghosts: GhostSet, regions: Regions) -> np.ndarray:
    """Bits of the particles that every node uses: a set's own, or those that its own region sees."""
    own = regions.index(jnp.asarray(ghosts.node, jnp.float32))
    plain = np.asarray(regions.sees(own)) & ((1 << regions.count) - 1)
    return np.where(ghosts.node_sees < 0, plain, ghosts.node_sees)


def _brimful(
    box: Box, regions: Regions, shapes: Sequence[AbstractShape], dx: float, layers: int
) -> tuple[np.ndarray, np.ndarray]:
    """Places (m) and volumes of water that fills the tank to the brim and a little over it, as over every end
    without a wall."""
    beyond = np.where(box.walls.T, 0.0, (2 * layers - 1) * dx)
    under, over = tuple(box.low - beyond[0]), tuple(box.high + beyond[1])
    x, volume = lattice(under, over, dx, regions.plates, regions.platforms)
    for shape in shapes:
        outside = np.asarray(shape.distance(jnp.asarray(x, jnp.float32))) > 0
        x, volume = x[outside], volume[outside]
    return x, volume


def _full(
    ghosts: GhostSet,
    node_sees: np.ndarray,
    brim: tuple[np.ndarray, np.ndarray],
    regions: Regions,
    smoothing: Smoothing,
) -> np.ndarray:
    """Sum of V W at every node over the water `brim` that it sees."""
    x, volume = brim
    full, kind = np.zeros(len(ghosts.x)), np.asarray(regions.kind(regions.index(jnp.asarray(x, jnp.float32))))
    for mask in np.unique(node_sees):
        of, seen = node_sees == mask, (kind & mask) != 0
        h, reach = float(smoothing.h), smoothing.kernel.reach
        full[of] = kernel_fill(ghosts.node[of], x[seen], volume[seen], h, reach)
    return full


def wall_normals(
    ghosts: Float[Array, "G D"], water: dict, smoothing: Smoothing, table: Int[Array, "K G"]
) -> Float[Array, "G D"]:
    """Eq. 21: unit normals from the kernel's gradient over the water, pointing into it."""
    raw = pair_sum(laws.surface_vector, smoothing, {"x": columns(ghosts)}, water, table)
    length = jnp.sqrt(dot(raw, raw) + 1e-20)
    return stacked([c / length for c in raw])
