"""Noise of the particles: zero in a linear flow, otherwise equal to that of a plain fit; its derivatives."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import shaken, with_velocity
from hypothesis import given, settings
from hypothesis import strategies as st

import jaxsph as js
from jaxsph.probes.noise import REACH, WIDTH

EPS = float(np.finfo(np.float32).eps)


NOISE = js.NoiseProbe()


@jax.jit
def read(model, state):
    """(readings, state, tables) with new tables."""
    state, tables = model.scheme.prepare(model, state)
    return NOISE.measure(model, state, tables), state, tables


@pytest.fixture(scope="module", params=["hydrostatic", "hydrostatic_3d"])
def tank(request):
    """(model, state) of a tank in two or three dimensions."""
    return request.getfixturevalue(request.param)[1:]


def without(state, gone):
    """The state in which the particles `gone` have no mass, as beyond an open rim, and move fast."""
    p = state.particles
    u = jnp.where(gone[:, None], 100.0, p.u)
    return eqx.tree_at(lambda s: (s.particles.m, s.particles.u), state, (jnp.where(gone, 0.0, p.m), u))


@settings(max_examples=30, deadline=None)
@given(
    seed=st.integers(0, 2**31),
    offset=st.floats(-10.0, 10.0, width=32),
    share=st.floats(0.0, 0.3),
    gone=st.sampled_from([0.0, 0.2]),
)
def test_linear_flow_has_no_noise(tank, seed, offset, share, gone):
    model, state = tank
    rng = np.random.default_rng(seed)
    moved = shaken(state, float(model.dx), rng, share)
    x = np.float64(moved.particles.x)
    u = x @ rng.normal(size=(x.shape[1],) * 2) + offset
    moved = without(with_velocity(moved, u), rng.random(len(x)) < gone)
    readings, *_ = read(model, moved)
    # The velocities of the particle and of the neighbours in its fit are rounded by up to half of EPS; sums
    # of differences to the particle's velocity are rounded less. The worst of 300 flows had 0.3 EPS.
    assert float(readings["noise"]) < 2 * EPS * np.abs(u).max()
    assert float(readings["rms_speed"]) <= 1.01 * np.sqrt(np.sum(u**2, axis=1)).max()


def plain_deviation(x, u, dx):
    """Velocities minus fits over neighbours within `REACH` dx, each by one dense least-squares solution."""
    found = []
    for here, own in zip(x, u, strict=True):
        r = (x - here) / dx
        r2 = np.sum(r**2, axis=1)
        near = r2 < REACH**2
        root = np.exp(-0.5 * r2[near] / WIDTH**2)[:, None]  # root of the weight
        terms = np.column_stack([np.ones(near.sum()), r[near]])
        fit = np.linalg.lstsq(root * terms, root * u[near], rcond=None)[0]
        found.append(own - fit[0])
    return np.array(found)


def test_noise_is_the_plain_fit_s(tank):
    """Random velocities on a slightly disturbed lattice; otherwise rounding would decide at 3 dx exactly."""
    model, state = tank
    rng = np.random.default_rng(4)
    moved = shaken(state, float(model.dx), rng, 0.01)
    s = 0.1
    readings, found, _ = read(model, with_velocity(moved, s * rng.normal(size=moved.particles.x.shape)))
    p = found.particles
    expected = plain_deviation(np.float64(p.x), np.float64(p.u), float(model.dx))
    rms, speed = (np.sqrt(np.mean(np.sum(np.float64(a) ** 2, axis=1))) for a in (expected, p.u))
    # float32 sums over up to a hundred neighbours, times inverse covariances of a few at the surface
    assert float(readings["noise"]) == pytest.approx(rms, rel=1e-5)
    assert float(readings["rms_speed"]) == pytest.approx(speed, rel=1e-5)
    # a fit over n neighbours follows a few n-ths of random velocities: most of their size is noise
    assert 0.7 * s < rms / np.sqrt(p.x.shape[1]) < s


def test_particles_without_neighbours_take_no_part(tank):
    """Two particles remain, far apart or side by side; along a line a fit has no slope."""
    model, state = tank
    u = np.random.default_rng(1).normal(size=state.particles.x.shape)
    index = np.arange(len(u))
    for pair in ([0, len(u) - 1], [0, 1]):
        alone = without(with_velocity(state, u), jnp.asarray(~np.isin(index, pair)))
        readings, *_ = read(model, alone)
        speed = np.sqrt(np.mean(np.sum(np.float64(u[pair]) ** 2, axis=1)))
        assert float(readings["noise"]) == 0.0
        assert float(readings["rms_speed"]) == pytest.approx(speed, rel=1e-5)


def test_water_at_rest_has_finite_derivatives(hydrostatic):
    """The noise is a norm, whose slope at zero is defined as zero."""
    _, model, state = hydrostatic
    _, state, tables = read(model, with_velocity(state, 0.0))

    def noise(u):
        return NOISE.measure(model, with_velocity(state, u), tables)["noise"]

    found = jax.jit(jax.value_and_grad(noise))
    still, slope = found(state.particles.u)
    assert float(still) == 0.0 and np.all(np.asarray(slope) == 0.0)
    u = jnp.asarray(np.random.default_rng(2).normal(size=state.particles.u.shape), jnp.float32)
    # the noise is homogeneous in the velocities, so that its slope along them is the noise itself (Euler)
    value, slope = found(u)
    assert float(jnp.sum(slope * u)) == pytest.approx(float(value), rel=1e-5)
