"""Kernels against their integrals and their own derivatives."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import enable_x64

from jaxsph.core.kernels import Gaussian, WendlandC2, support

H = 0.03
# What the cut at 3.5h takes from the Gaussian: erfc-type tails of exp(-q^2).
LOST = {
    (Gaussian, 2): math.exp(-12.25),
    (Gaussian, 3): math.erfc(3.5) + 7.0 / math.sqrt(math.pi) * math.exp(-12.25),
    (WendlandC2, 2): 0.0,
    (WendlandC2, 3): 0.0,
}
BOTH = pytest.mark.parametrize(("kernel", "dim"), list(LOST))


@BOTH
def test_integral_over_the_support_is_one_less_what_the_cut_takes(kernel, dim):
    with enable_x64():
        r = jnp.linspace(0.0, kernel.reach * H, 20001)
        shell = {2: 2.0 * np.pi * r, 3: 4.0 * np.pi * r**2}[dim]
        integral = jnp.trapezoid(kernel().value(r**2, H, dim) * shell, r)
        # The trapezoidal rule with 2e4 intervals errs by about (3/2e4)^2 = 2e-8 of the integral.
        assert float(integral) == pytest.approx(1.0 - LOST[kernel, dim], abs=1e-7)


@BOTH
def test_slope_is_the_derivative_of_the_value(kernel, dim):
    with enable_x64():
        r = jnp.linspace(0.02, 0.999, 40) * kernel.reach * H
        derivative = jax.vmap(jax.grad(lambda a: kernel().value(a**2, H, dim)))(r)
        # Both are exact; near the support's end the value's own terms cancel, hence the scale.
        scale = float(jnp.max(jnp.abs(derivative)))
        np.testing.assert_allclose(kernel().slope(r**2, H, dim) * r, derivative, atol=1e-13 * scale)


@BOTH
def test_slope_is_never_positive_and_finite_at_the_centre(kernel, dim):
    r2 = jnp.linspace(0.0, support(kernel(), H), 50) ** 2
    assert np.all(np.asarray(kernel().slope(r2, H, dim)) <= 0.0)
    assert np.isfinite(jax.grad(lambda a: kernel().value(a, H, dim))(0.0))


def test_wendland_vanishes_smoothly_at_its_support():
    with enable_x64():
        edge = support(WendlandC2(), H) ** 2
        # (1 - q/2)^4 at q = 2 (1 + 1e-16): nothing is left of the centre's value.
        centre = WendlandC2().value(0.0, H, 2)
        assert abs(WendlandC2().value(edge, H, 2)) < 1e-30 * centre
        assert abs(WendlandC2().slope(edge, H, 2)) < 1e-20 * centre / H**2


def test_support():
    assert support(Gaussian(), H) == pytest.approx(3.5 * H) and support(WendlandC2(), H) == pytest.approx(
        2 * H
    )
