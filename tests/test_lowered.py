"""Lowered steps of cases that the command line stores on disk."""

import functools

import jax
import numpy as np
import pytest
from conftest import coarse, compilations

import jaxsph as js
from jaxsph.problem.source import Source
from jaxsph.run import lowered, simulate
from jaxsph.run.chunks import with_settings

TANK = coarse("hydrostatic", {"output.snapshot_dt": 0.05})
run = functools.partial(js.run, TANK, t1=0.1, progress=False, devices=1)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty folder for lowered programs, which runs use."""
    monkeypatch.setattr(lowered, "program_folder", lambda: tmp_path)
    monkeypatch.setattr(lowered, "_kept", {})
    monkeypatch.setitem(lowered._switch, "on", True)
    return tmp_path


def _untraced(monkeypatch):
    """Makes every further tracing of a step fail, and forgets the stored programs in memory."""

    def traced(*_):
        raise AssertionError("the steps were traced again")

    lowered._kept.clear()
    monkeypatch.setattr(simulate, "_advance", traced)
    monkeypatch.setattr(simulate, "_on_one_device", traced)


def test_a_stored_program_gives_the_same_run_and_is_not_traced_again(folder, monkeypatch):
    stored = run()
    assert len(list(folder.iterdir())) == 1  # and no unfinished file
    with monkeypatch.context() as only_stored:
        _untraced(only_stored)
        again = run()
    monkeypatch.setitem(lowered._switch, "on", False)
    traced = run()
    for solution in (again, traced):
        for name, values in stored.series.items():
            np.testing.assert_array_equal(solution.series[name], values)
        for one, other in zip(jax.tree.leaves(stored.state), jax.tree.leaves(solution.state), strict=True):
            np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("stored", [False, True])
def test_a_program_is_compiled_once(folder, stored):
    """An estimate of the wall time would include a compilation that takes place after the first chunk."""
    model, state, probes = _started(TANK)
    if stored:
        _advance(TANK, model, state, probes)
        lowered._kept.clear()
    state, _ = _advance(TANK, model, state, probes)
    with compilations() as found:
        _advance(TANK, model, state, probes)
    assert not found


def test_a_damaged_program_is_made_again(folder):
    model, state, probes = _started(TANK)
    _advance(TANK, model, state, probes)
    (file,) = folder.iterdir()
    whole = file.read_bytes()
    for damaged in (b"", whole[: len(whole) // 2]):
        file.write_bytes(damaged)
        lowered._kept.clear()
        _advance(TANK, model, state, probes)
        # not equal to `whole`: the program also contains the lines of code from which it was called
        assert lowered._loaded(file.stem.removeprefix("steps-")) is not None


def test_a_program_that_cannot_be_stored_is_tried_once(folder, monkeypatch):
    """Later chunks of the run do not trace it again in vain."""
    tried = []

    def refused(*_, **__):
        tried.append(1)
        raise ValueError("no stable form")

    monkeypatch.setattr(lowered.export, "export", refused)
    model, state, probes = _started(TANK)
    for _ in range(2):
        _advance(TANK, model, state, probes)
    assert len(tried) == 1 and not list(folder.iterdir())


@pytest.mark.parametrize("change", ["code", "case", "tables"])
def test_a_program_belongs_to_one_version_case_and_size(folder, monkeypatch, change):
    """A change of what determines the steps makes another program."""
    case = TANK
    model, state, probes = _started(case)
    _advance(case, model, state, probes)
    if change == "code":
        monkeypatch.setattr(lowered, "_surroundings", lambda: "another version")
    elif change == "case":
        case = TANK.replace({"fluid.rho0": 1025.0})
    else:
        model = with_settings(model, {"capacity": 2 * model.search.capacity})
    _advance(case, model, state, probes)
    assert len(list(folder.iterdir())) == 2


def test_only_cases_of_the_command_line_have_stored_programs(folder, monkeypatch):
    assert lowered.key_of(TANK)
    problem = TANK.problem()
    assert lowered.key_of(js.Program(lambda: problem)) == ""
    monkeypatch.setitem(lowered._switch, "on", False)
    assert lowered.key_of(TANK) == ""
    assert isinstance(TANK, Source)


def _started(case):
    problem = case.problem()
    return problem.model, problem.state, problem.probes


def _advance(case, model, state, probes):
    every = model.search.rebuild_every
    return simulate.simulate_chunk(model, state, probes, every, every, every, lowered.key_of(case))
