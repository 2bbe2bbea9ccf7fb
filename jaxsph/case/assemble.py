"""`assemble`: model and initial state from arrays of particles, walls and parts, on the host.

Everything that determines the shape of an array is fixed here: the number of particles, the sizes of the
neighbour tables, and the number of steps between two searches.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy  # which imports its subpackages on first use

from jaxsph.core.arrays import on_device
from jaxsph.core.pairs import Smoothing
from jaxsph.core.search.base import AbstractSearch, Grid, needed_capacity
from jaxsph.core.search.cells import Cells, grid_over
from jaxsph.model.air import AbstractDuct
from jaxsph.model.consistency import check_parts, part_states
from jaxsph.model.interfaces import (
    AbstractChamber,
    AbstractDamper,
    AbstractForce,
    ExactTangents,
    Model,
)
from jaxsph.model.links import Link
from jaxsph.model.solids import AbstractBody, AbstractWall
from jaxsph.model.state import Particles, Search, State, Status, Tally
from jaxsph.parts.rim import Rim
from jaxsph.schemes.base import AbstractParticleScheme
from jaxsph.solids.divisions import region_bits
from jaxsph.solids.images import Images
from jaxsph.solids.walls import Ghosts

SKIN = 0.2
"""Skin of the neighbour tables, in spacings dx: the distance by which the tables reach beyond the kernel's
support. A wider skin saves searches but makes every pair sum more expensive. A step of the OWC takes as
long with this skin as with a skin of 0.3 (time per step in `python -m experiments run bench_step`)."""


SEARCH = 1.0
"""Assumed cost of a neighbour search and the regularisation that accompanies it, in time steps. The actual
cost is half a step of the incompressible scheme, and 1.5 steps of the weakly compressible scheme."""


def assemble(
    x: np.ndarray,
    u: np.ndarray,
    *,
    scheme: AbstractParticleScheme,
    walls: Ghosts,
    dx: float,
    sample_dt: float,
    p: np.ndarray | None = None,
    volume: np.ndarray | float | None = None,
    g: Sequence[float] | np.ndarray | None = None,
    moving: Sequence[AbstractWall] = (),
    bodies: Sequence[AbstractBody] = (),
    links: Sequence[Link] = (),
    chambers: Sequence[AbstractChamber] = (),
    ducts: Sequence[AbstractDuct] = (),
    dampers: Sequence[AbstractDamper] = (),
    forces: Sequence[AbstractForce] = (),
    speed: float | None = None,
    dt_most: float | None = None,
    skin: float = SKIN,
    depth: float | None = None,
    settings: dict[str, int] | None = None,
    search_by: type[AbstractSearch] = Cells,
) -> tuple[Model, State]:
    """Builds the model and initial state of a fluid in a box from arrays. To build them from a case, use
    `case.build`.

    **Arguments**: positions `x` `[N, D]` (m) and velocities `u` `[N, D]` (m/s). The model has the
    precision of the scheme.
    `p` `[N]`: gauge pressure (Pa), by default 0. `volume` of each particle (m3; m2 in 2-D), by default dx^D.
    `walls`: ghosts from `Ghosts.build` of a `Box`; the scheme's smoothing must have the same `period`.
    `g` `[D]`: gravitational acceleration (m/s2), by default 0. Parts: `moving` walls (driven solids, and the
    paddle if the box has a paddle); `bodies` and `links` between them; `chambers`; `ducts` between chambers;
    `dampers`; `forces` in addition to g.
    `sample_dt`: time between samples (s), a multiple of the time step. `dt_most`: largest time step (s), by
    default the largest stable step. `speed`: largest expected speed (m/s), which determines how often
    neighbours are searched; by default the largest speed in `u`, or for a fluid at rest 0.3 times the largest
    speed that the scheme allows. `skin` of the neighbour tables, in spacings dx: a wider skin gives more
    pairs but fewer searches, and saves time if particles move far in a step.
    `depth`: still water depth (m), for the probes, the reflection and the pictures; by default the box's
    height.
    `settings`: as for `build`. `search_by`: class of the neighbour search, `Cells` or `JaxMD`.
    **Raises** ValueError if shapes of arrays do not match, if the periods of scheme and walls differ, if a
    period is not a multiple of dx or is shorter than 2.5 search radii, or if a particle is outside the box.
    """
    dtype = np.dtype(scheme.smoothing.h.dtype)
    x, u = np.asarray(x, float), np.asarray(u, float)
    n, dim = _checked(x, u, p, scheme, walls, dx)

    def leaf(a: Any) -> jax.Array:
        return on_device(a, dtype)

    m = float(scheme.rho0) * np.broadcast_to(dx**dim if volume is None else volume, n)
    g = np.zeros(dim) if g is None else np.array(g, float)
    skin = skin * dx
    stable = scheme.stable_dt(float(np.linalg.norm(g)), dim) if dt_most is None else dt_most
    if speed is None:
        speed = float(np.sqrt(np.max(np.sum(u**2, axis=1)))) or 0.3 * float(scheme.fastest(stable))
    if dt_most is None:
        # a particle must not move so far in one step that its neighbour table becomes invalid
        stable = min(stable, 0.4 * skin / speed)
    blocks, block = cadence(sample_dt, stable, speed, skin)
    # In fast water the table lasts for one step, rounded to whole steps, and not for the two of the shortest
    # block. The run would find this out, but only after a replay.
    lasting = 0.5 * skin / (speed * sample_dt / (blocks * block))
    settings = {"rebuild_every": 1 if lasting < 1.5 else block} | (settings or {})
    model = Model(
        scheme=scheme,
        walls=walls,
        solids=walls.solids(),
        moving=tuple(moving),
        bodies=tuple(bodies),
        links=tuple(links),
        chambers=tuple(chambers),
        ducts=tuple(ducts),
        dampers=tuple(dampers),
        outlets=_rims(walls, dx),
        forces=tuple(forces),
        tangents=ExactTangents(),
        g=leaf(g),
        dx=leaf(dx),
        dt=leaf(sample_dt / (blocks * block)),
        t0=leaf(0.0),
        depth=leaf(walls.high[-1] - walls.low[-1] if depth is None else depth),
        z0=leaf(x[:, -1]),
        search=_search(walls, x, scheme.smoothing, skin, block, chambers, settings, search_by),
    )
    check_parts(model)
    state = State(
        particles=scheme.with_pressure(
            _particles(x, u, m, dtype, chambers if scheme.responds else ()),
            leaf(np.zeros(n) if p is None else p),
        ),
        parts=part_states(model, dtype),
        ledger={name: Tally.zero(dtype) for name in model.entries()},
        limits={name: Tally.zero(dtype) for name in scheme.limiters()},
        step=on_device(0, np.int32),
        status=Status.sound(dim, dtype),
    )
    return model, state


def _particles(
    x: np.ndarray, u: np.ndarray, m: np.ndarray, dtype: np.dtype, chambers: Sequence[AbstractChamber]
) -> Particles:
    """Particles at x `[N, D]` (m) with velocities u (m/s) and masses m `[N]` (kg, kg/m in 2-D), at zero
    pressure, with room for the responses to the air of the `chambers`."""
    zero = on_device(np.zeros(len(x)), dtype)
    return Particles(
        x=on_device(x, dtype),
        x_carry=on_device(x - np.asarray(x, dtype), dtype),
        u=on_device(u, dtype),
        rho=zero,
        m=on_device(m, dtype),
        id=on_device(np.arange(len(x)), np.int32),
        p=zero,
        p_mean=zero,
        p_air={chamber.name: zero for chamber in chambers},
    )


def cadence(sample_dt: float, dt_most: float, speed: float, skin: float) -> tuple[int, int]:
    """Number of blocks in a sampling interval `sample_dt` (s), and number of steps in a block.

    A block is the sequence of steps between two neighbour searches. A neighbour table is valid until a
    particle has moved half of the `skin` (m); the expected `speed` (m/s) therefore limits the length of a
    block. A block has an even number of steps of at most `dt_most` (s), so that the block can be divided if a
    table becomes invalid. The cheapest number of blocks is chosen; the cost includes the searches and the
    steps added by rounding.
    """
    needed = sample_dt / dt_most
    most = max(2.0, 0.5 * skin / (speed * dt_most))
    least = int(np.ceil(needed / most))
    found = ((blocks, 2 * int(np.ceil(needed / blocks / 2))) for blocks in range(least, 2 * least + 1))
    return min(found, key=lambda pair: pair[0] * (pair[1] + SEARCH))


def _rims(walls: Ghosts, dx: float) -> tuple[Rim, ...]:
    """Rim of a tank whose upper side lets water out; empty for other tanks."""
    if walls.sides[-1] != "spill":
        return ()
    return (Rim((*(a + 0.5 * dx for a in walls.low[:-1]), walls.high[-1])),)


def _checked(x, u, p, scheme, walls, dx) -> tuple[int, int]:
    """Numbers of particles and of dimensions. **Raises** ValueError if the arguments do not match."""
    if x.ndim != 2 or x.shape[1] != len(walls.low) or u.shape != x.shape:
        raise ValueError(f"x and u must have the shape [N, {len(walls.low)}], not {x.shape} and {u.shape}")
    if p is not None and np.shape(p) != x.shape[:1]:
        raise ValueError(f"p must have the shape [{len(x)}], not {np.shape(p)}")
    if scheme.smoothing.period != walls.period:
        raise ValueError(
            f"the scheme's smoothing has the period {scheme.smoothing.period}, but the box has "
            f"{walls.period}: give both the same period"
        )
    for axis, length in walls.period:
        if abs(length / dx - round(length / dx)) > 1e-6 * length / dx:
            raise ValueError(
                f"dx = {dx:g} m does not divide the period of {length:g} m along axis {axis}: use a dx that "
                "divides this period"
            )
    slack = 1e-6 * (np.asarray(walls.high) - np.asarray(walls.low))
    if (x < walls.low - slack).any() or (x > walls.high + slack).any():
        raise ValueError(
            f"x has particles outside the box from {walls.low} to {walls.high} m: move or remove these "
            "particles"
        )
    return x.shape


def _search(
    walls: Ghosts,
    x: np.ndarray,
    smoothing: Smoothing,
    skin: float,
    block: int,
    chambers: Sequence[AbstractChamber],
    settings: dict[str, int],
    search_by: type[AbstractSearch],
) -> Search:
    radius = float(smoothing.radius) + skin
    everything = np.concatenate([np.asarray(walls.x), x])
    low, high = everything.min(axis=0), everything.max(axis=0)
    for axis, side in enumerate(walls.sides):
        # along an axis without walls, particles may be anywhere in the box; along a periodic axis, the cells
        # begin at the low end of the box
        if side in ("open", "periodic"):
            low[axis], high[axis] = walls.low[axis], walls.high[axis]
    grid = grid_over(low, high, radius, walls.period)
    found = dict(settings)
    if "capacity" not in found:
        fluid, nodes = _fullest(walls, x, grid, float(smoothing.radius), skin)
        found["capacity"] = needed_capacity(fluid)
        found["node_capacity"] = needed_capacity(nodes)
        found["chamber_capacity"] = 1
        for chamber in chambers:
            count = _candidate_count(chamber, tuple(on_device(a, walls.x.dtype) for a in x.T), skin)
            # a small table: with much room, longer chambers share the program of this one
            found["chamber_capacity"] = max(found["chamber_capacity"], 2 * int(count) + 32)
    return Search(
        grid=grid,
        method=search_by.of(grid, everything, np.concatenate([np.asarray(walls.node), x])),
        capacity=int(found["capacity"]),
        node_capacity=int(found["node_capacity"]),
        chamber_capacity=int(found["chamber_capacity"]),
        rebuild_every=int(found["rebuild_every"]),
        regularise_every=block,
        skin=skin,
    )


_candidate_count = jax.jit(lambda chamber, x, margin: chamber.candidates(x, margin, 1)[1])
"""Counts the particles on which a chamber's air may act; compiled as one function."""


