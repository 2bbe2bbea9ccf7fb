"""Regularisation of the particles: what it leaves unchanged, what it conserves, and what it takes."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import shaken, with_velocity
from hypothesis import given, settings
from hypothesis import strategies as st

import jaxsph as js
from jaxsph.model.regularisation import PAIR, WHOLE, Regularisation

EPS = float(np.finfo(np.float32).eps)
ONE = Regularisation(jnp.float32(1.0), jnp.float32(3.0))


@jax.jit
def regularised(model, state):
    """(regularised, state) with new tables, after the time of one step."""
    state, tables = model.scheme.prepare(model, state)
    return ONE.apply(model.scheme, model, state.particles, tables, model.dt), state


@pytest.fixture(
    scope="module", params=["hydrostatic", pytest.param("hydrostatic_3d", marks=pytest.mark.slow)]
)
def tank(request):
    """(model, state) of a tank in two or three dimensions."""
    return request.getfixturevalue(request.param)[1:]


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**31), offset=st.floats(-10.0, 10.0, width=32), share=st.floats(0.0, 0.15))
def test_flow_of_second_degree_is_left_alone(tank, seed, offset, share):
    model, state = tank
    rng = np.random.default_rng(seed)
    moved = shaken(state, float(model.dx), rng, share)
    x = np.float64(moved.particles.x)
    dim = x.shape[1]
    u = offset + x @ rng.normal(size=(dim, dim)) + (x**2) @ rng.normal(size=(dim, dim))
    u += (x[:, :1] * x[:, -1:]) * rng.normal(size=dim)
    done, after = regularised(model, with_velocity(moved, u))
    # the residuals' rounding, and what the ridge changes, are some EPS of the speed; the rate times dt is
    # below 1
    assert float(jnp.max(jnp.abs(done.u - after.particles.u))) < 20 * EPS * np.abs(u).max()
    # no neighbour is closer than 0.6 spacings if no particle has moved by more than 0.15
    assert not np.any(np.asarray(done.moved))


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**31), share=st.floats(0.0, 0.5))
def test_momentum_is_kept_and_noise_loses_energy(tank, seed, share):
    model, state = tank
    rng = np.random.default_rng(seed)
    start = shaken(state, float(model.dx), rng, share)
    done, after = regularised(model, with_velocity(start, rng.normal(size=start.particles.x.shape)))
    p = after.particles
    m = np.float64(p.m)[:, None]
    change = np.float64(done.u) - np.float64(p.u)
    # every velocity is rounded after its change, by up to EPS of itself
    assert np.allclose((m * change).sum(0), 0.0, atol=EPS * np.abs(m * np.float64(p.u)).sum())
    moves = m * np.float64(done.moved)
    assert np.allclose(moves.sum(0), 0.0, atol=len(m) * EPS * np.abs(moves).max())
    kinetic = 0.5 * float(np.sum(m * (np.float64(p.u) ** 2 - np.float64(done.u) ** 2)))
    lifted = -float(np.sum(moves @ np.float64(model.g)))
    # the ledger's losses equal the energy lost, to the rounding of float32 sums
    booked = sum(float(loss) for loss in done.lost.values())
    scale = 0.5 * float(np.sum(m * np.float64(p.u) ** 2))
    assert booked == pytest.approx(kinetic - lifted, abs=20 * EPS * scale)
    # separation leaves velocities alone: a pair that is pressed together again and again gains no energy
    assert kinetic > 0.0
    assert float(done.lost["hyperviscosity"]) > 0.0


def damping(model, k):
    """Damping of a plane wave (rad per spacing along x and z) on a square lattice, over the rate."""
    support = float(model.scheme.smoothing.radius / model.dx)
    grid = np.stack(np.meshgrid(*(np.arange(-4, 5),) * 2), -1).reshape(-1, 2)
    grid = grid[(grid**2).sum(1) < support**2]
    grid = grid[grid.any(axis=1)]
    w = (1.0 - (grid**2).sum(1) / support**2) ** 2
    basis = np.stack([*grid.T, grid[:, 0] ** 2, grid[:, 1] ** 2, grid[:, 0] * grid[:, 1]], 1)
    wave = np.exp(1j * grid @ np.asarray(k)) - 1.0
    root = np.sqrt(w / w.sum())
    left = wave - basis @ np.linalg.lstsq(root[:, None] * basis, root * wave, rcond=None)[0]
    return float(np.sum(w * abs(left) ** 2) / w.sum())


@pytest.fixture(scope="module")
def wide():
    """(model, state) of a tank whose middle is more than two supports from walls and surface."""
    return js.build(js.load_case("hydrostatic").replace({"dx": 0.04, "probes": None}))


@pytest.mark.parametrize("k", [(np.pi, np.pi), (np.pi, 0.0), (1.5, 0.7), (0.5, 0.0)])
def test_waves_decay_as_the_least_squares_say(wide, k):
    """Particles in the middle of the tank see a lattice without an end."""
    model, state = wide
    x = np.asarray(state.particles.x)
    middle = x[np.argmin(np.sum((x - 0.5) ** 2, axis=1))]
    u = np.outer(np.cos((x - middle) / float(model.dx) @ np.asarray(k)), [1.0, 0.0])
    done, after = regularised(model, with_velocity(state, u))
    at = int(np.argmin(np.sum((np.asarray(after.particles.x) - middle) ** 2, axis=1)))
    share = 1.0 - float(done.u[at, 0] / after.particles.u[at, 0])
    rate = float(jnp.sqrt(jnp.sqrt(jnp.sum(model.g**2)) / model.scheme.smoothing.h))
    # masses exceed rho0 dx^2 by up to 1 %; float32 rounds the velocity
    expected = -np.expm1(-rate * float(model.dt)) * damping(model, k)
    assert share == pytest.approx(expected, rel=0.012, abs=2 * EPS)


def test_damping_falls_with_the_sixth_power_of_the_wavenumber(hydrostatic):
    model = hydrostatic[1]
    assert damping(model, (0.1, 0.0)) / damping(model, (0.05, 0.0)) == pytest.approx(2.0**6, rel=0.02)
    # noise, as the docstring says
    assert 1.3 < damping(model, (np.pi, np.pi)) < 1.6 and 1.3 < damping(model, (np.pi, 0.0)) < 1.6


def test_pairs_part_and_their_middle_stays(hydrostatic):
    _, model, state = hydrostatic
    dx = float(model.dx)
    x = np.array(state.particles.x)
    order = np.argsort(np.sum((x - 0.5) ** 2, axis=1))
    a, b = order[0], order[1]
    x[b] = x[a] + np.array([0.2 * dx, 0.0])
    state = eqx.tree_at(lambda s: s.particles.x, state, jnp.asarray(x))
    done, after = regularised(model, state)
    moved = np.asarray(done.moved)
    pair = np.flatnonzero(np.any(moved != 0.0, axis=1))
    assert len(pair) == 2
    at = np.asarray(after.particles.x)[pair]
    away = (at[1] - at[0]) / np.linalg.norm(at[1] - at[0])
    rate = 3.0 * float(jnp.sqrt(jnp.sqrt(jnp.sum(model.g**2)) / model.scheme.smoothing.h))
    part = (moved[pair[1]] - moved[pair[0]]) @ away
    # each particle moves at the rate times the initial overlap of 1 - 0.2/0.6, and by at most half of the
    # pair's distance; masses exceed rho0 dx^2 by up to 1 %
    share = -WHOLE * np.expm1(-rate * float(model.dt) / WHOLE)
    assert part == pytest.approx(2 * share * dx * (1 - 0.2 / PAIR), rel=0.02)
    assert np.allclose(moved[pair[0]], -moved[pair[1]], rtol=0.02)


def test_slopes_at_rest_are_finite(hydrostatic):
    _, model, state = hydrostatic

    def energy(u):
        done, _ = regularised(model, eqx.tree_at(lambda s: s.particles.u, state, u))
        return jnp.sum(done.u**2) + jnp.sum(done.moved)

    assert bool(jnp.all(jnp.isfinite(jax.grad(energy)(state.particles.u))))
