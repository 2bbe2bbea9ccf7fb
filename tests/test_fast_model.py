"""Fast models of oscillating water columns: linear theory as a limit, slopes, and fits to runs."""

import dataclasses
import functools
import json
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

import jaxsph as js
from jaxsph.cli.app import app
from jaxsph.core.roots import fixed_point
from jaxsph.study import fast_model
from jaxsph.study.fast_column import ColumnTheory
from jaxsph.study.fast_model import REGULAR, FastModel, Predicted, fitted, members_around
from jaxsph.waves.fast_owc import Additions
from jaxsph.waves.linear_sea import linear_sea_response
from jaxsph.waves.spectra import JONSWAP, draw_sea

CASE = js.load_case("owc").replace({"dx": 0.04, "probes.gauges": [2.0, 3.0, 3.3, 3.75, 7.4]})
PLATFORM = CASE.replace({"device.platform_length": 0.4, "device.platform_height": 0.08})
TRUE = Additions(1.9, 0.11)
NONE = Additions()


@functools.cache
def _model(added=NONE, air=False):
    """Model of the OWC with this loss and inertia."""
    case = CASE.replace({"air.volume": 0.8}) if air else CASE
    return dataclasses.replace(FastModel.of_theory(case, (1.2, 1.2)), added=added)


def _exact(H, T, K_dm, lip=0.0, case=CASE, **lengths):
    """Response in linear theory, which is solved at exactly this period and for exactly these lengths."""
    geometry = dataclasses.replace(js.linear_owc(case).water.geometry, **lengths)
    water = js.radiation_and_scattering(geometry, 2.0 * math.pi / T, case.g)
    return js.linear_response(water, H, K_dm, case.fluid.rho0, lip, js.linear_owc(case).air)


@settings(max_examples=25, deadline=None)
@given(st.floats(0.005, 0.1), st.floats(0.85, 1.75), st.floats(0.0, 5000.0), st.sampled_from([0.0, 2.0]))
def test_without_inertia_the_model_is_linear_theory(H, T, K_dm, lip):
    found = _model(Additions(lip, 0.0)).response({"waves.H": H, "waves.T": T, "pto.K_dm": K_dm})
    exact = _exact(H, T, K_dm, lip)
    # the series has 16 terms, and the model uses float32
    for here, there in ((found.xi, exact.xi), (found.P_a, abs(exact.P_a)), (found.flow, abs(exact.q))):
        assert float(here) == pytest.approx(float(there), rel=1e-4, abs=1e-9)
    assert float(found.level) == pytest.approx(float(abs(exact.level)), rel=1e-4)
    assert float(found.P_lost) == pytest.approx(float(exact.P_lip), rel=1e-4, abs=1e-9)


def test_compressible_air_is_that_of_linear_theory():
    model, exact = _model(air=True), _exact(0.04, 1.3, 700.0, case=_model(air=True).case)
    assert exact.air.give > 0.0 and abs(exact.q) != pytest.approx(abs(exact.q_pto), rel=0.01)
    found = model.response({"waves.T": 1.3, "pto.K_dm": 700.0})
    assert float(found.xi) == pytest.approx(float(exact.xi), rel=1e-4)
    assert float(found.flow) == pytest.approx(float(abs(exact.q)), rel=1e-4)


def _sea(Hs, Tp, K_dm, case=CASE):
    """Response to a sea by stochastic linearisation in double precision, with the waves of a drawn sea."""
    waves = draw_sea(JONSWAP(Hs, Tp), 60.0 * Tp, 1)
    geometry = js.linear_owc(CASE).water.geometry
    return linear_sea_response(geometry, *waves, K_dm, case.fluid.rho0, case.g, js.linear_owc(case).air)


@settings(max_examples=8, deadline=None)
@given(st.floats(0.01, 0.08), st.floats(0.85, 1.3), st.floats(50.0, 4000.0), st.booleans())
def test_without_additions_the_model_in_a_sea_is_linear_theory(Hs, Tp, K_dm, air):
    model = _model(air=air)
    found = model.response({"waves.Hs": Hs, "waves.Tp": Tp, "pto.K_dm": K_dm})
    exact = _sea(Hs, Tp, K_dm, model.case)
    root = math.sqrt(2.0)
    amplitudes = [found.flow / root, found.P_a / root, found.level / root]
    # seas of 93 and of 139 waves
    assert float(found.P_inc) == pytest.approx(exact.P_inc, rel=2e-3)
    assert float(found.P_owc) == pytest.approx(exact.P_owc, rel=4e-3)
    for here, there in zip(amplitudes, (exact.sigma_q, exact.sigma_P_a, exact.sigma_level), strict=True):
        assert float(here) == pytest.approx(there, rel=4e-3)


