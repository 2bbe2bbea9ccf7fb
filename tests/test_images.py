"""Mirror images: a wall acts as the middle of a tank twice as long, and kernels are full in corners."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import coarse
from hypothesis import given, settings
from hypothesis import strategies as st

import jaxsph as js
from experiments.common import lattice
from jaxsph.core.kernels import Gaussian
from jaxsph.core.pairs import Smoothing
from jaxsph.parts.paddle import Paddle
from jaxsph.schemes.incompressible import ISPH
from jaxsph.solids.box import Box, FreeSlip, Platform
from jaxsph.solids.filling import MirrorNodes
from jaxsph.solids.images import Images

DX = 0.05
SCHEMES = {"incompressible": ISPH, "weakly_compressible": js.DeltaSPH}


def _tank(kind, length, side, x, u):
    """A tank with a floor and the given sides, with particles of volume DX^2."""
    box = Box((0.0, 0.0), (length, 0.8), sides=(side, "floor"))
    # regularisation and density diffusion use the water alone, without images
    given = {"separation": 0.0, "hyperviscosity": 0.0}
    given |= {"dim": 2, "speed": 1.0} if kind == "incompressible" else {"c0": 20.0, "delta": 0.0}
    scheme = SCHEMES[kind].of(DX, period=box.period, **given)
    walls = js.Ghosts.build(box, DX, scheme.smoothing, FreeSlip())
    return js.assemble(x, u, scheme=scheme, walls=walls, dx=DX, sample_dt=0.02, g=(0.0, -9.81))


@jax.jit
def _step(model, state):
    """Velocities and pressures by id after one step."""
    state, tables = model.scheme.prepare(model, state)
    p = model.scheme.step(model, state, tables).particles
    order = jnp.argsort(p.id)
    return p.u[order], model.scheme.pressure(p)[order]


@pytest.mark.parametrize(
    "kind", ["incompressible", pytest.param("weakly_compressible", marks=pytest.mark.slow)]
)
def test_water_between_walls_is_half_of_a_periodic_tank_twice_as_long(kind):
    """With images, a disturbed lattice moves as in a periodic tank without the walls."""
    rng = np.random.default_rng(0)
    # not closer to a wall than half a spacing, where the contact springs begin to act
    x = lattice((0.0, 0.0), (1.0, 0.4), DX) + 0.1 * DX * rng.normal(size=(160, 2))
    x[:, 0] = np.clip(x[:, 0], 0.51 * DX, 1.0 - 0.51 * DX)
    both = np.concatenate([x, [2.0, 0.0] + x * [-1.0, 1.0]])
    u, p = _step(*_tank(kind, 1.0, "walls", x, 0.0 * x))
    there, expected = (a[: len(x)] for a in _step(*_tank(kind, 2.0, "periodic", both, 0.0 * both)))
    # the solver stops at 3e-3 of its right-hand side; sums are in float32
    np.testing.assert_allclose(p, expected, atol=5e-3 * np.abs(expected).max())
    np.testing.assert_allclose(u, there, atol=5e-3 * np.abs(there).max())


@pytest.mark.parametrize(
    "changes",
    [
        pytest.param({}, id="2-D"),
        pytest.param({"tank.width": 0.5, "dx": 0.125}, id="3-D", marks=pytest.mark.slow),
    ],
)
def test_kernels_are_full_at_walls_and_in_corners(changes):
    """Every particle below the surface has the kernel sum of a full lattice, at walls and in corners too."""
    case = coarse("hydrostatic", {"scheme.kind": "incompressible", "probes.pressure": None} | changes)
    model, state = js.build(case)
    z = np.arange(0.5 * case.dx, case.tank.depth, case.dx)
    state, tables = model.scheme.prepare(model, state)
    ghosts = model.scheme.place_ghosts(model, state, tables)
    own = {"x": tuple(state.particles.x.T), "V": model.scheme.volume(state.particles)}
    sources = ghosts.water.behind({"x": tuple(ghosts.x.T), "V": ghosts.V})
    fill = tables.fluid.sum(lambda pair, i, j: j["V"] * pair.W, model.scheme.smoothing, own, sources)
    W = model.scheme.smoothing.kernel.value(jnp.zeros(()), model.scheme.smoothing.h, case.dim)
    filled = np.asarray((fill + own["V"] * W) / model.scheme.lattice.full)
    deep = np.asarray(state.particles.x)[:, -1] < z[-1] - float(model.scheme.smoothing.radius)
    assert deep.sum() > 10
    np.testing.assert_allclose(filled[deep], 1.0, atol=2e-3)  # the kernel's cut, and rows placed at rest


@given(X=st.floats(-0.1, 0.1), seed=st.integers(0, 100))
@settings(max_examples=20, deadline=None)
def test_paddle_is_mirrored_in_where_it_is(X, seed):
    walls = _walls(paddle=True)
    paddle = Paddle(motion=None, rows=walls.paddle)
    own = eqx.tree_at(lambda a: a.X, paddle.start(np.float32), jnp.float32(X))
    x = jnp.asarray(np.random.default_rng(seed).random((walls.images.count, 2)), jnp.float32)
    images = walls.images.image(x, lambda a: paddle.place(own, a, a)[0])
    rows = slice(*walls.paddle)
    np.testing.assert_allclose(images[rows, 0], 2 * X - x[rows, 0], atol=1e-6)  # float32, values near one
    assert all(one.moves for one in walls.images.sets if one.rows[1] <= walls.paddle[1])


def _walls(paddle=False, platform=None, filling=None):
    smoothing = Smoothing(Gaussian(), jnp.asarray(1.2 * DX))
    box = Box((0.0, 0.0), (1.0, 0.8), paddle, stroke=2 * DX if paddle else 0.0)
    return js.Ghosts.build(box, DX, smoothing, FreeSlip(), platform=platform, filling=filling)


@settings(max_examples=20, deadline=None)
@given(at=st.floats(0.3, 0.7))
def test_images_end_with_their_wall(at):
    """A particle that passes the end of the bed keeps a share of its image: that of its cell over the bed."""
    walls = _walls(platform=Platform(0.5, 0.2))
    (bed,) = [one for one in walls.images.sets if one.planes[0].axis == 1 and len(one.planes) == 1]
    share = bed.share(jnp.asarray([[at, -0.02]]), DX)
    np.testing.assert_allclose(share, np.clip((0.5 - at) / DX + 0.5, 0.0, 1.0), atol=1e-5)


def test_more_water_than_images_is_a_failure_not_a_leak():
    case = coarse("hydrostatic", {"scheme.kind": "incompressible"})
    model, state = js.build(case)
    heap = state.particles.x.at[:, 0].multiply(0.2)  # all of the water beside one wall
    state = eqx.tree_at(lambda s: s.particles.x, state, heap)
    state, _ = jax.jit(lambda m, s: m.scheme.prepare(m, s))(model, state)
    assert int(state.status.bits) != 0


def test_a_platform_s_corners_are_full_beside_images():
    """Below the end of the bed and behind the end wall are ghosts as in a tank without images.

    Without these ghosts, water came through the corner of platform and end wall.
    """
    found = []
    for filling in (None, MirrorNodes()):
        x = np.asarray(_walls(platform=Platform(0.5, 0.2), filling=filling).x)
        behind = x[(x[:, 0] > 0.5) & (x[:, 1] < 0.2)]
        found.append(behind[np.lexsort(behind.T)])
    assert np.any(found[0][:, 0] > 1.0) and np.any(found[0][:, 1] < 0.0)
    np.testing.assert_array_equal(*found)


def test_walls_that_end_in_a_platform_have_no_corner_behind_it():
    box = Box((0.0, 0.0), (1.0, 0.8))
    plain, raised = (Images.of(box, p, DX, 3 * DX) for p in ((), (Platform(0.5, 0.2),)))
    corners = [{(p.axis, p.side) for p in one.planes} for one in plain.sets if len(one.planes) == 2]
    assert {(0, -1.0), (1, 1.0)} in corners and {(0, 1.0), (1, 1.0)} in corners
    left = [{(p.axis, p.side) for p in one.planes} for one in raised.sets if len(one.planes) == 2]
    assert left == [{(0, 1.0), (1, 1.0)}]
