"""Sweeps: members in separate processes, separate failures, files that continue and that others can read."""

import os
import subprocess
import sys
import threading
import time
from concurrent.futures import Future

import equinox as eqx
import numpy as np
import pytest
import xarray as xr

import jaxsph as js
from jaxsph.case.build import build
from jaxsph.errors import CaseError, FileError
from jaxsph.output.hdf5 import Variable
from jaxsph.output.run_file import RunFile
from jaxsph.output.sweep_file import Meanings
from jaxsph.run.together import run_together
from jaxsph.study import members
from jaxsph.study.members import run_member

CASE = js.load_case("hydrostatic").replace({"dx": 0.25, "t1": 0.1, "probes": {"gauges": [0.5]}})


@pytest.fixture
def quick(monkeypatch):
    """Stand-ins for members; returns the list of cases run, and the set of values of g that fail."""
    ran, failing = [], set()

    def member(case, stem):
        ran.append(case)
        t = np.arange(0.0, case.t1 - 1e-9, 0.01)
        series = {"time": t, "eta": np.full((len(t), 2), case.g / 3), "kinetic": t * case.dx}
        failure = "stopped: too fast\nand why" if case.g in failing else ""
        results = {} if failure else {"value": case.g * 10 + case.dx, "t_end": case.t1}
        variables = {"eta": Variable("m", "elevation", "gauge"), "kinetic": Variable("J m-1", "energy")}
        return {"results": results, "series": series, "failure": failure}, Meanings(variables)

    monkeypatch.setattr(members, "run_member", member)
    return ran, failing


def test_members_are_processes_of_their_own(tmp_path):
    """Two real members, one of which must fail."""
    done = js.sweep(CASE, {"fluid.c0": [31.0, 0.5]}, tmp_path / "s.h5", workers=1, progress=False)
    assert list(done.failures) == [(1,)] and "faster than a third of the speed of sound" in done.failures[1,]
    assert done["t_end"][0] == pytest.approx(CASE.t1, rel=1e-6) and np.isnan(done["t_end"][1])
    assert done.members[0,]["time"] == pytest.approx(0.01 * np.arange(10), abs=1e-12)
    assert not (tmp_path / "s.h5.members").exists()


def test_a_batch_is_the_single_runs_and_one_that_fails_does_not_spoil_it(tmp_path, monkeypatch):
    """Three members in one vmapped call; the water of the last one is thrown out of the tank."""

    def thrown(case, settings=None):
        model, state = build(case, settings)
        if case.scheme.delta == 0.2:
            state = eqx.tree_at(lambda s: s.particles.u, state, state.particles.u + 100.0)
        return model, state

    monkeypatch.setattr("jaxsph.case.case.build", thrown)
    over = {"scheme.delta": [0.1, 0.05, 0.2]}
    done = js.sweep(CASE, over, tmp_path / "s.h5", batch=4, progress=False)
    assert list(done.failures) == [(2,)] and "stopped at t = " in done.failures[2,]
    assert done["t_end"][:2] == pytest.approx([CASE.t1] * 2, rel=1e-6) and np.isnan(done["t_end"][2])
    alone = js.run(CASE.replace({"scheme.delta": 0.05}), progress=False)
    for name, series in alone.series.items():
        # float32 sums in another order, over 20 steps; energies are about a thousand joules
        assert np.allclose(done.members[1,][name], series, rtol=2e-5, atol=1e-4), name
    assert not np.allclose(done.members[0,]["loss_diffusive"], alone["loss_diffusive"], rtol=0.01)


@pytest.mark.slow
def test_a_batch_goes_on_where_its_members_were(tmp_path):
    """A member that is a chunk ahead waits for the other; members that have ended are only read."""
    cases = [CASE.replace({"scheme.delta": a, "output.snapshot_dt": 0.05}) for a in (0.1, 0.05)]
    outs = [tmp_path / f"{k}.h5" for k in range(2)]
    whole = run_together(cases, [tmp_path / f"whole_{k}.h5" for k in range(2)], progress=False)
    js.run(cases[0], t1=0.05, out=outs[0], progress=False)
    again = run_together(cases, outs, progress=False)
    for one, other in zip(whole, again, strict=True):
        for name, series in one.series.items():
            assert np.allclose(other[name], series, rtol=2e-5, atol=1e-4), name
    ended = run_together(cases, outs, progress=False)
    assert np.array_equal(ended[1]["kinetic"], again[1]["kinetic"])