@settings(max_examples=25, deadline=None)
@given(
    st.floats(0.01, 0.08), st.floats(0.85, 1.3), st.floats(0.0, 4000.0), st.floats(0.0, 4.0), st.booleans()
)
def test_powers_of_a_sea_balance(Hs, Tp, K_dm, lip, air):
    """What the turbine and the lip take is at most the waves' power, and less with a lip than without."""
    changes = {"waves.Hs": Hs, "waves.Tp": Tp, "pto.K_dm": K_dm}
    found = _model(Additions(lip, 0.1), air).response(changes)
    assert 0.0 <= float(found.P_owc) and 0.0 <= float(found.P_lost)
    assert float(found.P_owc + found.P_lost) <= float(found.P_inc) * (1.0 + 1e-5)
    assert float(found.P_owc) <= float(_model(Additions(0.0, 0.1), air).response(changes).P_owc) * 1.05


def test_fixed_points_have_the_derivatives_of_the_solution():
    """The root of x = sqrt(a x) is a."""

    def of(a):
        return fixed_point(lambda x: jnp.sqrt(a * x), jnp.float32(3.0), 40)

    for derivative in (jax.jacfwd, jax.jacrev):
        assert float(of(5.0)) == pytest.approx(5.0, rel=1e-5)
        assert float(derivative(of)(5.0)) == pytest.approx(1.0, rel=1e-4)


def test_seas_outside_the_range_and_half_of_a_sea_are_refused():
    model = _model()
    for Tp in (0.8, 1.4):
        assert math.isnan(model.response({"waves.Hs": 0.03, "waves.Tp": Tp}).xi)
    for changes in ({"waves.Hs": 0.03}, {"waves.Hs": 0.03, "waves.Tp": 1.2, "waves.T": 1.2}):
        with pytest.raises(js.CaseError, match=r"waves\.Hs.*: give waves\.Hs and waves\.Tp together"):
            model.response(changes)


def test_slopes_in_a_sea_are_those_of_differences():
    model = _model(TRUE)

    @jax.jit
    def of(Hs, K_dm, draught):
        changes = {"waves.Hs": Hs, "waves.Tp": 1.2, "pto.K_dm": K_dm, "device.draught": draught}
        return model.response(changes).P_owc

    at = (0.04, 500.0, 0.16)
    for method in (jax.jacfwd, jax.jacrev):
        slopes = jax.jit(method(of, (0, 1, 2)))(*at)
        for k, slope in enumerate(slopes):
            up, down = (of(*(v * (1.0 + s * (i == k)) for i, v in enumerate(at))) for s in (0.01, -0.01))
            assert float(slope) == pytest.approx(float((up - down) / (0.02 * at[k])), rel=5e-3)


LINEAR = ColumnTheory.of(CASE, (2.0, 5.0, 8.0, 16.0))
KEYS = REGULAR | LINEAR.keys(CASE)


@pytest.mark.parametrize("key", KEYS)
def test_slopes_are_those_of_linear_theory(key):
    usual = {"waves.H": 0.04, "waves.T": 1.25, "pto.K_dm": 500.0}
    usual |= {"device.draught": 0.16, "device.chamber_length": 0.13, "device.wall_thickness": 0.02}
    here, name = usual[key], KEYS[key]
    assert getattr(js.linear_owc(CASE).water.geometry, name, here) == here

    def of(value):
        return _model().response({"waves.T": 1.25, "pto.K_dm": 500.0, key: value}).xi

    def exact(value):
        arguments = {"H": 0.04, "T": 1.25, "K_dm": 500.0, name: value}
        return _exact(**arguments).xi

    step = 1e-3 * here
    slope = (exact(here + step) - exact(here - step)) / (2.0 * step)
    # the lengths' parabolas pass through values 10 % apart
    assert float(jax.grad(of)(here)) == pytest.approx(float(slope), rel=0.02, abs=2e-3 / here)


def test_lengths_may_change_within_the_model_s_range():
    changes = {"device.draught": 0.176, "device.chamber_length": 0.11}
    exact = _exact(0.04, 1.2, 534.66, draught=0.176, length=0.11)
    # two lengths change at once, whose changes the model adds
    assert float(_model().response(changes).xi) == pytest.approx(float(exact.xi), rel=0.01)
    assert math.isnan(_model().error["xi"])
    for beyond in ({"device.draught": 0.25}, {"waves.T": 3.0}, {"waves.T": 0.3}):
        assert math.isnan(_model().response(beyond).xi)


