"""Walls: ghosts of linear fields, mirrored velocities, normals, and which sides of a thin plate interact."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import coarse, enable_x64
from hypothesis import given, settings
from hypothesis import strategies as st

import jaxsph as js
from jaxsph.core.kernels import Gaussian
from jaxsph.core.pairs import Smoothing
from jaxsph.core.search.cells import grid_over, search
from jaxsph.core.slabs import ONE, Chosen, PointNeighbours, Sources
from jaxsph.errors import CaseError
from jaxsph.parts.paddle import Paddle
from jaxsph.solids.box import Box, FreeSlip, NoSlip, Platform, WallPlate
from jaxsph.solids.divisions import (
    PLAIN,
    SETS,
    DiagonalDivision,
    FivePartDivision,
    HorizontalDivision,
    MultiNodeGhosts,
    RegionalGhosts,
)
from jaxsph.solids.filling import MirrorNodes
from jaxsph.solids.placement import lattice
from jaxsph.solids.walls import Ghosts

DX = 0.05
LENGTH, DEPTH, HEIGHT = 1.0, 0.6, 1.0
PLATE = WallPlate(0.5, 0.55, 0.3)
DIVISIONS = {"a": DiagonalDivision, "b": HorizontalDivision, "c": FivePartDivision}
SLOPES = {"left": (700.0, -9810.0), "right": (-300.0, -4000.0), "below": (100.0, -7000.0)}
ORIGINS = {"left": 5000.0, "right": 9000.0, "below": 3000.0}

search_ = jax.jit(search, static_argnames=("grid", "capacity", "same"))


def _water(plate=None, jitter=0.2, platform=None):
    """A lattice of water, disturbed by a share of the spacing."""
    axes = [np.arange(DX / 2, end, DX) for end in (LENGTH, DEPTH)]
    x = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 2)
    if plate is not None:
        x = x[~((x[:, 0] > plate.x0) & (x[:, 0] < plate.x1) & (x[:, 1] > plate.tip))]
    if platform is not None:
        x = x[(x[:, 0] < platform.start) | (x[:, 1] > platform.height)]
    return x + jitter * DX * (np.random.default_rng(0).random(x.shape) - 0.5)


def _plates(plate):
    return () if plate is None else (plate,)


def _paddle(walls, X=0.0):
    """The paddle in front of these walls, and its motion with a displacement of X (m)."""
    paddle = Paddle(motion=None, rows=walls.paddle)
    return paddle, eqx.tree_at(lambda a: a.X, paddle.start(walls.x.dtype), jnp.asarray(X, walls.x.dtype))


def _pushes(walls, x, X=None):
    """Acceleration away from all walls, with the paddle, if there is one, displaced by X (m)."""
    total = sum(solid.push(None, x, jnp.asarray(DX), jnp.asarray(C0)) for solid in walls.solids())
    if not walls.paddle:
        return np.asarray(total)
    paddle, own = _paddle(walls, X or 0.0)
    return np.asarray(total + paddle.push(own, x, jnp.asarray(DX), jnp.asarray(C0)))


class _Tank:
    """Ghosts of a tank, filled from fields that are given as functions of position; float64."""

    def __init__(self, slip, plate=None, thin_wall=None, paddle=False, jitter=0.2, platform=None):
        self.smoothing = Smoothing(Gaussian(), jnp.asarray(1.2 * DX))
        box = Box((0.0, 0.0), (LENGTH, HEIGHT), paddle, stroke=2 * DX if paddle else 0.0)
        self.walls = Ghosts.build(
            box,
            DX,
            self.smoothing,
            slip,
            _plates(plate),
            thin_wall,
            dtype=np.float64,
            platform=platform,
            filling=MirrorNodes(),
        )
        self.x = jnp.asarray(_water(plate, jitter, platform))
        self.region = self.walls.regions.index(self.x)
        self.grid = grid_over(np.full(2, -0.5), np.array([1.5, 1.5]), 3.6 * DX)
        kind = self.walls.regions.kind(self.region)
        self.table = search_(self.walls.node, self.x, self.grid, 80, self.walls.node_sees, kind, False)
        assert not self.table.overflow
        self.ghost = np.asarray(self.walls.x)
        self.node = np.asarray(self.walls.node)

    def interpolate(self, field):
        """(fit, field at the nodes) for one array of the water's values."""
        columns = {"x": tuple(self.x.T), "V": jnp.full(len(self.x), DX**2)}
        water = Sources(columns | {"f": jnp.asarray(field)}, {})
        table = PointNeighbours.of(self.table.indices)
        images = Chosen.of(jnp.zeros(0, jnp.int32), len(self.x), ONE)
        weight = jnp.zeros(self.walls.node.shape[1], jnp.float32)  # no test here needs a level
        fit = self.walls.fit(self.walls.node, water, self.smoothing, images, table, weight)
        law = lambda j: j["f"]  # noqa: E731
        seen = fit, self.walls.node, water, self.smoothing, images, table
        return fit, self.walls.carried(law, *seen)

    def pressure(self, field, slope):
        """(wet ghosts, their pressure) if the body force balances the slope of the field."""
        fit, at_node = self.interpolate(field)
        force = jnp.broadcast_to(jnp.asarray(slope), self.walls.x.shape)
        p = self.walls.pressure(fit, at_node, self.walls.x, self.walls.node, force)
        return np.asarray(fit.wet) > 0, np.asarray(p)


