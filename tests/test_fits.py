"""Polynomials of second degree around particles: the fields they reproduce, and sparse neighbours."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxsph.core.arrays import stack
from jaxsph.core.fits import RIDGE, moments, monomials, polynomials

COUNT = {2: 5, 3: 9}
"""Coefficients of a polynomial without constant term, by number of dimensions."""


@jax.jit
def fit(d, w, f, stiffness=0.0):
    """Polynomial of one component around one particle, and its values at the neighbours at d `[J, D]`."""
    columns = tuple(d.T)
    summed = tuple(jnp.sum(one) for one in moments(w, columns))
    right = tuple(jnp.sum(w * f * one) for one in monomials(columns))
    (c,) = polynomials(summed, (right,), d.shape[1], stiffness)
    return jnp.stack(c), stack(monomials(columns)) @ jnp.stack(c)


def neighbours(rng, count, dim):
    """Places and weights of neighbours, like those of a kernel."""
    d = rng.uniform(-2.0, 2.0, (count, dim))
    w = np.exp(-np.sum(d**2, axis=1))
    return jnp.float32(d), jnp.float32(w / w.sum())


@pytest.mark.parametrize("dim", [2, 3])
@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**31))
def test_a_field_of_second_degree_is_its_own_polynomial(dim, seed):
    rng = np.random.default_rng(seed)
    d, w = neighbours(rng, 60, dim)
    c = rng.normal(size=COUNT[dim])
    values = stack(monomials(tuple(d.T))) @ jnp.float32(c)
    found, at = fit(d, w, values)
    # the ridge and float32 each change the weighted sums by 1e-6 of the field, and single values by more
    # where weights are small
    assert float(jnp.sqrt(jnp.sum(w * (at - values) ** 2))) < 2e-5 * float(jnp.max(jnp.abs(values)))
    assert np.asarray(found) == pytest.approx(c, abs=2e-2 * np.abs(c).max())


@pytest.mark.parametrize("dim", [2, 3])
@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**31))
def test_a_stiff_polynomial_is_of_first_degree(dim, seed):
    rng = np.random.default_rng(seed)
    d, w = neighbours(rng, 60, dim)
    values = rng.normal(size=60)
    found, _ = fit(d, w, jnp.float32(values), 1e4)
    root = np.sqrt(np.float64(w))
    straight = np.linalg.lstsq(root[:, None] * np.float64(d), root * values, rcond=None)[0]
    # the stiffness is 1e4 of the moments, which are of order 1
    assert np.asarray(found[:dim]) == pytest.approx(straight, abs=1e-3)
    assert float(jnp.max(jnp.abs(found[dim:]))) < 1e-3


@pytest.mark.parametrize("dim", [2, 3])
@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**31), data=st.data())
def test_few_neighbours_leave_no_residual(dim, seed, data):
    """A free polynomial with as many coefficients as neighbours goes through all values: it damps nothing."""
    rng = np.random.default_rng(seed)
    count = data.draw(st.integers(1, COUNT[dim] - 2))
    d, w = neighbours(rng, COUNT[dim], dim)
    w = jnp.where(jnp.arange(COUNT[dim]) < count, w, 0.0)  # one shape for all counts compiles once
    values = jnp.float32(rng.normal(size=COUNT[dim]))
    found, at = fit(d, w, values)
    assert np.all(np.isfinite(found))
    # the ridge allows at most the residual with which the smallest polynomial through all values costs less
    rows = np.float64(stack(monomials(tuple(d.T))))[:count]
    through = np.linalg.pinv(rows) @ np.float64(values[:count])
    most = RIDGE * np.sum(through**2)
    assert float(jnp.sum(w * (at - values) ** 2)) < 2.0 * most + 1e-5 * float(jnp.sum(w * values**2))


def test_no_neighbours_give_no_polynomial():
    for dim in COUNT:
        found, _ = fit(jnp.zeros((1, dim)), jnp.zeros(1), jnp.ones(1))
        assert not np.any(np.asarray(found))
