"""Division of the water around thin walls into regions that see different ghosts.

Particles on one side of a wall thinner than the kernel's support must not interact with particles on the
other side (Zhu et al. 2020, section 2.4.1). Static boolean matrices define which regions and which sets of
ghosts each region sees. The matrices are packed into bit masks that the neighbour search applies.
"""

from __future__ import annotations

import abc
from collections.abc import Iterable, Sequence
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxsph.core.arrays import Array, Components, Float, Int, columns
from jaxsph.core.points import at_points
from jaxsph.solids.box import AnyPlate, LeaningPlate, Platform, WallPlate
from jaxsph.solids.shapes import AbstractShape

PLAIN_BIT = 30
"""Index of the kind bit of ordinary ghosts; the lower bits belong to regions and to other ghost sets."""
PLAIN = 1 << PLAIN_BIT
"""Kind bit of an ordinary wall's ghosts, which every region sees."""


PLATFORM_SETS = ("top", "front")
"""Names of a platform's ghost sets, one per face."""


SETS = ("left", "right", "tip")
"""Names of a thin wall's ghost sets, one per face."""


class AbstractDivision(eqx.Module):
    """Division of the water around a plate into regions (Zhu et al. 2020, section 2.4.1.2).

    `region` gives a particle's region; the matrices define which regions see each other, which ghost sets a
    region sees, and which regions the interpolation nodes of a set may use. The paper's figure was not
    available, so the description of each division states how the section was interpreted.
    """

    regions: eqx.AbstractClassVar[tuple[str, ...]]
    """Names of the regions."""
    water: eqx.AbstractClassVar[tuple[str, ...]]
    """Names of the regions that each region sees, separated by spaces."""
    ghosts: eqx.AbstractClassVar[tuple[str, ...]]
    """Ghost set, one of `SETS`, that each region sees."""
    nodes: eqx.AbstractClassVar[tuple[tuple[str, ...], ...]]
    """Regions whose water the interpolation nodes of each of `SETS` use."""

    @abc.abstractmethod
    def region(self, x: Components, plate: AnyPlate) -> Int[Array, " N"]:
        """Region of every particle at x (m), as an index into `regions`."""

    def water_mask(self) -> np.ndarray:
        """Symmetric mask `[regions, regions]`, True where particles of the two regions interact."""
        return np.array([[b in seen.split() for b in self.regions] for seen in self.water])

    def ghost_mask(self) -> np.ndarray:
        """Mask `[regions, sets]`, True where particles of the region see ghosts of the set."""
        return np.array([[s == seen for s in SETS] for seen in self.ghosts])

    def node_mask(self) -> np.ndarray:
        """Mask `[sets, regions]`, True where nodes of the set use particles of the region."""
        return np.array([[r in used for r in self.regions] for used in self.nodes])


class HorizontalDivision(AbstractDivision):
    """Division (b), the default, into the water left of the plate, right of the plate, and below the tip."""

    regions: ClassVar[tuple[str, ...]] = ("left", "right", "below")
    water: ClassVar[tuple[str, ...]] = ("left below", "right below", "left right below")
    ghosts: ClassVar[tuple[str, ...]] = ("left", "right", "tip")
    nodes: ClassVar[tuple[tuple[str, ...], ...]] = (("left",), ("right",), ("below",))

    def region(self, x, plate):
        """See `AbstractDivision`."""
        across, past = plate.across(x), plate.past(x)
        side = jnp.where(across < 0, 0, 1)
        # A particle pressed slightly into the tip still sees the tip's ghosts, which push it out.
        under = (jnp.abs(across) < 0.5 * plate.thickness) & (past > -plate.thickness)
        return jnp.where(under | (past > 0), 2, side).astype(jnp.int32)


class DiagonalDivision(AbstractDivision):
    """Division (a) into the water left of the plate, right of the plate, and in a wedge below the tip.

    The wedge lies between the bisectors of the two corners of the plate's tip.
    """

    regions: ClassVar[tuple[str, ...]] = ("left", "right", "below")
    water: ClassVar[tuple[str, ...]] = ("left below", "right below", "left right below")
    ghosts: ClassVar[tuple[str, ...]] = ("left", "right", "tip")
    nodes: ClassVar[tuple[tuple[str, ...], ...]] = (("left",), ("right",), ("below",))

    def region(self, x, plate):
        """See `AbstractDivision`."""
        across = plate.across(x)
        side = jnp.where(across < 0, 0, 1)
        return jnp.where(jnp.abs(across) - 0.5 * plate.thickness < plate.past(x), 2, side).astype(jnp.int32)


