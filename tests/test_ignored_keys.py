"""Keys that the chosen alternative would ignore are refused, and their defaults are not."""

import itertools

import pytest

import jaxsph as js
from jaxsph.case.air_sections import LAWS

VALUES = {
    "K_dm": 500.0,
    "resistance": 100.0,
    "area": 0.01,
    "curve": [[0.0, 0.0], [0.1, 500.0]],
    "P_a": 10.0,
    "phase": [0.1, 0.2],
    "relief": 80.0,
    "suction": 80.0,
    "discharge": 0.7,
    "density": 1.1,
    "ramp": 0.5,
}
FLAP = {
    "block": {"low": [1.0, 0.1], "high": [1.1, 0.4]},
    "free": ["pitch"],
    "pivot": [1.05, 0.1],
    "density": 500.0,
}


@pytest.fixture(scope="module")
def owc():
    return js.load_case("owc")


@pytest.mark.parametrize(
    ("law", "key"), list(itertools.product(LAWS, sorted({key for keys in LAWS.values() for key in keys})))
)
def test_a_power_take_off_takes_the_keys_of_its_own_law_only(owc, law, key):
    change = {"pto": {law: VALUES[law], key: VALUES[key]}}
    if key in LAWS[law]:
        assert getattr(owc.replace(change).pto, key) is not None
    else:
        with pytest.raises(
            js.CaseError, match=rf"pto: {key} has no effect with {law}; give .* or remove {key}"
        ):
            owc.replace(change)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"duct": {"a": {"between": ["chamber", "b"], "pto": {"K_dm": 1.0}, "discharge": 0.7}}},
            "duct.a: discharge has no effect with pto; give area instead of pto, or remove discharge",
        ),
        (
            {"body": FLAP | {"pto": {"damping": 1.0, "stop": 0.5}}},
            "body.pto: stop has no effect without stop_stiffness; give a positive stop_stiffness, or "
            "remove stop",
        ),
        (
            {"body": FLAP | {"inertia": 0.4}},
            "body: inertia has no effect with density; give mass instead of density, or remove inertia",
        ),
        (
            {"scheme": {"kind": "weakly_compressible", "kernel": "wendland", "cut": 3.0}},
            'scheme.*: cut has no effect with kernel = "wendland"; choose kernel = "gaussian", or remove cut',
        ),
        (
            {"scheme": {"kind": "incompressible", "solver": "explicit", "tolerance": 1e-4}},
            'scheme.*: tolerance has no effect with solver = "explicit"; choose solver = "bicgstab", or '
            "remove tolerance",
        ),
    ],
    ids=lambda value: None if isinstance(value, str) else "+".join(value),
)
def test_a_key_without_effect_is_refused(owc, change, message):
    with pytest.raises(js.CaseError, match=message):
        owc.replace(change)


def test_defaults_are_accepted_whatever_the_alternative(owc):
    """Run files contain all keys, also those that have no effect."""
    again = owc.replace({"pto": {"K_dm": 500.0, "discharge": 0.6, "density": 1.2, "ramp": 0.0}})
    assert again.pto.K_dm == 500.0


def test_a_short_tank_without_absorption_needs_no_room_for_the_paddles_gauge():
    tank = js.load_case("wave_tank").replace({"probes": None, "sponge": None})
    short = {"dx": 0.05, "tank.length": 0.3, "waves.H": 0.002}
    with pytest.raises(js.CaseError, match="the paddle's gauge needs 0.34 m of water"):
        tank.replace(short)
    assert not tank.replace(short | {"waves.absorption": False}).waves.absorption
