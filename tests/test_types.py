"""Lanes that read or run the package under other rules: types, shapes of arrays, promotion of precisions."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def _succeeds(*command, **environment):
    done = subprocess.run(
        command, cwd=ROOT, env=os.environ | environment, capture_output=True, text=True, timeout=1200
    )
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]


@pytest.mark.slow
def test_types_pass_pyright():
    """Basic mode; what is not held yet is named in pyproject.toml."""
    assert (ROOT / "jaxsph" / "py.typed").exists()
    _succeeds(sys.executable, "-m", "pyright", "--pythonpath", sys.executable)


@pytest.mark.slow
def test_shapes_of_arrays_are_those_annotated():
    """A few small tests with every annotated function of these rooms checked at run time by beartype."""
    hook = ",".join(f"jaxsph.{room}" for room in ("core", "model", "solids", "parts", "schemes"))
    tests = (
        "tests/test_pairs.py",
        "tests/test_shapes.py",
        "tests/test_neighbours.py::test_overflow_is_flagged_and_says_how_much",
        "tests/test_precision.py",
    )
    _succeeds(
        sys.executable,
        "-m",
        "pytest",
        "-n",
        "0",
        "-x",
        f"--jaxtyping-packages={hook},beartype.beartype",
        *tests,
    )


@pytest.mark.slow
def test_no_step_mixes_precisions():
    """A few steps of a tank and of the OWC where jax refuses to promote one precision to another."""
    _succeeds(
        sys.executable,
        *("-m", "pytest", "-n", "0", "-x", "tests/test_precision.py"),
        JAX_NUMPY_DTYPE_PROMOTION="strict",
    )