# --- pressure


def test_ghosts_of_a_tank_continue_a_linear_pressure():
    with enable_x64():
        tank = _Tank(FreeSlip())
        slope = np.array(SLOPES["left"])
        wet, p = tank.pressure(4000.0 + tank.x @ slope, slope)
        exact = 4000.0 + tank.ghost @ slope
        low, high = tank.ghost < 0, tank.ghost > LENGTH
        places = {
            "bed": low[:, 1] & ~low[:, 0] & ~high[:, 0],
            "side wall": low[:, 0] & ~low[:, 1],
            "left corner": low[:, 0] & low[:, 1],
            "right corner": high[:, 0] & low[:, 1],
        }
        for name, here in places.items():
            assert np.count_nonzero(wet & here) >= 9, name
            # Round-off of 1e-16 in sums of some tens of terms, times the condition of the fit (about 10).
            np.testing.assert_allclose(p[wet & here], exact[wet & here], atol=1e-11 * 1e4, err_msg=name)


def test_hydrostatic_pressure_goes_on_below_the_bed():
    with enable_x64():
        tank = _Tank(NoSlip())
        slope = np.array([0.0, -9810.0])
        wet, p = tank.pressure(9810.0 * (DEPTH - tank.x[:, 1]), slope)
        bed = wet & (tank.ghost[:, 1] < 0)
        # As above; p is 6 to 8 kPa there.
        np.testing.assert_allclose(p[bed], 9810.0 * (DEPTH - tank.ghost[bed, 1]), rtol=1e-11)


@pytest.mark.parametrize("division", list(DIVISIONS))
def test_each_set_of_a_thin_wall_continues_its_own_water(division):
    """Three unrelated linear fields in the three regions: no set of ghosts may mix two of them."""
    with enable_x64():
        tank = _Tank(FreeSlip(), PLATE, RegionalGhosts(DIVISIONS[division]()))
        names = np.array(tank.walls.regions.division.regions)[np.asarray(tank.region)]
        names = np.char.partition(names, "_")[:, 0]  # no set's nodes use the strips beside the tip
        x = np.asarray(tank.x)
        field = np.zeros(len(x))
        for name, slope in SLOPES.items():
            field[names == name] = ORIGINS[name] + x[names == name] @ np.array(slope)
        for which, name in enumerate(SETS):
            region = {"tip": "below"}.get(name, name)
            wet, p = tank.pressure(field, SLOPES[region])
            own = wet & (np.asarray(tank.walls.kind) == tank.walls.regions.set_kind(which))
            exact = ORIGINS[region] + tank.ghost @ np.array(SLOPES[region])
            assert np.count_nonzero(own) >= 3, name
            # As for the tank; where the strip of water is thin, the condition of the fit is about 100.
            np.testing.assert_allclose(p[own], exact[own], atol=1e-10 * 1e4, err_msg=name)


