"""Only `build` determines array shapes: another damping, wave height or period compiles nothing."""

import jax
import numpy as np
import pytest
from conftest import advance, coarse, compilations

import jaxsph as js
from jaxsph.case.speeds import search_speed, speed_scale
from jaxsph.waves import theory


def _built(name, changes):
    case = coarse(name, changes)
    return case, *js.build(case)


@pytest.fixture(scope="module")
def compiled():
    """The coarse OWC, after its step was compiled."""
    # as in a separate process: JAX's caches have a fixed size, and full caches drop programs at any time
    jax.clear_caches()
    with compilations() as found:
        # a period of no other test, because a known wavenumber would compile nothing
        case, model, state = _built("owc", {"waves.T": 1.37})
        advance(case, model, state, 1)
    assert found  # the listener works
    return model


@pytest.mark.parametrize(
    "changes",
    [
        {"pto.K_dm": 300.0},
        {"waves.H": 0.02},
        {"waves.H": 0.05},
        {"waves.T": 0.9},
        {"waves.T": 2.0, "waves.H": 0.05},
    ],
    ids=str,
)
def test_another_damping_height_or_period_compiles_nothing(compiled, changes):
    """Neither the build nor the steps compile anything; every first step is compiled already."""
    with compilations() as found:
        case, model, state = _built("owc", changes)
        advance(case, model, state, 1)
    assert jax.tree.structure(model) == jax.tree.structure(compiled)
    assert not found


def test_speeds_of_waves_come_in_few_classes():
    """The class differs from the speed by at most a fifth (the fourth root of two), or is the lowest."""
    least = 0.13 * np.sqrt(9.81 * coarse("owc").tank.depth)
    classes = set()
    for H in np.linspace(0.01, 0.245, 48):
        case = coarse("owc", {"waves.H": float(H)})
        speed, found = speed_scale(case), search_speed(case)
        assert found == pytest.approx(least) or 2**-0.251 < found / speed < 2**0.251
        assert found >= 2**-0.251 * speed
        classes.add(round(found, 9))
    assert len(classes) == 7  # over a factor of 24 in height, up to breaking


@pytest.mark.parametrize("T", [0.8, 1.2, 2.0])
@pytest.mark.parametrize("name", ["owc", "wave_tank"])
def test_the_bed_behind_the_paddle_is_the_depth_s(name, T):
    """The bed reaches behind the paddle for the steepest waves of the theory, whatever their height."""
    model = _built(name, {"waves.T": T, "waves.H": 0.03})[1]
    assert model.walls.x.shape == _built(name, {})[1].walls.x.shape
    assert float(model.walls.x[:, 0].min()) < -1.5 * theory.largest_stroke(coarse(name).tank.depth)
