"""Profile of a time step: its parts, their sum, the solver's iterations, and the command."""

import jax
import pytest
from conftest import coarse
from typer.testing import CliRunner

import jaxsph as js
from jaxsph.cli.app import app
from jaxsph.core.parts import Part
from jaxsph.run import profile as measured

CASE = coarse("owc", {"scheme": {"kind": "incompressible"}, "waves.ramp_periods": 0.0})


@pytest.fixture(scope="module")
def profile():
    """Profile of an incompressible OWC from a few steps, which is enough for all but exact shares."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(measured, "ENOUGH", 0.05)
        return js.profile(CASE)


@pytest.mark.slow
def test_the_file_of_a_run_is_profiled_from_its_last_checkpoint(tmp_path):
    path = tmp_path / "owc.h5"
    js.run(CASE, t1=0.4, out=path, progress=False)
    found = js.profile(path)
    assert found.parts[Part.SOLVER.value].iterations >= 0.5
    assert sum(share.seconds for share in found.parts.values()) == pytest.approx(found.step)


def test_the_parts_of_a_step_add_up_to_its_time(profile):
    assert sum(share.seconds for share in profile.parts.values()) == pytest.approx(profile.step)
    assert profile.particles > 0 and profile.devices == 1 and profile.recording > 0.0
    assert 0.2 * profile.step < profile.loops < profile.step
    assert profile.lowering > 0.0 and profile.compilation > 1.0 and profile.slowdown > 0.0


def test_every_part_of_an_incompressible_step_is_found(profile):
    found = {part for part in Part if part.value in profile.parts}
    assert found == set(Part) - {Part.MOMENTUM, Part.CONTINUITY, Part.BODIES}
    assert profile.parts[measured.REST].seconds < 0.15 * profile.step


def test_only_the_solver_and_the_air_iterate(profile):
    iterating = {name for name, share in profile.parts.items() if share.iterations}
    assert iterating <= {Part.SOLVER.value, Part.AIR.value}
    assert profile.parts[Part.SOLVER.value].iterations > 0.0


def test_operations_belong_to_their_scope_or_to_what_contains_them():
    program = """
  %loop.1 = f32[] while(...), metadata={op_name="jit(f)/pressure solver/while"}
  ROOT %add.2 = f32[] add(...), metadata={op_name="jit(f)/pressure solver/while/body/iteration/add"}
  %inner.3 = f32[] while(...), metadata={op_name="jit(f)/pressure solver/while/body/iteration/while"}
  %other.4 = f32[] add(...), metadata={op_name="jit(g)/probes/neighbour search/add"}
"""
    scopes = measured._scopes(program)
    operation = measured._Operation
    line = [
        operation("loop.1", 0.0, 100.0),
        operation("add.2", 10.0, 20.0),
        operation("add.2", 30.0, 40.0),
        operation("inner.3", 50.0, 80.0),
        operation("copy.9", 60.0, 70.0),  # not in the program: belongs to the loop
        operation("other.4", 110.0, 140.0),
        operation("copy.9", 150.0, 160.0),  # contained in nothing
    ]
    found = measured._shares([line], scopes, delay=2.0, step=1.0, steps=2)
    # four operations, contained in others, delay the solver by 2 each
    assert {name: share.seconds for name, share in found.items()} == pytest.approx(
        {"pressure solver": 92 / 132, "probes": 30 / 132, measured.REST: 10 / 132}
    )
    assert found["pressure solver"].iterations == 1.0 and found["probes"].iterations == 0.0


def test_interruptions_by_other_processes_count_little():
    scopes = {"loop.1": [], "add.2": [Part.VISCOSITY.value], "add.3": [Part.PROBES.value]}

    def line(interrupted):
        """A loop over two operations, of which some executions and some gaps last 1000 times longer."""
        now, found = 0.0, []
        for number in range(40):
            for name in ("add.2", "add.3"):
                now += 1000.0 if interrupted and number % 9 == 4 else 1.0
                took = 3000.0 if interrupted and number % 7 == 3 else 3.0
                found.append(measured._Operation(name, now, now + took))
                now += took
        return [measured._Operation("loop.1", 0.0, now), *found]

    quiet, loaded = (measured._shares([line(busy)], scopes, 0.5, 1.0, 40) for busy in (False, True))
    assert {name: share.seconds for name, share in loaded.items()} == pytest.approx(
        {name: share.seconds for name, share in quiet.items()}
    )
    assert quiet[measured.REST].seconds == pytest.approx(0.5 / 3.5)


def test_the_command_prints_the_parts(profile, monkeypatch):
    monkeypatch.setattr(js, "profile", lambda given, devices=None: profile, raising=False)
    result = CliRunner().invoke(app, ["profile", "owc"])
    assert result.exit_code == 0, result.output
    for name in profile.parts:
        assert name in result.output
    assert "particles on 1 device" in result.output and "iterations" in result.output


def test_a_file_has_its_own_case():
    result = CliRunner().invoke(app, ["profile", "run.h5", "--set", "dx=0.02"])
    assert result.exit_code == 2 and "omit --set and --quick" in " ".join(result.output.split())


def test_an_accelerator_is_refused(monkeypatch):
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    with pytest.raises(js.CaseError, match="on CPUs only; set JAX_PLATFORMS=cpu"):
        js.profile(CASE)