class FivePartDivision(AbstractDivision):
    """Division (c) into five regions: water left and water right of the plate, each divided at the level of
    the tip, and water under the plate."""

    regions: ClassVar[tuple[str, ...]] = ("left", "right", "below", "below_left", "below_right")
    water: ClassVar[tuple[str, ...]] = (
        "left below below_left",
        "right below below_right",
        "left right below below_left below_right",
        "left below below_left below_right",
        "right below below_left below_right",
    )
    ghosts: ClassVar[tuple[str, ...]] = ("left", "right", "tip", "left", "right")
    nodes: ClassVar[tuple[tuple[str, ...], ...]] = (("left",), ("right",), ("below",))

    def region(self, x, plate):
        """See `AbstractDivision`."""
        across = plate.across(x)
        side = jnp.where(across < 0, 0, 1)
        below = jnp.where(jnp.abs(across) < 0.5 * plate.thickness, 2, 3 + side)
        return jnp.where(plate.past(x) > 0, below, side).astype(jnp.int32)


class Regions(eqx.Module):
    """Regions of the water in a tank, and bit masks of the regions and ghosts that each region sees.

    The dividers are the plates and the platform. Every plate divides the water by `division`; a platform
    divides the water into the part above its top and the part in front. A region is one combination of these
    parts. Two regions see each other if the divisions of all plates allow this. Whether a region sees
    the ghosts of a face depends only on the region's place relative to the divider of that face. The
    water above a platform and the water in front of it interact, but only the water in front of a face sees
    the ghosts of that face.

    **Raises** ValueError if the regions and ghost sets need more bits than an integer has.
    """

    plates: tuple[WallPlate, ...]
    """Thin plates."""
    division: AbstractDivision
    """Division of the water around each plate."""
    platforms: tuple[Platform, ...] = eqx.field(static=True, default=())
    """Raised beds, at most one."""
    leaning: tuple[LeaningPlate, ...] = eqx.field(static=True, default=())
    """Thin plates at any inclination."""

    @classmethod
    def of(
        cls,
        plates: Sequence[WallPlate],
        division: AbstractDivision,
        platform: Platform | None,
        shapes: Iterable[AbstractShape],
    ) -> Regions:
        """Builds the regions of a tank with upright `plates`, a `platform` and solids of these `shapes`."""
        leaning = tuple(plate for shape in shapes for plate in shape.dividers())
        return cls(tuple(plates), division, () if platform is None else (platform,), leaning)

    def __check_init__(self) -> None:
        """Checks that every region and ghost set has a bit."""
        bits = self.count + len(self.sets)
        if bits > PLAIN_BIT:
            bed = " and a raised bed" if self.platforms else ""
            fewer = ", or division (b)" if len(self.division.regions) > 3 else ""
            raise ValueError(
                f"{len(self.thin)} plates{bed} make {self.count} regions and {len(self.sets)} ghost sets, "
                f"together more than the {PLAIN_BIT} bits available: use fewer plates{fewer}"
            )

    @property
    def thin(self) -> tuple[AnyPlate, ...]:
        """All thin plates, the upright ones first."""
        return (*self.plates, *self.leaning)

    @property
    def _parts(self) -> tuple[int, ...]:
        """Number of parts into which each divider divides the water."""
        return (len(self.division.regions),) * len(self.thin) + (2,) * len(self.platforms)

    @property
    def count(self) -> int:
        """Number of regions of the water."""
        return int(np.prod(self._parts, initial=1))

    @property
    def sets(self) -> tuple[tuple[int, str], ...]:
        """Ghost sets of plates and platforms, in the order of their bits: (index of divider, face)."""
        plates = [(k, name) for k in range(len(self.thin)) for name in SETS]
        return (*plates, *((len(self.thin), name) for _ in self.platforms for name in PLATFORM_SETS))

    def index(self, x: Float[Array, "N D"]) -> Int[Array, " N"]:
        """Region of every particle at x (m), as an integer below `count`."""
        region, stride = jnp.zeros(x.shape[0], jnp.int32), 1
        for plate in self.thin:
            region = region + stride * self.division.region(columns(x), plate)
            stride *= len(self.division.regions)
        for platform in self.platforms:
            region = region + stride * platform.in_front(columns(x)).astype(jnp.int32)
        return region

    def kind(self, region: Int[Array, " N"]) -> Int[Array, " N"]:
        """Kind bit of particles in these regions, which represents their region in every mask."""
        return jnp.left_shift(jnp.int32(1), region)

    def sees(self, region: Int[Array, " N"]) -> Int[Array, " N"]:
        """Bits of the particles and ghosts that particles in these regions see."""
        return jnp.asarray(self._packed())[region]

    def _part(self, divider: int) -> np.ndarray:
        """For each region, the index `[count]` of the part that contains it, among the parts made by one
        divider."""
        stride = int(np.prod(self._parts[:divider], initial=1))
        return np.arange(self.count) // stride % self._parts[divider]

    def _packed(self) -> np.ndarray:
        """Bits `[count]` of the particles and ghosts that each region sees."""
        water = np.ones((self.count, self.count), bool)
        for k in range(len(self.thin)):
            part = self._part(k)
            water &= self.division.water_mask()[np.ix_(part, part)]
        ghosts = [self._seen(divider, name) for divider, name in self.sets]
        bits = np.column_stack([water, *ghosts])
        return (bits @ (1 << np.arange(bits.shape[1])) | PLAIN).astype(np.int32)

    def _seen(self, divider: int, name: str) -> np.ndarray:
        """Mask `[count]` of the regions that see the ghosts of a divider's face, given by the face's name."""
        part = self._part(divider)
        if name in PLATFORM_SETS:
            return part == PLATFORM_SETS.index(name)
        return self.division.ghost_mask()[part, SETS.index(name)]

    def set_kind(self, which: int) -> int:
        """Kind bit of a ghost set, by its index in `sets`."""
        return 1 << (self.count + which)

    def node_sees(self, which: int) -> int:
        """Bits of the particles that the interpolation nodes of a ghost set use, by its index in `sets`."""
        divider, name = self.sets[which]
        part = self._part(divider)
        if name in PLATFORM_SETS:
            used = part == PLATFORM_SETS.index(name)
        else:
            used = self.division.node_mask()[SETS.index(name)][part]
        return int(used @ (1 << np.arange(self.count)))


