"""A body that sinks to the bed, drifts into a wall or meets another body stops the run."""

import equinox as eqx
import jax.numpy as jnp
import pytest

import jaxsph as js
from jaxsph.case.scheme import remedies
from jaxsph.errors import SimulationError
from jaxsph.model.state import Failure
from jaxsph.run.chunks import failure_error
from jaxsph.schemes.touching import touching

DX = 0.04
FREE = ["surge", "heave", "pitch"]
BLOCK = {"block": {"low": [0.5, 0.32], "high": [0.7, 0.44]}}
"""A box 0.2 m wide whose lowest points are at z = 0.32 m."""


def case(bodies, **sections):
    """A short tank with bodies in it, almost without waves."""
    base = {
        "name": "touching",
        "dx": DX,
        "t1": 2.0,
        "scheme": {"kind": "incompressible"},
        "tank": {"length": 1.6, "depth": 0.4, "height": 0.6},
        "waves": {"H": 1e-6, "T": 1.0},
        "bodies": bodies,
    }
    return js.Case.from_dict(base | sections)


def stops(given, **poses):
    """Place (x, z) where a case stops with its bodies in `poses` (m, m, rad); None if it does not stop."""
    model, state = js.build(given)
    parts = dict(state.parts)
    for name, pose in poses.items():
        parts[name] = eqx.tree_at(lambda motion: motion.pose, parts[name], jnp.asarray(pose, jnp.float32))
    near, where = touching(model, parts)
    return tuple(map(float, where)) if near else None


@pytest.fixture(scope="module")
def alone():
    """One free box."""
    return case({"buoy": BLOCK | {"density": 500.0, "free": FREE}})


@pytest.mark.parametrize(
    "pose",
    [
        (0.0, 0.0, 0.0),
        (0.0, -0.29, 0.0),
        (0.0, 1.0, 0.0),
        (-0.47, 0.0, 0.0),
        # the lowest corner of the turned box is 0.027 m above the bed
        (0.0, -0.24, 0.785),
    ],
)
def test_a_body_apart_from_everything_moves_on(alone, pose):
    assert stops(alone, buoy=pose) is None


@pytest.mark.parametrize(
    ("pose", "beside"),
    [
        ((0.0, -0.305, 0.0), (None, 0.0)),
        ((0.0, -0.5, 0.0), (None, 0.0)),
        ((0.0, -0.265, 0.785), (None, 0.0)),
        ((0.89, 0.0, 0.0), (1.6, None)),
        ((-0.49, 0.0, 0.0), (0.0, None)),
    ],
)
def test_a_body_at_the_bed_or_an_end_stops_the_run_there(alone, pose, beside):
    where = stops(alone, buoy=pose)
    assert where is not None
    for at, wall in zip(where, beside, strict=True):
        if wall is not None:
            assert at < DX if wall == 0.0 else at > wall - DX


@pytest.mark.parametrize(
    "free",
    [pytest.param(one, marks=[pytest.mark.slow] * (one != "heave")) for one in ("surge", "sway", "heave")],
)
def test_a_body_in_three_dimensions_stops_the_run_however_it_translates(free):
    axis, low = ["surge", "sway", "heave"].index(free), [0.24, 0.24, 0.24]
    buoy = {"block": {"low": low, "high": [0.4, 0.4, 0.4]}, "density": 500.0, "free": [free]}
    tank = {"length": 0.64, "width": 0.64, "depth": 0.32, "height": 0.6}
    model, state = js.build(case({"buoy": buoy}, tank=tank, waves=None))
    for gap, found in ((0.6, False), (0.4, True)):
        pose = jnp.zeros(6).at[axis].set(gap * DX - low[axis])
        parts = state.parts | {"buoy": eqx.tree_at(lambda motion: motion.pose, state.parts["buoy"], pose)}
        near, where = touching(model, parts)
        assert near == found
    assert where[axis] == pytest.approx(gap * DX, abs=1e-3)


def test_bodies_and_solids_do_not_pass_through_each_other():
    two = {
        "left": BLOCK | {"density": 500.0, "free": FREE},
        "right": {"block": {"low": [1.0, 0.32], "high": [1.2, 0.44]}, "density": 500.0, "free": FREE},
    }
    assert stops(case(two), left=(0.2, 0.0, 0.0)) is None
    assert stops(case(two), left=(0.29, 0.0, 0.0)) is not None
    post = {"post": {"block": {"low": [1.0, 0.2], "high": [1.2, 0.5]}}}
    one = {"left": two["left"]}
    assert stops(case(one, solid=post), left=(0.2, 0.0, 0.0)) is None
    assert stops(case(one, solid=post), left=(0.29, 0.0, 0.0)) is not None


def test_joined_bodies_may_meet_and_a_hinged_flap_may_brush_the_bed():
    raft = {
        "front": BLOCK | {"density": 500.0, "free": FREE},
        "back": {
            "block": {"low": [0.74, 0.32], "high": [0.94, 0.44]},
            "density": 500.0,
            "joined_to": "front",
            "pivot": [0.72, 0.38],
            "free": ["pitch"],
        },
    }
    assert stops(case(raft), back=(0.0, 0.0, 0.4)) is None
    flap = {"block": {"low": [0.7, 0.02], "high": [0.82, 0.5]}, "pivot": [0.76, 0.06], "density": 400.0}
    assert stops(case({"flap": flap | {"free": ["pitch"]}}), flap=(0.0, 0.0, 0.5)) is None


def test_the_message_names_the_body_the_place_and_what_to_change(alone):
    model, state = js.build(alone)
    sunk = eqx.tree_at(lambda s: s.parts["buoy"].pose, state, jnp.asarray((0.0, -0.31, 0.0), jnp.float32))
    near, where = touching(model, sunk.parts)
    status = state.status.flag(Failure.TOUCHING, near, state.step, where)
    error = failure_error(model, eqx.tree_at(lambda s: s.status, sunk, status), "sunk", remedies(alone))
    assert "the body 'buoy' is too near to the bed" in str(error)
    assert error.where[1] == pytest.approx(0.01, abs=1e-3)
    assert "[mooring.NAME]" in str(error)


def test_check_says_that_a_body_sinks():
    stone = BLOCK | {"density": 2500.0, "free": FREE}
    assert any("stone sinks: its mass of 60 kg/m" in note for note in case({"stone": stone}).notices())
    hung = {"rope": {"between": ["tank", "stone"], "at": [[0.6, 0.6], [0.6, 0.44]], "stiffness": 1e4}}
    for safe in (
        case({"stone": stone}, link=hung),
        case({"stone": stone | {"density": 990.0}}),
        case({"stone": stone | {"free": ["surge"]}}),
    ):
        assert not any("sinks" in note for note in safe.notices())


@pytest.mark.slow
def test_a_stone_stops_the_run_when_it_has_sunk():
    stone = case({"stone": BLOCK | {"density": 2500.0, "free": FREE}})
    with pytest.raises(SimulationError, match="'stone' is too near") as error:
        js.run(stone)
    # it falls by 0.3 m with less than g (1 - 1/2.5), since it moves water
    assert 0.32 < error.value.time < 1.5
    assert error.value.where[1] < 0.6 * DX
