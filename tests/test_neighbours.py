"""The neighbour search, compared with brute force and with the search of jax-md."""

import functools
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import advance, coarse
from hypothesis import given, settings
from hypothesis import strategies as st

import jaxsph as js
from jaxsph.core.arrays import columns
from jaxsph.core.kernels import WendlandC2
from jaxsph.core.pairs import Smoothing
from jaxsph.core.search import cells
from jaxsph.core.search.base import Grid, needed_capacity
from jaxsph.core.search.cells import Cells, cell_order, grid_over, search, wrap
from jaxsph.core.search.jax_md import JaxMD
from jaxsph.core.search.tables import Seen, point_neighbours
from jaxsph.core.slabs import Slabs, Sources
from jaxsph.run.host import run

N, M, RADIUS = 60, 90, 0.45
search_ = jax.jit(search, static_argnames=("grid", "capacity", "same"))
GRIDS = {d: grid_over(np.full(d, -1.0), np.full(d, 1.0), RADIUS) for d in (2, 3)}
CLOUDS = dict(
    dim=st.sampled_from([2, 3]),
    seed=st.integers(0, 2**32 - 1),
    spread=st.sampled_from([0.02, 0.3, 1.0, 2.5]),
    shift=st.floats(-2.0, 2.0),
)


def _find(targets, sources, grid, capacity, sees=None, kind=None, same=False):
    sees = np.full(len(targets), 1) if sees is None else sees
    kind = np.full(len(sources), 1) if kind is None else kind
    return search_(
        jnp.asarray(targets, jnp.float32),
        jnp.asarray(sources, jnp.float32),
        grid,
        capacity,
        jnp.asarray(sees, jnp.int32),
        jnp.asarray(kind, jnp.int32),
        same,
    )


def _matrix(table, sources):
    """Number of times that each source is in the list of each target, `[N, M]`."""
    indices = np.asarray(table.indices)
    count = np.zeros((indices.shape[1], sources + 1), int)
    np.add.at(count, (np.broadcast_to(np.arange(indices.shape[1]), indices.shape), indices), 1)
    return count[:, :-1]


def _assert_same(table, targets, sources, radius, may=True, same=False):
    targets, sources = np.float32(targets), np.float32(sources)
    r = np.linalg.norm(targets[:, None].astype(float) - sources[None], axis=-1)
    may = np.broadcast_to(may, r.shape).copy()
    if same:
        np.fill_diagonal(may, False)
    found = _matrix(table, len(sources))
    # A pair at the radius to within float32's rounding of the squares may fall on either side.
    clear = np.abs(r / radius - 1.0) > 1e-5
    expected = (r < radius) & may
    np.testing.assert_array_equal(found[clear], expected[clear].astype(int))
    assert found.max(initial=0) <= 1


@settings(max_examples=60, deadline=None)
@given(**CLOUDS)
def test_table_is_brute_force(dim, seed, spread, shift):
    """For any positions: negative coordinates, all in one cell, or outside the grid's box."""
    rng = np.random.default_rng(seed)
    targets = shift + spread * rng.normal(size=(N, dim))
    sources = np.concatenate([targets, shift + spread * rng.normal(size=(M - N, dim))])
    table = _find(targets, sources, GRIDS[dim], M, same=True)
    assert not table.overflow
    _assert_same(table, targets, sources, RADIUS, same=True)


PERIODS = {2: [((0, 1.4),), ((1, 1.4),), ((0, 1.4), (1, 1.7))], 3: [((0, 1.4), (2, 1.7))]}
LOW = -0.6


@settings(max_examples=25, deadline=None)
@given(dim=st.sampled_from([2, 3]), which=st.integers(0, 2), seed=st.integers(0, 2**32 - 1))
def test_periodic_table_is_brute_force_with_nearest_images(dim, which, seed):
    """Also for positions exactly at an end of the period, and outside the box along the other axes."""
    period = PERIODS[dim][which % len(PERIODS[dim])]
    rng = np.random.default_rng(seed)
    length = np.array([dict(period).get(axis, 2.0) for axis in range(dim)])
    sources = LOW + rng.random((M, dim)) * length
    sources[:3] = LOW + (np.arange(3)[:, None] - 1.0) * length * 1e-7  # around the seam
    sources, _ = wrap(jnp.float32(sources), jnp.zeros((M, dim)), (LOW,) * dim, period)
    sources = np.asarray(sources)
    grid = grid_over(np.full(dim, LOW), LOW + length, RADIUS, period)
    found = _matrix(_find(sources[:N], sources, grid, M, same=True), M)
    r = sources[:N, None].astype(float) - sources[None]
    for axis, a in period:
        r[..., axis] -= a * np.round(r[..., axis] / a)
    r = np.linalg.norm(r, axis=-1)
    clear = np.abs(r / RADIUS - 1.0) > 1e-5  # rounding, as below
    np.fill_diagonal(clear, False)
    np.testing.assert_array_equal(found[clear], (r < RADIUS)[clear].astype(int))
    assert found.max() == 1 and not found[np.arange(N), np.arange(N)].any()


