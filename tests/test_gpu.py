"""Results on an accelerator compared with those on the CPU: `pytest -m gpu` where there is one."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import advance, coarse

import jaxsph as js
from jaxsph.core.arrays import columns
from jaxsph.core.kernels import Gaussian
from jaxsph.core.pairs import Smoothing, pair_sum, with_empty
from jaxsph.core.search.cells import grid_over, search

pytestmark = pytest.mark.gpu

RADIUS = 0.12


def _on_both(function):
    """Results of a function on the CPU and on the default device, which must be an accelerator."""
    if jax.default_backend() == "cpu":
        pytest.skip("jax sees no accelerator here")
    with jax.default_device(jax.devices("cpu")[0]):
        here = jax.tree.map(np.asarray, function())
    return here, jax.tree.map(np.asarray, function())


def _places():
    """A disturbed lattice of 20 by 20 points, with no distance within rounding of the radius."""
    at = np.stack(np.meshgrid(*[np.arange(20) * 0.05] * 2), -1).reshape(-1, 2)
    return jnp.asarray(at + np.random.default_rng(0).uniform(-0.01, 0.01, at.shape), jnp.float32)


def _table(x):
    every = jnp.ones(len(x), jnp.int32)
    grid = grid_over(np.full(2, -0.05), np.full(2, 1.05), RADIUS)
    return jax.jit(search, static_argnums=(2, 3, 6))(x, x, grid, 40, every, every, True)


def test_the_search_finds_the_same_neighbours():
    """Compared as sets, because the order of slots follows from the sorting of the cells."""
    cpu, gpu = _on_both(lambda: _table(_places()))
    assert cpu.most == gpu.most
    np.testing.assert_array_equal(np.sort(cpu.indices, axis=0), np.sort(gpu.indices, axis=0))


def test_a_pair_sum_is_the_same():
    """To the rounding of float32 over some twenty terms: 20 x 1.2e-7 of the sum of their sizes."""

    def volumes():
        x = _places()
        fields = {"x": columns(x), "V": jnp.full(len(x), 0.05**2)}
        smoothing = Smoothing(Gaussian(), jnp.float32(RADIUS / 3))
        law = lambda pair, _, j: j["V"] * pair.W  # noqa: E731
        return jax.jit(lambda t: pair_sum(law, smoothing, fields, with_empty(fields), t))(_table(x).indices)

    cpu, gpu = _on_both(volumes)
    np.testing.assert_allclose(gpu, cpu, rtol=2.4e-6)


def test_ten_steps_of_the_owc_are_the_same():
    """Positions to 1e-6 m in 2.4 m (rounding is 2e-7 m a step); pressures to 1e-4 of the largest."""
    case = coarse("owc")

    def run():
        model, state = js.build(case)
        state, _ = advance(case, model, state, 1)
        order = jnp.argsort(state.particles.id)
        return state.particles.x[order], model.scheme.pressure(state.particles)[order], state.status.bits

    (x, p, bits), (x_gpu, p_gpu, bits_gpu) = _on_both(run)
    assert bits == bits_gpu == 0
    np.testing.assert_allclose(x_gpu, x, rtol=0, atol=1e-6)
    np.testing.assert_allclose(p_gpu, p, rtol=0, atol=1e-4 * np.max(p))