@pytest.mark.parametrize("height", [2 * DX, 6 * DX])
def test_a_platform_s_faces_continue_a_linear_pressure(height):
    """Also for a platform lower than the kernel's reach, where water above it could interact with the bed."""
    platform = Platform(LENGTH - 7 * DX, height)
    with enable_x64():
        tank = _Tank(FreeSlip(), platform=platform)
        slope = np.array(SLOPES["left"])
        wet, p = tank.pressure(4000.0 + tank.x @ slope, slope)
        exact = 4000.0 + tank.ghost @ slope
        kind, regions = np.asarray(tank.walls.kind), tank.walls.regions
        for which, name in enumerate(("top", "front")):
            own = wet & (kind == regions.set_kind(which))
            assert np.count_nonzero(own) >= 3 * 6, name
            # round-off, as for the tank
            np.testing.assert_allclose(p[own], exact[own], atol=1e-11 * 1e4, err_msg=name)
        assert not np.any((tank.node[:, 0] > platform.start) & (tank.node[:, 1] < height) & wet)


def test_a_particle_is_surrounded_beside_a_platform():
    """On the lattice the kernel's sum over water and ghosts is that of open water, but for the outer edge."""
    platform = Platform(LENGTH - 7 * DX, 6 * DX)
    with enable_x64():
        tank = _Tank(FreeSlip(), jitter=0.0, platform=platform)
        walls, x = tank.walls, np.asarray(tank.x)
        every = np.concatenate([x, tank.ghost])
        kind = np.concatenate([np.asarray(walls.regions.kind(tank.region)), np.asarray(walls.kind)])
        sees = np.asarray(walls.regions.sees(tank.region))
        r2 = ((x[:, None] - every[None]) ** 2).sum(axis=2)
        seen = ((sees[:, None] & kind[None]) != 0) & (r2 < (3.6 * DX) ** 2)
        total = np.where(seen, np.asarray(Gaussian().value(r2, 1.2 * DX, 2)), 0.0).sum(axis=1) * DX**2
    deep = x[:, 1] < DEPTH - 4 * DX
    middle = (x[:, 0] > 4 * DX) & (x[:, 0] < platform.start - 4 * DX) & (x[:, 1] > 4 * DX)
    open_water = np.median(total[deep & middle])
    edge = np.hypot(x[:, 0] - platform.start, x[:, 1] - platform.height) < 4 * DX
    # round-off
    np.testing.assert_allclose(total[deep & ~edge], open_water, rtol=1e-9)
    # At the edge a quarter of the plane is counted twice or not at all; the kernel has a few per cent there.
    np.testing.assert_allclose(total[deep & edge], open_water, rtol=0.1)


def test_a_platform_pushes_away_from_its_faces_and_its_edge():
    platform = Platform(0.5, 0.3)
    with enable_x64():
        walls = _Tank(FreeSlip(), platform=platform).walls
        near = 0.1 * DX
        x = jnp.asarray(
            [[0.5 - near, 0.15], [0.8, 0.3 + near], [0.5 - near, 0.3 + near], [0.5 - 0.5 * DX, 0.15]]
        )
        push = _pushes(walls, x)
        inside = jnp.asarray([[0.5 + 0.6 * DX, 0.1], [0.5 + 0.4 * DX, 0.1], [0.8, 0.31]])
        entered = np.any([solid.contains(None, inside, jnp.asarray(DX)) for solid in walls.solids()], axis=0)
    assert push[0, 0] < 0 == push[0, 1] and push[1, 1] > 0 == push[1, 0]
    assert push[2, 0] < 0 < push[2, 1] and push[2, 0] == pytest.approx(-push[2, 1])
    assert not push[3].any()
    np.testing.assert_array_equal(entered, [True, False, False])


