"""The command line, with a fake solver: options passed on, output printed, exit status."""

import inspect
import re
import types
from importlib.metadata import version

import numpy as np
import pytest
from typer.testing import CliRunner

import jaxsph as js
from jaxsph.cli.app import app
from jaxsph.cli.arguments import load, setting_of, values_of
from jaxsph.errors import CaseError, FileError, SimulationError
from jaxsph.output.hdf5 import Variable
from jaxsph.output.run_file import RunFile


class _Case:
    name = "fake"
    precision = "float32"

    def __init__(self, changes=None):
        self.changes = changes or {}

    def replace(self, changes):
        return _Case(self.changes | changes)

    def value(self, name):
        return self.changes[name]

    built = value

    def notices(self):
        return ["chamber snapped"]

    def problem(self):
        return types.SimpleNamespace(labels={"xi": ("efficiency",)})


def _record(path, overwrite=False, checkpoint=True, toml='name = "fake"\nprecision = "float32"\n'):
    run = RunFile.create(path, toml, {}, {}, overwrite)
    if checkpoint:
        series = {"time": np.arange(4.0), "P_a": np.arange(4.0)}
        saved = {"x": np.zeros(2)}
        run.append(series, {"P_a": Variable("Pa", "pressure")}, None, saved, {})
    return run


def _ended(results, notices=()):
    """The parts of a solution that the command line reads."""
    model = types.SimpleNamespace(g=(0.0, -9.81))
    return types.SimpleNamespace(results=results, notices=notices, labels={}, model=model)


@pytest.fixture
def calls(monkeypatch, tmp_path):
    """Replaces the solver's functions by stand-ins, and records their calls."""
    monkeypatch.chdir(tmp_path)
    found = []
    solution = _ended({"xi": 0.4871, "steps": 1200.0, "mine": 1.5})

    def load_case(name):
        if name == "oww":
            raise CaseError("no built-in case 'oww'; did you mean 'owc'?")
        return _Case()

    def run(case, **options):
        found.append((case, options))
        _record(options["out"], options["overwrite"])
        return solution

    def resume(path, **options):
        found.append((path, options))
        return solution

    monkeypatch.setattr(js, "load_case", load_case, raising=False)
    monkeypatch.setattr(js, "run", run, raising=False)
    monkeypatch.setattr(js, "resume", resume, raising=False)
    monkeypatch.setattr(js, "check", lambda case: [("particles", "8,224")], raising=False)
    monkeypatch.setattr(js, "linear_check", lambda case: [("linear efficiency", "0.78")], raising=False)
    found_duration = js.Duration(10.0, 0.01, 1200, 1)
    monkeypatch.setattr(js, "duration", lambda case, devices=None: found_duration, raising=False)
    monkeypatch.setattr(js, "built_in_cases", lambda: {"owc": "a column"}, raising=False)
    return found


def _jaxsph(*arguments):
    return CliRunner().invoke(app, [str(a) for a in arguments])


def test_quick_run_says_that_it_is_coarse_and_leaves_the_pictures_out(calls, monkeypatch, tmp_path):
    monkeypatch.setattr(js, "coarsen", lambda case: _Case({"coarse": True}), raising=False)
    result = _jaxsph("run", "owc", "--quick", "--no-report")
    assert result.exit_code == 0, result.output
    case, options = calls[0]
    assert case.changes == {"coarse": True} and options["overwrite"] is False
    assert "this was a COARSE run" in result.stdout and "jaxsph run owc" in result.stdout
    assert "pictures" not in result.stdout and "page for a browser" not in result.stdout


def test_quick_run_does_not_replace_a_file(calls, monkeypatch, tmp_path):
    monkeypatch.setattr(js, "coarsen", lambda case: _Case({"coarse": True}), raising=False)
    _jaxsph("run", "owc", "--quick", "--no-report")
    before = (tmp_path / "runs" / "fake.h5").read_bytes()
    result = _jaxsph("run", "owc", "--quick", "--no-report")
    assert result.exit_code == 2 and "--overwrite" in result.stderr and "nothing was changed" in result.stderr
    assert (tmp_path / "runs" / "fake.h5").read_bytes() == before
    assert _jaxsph("run", "owc", "--quick", "--no-report", "--overwrite").exit_code == 0


