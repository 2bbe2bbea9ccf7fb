"""Files of studies: files of another study are refused, one study writes at a time, damage is reported."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest
from typer.testing import CliRunner

import jaxsph as js
from jaxsph.cli.app import app
from jaxsph.errors import CaseError, DerivativeError, FileError
from jaxsph.output.hdf5 import Variable
from jaxsph.output.run_file import RunFile
from jaxsph.output.sweep_file import Meanings, SweepFile
from jaxsph.study import members
from jaxsph.study.matrix import matrix_of
from jaxsph.study.scatter import ScatterTable

STILL = js.load_case("hydrostatic").replace({"dx": 0.25, "t1": 0.1, "probes": {"gauges": [0.5]}})
OWC = js.load_case("owc")
SEA = js.load_case("owc_irregular").replace(
    {
        "waves": {"kind": "irregular", "Hs": 0.04, "Tp": 1.4, "duration": 28.0},
        "tank.length": 4.0,
        "probes.gauges": [],
        "t1": 60.0,
    }
)
TABLE = ScatterTable(np.array([0.04]), np.array([1.4]), np.array([1.0]))
OTHER_TABLE = ScatterTable(np.array([0.03]), np.array([1.4]), np.array([1.0]))
BOUNDS = {"pto.K_dm": (100.0, 2500.0)}
FOUR = js.Ensemble(members=4)


class Study(NamedTuple):
    """A study that stores files: how it is run, the folder of its members beside `out`, and its case."""

    run: Callable
    member: str
    case: js.Case
    key: str


STUDIES = {
    "sweep": Study(
        lambda case, out: js.sweep(case, {"g": [9.81]}, out, progress=False), "s.h5.members", STILL, "nu"
    ),
    "matrix": Study(
        lambda case, out: js.power_matrix(case, [0.04], [1.4], out, progress=False),
        "s.h5.members",
        SEA,
        "nu",
    ),
    "ensemble": Study(
        lambda case, out: js.derivative(
            case, "pto.K_dm", "P_owc", js.Ensemble(members=4, out=out), progress=False
        ),
        "s.h5.members",
        OWC,
        "nu",
    ),
    "seas": Study(
        lambda case, out: js.derivative(
            case, "pto.K_dm", "P_owc", js.OverSeas(TABLE, FOUR, out), progress=False
        ),
        "s_sea00.h5.members",
        SEA,
        "nu",
    ),
    "search": Study(
        lambda case, out: js.maximise(case, BOUNDS, out, "P_owc", FOUR, evaluations=1, progress=False),
        "s.h5.evaluations/00_pto.K_dm.h5.members",
        OWC,
        "nu",
    ),
}


@pytest.fixture
def quick(monkeypatch):
    """Stand-ins for members; returns the list of cases run, and the list of calls to make meanwhile."""
    ran, meanwhile = [], []

    def member(case, stem):
        ran.append(case)
        for call in meanwhile:
            call()
        value = 1.0 + 1e-3 * (case.pto.K_dm if case.pto else 0.0)
        results = {"xi": value, "P_owc": value, "P_inc": 1.0, "xi_error": 0.1}
        return {"results": results, "series": {"time": np.arange(3.0)}, "failure": ""}, Meanings()

    monkeypatch.setattr(members, "run_member", member)
    return ran, meanwhile


def ended_member(path, case):
    """Writes the file of a run of the case that has ended with results, without running it."""
    run = RunFile.create(path, case.to_toml(), {}, {})
    run.append({"time": np.arange(3.0)}, {}, None, {"x": np.zeros(2)}, {})
    run.finish({"xi": 0.1, "P_owc": 0.1})
    return path


# --- members of another study


@pytest.mark.parametrize("name", STUDIES)
def test_a_study_refuses_members_of_another_that_lie_in_its_folder(name, tmp_path, quick):
    study, out = STUDIES[name], tmp_path / "s.h5"
    stored = ended_member(tmp_path / study.member / "0000.h5", study.case.replace({"fluid.rho0": 900.0}))
    before = stored.read_bytes()
    with pytest.raises(FileError, match="nothing was changed.*remove"):
        study.run(study.case, out)
    assert not quick[0] and not out.exists() and stored.read_bytes() == before


def test_the_refusal_names_the_folder_and_the_keys_that_differ(tmp_path, quick):
    folder = tmp_path / "s.h5.members"
    ended_member(folder / "0001.h5", STILL.replace({"g": 2.0, "fluid.rho0": 900.0}))
    words = rf"fluid.rho0 \(900.0 there, 1000.0 here\), g \(2.0 there, 3.0 here\).*remove {folder}"
    with pytest.raises(FileError, match=words):
        js.sweep(STILL, {"g": [1.0, 3.0]}, tmp_path / "s.h5", progress=False)
    (folder / "0001.h5").rename(folder / "0007.h5")  # as in a sweep with more members
    with pytest.raises(FileError, match="0007.h5 is a member of another sweep"):
        js.sweep(STILL, {"g": [1.0, 3.0]}, tmp_path / "s.h5", progress=False)
    assert not quick[0]


def test_a_batch_and_a_worker_refuse_a_member_of_another_sweep(tmp_path):
    """A worker on another machine checks again, because it may have been lost and come back."""
    stored = ended_member(tmp_path / "s.h5.members" / "0000.h5", STILL.replace({"g": 2.0}))
    with pytest.raises(FileError, match=r"g \(2.0 there, 1.0 here\)"):
        js.sweep(STILL, {"g": [1.0]}, tmp_path / "s.h5", batch=2, progress=False)
    with pytest.raises(FileError, match=r"g \(2.0 there, 9.81 here\)"):
        members.run_member(STILL, stored.with_suffix(""))


# --- identity of a search

BY = {"of": "P_owc", "method": FOUR}


@pytest.mark.parametrize(
    ("first", "second", "named"),
    [
        (BY, BY | {"of": "xi"}, r"of \(P_owc there, xi here\)"),
        (BY, BY | {"method": js.Ensemble(members=5)}, r"method.members \(4 there, 5 here\)"),
        (BY, BY | {"method": js.Ensemble(0.2, 4)}, r"method.spread \(0.3 there, 0.2 here\)"),
        (BY, BY | {"method": js.Filtered()}, r"method \(Ensemble there, Filtered here\)"),
        (
            BY | {"method": js.OverSeas(TABLE, FOUR)},
            BY | {"method": js.OverSeas(OTHER_TABLE, FOUR)},
            r"method.table.Hs \(\[0.04\] there, \[0.03\] here\)",
        ),
    ],
)
def test_a_search_goes_on_with_its_own_result_and_method_only(first, second, named, tmp_path, quick):
    ran, _ = quick
    out = tmp_path / "o.h5"
    js.maximise(SEA, BOUNDS, out, evaluations=1, progress=False, **first)
    before, count = out.read_bytes(), len(ran)
    js.maximise(SEA, BOUNDS, out, evaluations=1, progress=False, **first)
    with pytest.raises(FileError, match=f"nothing was changed.*{named}"):
        js.maximise(SEA, BOUNDS, out, evaluations=1, progress=False, **second)
    assert out.read_bytes() == before and len(ran) == count
    # the number of workers and the files do not affect the results
    method = first["method"]
    if isinstance(method, js.Ensemble):
        js.maximise(SEA, BOUNDS, out, "P_owc", js.Ensemble(members=4, workers=2), evaluations=1)


def test_a_sweep_does_not_take_the_file_of_a_search(tmp_path, quick):
    js.maximise(OWC, BOUNDS, tmp_path / "o.h5", evaluations=1, progress=False, method=FOUR)
    with pytest.raises(FileError, match=r"method \(Ensemble there, not given here\)"):
        js.sweep(OWC, {"pto.K_dm": [OWC.pto.K_dm]}, tmp_path / "o.h5", progress=False)


# --- two at once


@pytest.mark.parametrize("name", STUDIES)
def test_a_second_study_on_one_output_is_refused_while_the_first_runs(name, tmp_path, quick):
    study, (_, meanwhile), refused = STUDIES[name], quick, []

    def second():
        meanwhile.clear()
        with pytest.raises(FileError, match="another study .*is writing to it, and nothing was changed"):
            study.run(study.case, tmp_path / "s.h5")
        refused.append(name)

    meanwhile.append(second)
    study.run(study.case, tmp_path / "s.h5")
    assert refused and not list(tmp_path.glob(".*.lock"))


RUNS = """
import sys, time
import jaxsph as js
from jaxsph.study import members

