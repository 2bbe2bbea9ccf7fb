"""Running: `simulate` is pure, water at rest stays, and `run` survives kills, overflow and NaNs."""

import functools
import importlib
import inspect
import os
import re
import shutil
import signal
import subprocess
import sys
import time
import types
from pathlib import Path

import equinox as eqx
import h5py
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import advance, coarse, enable_x64, kill_with_two_checkpoints, with_velocity

import jaxsph as js
from jaxsph.case.geometry import Geometry
from jaxsph.case.linear import incident_energy, incident_power
from jaxsph.case.results import SettledPeriods, case_results, flume_gauges
from jaxsph.case.results import mean_of_power as result_of_power
from jaxsph.case.scheme import remedies
from jaxsph.case.settling import settled_periods
from jaxsph.errors import CaseError, FileError, SimulationError
from jaxsph.model.meaning import Entry, Exchange
from jaxsph.model.state import Failure
from jaxsph.output.run_file import RunFile
from jaxsph.output.run_groups import replace_results
from jaxsph.problem.problem import summary_of
from jaxsph.problem.results import energy_result, noise_result
from jaxsph.report.labels import label_of
from jaxsph.run import chunks, host, remembered, simulate
from jaxsph.run.amend import amend
from jaxsph.waves import theory
from jaxsph.waves.second_order import Harmonics, wavenumbers

CHUNK = 0.05
"""Time between checkpoints in these tests, s."""
OWC = coarse("owc", {"output.snapshot_dt": CHUNK})
quiet = functools.partial(js.run, progress=False)


def run_results(case, solution, seconds, steps, since=0.0):
    """Scalar results and notices of a case's run, without building the case."""
    model = types.SimpleNamespace(entries=dict, g=(0.0, 0.0))
    labelled = energy_result(model, case.waves is not None)
    made = (labelled, noise_result, *case_results(case))
    return summary_of(solution, made, SettledPeriods(case), seconds, steps, since)


resume = functools.partial(js.resume, progress=False)


def _settings(model):
    return {
        name: int(getattr(model.search, name))
        for name in ("capacity", "node_capacity", "chamber_capacity", "rebuild_every")
    }


def _assert_same(a, b):
    """Bit for bit, because both runs do the same operations and round in the same way."""
    assert jax.tree.structure(a) == jax.tree.structure(b)
    for left, right in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True):
        np.testing.assert_array_equal(left, right)


# --- simulate


def test_the_api_keeps_its_names():
    """`jaxsph.run` is the function, whatever was imported before; the subpackage must not hide it."""
    assert callable(js.simulate) and callable(js.run)
    assert "overwrite" in inspect.signature(js.run).parameters


def test_simulate_is_pure(hydrostatic):
    first, second = advance(*hydrostatic, samples=60), advance(*hydrostatic, samples=60)
    _assert_same(first, second)
    assert int(hydrostatic[2].step) == 0


def test_samples_are_at_the_start_of_their_interval(hydrostatic):
    _, model, _ = hydrostatic
    state, series = advance(*hydrostatic, samples=60)
    assert {len(values) for values in series.values()} == {60}
    # Time is the counted steps times dt, so that float32 rounds it only once.
    np.testing.assert_allclose(series["time"], 0.01 * np.arange(60), rtol=3e-7)
    assert float(model.time(state)) == pytest.approx(0.6, rel=3e-7)
    assert series["eta"].shape == (60, 2) and series["pressure"].shape == (60, 3)


def test_samples_are_counted_from_the_state_s_own_step(hydrostatic):
    """A state at a step between samples is measured like any other, at its own time."""
    case, model, state = hydrostatic
    first = 3
    late = eqx.tree_at(lambda s: s.step, state, jnp.asarray(first, state.step.dtype))
    (end, expected), (late_end, series) = (advance(case, model, s, samples=60) for s in (state, late))
    t = float(model.dt) * (first + 6 * np.arange(60))
    np.testing.assert_allclose(series["time"], t, rtol=3e-7)  # float32 rounds each time once
    # a tank at rest does not depend on time
    _assert_same(
        {k: v for k, v in series.items() if k != "time"}, {k: v for k, v in expected.items() if k != "time"}
    )
    assert int(late_end.step) == first + int(end.step)


@pytest.mark.parametrize("lengths", [{"n_steps": 7}, {"n_steps": 12, "sample_every": 9}])
def test_lengths_that_do_not_divide_are_refused(hydrostatic, lengths):
    _, model, state = hydrostatic
    with pytest.raises(ValueError, match="sample_every must be a multiple of 6, the model's rebuild_every"):
        js.simulate(model, state, **lengths)


def test_water_at_rest_stays_at_rest(hydrostatic):
    state, series = advance(*hydrostatic, samples=60)
    assert int(state.status.bits) == 0
    # The bar for the fine tank, d/40, is 1 % of sqrt(g d) after 3 s; this tank is as quiet.
    assert np.max(series["max_speed"]) < 0.01 * np.sqrt(9.81)
    p = state.particles
    pressure = p.rho * hydrostatic[1].scheme.c0 ** 2
    # ... and 1 % of rho g d; here ten particles are the depth, and the top row errs by half its own weight.
    assert np.sqrt(np.mean((pressure - 9810.0 * (1.0 - p.x[:, 1])) ** 2)) < 0.015 * 9810.0
    np.testing.assert_allclose(series["pressure"][-1], [7357.5, 4905.0, 2452.5], atol=0.015 * 9810.0)
    assert np.max(np.abs(series["eta"])) < 1e-3


def test_water_at_rest_has_no_momentum(hydrostatic):
    p = advance(*hydrostatic, samples=60)[0].particles
    momentum = np.asarray(p.m @ p.u)
    # The tank is symmetric sideways. The remainder is round-off of 360 steps of pressure forces, each 1e-7 of
    # rho g d times the wall's area: far below a thousandth of the water's weight times 1 s.
    assert abs(momentum[0]) < 1e-3 * float(jnp.sum(p.m))
    # Vertically the water settles, within the speed of the test above.
    assert abs(momentum[1]) < 0.005 * float(jnp.sum(p.m))


def test_three_dimensions_are_another_width(hydrostatic_3d):
    state, series = advance(*hydrostatic_3d, samples=20)
    p = state.particles
    assert int(state.status.bits) == 0 and p.x.shape == (256, 3)
    # As in two dimensions; eight particles deep.
    assert np.max(series["max_speed"]) < 0.01 * np.sqrt(9.81)
    pressure = p.rho * hydrostatic_3d[1].scheme.c0 ** 2
    assert np.sqrt(np.mean((pressure - 9810.0 * (1.0 - p.x[:, 2])) ** 2)) < 0.02 * 9810.0


