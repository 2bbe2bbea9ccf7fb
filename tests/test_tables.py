"""Runs and sweeps as tables and datasets, and the fields of a snapshot on a grid."""

import csv
import sys

import numpy as np
import openpyxl
import pytest
from typer.testing import CliRunner

import jaxsph as js
from jaxsph.cli.app import app
from jaxsph.output.dataset import wanted
from jaxsph.output.hdf5 import Variable
from jaxsph.output.run_file import RunFile
from jaxsph.output.sweep_file import Meanings, SweepFile

TOML = 'name = "fake"\nprecision = "float32"\n'
VARIABLES = {
    "P_a": Variable("Pa", "pressure of the air"),
    "eta": Variable("m", "elevation", "gauge"),
    "body_force": Variable("N m-1, N m-1, N", "force", "motion"),
}


@pytest.fixture
def run(tmp_path):
    """File of a run with a scalar reading, readings of gauges and of components, and three results."""
    places = {"gauge_x": ("gauge", np.array([1.0, 2.5]), "m", "position of the gauge")}
    file = RunFile.create(tmp_path / "run.h5", TOML, {}, places)
    series = {
        "time": np.array([0.0, 0.1, 0.2]),
        "P_a": np.array([0.0, 5.0, np.nan], np.float32),
        "eta": np.array([[0.0, 0.1], [0.2, 0.3], [0.4, 0.5]], np.float32),
        "body_force": np.ones((3, 3), np.float32),
    }
    file.append(series, VARIABLES, None, {"x": np.zeros(2)}, {})
    file.finish({"noise": 0.02, "xi": 0.61, "mine": 2.0}, ("why",), {"mine": js.Label("my own", "m2")})
    return file.path


@pytest.fixture
def sweep(tmp_path):
    """File of a sweep over two parameters; one of its members has failed and one has not ended."""
    series = {"time": np.arange(3.0), "noise": np.full(3, 0.5)}
    members = {
        k: {"results": {"xi": 0.1 * k, "noise": 0.02}, "series": series, "failure": ""} for k in range(3)
    }
    members[1] = {"results": {}, "series": {}, "failure": "too fast"}
    meanings = Meanings({"noise": Variable("m s-1", "noise of the particles")})
    axes = {"pto.K_dm": np.array([300.0, 400.0]), "waves.H": np.array([0.02, 0.04])}
    path = tmp_path / "sweep.h5"
    SweepFile(path).write(TOML, axes, (2, 2), members, meanings)
    return path


def table(path):
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.reader(file))


def test_a_run_is_two_tables(run):
    assert [path.name for path in js.export(run, run.with_suffix(".csv"))] == ["run.csv", "run_results.csv"]
    head, first, *_ = table(run.with_suffix(".csv"))
    assert head[0] == "time (s)" and set(head[1:]) == {
        *("P_a (Pa)", "eta [1] (m)", "eta [2.5] (m)"),
        *("body_force [x] (N m-1)", "body_force [z] (N m-1)", "body_force [moment] (N)"),
    }
    assert dict(zip(head, map(float, first), strict=True))["eta [2.5] (m)"] == pytest.approx(0.1)
    results = {row[0]: row[1:] for row in table(run.with_name("run_results.csv"))}
    assert float(results["xi"][0]) == 0.61 and results["xi"][2] == "hydrodynamic efficiency"
    assert results["mine"][:3] == ["2.0", "m2", "my own"]
    assert list(results)[:2] == ["result", "xi"]  # results of the device first


def test_a_sweep_is_a_row_for_each_member(sweep):
    js.export(sweep, sweep.with_suffix(".csv"))
    head, *rows = table(sweep.with_suffix(".csv"))
    assert head == ["pto.K_dm", "waves.H", "xi", "noise", "failure"]
    assert rows[0][:2] == ["300.0", "0.02"] and rows[1][2:] == ["", "", "too fast"]
    assert rows[2] == ["400.0", "0.02", "0.2", "0.02", ""] and len(rows) == 3


def test_a_workbook_has_a_sheet_for_each_table(run):
    (path,) = js.export(run, run.with_suffix(".xlsx"))
    book = openpyxl.load_workbook(path)
    assert book.sheetnames == ["results", "series"]
    series = {cells[0].value: [cell.value for cell in cells[1:]] for cells in book["series"].columns}
    assert series["P_a (Pa)"] == [0.0, 5.0, None] and series["eta [1] (m)"][2] == pytest.approx(0.4)


def test_nothing_is_replaced_unasked_and_other_endings_are_refused(run):
    run.with_name("run_results.csv").write_text("mine")
    with pytest.raises(js.FileError, match="run_results.csv exists"):
        js.export(run, run.with_suffix(".csv"))
    assert not run.with_suffix(".csv").exists()  # refused before anything is written
    with pytest.raises(js.FileError, match=r"must end in \.csv, \.xlsx or \.mat"):
        js.export(run, run.with_suffix(".txt"))


def test_the_command_writes_beside_the_file(run):
    command = CliRunner().invoke(app, ["export", str(run), "--xlsx"])
    assert command.exit_code == 0 and f"table: {run.with_suffix('.xlsx')}" in command.stdout
    both = CliRunner().invoke(app, ["export", str(run), "--csv", "--xlsx"])
    assert both.exit_code == 2 and "give only one of them" in both.stderr


