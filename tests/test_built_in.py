"""Built-in cases, from the command line: run, killed, resumed, swept; each page is written."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import kill_with_two_checkpoints
from mutations import SMALL
from typer.testing import CliRunner

import jaxsph as js
from jaxsph.cli.app import app
from jaxsph.output.run_file import RunFile

AS_HERE = os.environ | {"PYTHONPATH": str(Path(js.__file__).parents[1])}
NAMES = (
    "basin",
    "beach",
    "box_in_waves",
    "box_moored",
    "breakwater",
    "buoy_3d",
    "buoy_heave",
    "flap_floating",
    "hull",
    "owc_3d",
    "owc_floating",
    "owc_ning",
    "owc_slope",
    "owc_spar",
    "owc_two_chambers",
    "raft",
    "section_fixed",
)


def _command(*arguments):
    done = CliRunner().invoke(app, [str(one) for one in arguments])
    assert done.exit_code == 0, done.output
    return done.output


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_a_built_in_case_is_run_killed_resumed_and_swept(name, tmp_path):
    """Coarse, from a case file: the resumed run equals the whole run bit for bit; the sweep has its page."""
    case = js.load_case(name).replace({**SMALL[name], "output.snapshot_dt": 0.1, "t1": 30.0})
    toml, whole, killed, sweep = (tmp_path / file for file in ("case.toml", "whole.h5", "killed.h5", "s.h5"))
    toml.write_text(case.to_toml(), encoding="utf-8")
    quiet = ("--quiet", "--no-plot")
    _command("run", toml, "--t1", 0.3, "--out", whole, *quiet)
    page = whole.with_suffix(".html").read_text(encoding="utf-8")
    assert page.startswith("<!doctype html>") and len(page) > 100_000

    command = [sys.executable, "-m", "jaxsph", "run", str(toml), "--out", str(killed), "--no-report", *quiet]
    kill_with_two_checkpoints(subprocess.Popen(command, env=AS_HERE), killed)
    later = max(0.3, round(float(RunFile.open(killed).series()["time"][-1]) + 0.1, 2))
    _command("resume", killed, "--t1", later, "--no-report", *quiet)
    series = RunFile.open(killed).series()
    for reading, values in RunFile.open(whole).series().items():
        np.testing.assert_array_equal(series[reading][: len(values)], values, err_msg=reading)

    key = "body.density" if case.waves is None else "waves.H"
    value = case.body.density if case.waves is None else case.waves.H
    grid = f"{key}={value:g},{1.1 * value:g}"
    _command("sweep", toml, "--grid", grid, "--set", "t1=0.3", "--out", sweep, "--workers", 1)
    assert not js.read_sweep(sweep).failures and sweep.with_suffix(".html").exists()