@pytest.fixture(scope="module")
def standing(hydrostatic):
    """Series of a standing wave of the first mode, 0.03 m."""
    case = coarse("hydrostatic", {"start.amplitude": 0.03})
    # with the tables of the tank at rest, so that nothing is compiled again
    model, state = js.build(case, _settings(hydrostatic[1]))
    state, series = advance(case, model, state, samples=70)
    assert int(state.status.bits) == 0
    return series


def _tilt(series):
    return np.asarray(series["eta"][:, 0] - series["eta"][:, 1])


def test_standing_wave_has_its_period_roughly(standing):
    t, tilt = np.asarray(standing["time"]), _tilt(standing)
    period = 2 * np.pi / np.sqrt(9.81 * np.pi * np.tanh(np.pi))
    # With ten particles per half wavelength and h = 1.2 dx, dispersion is of order (k h)^2/4 = 4 %; the slow
    # lane measures it on a fine lattice.
    assert t[np.argmax(tilt)] == pytest.approx(period / 4, rel=0.06)
    down = np.flatnonzero((tilt[1:-1] > 0) & (tilt[2:] <= 0))[0] + 1
    crossing = t[down] - tilt[down] * (t[down + 1] - t[down]) / (tilt[down + 1] - tilt[down])
    assert crossing == pytest.approx(period / 2, rel=0.06)
    # Between the gauges at 0.2 and 0.8 m: 2 x 0.03 cos(0.2 pi) = 0.0485 m, reduced by their width.
    assert np.max(tilt) == pytest.approx(0.0485, rel=0.15)


def test_integrators_agree(standing):
    changes = {"start.amplitude": 0.03, "scheme.integrator": "predictor_corrector"}
    case = coarse("hydrostatic", changes)
    model, state = js.build(case)
    state, series = advance(case, model, state, samples=20)
    assert int(state.status.bits) == 0 and float(model.dt) < 1e-3
    # Two second-order schemes, one with half the step: they differ by (omega dt)^2 = 1e-4 of a wave of omega
    # = 5.5 rad/s, and by the acoustics of the first milliseconds.
    np.testing.assert_allclose(_tilt(series), _tilt(standing)[:20], atol=1e-3 * np.max(_tilt(standing)))


def test_no_slip_walls_only_shear(hydrostatic, standing):
    """With the viscosity of water they do not change a wave visibly.

    The wave exploded when the continuity equation treated such a wall like a moving one.
    """
    case = coarse("hydrostatic", {"start.amplitude": 0.03, "tank.slip": "no_slip"})
    model, state = js.build(case, _settings(hydrostatic[1]))
    state, series = advance(case, model, state, samples=70)
    assert int(state.status.bits) == 0
    np.testing.assert_allclose(_tilt(series), _tilt(standing), atol=0.01 * np.max(_tilt(standing)))


# --- failures are data


def test_overflow_is_a_bit(hydrostatic):
    case, model, state = hydrostatic
    small, _ = js.build(case, _settings(model) | {"capacity": 8, "node_capacity": 8})
    state, found = jax.jit(lambda m, s: m.scheme.prepare(m, s))(small, state)
    assert Failure(int(state.status.bits)) == Failure.NEIGHBOUR_OVERFLOW
    assert found.fluid.indices.shape[0] == 8


def test_stale_table_is_flagged_and_mended(hydrostatic):
    case, model, state = hydrostatic
    # All water moves up at 1.33 m/s: by 0.0133 m in a block of 6 steps, and half the skin is 0.01 m.
    rising = with_velocity(state, (0.0, 1.33))
    failed, _ = advance(case, model, rising, samples=60)
    assert Failure.STALE_TABLE in Failure(int(failed.status.bits))
    assert int(failed.status.step) < 6 and np.all(np.isfinite(failed.status.where))
    better = chunks.better_settings(model, failed.status)
    assert better == {"rebuild_every": 3}
    again, _ = advance(case, chunks.with_settings(model, better), rising, samples=2)
    assert int(again.status.bits) == 0
    broken = eqx.tree_at(lambda s: s.bits, failed.status, jnp.asarray(int(Failure.NON_FINITE)))
    assert chunks.better_settings(model, broken) is None


def test_settings_go_straight_to_what_was_needed(hydrostatic):
    """One change instead of several, because every change compiles the step again."""
    _, model, state = hydrostatic
    most = {"capacity": 151, "node_capacity": 3, "chamber_capacity": 0, "halo": 0, "points": 0}
    of = lambda s: (s.bits, s.most, s.speed2)  # noqa: E731
    lost = eqx.tree_at(of, state.status, (1, {k: np.asarray(v) for k, v in most.items()}, 0.0))
    found = chunks.better_settings(model, lost)
    assert found.keys() == {"capacity"} and 151 < found["capacity"] < 1.5 * 151
    # water that has spread once will spread further
    spread = chunks.with_settings(model, {"points": 300})
    wide = eqx.tree_at(lambda s: s.most, lost, {k: np.asarray(301 if k == "points" else 0) for k in most})
    assert chunks.better_settings(spread, wide) == {"points": 604}
    # half a skin is 0.01 m and a step 1/600 s: at 1.25 times 5 m/s a search is due at every step
    stale = eqx.tree_at(of, state.status, (int(Failure.STALE_TABLE), state.status.most, 25.0))
    assert chunks.better_settings(model, stale) == {"rebuild_every": 1}


def test_too_few_images_name_the_walls_that_need_none(hydrostatic):
    case, model, state = hydrostatic
    full = eqx.tree_at(lambda s: s.status.bits, state, jnp.asarray(int(Failure.NEIGHBOUR_OVERFLOW)))
    assert chunks.better_settings(model, full.status) is None  # larger tables do not help
    words = str(chunks.failure_error(model, full, "dense", remedies(case)))
    assert 'set tank.walls = "mirror"' in words


def test_a_table_outrun_in_one_step_names_what_makes_steps_shorter(hydrostatic):
    case, model, state = hydrostatic
    stale = eqx.tree_at(lambda s: s.status.bits, state, jnp.asarray(int(Failure.STALE_TABLE)))
    error = str(chunks.failure_error(model, stale, "fast", remedies(case)))
    assert "leaves the reach of its neighbour table" in error and "raise fluid.c0" in error