def test_a_batch_takes_no_workers(tmp_path):
    with pytest.raises(CaseError, match="batch = 0: must be 1 or more"):
        js.sweep(CASE, {"g": [1.0]}, tmp_path / "s.h5", batch=0)
    with pytest.raises(CaseError, match="batch = 2 and workers = 2: give only one of"):
        js.sweep(CASE, {"g": [1.0]}, tmp_path / "s.h5", batch=2, workers=2)
    with pytest.raises(CaseError, match="workers = 0: must be 1 or more"):
        js.sweep(CASE, {"g": [1.0]}, tmp_path / "s.h5", workers=0)


@pytest.mark.slow
def test_a_member_is_the_single_run(tmp_path):
    done = js.sweep(CASE, {"fluid.c0": [31.0]}, tmp_path / "s.h5", progress=False)
    alone = js.run(CASE.replace({"fluid.c0": 31.0}), progress=False)
    for name in ("potential", "kinetic"):
        # float32 sums of about a thousand joules, in another order
        assert np.allclose(done.members[0,][name], alone[name], atol=1e-3)


def test_grid_and_list(tmp_path, quick):
    over = {"g": [1.0, 2.0, 3.0], "dx": [0.25, 0.125]}
    done = js.sweep(CASE, over, tmp_path / "grid.h5", progress=False)
    expected = np.array([[10 * g + dx for dx in over["dx"]] for g in over["g"]])
    assert np.array_equal(done["value"], expected) and not done.failures
    pairs = js.sweep(
        CASE, {"g": [1.0, 2.0], "dx": [0.25, 0.125]}, tmp_path / "list.h5", grid=False, progress=False
    )
    assert np.array_equal(pairs["value"], [10.25, 20.125])


def test_a_sweep_goes_on_where_it_was_and_tries_failed_members_again(tmp_path, quick):
    ran, failing = quick
    over, out = {"g": [1.0, 2.0, 3.0]}, tmp_path / "s.h5"
    failing.add(2.0)
    first = js.sweep(CASE, over, out, progress=False)
    assert list(first.failures) == [(1,)] and np.isnan(first["value"][1])
    failing.clear()
    ran.clear()
    second = js.sweep(CASE, over, out, progress=False)
    assert [case.g for case in ran] == [2.0] and not second.failures
    assert np.array_equal(second["value"], [10.25, 20.25, 30.25])
    assert np.array_equal(second.members[0,]["eta"], first.members[0,]["eta"])


def test_file_is_read_by_others_and_by_us(tmp_path, quick):
    out = tmp_path / "s.h5"
    done = js.sweep(CASE, {"g": [1.0, 2.0], "t1": [0.05, 0.1]}, out, progress=False)
    with xr.open_dataset(out, engine="h5netcdf") as data:
        assert data["value"].dims == ("g", "t1") and float(data["value"].sel(g=2.0, t1=0.1)) == 20.25
    with xr.open_dataset(out, engine="h5netcdf", group="series") as data:
        assert data["eta"].dims == ("g", "t1", "time", "gauge") and data["eta"].attrs["units"] == "m"
        short = data["kinetic"].sel(g=1.0, t1=0.05).values
        assert np.isfinite(short[:5]).all() and np.isnan(short[5:]).all()  # padded
    again = js.read_sweep(out)
    assert again.case == CASE and list(again.axes) == ["g", "t1"]
    assert np.array_equal(again["value"], done["value"])
    for place, series in done.members.items():
        assert np.allclose(again.members[place]["time"], series["time"])
        # float64, as in the members
        assert again.members[place]["eta"].dtype == again.members[place]["time"].dtype == np.float64
        assert np.array_equal(again.members[place]["eta"], series["eta"])


def test_bad_sweeps_are_refused_before_anything_runs(tmp_path, quick):
    ran, _ = quick
    out = tmp_path / "s.h5"
    with pytest.raises(CaseError, match=r"dx = -1.0: must be positive"):
        js.sweep(CASE, {"dx": [0.25, -1.0]}, out, progress=False)
    with pytest.raises(CaseError, match="lists of equal length"):
        js.sweep(CASE, {"g": [1.0], "dx": [0.25, 0.125]}, out, grid=False, progress=False)
    with pytest.raises(CaseError, match="at least one parameter"):
        js.sweep(CASE, {}, out, progress=False)
    rounded = "device.draught = 0.15 and 0.16: the lattice rounds both to 0.16 m"
    with pytest.raises(CaseError, match=rounded):
        coarse = js.load_case("owc").replace({"dx": 0.04, "device.wall_thickness": 0.04})
        js.sweep(coarse, {"device.draught": [0.15, 0.2, 0.16]}, out, progress=False)
    assert not ran
    js.sweep(CASE, {"g": [1.0]}, out, progress=False)
    with pytest.raises(FileError, match="contains the runs of another study"):
        js.sweep(CASE, {"g": [2.0]}, out, progress=False)
    with pytest.raises(KeyError, match="no result 'xi'; use one of t_end, value"):
        js.read_sweep(out)["xi"]