def test_a_response_is_vectorised_and_compiled():
    model, values = _model(TRUE), jnp.linspace(200.0, 2000.0, 7)
    found = jax.jit(jax.vmap(lambda K: model.response({"pto.K_dm": K})))(values)
    each = [float(model.response({"pto.K_dm": float(K)}).xi) for K in values]
    np.testing.assert_allclose(found.xi, each, rtol=1e-5)


def test_inertia_delays_resonance():
    """A longer column resonates at a longer period."""
    T = jnp.linspace(0.85, 1.75, 91)
    peaks = [
        float(T[jnp.argmax(jax.vmap(lambda T, m=model: m.response({"waves.T": T, "pto.K_dm": 300.0}).xi)(T))])
        for model in (_model(), _model(Additions(0.0, 0.3)))
    ]
    assert peaks[1] > peaks[0] + 0.03


def _runs(scatter=0.0, failed=()):
    """Sweep whose results are those of a model with the additions `TRUE`, with relative errors."""
    over = {key: np.array(values) for key, values in members_around(CASE).items()}
    H = 0.98 * over["waves.H"]
    changes = {key: jnp.asarray(values) for key, values in (over | {"waves.H": H}).items()}
    exact, rng = jax.vmap(_model(TRUE).response)(changes), np.random.default_rng(3)
    results = {
        of: np.asarray(getattr(exact, name)) * (1.0 + scatter * rng.normal(size=len(H)))
        for name, of in LINEAR.read.items()
    }
    results |= {"incident_height": H, "xi": 1.1 * results["xi_measured"]}
    return js.Sweep(CASE, over, results, {(k,): "too fast" for k in failed}, {})


def test_a_fit_finds_loss_and_inertia_of_exact_runs():
    model = fitted(CASE, _runs())
    assert model.added.lip == pytest.approx(TRUE.lip, rel=1e-3)
    assert model.added.length == pytest.approx(TRUE.length, rel=1e-2)
    assert max(model.error.values()) < 1e-3
    assert [one.H for one in model.runs] == pytest.approx(list(_runs()["incident_height"]))


def test_errors_of_a_fit_grow_with_the_scatter_of_the_runs():
    exact, noisy = (fitted(CASE, _runs(scatter)) for scatter in (0.0, 0.03))
    for name in ("lip", "length"):
        error = getattr(noisy.added_error, name)
        assert error > 3.0 * getattr(exact.added_error, name)
        assert abs(getattr(noisy.added, name) - getattr(TRUE, name)) < 4.0 * error
    # predictions of left-out runs are worse than the scatter, but of its size
    assert 0.015 < noisy.error["xi"] < 0.12


def test_a_failed_run_is_left_out_and_too_few_are_refused():
    assert len(fitted(CASE, _runs(failed=(3,))).runs) == 4
    with pytest.raises(js.CaseError, match=r"only 3 runs succeeded, and 4 are needed\. .*too fast"):
        fitted(CASE, _runs(failed=(1, 3)))


def test_runs_whose_waves_were_not_measured_are_refused():
    runs = _runs()
    runs.results["incident_height"][2] = np.nan
    with pytest.raises(js.CaseError, match=r"waves\.H = 0\.06.*no incident_height: .*probes\.gauges"):
        fitted(CASE, runs)
    short = dataclasses.replace(runs, results={"noise": np.zeros(5)})
    with pytest.raises(js.CaseError, match=r"no incident_height and no xi_measured .* t1 long enough"):
        fitted(CASE, short)


@pytest.mark.parametrize(
    ("case", "over", "words"),
    [
        ("wave_tank", {}, "needs a device with a turbine in regular waves"),
        ("owc_irregular", {}, "needs a device with a turbine, or bodies with .*, in regular waves"),
        ("owc_slope", {}, "needs a device with a turbine in regular waves"),
        (PLATFORM, {}, r"device\.platform_height.*: a fast model needs linear theory"),
        ("owc", {"pto.K_dm": [1.0, 2.0]}, r"pto\.K_dm: a calibration needs 4 runs or more, not 2"),
        (CASE.replace({"t1": 8.0}), None, r"t1 = 8 s is too short for a run with waves\.T = .*; raise t1"),
        ("owc", {"dx": [1.0] * 5}, "dx: the runs of a calibration differ in waves.H, waves.T, pto.K_dm only"),
    ],
)
def test_cases_without_a_fast_model_are_refused_before_any_run(case, over, words, tmp_path):
    with pytest.raises(js.CaseError, match=words):
        js.calibrate(
            js.load_case(case) if isinstance(case, str) else case, tmp_path / "model.json", over=over
        )
    assert not list(tmp_path.iterdir())


