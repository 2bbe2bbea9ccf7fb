"""User-defined parts, each in one file of at most 40 lines, run from the command line."""

import importlib
import os
import shutil
import subprocess
import sys
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from conftest import kill_with_two_checkpoints
from typer.testing import CliRunner

import jaxsph as js
from jaxsph.analysis.energy import energy_budget
from jaxsph.cli.app import app
from jaxsph.errors import CaseError
from jaxsph.output.run_file import RunFile

EXAMPLES = Path(js.__file__).parents[1] / "examples"
AS_HERE = os.environ | {"PYTHONPATH": str(EXAMPLES.parent)}
PARTS = {
    "own_pto:one_way": ("c", "energy_pto", 0.3),
    "own_shape:bob": ("density", "energy_hyperviscosity", 0.2),
    "own_solid:plunger": ("stroke", "energy_hyperviscosity", 0.2),
    "own_probe:steep": ("amplitude", "steepest", 0.2),
    "own_viscosity:thick": ("nu", "energy_hyperviscosity", 0.2),
    "own_wavemaker:hump": ("stroke", "energy_hyperviscosity", 0.2),
    "own_damper:screened": ("drag", "energy_hyperviscosity", 0.2),
    "own_force:shaken": ("amplitude", "energy_hyperviscosity", 0.2),
    "own_scheme:tait": ("c0", "squeezed", 0.1),
}
"""For each part: an argument, a result with a slope with respect to it, and the end of a short run, s."""


def _command(*arguments, code=0):
    done = CliRunner().invoke(app, [str(one) for one in arguments])
    assert done.exit_code == code, done.output
    return done.output


@pytest.mark.slow
@pytest.mark.parametrize("part", PARTS)
def test_a_part_is_run_killed_resumed_swept_and_differentiated(part, tmp_path):
    """Its file is copied to a user's folder; the resumed run equals the whole run bit for bit."""
    key, of, t1 = PARTS[part]
    name, function = part.split(":")
    own = shutil.copy(EXAMPLES / f"{name}.py", tmp_path)
    assert len(Path(own).read_text(encoding="utf-8").splitlines()) <= 40
    program = f"{own}:{function}"
    whole, killed, sweep = (tmp_path / file for file in ("whole.h5", "killed.h5", "sweep.h5"))

    _command("run", program, "--set", f"t1={t1}", "--out", whole, "--no-plot", "--quiet")
    page = whole.with_suffix(".html").read_text(encoding="utf-8")
    assert page.startswith("<!doctype html>") and len(page) > 100_000

    command = [sys.executable, "-m", "jaxsph", "run", program, "--set", "t1=30", "--out", str(killed)]
    process = subprocess.Popen([*command, "--quiet", "--no-report", "--no-plot"], env=AS_HERE)
    kill_with_two_checkpoints(process, killed)
    done = RunFile.open(killed)
    later = max(t1, round(done.snapshot_times()[-1] + 0.1, 2))
    _command("resume", killed, "--program", program, "--t1", later, "--quiet", "--no-report", "--no-plot")
    series = RunFile.open(killed).series()
    for reading, values in RunFile.open(whole).series().items():
        np.testing.assert_array_equal(series[reading][: len(values)], values, err_msg=reading)

    value = js.Program.load(program).arguments[key]
    grid = f"{key}={value},{1.1 * value:g}"
    _command("sweep", program, "--grid", grid, "--set", f"t1={t1}", "--out", sweep, "--workers", 1)
    found = js.read_sweep(sweep)
    assert not found.failures and sweep.with_suffix(".html").exists()

    told = ("--over", key, "--of", of, "--set", f"t1={t1}", "--members", 5)
    assert "recorded in" in _command("slope", program, *told, "--out", tmp_path / "slope.h5")


