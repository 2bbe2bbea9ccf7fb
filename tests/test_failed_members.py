"""Members that fail: the reason that is given, and what studies print and write without them."""

import os
import sys

import numpy as np
import pytest
from typer.testing import CliRunner

import jaxsph as js
from jaxsph.cli import studies
from jaxsph.cli.app import app
from jaxsph.output.sweep_file import Meanings, SweepFile
from jaxsph.report.pack import Pack
from jaxsph.report.sweeps import sweep_content
from jaxsph.run.chunks import REPLAYED
from jaxsph.study import members
from jaxsph.study.failures import failure_of
from jaxsph.study.matrix import matrix_of

OWC = js.load_case("owc")
SEA = OWC.replace({"waves": {"kind": "irregular", "Hs": 0.04, "Tp": 1.4}})
REPLAY = f"{REPLAYED}: rebuild_every = 1"
ABORTED = """WARNING: All log messages before the log is opened are written to the error stream
F0000 00:00:1700000000.000001   12 symbolic_map.cc:196] Check failed: a == b (1 vs. 2)
*** Check failure stack trace: ***
    @     0x7f0000000000  (unknown)
"""
RAISED = """Traceback (most recent call last):
  File "mine.py", line 1, in <module>
    mine()
ValueError: damping = -1
must not be negative
--------------------
For simplicity, JAX has removed its internal frames from the traceback of the following exception.
"""

# --- processes of members


class Held:
    """A claim that always holds."""

    def holds(self):
        return True


@pytest.mark.parametrize("given", [None, "--xla_cpu_enable_fast_math=false"])
def test_members_are_compiled_with_the_flags_of_the_user_and_no_others(tmp_path, monkeypatch, given):
    """Other flags made the compiler abort when a member's program was compiled again during the run."""
    monkeypatch.delenv("XLA_FLAGS", raising=False)
    if given is not None:
        monkeypatch.setenv("XLA_FLAGS", given)
    code = "import os; print(os.environ.get('XLA_FLAGS'))"
    assert members._run_process([sys.executable, "-c", code], tmp_path / "log", Held()) == 0
    assert (tmp_path / "log").read_text().strip() == str(given)