def test_only_the_model_s_parameters_change():
    with pytest.raises(
        js.CaseError, match=r"dx: a fast model cannot change this parameter; use one of waves"
    ):
        _model().response({"dx": 0.01})


def test_a_model_is_read_as_it_was_written(tmp_path):
    model = fitted(CASE, _runs(0.02))
    model.write(tmp_path / "model.json")
    found = FastModel.read(tmp_path / "model.json")
    assert found.case == CASE and found.added == model.added and found.error == model.error
    assert isinstance(found.runs[0], Predicted) and found.runs == model.runs
    changes = {"waves.T": 1.1, "device.draught": 0.15}
    assert float(found.response(changes).xi) == float(model.response(changes).xi)
    (tmp_path / "other.json").write_text("{}")
    old = json.loads((tmp_path / "model.json").read_text())
    (tmp_path / "old.json").write_text(json.dumps({key: a for key, a in old.items() if key != "series"}))
    with pytest.raises(js.FileError, match="written by an earlier version; run jaxsph calibrate again"):
        FastModel.read(tmp_path / "old.json")
    for name, words in (("other.json", "no file of a fast model"), ("none.json", "No such file")):
        with pytest.raises(js.FileError, match=words):
            FastModel.read(tmp_path / name)
    with pytest.raises(js.FileError, match="cannot be written"):
        model.write(tmp_path / "none" / "model.json")


def test_the_commands_calibrate_and_predict(tmp_path, monkeypatch):
    asked = {}

    def sweep(case, over, out, **options):
        asked.update(over=over, out=out, **options)
        return _runs(0.02)

    monkeypatch.setattr(fast_model, "sweep", sweep)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs" / "owc_model_runs.h5").touch()  # so that no time is estimated
    done = CliRunner().invoke(app, ["calibrate", "owc", "--set", "dx=0.04"])
    assert done.exit_code == 0, done.output
    assert asked["out"].name == "owc_model_runs.h5" and not asked["grid"]
    assert asked["over"]["waves.T"] == pytest.approx([1.2, 1.0, 1.4, 1.6, 1.1])
    assert "loss coefficient of the lip" in done.output and " Pa (run " in done.output
    assert "recorded in runs/owc_model.json" in done.output
    grid = ["--grid", "pto.K_dm=300,600", "--grid", "waves.T=1.2,4.0", "--out", "found.csv"]
    done = CliRunner().invoke(app, ["predict", "runs/owc_model.json", *grid])
    assert done.exit_code == 0, done.output
    assert "pto.K_dm = 600, waves.T = 1.2" in done.output and "2 of 4 predictions are nan" in done.output
    rows = (tmp_path / "found.csv").read_text().splitlines()
    assert rows[0].startswith("pto.K_dm,waves.T,xi,P_owc (W per metre of width)") and len(rows) == 5
    (tmp_path / "year.csv").write_text("Hs,Tp,share\n0.03,1.1,0.4\n0.04,1.3,0.6\n")
    year = ["--table", "year.csv", "--grid", "pto.K_dm=300,600"]
    done = CliRunner().invoke(app, ["predict", "runs/owc_model.json", *year])
    assert done.exit_code == 0, done.output
    table = js.ScatterTable.read(tmp_path / "year.csv")
    mean = FastModel.read(tmp_path / "runs" / "owc_model.json").annual(table, {"pto.K_dm": 600.0})
    assert f"P_owc = {float(mean):.4g} +- " in done.output and "xi" not in done.output
    done = CliRunner().invoke(app, ["predict", "runs/owc_model.json", *year, "--grid", "waves.T=1.2"])
    assert done.exit_code == 2 and "waves.T: the waves are those of the scatter" in done.output
    done = CliRunner().invoke(app, ["predict", "runs/owc_model.json", "--grid", "pto.K_dm=1:900:100"])
    assert done.exit_code == 2 and "100 predictions; give --out FILE" in done.output


@pytest.mark.slow
def test_a_calibration_from_runs_of_the_water(tmp_path):
    case = CASE.replace({"tank.length": 4.0, "probes.gauges": [1.0, 1.5, 1.8, 2.25], "probes.pressure": None})
    model = js.calibrate(case.replace({"t1": 14.0}), tmp_path / "model.json")
    assert 0.5 < model.added.lip < 6.0 and model.error["xi"] < 0.25