def test_a_member_that_had_ended_before_the_sweep_was_stopped_is_only_read(tmp_path):
    stem = tmp_path / "0000"
    run = RunFile.create(stem.with_suffix(".h5"), CASE.to_toml(), {}, {})
    series = {"time": np.arange(3.0), "kinetic": np.ones(3)}
    kinetic = {"kinetic": Variable("J m-1", "energy", group="energy")}
    run.append(series, kinetic, None, {"x": np.zeros(2)}, {})
    run.finish({"t_end": 0.1})
    found, variables = run_member(CASE, stem)
    assert not stem.with_suffix(".log").exists()  # no process was started
    assert found["failure"] == "" and found["results"] == {"t_end": 0.1}
    assert (
        variables.variables["kinetic"] == kinetic["kinetic"] and list(found["series"]["kinetic"]) == [1.0] * 3
    )


class Alternating:
    """An executor from outside the standard library, which runs jobs at once and loses every second one."""

    def __init__(self):
        self.jobs = 0

    def submit(self, function, *arguments):
        self.jobs += 1
        job = Future()
        if self.jobs % 2 == 0:
            job.set_exception(ConnectionError("the worker was lost"))
        else:
            job.set_result(function(*arguments))
        return job


def test_any_executor_runs_members_and_one_that_it_loses_is_a_failure(tmp_path, quick):
    out = tmp_path / "s.h5"
    done = js.sweep(CASE, {"g": [1.0, 2.0, 3.0]}, out, executor=Alternating(), progress=False)
    assert done.failures == {(1,): "ConnectionError: the worker was lost"}
    assert np.array_equal(done["value"], [10.25, np.nan, 30.25], equal_nan=True)
    again = js.sweep(CASE, {"g": [1.0, 2.0, 3.0]}, out, executor=Alternating(), progress=False)
    assert np.array_equal(again["value"], [10.25, 20.25, 30.25]) and not again.failures
    with pytest.raises(CaseError, match="workers = 2 and executor = .*: give only one of"):
        js.sweep(CASE, {"g": [1.0]}, tmp_path / "t.h5", executor=Alternating(), workers=2)


def test_a_worker_that_does_not_see_the_folder_says_so(tmp_path):
    with pytest.raises(FileError, match="nowhere: the worker on .* cannot see this folder"):
        run_member(CASE, tmp_path / "nowhere" / "0000")


def test_a_worker_gives_up_a_member_that_another_has_claimed(tmp_path, monkeypatch):
    """The first worker ends its process before the second worker starts its own."""
    log, times, run_process = tmp_path / "0000.log", {}, members._run_process

    def asleep(command, log, claim):
        times.setdefault("begun", []).append(time.monotonic())
        code = "import time; time.sleep(60)" if len(times["begun"]) == 1 else "print(2)"
        status = run_process([sys.executable, "-c", code], log, claim)
        times.setdefault("ended", []).append(time.monotonic())
        return status

    monkeypatch.setattr(members, "_run_process", asleep)
    lost = []

    def first():
        with pytest.raises(FileError, match="was abandoned") as raised:
            run_member(CASE, tmp_path / "0000")
        lost.append(raised)

    thread = threading.Thread(target=first)
    thread.start()
    while "begun" not in times:
        time.sleep(0.01)
    found, _ = run_member(CASE, tmp_path / "0000")
    thread.join(timeout=10)
    assert lost and times["ended"][0] < times["begun"][1] and found["failure"] == ""
    assert log.read_text() == "2\n" and not list(tmp_path.glob("*.owner"))


def test_a_member_s_process_ends_with_the_one_that_started_it():
    code = "from jaxsph.run import interrupt; interrupt.end_with_parent(); import time; time.sleep(60)"
    environment = os.environ | {"JAXSPH_ATTACHED": "1"}
    child = subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, env=environment)
    with pytest.raises(subprocess.TimeoutExpired):
        child.wait(1.0)
    child.stdin.close()  # as the system does when the parent is killed
    assert child.wait(30) == 130