def test_ghosts_in_air_are_dry_and_finite():
    with enable_x64():
        tank = _Tank(FreeSlip())
        wet, p = tank.pressure(np.ones(len(tank.x)), (0.0, 0.0))
        high = tank.ghost[:, 1] > DEPTH + 4 * DX
        assert high.any() and not np.any(wet[high]) and np.all(np.isfinite(p))


# --- velocity


@pytest.mark.parametrize("slip", [FreeSlip(), NoSlip()])
def test_velocities_are_mirrored(slip):
    with enable_x64():
        tank = _Tank(slip, paddle=True)
        U = 0.7

        def flow(x):
            return np.stack([1.0 + 2.0 * x[:, 0] - x[:, 1], -0.5 + x[:, 0] + 3.0 * x[:, 1]], -1)

        u = flow(np.asarray(tank.x))
        fit, ux = tank.interpolate(u[:, 0])
        _, uz = tank.interpolate(u[:, 1])
        zero = jnp.zeros_like(ux)
        moves = np.arange(tank.walls.count) < tank.walls.paddle[1]
        found = np.asarray(tank.walls.velocity((ux, uz), (U * moves, zero), tank.walls.shear))
        at_node = flow(tank.node)
        exact = (np.asarray(fit.wet) > 0) & ~np.any(np.stack(fit.offset), axis=0)
        x = tank.ghost
        inner = (x[:, 0] > 0) & (x[:, 0] < LENGTH)
        bed = exact & (x[:, 1] < 0) & inner
        wall = exact & (x[:, 0] > LENGTH) & (x[:, 1] > 0)
        paddle = exact & moves & (x[:, 1] > 0)
        assert min(map(np.count_nonzero, (bed, wall, paddle))) > 9
        s = slip.tangential
        # The interpolation is exact for linear fields to round-off (see the pressure).
        close = dict(rtol=0, atol=1e-11)
        np.testing.assert_allclose(found[bed], at_node[bed] * [s, -1.0], **close)
        np.testing.assert_allclose(found[wall], at_node[wall] * [-1.0, s], **close)
        # A moving wall mirrors relative to itself; it is free-slip, whatever the tank's walls are.
        mirrored = np.stack([2 * U - at_node[:, 0], at_node[:, 1]], -1)
        np.testing.assert_allclose(found[paddle], mirrored[paddle], **close)


def test_a_paddle_carries_its_own_ghosts_and_nodes():
    walls = _Tank32().walls
    paddle, own = _paddle(walls, 0.02)
    rows = slice(*paddle.rows)
    x, node = paddle.place(own, walls.x[rows], walls.node[rows])
    # One addition in float32 at coordinates of order one.
    np.testing.assert_allclose(x - walls.x[rows], np.broadcast_to([0.02, 0.0], x.shape), atol=2e-7)
    np.testing.assert_allclose(node - walls.node[rows], np.broadcast_to([0.02, 0.0], x.shape), atol=2e-7)
    assert 0 < len(x) < walls.count


class _Tank32:
    def __init__(self, plate=None):
        box = Box((0.0, 0.0), (LENGTH, HEIGHT), plate is None, stroke=2 * DX)
        smoothing = Smoothing(Gaussian(), jnp.asarray(1.2 * DX))
        thin_wall = RegionalGhosts() if plate is not None else None
        self.walls = Ghosts.build(
            box, DX, smoothing, FreeSlip(), _plates(plate), thin_wall, filling=MirrorNodes()
        )


# --- regions


@pytest.mark.parametrize("division", list(DIVISIONS))
def test_masks_are_symmetric_and_keep_the_sides_apart(division):
    one = DIVISIONS[division]()
    water = one.water_mask()
    np.testing.assert_array_equal(water, water.T)
    assert water.diagonal().all()
    left, right = one.regions.index("left"), one.regions.index("right")
    assert not water[left, right]
    assert not one.ghost_mask()[left, SETS.index("right")]
    assert not one.ghost_mask()[right, SETS.index("left")]
    assert one.node_mask()[:2, [left, right]].tolist() == [[True, False], [False, True]]


prepare = jax.jit(lambda model, state: model.scheme.prepare(model, state))

