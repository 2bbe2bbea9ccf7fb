"""Problems from a user's own function: run, killed, resumed, swept, differentiated, and refused."""

import os
import pickle
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import coarse, kill_with_two_checkpoints
from typer.testing import CliRunner

import jaxsph as js
from jaxsph.cli.app import app
from jaxsph.errors import CaseError, FileError
from jaxsph.output.run_file import RunFile

AS_HERE = os.environ | {"PYTHONPATH": str(Path(js.__file__).parents[1])}
OWC = coarse("owc", {"output.snapshot_dt": 0.05, "t1": 0.1})
SWELL = coarse("hydrostatic", {"start.amplitude": 0.03, "output.snapshot_dt": 0.05, "t1": 0.2})
OWN = f"""
import numpy as np
import jaxsph as js

OWC = js.Case.from_dict({OWC.model_dump(exclude_none=True, mode="json")!r})
SWELL = js.Case.from_dict({SWELL.model_dump(exclude_none=True, mode="json")!r})


def swell(amplitude=0.05, t1=0.2):
    made = SWELL.replace({{"start.amplitude": amplitude}}).problem()
    labels = {{"highest": js.Label("highest elevation", "m")}}
    own = dict(probes=made.probes, results=[js.Result(highest, labels)], snapshot_dt=0.05)
    return js.Problem(made.model, made.state, 0.01, t1, **own)


def highest(record):
    return {{"highest": np.max(record["eta"])}}


def owc(K_dm=500.0, wall=0.08):
    made = OWC.replace({{"pto.K_dm": K_dm, "device.wall_thickness": wall}}).problem()
    return js.Problem(made.model, made.state, 0.01, 0.1, probes=made.probes, snapshot_dt=0.05)
"""
"""A user's file: a standing wave with a result of its own, and a coarse OWC."""


@pytest.fixture(scope="module")
def own(tmp_path_factory):
    """Place of the function in a user's file."""
    file = tmp_path_factory.mktemp("own") / "own.py"
    file.write_text(OWN, encoding="utf-8")
    return f"{file}:swell"


@pytest.fixture(scope="module")
def whole(own, tmp_path_factory):
    """Run by the command line: its file, and what the command printed."""
    path = tmp_path_factory.mktemp("whole") / "run.h5"
    told = _command("run", own, "--set", "amplitude=0.03", "--out", path, "--no-plot")
    return path, told


def _command(*arguments, code=0):
    done = CliRunner().invoke(app, [str(one) for one in arguments])
    assert done.exit_code == code, done.output
    return done.output


def test_a_function_is_run_with_a_file_a_page_and_a_result_of_its_own(own, whole):
    path, told = whole
    file = RunFile.open(path)
    assert re.search(r"highest elevation +\d", told)
    assert file.labels()["highest"] == ["highest elevation", "m", "", "device"]
    assert file.results()["highest"] == pytest.approx(file.series()["eta"].max(), rel=1e-6)
    assert file.case_keys()["arguments"] == {"amplitude": 0.03, "t1": 0.2}
    page = path.with_suffix(".html").read_text(encoding="utf-8")
    assert page.startswith("<!doctype html>") and len(page) > 100_000
    # it is the case's own problem, and its readings are equal bit for bit
    case = js.run(SWELL, progress=False)
    assert all(np.array_equal(case[name], values) for name, values in file.series().items())


def test_a_killed_program_resumes_to_the_bit_when_it_is_named_again(own, whole, tmp_path):
    path = tmp_path / "killed.h5"
    command = [
        sys.executable,
        "-m",
        "jaxsph",
        "run",
        own,
        "--set",
        "amplitude=0.03",
        "--set",
        "t1=30",
        "--out",
        path,
    ]
    process = subprocess.Popen([*command, "--quiet", "--no-report", "--no-plot"], env=AS_HERE)
    kill_with_two_checkpoints(process, path)
    assert "pass the function or the problem again" in _command("resume", path, code=2)
    done = RunFile.open(path).snapshot_count * 0.05
    t1 = max(0.2, round(done + 0.05, 2))
    _command("resume", path, "--program", own, "--t1", t1, "--quiet", "--no-report", "--no-plot")
    series = RunFile.open(path).series()
    for name, values in RunFile.open(whole[0]).series().items():
        assert np.array_equal(series[name][: len(values)], values), name


@pytest.mark.slow
def test_a_function_whose_arguments_have_no_defaults_is_run_swept_and_resumed(tmp_path):
    """Its values come from --set, from the sweep, and from the file of the run."""
    file = tmp_path / "needy.py"
    file.write_text(OWN.replace("def swell(amplitude=0.05, t1=0.2)", "def swell(amplitude, t1)"))
    path = tmp_path / "run.h5"
    given = ["--set", "amplitude=0.03", "--set", "t1=0.06"]
    _command("run", f"{file}:swell", *given, "--out", path, "--no-plot", "--no-report", "--quiet")
    _command("resume", path, "--program", f"{file}:swell", "--no-plot", "--no-report", "--quiet")
    assert RunFile.open(path).case_keys()["arguments"] == {"amplitude": 0.03, "t1": 0.06}
    program = js.Program.load(f"{file}:swell", {"amplitude": 0.03, "t1": 0.06})
    done = js.sweep(program, {"amplitude": [0.02]}, tmp_path / "s.h5", workers=1, progress=False)
    assert not done.failures and done["highest"][0] > 0.0
    assert "amplitude is missing" in _command("run", f"{file}:swell", "--out", tmp_path / "n.h5", code=2)


