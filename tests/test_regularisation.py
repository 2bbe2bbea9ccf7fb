"""Regularisation of the particles: what it leaves unchanged, what it conserves, and what it takes."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import shaken, with_velocity
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxsph.model.regularisation import PAIR, WHOLE, Regularisation

EPS = float(np.finfo(np.float32).eps)
ONE = Regularisation(jnp.float32(1.0), jnp.float32(3.0))


@jax.jit
def regularised(model, state):
    """(regularised, state) with new tables, after the time of one step."""
    state, tables = model.scheme.prepare(model, state)
    return ONE.apply(model.scheme, model, state.particles, tables, model.dt), state


@pytest.fixture(scope="module", params=["hydrostatic", "hydrostatic_3d"])
def tank(request):
    """(model, state) of a tank in two or three dimensions."""
    return request.getfixturevalue(request.param)[1:]


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**31), offset=st.floats(-10.0, 10.0, width=32), share=st.floats(0.0, 0.15))
def test_linear_flow_is_left_alone(tank, seed, offset, share):
    model, state = tank
    rng = np.random.default_rng(seed)
    moved = shaken(state, float(model.dx), rng, share)
    x = np.float64(moved.particles.x)
    u = x @ rng.normal(size=(x.shape[1],) * 2) + offset
    done, after = regularised(model, with_velocity(moved, u))
    # The gradient's rounding times a spacing is a few EPS of the largest speed; the rate times dt is below 1.
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
    assert float(done.lost["hyperviscosity"]) > 0.0


def test_noise_decays_at_the_stated_rate(hydrostatic):
    """Velocities that alternate between neighbours lose 1 to 2 times the rate, relative to their size."""
    _, model, state = hydrostatic
    ij = np.rint(np.asarray(state.particles.x) / float(model.dx) - 0.5).sum(1)
    u = np.outer((-1.0) ** ij, [1.0, 0.0])
    done, after = regularised(model, with_velocity(state, u))
    x = np.asarray(after.particles.x)
    inner = np.all((x > 0.35) & (x < 0.65), axis=1)
    rate = float(jnp.sqrt(jnp.sqrt(jnp.sum(model.g**2)) / model.scheme.smoothing.h))
    share = 1.0 - np.asarray(done.u)[inner, 0] / np.asarray(after.particles.u)[inner, 0]
    # nearest neighbours, which have most of the weight, have opposite velocities: u_j - u_i = -2 u_i
    assert inner.sum() == 4 and np.all(share > 0.9 * rate * float(model.dt))
    assert np.all(share < 2.0 * rate * float(model.dt))


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
