"""Checks of types, of array shapes at run time, and of the promotion of precisions."""

import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def _succeeds(*command, **environment):
    done = subprocess.run(
        command, cwd=ROOT, env=os.environ | environment, capture_output=True, text=True, timeout=1200
    )
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]


def test_nine_tenths_of_the_lines_are_checked():
    """`pyright` itself takes a minute, too long for this lane; it runs in `.ci/run` and before a commit."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["pyright"]

    def lines(path):
        return len(path.read_text(encoding="utf-8").splitlines())

    ignored = [ROOT / name for name in settings["ignore"]]
    assert settings["include"] == ["jaxsph"] and all(path.is_file() for path in ignored)
    assert sum(map(lines, ignored)) <= 0.1 * sum(map(lines, (ROOT / "jaxsph").rglob("*.py")))


@pytest.mark.slow
def test_types_pass_pyright():
    """In basic mode; pyproject.toml names the files that are not checked yet."""
    assert (ROOT / "jaxsph" / "py.typed").exists()
    _succeeds(sys.executable, "-m", "pyright", "--pythonpath", sys.executable)


STEPS = """
import sys
sys.path.insert(0, "tests")
if "checked" in sys.argv:
    from jaxtyping import install_import_hook
    rooms = ("core", "model", "waves", "solids", "parts", "schemes", "probes")
    install_import_hook([f"jaxsph.{room}" for room in rooms], "beartype.beartype")
import jaxsph as js
import jax
from conftest import coarse
tank = {"dx": 0.1, "tank.length": 1.6, "sponge": {"length": 0.4}, "probes": {"gauges": [0.4, 0.8]}}
flap = js.load_case("flap_2d").replace({"dx": 0.06, "body.block": {"low": [6.0, 0.06], "high": [6.24, 0.66]}})
sea = {"kind": "irregular", "Hs": 0.04, "Tp": 1.4, "duration": 24.0}
air = {"scheme.kind": "incompressible", "air.volume": 0.5, "probes.gauges": [0.8], "waves": sea}
cases = [coarse("wave_tank", tank), coarse("owc", air), flap]
if "all" in sys.argv:
    cases += [coarse("owc"), coarse("hydrostatic_3d")]
for case in cases:
    model, state = js.build(case)
    every = round(case.output.sample_dt / float(model.dt))
    given = {"n_steps": every, "sample_every": every, "probes": js.make_probes(case, model, state)}
    # shapes and precisions are checked as a step is traced; it need not be compiled
    jax.eval_shape(lambda *both: js.simulate(*both, **given), model, state)
"""
"""Traces a step of a tank, an OWC and a flap; with "all" also the OWC in the other scheme, and 3-D."""


@pytest.mark.parametrize("which", ["some", pytest.param("all", marks=pytest.mark.slow)])
def test_shapes_of_arrays_are_those_annotated(which):
    """jaxtyping and beartype check every annotated function of seven subpackages at run time.

    This needs a separate process, because the tests' stand-ins for tables and models do not have these types.
    """
    _succeeds(sys.executable, "-c", STEPS, "checked", which)


@pytest.mark.slow
def test_no_step_mixes_precisions():
    """With jax set to refuse the promotion of one precision to another."""
    _succeeds(sys.executable, "-c", STEPS, "all", JAX_NUMPY_DTYPE_PROMOTION="strict")