@pytest.mark.parametrize("field", ["u", "rho"])
def test_the_place_of_a_value_gone_wrong_is_where_it_began(hydrostatic, field):
    """It is reported at the end of the step in which it arises, before the next step spreads it."""
    _, model, state = hydrostatic
    of = lambda s: getattr(s.particles, field)  # noqa: E731
    poisoned = eqx.tree_at(of, state, of(state).at[57].set(jnp.nan))
    tables = types.SimpleNamespace(x=state.particles.x)
    checked = model.scheme.check(model, poisoned, tables, state.particles.x, state.particles.x)
    assert Failure(int(checked.status.bits)) == Failure.NON_FINITE
    np.testing.assert_array_equal(checked.status.where, state.particles.x[57])


# --- run, files, resume


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """An uninterrupted run of the coarse OWC, over four checkpoints."""
    path = tmp_path_factory.mktemp("whole") / "owc.h5"
    return path, quiet(OWC, t1=4 * CHUNK, out=path)


def test_run_gives_series_and_results(whole):
    path, solution = whole
    # CHUNK / sample_dt = 5 samples each
    np.testing.assert_allclose(solution.t, 0.01 * np.arange(20), atol=1e-12)
    assert solution["eta"].shape == (20, 4) and solution["pressure"].shape == (20, 1)
    assert {"P_a", "flow", "power_pto", "chamber_level", "noise", "rms_speed"} <= set(solution.series)
    assert np.all(np.isfinite(np.concatenate([a.ravel() for a in solution.series.values()])))
    file = RunFile.open(path)
    assert file.results() == pytest.approx(solution.results) and file.snapshot_count == 4
    # no period has settled, so the noise is that of the last tenth: two samples
    noise, speed = (np.sqrt(np.mean(np.square(solution[name][-2:]))) for name in ("noise", "rms_speed"))
    assert solution.results["noise"] == pytest.approx(noise / speed, rel=1e-6) and 0.0 < noise < speed
    with pytest.raises(KeyError, match="no reading 'chamber'; use one of .*chamber_level"):
        solution["chamber"]


def test_run_refuses_what_would_lose_something(whole):
    path, _ = whole
    before = path.read_bytes()
    with pytest.raises(FileError, match="exists"):
        quiet(OWC, out=path)
    with pytest.raises(CaseError, match="already at 0.2 s"):
        resume(path, t1=4 * CHUNK)
    assert path.read_bytes() == before


def test_resumed_run_is_the_uninterrupted_one(whole, tmp_path):
    path = tmp_path / "half.h5"
    quiet(OWC, t1=2 * CHUNK, out=path)
    again = resume(path, t1=4 * CHUNK)
    _assert_same(again.series, whole[1].series)
    _assert_same(again.state, whole[1].state)


def test_a_case_is_built_once_in_a_run(whole, tmp_path, monkeypatch):
    """The probes' zero levels come from the initial state of the same build, also in a resumed run."""
    built = []

    def build(*arguments):
        built.append(arguments)
        return js.build(*arguments)

    monkeypatch.setattr("jaxsph.case.case.build", build)
    quiet(OWC, t1=CHUNK, out=tmp_path / "once.h5")
    assert len(built) == 1
    resume(tmp_path / "once.h5", t1=2 * CHUNK)
    assert len(built) == 2


def test_checkpoint_of_other_rules_is_refused(whole, tmp_path, monkeypatch):
    """If the default speed of sound had changed, continuing would silently be another run."""
    path = shutil.copy(whole[0], tmp_path / "other.h5")

    def build(case, settings=None):
        model, state = js.build(case, settings)
        return eqx.tree_at(lambda m: m.scheme.c0, model, 1.1 * model.scheme.c0), state

    monkeypatch.setattr("jaxsph.case.case.build", build)
    with pytest.raises(
        FileError, match=r"differs from the model of the run \(scheme.c0 was \d+.* and is \d+"
    ):
        resume(path)
    monkeypatch.undo()
    with h5py.File(path, "r+") as file:
        file.attrs["schema"] = 1
    with pytest.raises(FileError, match="checkpoint of layout 1, .* layout 5 only: finish the run with"):
        resume(path)
    assert len(RunFile.open(path).series()["time"]) == 20  # its series can still be read


def test_a_run_goes_on_under_a_higher_tank(whole, tmp_path):
    """The ghosts are rebuilt; the particles keep their positions."""
    path, case = shutil.copy(whole[0], tmp_path / "higher.h5"), whole[1].case
    changes, before = {"tank.height": 2.0, "pto.K_dm": 300.0}, whole[1].state
    again = resume(path, t1=5 * CHUNK, changes=changes)
    assert again.case == case.replace(changes)
    assert again.model.walls.count > whole[1].model.walls.count
    assert float(again.model.chambers[0].pto.K_dm) == 300.0
    np.testing.assert_allclose(again.t, 0.01 * np.arange(25), atol=1e-12)
    # The first sample is the state itself, read with other walls: float32 sums in another order.
    p = before.particles
    kinetic = 0.5 * float(jnp.sum(p.m * jnp.sum(p.u**2, axis=1)))
    assert again["kinetic"][20] == pytest.approx(kinetic, rel=1e-5)
    text = RunFile.open(path).case_toml
    assert "# since t = 0.2 s: pto.K_dm = 300.0 (before: 534.66)" in text
    case, _, state = js.restore(path)
    assert case.tank.height == 2.0
    _assert_same(state, again.state)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"dx": 0.1}, "dx cannot change during a run: it is the spacing"),
        ({"device.draught": 0.1}, "device.draught cannot .* would move the walls"),
        ({"waves.H": 0.02}, "waves.H cannot .* the paddle would jump"),
        ({"probes.gauges": [1.0]}, "probes.gauges cannot .* are those of the present probes"),
        ({"tank.height": 0.5}, "tank.height = 0.5: must be higher than the .* m of the run"),
        ({"pto.P_a": 10.0}, "pto cannot change between a turbine and a prescribed pressure"),
        ({"pto.k_dm": 10.0}, "did you mean 'pto.K_dm'"),
        (
            {"output.sample_dt": 0.03},
            "output.sample_dt = 0.03 s: must divide the 0.2 s that the run has reached",
        ),
    ],
)
def test_what_a_run_cannot_change_is_refused_by_name(whole, changes, message):
    before = whole[0].read_bytes()
    with pytest.raises(CaseError, match=message):
        resume(whole[0], t1=5 * CHUNK, changes=changes)
    assert whole[0].read_bytes() == before