@settings(max_examples=60, deadline=None)
@given(x=st.floats(-1.25, 2.25, width=32, allow_subnormal=False), carry=st.sampled_from([-1e-8, 0.0, 1e-8]))
def test_wrapping_moves_by_the_period_exactly(x, carry):
    """The carry has the part of the sum that float32 cannot hold, within its own rounding, 1e-7 of 1e-7.

    Positions below 1e-38 m are flushed to zero.
    """
    length, low = np.float32(1.7), np.float32(-0.6)
    place = jnp.full((1, 2), x, jnp.float32)
    new, rest = wrap(place, jnp.full((1, 2), carry, jnp.float32), (-0.6, -0.6), ((0, 1.7),))
    new, rest = np.asarray(new, float), np.asarray(rest, float)
    assert new[0, 1] == np.float32(x) and rest[0, 1] == np.float32(carry)
    assert low <= new[0, 0] <= low + length or not (low - length <= x < low + 2 * length)
    moved = (new[0, 0] + rest[0, 0]) - (float(np.float32(x)) + float(np.float32(carry)))
    assert min(abs(moved - k * float(length)) for k in (-1, 0, 1)) < 1e-13


def test_short_period_is_refused():
    with pytest.raises(ValueError, match="period = 1 m along axis 1 is too short"):
        grid_over(np.zeros(2), np.ones(2), RADIUS, ((1, 1.0),))


@functools.cache
def _sums_at_points(dim, period):
    """Sums over the water at all points, at the points near it, and their number if the capacity is small."""
    grid = grid_over(np.zeros(dim), BOX[:dim], 0.12, period)
    smoothing = Smoothing(WendlandC2(), jnp.float32(0.06), period)

    @jax.jit
    def sums(points, x):
        water, sees = Seen(x, jnp.ones(len(x), jnp.int32)), jnp.ones(len(points), jnp.int32)
        fields = {"x": columns(points)}, Sources({"x": columns(x)}, {})

        def over(places):
            slabs = Slabs(points=places)
            table, most, crowd = point_neighbours(slabs, Cells(grid), points, sees, water, 60)
            return table.sum(lambda pair, i, j: pair.W, smoothing, *fields), most, crowd

        return over(0)[:2], over(len(points) - 1)[::2], over(1)[2]

    return sums


BOX = np.array([2.0, 1.0, 1.0])


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), kind=st.sampled_from([(2, ()), (2, ((1, 1.0),)), (3, ())]))
def test_points_away_from_the_water_are_left_out_without_loss(seed, kind):
    """The sums are those with all points, for points in a tank that the water fills only in part."""
    dim, period = kind
    random = np.random.default_rng(seed)
    points = random.uniform(0.0 if period else -0.1, 1.0, (200, dim)) * BOX[:dim]
    x = random.uniform(0.0, 1.0, (60, dim)) * BOX[:dim]
    x[:, -1] *= 0.2
    arrays = jnp.asarray(points, jnp.float32), jnp.asarray(x, jnp.float32)
    (every, most), (found, crowd), asked = _sums_at_points(dim, period)(*arrays)
    assert most <= 60
    assert np.sum(np.asarray(every) > 0) <= crowd < 200
    np.testing.assert_array_equal(found, every)
    assert asked == crowd > 1


@settings(max_examples=30, deadline=None)
@given(**CLOUDS)
def test_masks_are_respected(dim, seed, spread, shift):
    rng = np.random.default_rng(seed)
    targets, sources = (shift + spread * rng.normal(size=(n, dim)) for n in (N, M))
    sees, kind = rng.integers(0, 16, N), 1 << rng.integers(0, 5, M)
    table = _find(targets, sources, GRIDS[dim], M, sees, kind)
    _assert_same(table, targets, sources, RADIUS, may=(sees[:, None] & kind[None]) != 0)