def _sloshing(t, x, amplitude, omega, length, depth):
    """Elevation (m) at x (m) in a tank that is shaken from rest by amplitude sin(omega t) (m/s2).

    Linear theory of inviscid water: the sum of the odd modes, oscillators driven by their share of the force.
    """
    eta = np.zeros_like(t)
    for n in range(1, 41, 2):
        k = n * np.pi / length
        pull, own = (
            4.0 * amplitude * np.tanh(k * depth) / (length * k),
            np.sqrt(9.81 * k * np.tanh(k * depth)),
        )
        swing = np.sin(omega * t) - omega / own * np.sin(own * t)
        eta += pull / (own**2 - omega**2) * swing * np.cos(k * x)
    return eta


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["incompressible", "weakly_compressible"])
def test_water_in_a_shaken_tank_sloshes_as_in_linear_theory(kind, monkeypatch):
    """To 12 % (RMS) for waves of up to one and a half spacings, whose steepness the theory neglects.

    The waves are 4 % off with a third of the force and half the spacing, and 6 % with one of these changes.
    The energy from the force is in the water, to 1e-4 of the kinetic energy, or to 1 % with sound.
    """
    monkeypatch.syspath_prepend(EXAMPLES)
    shaken = importlib.import_module("own_force").shaken
    problem = shaken(dx=0.025, t1=4.0)
    if kind == "weakly_compressible":
        case = js.load_case("hydrostatic").replace({"dx": 0.025, "probes.gauges": [0.1]})
        problem = case.problem().with_parts(forces=problem.model.forces)
    series = js.march(problem.model, problem.state, 4.0, problem.sample_dt, problem.probes).series
    expected = _sloshing(series["time"], 0.1, 0.3, 4.0, 1.0, 1.0)
    assert np.linalg.norm(series["eta"][:, 0] - expected) < 0.12 * np.linalg.norm(expected)
    budget = energy_budget(series)
    assert np.max(series["kinetic"]) > 1.0
    assert abs(budget["residual_share"]) < (1e-4 if kind == "incompressible" else 1e-2)


@pytest.fixture(scope="module")
def tank():
    """A coarse tank at rest as a problem."""
    return js.load_case("hydrostatic").replace({"dx": 0.1, "scheme.kind": "incompressible"}).problem()


def test_parts_of_a_problem_are_changed_whole(tank):
    """Ledger, state and probes belong to the new parts, and the case's own probes stay."""
    sponge = js.Sponge((js.SpongeLayer(0.5, 1.0),), 5.0)
    changed = tank.with_parts(dampers=[sponge], t1=0.25)
    assert changed.model.dampers == (sponge,) and not tank.model.dampers
    assert "sponge" in changed.state.ledger and "sponge" not in tank.state.ledger
    assert "power_sponge" in changed.units and "power_sponge" not in tank.units
    assert set(tank.units) <= set(changed.units)
    assert (changed.t1, tank.t1) != (tank.t1, changed.t1) and changed.name == tank.name


def test_parts_that_do_not_fit_are_refused(tank):
    """Because of an unknown name, a name that two parts share, or a time step that is too long."""
    sponge = js.Sponge((js.SpongeLayer(0.5, 1.0),), 5.0)
    with pytest.raises(CaseError, match="damper is not a field of the model: use one of scheme, walls"):
        tank.with_parts(damper=[sponge])
    with pytest.raises(CaseError, match=r"parts have the same name \(sponge\)"):
        tank.with_parts(dampers=[sponge, sponge])
    with pytest.raises(CaseError, match="the scheme is stable with time steps up to .* shorter time steps"):
        tank.with_parts(scheme=js.DeltaSPH.of(0.1, 100.0))
    pull, ball = (
        js.CentralForce(jnp.float32(1.0), jnp.zeros(2)),
        js.load_case("flap_2d").replace({"dx": 0.08}),
    )
    with pytest.raises(CaseError, match="body forces act only on the water, but body can move"):
        ball.problem().with_parts(forces=[pull])
    with pytest.raises(CaseError, match=r"t1 = -1.0 s: must be a positive, finite time"):
        tank.with_parts(t1=-1.0)
