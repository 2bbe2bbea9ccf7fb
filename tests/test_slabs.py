"""Runs on several devices: the flow is that on one, slopes agree, and any number resumes a file."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from mutations import SMALL

import jaxsph as js
from jaxsph.errors import CaseError
from jaxsph.output.run_file import RunFile
from jaxsph.run.devices import find_devices

SHARING = Path(__file__).parent / "sharing.py"
COARSE = ("dx=0.04", "device.wall_thickness=0.04")
SHARED = {
    name: SMALL[name]
    for name in (
        "beach",
        "box_in_waves",
        "box_moored",
        "buoy_heave",
        "flap_floating",
        "owc_floating",
        "owc_two_chambers",
        "raft",
    )
} | {"dam_break_column": {"dx": 0.02, "tank.layer": None}, "flap_2d": {"dx": 0.05}}
"""Changes that make cases small, by name. The tables of the two last ones are large enough for 20 steps."""


def apart(case, devices, steps, *settings):
    """Largest difference from a run on one device, and largest value, by name, from a separate process."""
    command = [sys.executable, str(SHARING), case, str(devices), str(steps), *settings]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])


def check(found, share, of):
    """Checks that differences are below `share` of the bounds in `of`, or of the size where a bound is 0."""
    assert found["failures"] == [0.0, 0.0]
    for name, bound in of.items():
        difference, size = found[name]
        assert difference <= share * (bound or size), f"{name}: {difference:.2g} of {size:.2g}"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "settings"),
    [("dam_break", ["dx=0.04"]), ("owc", [*COARSE, "scheme.kind=weakly_compressible"])],
)
def test_three_devices_make_the_weakly_compressible_flow_of_one(case, settings):
    """The OWC's 2152 particles and two copies without mass are 718 on each of three devices.

    float32 sums have another order: velocities agree to a few units in the last place of their change in 20
    steps, and so do pressures, which follow from the density.
    """
    found = apart(case, 3, 20, *settings)
    gravity = 9.81 * 0.01  # m/s: what gravity alone gives in 20 steps
    air = {"reading P_a": 0} if case == "owc" else {}
    check(found, 1e-5, {"x": 0, "u": gravity, "rho": 0, "m": 0, "reading kinetic": 0} | air)


@pytest.mark.slow
@pytest.mark.parametrize("devices", [2, 3, 8])
def test_more_devices_make_the_incompressible_flow_of_one(devices):
    """To ten times the pressure solver's tolerance: another order of summation changes its iterations."""
    found = apart("owc", devices, 20, *COARSE, "scheme.tolerance=3e-5")
    check(found, 3e-4, {"x": 0, "u": 0.1, "p": 0, "reading kinetic": 0, "reading P_a": 1.0})


@pytest.mark.slow
@pytest.mark.parametrize("devices", [2, 3, 8])
@pytest.mark.parametrize(
    ("settings", "share"),
    [
        (("scheme.kind=weakly_compressible", "precision=float64"), 1e-12),
        (("scheme.tolerance=1e-9", "precision=float64"), 1e-6),
        (("scheme.kind=weakly_compressible",), 1e-4),
        (("scheme.tolerance=3e-5",), 3e-3),
    ],
)
def test_more_devices_make_the_flow_of_one_for_200_steps(devices, settings, share):
    """Ten times the bounds for 20 steps: round-off grows e-fold in 0.2 s, and 200 steps are 0.5 and 1.6 s.

    Incompressible flow is allowed at least a hundred times the pressure solver's tolerance in a step.
    """
    found = apart("owc", devices, 200, *COARSE, *settings)
    check(found, share, {"x": 0, "u": 0, "reading kinetic": 0})


@pytest.mark.slow
@pytest.mark.parametrize("name", SHARED)
def test_two_devices_share_bodies_solids_and_three_dimensions(name, tmp_path):
    coarse = tmp_path / "case.toml"
    coarse.write_text(js.load_case(name).replace(SHARED[name]).to_toml(), encoding="utf-8")
    found = apart(str(coarse), 2, 20, "scheme.tolerance=3e-5")
    # a balance of gravity and pressure is as exact as the solver; velocities can be larger in a dam break
    gravity = 9.81 * found["reading time"][1]
    check(found, 3e-4, {"x": 0, "u": max(gravity, found["u"][1]), "p": 0})


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scheme", "share"), [("scheme.kind=weakly_compressible", 1e-12), ("scheme.tolerance=1e-9", 1e-6)]
)
def test_slopes_go_through_two_devices(scheme, share):
    """By forward and reverse mode in float64: to round-off, or to the pressure solver's tolerance."""
    found = apart("owc", 2, 20, *COARSE, "precision=float64", scheme, "--slopes")
    for name, (difference, size) in found.items():
        assert size > 0.0 and difference <= share * size, name


@pytest.mark.slow
def test_a_run_of_two_devices_is_resumed_on_one_and_on_three(tmp_path):
    """Readings agree to round-off, for weakly compressible water at rest and the paddle's first push."""

    def jaxsph(*arguments):
        command = [sys.executable, "-m", "jaxsph", *map(str, arguments), "--quiet", "--no-plot"]
        # there may be fewer cores than devices
        flags = {"XLA_FLAGS": "--xla_force_host_platform_device_count=3"}
        subprocess.run(command, check=True, capture_output=True, text=True, env=os.environ | flags)

    settings = [
        a
        for pair in zip(["--set"] * 3, [*COARSE, "scheme.kind=weakly_compressible"], strict=True)
        for a in pair
    ]
    jaxsph("run", "owc", *settings, "--t1", 0.4, "--out", tmp_path / "whole.h5")
    whole = RunFile.open(tmp_path / "whole.h5").series()
    for devices in (1, 3):
        path = tmp_path / f"{devices}.h5"
        jaxsph("run", "owc", *settings, "--t1", 0.2, "--devices", 2, "--out", path)
        jaxsph("resume", path, "--t1", 0.4, "--devices", devices)
        series = RunFile.open(path).series()
        for name in ("P_a", "paddle", "kinetic", "max_speed"):
            # round-off grows e-fold in 0.2 s at the fastest (tangent_growth): threefold in half of the run
            np.testing.assert_allclose(series[name], whole[name], atol=1e-4 * np.max(np.abs(whole[name])))


def test_too_many_devices_are_refused():
    with pytest.raises(CaseError, match="devices = 0: must be 1 or more"):
        find_devices(0)
    with pytest.raises(CaseError, match=r"devices = 999: JAX has only \d+ devices? \(cpu\); give"):
        find_devices(999)