PLATES = {
    "a": {"device.division": "a"},
    "b": {"device.division": "b"},
    "c": {"device.division": "c"},
    "multi_node": {"device.thin_wall": "multi_node", "device.wall_thickness": 0.12, "tank.length": 0.76},
}


@pytest.fixture(scope="module", params=list(PLATES))
def tables(request):
    """(model, particle positions, table) of the communicating vessels, coarse."""
    case = coarse("vessel", PLATES[request.param])
    model, state = js.build(case)
    # Off the lattice, so that no particle is exactly between two regions.
    shaken = state.particles.x + 0.1 * case.dx * np.random.default_rng(0).normal(size=state.particles.x.shape)
    state = eqx.tree_at(lambda s: s.particles.x, state, jnp.asarray(shaken, jnp.float32))
    state, found = prepare(model, state)
    assert int(state.status.bits) == 0
    return (
        model,
        np.asarray(state.particles.x),
        np.asarray(found.fluid.indices),
        np.asarray(found.nodes.indices),
    )


def _sides(x, plate):
    middle = 0.5 * (plate.x0 + plate.x1)
    # Above the tip by more than the strip in which a division may assign a particle to the water below.
    above = x[:, 1] > plate.tip + plate.thickness
    return above & (x[:, 0] < middle), above & (x[:, 0] > middle)


def test_no_pair_across_the_wall(tables):
    model, x, fluid, _ = tables
    left, right = _sides(x, model.walls.regions.plates[0])
    n = len(x)
    slots, targets = np.nonzero(fluid < n)
    sources = fluid[slots, targets]
    assert not np.any(left[targets] & right[sources]) and not np.any(right[targets] & left[sources])
    # ... although some of them are near enough.
    r = np.linalg.norm(x[left][:, None] - x[right][None], axis=-1)
    near = np.count_nonzero(r < float(model.scheme.smoothing.radius))
    thick = model.walls.regions.plates[0].thickness > 0.1
    assert near > 0 or thick
    listed = np.zeros((n, n), bool)
    listed[targets, sources] = True
    np.testing.assert_array_equal(listed, listed.T)


def test_each_ghost_set_is_seen_by_its_region_only(tables):
    model, x, fluid, nodes = tables
    regions = model.walls.regions
    n = len(x)
    slots, targets = np.nonzero((fluid >= n) & (fluid < n + model.walls.count))
    kind = np.asarray(model.walls.kind)[fluid[slots, targets] - n]
    left, right = _sides(x, regions.plates[0])
    below = x[:, 1] < regions.plates[0].tip - 4 * float(model.dx)
    for which, (own, other) in enumerate(((left, right), (right, left))):
        mine = kind == regions.set_kind(which)
        assert np.any(own[targets[mine]]) and not np.any(other[targets[mine]])
        # and its nodes use only the water of its own side
        rows = np.asarray(model.walls.kind)[model.walls.at_nodes] == regions.set_kind(which)
        used = nodes[:, rows]
        used = used[used < n]
        assert np.any(own[used]) and not np.any(other[used])
    tip = kind == regions.set_kind(2)
    assert np.any(tip) and not np.any((left | right)[targets[tip]])
    assert not np.any(below[targets[kind != PLAIN]])


def test_a_plate_too_thin_for_its_method_is_refused():
    with pytest.raises(ValueError, match="multi-node ghosts need 3: use dx of at most .* or regional ghosts"):
        MultiNodeGhosts().check(PLATE, DX, 4)
    with pytest.raises(ValueError, match="less than half a spacing"):
        RegionalGhosts().check(WallPlate(0.5, 0.52, 0.3), DX, 4)
    RegionalGhosts().check(PLATE, DX, 4)
    MultiNodeGhosts().check(WallPlate(0.5, 0.65, 0.3), DX, 4)
    with pytest.raises(CaseError, match="device.wall_thickness .* multi-node"):
        coarse("vessel", {"device.thin_wall": "multi_node"})


# --- push


C0 = 20.0