@pytest.mark.parametrize("name", ["", ".", "..", "a/", "a/.", "..toml", " ", "a/.toml", "a\0b", "a\nb"])
def test_a_new_case_needs_a_name(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    result = _jaxsph("new", name)
    assert result.exit_code == 2 and "must end with a file name" in result.stderr
    assert not list(tmp_path.iterdir())


def test_the_version_is_printed():
    result = _jaxsph("--version")
    assert result.exit_code == 0 and result.stdout.strip() == f"jaxsph {version('jaxsph')}"


def test_the_end_time_can_be_given_to_every_command_that_runs_a_case():
    """The runs of `coefficients` end after a number of periods, which has its own option."""
    parameters = {one.name: inspect.signature(one.callback).parameters for one in app.registered_commands}
    run = {name for name, found in parameters.items() if {"quick", "out"} <= set(found)}
    assert run >= {"run", "sweep", "matrix", "slope", "optimise"}
    assert {name for name in run if "t1" not in parameters[name]} == {"coefficients"}
    assert load("owc", None, t1=3.0).t1 == 3.0 and load("owc", None, True, 3.0).t1 == 3.0


def test_run_records_prints_and_plots(calls, tmp_path):
    result = _jaxsph("run", "owc")
    assert result.exit_code == 0, result.output
    _, options = calls[0]
    assert options["out"].as_posix() == "runs/fake.h5" and options["t1"] is None
    assert options["overwrite"] is False and options["progress"] is True
    assert "note: chamber snapped" in result.stderr
    lines = [line.split() for line in result.stdout.splitlines()]
    assert ["time", "steps", "1200"] in lines
    assert ["hydrodynamic", "efficiency", "0.4871"] in lines
    assert ["mine", "1.5"] in lines
    assert "runs/fake.h5" in result.stdout
    assert (tmp_path / "runs" / "fake_plots" / "chamber.png").exists()


def test_run_passes_its_options_on(calls, tmp_path):
    result = _jaxsph(
        "run", "owc", "--set", "pto.K_dm=300", "--set", "name=my owc", "--set", "sponge=",
        "--set", "probes.gauges=[1.0, 2.0]", "--t1", 2, "--out", "a.h5", "--overwrite",
        "--no-plot", "--quiet",
    )  # fmt: skip
    assert result.exit_code == 0 and result.output == ""
    case, options = calls[0]
    assert case.changes == {
        "pto.K_dm": 300,
        "name": "my owc",
        "sponge": None,
        "probes.gauges": [1.0, 2.0],
        "t1": 2.0,  # also in the file, so that `resume` ends there
    }
    assert options["t1"] == 2.0 and options["overwrite"] and not options["progress"]
    assert not (tmp_path / "a_plots").exists()


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("dx=0.01", ("dx", 0.01)),
        ("a.b = true", ("a.b", True)),
        ('name="x=y"', ("name", "x=y")),
        ("scheme.kernel=wendland", ("scheme.kernel", "wendland")),
    ],
)
def test_settings_are_toml_or_text(text, expected):
    assert setting_of(text) == expected


def test_keys_that_a_setting_replaces_are_told(tmp_path, capsys):
    """Otherwise an orifice would silently become a turbine."""
    file = tmp_path / "orifice.toml"
    file.write_text(js.load_case("owc").replace({"pto.area": 0.005}).to_toml())
    case = load(str(file), ["pto.K_dm=300"])
    assert case.pto.area is None
    told = capsys.readouterr().err
    assert told == "note: pto.area = 0.005 of the case no longer applies with pto.K_dm = 300\n"
    load(str(file), ["pto.area=0.004", "device=", "pto=", "probes.gauges=[1.0, 1.4, 2.0]"])
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("text", ["dx", "=3", ""])
def test_setting_without_key_or_value(calls, text):
    result = _jaxsph("run", "owc", "--set", text)
    assert result.exit_code == 2 and "KEY=VALUE" in result.stderr and not calls