def region_bits(regions: Regions, x: np.ndarray, dtype: Any = jnp.float32) -> tuple[np.ndarray, np.ndarray]:
    """Kind bits of particles at x (m), and bits of the particles and ghosts that they see."""
    return at_points(eqx.Partial(_bits, regions), x, dtype)


def _bits(regions: Regions, x: Float[Array, "N D"]) -> tuple[Int[Array, " N"], Int[Array, " N"]]:
    region = regions.index(x)
    return regions.kind(region), regions.sees(region)


class AbstractThinWall(eqx.Module):
    """Method of placing the ghosts of a thin plate."""

    division: eqx.AbstractVar[AbstractDivision]
    """Division of the water around the plate."""

    @abc.abstractmethod
    def check(self, plate: WallPlate, dx: float, layers: int) -> None:
        """Checks the plate's thickness for this method, at the spacing `dx` (m), for `layers` ghost layers.

        **Raises** ValueError if the plate is too thin.
        """

    @abc.abstractmethod
    def body(self, plate: WallPlate, dx: float, layers: int) -> tuple[tuple[float, float], ...]:
        """Extent of each ghost set in `SETS`, m: (across the plate, upwards from its tip)."""

    def tip_tangential(self, plate: WallPlate, dx: float, layers: int) -> float:
        """Tangential velocity of the ghosts at the plate's tip, divided by the water's (-)."""
        return 1.0


class RegionalGhosts(AbstractThinWall):
    """Separate ghosts of a thin wall for each region, to the depth of the kernel's support behind each face
    (Zhu et al. 2020, section 2.4.1).

    Only the water in front of a face sees the ghosts of that face. The ghosts may therefore lie in the plate,
    in the water behind the plate and on top of each other, and the plate may be as thin as half a spacing.
    """

    division: AbstractDivision = HorizontalDivision()

    def check(self, plate, dx, layers):
        """See `AbstractThinWall`."""
        if plate.thickness < 0.45 * dx:
            raise ValueError(
                f"wall_thickness = {plate.thickness:g} m is less than half a spacing (dx = {dx:g} m): "
                "the particles below the tip would not interact with the plate; use dx of at most "
                f"{2 * plate.thickness:g} m"
            )

    def body(self, plate, dx, layers):
        """See `AbstractThinWall`."""
        depth = layers * dx
        return ((depth, np.inf), (depth, np.inf), (plate.thickness, depth))

    def tip_tangential(self, plate, dx, layers):
        """See `AbstractThinWall`."""
        if not plate.is_thin(dx, layers):
            return 1.0
        # With the water's tangential velocity, the few ghosts of the tip would represent a flow out of the
        # plate's sides. In the OWC at dx = 0.02 m this spurious flow created 0.2 J/m of energy per period,
        # four times as much as is created with ghosts at rest.
        return 0.0


class MultiNodeGhosts(AbstractThinWall):
    """Thin-wall ghosts inside the plate only (Meringolo et al. 2015).

    The ghosts of different faces may share a position; the node of each ghost is in front of its face.
    The plate must be at least `layers` - 1 spacings thick; the kernel reaches `layers` layers of ghosts.
    """

    division: AbstractDivision = HorizontalDivision()

    def check(self, plate, dx, layers):
        """See `AbstractThinWall`."""
        needed = layers - 1
        if plate.thickness < (needed - 0.01) * dx:
            raise ValueError(
                f"wall_thickness = {plate.thickness:g} m has room for {plate.thickness / dx:.1f} layers of "
                f"ghosts at dx = {dx:g} m; multi-node ghosts need {needed}: use dx of at most "
                f"{plate.thickness / needed:.4g} m, or regional ghosts"
            )

    def body(self, plate, dx, layers):
        """See `AbstractThinWall`."""
        return ((plate.thickness, np.inf), (plate.thickness, np.inf), (plate.thickness, layers * dx))