def _depth(x, plate, paddle):
    """Depth in a wall, m: outside the box, or inside the plate by the nearest way out."""
    out = np.maximum.reduce([paddle - x[:, 0], x[:, 0] - LENGTH, -x[:, 1], np.zeros(len(x))])
    through = np.minimum.reduce([x[:, 0] - plate.x0, plate.x1 - x[:, 0], x[:, 1] - plate.tip])
    return np.maximum(out, through)


def test_push_points_out_of_the_walls():
    walls = _Tank32(PLATE).walls
    x = np.float32(np.random.default_rng(1).uniform((-0.05, -0.05), (1.05, 1.2), size=(4000, 2)))
    push = np.float64(_pushes(walls, jnp.asarray(x)))
    inside = _depth(x, PLATE, 0.0) > 0
    unit = push / np.maximum(np.linalg.norm(push, axis=1, keepdims=True), 1e-30)
    after = _depth(x + 1e-5 * unit, PLATE, 0.0)
    # Float32 coordinates of order one are rounded to 1e-7; the push at a corner is oblique.
    assert np.all(after[inside] < _depth(x, PLATE, 0.0)[inside] - 0.5e-5)
    # Points at least half a spacing from every wall are not pushed.
    far = np.all((x > 0.5 * DX) & (x < [LENGTH - 0.5 * DX, 9.0]), axis=1)
    far &= (np.abs(x[:, 0] - 0.5 * (PLATE.x0 + PLATE.x1)) > 0.5 * PLATE.thickness + 0.5 * DX) | (
        x[:, 1] < PLATE.tip - 0.5 * DX
    )
    assert far.any() and not push[far].any()


def test_push_is_conservative():
    """The curl of the push vanishes: central differences over 1e-6 m in float64, to their own rounding."""
    with enable_x64():
        walls = _Tank32(PLATE).walls
        rng = np.random.default_rng(2)
        tip = np.array([PLATE.x0 - 0.3 * DX, PLATE.tip - 0.3 * DX])
        x = rng.uniform(tip, tip + 0.25 * DX, size=(50, 2))  # about a corner of the tip

        def at(dx, dz):
            return _pushes(walls, jnp.asarray(x + np.array([dx, dz])))

        e = 1e-6
        across = (at(e, 0)[:, 1] - at(-e, 0)[:, 1]) / (2 * e)
        up = (at(0, e)[:, 0] - at(0, -e)[:, 0]) / (2 * e)
        assert np.abs(across).max() > 0
        np.testing.assert_allclose(across, up, atol=1e-6 * np.abs(across).max())


def test_push_moves_with_the_paddle():
    walls = _Tank32().walls
    x = jnp.asarray([[0.01, 0.3], [0.02 + 0.5 * DX, 0.3]])  # behind and in front of a paddle at 0.02 m
    push = _pushes(walls, x, 0.02)
    assert push[0, 0] > 0 and not push[1].any() and push[0, 1] == 0


# --- lattice


@settings(max_examples=50, deadline=None)
@given(
    thickness=st.floats(0.05, 0.5),
    gap=st.floats(0.3, 1.0),
    rows=st.integers(2, 8),
    dim=st.sampled_from([2, 3]),
)
def test_lattice_fills_the_box_around_a_plate(thickness, gap, rows, dim):
    """Volumes sum to the volume of the water; no particle is nearer to a face than a third of a spacing."""
    dx = 0.1
    high = (2.0, *((0.3,) * (dim - 2)), 1.0)
    plate = WallPlate(2.0 - gap - thickness, 2.0 - gap, rows * dx)
    x, volume = lattice((0.0,) * dim, high, dx, [plate])
    width = 0.3 ** (dim - 2)
    water = (2.0 - thickness * (1.0 - plate.tip)) * width
    assert volume.sum() == pytest.approx(water, rel=1e-9)  # sums in float64
    beside = x[x[:, -1] > plate.tip]
    gaps = np.concatenate([plate.x0 - beside[:, 0], beside[:, 0] - plate.x1])
    # the widest column, of 1.5 spacings, has its middle 0.75 spacings away; the narrowest is 0.67 wide
    assert np.min(gaps[gaps > -0.5 * thickness]) > 0.33 * dx