def _fullest(walls: Ghosts, x: np.ndarray, grid: Grid, radius: float, skin: float) -> tuple[int, int]:
    """Largest number of neighbours of any particle, and of any node, in the initial state.

    **Arguments**: positions x (m) of the water; `radius` of the kernel's support and margin `skin`, m.
    """
    kind, sees = region_bits(walls.regions, x, walls.x.dtype)
    images, there = _first_images(walls.images, on_device(x, walls.x.dtype), radius, skin)
    behind, at_nodes = np.asarray(walls.kind)[: len(there)], walls.at_nodes
    sources = np.concatenate([x, np.asarray(images, float)[there], np.asarray(walls.x, float)[at_nodes]])
    kinds = np.concatenate([kind, behind[there], np.asarray(walls.kind)[at_nodes]])
    around = _neighbour_count(x, sees, sources, kinds, grid) - 1  # a particle is not its own neighbour
    node, node_sees = np.asarray(walls.node, float)[at_nodes], np.asarray(walls.node_sees)[at_nodes]
    # a moving wall's force is summed over all water around its ghosts, whatever the water's region
    ends = max((*walls.paddle, *walls.far_end), default=0)
    moving = np.asarray(images, float)[there & (np.arange(len(there)) < ends)]
    node, node_sees = np.concatenate([node, moving]), np.append(node_sees, np.full(len(moving), -1))
    at_nodes = _neighbour_count(node, node_sees, x, kind, grid)
    return int(around.max(initial=0)), int(at_nodes.max(initial=0))


