"""Distributes a run's particles over devices in slabs, and gathers one state for files and results."""

from __future__ import annotations

import contextlib
import os
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import NamedSharding, PartitionSpec

from jaxsph.core.native.forms import available, installed
from jaxsph.core.search.base import SPREADING, WIDTH, needed_capacity, rounded_up
from jaxsph.core.search.cells import Cells, cell_index, cell_order
from jaxsph.core.search.tables import beside
from jaxsph.core.slabs import AXIS, WHOLE, Slabs
from jaxsph.errors import CaseError
from jaxsph.model.interfaces import Model
from jaxsph.model.state import Particles, State
from jaxsph.parts.border import flumes
from jaxsph.run.processes import whole

WORTHWHILE = 8000
"""Least number of particles per slab at which one more core of a CPU is worthwhile as a device.

With JAX's loops and 4,100 particles per core, two cores are faster than one core by a factor of 1.05
(incompressible) or 1.3 (weakly compressible). With 16,400 particles per core the factors are 1.5 and 1.6
(`python -m experiments run bench_devices`).
"""

WORTH_SPARING = 0.1
"""Least ratio of nodes away from the water to particles (-) for which the tables omit these nodes.

Omitting fewer nodes does not make a run on one device faster.
"""


def describe_machine(devices: int) -> str:
    """Devices that share a run, and JAX's version, in words."""
    first = jax.devices()[0]
    kind, one = ("CPU", "core") if first.platform == "cpu" else (first.device_kind, "device")
    count = available_cores() if _threads_share_loops() else devices
    return f"{kind}, {count} {one}{'s' if count > 1 else ''}, JAX {jax.__version__}"


def _threads_share_loops() -> bool:
    """Whether all cores share the loops of a run on the only device of this process."""
    return available() and jax.local_device_count() == 1


def find_devices(count: int | None) -> tuple[jax.Device, ...]:  # pyright: ignore[reportInvalidTypeForm]
    """The first `count` devices of the default backend, or all if None.

    On a CPU, `count` cores become devices if JAX has not been used yet. By default all cores become devices,
    or none if their threads share the native loops of one device. **Raises** CaseError if `count` is less
    than 1 or more than the number of devices, or if several processes share the run but do not use all
    devices.
    """
    if count is not None and count < 1:
        raise CaseError(f"devices = {count}: must be 1 or more")
    cores = count or (1 if installed() else available_cores())
    if 1 < cores <= (os.cpu_count() or 1) and not jax.distributed.is_initialized():
        with contextlib.suppress(RuntimeError):  # too late: the backend already uses the existing devices
            jax.config.update("jax_num_cpu_devices", cores)
    found = jax.devices()
    if count is None:
        return tuple(found)
    if count < len(found) and jax.process_count() > 1:
        raise CaseError(
            f"devices = {count}: the {jax.process_count()} processes that share the run have {len(found)} "
            f"devices and must use all of them; omit the number of devices, or give {len(found)}"
        )
    if len(found) < count:
        raise CaseError(_too_few(count, found))
    return tuple(found[:count])


def _too_few(count: int, found: list[jax.Device]) -> str:  # pyright: ignore[reportInvalidTypeForm]
    """Message for a number of devices larger than the number of devices `found`."""
    most, platform = len(found), found[0].platform
    only = (
        f"devices = {count}: JAX has only {most} device{'s' * (most > 1)} ({platform}); give at most {most}"
    )
    if platform != "cpu":
        return only
    first = f"pass devices = {count} to the program's first js.run, or "
    return (
        f"{only}, or set the number of CPU devices before JAX is first used "
        f"({first if count <= (os.cpu_count() or 1) else ''}set "
        f"XLA_FLAGS=--xla_force_host_platform_device_count={count})"
    )


