"""Cases with several bodies: what is refused and with which message, files of motions, readings."""

import tomllib

import numpy as np
import pytest
from mutations import SMALL

import jaxsph as js
from jaxsph.case.case import Case
from jaxsph.errors import CaseError

TANK = {"dx": 0.05, "t1": 1.0, "tank": {"length": 3.0, "depth": 0.5}, "scheme": {"kind": "incompressible"}}


def box(first, last, **keys):
    """A box at the water surface, from the first to the last x (m)."""
    return {"block": {"low": [first, 0.4], "high": [last, 0.6]}, "density": 500.0, **keys}


FORE = box(1.0, 1.4, free=["surge", "heave", "pitch"])
AFT = box(1.5, 1.9, free=["pitch"], joined_to="fore", pivot=[1.45, 0.5])
TALL = FORE | {"block": {"low": [1.2, 0.2], "high": [1.4, 0.9]}}


def moved(**motion):
    """Sections of one body with a prescribed motion."""
    return {"bodies": {"plunger": box(1.0, 1.4, motion=motion)}}


TIMES = [0.0, 0.1, 0.2, 0.3]


@pytest.mark.parametrize(
    ("sections", "message"),
    [
        (
            {"bodies": {"fore": FORE, "aft": AFT | {"joined_to": "stern"}}},
            r"bodies.aft.joined_to = 'stern': there is no such body; choose from fore, or remove",
        ),
        (
            {"bodies": {"fore": box(1.0, 1.4, joined_to="aft"), "aft": AFT}},
            r"bodies.aft, bodies.fore: joined_to forms a loop; join one body of the loop to the tank",
        ),
        ({"body": box(1.0, 1.4, joined_to="body")}, r"body: joined_to forms a loop"),
        (
            {"bodies": {"fore": FORE, "aft": AFT | {"block": {"low": [1.3, 0.4], "high": [1.9, 0.6]}}}},
            r"bodies.fore and bodies.aft have 0.02 m2 in common: move one of them",
        ),
        (  # they overlap only at this angle
            {"bodies": {"fore": TALL | {"angle": 1.4}, "aft": box(1.5, 1.9)}},
            r"bodies.fore and bodies.aft have .* m2 in common: move one of them",
        ),
        (
            {"body": FORE, "bodies": {"body": box(1.5, 1.9)}},
            r"bodies.body and \[body\] are the same body: give only one",
        ),
        (
            {"bodies": {"fore": FORE}, "solid": {"fore": {"block": {"low": [2.0, 0.0], "high": [2.2, 0.2]}}}},
            r"have the same name: rename one",
        ),
        (
            {"bodies": {"fore": FORE, "aft": AFT | {"density": None, "mass": 40.0}}},
            r"bodies.aft: a body that turns needs inertia or density",
        ),
        (
            {"bodies": {"fore": FORE, "aft": AFT | {"density": None}}},
            r"bodies.aft: a body that is free or joined to another needs either density, or mass",
        ),
        (moved(amplitude=[0.0, 0.1, 0.0]), r"bodies.plunger.motion: give either amplitude and period, or a"),
        (moved(period=1.0), r"bodies.plunger.motion: give either amplitude and period, or a file"),
        (
            moved(amplitude=[0.0, 0.1, 0.0], period=1.0, t=TIMES, heave=TIMES),
            r"bodies.plunger.motion: give either amplitude and period, or a file",
        ),
        (
            moved(t=TIMES, heave=TIMES[:3]),
            r"motion: heave has 3 values, but t has 4; give one value for each",
        ),
        (
            moved(t=TIMES),
            r"motion: give samples of at least one motion \(surge, heave, ...\) together with t",
        ),
        (
            moved(t=TIMES[1:], heave=TIMES[1:]),
            r"motion: t must have at least 4 increasing values, the first of which is 0",
        ),
        (moved(t=[0.0, 0.2, 0.1, 0.3], heave=TIMES), r"motion: t must have .* the first of which is 0"),
    ],
)
def test_bodies_that_cannot_be_are_refused(sections, message):
    with pytest.raises(CaseError, match=message):
        Case.from_dict(_without_nothing(TANK | sections))


def _without_nothing(data):
    """The mapping without the keys whose value is None."""
    if not isinstance(data, dict):
        return data
    return {key: _without_nothing(value) for key, value in data.items() if value is not None}


def test_a_tank_has_bodies_or_a_device():
    with pytest.raises(
        CaseError, match=r"a tank has either bodies \(\[bodies.fore\]\) or a \[device\]: remove"
    ):
        js.load_case("owc").replace({"bodies.fore": FORE})


def test_a_moment_of_inertia_that_no_body_has_is_refused():
    """40 kg/m at 0.3 m from the pivot have 3.6 kg m, also if the body has no extent."""
    flap = {"block": FORE["block"], "mass": 40.0, "free": ["pitch"], "pivot": [1.2, 0.2]}
    words = r"bodies.flap.inertia = 3.5: the moment of inertia about the pivot must be more than .*, 3.6$"
    with pytest.raises(CaseError, match=words):
        Case.from_dict(TANK | {"bodies": {"flap": flap | {"inertia": 3.5}}})
    model, _ = js.build(Case.from_dict(TANK | {"bodies": {"flap": flap | {"inertia": 3.9}}}))
    assert float(model.bodies[0].inertia) == pytest.approx(0.3, rel=1e-5)


