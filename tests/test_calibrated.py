"""Slopes from runs with a fast model as control variate."""

import dataclasses
import functools
import tomllib

import jax
import pytest
from typer.testing import CliRunner

import jaxsph as js
from jaxsph.cli.app import app
from jaxsph.output.sweep_file import Meanings
from jaxsph.study import members as running
from jaxsph.study.fast_model import FastModel
from jaxsph.waves.fast_bodies import BodyAdditions
from jaxsph.waves.fast_owc import Additions

CASE = js.load_case("owc").replace({"t1": 30.0})
WATER = Additions(1.9, 0.11)
"""Loss and inertia of the pretended water."""
TILT = 0.2
"""Change of its efficiency over the relative change of a draught, which no fast model knows."""


@functools.cache
def _model(draught):
    case = CASE.replace({"device.draught": draught})
    return dataclasses.replace(FastModel.of_theory(case, (0.9, 1.7)), added=WATER)


@pytest.fixture
def ran(monkeypatch):
    """Runs with the results of a fast model and a tilt over the draught; returns the cases that were run."""
    ran = []

    def member(case, stem):
        ran.append(case)
        draught = case.built("device.draught")
        found = _model(draught).results({key: case.value(key) for key in ("waves.H", "waves.T", "pto.K_dm")})
        xi = float(found["xi"]) + TILT * (draught / 0.16 - 1.0)
        more = {"amplitude_P_a": float(found["P_a"]), "amplitude_flow": float(found["flow"])}
        results = {"xi": xi, "xi_measured": xi, "incident_height": case.value("waves.H")} | more
        return {"results": results, "series": {}, "failure": ""}, Meanings()

    monkeypatch.setattr(running, "run_member", member)
    return ran


def _exact():
    """Slope of the pretended water."""
    model = _model(0.16)
    return float(jax.grad(lambda a: model.results({"device.draught": a})["xi"])(0.16)) + TILT / 0.16


def test_a_model_gives_the_shape_and_the_runs_the_rest(ran, tmp_path):
    """With the water's loss and inertia the slope is exact over half of the draught to either side, where a
    parabola is wrong, as the efficiency is not one."""
    _model(0.16).write(tmp_path / "owc.json")
    runs = js.Ensemble(spread=0.5, members=5)
    found = js.derivative(CASE, "device.draught", "xi", js.Calibrated(runs, tmp_path / "owc.json"), False)
    # the runs' model and the slope's are solved for slightly different lengths, in float32
    assert found.slope == pytest.approx(_exact(), rel=2e-3) and found.error < 5e-3 * abs(_exact())
    assert found.value == pytest.approx(found.members["xi"][2], rel=1e-3) and found.reach == 0.08
    assert len(ran) == 5 == len(found.members["device.draught"])
    parabola = js.derivative(CASE, "device.draught", "xi", runs, False)
    assert abs(parabola.slope - _exact()) > 0.05 * abs(_exact()) and parabola.error > 5.0 * found.error


BUOY, DENSITY = js.load_case("buoy_heave").replace({"t1": 16.0}), 500.0


@functools.cache
def _floating(text):
    """Power of a buoy by a model."""
    model = FastModel.of_theory(js.Case.from_dict(tomllib.loads(text)))
    return float(dataclasses.replace(model, added=BodyAdditions((400.0,), (0.1,))).results()["P_pto"])


def _dense(density):
    return _floating(BUOY.replace({"body.density": density}).to_toml())