def test_table_is_jax_md_s():
    from jax_md import partition, space

    rng = np.random.default_rng(0)
    x = jnp.asarray(rng.uniform(0.1, 3.9, size=(400, 2)), jnp.float32)  # jax-md needs positive coordinates
    displacement, _ = space.free()
    neighbor_fn = partition.neighbor_list(displacement, 4.0, RADIUS, dr_threshold=0.0)
    theirs = np.asarray(neighbor_fn.allocate(x).idx)
    listed = np.zeros((400, 401), int)
    np.add.at(listed, (np.broadcast_to(np.arange(400)[:, None], theirs.shape), theirs), 1)
    table = _find(x, x, grid_over(np.zeros(2), np.full(2, 4.0), RADIUS), 64, same=True)
    r = np.linalg.norm(np.asarray(x)[:, None] - np.asarray(x)[None], axis=-1)
    clear = np.abs(r / RADIUS - 1.0) > 1e-5  # rounding, as above
    np.fill_diagonal(clear, False)  # jax-md lists no particle as its own neighbour, or drops it later
    np.testing.assert_array_equal(_matrix(table, 400)[clear], listed[:, :-1][clear])
    assert listed[:, :-1][clear].sum() > 400


def test_overflow_is_flagged_and_says_how_much():
    x = 0.05 * np.random.default_rng(1).normal(size=(30, 2))
    short, enough = (_find(x, x, GRIDS[2], capacity, same=True) for capacity in (28, 29))
    assert short.overflow and int(short.most) == 29
    assert not enough.overflow and needed_capacity(29) >= 29
    # The slots that there are hold true neighbours, each of them once.
    assert np.all(np.asarray(short.indices) < 30) and _matrix(short, 30).max() == 1


def test_slots_of_ten_million_targets_are_indexed_without_overflow():
    """Traced only: no index computed from a slot and a target is too large for int32."""

    def write(slot, source):
        rows, put = cells._slots(251, 10_000_000)
        return put(rows, slot, source)

    some = jax.ShapeDtypeStruct((10_000_000,), jnp.int32)
    jaxpr = jax.make_jaxpr(write)(some, some).jaxpr
    assert jaxpr.outvars[0].aval.shape == (251, 10_000_000)
    products = [e for e in jaxpr.eqns if e.primitive.name == "mul"]
    assert not products, "slot times number of targets overflows int32"


def test_large_tables_are_written_like_small_ones(monkeypatch):
    x = np.random.default_rng(5).uniform(-1, 1, size=(N, 2))
    expected = _find(x, x, GRIDS[2], M, same=True)
    monkeypatch.setattr(cells, "LARGEST_INDEX", 0)
    x, every = jnp.asarray(x, jnp.float32), jnp.ones(N, jnp.int32)
    found = search(x, x, GRIDS[2], M, every, every, True)
    np.testing.assert_array_equal(found.indices, expected.indices)


def test_empty_slots_come_last_and_hold_the_empty_index():
    x = np.random.default_rng(2).uniform(-1, 1, size=(N, 2))
    indices = np.asarray(_find(x, x, GRIDS[2], M, same=True).indices)
    empty = indices == N
    assert empty.any() and indices.max() == N and indices.min() >= 0
    assert np.all(empty[1:] >= empty[:-1])


@settings(max_examples=20, deadline=None)
@given(**CLOUDS)
def test_cell_order_is_a_permutation_that_sorts(dim, seed, spread, shift):
    x = jnp.asarray(shift + spread * np.random.default_rng(seed).normal(size=(N, dim)), jnp.float32)
    order = np.asarray(cell_order(x, GRIDS[dim]))
    assert sorted(order) == list(range(N))
    # A sorted set stays as it is.
    np.testing.assert_array_equal(cell_order(x[order], GRIDS[dim]), np.arange(N))


def test_table_is_constant_to_a_derivative():
    x = jnp.asarray(np.random.default_rng(3).uniform(-1, 1, size=(N, 2)), jnp.float32)
    ones = jnp.ones(N, jnp.int32)
    find = functools.partial(search, grid=GRIDS[2], capacity=M, sees=ones, kind=ones, same=True)
    _, tangent = jax.jvp(lambda a: find(a, a).indices, (x,), (jnp.ones_like(x),))
    assert tangent.dtype == jax.dtypes.float0


@pytest.mark.parametrize("radius", [0.1, 5.0])
def test_grid_covers_its_box(radius):
    grid = grid_over(np.array([-1.0, 0.0]), np.array([2.0, 0.3]), radius)
    assert isinstance(grid, Grid) and grid.radius == pytest.approx(radius)
    assert all(n * grid.cell >= span - 1e-12 for n, span in zip(grid.shape, (3.0, 0.3), strict=True))


# --- by jax-md