def test_a_run_is_a_dataset_with_units_and_results(run):
    found = js.read(run)
    assert found["P_a"].attrs == {"units": "Pa", "long_name": "pressure of the air"}
    assert found["eta"].dims == ("time", "gauge")
    np.testing.assert_allclose(found["gauge_x"], [1.0, 2.5])
    np.testing.assert_allclose(found["eta"].sel(time=0.1), [0.2, 0.3])
    assert found.attrs["xi"] == 0.61 and found.attrs["notices"] == "why" and found.attrs["case"] == TOML


def test_a_sweep_is_a_dataset_over_its_parameters(sweep):
    found = js.read(sweep)
    assert found["xi"].dims == ("pto.K_dm", "waves.H")
    assert float(found["xi"].sel({"pto.K_dm": 400.0, "waves.H": 0.02})) == pytest.approx(0.2)
    assert np.isnan(found["xi"].sel({"pto.K_dm": 300.0, "waves.H": 0.04}))
    assert found["noise"].ndim == 2 and found["noise_series"].dims == ("pto.K_dm", "waves.H", "time")


@pytest.mark.parametrize(
    ("missing", "call"),
    [
        ("xarray", lambda path: js.read(path)),
        ("openpyxl", lambda path: js.export(path, path.with_suffix(".xlsx"))),
    ],
)
def test_a_missing_library_names_the_extra(run, monkeypatch, missing, call):
    monkeypatch.setitem(sys.modules, missing, None)
    with pytest.raises(js.FileError, match=r"pip install \"jaxsph\[analysis\]\""):
        call(run)


def test_a_library_that_cannot_be_imported_is_named_with_its_reason():
    with pytest.raises(js.FileError, match=r"js.read needs xarray, but a broken library: run pip"):
        with wanted("js.read", "xarray"):
            raise ImportError("a broken library")


@pytest.mark.parametrize("dim", [2, 3])
def test_a_linear_flow_is_exact_on_a_grid_and_nothing_outside(dim):
    rng = np.random.default_rng(0)
    axes = [np.arange(0.05, 1.0, 0.1)] * dim
    x = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, dim)
    x += 0.01 * rng.standard_normal(x.shape)
    u = np.zeros_like(x)
    u[:, 0], u[:, -1] = 0.3 + 2.0 * x[:, -1], 0.5 * x[:, 0]
    snapshot = {"x": x, "u": u, "p": 9810.0 * (1.0 - x[:, -1]), "time": 1.5}
    at_x, at_z = np.array([0.2, 0.55]), np.array([0.3, 0.7, 1.5])
    found = js.on_grid(snapshot, at_x, at_z)
    assert found["pressure"].dims == ("z", "x") and found.attrs["time"] == 1.5
    inside = found.isel(z=slice(2))
    # the fit is regularised by 1e-6 of its weights
    np.testing.assert_allclose(inside["velocity_x"], np.tile(0.3 + 2.0 * at_z[:2, None], 2), rtol=1e-4)
    np.testing.assert_allclose(inside["velocity_z"], np.tile(0.5 * at_x, (2, 1)), rtol=1e-4)
    np.testing.assert_allclose(inside["pressure"], np.tile(9810.0 * (1.0 - at_z[:2, None]), 2), rtol=1e-4)
    np.testing.assert_allclose(inside["vorticity"], 1.5, rtol=1e-4)
    assert np.isnan(found["pressure"].sel(z=1.5)).all()


def test_a_grid_has_no_values_inside_solids(tmp_path):
    # a fixed wall thinner than a spacing, and a body that has moved by 0.2 m since it was drawn
    solids = [
        {"name": "", "corners": [[0.46, 0.3], [0.54, 0.3], [0.54, 1.0], [0.46, 1.0]], "pivot": [0.0, 0.0]},
        {"name": "box", "corners": [[0.6, 0.6], [0.7, 0.6], [0.7, 0.7], [0.6, 0.7]], "pivot": [0.65, 0.65]},
    ]
    run = RunFile.create(tmp_path / "run.h5", 'name = "wall"', {}, {}, scene={"solids": solids})
    x = np.stack(np.meshgrid(*[np.arange(0.05, 1.0, 0.1)] * 2), axis=-1).reshape(-1, 2)
    snapshot = {"time": 0.0, "x": x, "u": np.zeros_like(x), "p": x[:, 1], "box": np.array([0.2, 0.0, 0.0])}
    run.append({"time": np.zeros(1)}, {"time": Variable("s", "time")}, snapshot, {}, {})
    stored = RunFile.open(run.path).snapshot(0)
    found = js.on_grid(stored, np.array([0.4, 0.5, 0.65, 0.85]), np.array([0.2, 0.65]))["pressure"]
    np.testing.assert_array_equal(np.isnan(found), [[0, 0, 0, 0], [0, 1, 0, 1]])
    whole = js.on_grid(dict(stored), found.x, found.z)["pressure"]  # without the run's outlines
    assert np.isfinite(whole).all()
