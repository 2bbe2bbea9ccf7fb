"""Cases with links: what is refused, and runs with take-offs, springs, joints and prescribed motions."""

import numpy as np
import pytest
from conftest import enable_x64, exact_and_difference

import jaxsph as js
from jaxsph.case.case import Case
from jaxsph.errors import CaseError
from jaxsph.schemes.incompressible import ISPH

TANK = {"dx": 0.05, "t1": 1.0, "tank": {"length": 2.0, "depth": 0.5}, "scheme": {"kind": "incompressible"}}
BODY = {
    "block": {"low": [0.8, 0.4], "high": [1.2, 0.6]},
    "density": 500.0,
    "free": ["surge", "heave", "pitch"],
}
ROPE = {"between": ["body", "tank"], "at": [[0.8, 0.4], [0.4, 0.0]], "stiffness": 50.0}
HEAVE = {"body": "body", "motion": "heave", "damping": 100.0}


@pytest.mark.parametrize(
    ("link", "message"),
    [
        ({"damping": 1.0}, "link.a: give either body and motion, or between and at"),
        (HEAVE | {"between": ["body", "tank"]}, "give either body and motion, or between and at"),
        ({"body": "body", "damping": 1.0}, "give either body and motion"),
        (HEAVE | {"body": "buoy"}, "link.a.body: there is no body 'buoy'; choose from body"),
        (ROPE | {"between": ["buoy", "tank"]}, "link.a.between: there is no body 'buoy'; choose from body"),
        (ROPE | {"between": ["body", "body"]}, "must be on different bodies"),
        (HEAVE | {"damping": 0.0}, "the link has no force"),
        (ROPE | {"take_off": True}, "take_off needs a force that absorbs energy"),
        (HEAVE | {"rest": 0.1}, "rest needs between and at"),
        (
            HEAVE | {"stops": [0.1, -0.1], "stop_stiffness": 1.0},
            r"stops = \[0.1, -0.1\] must be an increasing pair",
        ),
        (HEAVE | {"stops": [-0.1, 0.1]}, "give both stops and a positive stop_stiffness"),
        (HEAVE | {"latch": 0.3}, "a latch needs both latch"),
        (
            HEAVE | {"motion": "surge"},
            "link.a.motion = 'surge': the body body is not free in this motion",
        ),
        (HEAVE | {"motion": "yaw"}, r"link.a.motion = 'yaw'"),
        (HEAVE | {"damping": -1.0}, r"link.a.damping = -1"),
        (HEAVE | {"stiffness": -50.0}, r"stiffness = -50: must not be negative without take_off"),
        (
            ROPE | {"stiffness": -50.0, "slack": True, "take_off": True},
            "slack needs between",
        ),
    ],
)
def test_links_that_do_not_fit_are_refused(link, message):
    with pytest.raises(CaseError, match=message):
        body = BODY | {"free": ["heave"]} if link.get("motion") == "surge" else BODY
        Case.from_dict(TANK | {"body": body, "link": {"a": link}}).problem()


def test_a_name_of_a_body_and_a_link_at_once_is_refused():
    with pytest.raises(CaseError, match="have the same name"):
        Case.from_dict(TANK | {"bodies": {"a": BODY}, "link": {"a": HEAVE | {"body": "a"}}})


@pytest.mark.parametrize(
    ("sections", "message"),
    [
        (
            {"body": BODY | {"pto": {"damping": 1.0}}, "link": {"pto": HEAVE}},
            "link.pto and body.pto have the same",
        ),
        *(
            ({"body": BODY, "link": {name: HEAVE}}, f"link.{name}: the names .* are reserved")
            for name in ISPH.of(0.02, 1.0, dim=2).entries()
        ),
        ({"bodies": {"tank": BODY}}, "bodies.tank: the names .* are reserved"),
    ],
)
def test_names_that_mean_something_else_are_refused(sections, message):
    with pytest.raises(CaseError, match=message):
        Case.from_dict(TANK | sections)


def devices():
    """A hinged pair of boxes on a rope, beside a plunger with a prescribed motion."""
    bodies = {
        "fore": BODY | {"block": {"low": [0.6, 0.4], "high": [0.9, 0.6]}},
        "aft": {
            "block": {"low": [1.0, 0.4], "high": [1.3, 0.6]},
            "density": 500.0,
            "joined_to": "fore",
            "pivot": [0.95, 0.5],
            "free": ["pitch"],
            "pto": {"damping": 5.0, "coulomb": 0.1},
        },
        "plunger": {
            "block": {"low": [1.6, 0.4], "high": [1.8, 0.7]},
            "motion": {"amplitude": [0.0, 0.05, 0.0], "period": 0.8, "ramp": 0.4},
        },
    }
    link = {"rope": ROPE | {"between": ["fore", "tank"], "at": [[0.6, 0.45], [0.3, 0.0]], "damping": 5.0}}
    return TANK | {"bodies": bodies, "link": link, "output": {"sample_dt": 0.02}}


@pytest.mark.parametrize(
    "kind", ["incompressible", pytest.param("weakly_compressible", marks=pytest.mark.slow)]
)
def test_joined_bodies_with_links_and_a_plunger_run_in_both_schemes(kind):
    """The plunger follows its motion, and the hinge keeps the two pontoons together. In incompressible water
    what the drive gave is stored or was taken, within 1 % of its work (0.3 % when written)."""
    run = js.run(Case.from_dict(devices() | {"scheme": {"kind": kind}}), t1=0.6, progress=False)
    given = run.results["energy_paddle"]
    assert given > 0.5 and run.results["energy_pto"] > 0.0
    if kind == "incompressible":
        assert abs(run.results["energy_residual"]) < 0.01 * given
    late = run.t > 0.4  # after the ramp
    asked = 0.05 * np.sin(2 * np.pi * run.t[late] / 0.8)
    np.testing.assert_allclose(run["heave_plunger"][late], asked, atol=1e-5)
    relative = run["relative_pitch_aft"]
    assert np.abs(relative).max() > 1e-4
    np.testing.assert_allclose(relative, run["pitch_aft"] - run["pitch_fore"], atol=1e-6)


def test_a_run_with_links_is_resumed_to_the_bit(tmp_path):
    case = Case.from_dict(devices())
    whole, cut = tmp_path / "whole.h5", tmp_path / "cut.h5"
    js.run(case, t1=0.12, out=whole, progress=False)
    js.run(case, t1=0.06, out=cut, progress=False)
    resumed = js.resume(cut, t1=0.12, progress=False)
    again = js.run(case, t1=0.12, progress=False)
    for name in ("pitch_fore", "relative_pitch_aft", "link_force_rope", "heave_plunger"):
        np.testing.assert_array_equal(resumed[name], again[name])


@pytest.mark.slow
@pytest.mark.parametrize("key", ["link.take.damping", "link.take.stiffness"])
def test_exact_slopes_over_a_link_are_those_of_differences(key):
    with enable_x64():
        case = Case.from_dict(
            TANK
            | {
                "precision": "float64",
                "scheme": {"kind": "incompressible", "tolerance": 1e-11},  # differences need a finer solution
                "t1": 0.2,
                "body": BODY | {"free": ["heave"], "velocity": [0.0, -0.3, 0.0]},
                "link": {"take": HEAVE | {"stiffness": 200.0, "take_off": True}},
                "output": {"sample_dt": 0.02},
            }
        )
        slope, apart = exact_and_difference(case, key)
    assert slope == pytest.approx(apart, rel=1e-4)
