"""Only `build` determines array shapes: another damping, wave height or period compiles nothing."""

import jax
import numpy as np
import pytest
from conftest import advance, coarse, compilations

import jaxsph as js
from jaxsph.case.speeds import search_speed, speed_scale
from jaxsph.output.run_file import RunFile
from jaxsph.run import devices, remembered, simulate
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


def test_owcs_of_other_lengths_share_a_program(monkeypatch):
    """Draught and chamber length are numbers of the program; empty rows even the shapes of arrays."""
    monkeypatch.setattr(remembered, "_programs", {})
    jax.clear_caches()  # as above
    programs = []
    for lengths in ({}, {"draught": 0.14}, {"chamber_length": 0.16}):
        changes = {f"device.{name}": value for name, value in lengths.items()}
        case = js.load_case("owc").replace({"probes.pressure": [], **changes})
        js.run(case, t1=0.05, progress=False)
        programs.append(simulate._on_one_device._cache_size())
    assert programs == [1, 1, 1]


def test_copies_that_even_the_shapes_have_no_effect(monkeypatch):
    """Copies of particles and empty ghosts stay where they are, and change the water by rounding only."""
    monkeypatch.setattr(devices, "STEPS", 8)  # long steps, since the coarse OWC has few particles
    case, model, state = _built("owc", {})
    count = len(state.particles.id)
    more, evened = devices._evened(model, state, 7)
    copies = len(evened.particles.id) - count
    assert copies > 0 and len(evened.particles.id) % 7 == 0 and more.walls.count > model.walls.count
    plain, _ = advance(case, model, state, 4)
    whole, _ = advance(case, more, evened, 4)
    before, after = (
        {name: np.asarray(getattr(one, name))[np.argsort(one.id)] for name in ("x", "u", "m")}
        for one in (evened.particles, whole.particles)
    )
    for name in before:
        np.testing.assert_array_equal(after[name][count:], before[name][count:])
    for name, most in plain.status.most.items():  # no table lists a copy, or the image of one
        assert int(whole.status.most[name]) == int(most), name
    found, expected = devices.gather(whole, count).particles, plain.particles
    assert np.array_equal(found.id, expected.id)
    # after 40 steps at speeds of 0.02 m/s the solver's sums, in another order, leave 1e-6 m/s
    np.testing.assert_allclose(found.u, expected.u, atol=2e-5)
    np.testing.assert_allclose(found.x, expected.x, atol=2e-6)
    assert np.max(np.abs(expected.u)) > 1e-3


def test_a_resumed_run_adds_its_copies_again(monkeypatch, tmp_path):
    """Copies are no part of a checkpoint: a resumed run adds others, and has the same bits."""
    monkeypatch.setattr(devices, "STEPS", 8)
    case, paths = coarse("owc"), (tmp_path / "whole.h5", tmp_path / "halves.h5")
    js.run(case, t1=0.4, out=paths[0], progress=False)
    js.run(case, t1=0.2, out=paths[1], progress=False)
    js.resume(paths[1], t1=0.4, progress=False)
    whole, halves = (RunFile.open(path).series() for path in paths)
    assert len(whole["time"]) == 40 and np.max(np.abs(whole["eta"])) > 1e-5
    for name, values in whole.items():
        np.testing.assert_array_equal(halves[name], values, err_msg=name)