def _first_images(images: Images, x: jax.Array, radius: float, skin: float) -> tuple[np.ndarray, np.ndarray]:
    """Positions (m) of the mirror images of particles at x (m) with the paddle at rest, and a mask of the
    entries in use."""
    found, there = _imaged(images, x, radius, skin)
    return np.asarray(found), np.asarray(there)


@jax.jit
def _imaged(images: Images, x: jax.Array, radius: float, skin: float) -> tuple[jax.Array, jax.Array]:
    """Computes `_first_images`; compiled once for all builds with arrays of the same sizes."""
    rows, _ = images.choose(x, lambda a: a, radius, skin)
    return images.image(x[jnp.minimum(rows, len(x) - 1)], lambda a: a), rows < len(x)


def _neighbour_count(
    targets: np.ndarray, sees: np.ndarray, sources: np.ndarray, kinds: np.ndarray, grid: Grid
) -> np.ndarray:
    """Number of sources within the grid's radius of each target whose kinds are in the target's mask `sees`.

    A tree on the host counts the sources, because a search on the device would be compiled for every build.
    """
    lengths, count = dict(grid.period), np.zeros(len(targets), int)
    box = [lengths.get(axis, 0.0) for axis in range(targets.shape[1])]

    def wrapped(places: np.ndarray) -> np.ndarray:
        shifted = places - np.asarray(grid.origin)
        for axis, length in grid.period:
            shifted[:, axis] %= length
        return shifted

    for mask in np.unique(sees):
        of, seen = sees == mask, (kinds & mask) != 0
        if of.any() and seen.any():
            tree = scipy.spatial.KDTree(wrapped(sources[seen]), boxsize=box)
            count[of] = tree.query_ball_point(wrapped(targets[of]), grid.radius, return_length=True)
    return count