def test_a_sweep_of_a_function_runs_its_members_in_processes(own, whole, tmp_path):
    out = tmp_path / "sweep.h5"
    told = _command(
        "sweep", own, "--grid", "amplitude=0.03,0.05", "--set", "t1=0.1", "--out", out, "--workers", 1
    )
    assert "highest elevation" in told and out.with_suffix(".html").exists()
    found = js.read_sweep(out)
    alone = RunFile.open(whole[0]).series()["eta"][:10].max()
    # members are compiled with another flag, which changes the rounding of sums
    assert found["highest"][0] == pytest.approx(alone, rel=1e-3) and not found.failures
    assert _command("plot", out).strip().endswith("highest.png")
    assert "linear theory is available only for cases" in _command("plot", whole[0], "--linear", code=2)
    assert "The studies differ in arguments.t1 (0.1 there, 0.2 here)" in _command(
        "sweep", own, "--grid", "amplitude=0.03,0.05", "--out", out, code=2
    ).replace("\n", " ")


def test_a_program_that_sweeps_when_it_is_imported_fails_as_a_member_only(tmp_path):
    """Members import the program too; they would start the sweep again, without end."""
    file = tmp_path / "eager.py"
    call = f'js.sweep(swell, {{"amplitude": [0.03]}}, {str(tmp_path / "s.h5")!r}, workers=1, progress=False)'
    file.write_text(f"{OWN}\nfound = {call}\n", encoding="utf-8")
    found = js.Program.load(f"{file}:swell")
    assert "a member of a sweep started a sweep" in js.read_sweep(tmp_path / "s.h5").failures[0,]
    assert found.arguments == {"amplitude": 0.05, "t1": 0.2}


@pytest.mark.slow
def test_a_function_inside_another_is_swept_in_this_process(tmp_path):
    def inner(amplitude: float = 0.03) -> js.Problem:
        return SWELL.replace({"start.amplitude": amplitude, "t1": 0.05}).problem()

    over = {"amplitude": [0.03, 0.05]}
    found = js.sweep(inner, over, tmp_path / "inner.h5", progress=False)
    assert np.all(np.isfinite(found["energy_stored"])) and not found.failures
    assert js.sweep(inner, over, tmp_path / "inner.h5", progress=False)["steps"].all()


def test_an_assembled_problem_has_a_file_and_goes_on(tmp_path):
    path, problem = tmp_path / "a.h5", SWELL.problem()
    js.run(problem, t1=0.1, out=path, progress=False)
    with pytest.raises(FileError, match=r"assembled in Python.* pass the problem again: js.resume"):
        js.resume(path, progress=False)
    again = js.resume(path, given=problem, progress=False)
    assert np.array_equal(again["eta"], js.run(SWELL, progress=False)["eta"])
    with pytest.raises(FileError, match="and not by 'hydrostatic'"):
        js.resume(path, given=SWELL, progress=False)
    with pytest.raises(FileError, match="differs from the model of the run"):
        js.resume(path, given=SWELL.replace({"fluid.nu": 1e-3}).problem(), progress=False)
    with pytest.raises(CaseError, match="is already built"):
        js.sweep(problem, {"amplitude": [1.0]}, tmp_path / "s.h5", progress=False)


@pytest.mark.slow
def test_exact_slope_of_a_function_is_that_of_its_case(own):
    of_case = js.derivative(OWC, "pto.K_dm", "energy_pto", js.Exact(), progress=False)
    arguments = {"K_dm": OWC.pto.K_dm, "wall": OWC.device.wall_thickness}
    program = js.Program.load(own.replace("swell", "owc"), arguments)
    found = js.derivative(program, "K_dm", "energy_pto", js.Exact(), progress=False)
    assert found.value == of_case.value and found.slope == of_case.slope
    with pytest.raises(
        CaseError,
        match="wall: the model changes disc|changes the number of particles|wall changes values that are",
    ):
        js.derivative(program, "wall", "energy_pto", js.Exact(), progress=False)
    with pytest.raises(CaseError, match="of = 'xi': must be one of .*energy_separation, energy_pto"):
        js.derivative(program, "K_dm", "xi", progress=False)


WRONG = {
    "x: float = 1.0": ("return 3.0", r"returned a float: must be a js.Problem"),
    "x: float = 2.0": ("pass", r"returned nothing: must be a js.Problem"),
    "x: float = 3.0": (
        "raise ValueError('too wide')",
        r"wrong.py:\w+\(x=3.0\) raised ValueError: too wide \(wrong.py, line \d+\)",
    ),
    "x": ("pass", r"x is missing; give it as x=VALUE"),
    "*x": ("pass", r"x cannot be passed by name; use named arguments only"),
    "x=object": ("pass", r"x = <class 'object'> must be a number, a string"),
}
"""Functions that do not make a problem, by their arguments: body, and words of the error."""