def test_resume(calls, tmp_path):
    run = _record(tmp_path / "a.h5")
    result = _jaxsph("resume", run.path, "--t1", 5, "--no-plot")
    options = {"t1": 5.0, "progress": True, "changes": {}, "devices": None, "given": None}
    assert result.exit_code == 0 and calls == [(run.path, options)]
    assert _jaxsph("resume", "missing.h5").exit_code == 2


def test_resume_with_changes(calls, tmp_path):
    run = _record(tmp_path / "a.h5")
    result = _jaxsph("resume", run.path, "--set", "tank.height=1.5", "--set", "pto.K_dm=300", "--no-plot")
    assert result.exit_code == 0
    assert calls[0][1]["changes"] == {"tank.height": 1.5, "pto.K_dm": 300}


def test_a_particle_over_the_rim_names_the_file(calls, monkeypatch, tmp_path):
    def stops(case, out, **_):
        _record(out)
        raise SimulationError(
            "raise tank.height and continue: jaxsph resume FILE --set tank.height=1.5", step=3
        )

    monkeypatch.setattr(js, "run", stops)
    assert "jaxsph resume a.h5 --set tank.height=1.5" in _jaxsph("run", "owc", "--out", "a.h5").stderr


def test_notices_of_the_results_are_printed(calls, monkeypatch):
    def run(case, out, **_):
        _record(out)
        return _ended({"steps": 1.0}, ("no result for the reflection: why",))

    monkeypatch.setattr(js, "run", run)
    assert "note: no result for the reflection: why" in _jaxsph("run", "owc", "--no-plot").stderr


def test_doubts_about_the_results_are_printed(calls, monkeypatch):
    monkeypatch.setattr(_Case, "waves", object(), raising=False)
    few = _ended({"xi": 0.5, "periods": 2.0, "noise": 0.2})
    monkeypatch.setattr(js, "run", lambda case, out, **_: _record(out) and few)
    said = _jaxsph("run", "owc", "--no-plot").stderr
    assert said.count("note: Results are averaged over 2 periods only: raise t1") == 1
    assert "note: The particles are noisy: " in said
    monkeypatch.setattr(js, "run", lambda case, out, **_: _record(out, True) and _ended({"steps": 1.0}))
    assert "too short for a mean over a settled wave period" in _jaxsph("run", "owc", "--no-plot").stderr


def test_check_and_cases(calls):
    result = _jaxsph("check", "owc")
    assert result.exit_code == 0
    assert [line.split() for line in result.stdout.splitlines()] == [
        ["particles", "8,224"],
        ["linear", "efficiency", "0.78"],
    ]
    assert "chamber snapped" in result.stderr
    timed = _jaxsph("check", "owc", "--time").stdout.splitlines()
    assert timed[-1].split() == [
        "wall",
        "time",
        "22",
        "s",
        "on",
        "1",
        "device",
        "here,",
        "including",
        "10",
        "s",
        "of",
        "compilation",
    ]
    assert _jaxsph("cases").stdout == "owc  a column\n"


def test_plot_and_export(calls, tmp_path):
    run = _record(tmp_path / "a.h5")
    result = _jaxsph("plot", run.path, "--no-animation", "--out", tmp_path / "p")
    assert result.exit_code == 0 and (tmp_path / "p" / "chamber.png").exists()
    result = _jaxsph("plot", run.path, "--no-animation", "--vtk", tmp_path / "a.vtkhdf")
    assert result.exit_code == 2 and "no snapshots" in result.stderr


def test_plot_with_linear_theory(tmp_path):
    case = js.load_case("owc")
    run = _record(tmp_path / "a.h5", toml=case.to_toml())
    result = _jaxsph("plot", run.path, "--no-animation", "--linear")
    assert result.exit_code == 0 and (tmp_path / "a_plots" / "chamber.png").exists()
    calm = _record(tmp_path / "b.h5", toml=case.replace({"waves": None}).to_toml())
    result = _jaxsph("plot", calm.path, "--no-animation", "--linear")
    assert result.exit_code == 2 and "waves" in result.stderr


@pytest.mark.parametrize(
    ("error", "code"),
    [(CaseError("dx = -1"), 2), (FileError("exists"), 2), (SimulationError("not finite"), 1)],
)
def test_errors_are_messages_with_a_code(calls, monkeypatch, error, code):
    def fails(*_, **__):
        raise error

    monkeypatch.setattr(js, "run", fails)
    result = _jaxsph("run", "owc")
    assert result.exit_code == code
    assert f"jaxsph: error: {error.args[0]}" in result.stderr
    assert "Traceback" not in result.output
    assert _jaxsph("run", "oww").exit_code == 2


