"""Cases keep their own precision, whatever the program's default is."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import advance, coarse, enable_x64

import jaxsph as js
from jaxsph.parts.sponge import Sponge, SpongeLayer
from jaxsph.waves.absorption import ActiveAbsorption
from jaxsph.waves.regular import RegularWaves, SecondOrderPiston

TANK = {
    "dx": 0.1,
    "tank.length": 1.6,
    "sponge": {"length": 0.4},
    "probes": {"gauges": [0.4, 0.8]},
    "scheme.cfl": 1.0,
}


@pytest.mark.parametrize("precision", ["float32", pytest.param("float64", marks=pytest.mark.slow)])
def test_a_tank_keeps_its_precision_where_the_default_is_float64(precision):
    with enable_x64():
        case = coarse("wave_tank", TANK | {"precision": precision})
        model, state = js.build(case)
        state, readings = advance(case, model, state, 2)
    for tree in (model, state, readings):
        for path, leaf in jax.tree_util.tree_flatten_with_path(tree)[0]:
            if jnp.issubdtype(leaf.dtype, jnp.floating):
                assert leaf.dtype == precision, jax.tree_util.keystr(path)
            else:
                assert leaf.dtype == jnp.int32, jax.tree_util.keystr(path)
    assert not int(state.status.bits)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_waves_and_sponge_follow_the_precision_of_their_leaves(dtype):
    """Python numbers, such as the defaults and t = 0.3 here, do not change the precision."""
    with enable_x64():
        one = jnp.ones((), dtype)
        waves = RegularWaves(0.04 * one, 1.2 * one, 0.42 * one, ramp=2.4, correction=SecondOrderPiston())
        absorption = ActiveAbsorption(distance=0.1 * one)
        found = [
            waves.k,
            waves.paddle_displacement(0.3),
            waves.paddle_velocity(0.3 * one),
            waves.elevation(one, 0.3),
            absorption.velocity(waves, 0.0, 0.3, 0.0),
            absorption.filter_time(waves),
            Sponge((SpongeLayer(one, 2.0 * one),)).factor(jnp.full((1, 2), 1.5, dtype), 0.01),
            jax.grad(lambda T: RegularWaves(0.04 * one, T, 0.42 * one).k)(1.2 * one),
        ]
        assert {a.dtype for a in found} == {np.dtype(dtype)}