@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), dim=st.sampled_from([2, 3]), same=st.booleans())
def test_jax_md_s_table_is_the_default_s(seed, dim, same):
    """With masks, and with targets that are not sources; slots are in the order of the sources' indices."""
    rng = np.random.default_rng(seed)
    sources = rng.uniform(-1, 1, (M, dim))
    targets = sources[:N] if same else rng.uniform(-1, 1, (N, dim))
    sees, kind = rng.integers(1, 4, N).astype(np.int32), (1 << rng.integers(0, 2, M)).astype(np.int32)
    # capacity for all: cells then have one size, and are compiled once for each dimension
    method = JaxMD.of(GRIDS[dim], *np.zeros((2, 20, dim)))
    targets, sources = jnp.asarray(targets, jnp.float32), jnp.asarray(sources, jnp.float32)
    found = table_(method, targets, sources, M, sees, kind, same)
    assert not found.overflow
    indices = np.asarray(found.indices)
    assert np.all(np.diff(indices, axis=0) >= 0)
    r = np.linalg.norm(np.asarray(targets)[:, None] - np.asarray(sources)[None], axis=-1)
    clear = np.abs(r / RADIUS - 1.0) > 1e-5  # rounding, as above
    expected = _find(targets, sources, GRIDS[dim], M, sees, kind, same)
    np.testing.assert_array_equal(_matrix(found, M)[clear], _matrix(expected, M)[clear])
    assert int(found.most) == np.max(np.sum(indices < M, axis=0))


table_ = jax.jit(lambda method, *a: method.table(*a), static_argnums=(3, 6))


def test_jax_md_s_overflows_are_flagged():
    """Overflows of the table and of a cell; with a larger capacity neither overflows."""
    x = jnp.asarray(0.05 * np.random.default_rng(1).normal(size=(30, 2)), jnp.float32)
    every = jnp.ones(30, jnp.int32)
    method = JaxMD.of(GRIDS[2], x, x)
    assert not table_(method, x, x, 29, every, every, True).overflow
    short = table_(method, x, x, 28, every, every, True)
    assert short.overflow and int(short.most) == 29
    small = JaxMD(method.origin, method.box, method.radius, (8, 8))
    assert table_(small, x, x, 29, every, every, True).overflow
    while min(small.cell_capacity) < 30:
        small = small.grown()
    assert not table_(small, x, x, 29, every, every, True).overflow
    assert Cells(GRIDS[2]).grown() == Cells(GRIDS[2])


def test_jax_md_refuses_a_period():
    grid = grid_over(np.zeros(2), np.full(2, 4.0), RADIUS, ((0, 4.0),))
    with pytest.raises(ValueError, match=r'search = "jax_md" does not support periodic axes'):
        JaxMD.of(grid, *np.zeros((2, 1, 2)))


def test_a_missing_jax_md_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "jax_md", None)
    with pytest.raises(js.CaseError, match=r'search = "jax_md" .*pip install "jaxsph\[jax-md\]"'):
        js.build(coarse("hydrostatic", {"search": "jax_md"}))


@pytest.mark.slow
def test_a_tank_at_rest_is_the_default_s():
    """Ten steps: pressures differ by the order of summation only, 1e-7 of each term in float32."""
    found = []
    for name in ("cells", "jax_md"):
        case = coarse("hydrostatic", {"search": name})
        model, state = js.build(case)
        state, _ = advance(case, model, state, 1)
        assert not int(state.status.bits)
        p = state.particles
        found.append(np.asarray(model.scheme.pressure(p))[np.argsort(p.id)])
    np.testing.assert_allclose(*found, atol=1e-4 * found[0].max())


@pytest.mark.slow
def test_a_wave_in_the_owc_is_the_default_s():
    """A wave through the coarse OWC: equal to 1e-4 of the wave for 0.4 s, and later as far as round-off
    allows.

    Another order of summation makes the paths of particles diverge exponentially. The later bounds are the
    changes of the default's own readings after a random shift of all positions by 1e-7 m (the largest of four
    seeds): elevation 1.0e-4, chamber level 2.7e-4, P_a 4.0e-4, flow 1.2e-2, point pressures 6.0e-2. Measured
    here: 6.9e-5, 2.0e-4, 2.1e-4, 6.1e-3, 2.6e-2.
    """
    found = []
    for name in ("cells", "jax_md"):
        case = coarse("owc", {"search": name})
        solution = run(case, t1=case.waves.T, progress=False)
        found.append({k: np.asarray(v) for k, v in solution.series.items()})
    head, area = 1000.0 * 9.81 * case.waves.H, case.device.chamber_length * case.waves.H
    flow = np.pi * area / case.waves.T
    for name, size, later in (
        ("eta", case.waves.H, 1.0e-4),
        ("chamber_level", case.waves.H, 2.7e-4),
        ("P_a", head, 4.0e-4),
        ("flow", flow, 1.2e-2),
        ("pressure", head, 6.0e-2),
    ):
        theirs, ours = found[1][name] / size, found[0][name] / size
        np.testing.assert_allclose(theirs[:40], ours[:40], rtol=0, atol=1e-4, err_msg=name)
        np.testing.assert_allclose(theirs, ours, rtol=0, atol=later, err_msg=name)