def test_commands_of_studies_set_no_compiler_flags(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("XLA_FLAGS", raising=False)
    for command in (
        ("sweep", "owc", "--grid", "waves.heading=1"),
        ("matrix", "owc", "--hs", "0.02", "--tp", "1.2"),
        ("optimise", "owc", "--over", "pto.Kdm=100:200"),
        ("coefficients", "owc", "--period", "1.2"),
    ):
        assert CliRunner().invoke(app, command).exit_code == 2
        assert "XLA_FLAGS" not in os.environ, command


@pytest.mark.parametrize(
    ("messages", "status", "first"),
    [
        (f"{REPLAY}\njaxsph: error: case 'a' stopped\nWhat to change: dx.\n", 1, "case 'a' stopped"),
        (f" 9%|# | 9/99\r{REPLAY}jaxsph: error: no such key\n", 2, "no such key"),
        (f"{REPLAY}\n", -6, "the process was killed by SIGABRT (exit status -6)"),
        (
            f"note: coarse\n{REPLAY}\n{ABORTED}",
            -6,
            "(exit status -6): F0000 00:00:1700000000.0",
        ),
        (f"{REPLAY}\n{RAISED}", 1, "the process ended with exit status 1: ValueError: damping = -1"),
        (f"out of paper\n{REPLAY}\n12step [00:01, 9step/s]\n", 3, "with exit status 3: out of paper"),
        ("", -9, "killed by SIGKILL (exit status -9), for example because the memory was full"),
        ("", -999, "killed by signal 999"),
    ],
)
def test_reason_is_the_error_and_not_a_notice(messages, status, first):
    told = failure_of(messages, status).splitlines()
    assert first in told[0] and REPLAYED not in told[0]
    assert told[0].count("\r") == 0 and "jaxsph: error" not in told[0]


def test_reason_comes_first_and_the_messages_follow():
    assert failure_of(f"{REPLAY}\njaxsph: error: stopped\nWhat to change: dx.\n", 1) == (
        "stopped\nWhat to change: dx."
    )
    told = failure_of(f"{REPLAY}\n{RAISED}", 1)
    assert REPLAY in told and "must not be negative" in told and 'File "mine.py"' in told
    assert failure_of("out of paper\n", 3) == "the process ended with exit status 3: out of paper"


@pytest.mark.skipif(sys.platform == "win32", reason="processes are not ended by signals")
def test_a_member_whose_process_aborts_says_so(tmp_path, monkeypatch):
    code = f"import os; print({REPLAY!r}, flush=True); os.abort()"
    run_process = members._run_process

    def aborts(command, log, claim):
        return run_process([sys.executable, "-c", code], log, claim)

    monkeypatch.setattr(members, "_run_process", aborts)
    found, _ = members.run_member(OWC, tmp_path / "0000")
    assert found["failure"].splitlines()[0] == "the process was killed by SIGABRT (exit status -6)"


# --- power matrices


def a_sweep(results, failures):
    """A sweep over two heights, two periods and a seed, without runs."""
    axes = {"waves.Hs": np.array([0.02, 0.04]), "waves.Tp": np.array([1.2, 1.4]), "waves.seed": np.arange(1)}
    every = {(i, j, 0): {} for i in range(2) for j in range(2)}
    return js.Sweep(SEA, axes, results, failures, every)


@pytest.fixture
def a_matrix(monkeypatch):
    """A matrix without linear theory: of its runs with Hs = 0.04 m, that with Tp = 1.2 s failed, and that
    with Tp = 1.4 s has no power."""
    monkeypatch.setattr("jaxsph.study.matrix.sea_is_linear", lambda _: False)
    powers = np.array([[1.0, 2.0], [np.nan, np.nan]])[..., None]
    known = {"P_owc": powers, "P_inc": powers, "xi": powers, "xi_error": powers}
    return matrix_of(a_sweep(known, {(1, 0, 0): "stopped: too fast\nand why"}))


def test_a_mean_over_a_table_names_the_sea_states_without_power(a_matrix, monkeypatch):
    table = js.ScatterTable(np.array([0.02, 0.04, 0.03]), np.array([1.2, 1.2, 1.4]), np.full(3, 1 / 3))
    named = "it has none at Hs = 0.04 m, Tp = 1.2 s; Hs = 0.04 m, Tp = 1.4 s: run the matrix again"
    with pytest.raises(js.CaseError, match=named):
        a_matrix.annual(table)
    monkeypatch.setattr("jaxsph.study.matrix.MOST_NAMED", 1)
    with pytest.raises(js.CaseError, match="none at Hs = 0.04 m, Tp = 1.2 s; 1 more: run"):
        a_matrix.annual(table)


def test_a_matrix_without_powers_says_why_the_first_run_failed():
    failures = {(1, 0, 0): "too slow", (0, 1, 0): "too fast\nand why"}
    words = r"2 of 4 runs failed, first the one with Hs = 0.02 m, Tp = 1.4 s and seed = 0: too fast$"
    with pytest.raises(js.CaseError, match=f"no run gave an absorbed power: .*; {words}"):
        matrix_of(a_sweep({}, failures))
    with pytest.raises(js.CaseError, match="and that t1 is long enough$"):
        matrix_of(a_sweep({}, {}))


def test_the_command_prints_and_draws_a_matrix_before_it_refuses_the_mean(a_matrix, tmp_path, monkeypatch):
    pages = []
    monkeypatch.setattr(js, "power_matrix", lambda *_, **__: a_matrix, raising=False)
    monkeypatch.setattr("jaxsph.cli.matrix.announce", lambda *_: None)
    monkeypatch.setattr("jaxsph.cli.matrix.note_members", lambda *_: None)
    monkeypatch.setattr("jaxsph.cli.matrix.write_page", lambda *given: pages.append(given))
    (tmp_path / "sea.toml").write_text(SEA.to_toml())
    (tmp_path / "table.csv").write_text("Hs,Tp,share\n0.04,1.2,1\n")
    arguments = ["matrix", str(tmp_path / "sea.toml"), "--hs", "0.02,0.04", "--tp", "1.2,1.4"]
    arguments += ["--table", str(tmp_path / "table.csv"), "--out", str(tmp_path / "m.h5")]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 2, done.output
    lines = dict(line.split("  ", 1) for line in done.stdout.splitlines() if line.startswith("Hs"))
    assert lines["Hs = 0.02 m, Tp = 1.4 s"].startswith("2 +- ")
    assert lines["Hs = 0.04 m, Tp = 1.4 s"] == "no mean power"
    assert "mean over" not in done.stdout and "nan" not in done.stdout
    assert pages and (tmp_path / "m_plots" / "matrix.png").exists()
    failed, error = done.stderr.splitlines()[-2:]
    assert failed == "failed: waves.Hs = 0.04, waves.Tp = 1.2, waves.seed = 0: stopped: too fast"
    assert error.startswith("jaxsph: error: the matrix has no mean power for some sea states")
    assert "none at Hs = 0.04 m, Tp = 1.2 s:" in error


# --- slopes


def test_a_slope_says_from_how_many_runs_it_is(tmp_path, monkeypatch):
    """Of six runs the first fails, and the fifth has no efficiency."""

    def member(case, stem):
        k = round((case.pto.K_dm - 350.0) / 60.0)
        results = {} if k in (0, 4) else {"xi": 1e-3 * case.pto.K_dm}
        failure = "too fast\nand why" if k == 0 else ""
        return {"results": results, "series": {}, "failure": failure}, Meanings()

    monkeypatch.chdir(tmp_path)
    (tmp_path / "runs").mkdir()
    monkeypatch.setattr(members, "run_member", member)
    found, derivative = [], js.derivative

    def kept(*given, **options):
        found.append(derivative(*given, **options))
        return found[0]

    monkeypatch.setattr(js, "derivative", kept, raising=False)
    settings = ["--set", "pto.K_dm=500", "--members", "6", "--quiet"]
    done = CliRunner().invoke(app, ["slope", "owc", "--over", "pto.K_dm", *settings])
    assert done.exit_code == 0, done.output
    line = next(line for line in done.stdout.splitlines() if line.startswith("d xi"))
    assert line.endswith(" (4 of 6 runs; member 0 failed: too fast; member 4 gave no xi)")
    assert found[0].failures == {0: "too fast\nand why"}


# --- pages and plans


@pytest.mark.parametrize(
    ("failed", "count", "words"),
    [
        ((), 4, "4 members that have ended"),
        ((1,), 2, "1 member that has ended, 1 that has failed"),
        ((0, 1), 2, "0 members that have ended, 2 that have failed"),
    ],
)
def test_a_page_counts_failed_members_separately(tmp_path, failed, count, words):
    ended = {k: {"results": {"xi": 0.1}, "series": {}, "failure": ""} for k in range(count)}
    ended |= {k: {"results": {}, "series": {}, "failure": "too fast"} for k in failed}
    file = SweepFile(tmp_path / "s.h5")
    axes = {"pto.K_dm": 100.0 * np.arange(1, count + 2)}
    file.write(OWC.to_toml(), axes, (count + 1,), ended, Meanings())
    content = sweep_content(file, Pack())
    assert content["counted"] == words
    assert content["warnings"][0] == f"1 of {count + 1} members has not ended yet."


@pytest.mark.parametrize(
    ("runs", "scheduler", "words"),
    [
        (1, None, "1 run of about 12 s: about 22 s"),
        (2, None, "2 runs of about 12 s each, 2 at a time: about 22 s"),
        (1, "tcp://host:1", "1 run"),
        (3, "tcp://host:1", "3 runs"),
    ],
)
def test_a_plan_of_one_run_is_in_the_singular(tmp_path, monkeypatch, capsys, runs, scheduler, words):
    monkeypatch.setattr(js, "duration", lambda *_, **__: js.Duration(10.0, 0.01, 1200, 1), raising=False)
    studies.announce(OWC, tmp_path / "s.h5", runs, 2, scheduler)
    assert capsys.readouterr().err == f"{words}\n"
