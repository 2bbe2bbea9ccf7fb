"""Linear theory of a case with floating or jointed bodies in regular waves: motions, pressures and power.

Water, bodies, links and chambers are set up from the case's sections, without particles. The equilibrium in
still water is found first. Small motions about it follow from `waves.panels` and `waves.linear_bodies`.
"""

from __future__ import annotations

import functools
import itertools
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import shapely
from numpy.typing import NDArray

from jaxsph.case.body_sections import PLANAR as MOTIONS
from jaxsph.case.geometry import Geometry
from jaxsph.case.resting import Resting
from jaxsph.case.sections import DEVICE_CHAMBER, ONLY_BODY, Sections
from jaxsph.case.settling import given_waves
from jaxsph.errors import CaseError
from jaxsph.model.links import Link
from jaxsph.model.part import name_of
from jaxsph.problem.results import amplitude
from jaxsph.waves.linear_bodies import Compliance, Damping, LinearBodies, SmallMotion, linear_motion
from jaxsph.waves.panels import Chamber, Hull, Section, hydrodynamics

__all__ = [
    "LinearMotions",
    "SmallMotions",
    "has_free_bodies",
    "linear_motions",
    "small_motions",
    "why_no_motions",
]

STEEP = np.deg2rad(60.0)
"""Smallest inclination of a solid's face at the still water surface, rad; waves break on flatter faces."""
BENT = 0.2
"""Largest deviation of a link's elastic force from linearity, relative to its linear change (-)."""
AIR = ("P_a", "flow", "chamber_level")
"""Names of a chamber's oscillations: air pressure (Pa), flow (m2/s), and level (m) in the chamber's frame."""
CLOSED = 1e12
"""Resistance that represents a closed chamber, Pa s/m2."""

Real = NDArray[Any]
"""Array of real numbers."""


@dataclass(frozen=True, eq=False)
class LinearMotions:
    """Linear response of a case's bodies to its regular waves, as complex amplitudes a of
    Re(a exp(-i omega t)).

    The crest of the incident wave is at the paddle, x = 0, at t = 0. All values are per metre of width.
    """

    response: LinearBodies
    """Response of water, bodies, links and chambers."""
    motions: dict[str, NDArray[Any]]
    """Surge (m), heave (m) and pitch (rad) of every moving body's pivot, by the body's name."""
    rest: dict[str, Real]
    """Displacements (m, m, rad) from the given position to the equilibrium in still water, by the
    body's name."""
    relative: dict[str, NDArray[Any]]
    """Coordinates of every moving body's joint, by the body's name, m or rad."""
    extensions: dict[str, complex]
    """Extensions of all links except moorings, whose extension is a vector, by the link's name, m or rad."""
    forces: dict[str, complex]
    """Complex amplitudes of the forces (N/m) or moments (N) of all links except moorings, by name."""
    powers: dict[str, float]
    """Mean power of every power take-off of links and chambers, by its name, W/m."""
    swings: dict[str, complex]
    """Complex amplitudes of the oscillations of bodies, links and chambers, by their names in a model."""

    @property
    def results(self) -> dict[str, float]:
        """Values of linear theory, by the names of a run's results."""
        a, sizes = 0.5 * self.response.H, {name: float(abs(x)) for name, x in self.swings.items()}
        found = {amplitude(name): size for name, size in sizes.items()}
        over_waves = (name for name in sizes if not name.startswith(("P_a", "flow")))
        found |= {f"rao_{name}": sizes[name] / a for name in over_waves}
        power = {"xi": self.xi, "P_pto": self.P_pto, "P_owc": self.P_pto}
        return found | (power if self.powers else {})

    @property
    def levels(self) -> dict[str, list[float]]:
        """Extremes of the bodies' heave and pitch and of the chambers' pressure, flow and level, and mean
        powers, by the names of the series."""
        air = {name: float(abs(x)) for name, x in self.swings.items() if name.startswith(AIR)}
        found = {name: [-size, size] for name, size in air.items()}
        for body in self.motions:
            for index, motion in ((1, "heave"), (2, "pitch")):
                name = name_of(motion, body, ONLY_BODY)
                if name in self.swings:
                    size, rest = abs(self.swings[name]), self.rest[body][index]
                    found[name] = [float(rest - size), float(rest + size)]
        return found | {f"power_{name}": [power] for name, power in self.powers.items()}

    @property
    def P_pto(self) -> float:
        """Mean absorbed power, W/m."""
        return float(sum(self.powers.values()))

    @property
    def xi(self) -> float:
        """Efficiency: ratio of absorbed to incident power (-)."""
        return self.P_pto / self.response.P_inc