def test_a_slope_over_a_number_of_a_body(tmp_path, monkeypatch):
    """The water absorbs more than the model by an amount that is linear in the density."""

    def member(case, stem):
        density = case.value("body.density")
        results = {"P_pto": _dense(density) + TILT * (density / DENSITY - 1.0), "xi": 0.5}
        return {"results": results, "series": {}, "failure": ""}, Meanings()

    monkeypatch.setattr(running, "run_member", member)
    model = dataclasses.replace(FastModel.of_theory(BUOY), added=BodyAdditions((400.0,), (0.1,)))
    model.write(tmp_path / "buoy.json")
    way = js.Calibrated(js.Ensemble(spread=0.2, members=4), tmp_path / "buoy.json")
    found = js.derivative(BUOY, "body.density", "P_owc", way, False)
    low, high = (_dense(DENSITY * share) for share in (0.99, 1.01))
    exact = (high - low) / (0.02 * DENSITY) + TILT / DENSITY
    assert found.slope == pytest.approx(exact, rel=0.01) and found.error < 0.01 * abs(exact)
    with pytest.raises(js.CaseError, match=r"body\.block\.low = .*: must be a number that varies"):
        js.derivative(BUOY, "body.block.low", "P_owc", way, False)


def test_without_a_file_the_case_is_calibrated_first(ran, tmp_path):
    out = tmp_path / "slope.h5"
    way = js.Calibrated(js.Ensemble(members=4, out=out))
    found = js.derivative(CASE, "pto.K_dm", "amplitude_flow", way, False)
    model = FastModel.read(tmp_path / "slope_model.json")
    assert len(ran) == 9 and model.added.lip == pytest.approx(WATER.lip, rel=0.02)
    K_dm = CASE.value("pto.K_dm")
    exact = jax.grad(lambda K: _model(0.16).results({"pto.K_dm": K})["flow"])(K_dm)
    assert found.slope == pytest.approx(float(exact), abs=0.02 * found.value / K_dm)
    # a repeated call makes no further runs
    js.derivative(CASE, "pto.K_dm", "amplitude_flow", way, False)
    assert len(ran) == 9


@pytest.mark.parametrize(
    ("given", "parameter", "of", "message"),
    [
        (CASE, "device.draught", "noise", "noise: a fast model cannot predict this result; use one of xi"),
        (BUOY, "dx", "P_owc", r"dx: a fast model cannot change this parameter; use one of waves\.H"),
        (CASE, "dx", "xi", r"dx: a fast model cannot change this parameter; use one of waves\.H"),
        (js.load_case("dam_break"), "dx", "xi", "a fast model needs a device with a turbine"),
        (lambda K=1.0: CASE.problem(), "K", "xi", r"js\.Calibrated\(\) needs a case"),
    ],
)
def test_slopes_that_no_model_gives_are_refused_before_a_run(ran, given, parameter, of, message):
    with pytest.raises(js.CaseError, match=message):
        js.derivative(given, parameter, of, js.Calibrated(), False)
    assert not ran


def test_a_model_of_another_device_and_of_other_periods_is_refused(ran, tmp_path):
    buoy = FastModel.of_theory(js.load_case("buoy_heave"))
    buoy.write(tmp_path / "buoy.json")
    with pytest.raises(js.CaseError, match="of 'buoy_heave' is that of another kind of device"):
        js.derivative(CASE, "pto.K_dm", "xi", js.Calibrated(model=tmp_path / "buoy.json"), False)
    assert not ran
    FastModel.of_theory(CASE).write(tmp_path / "owc.json")
    way = js.Calibrated(js.Ensemble(spread=0.5, members=4), tmp_path / "owc.json")
    with pytest.raises(js.CaseError, match=r"waves\.T: the fast model has no prediction for all of 0\.6,"):
        js.derivative(CASE, "waves.T", "xi", way, False)


def test_slope_of_the_command_line_takes_a_model(ran, tmp_path):
    _model(0.16).write(tmp_path / "owc.json")
    call = ["slope", "owc", "--over", "device.draught", "--quiet", "--out", str(tmp_path / "s.h5")]
    call += ["--spread", "0.5", "--members", "5", "--model", str(tmp_path / "owc.json")]
    done = CliRunner().invoke(app, [*call, "--method", "model"])
    assert done.exit_code == 0, done.output
    (line,) = [one for one in done.output.splitlines() if one.startswith("d xi / d device.draught")]
    assert float(line.split()[5]) == pytest.approx(_exact(), rel=5e-3)
    done = CliRunner().invoke(app, call)
    assert done.exit_code == 2 and "needs --method model, not ensemble" in done.output