@pytest.mark.parametrize("arguments", WRONG)
def test_a_function_that_makes_no_problem_is_refused(arguments, tmp_path):
    body, words = WRONG[arguments]
    file = tmp_path / "wrong.py"
    file.write_text(f"def made({arguments}):\n    {body}\n", encoding="utf-8")
    with pytest.raises(CaseError, match=words):
        js.run(js.Program.load(f"{file}:made"), out=tmp_path / "none.h5")
    assert not (tmp_path / "none.h5").exists()


def test_what_is_no_program_is_named(own, tmp_path):
    for place, words in (
        ("own.py", r"must be FILE.py:FUNCTION"),
        (f"{tmp_path}/none.py:f", r"there is no such file"),
        (own + "s", r"has no function 'swells'; did you mean swell\? \(it has swell, highest, owc\)"),
    ):
        with pytest.raises(CaseError, match=words):
            js.Program.load(place)
    broken = tmp_path / "broken.py"
    broken.write_text("import nothing_of_the_name\n", encoding="utf-8")
    with pytest.raises(CaseError, match="importing this file raised ModuleNotFoundError"):
        js.Program.load(f"{broken}:f")
    with pytest.raises(
        CaseError, match=r"has no argument 'amplitud'; did you mean 'amplitude'\? \(it has amplitude, t1\)"
    ):
        js.Program.load(own, {"amplitud": 1.0})
    with pytest.raises(CaseError, match="int cannot be run"):
        js.run(3)
    assert "only a case can be made coarse" in _command("run", own, "--quick", code=2).replace("\n", " ")


def test_a_program_that_has_changed_since_is_refused(own, whole, tmp_path):
    """Whatever has changed in the file, continuing would silently be another run."""
    path = shutil.copy(whole[0], tmp_path / "run.h5")
    changed = tmp_path / "own.py"
    changed.write_text(OWN + "# another\n", encoding="utf-8")
    with pytest.raises(FileError, match=r"own.py:swell has changed since the run began"):
        js.resume(path, t1=0.25, given=js.Program.load(f"{changed}:swell"), progress=False)
    with pytest.raises(FileError, match=r"was made by own.py:swell, and not by 'owc'"):
        js.resume(path, t1=0.25, given=OWC, progress=False)
    with pytest.raises(CaseError, match="amplitude: only the values of a case can change"):
        js.resume(path, t1=0.25, given=js.Program.load(own), changes={"amplitude": 0.1}, progress=False)
    assert Path(path).read_bytes() == whole[0].read_bytes()


def test_a_program_goes_to_a_worker_as_its_place_and_arguments(own):
    program = js.Program.load(own, {"amplitude": 1})
    again = pickle.loads(pickle.dumps(program))
    assert again.to_toml() == program.to_toml() and again.arguments["amplitude"] == 1.0
    assert program.replace({"amplitude": None}).arguments["amplitude"] == 0.05


def test_a_problem_that_does_not_fit_is_refused():
    made = SWELL.problem()
    model, state = made.model, made.state
    for arguments, words in (
        ((0.0123, 1.0), r"sample_dt = 0.0123 s is 7.38 time steps"),
        ((0.01, 0.0), r"t1 = 0.0 s: must be a positive, finite time"),
        ((0.01, float("nan")), r"t1 = nan s: must be a positive, finite time"),
    ):
        with pytest.raises(CaseError, match=words):
            js.Problem(model, state, *arguments)
    with pytest.raises(CaseError, match="the reading 'kinetic' of .* has the same name"):
        js.Problem(model, state, 0.01, 1.0, probes=[*made.probes, *made.probes])
    with pytest.raises(TypeError, match="no argument snapshots"):
        js.Problem(model, state, 0.01, 1.0, snapshots=3)


def test_a_result_that_fails_costs_no_other():
    made = SWELL.replace({"t1": 0.05}).problem()
    fails = js.Result(lambda record: {"a": record["nothing"]}, what="largest nothing")
    counts = js.Result(lambda record: {"b": 1.0 + record.results["steps"]})
    problem = js.Problem(made.model, made.state, 0.01, 0.05, probes=made.probes, results=[fails, counts])
    solution = js.run(problem, progress=False)
    assert solution.results["b"] == solution.results["steps"] + 1.0 and "a" not in solution.results
    assert any(
        notice.startswith("no result for the largest nothing: KeyError") for notice in solution.notices
    )


def test_coordinates_of_probes_are_the_decimals_given():
    made = coarse("hydrostatic_3d", {"probes.surface": [[0.1, 0.3]]}).problem()
    found = {name: values for probe in made.probes for name, (_, values, *_) in probe.coordinates().items()}
    assert found["surface_point_x"] == 0.1 and found["surface_point_y"] == 0.3
    assert made.model.dt.dtype == np.float32 and float(np.float32(0.3)) != 0.3