def member(case, stem):
    open(sys.argv[2], "w").close()
    time.sleep(300)

members.run_member = member
case = js.load_case("hydrostatic").replace({"dx": 0.25, "t1": 0.1, "probes": {"gauges": [0.5]}})
js.sweep(case, {"g": [9.81]}, sys.argv[1], progress=False)
"""


def test_a_sweep_of_another_process_excludes_others_until_it_is_killed(tmp_path, quick):
    out, begun = tmp_path / "s.h5", tmp_path / "begun"
    with subprocess.Popen([sys.executable, "-c", RUNS, str(out), str(begun)]) as process:
        try:
            while not begun.exists():
                assert process.poll() is None
                time.sleep(0.05)
            with pytest.raises(FileError, match=rf"another study \(process {process.pid} on "):
                STUDIES["sweep"].run(STILL, out)
        finally:
            os.kill(process.pid, signal.SIGKILL)
    assert STUDIES["sweep"].run(STILL, out)["xi"] == pytest.approx(1.0)


# --- what makes no study


@pytest.mark.parametrize(
    "values",
    [["regular", "bichromatic"], [None, 1.0], [True, False], [[1.0], [1.0, 2.0]], [np.nan], [10**30]],
)
def test_a_sweep_over_what_is_no_number_is_refused(values, tmp_path, quick):
    with pytest.raises(CaseError, match="g = .*: must be a list of one or more finite numbers"):
        js.sweep(STILL, {"g": values}, tmp_path / "s.h5", progress=False)
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize(
    "options",
    [
        ["sweep", "owc", "--grid", "g=1:2:99999999999"],
        ["sweep", "owc", "--grid", "g=1:2:0"],
        ["sweep", "owc", "--grid", "g=1:2:-3"],
        ["sweep", "owc", "--grid", "g=nan:2:3"],
        ["sweep", "owc", "--grid", "g=1:inf:3"],
        ["sweep", "owc", "--grid", "g=1:2:1000", "--grid", "fluid.rho0=1:2:1000"],
        ["sweep", "owc", "--grid", "g=1,2", "--grid", "g=3"],
        ["slope", "owc", "--over", "pto.K_dm", "--members", "99999999999"],
        ["slope", "owc", "--over", "pto.K_dm", "--spread", "nan"],
        ["slope", "owc", "--over", "pto.K_dm", "--of", "nonsense"],
        ["optimise", "owc", "--over", "pto.K_dm=100:2500", "--evaluations", "0"],
        ["optimise", "owc", "--over", "pto.K_dm=100:2500", "--evaluations", "-1"],
        ["optimise", "owc", "--over", "pto.K_dm=100:inf"],
        ["optimise", "owc", "--over", "pto.K_dm=100:600", "--over", "pto.K_dm=100:2500"],
        ["matrix", "owc_irregular", "--hs", "0.04", "--tp", "1.4", "--seeds", "99999999999"],
        ["matrix", "owc_irregular", "--hs", "0.04:0.05:99999999999", "--tp", "1.4"],
        ["matrix", "owc_irregular", "--hs", "0.04", "--tp", "1.4", "--set", "pto="],
        ["matrix", "owc_irregular", "--hs", "0.04", "--tp", "1.4", "--set", "t1=3"],
    ],
)
def test_the_command_refuses_what_makes_no_study_before_anything_runs(options, tmp_path, quick, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, [*options, "--quiet"])
    assert done.exit_code == 2 and "jaxsph: error: " in done.output, done.output
    assert not quick[0] and not any(tmp_path.iterdir())


def test_a_matrix_in_a_tank_with_a_width_leaves_out_what_its_runs_do_not_have():
    """Such runs have a mean power, but no efficiency and no error."""
    axes = {"waves.Hs": np.array([0.04]), "waves.Tp": np.array([1.4]), "waves.seed": np.arange(2)}
    powers = np.array([[[1.0, 3.0]]])
    wide = js.load_case("flap_3d").replace({"waves": SEA.waves.model_dump(exclude_none=True), "t1": 60.0})
    matrix = matrix_of(js.Sweep(wide, axes, {"P_pto": powers, "P_inc": powers}, {}, {}))
    assert matrix.P[0, 0] == 2.0 and np.isnan(matrix.xi).all()
    assert matrix.error[0, 0] == 1.0  # error of the mean of 1 and 3
    one = {name: values[..., :1] for name, values in {"P_pto": powers, "P_inc": powers}.items()}
    alone = matrix_of(js.Sweep(wide, axes | {"waves.seed": np.arange(1)}, one, {}, {}))
    assert alone.P[0, 0] == 1.0 and np.isnan(alone.error[0, 0])  # unknown, not zero
    assert alone.annual(TABLE).value == 1.0


def test_an_ensemble_whose_members_lack_the_result_says_so(monkeypatch):
    def member(case, stem):
        return {"results": {"P_inc": 1.0}, "series": {"time": np.arange(3.0)}, "failure": ""}, Meanings()

    monkeypatch.setattr(members, "run_member", member)
    with pytest.raises(DerivativeError, match="only 0 of 4 members gave P_owc"):
        js.derivative(OWC, "pto.K_dm", "P_owc", FOUR, progress=False)
    with pytest.raises(CaseError, match="of = 'nonsense'"):
        FOUR.derivative(OWC, "pto.K_dm", "nonsense", False)


# --- damage


def test_a_damaged_file_of_a_sweep_gives_the_numbers_written_or_an_error(tmp_path):
    """One bit is flipped anywhere; bytes that HDF5 does not use may differ without harm."""
    path = tmp_path / "s.h5"
    t = 0.1 * np.arange(50)
    one = {"results": {"xi": 0.5, "P_owc": 1.5}, "series": {"time": t, "P_a": np.sin(t)}, "failure": ""}
    axes = {"pto.K_dm": np.array([100.0, 200.0])}
    described = {"P_a": Variable("Pa", "pressure"), "time": Variable("s", "time")}
    SweepFile(path).write(OWC.to_toml(), axes, (2,), {0: one, 1: one}, Meanings(described))
    whole, rng, refused = path.read_bytes(), np.random.default_rng(3), 0
    said = repr(js.read_sweep(path)) + repr(js.read_sweep(path).members)
    for _ in range(150):
        damaged = bytearray(whole)
        damaged[rng.integers(len(whole))] ^= 1 << rng.integers(8)
        path.write_bytes(damaged)
        try:
            found = js.read_sweep(path)
        except FileError:
            refused += 1
            continue
        assert repr(found) + repr(found.members) == said
    assert refused > 30