@pytest.mark.parametrize(
    ("t1", "devices", "message"),
    [
        (2 * CHUNK, None, "already at 0.2 s"),
        (np.nan, None, "t1 = nan s: must be a finite time"),
        (np.inf, None, "t1 = inf s: must be a finite time"),
        (5 * CHUNK, 10**6, "devices"),
    ],
)
def test_what_is_refused_has_changed_nothing(whole, t1, devices, message):
    """Neither the case of a run that is resumed, nor the file of a run that starts anew."""
    path = whole[0]
    before = path.read_bytes()
    with pytest.raises(CaseError, match=message):
        resume(path, t1=t1, changes={"pto.K_dm": 300.0}, devices=devices)
    assert path.read_bytes() == before
    with pytest.raises(CaseError, match="-3|finite|devices"):
        quiet(OWC, t1=-3.0 if t1 == 2 * CHUNK else t1, out=path, overwrite=True, devices=devices)
    assert path.read_bytes() == before and len(os.listdir(path.parent)) == 1


@pytest.mark.slow
def test_another_interval_of_samples_keeps_powers_and_what_was_exchanged(whole, tmp_path):
    """The first sample after the change is a mean over the old interval, and the totals are unchanged."""
    path = shutil.copy(whole[0], tmp_path / "wider.h5")
    plain = quiet(OWC, t1=5 * CHUNK)
    wider = resume(path, t1=0.24, changes={"output.sample_dt": 0.02})
    assert RunFile.open(path).since == pytest.approx(0.2)
    np.testing.assert_allclose(wider.t[19:], [0.19, 0.2, 0.22], atol=1e-12)
    for name in ("flow_mean", "power_pto", "power_paddle", "power_hyperviscosity", "power_contact"):
        if name in plain.series:
            # one rounding of a fraction of a float32 sum
            np.testing.assert_allclose(wider[name][20], plain[name][20], rtol=1e-5, err_msg=name)
    # one interval instead of two; the time step differs, because it divides the interval
    mean = 0.5 * (plain["power_paddle"][21] + plain["power_paddle"][22])
    assert wider["power_paddle"][21] == pytest.approx(mean, rel=0.01)
    _, _, state = js.restore(whole[0])
    other = tmp_path / "killed.h5"
    shutil.copy(whole[0], other)
    start, change = amend(RunFile.open(other), host.load_start(other), {"output.sample_dt": 0.02})
    RunFile.open(other).amend(*change)
    _assert_same(js.restore(other)[2], start.state)  # a kill before the next chunk loses nothing
    for name, tally in state.ledger.items():
        np.testing.assert_allclose(start.state.ledger[name].total, tally.total, rtol=1e-6, atol=1e-12)


def test_a_run_that_was_killed_before_its_results_is_ended_by_resume(whole, tmp_path):
    path = shutil.copy(whole[0], tmp_path / "nearly.h5")
    with RunFile.open(path)._rewritten() as (file, _):
        replace_results(file, {}, (), {})
    again = resume(path, t1=4 * CHUNK)
    assert {k: v for k, v in again.results.items() if "second" not in k} == {
        k: v for k, v in whole[1].results.items() if "second" not in k
    }


# --- results


def test_a_change_restarts_the_record_of_results(tmp_path):
    """Means are taken over the time after the change and its transient; if none is left, a notice says so."""
    case, solution = _ended(js.load_case("owc").replace({"t1": 60.0}), [2.0, 2.3, 2.75])
    power = solution.series["power_pto"]
    straight = run_results(case, solution, 1.0, 1)[0]
    power[solution.t < 20.0] = 7.0
    results, notices = run_results(case, solution, 1.0, 1, since=20.0)
    assert not notices and results["xi"] == pytest.approx(straight["xi"], rel=1e-6)
    late, notices = run_results(case, solution, 1.0, 1, since=55.0)
    assert not {"xi", "P_owc", "reflection", "periods"} & set(late)
    assert len(notices) == 1 and re.search(r"changed at t = 55 s.* continue to t1 = \d+", notices[0])
    # energy, too, counts from the change: 1 W/m over the last five seconds
    assert late["energy_pto"] == pytest.approx(5.0, abs=0.03)


def test_results_of_before_a_change_do_not_outlive_it(whole, tmp_path):
    path = shutil.copy(whole[0], tmp_path / "changed.h5")
    for changes, since in (({"t1": 9.0}, 0.0), ({"pto.K_dm": 300.0}, 0.2)):
        file = RunFile.open(path)
        start, change = amend(file, host.load_start(path), changes)
        file.amend(*change)
        assert file.since == pytest.approx(since)
        assert not RunFile.open(path).results() and not RunFile.open(path).notices()
        assert start.source == host.load_start(path).source


def _one_pto():
    return {"pto": Entry("power take-off", Exchange.HARVESTED)}


BRIEF = js.load_case("owc").replace({"t1": 22.8})
"""The built-in OWC, in a run that ends before the waves that the device reflects have returned to it."""


def _ended(case, gauges, reflected=0.1):
    """A run of regular waves with the elevations at the gauges, without running it."""
    case = case.replace({"probes.gauges": gauges})
    t = np.arange(0.0, case.t1, 0.01)
    omega = 2 * np.pi / case.waves.T
    k = float(theory.wavenumber(omega, case.tank.depth, case.g))
    x = np.asarray(gauges)[:, None]
    eta = 0.02 * (np.cos(k * x - omega * t) + reflected * np.cos(k * x + omega * t))
    ones = {name: np.ones(len(t)) for name in ("kinetic", "potential", "compression", "power_pto")}
    model = types.SimpleNamespace(depth=case.tank.depth, time=lambda state: case.t1, entries=_one_pto)
    state = types.SimpleNamespace(step=100, particles=types.SimpleNamespace(x=np.zeros((4, 2))))
    return case, js.Solution({"time": t, "eta": eta.T} | ones, {}, model, state, case)


def test_reflection_is_of_the_gauges_that_see_free_waves():
    """Gauges 2, 3 and 5 are used: those beside paddle and device are left out, whatever their order."""
    case, solution = _ended(BRIEF, [0.2, 7.5, 3.0, 3.3, 7.6, 3.75])
    assert flume_gauges(case) == [2, 3, 5]
    solution.series["eta"][:, [0, 1, 4]] = 1.0
    results, notices = run_results(case, solution, 1.0, 100)
    # k is in float32; the gauges' condition is below ten
    assert results["reflection"] == pytest.approx(0.1, abs=1e-4) and not notices
    assert results["incident_height"] == pytest.approx(0.04, rel=1e-4)