def available_cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def usual_devices(model: Model, state: State) -> int:
    """Default number of devices of a run, the largest number that makes the run faster.

    If several processes share the run, they use all their devices. A single process uses one device for a
    case that cannot be shared. Otherwise it uses all accelerators, or as many CPU devices as have at least
    `WORTHWHILE` particles each; it uses fewer devices if the slabs would otherwise be too narrow.
    """
    found = find_devices(None)
    if jax.process_count() > 1:
        return len(found)
    if _obstacle(model):
        return 1
    # if the water is spread evenly along the tank, a slab is at least four search radii wide
    most = min(len(found), model.search.grid.shape[0] // (4 * WIDTH))
    if found[0].platform == "cpu":
        most = min(most, len(state.particles.id) // WORTHWHILE)
    return max(1, most)


def _obstacle(model: Model) -> str:
    """Reason why a model's particles cannot be shared among devices; empty if they can."""
    if not isinstance(model.search.method, Cells):
        return "this neighbour search runs on one device only; use the search by cells, or give devices = 1"
    if 0 in dict(model.search.grid.period):
        return "a tank that is periodic along its length runs on one device only; give devices = 1"
    if flumes(model):
        return "a tank with a coarse flume runs on one device only; give devices = 1"
    return ""


def share(model: Model, state: State, devices: int) -> tuple[Model, State]:
    """Distributes the particles of a run over `devices` devices, in slabs along the tank.

    The neighbour tables are sized for the state. They may omit walls away from the water, also on a single
    device.

    Massless copies of particles and empty ghosts are added up to even numbers (`rounded_up`), so that cases
    of almost the same size share a compiled program, and up to a number of particles that `devices` divides.
    The copies stay at rest and have no effect. **Returns** the model and the state. **Raises** CaseError for
    a case that cannot be shared.
    """
    model, state = _evened(model, state, devices)
    if devices == 1:
        # with fewer nodes, `_sizes` would only load a program to find that no node is worth omitting
        nodes = np.arange(len(model.walls.node))[model.walls.at_nodes]
        if isinstance(model.search.method, Cells) and len(nodes) >= WORTH_SPARING * len(state.particles.id):
            model = eqx.tree_at(lambda m: m.search.slabs, model, Slabs(points=_sizes(model, state, 1)[1]))
        return model, state
    found = find_devices(devices)
    if why := _obstacle(model):
        raise CaseError(f"devices = {devices}: {why}")
    order = cell_order(state.particles.x, model.search.grid)
    state = eqx.tree_at(lambda s: s.particles, state, jax.tree.map(lambda a: a[order], state.particles))
    slabs = Slabs(found, *_sizes(model, state, devices))
    model = eqx.tree_at(lambda m: m.search.slabs, model, slabs)
    particles = _placed(slabs, state.particles, PartitionSpec(AXIS))
    return everywhere(slabs, model), eqx.tree_at(lambda s: s.particles, everywhere(slabs, state), particles)


def everywhere(slabs: Slabs, tree: Any) -> Any:
    """Copies all arrays of a tree in full to every device of a run."""
    return tree if slabs.count == 1 else _placed(slabs, tree, WHOLE)


def _placed(slabs: Slabs, tree: Any, partition: PartitionSpec) -> Any:
    on = NamedSharding(slabs.mesh, partition)
    return jax.tree.map(lambda a: jax.device_put(np.asarray(a), on), tree)


def gather(state: State, count: int) -> State:
    """State with the first `count` particles only, without the copies that `share` has added.

    Every process can read the state.
    """
    state = whole(state)
    if state.particles.x.shape[0] == count:
        return state
    own = np.asarray(state.particles.id) < count
    return eqx.tree_at(
        lambda s: s.particles, state, jax.tree.map(lambda a: jnp.asarray(np.asarray(a)[own]), state.particles)
    )


def unshare(state: State, count: int) -> State:
    """State on one device, with the first `count` particles only."""
    return jax.tree.map(lambda a: jax.device_put(np.asarray(a)), gather(state, count))


STEPS = 64
"""Least ratio of the number of particles to the step in which the numbers of particles and ghosts grow (-).

On the average 0.8 % of the particles are copies.
"""
LEAST_STEP = 64
"""Smallest step in which the number of particles grows; a power of 2."""
ROW = 192
"""Number of particles in addition to whole steps, a multiple of 64.

Every row of a neighbour table then begins at a multiple of 256 bytes, and successive rows lie in different
parts of the processor's cache. A step of the built-in OWC takes 0.85 of the time with 8256 particles, 24 of
them copies, instead of the 8232 of its lattice. At dx = 0.01 m it takes 1.00 of the time, and at 0.005 m,
with 1.3 % copies, 1.03; with 208 instead of 192 particles it would take 1.07 there.
"""


def _evened(model: Model, state: State, devices: int) -> tuple[Model, State]:
    """Model and state with massless copies of particles and with empty ghosts up to even numbers."""
    n, walls = len(state.particles.id), model.walls
    count = rounded_up(n - ROW, max(n // STEPS, LEAST_STEP)) + ROW
    more = count + -count % devices - n
    lattice = walls.count - walls.images.count
    walls = walls.padded(rounded_up(lattice, n // STEPS // 2) - lattice)
    z0 = jax.device_put(np.pad(model.z0, (0, more)))
    model = eqx.tree_at(lambda m: (m.walls, m.z0), model, (walls, z0))
    return model, eqx.tree_at(lambda s: s.particles, state, _filled_up(state.particles, more))


def _filled_up(p: Particles, more: int) -> Particles:
    """Particles, followed by massless copies of `more` of them, evenly spread over the water and at rest."""
    if not more:
        return p
    n = len(p.id)
    copied = np.linspace(0, n - 1, more).astype(int)
    copies = jax.tree.map(lambda a: np.zeros_like(a, shape=(more, *a.shape[1:])), p)
    copies = eqx.tree_at(
        lambda a: (a.x, a.id), copies, (np.asarray(p.x)[copied], n + np.arange(more, dtype=np.int32))
    )
    # on the host, where a new number of particles compiles nothing
    return jax.tree.map(lambda a, b: jax.device_put(np.concatenate([a, b])), p, copies)


def _sizes(model: Model, state: State, devices: int) -> tuple[int, int]:
    """Largest numbers of particles in a halo and of points in a slab, with a reserve for later steps.

    On one device the number of points is 0, which means all points, unless many points are away from the
    water, as in the tank of a dam break.
    """
    cell, ghosts, nodes = (np.asarray(cells) for cells in _first_cells(model, state))
    columns = np.bincount(cell, minlength=model.search.grid.shape[0])
    # a halo consists of whole columns of cells, and of one column that the slab's edge cuts
    halo = int(np.convolve(columns, np.ones(WIDTH + 1, int)).max())
    edges = np.sort(cell)[:: len(cell) // devices][1:devices]

    def fullest(cells: np.ndarray) -> int:
        slab = np.searchsorted(edges, cells[cells >= 0], side="right")
        return int(np.bincount(slab, minlength=1).max())

    nodes = nodes[model.walls.at_nodes]
    around = (ghosts[slice(*wall.rows)] for wall in model.moving)
    points = needed_capacity(max(map(fullest, (nodes, *around))), SPREADING)
    if devices == 1 and len(nodes) - points < WORTH_SPARING * len(cell):
        points = 0
    return min(needed_capacity(halo), len(cell) // devices), points


@eqx.filter_jit  # one program, because every program has to be loaded at every start
def _first_cells(model: Model, state: State) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Indices along the tank of the cells of all particles, ghosts and ghosts' nodes.

    The index of a ghost or node away from the water is -1.
    """
    x, grid = state.particles.x, model.search.grid

    def cells(points: jax.Array) -> jax.Array:
        return jnp.where(beside(x, points, grid), cell_index(points, grid)[:, 0], -1)

    ghosts, nodes = model.walls_at(state.parts)
    return cell_index(x, grid)[:, 0], cells(ghosts), cells(nodes)