@dataclass(frozen=True, eq=False)
class SmallMotions:
    """Bodies and links of a case about their equilibrium in still water, and the section of the water."""

    section: Section
    bodies: SmallMotion
    links: dict[str, Link]
    """Links of `bodies.dampings` by name."""
    extensions: dict[str, float]
    """Extensions of the same links at the equilibrium, m or rad."""
    stiffness: dict[str, float]
    """Stiffness of the same links there, N/m or N m."""
    swings: dict[str, Real]
    """Oscillations of the bodies `[n]` per unit change of each free coordinate, by their names in a model."""


def has_free_bodies(case: Sections) -> bool:
    """Whether a case has waves, and a body with at least one free motion."""
    return case.waves is not None and any(one.free for one in case.every_body.values())


def linear_motions(case: Sections) -> LinearMotions:
    """Linear theory of a case's bodies, with links and chambers, in the case's regular waves.

    The theory includes other solids, and also the end wall unless there is a sponge in front of it. It
    assumes that the paddle absorbs all waves that return to it. Results are cached. **Raises** CaseError,
    with the reason, for a case that linear theory does not cover.
    """
    return _found(type(case), case.model_dump_json(exclude_none=True))[0]


def small_motions(case: Sections) -> SmallMotions:
    """Bodies and links of a case about their equilibrium. **Raises** CaseError as `linear_motions`."""
    return _found(type(case), case.model_dump_json(exclude_none=True))[1]


def why_no_motions(case: Sections) -> str:
    """Reason why linear theory does not cover the bodies of a case in waves; empty if the theory covers
    them."""
    try:
        linear_motions(case)
    except CaseError as error:
        return str(error)
    return ""


@functools.lru_cache(maxsize=16)
def _found(of: type[Sections], text: str) -> tuple[LinearMotions, SmallMotions]:
    """`linear_motions` and `small_motions` of a case from its JSON text."""
    case = of.model_validate_json(text)
    if reason := _not_covered(case):
        raise CaseError(reason)
    geometry = Geometry.of(case)
    if reason := _sloping(geometry):
        raise CaseError(reason)
    try:
        with jax.enable_x64(True):
            response = _Response(case, Resting(case, geometry))
            small = response.small()
            return response.found(small), small
    except ValueError as error:
        raise CaseError(str(error)) from None


def _not_covered(case: Sections) -> str:
    """Reason, by the keys of a case, why linear theory does not cover its bodies; empty if the theory
    covers them."""
    if case.waves is None or not has_free_bodies(case):
        return "linear theory of bodies needs waves, and a body with a free motion (give free)"
    if case.waves.kind != "regular":
        return f'waves.kind = "{case.waves.kind}": linear theory of bodies covers regular waves only'
    if case.dim == 3:
        return "tank.width: the tank has three dimensions"
    if case.g == 0.0:
        return "g = 0: there are no waves"
    if case.tank.column is not None:
        return "tank.column: the water is not at rest at the start"
    for name, body in case.every_body.items():
        if body.motion is not None:
            return f"{case.body_key(name)} has a prescribed motion"
        given = zip(body.velocity, MOTIONS, strict=True)
        if kept := [motion for v, motion in given if v and motion not in body.free]:
            return f"{case.body_key(name)}.velocity prescribes the motion in {', '.join(kept)}"
    if case.duct:
        return f"duct.{next(iter(case.duct))} joins two chambers"
    for name, chamber in case.chambers.items():
        pto, key = chamber.pto, case.chamber_key(name, "pto")
        if pto is None:
            continue
        if pto.P_a is not None or pto.curve is not None:
            return f"{key} is neither a linear nor a quadratic turbine"
        if pto.phase is not None:
            return f"{key}.phase varies the damping over the wave"
        if pto.has_relief:
            return f"{key} has a relief valve"
    return ""


def _sloping(geometry: Geometry) -> str:
    """Reason why a case is refused, if a fixed solid slopes so gently at the surface that waves break;
    empty otherwise."""
    for name, shape in geometry.solids.items():
        for part in shapely.get_parts(shape.region()):
            corners = np.asarray(part.exterior.coords)
            for a, b in itertools.pairwise(corners):
                low, high = min(a[1], b[1]), max(a[1], b[1])
                rise, run = abs(b - a)[::-1]
                if low < geometry.depth <= high and np.arctan2(rise, run) < STEEP:
                    return (
                        f"solid.{name} slopes at the water surface by less than {np.rad2deg(STEEP):.0f} "
                        "degrees, and waves break on such a slope"
                    )
    return ""