def test_means_before_the_second_reflection_say_so():
    """Waves that the device reflects return to it after three lengths of the flume, at 23.0 s."""
    gauges, case = [2.0, 2.3, 2.75], BRIEF
    _, notices = run_results(*_ended(case, gauges, 0.3), 1.0, 100)
    assert len(notices) == 1
    assert re.search(r"averaging starts at t = 10.8 s, .* at t = 23 s: .* raise t1 to 35.04 s", notices[0])
    for others in (
        _ended(case, gauges, 0.1),  # weak reflection
        _ended(case.replace({"t1": 40.0}), gauges, 0.3),  # waves have returned
    ):
        assert not run_results(*others, 1.0, 100)[1]


def test_noise_is_of_settled_periods_or_of_the_last_tenth():
    case, solution = _ended(BRIEF, [2.0, 2.3, 2.75])
    t, series, still = solution.t, solution.series, js.load_case("hydrostatic")
    settled = t >= t[-1] - settled_periods(case, t[-1]) * case.waves.T - 1e-6
    series |= {"noise": np.where(settled, 0.3, 7.0), "rms_speed": np.full(len(t), 2.0)}
    assert run_results(case, solution, 1.0, 1)[0]["noise"] == pytest.approx(0.15)
    series["noise"] = np.where(np.arange(len(t)) < len(t) - len(t) // 10, 7.0, 0.4)
    assert run_results(still, solution, 1.0, 1)[0]["noise"] == pytest.approx(0.2)
    series["rms_speed"] = np.zeros(len(t))  # no noise in water at rest
    results, notices = run_results(still, solution, 1.0, 1)
    assert "noise" not in results and not notices


def test_reflection_has_the_gravity_of_the_case():
    results, notices = run_results(*_ended(BRIEF.replace({"g": 7.0}), [2.0, 2.3, 2.75]), 1.0, 1)
    assert results["reflection"] == pytest.approx(0.1, abs=1e-4) and not notices


@pytest.mark.parametrize(
    ("gauges", "message"),
    [
        ([2.0, 2.981, 3.962], "no result for the reflection: gauges at .* cannot separate incident"),
        ([2.0, 3.0], "no result for the reflection: three gauges or more are needed between x = 0.42 and"),
    ],
)
def test_a_run_that_has_ended_does_not_die_in_its_results(gauges, message):
    """Gauges half a wavelength of 1.962 m apart, or too few of them: a notice, and all other results."""
    case, solution = _ended(BRIEF, gauges)
    results, notices = run_results(case, solution, 1.0, 100)
    assert "reflection" not in results and {"xi", "P_inc", "energy_pto"} <= set(results)
    assert len(notices) == 1 and re.search(message, notices[0])


def test_efficiency_is_of_the_asked_and_of_the_measured_waves():
    """The gauges record waves of amplitude 0.02 m, which the case specifies."""
    results, _ = run_results(*_ended(BRIEF, [2.0, 2.3, 2.75]), 1.0, 100)
    assert results["P_inc_measured"] == pytest.approx(results["P_inc"], rel=1e-4)
    assert results["xi_measured"] == pytest.approx(results["xi"], rel=1e-4)
    assert results["periods"] > 1
    assert results["xi_error"] == pytest.approx(results["xi_scatter"] / np.sqrt(results["periods"]))


def test_results_of_a_sea_have_errors_and_its_measured_height():
    """One repetition of a sea at five gauges, without reflection: height and power to the taper's 4 %."""
    sea = {"kind": "irregular", "Hs": 0.04, "Tp": 1.4, "duration": 56.0}
    changes = {"waves": sea, "t1": 90.0, "probes.gauges": [2.0, 2.2, 2.5, 2.9, 3.4]}
    case = js.load_case("owc").replace(changes)
    a, omega = case.waves.sum_of_waves(case.tank.depth, case.g)
    k, t = wavenumbers(omega, case.tank.depth, case.g), np.arange(0.0, 90.0, 0.02)
    gauges = [Harmonics(a * np.exp(-1j * k * x), omega, k).at(t) for x in case.probes.gauges]
    ones = {name: np.ones(len(t)) for name in ("kinetic", "potential", "compression")}
    power = 0.5 + 0.5 * np.random.default_rng(0).normal(size=len(t))
    model = types.SimpleNamespace(depth=case.tank.depth, time=lambda state: case.t1, entries=_one_pto)
    state = types.SimpleNamespace(step=100, particles=types.SimpleNamespace(x=np.zeros((4, 2))))
    series = {"time": t, "eta": np.transpose(gauges), "power_pto": power} | ones
    results, notices = run_results(case, js.Solution(series, {}, model, state, case), 1.0, 100)
    assert not notices and results["periods"] == 40
    assert results["Hm0"] == pytest.approx(0.04, rel=0.04) and results["reflection"] < 0.03
    assert results["P_inc_measured"] == pytest.approx(results["P_inc"], rel=0.08)
    assert results["xi"] == pytest.approx(0.5 / results["P_inc"], rel=0.05)
    # white noise: its standard deviation over the root of the number of samples, 2,800 in 40 periods
    expected = 0.5 / np.sqrt(2800) / results["P_inc"]
    assert results["xi_error"] == pytest.approx(expected, rel=0.15)


def _with_transient(case, solution, since=0.0):
    """The run with a power that settles at 16 s, and a scatter of 1 % from period to period."""
    t, T = solution.t, case.waves.T
    period = np.floor((solution.t[-1] - t) / T - 1e-9).astype(int)
    scatter = 0.01 * np.random.default_rng(3).normal(size=period.max() + 1)
    solution.series["power_pto"] = 0.5 * (1.0 + scatter[period]) + np.where(t < max(16.0, since), 0.2, 0.0)
    return case, solution


def test_means_begin_when_the_record_has_settled():
    """All means have one window; of ten periods of 1.2 s it leaves out those that begin before 16 s."""
    case, solution = _with_transient(*_ended(BRIEF, [2.0, 2.3, 2.75]))
    t = solution.t
    late = t >= t[-1] - 5 * 1.2 - 1e-6
    series = solution.series
    series |= {"noise": np.where(late, 0.3, 7.0), "rms_speed": np.full(len(t), 2.0)}
    results, notices = run_results(case, solution, 1.0, 100)
    assert results["periods_left_out"] == 5 and results["periods"] == 5 and not notices
    assert results["P_owc"] == pytest.approx(0.5, rel=0.02)  # 0.58 with ten periods
    assert results["energy_pto"] == pytest.approx(results["P_owc"] * 5 * 1.2, rel=1e-6)
    assert results["noise"] == pytest.approx(0.15, rel=0.02)
    words = [(label_of(name, True).text, label_of(name, True).meaning) for name in ("periods_left_out",)]
    assert words[0][0].strip() != "periods_left_out" and words[0][1]


@pytest.mark.parametrize("of", ["xi", "P_owc"])
@pytest.mark.parametrize("sea", [False, True])
def test_the_value_of_a_slope_is_the_result_of_its_run(of, sea):
    """Over the same settled periods; for a part of a sea, relative to the waves of that part."""
    waves = {"kind": "irregular", "Hs": 0.04, "Tp": 1.4, "duration": 56.0}
    case = BRIEF.replace({"waves": waves, "t1": 40.0} if sea else {})
    t = np.arange(0.0, case.t1, 0.02)
    ones = {name: np.ones(len(t)) for name in ("kinetic", "potential", "compression")}
    model = types.SimpleNamespace(depth=case.tank.depth, time=lambda state: case.t1, entries=_one_pto)
    state = types.SimpleNamespace(step=100, particles=types.SimpleNamespace(x=np.zeros((4, 2))))
    solution = js.Solution({"time": t, "power_pto": np.ones(len(t))} | ones, {}, model, state, case)
    if not sea:
        _with_transient(case, solution)
    results, _ = run_results(case, solution, 1.0, 100)
    power = solution["power_pto"]
    mean = result_of_power(case, of)(t, power)
    assert mean.of_power(power) == pytest.approx(results[of], rel=1e-9)
    assert mean.incident(case) == pytest.approx(results["P_inc"] if of == "xi" else 1.0, rel=1e-9)
    assert sea or results["periods_left_out"] > 0


def test_too_few_settled_periods_ask_for_a_longer_run():
    case, solution = _ended(BRIEF, [2.0, 2.3, 2.75])
    solution.series["power_pto"] = 0.1 * solution.t
    results, notices = run_results(case, solution, 1.0, 100)
    assert results["periods"] == 3 and results["periods_left_out"] == 7
    assert len(notices) == 1 and "3 periods only, because the 7 before them had not settled" in notices[0]


def test_results_begin_after_a_change_and_its_transient():
    """Wave energy needs 7 s to the far end of the tank: after a change at 8 s, averaging starts at 15 s."""
    case, solution = _ended(BRIEF, [2.0, 2.3, 2.75])
    solution.series["power_pto"] = np.where(solution.t < 8.0, 100.0, 0.5)
    results, notices = run_results(case, solution, 1.0, 100, since=8.0)
    assert results["periods"] == 6 and results["P_owc"] == pytest.approx(0.5) and not notices
    results, notices = run_results(case, solution, 1.0, 100, since=20.0)
    assert not {"xi", "P_owc", "periods", "reflection"} & set(results)
    assert len(notices) == 1 and "changed at t = 20 s" in notices[0]
    # the budget covers the time after the change: 0.5 W/m to the last sample, at 22.79 s
    assert results["energy_pto"] == pytest.approx(0.5 * (solution.t[-1] - 20.0), rel=0.01)


def test_efficiency_of_a_focused_group_is_energy_over_energy():
    """The device takes half of the group's energy within half a minute: 0.5, however long the record is."""
    waves = {"kind": "focused", "crest": 0.04, "Tp": 1.2, "x": 4.0, "t": 14.0}
    whole = incident_power(js.load_case("owc").replace({"waves": waves})) * 64 * 1.2
    for t1 in (24.0, 34.0):
        case = js.load_case("owc").replace({"waves": waves, "t1": t1})
        t = np.arange(0.0, t1, 0.01)
        power = 0.5 * whole * np.exp(-(((t - 16.5) / 1.5) ** 2)) / (1.5 * np.sqrt(np.pi))
        ones = {name: np.ones(len(t)) for name in ("kinetic", "potential", "compression")}
        model = types.SimpleNamespace(depth=0.42, time=lambda state, t1=t1: t1, entries=_one_pto)
        state = types.SimpleNamespace(step=100, particles=types.SimpleNamespace(x=np.zeros((4, 2))))
        solution = js.Solution({"time": t, "power_pto": power} | ones, {}, model, state, case)
        results, notices = run_results(case, solution, 1.0, 100)
        assert results["xi"] == pytest.approx(0.5, rel=1e-3) and not notices
        assert results["E_inc"] == pytest.approx(whole) and not {"P_owc", "periods"} & set(results)
    early = js.Solution({k: v[:1500] for k, v in solution.series.items()}, {}, model, state, case)
    results, notices = run_results(case, early, 1.0, 100)
    assert "xi" not in results and "of the group's energy has reached" in " ".join(notices)


@pytest.mark.slow
def test_efficiency_of_a_part_of_a_sea_is_over_the_waves_of_that_part():
    """A device that takes half of the incident power has 0.5, in weak and in strong parts of a sea."""
    sea = {"kind": "irregular", "Hs": 0.04, "Tp": 1.4, "duration": 112.0}
    case = js.load_case("owc").replace({"waves": sea, "t1": 40.0})
    t, x = np.arange(0.0, 40.0, 0.1), Geometry.of(case).plate.x0
    power = np.zeros(len(t))
    for k in range(1, len(t)):
        power[k] = 0.5 * incident_energy(case, x, t[k - 1], t[k]) / 0.1
    ones = {name: np.ones(len(t)) for name in ("kinetic", "potential", "compression")}
    model = types.SimpleNamespace(depth=0.42, time=lambda state: 40.0, entries=_one_pto)
    state = types.SimpleNamespace(step=100, particles=types.SimpleNamespace(x=np.zeros((4, 2))))
    solution = js.Solution({"time": t, "power_pto": power} | ones, {}, model, state, case)
    results, _ = run_results(case, solution, 1.0, 100)
    assert results["xi"] == pytest.approx(0.5, rel=0.01)
    assert results["P_inc"] != pytest.approx(incident_power(case), rel=0.02)


def test_whatever_goes_wrong_in_a_result_is_a_notice():
    case, solution = _ended(BRIEF, [2.0, 2.3, 2.75])
    del solution.series["compression"]
    results, notices = run_results(case, solution, 1.0, 100)
    assert notices == ("no result for the energy balance: KeyError: 'compression'",)
    assert "xi" in results and "reflection" in results


def test_failures_have_their_remedies(hydrostatic):
    """A case names its keys; a problem without keys says what to change in its parts."""
    case, model, state = hydrostatic
    status = eqx.tree_at(lambda s: (s.bits, s.where), state.status, (8, jnp.asarray([0.5, 1e3])))
    top = float(model.walls.high[-1])
    failed = eqx.tree_at(lambda s: s.status, state, status)
    words = str(chunks.failure_error(model, failed, "it", remedies(case)))
    assert f"left the tank over its rim, which is {top:g} m high" in words
    assert "jaxsph resume FILE --set tank.height=" in words
    inside = eqx.tree_at(lambda s: s.where, status, jnp.asarray([0.5, 0.1]))
    failed = eqx.tree_at(lambda s: s.status, state, inside)
    words = str(chunks.failure_error(model, failed, "it", remedies(case)))
    assert "inside a wall within the first 20 steps" in words
    assert (
        "What to change: correct the set-up, which is the likely cause; near this point water, walls" in words
    )
    later = eqx.tree_at(lambda s: s.step, inside, jnp.asarray(21, inside.step.dtype))
    failed = eqx.tree_at(lambda s: s.status, state, later)
    words = str(chunks.failure_error(model, failed, "it", remedies(case)))
    assert "gone through a wall" in words and "What to change: reduce scheme.cfl or dx" in words
    status = eqx.tree_at(lambda s: (s.bits, s.residual), status, (64, jnp.asarray(0.25)))
    failed = eqx.tree_at(lambda s: s.status, state, status)
    words = str(chunks.failure_error(model, failed, "it", remedies(case)))
    assert "did not converge (relative residual 0.25" in words and "raise scheme.tolerance" in words
    words = str(chunks.failure_error(model, failed, "it", {}))
    assert "What to change: use shorter time steps" in words and "scheme." not in words


# --- interruptions

LOOP = """
import sys, time
from jaxsph.run import interrupt
with interrupt.end_at_once(lambda: "ended at once"):
    try:
        with interrupt.hear_interrupts() as asked:
            for k in range(1000):
                print(k, flush=True)
                end = time.monotonic() + 0.3
                while time.monotonic() < end:
                    pass
                asked.chunk_is_saved()
    except KeyboardInterrupt:
        print("ended between chunks", flush=True)
        sys.exit(130)
"""
AS_HERE = os.environ | {"PYTHONPATH": str(Path(js.__file__).parents[1])}


@pytest.mark.parametrize(
    ("chunks_done", "times", "words"),
    [(0, 1, "ended at once"), (1, 1, "between chunks"), (1, 2, "ended at once")],
)
def test_interrupt_is_heard_between_chunks_or_at_once(chunks_done, times, words):
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    child = subprocess.Popen([sys.executable, "-c", LOOP], env=AS_HERE, preexec_fn=_heed_interrupts, **pipes)
    for _ in range(chunks_done + 1):
        child.stdout.readline()
    for _ in range(times):
        child.send_signal(signal.SIGINT)
        time.sleep(0.05)
    out, err = child.communicate(timeout=30)
    assert child.returncode == 130 and words in out + err and "Traceback" not in err


def _heed_interrupts():
    """A shell's background job inherits that Ctrl-C is ignored, which these tests must undo."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.mark.parametrize("seconds", [1.0, 3.0, pytest.param(6.0, marks=pytest.mark.slow)])
def test_interrupted_command_says_so_whatever_it_was_doing(tmp_path, seconds):
    """While it imports, builds or compiles: never a crash, always the message."""
    (tmp_path / "owc.toml").write_text(OWC.to_toml())
    command = [sys.executable, "-m", "jaxsph", "run", "owc.toml", "--no-plot", "--out", "out.h5"]
    how = {"cwd": tmp_path, "stderr": subprocess.PIPE, "text": True, "env": AS_HERE}
    child = subprocess.Popen(command, preexec_fn=_heed_interrupts, **how)
    time.sleep(seconds)
    child.send_signal(signal.SIGINT)
    time.sleep(1.0)
    if child.poll() is None:  # it saved a chunk and waits for the next
        child.send_signal(signal.SIGINT)
    _, err = child.communicate(timeout=60)
    assert child.returncode == 130 and "jaxsph: interrupted" in err and "Traceback" not in err


# --- kills


ENDLESS = """
import sys
import jaxsph as js
js.run(js.load_case(sys.argv[1]), t1=60.0, out=sys.argv[2], progress=False)
"""


def test_killed_run_resumes_as_if_nothing_had_happened(tmp_path):
    (tmp_path / "owc.toml").write_text(OWC.to_toml())
    path = tmp_path / "killed.h5"
    process = subprocess.Popen([sys.executable, "-c", ENDLESS, tmp_path / "owc.toml", path])
    kill_with_two_checkpoints(process, path)
    done = RunFile.open(path).snapshot_count
    assert 2 <= done < 60.0 / CHUNK
    t1 = (done + 1) * CHUNK
    again = resume(path, t1=t1)
    straight = quiet(OWC, t1=t1)
    _assert_same(again.series, straight.series)
    _assert_same(again.state, straight.state)


def test_restore(whole):
    path, solution = whole
    case, model, state = js.restore(path, OWC)
    assert case == OWC
    _assert_same(state, solution.state)
    assert _settings(model) == _settings(solution.model)
    with pytest.raises(FileError, match="differs from the given case"):
        js.restore(path, OWC.replace({"pto.K_dm": 300.0}))


def test_overflow_is_regrown_and_replayed_once(whole, monkeypatch, tmp_path):
    """From tables that are far too small, one replay gives the same run as from sufficient tables.

    The next run of the case begins with the larger tables, needs no replay, and has the same results; a
    damaged file of sizes is as good as none.
    """
    good = _settings(whole[1].model)
    small = {name: good[name] // 2 for name in ("capacity", "node_capacity")}
    real, ran = js.build, []

    def build(case, settings=None):
        return real(case, good | small if settings is None else settings)

    def chunk(model, **others):
        ran.append(_settings(model))
        return simulate.simulate_chunk(model, **others)

    monkeypatch.setattr("jaxsph.case.case.build", build)
    monkeypatch.setattr(host, "simulate_chunk", chunk)
    monkeypatch.setattr(remembered, "program_folder", lambda: tmp_path)
    monkeypatch.setattr(remembered, "_programs", {})  # as in a new process
    model, state = build(OWC)
    overflown, _ = jax.jit(lambda m, s: m.scheme.prepare(m, s))(model, state)
    assert Failure.NEIGHBOUR_OVERFLOW in Failure(int(overflown.status.bits))
    solution = quiet(OWC, t1=CHUNK)
    assert len(ran) == 2 and all(ran[1][name] > ran[0][name] for name in small)
    _assert_same(solution.series, {name: values[:5] for name, values in whole[1].series.items()})
    again = quiet(OWC, t1=CHUNK)
    assert len(ran) == 3 and ran[2] == ran[1]
    _assert_same(again.series, solution.series)
    next(tmp_path.glob("sizes-*.json")).write_text("[")
    quiet(OWC, t1=CHUNK)
    assert len(ran) == 5 and ran[3] == ran[0]


def test_a_value_gone_wrong_stops_the_run_and_spares_the_checkpoint(tmp_path, monkeypatch):
    path = tmp_path / "poisoned.h5"
    quiet(OWC, t1=2 * CHUNK, out=path)
    before = path.read_bytes()
    real = host.load_start

    def poisoned(*arguments):
        start = real(*arguments)
        rho = start.state.particles.rho
        start.state = eqx.tree_at(lambda s: s.particles.rho, start.state, rho.at[5].set(jnp.nan))
        return start

    monkeypatch.setattr(host, "load_start", poisoned)
    with pytest.raises(SimulationError, match="no longer finite") as stopped:
        resume(path, t1=4 * CHUNK)
    # what, when, where, what to change
    error = stopped.value
    assert (
        "t = 0.1" in str(error)
        and "near (" in str(error)
        and "What to change: reduce scheme.cfl" in str(error)
    )
    # The checkpoint is at step 100, and the next step is the first with a value that is not finite.
    assert error.step == 101 and error.time == pytest.approx(0.101, rel=1e-5)
    assert len(error.where) == 2
    assert path.read_bytes() == before
    monkeypatch.undo()
    assert resume(path, t1=3 * CHUNK).t[-1] == pytest.approx(3 * CHUNK - 0.01)


# --- derivatives


def test_derivative_of_a_run_with_respect_to_K_dm():
    """Forward mode through 40 steps, four searches, ghosts and chamber, compared with differences."""
    with enable_x64():
        case = coarse("vessel", {"pto.K_dm": 300.0, "precision": "float64"})
        model, state = js.build(case)
        right = state.particles.x[:, 0] > model.chambers[0].sides.x0[0]
        sinking = jnp.stack([jnp.zeros_like(right, float), jnp.where(right, -0.2, 0.0)], -1)
        state = with_velocity(state, sinking)

        def energy_left(K_dm):
            changed = eqx.tree_at(lambda m: m.chambers[0].pto.K_dm, model, K_dm)
            end, _ = js.simulate(changed, state, n_steps=4 * model.search.rebuild_every)
            p = end.particles
            return 0.5 * jnp.sum(p.m * jnp.sum(p.u**2, axis=1)), end.status.bits

        both = jax.jit(lambda K: jax.jvp(lambda a: energy_left(a)[0], (K,), (jnp.ones_like(K),)))
        K, step = jnp.asarray(300.0), 1e-3
        _, slope = both(K)
        difference = (both(K + step)[0] - both(K - step)[0]) / (2 * step)
        assert float(slope) < 0.0
        # The error of the difference itself: truncation (step/K)^2 = 1e-11, and round-off 1e-16 x 10 J/m over
        # step x 1e-3 J/m = 1e-9. Forty steps are far below the growth time of 0.1 s. The rest is due to the
        # kernel's cut and the limits in the ghosts, where a pair may be on either side.
        assert float(slope) == pytest.approx(float(difference), rel=1e-4)


def test_one_program_serves_chunks_of_every_length(hydrostatic):
    """Equal bit for bit to a loop of that length, and compiled once; a run's last chunk is often shorter."""
    case, model, state = hydrostatic
    every = model.search.rebuild_every
    probes = case.problem().probes
    compiled = simulate._on_one_device._cache_size()
    for blocks in (5, 2):
        found, series = simulate.simulate_chunk(model, state, probes, blocks * every, every, 5 * every)
        run = functools.partial(js.simulate, n_steps=blocks * every, probes=probes, sample_every=every)
        expected, alone = jax.jit(run)(model, state)
        assert len(series["time"]) == blocks
        for name, values in alone.items():
            np.testing.assert_array_equal(series[name], values)
        assert bool(eqx.tree_equal(found.particles, expected.particles))
    assert simulate._on_one_device._cache_size() == compiled + 1
    with pytest.raises(ValueError, match=f"n_steps = {every + 1} and sample_every = .* do not fit"):
        simulate.simulate_chunk(model, state, probes, every + 1, every, 5 * every)


def test_a_run_is_foretold_by_its_own_program(hydrostatic):
    case, _, _ = hydrostatic
    told = js.duration(case, devices=1)
    assert told.steps == round(case.t1 / float(case.problem().model.dt)) and told.devices == 1
    assert 0.0 < told.step < 1.0 and told.total == told.compilation + told.steps * told.step
    compiled = simulate._on_one_device._cache_size()
    js.run(case, t1=case.output.snapshot_dt, progress=False, devices=1)
    assert simulate._on_one_device._cache_size() == compiled


def test_steps_are_timed_in_moving_water(hydrostatic):
    """Water at rest starts with a standing wave of a tenth of the depth; water that moves starts as it is."""
    timed = importlib.import_module("jaxsph.run.duration")
    case, model, state = hydrostatic
    depth, k = case.tank.depth, np.pi / case.tank.length
    u = np.asarray(timed._in_motion(model, state).particles.u)
    omega = np.sqrt(case.g * k * np.tanh(k * depth))
    # the uppermost particles are half a spacing below the surface
    assert np.abs(u[:, -1]).max() == pytest.approx(0.05 * depth * omega, rel=1.5 * k * case.dx / 2.0)
    below = np.asarray(state.particles.x[:, -1]) < case.dx
    assert np.abs(u[below, -1]).max() < 0.2 * np.abs(u[:, -1]).max()
    moving = eqx.tree_at(lambda s: s.particles.u, state, 0.01 + state.particles.u)
    assert timed._in_motion(model, moving) is moving