@pytest.mark.parametrize("checkpoint", [True, False])
def test_interruption_says_how_to_go_on(calls, monkeypatch, tmp_path, checkpoint):
    def interrupted(case, out, **_):
        _record(out, checkpoint=checkpoint)
        raise KeyboardInterrupt

    monkeypatch.setattr(js, "run", interrupted)
    result = _jaxsph("run", "owc", "--out", "a.h5")
    assert result.exit_code == 130 and "Traceback" not in result.output
    assert ("jaxsph resume a.h5" in result.stderr) == checkpoint
    assert ("--overwrite" in result.stderr) != checkpoint


def test_stopped_run_says_what_is_left(calls, monkeypatch):
    def stops(case, out, **_):
        _record(out)
        raise SimulationError("not finite near (1, 2) m", step=3)

    monkeypatch.setattr(js, "run", stops)
    result = _jaxsph("run", "owc", "--out", "a.h5")
    assert result.exit_code == 1 and "not finite" in result.stderr
    assert "jaxsph resume a.h5" in result.stderr


def test_interruption_while_plotting(calls, monkeypatch, tmp_path):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("jaxsph.output.plot.pictures.plot_run", interrupted)
    assert _jaxsph("plot", _record(tmp_path / "a.h5").path).exit_code == 130


def test_slope_is_printed_with_its_error(calls, monkeypatch):
    def derivative(case, parameter, of, method, progress):
        calls.append((parameter, of, method))
        error = 3e-5 if isinstance(method, js.Ensemble) else None
        return js.Derivative(parameter, of, 0.5, 2e-4, error, 160.0, method)

    monkeypatch.setattr(js, "derivative", derivative, raising=False)
    result = _jaxsph("slope", "owc", "--over", "pto.K_dm", "--members", "5")
    assert (
        result.exit_code == 0 and "d xi / d pto.K_dm" in result.stdout and "0.0002 +- 3e-05" in result.stdout
    )
    method = calls[0][2]
    assert (method.members, method.spread, method.out.as_posix()) == (5, 0.3, "runs/fake_pto.K_dm.h5")
    exact = _jaxsph("slope", "owc", "--over", "pto.K_dm", "--of", "energy_pto", "--method", "exact")
    assert isinstance(calls[1][2], js.Exact) and "+-" not in exact.stdout and "recorded" not in exact.stdout
    _jaxsph("slope", "owc", "--over", "pto.K_dm", "--method", "filtered")
    assert isinstance(calls[2][2], js.Filtered)
    bad = _jaxsph("slope", "owc", "--over", "pto.K_dm", "--members", "2")
    assert bad.exit_code == 2 and "members = 2" in bad.stderr