class _Response:
    """Linear response of bodies about their equilibrium; use it with double precision enabled."""

    def __init__(self, case: Sections, resting: Resting) -> None:
        """Response of a case's bodies to its waves; `resting`: the bodies at their equilibrium."""
        self.case, self.resting = case, resting

    def found(self, small: SmallMotions) -> LinearMotions:
        """Response to the case's waves. **Raises** ValueError if linear theory does not cover the case."""
        case, waves = self.case, given_waves(self.case)
        water = hydrodynamics(small.section, 2.0 * np.pi / waves.period, case.fluid.rho0, case.g)
        found = linear_motion(water, small.bodies, waves.height)
        return self._named(found, self._ways() @ found.coordinates, list(small.links))

    def small(self) -> SmallMotions:
        """Bodies and links about their equilibrium."""
        free, ways = self.resting.free, self._ways()
        hulls, carriers = self._hulls()
        dampings, damping = self._dampings()
        bodies = SmallMotion(
            mass=np.asarray(self.resting.posture.mass)[np.ix_(free, free)],
            stiffness=self.resting.stiffness,
            damping=damping,
            jacobian=np.concatenate([ways[index] for index in carriers]),
            dampings=tuple(dampings.values()),
            chambers=tuple(_turbine(one) for one in self.case.chambers.values()),
        )
        every = {link.name: link for link in self.resting.mechanism.links}
        swings = self._swings(ways, self._by_joint(np.eye(int(free.sum()))))
        links = {name: every[name] for name in dampings}
        extensions = {name: float(self.resting.posture.extensions[name]) for name in dampings}
        stiffness = {name: self._stiffness(link) for name, link in links.items()}
        return SmallMotions(self._section(hulls), bodies, links, extensions, stiffness, swings)

    def _ways(self) -> Real:
        """Motions of all bodies `[B, 3, n]` per unit change of each free coordinate."""
        return np.asarray(self.resting.posture.ways)[:, :, self.resting.free]

    def _by_joint(self, free: NDArray[Any]) -> list[NDArray[Any]]:
        """Coordinates of every body's joint, from the free coordinates `[n, ...]`."""
        every = np.zeros((len(self.resting.free), *free.shape[1:]), free.dtype)
        every[self.resting.free] = free
        return np.split(every, np.cumsum([body.joint.size for body in self.resting.mechanism.bodies])[:-1])

    def _hulls(self) -> tuple[list[Hull], list[int]]:
        """Hulls of all bodies in their poses, and the index of each hull's body."""
        hulls, carriers, depth = [], [], self.resting.geometry.depth
        for index, body in enumerate(self.resting.mechanism.bodies):
            pose, solid = self.resting.poses[body.name], self.resting.geometry.solids.get(body.name)
            region = self.resting.region(body, pose) if solid is None else solid.region()
            if not body.fixed and region.bounds[1] < 1e-6:
                raise ValueError(f"the {body.name} is on the bed in still water")
            x, z = np.asarray(body.pivot) + pose[:2]
            for number, part in enumerate(shapely.get_parts(region)):
                corners = np.asarray(part.exterior.coords)[:-1] - (0.0, depth)
                name = body.name if number == 0 else f"{body.name}, part {number + 1}"
                hulls.append(Hull(name, tuple(map(tuple, corners)), (float(x), float(z - depth))))
                carriers.append(index)
        return hulls, carriers

    def _section(self, hulls: list[Hull]) -> Section:
        """Vertical section of the water with hulls and chambers; the air of a chamber in a body moves with
        the body."""
        chambers = []
        for name, stretch in self.resting.geometry.stretches.items():
            shift = float(self.resting.poses[stretch.carrier][0]) if stretch.carrier else 0.0
            ends = stretch.first + shift, stretch.last + shift
            chambers.append(Chamber(f"air of {name}", *ends, stretch.carrier))
        end = None if self.case.sponge is not None else self.resting.geometry.length
        return Section(self.resting.geometry.depth, tuple(hulls), end, tuple(chambers))

    def _dampings(self) -> tuple[dict[str, Damping], Real]:
        """Rate-dependent forces of all links except moorings, by name, and damping matrix of the moorings."""
        found, total, t = {}, np.zeros((int(self.resting.free.sum()),) * 2), jnp.zeros(())
        for link in self.resting.mechanism.links:
            way = np.asarray(self.resting.posture.slopes[link.name])[..., self.resting.free]
            s, own = self.resting.posture.extensions[link.name], self.resting.parts[link.name].own
            if s.ndim == 0:
                found[link.name] = Damping(way, _Rate(link, own, s))
                continue
            slope = jax.jacfwd(functools.partial(link.law.force, own, s, t=t))(jnp.zeros_like(s))
            total -= way.T @ np.asarray(slope) @ way
        return found, total

    def _stiffness(self, link: Link) -> float:
        """Stiffness of a link at its equilibrium extension, N/m or N m."""
        own, rest = self.resting.parts[link.name].own, self.resting.posture.extensions[link.name]
        return float(jax.grad(jax.grad(link.law.stored, argnums=1), argnums=1)(own, rest))

    def _force(self, link: Link, s: complex, damping: float) -> complex:
        """Complex amplitude (N/m or N) of a link's force for the amplitude s (m or rad) of its extension.

        `damping`: damping of the linearised link. **Raises** ValueError if the elastic force is not linear.
        """
        own, rest = self.resting.parts[link.name].own, self.resting.posture.extensions[link.name]
        at = rest + abs(s) * jnp.array([-1.0, 0.0, 1.0])
        slope = jax.grad(link.law.stored, argnums=1)
        low, middle, high = np.asarray(jax.vmap(lambda one: slope(own, one))(at))
        stiffness = self._stiffness(link)
        linear = stiffness * abs(s)
        if max(abs(high - middle - linear), abs(middle - low - linear)) > BENT * abs(linear) + 1e-9:
            raise ValueError(
                f"the elastic force of {link.name} is not linear for the amplitude that linear theory "
                f"predicts, {abs(s):.3g} {link.ends.unit}: the link becomes slack, or reaches its end stops"
            )
        return -(stiffness - 2j * np.pi / given_waves(self.case).period * damping) * s

    def _named(self, found: LinearBodies, moved: NDArray[Any], links: list[str]) -> LinearMotions:
        """Response to the waves, under the names used in the case and in its results.

        `moved`: motions of all bodies `[B, 3]`, m or rad.
        """
        every = {link.name: link for link in self.resting.mechanism.links}
        extensions = dict(zip(links, found.extensions, strict=True))
        dampings = dict(zip(links, found.dampings, strict=True))
        forces = {name: self._force(every[name], s, dampings[name]) for name, s in extensions.items()}
        taken = zip(links, found.link_power, strict=True)
        powers = {name: float(power) for name, power in taken if every[name].harvests}
        chambers = zip(self.case.chambers, found.chamber_power, strict=True)
        powers |= {_called("pto", n): float(power) for n, power in chambers if self.case.chambers[n].pto}
        split = self._by_joint(found.coordinates)
        bodies = [(i, body) for i, body in enumerate(self.resting.mechanism.bodies) if not body.fixed]
        return LinearMotions(
            found,
            motions={body.name: moved[i] for i, body in bodies},
            rest={body.name: self.resting.poses[body.name] for _, body in bodies},
            relative={body.name: split[i] for i, body in bodies},
            extensions=extensions,
            forces=forces,
            powers=powers,
            swings=self._swings(moved, split) | self._of_links(extensions, forces) | self._air(found),
        )

    def _swings(self, moved: NDArray, split: list[NDArray]) -> dict[str, Any]:
        """Motions of the bodies, by the names of their oscillations."""
        swings = {}
        for body, motions, joint in zip(self.resting.mechanism.bodies, moved, split, strict=True):
            values = dict(zip(MOTIONS, motions, strict=True))
            values |= {f"relative_{name}": x for name, x in zip(MOTIONS, joint, strict=True)}
            asked = {} if body.fixed else body.oscillations(2)
            swings |= {body.called(n): x for n, x in values.items() if body.called(n) in asked}
        return swings

    def _of_links(self, extensions: dict[str, complex], forces: dict[str, complex]) -> dict[str, complex]:
        """Extensions and forces of the links, by the names of their oscillations."""
        links = [link for link in self.resting.mechanism.links if link.name in forces]
        swings = {link.called("link_force"): forces[link.name] for link in links}
        return swings | {link.called("link_extension"): extensions[link.name] for link in links}

    def _air(self, found: LinearBodies) -> dict[str, complex]:
        """Amplitudes of pressure, flow and level of every chamber, by the names of their oscillations."""
        swings = {}
        for name, P_a, q in zip(self.case.chambers, found.P_a, found.q, strict=True):
            level = 1j * q / (found.water.omega * self.resting.geometry.stretches[name].surface)
            values = zip(AIR, (P_a, q, level), strict=True)
            swings |= {_called(what, name): value for what, value in values}
        return swings


class _Rate(NamedTuple):
    """Force of a link at its equilibrium extension, as a function of the extension's rate."""

    link: Link
    own: Any
    s: jax.Array

    def __call__(self, v: Real) -> Real:
        """Force (N or N m) at rates v `[K]` (m/s or rad/s)."""
        with jax.enable_x64(True):
            each = jax.vmap(lambda one: self.link.law.force(self.own, self.s, one, jnp.zeros(())))
            return np.asarray(each(jnp.asarray(v)))


def _turbine(section: Any) -> Compliance:
    """Turbine and air of a chamber's section; a chamber without a turbine is closed."""
    give = 0.0 if section.air is None else section.air.give
    if section.pto is None:
        return Compliance(CLOSED, give=give)
    return Compliance(section.pto.resistance or 0.0, section.pto.quadratic or 0.0, give)


def _called(what: str, chamber: str) -> str:
    """Name of a chamber's reading, as `AbstractPart.called` makes it."""
    return name_of(what, chamber, DEVICE_CHAMBER)