def test_a_motion_is_read_from_a_file(tmp_path):
    """And the case survives its own text, which holds the samples instead of the file's name."""
    (tmp_path / "motion.csv").write_text(
        "t (s),pitch (rad),heave\n0,0,0\n0.1,0.01,0.02\n0.2,0,0.04\n0.3,0,0\n"
    )
    path = tmp_path / "plunger.toml"
    path.write_text(
        """
        dx = 0.05
        t1 = 1.0
        tank = { length = 3.0, depth = 0.5 }
        scheme = { kind = "incompressible" }

        [bodies.plunger]
        block = { low = [1.0, 0.4], high = [1.4, 0.6] }
        motion = { file = "motion.csv" }
        """
    )
    case = js.load_case(path)
    samples = [[0.0, 0.0, 0.0], [0.0, 0.02, 0.01], [0.0, 0.04, 0.0], [0.0, 0.0, 0.0]]
    np.testing.assert_allclose(case.bodies["plunger"].motion.samples, samples)
    assert case.bodies["plunger"].motion.t == (0.0, 0.1, 0.2, 0.3)
    assert Case.from_dict(tomllib.loads(case.to_toml())) == case
    (tmp_path / "motion.csv").write_text("t,rise\n0,0\n")
    names = r"must name the columns t \(s\) and at least one of surge \(m\), heave"
    with pytest.raises(CaseError, match=r"motion.csv, line 1 .*: " + names):
        js.load_case(path)
    (tmp_path / "motion.csv").write_text("t,sway\n0,0\n0.1,0.1\n0.2,0.1\n0.3,0.1\n")
    with pytest.raises(CaseError, match="motion.sway: must have no values in a two-dimensional case"):
        js.load_case(path).problem()


def test_a_joined_body_begins_turned_with_the_body_that_carries_it():
    """The fore box begins turned by 0.2 rad about its centre, and the aft box by 0.1 rad relative to it."""
    bodies = {"aft": AFT | {"angle": 0.1}, "fore": FORE | {"angle": 0.2}}
    model, state = js.build(Case.from_dict(TANK | {"bodies": bodies}))
    assert [body.name for body in model.bodies] == ["fore", "aft"]
    np.testing.assert_allclose(state.parts["fore"].pose, [0.0, 0.0, 0.2], atol=1e-6)
    # the hinge is 0.25 m behind the centre of the fore box; landward pitch lowers it
    turned = [0.25 * (np.cos(0.2) - 1.0), -0.25 * np.sin(0.2), 0.3]
    np.testing.assert_allclose(state.parts["aft"].pose, turned, atol=1e-6)


def test_readings_of_joined_bodies_end_in_their_names():
    case = js.load_case("raft").replace(SMALL["raft"])
    model, state = js.build(case)
    names = {name for probe in js.make_probes(case, model, state) for name in probe.describe()}
    of_both = {"surge", "heave", "pitch", "body_velocity", "body_force", "body_force_mean"}
    assert {f"{name}_{body}" for name in of_both for body in ("fore", "aft")} <= names
    assert {"relative_pitch_aft", "power_pto_aft"} <= names
    assert not {"relative_pitch_fore", "relative_surge_aft", "pitch", "power_pto_fore"} & names


def test_the_work_of_a_drive_is_booked_only_where_a_motion_is_given():
    motion = {"amplitude": [0.0, 0.05, 0.0], "period": 1.0}
    bodies = {"fore": FORE, "plunger": box(2.0, 2.4, motion=motion), "buoy": box(0.2, 0.6, free=["heave"])}
    model, _ = js.build(Case.from_dict(TANK | {"bodies": bodies}))
    assert [name for name in model.entries() if name.startswith("body_drive")] == ["body_drive_plunger"]


def test_a_body_is_no_wall_of_a_chamber():
    with pytest.raises(CaseError, match=r"there is no wall 'bodies.fore'; choose from far"):
        Case.from_dict(
            TANK
            | {
                "bodies": {"fore": FORE},
                "chamber": {"c": {"between": ["bodies.fore", "far"], "pto": {"K_dm": 9.0}}},
            }
        )


@pytest.mark.parametrize(
    "motion",
    [
        {"amplitude": [0.0, 0.1, 0.0], "period": 1.0, "surge": [0.0, 0.1]},
        {"t": TIMES, "heave": [0.0, 0.1, 0.1, 0.0], "ramp": 1.0},
        {"t": TIMES, "heave": [0.0, 0.1, 0.1, 0.0], "phase": [0.0, 1.0, 0.0]},
    ],
)
def test_keys_of_two_kinds_of_motion_are_refused(motion):
    with pytest.raises(CaseError, match="give phase and ramp only with amplitude and period"):
        Case.from_dict(TANK | moved(**motion))