def test_optimise_prints_the_way_and_the_best(calls, monkeypatch, tmp_path):
    def maximise(case, over, out, of, method, evaluations, progress):
        calls.append((over, out, method, evaluations))
        slope = {"slope pto.K_dm": 2e-4, "error pto.K_dm": 1e-5}
        history = [{"pto.K_dm": 300.0, "xi": 0.4} | slope, {"pto.K_dm": 500.0, "xi": 0.5} | slope]
        best = types.SimpleNamespace(pto=types.SimpleNamespace(K_dm=500.0))
        return js.Maximum(best, of, 0.5, "2 evaluations", history)

    monkeypatch.setattr(js, "maximise", maximise, raising=False)
    result = _jaxsph("optimise", "owc", "--over", "pto.K_dm=100:2500", "--members", "5")
    assert result.exit_code == 0
    assert "xi at pto.K_dm = 300" in result.stdout
    assert "0.4, slope 0.0002 +- 1e-05" in result.stdout
    assert "best: xi = 0.5 at pto.K_dm = 500 (2 evaluations)" in result.stdout
    over, out, method, evaluations = calls[0]
    assert over == {"pto.K_dm": (100.0, 2500.0)} and out.as_posix() == "runs/fake_optimum.h5"
    assert method.members == 5 and evaluations == 10
    (tmp_path / "year.csv").write_text("Hs,Tp,share\n0.03,1.4,0.5\n0.04,1.4,0.5\n")
    year = _jaxsph("optimise", "owc", "--over", "pto.K_dm=100:2500", "--table", tmp_path / "year.csv")
    assert isinstance(calls[1][2], js.OverSeas) and calls[1][2].method.members == 9, year.stderr
    bad = _jaxsph("optimise", "owc", "--over", "pto.K_dm")
    assert bad.exit_code == 2 and "must be KEY=LOW:HIGH" in bad.stderr


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("1,2", [1, 2]),
        ("1:4:4", [1, 2, 3, 4]),
        ("1,2.5", [1.0, 2.5]),
        ("1.0,2", [1.0, 2.0]),
        ("1:2:3", [1, 1.5, 2]),
    ],
)
def test_values_of_a_grid_are_whole_where_they_are_written_so(text, values):
    """Whole numbers stay integers, as a seed must be; numbers with a decimal point become floats."""
    key, found = values_of(f"waves.seed={text}")
    assert key == "waves.seed" and found == values
    whole = all(float(one).is_integer() for one in values) and "." not in text
    assert all(isinstance(one, int) == whole for one in found)


def test_sweep_runs_a_grid_and_says_what_failed(calls, monkeypatch, tmp_path):
    def sweep(case, over, out, **options):
        calls.append((over, out, options, case))
        axes = {name: np.array(values) for name, values in over.items()}
        results = {"xi": np.array([[0.5, np.nan]])}
        members = {(0, 0): {}, (0, 1): {}}
        return js.Sweep(case, axes, results, {(0, 1): "too fast\nand why"}, members)

    monkeypatch.setattr(js, "sweep", sweep, raising=False)
    result = _jaxsph("sweep", "owc", "--grid", "pto.K_dm=300", "--grid", "waves.H=0.02:0.04:2")
    assert result.exit_code == 1  # one member failed
    over, out, _, _ = calls[0]
    assert over == {"pto.K_dm": [300.0], "waves.H": [0.02, 0.04]} and out.as_posix() == "runs/fake_sweep.h5"
    assert "pto.K_dm = 300, waves.H = 0.02  hydrodynamic efficiency 0.5" in result.stdout
    assert "failed: pto.K_dm = 300, waves.H = 0.04: too fast" in result.stderr
    assert result.stderr.count("note: chamber snapped") == 1
    assert re.search(r"^2 runs of about 12 s each, [12] at a time: about (22|34) s$", result.stderr, re.M)
    _jaxsph("sweep", "owc", "--grid", "pto.K_dm=300,400", "--grid", "waves.H=0.02", "--t1", 2)
    assert calls[1][3].changes == {"t1": 2.0}
    monkeypatch.setattr("jaxsph.cli.studies.CLUSTER_TIMEOUT", 0.2)
    alone = _jaxsph("sweep", "owc", "--grid", "pto.K_dm=300", "--scheduler", "tcp://127.0.0.1:9")
    assert alone.exit_code == 2 and "no Dask scheduler answers there" in alone.stderr
    both = _jaxsph("sweep", "owc", "--grid", "t1=1,2", "--t1", 2)
    assert both.exit_code == 2 and "--t1: t1 is also a parameter" in both.stderr
    bad = _jaxsph("sweep", "owc", "--grid", "pto.K_dm=a")
    assert bad.exit_code == 2 and "KEY=FIRST:LAST:COUNT" in bad.stderr


def test_a_study_is_refused_before_a_run_of_it_is_timed(monkeypatch, tmp_path):
    def never(*_, **__):
        raise AssertionError("timed before it was refused")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(js, "duration", never, raising=False)
    for command in (
        ("sweep", "owc", "--grid", "waves.heading=1,2"),
        ("matrix", "owc", "--hs", "0.02", "--tp", "1.2"),
        ("optimise", "owc", "--over", "pto.Kdm=100:200"),
        ("sweep", "owc", "--grid", "dx=0.02,-1"),
    ):
        refused = _jaxsph(*command)
        assert refused.exit_code == 2 and "error" in refused.stderr, command
