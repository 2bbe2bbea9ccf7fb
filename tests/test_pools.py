"""Chambers in three dimensions: the water surface that solids enclose, and the air's force on it."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import airs_of

import jaxsph as js
from jaxsph.case.case import Case
from jaxsph.case.geometry import Geometry
from jaxsph.errors import CaseError
from jaxsph.parts.sides import Plan

DX = 0.05
PIPE = {"revolution": {"profile": [[0.2, 0.3], [0.35, 0.3], [0.35, 0.8], [0.2, 0.8]], "axis": [1.0, 0.5]}}
CONE = [[0.3, 0.3], [0.4, 0.3], [0.3, 0.8], [0.2, 0.8]]
SHALLOW = [[0.2, 0.45], [0.35, 0.45], [0.35, 0.8], [0.2, 0.8]]
AIR = {"volume": 0.5}
BED = {"block": {"low": [1.0, 0.0], "high": [1.2, 0.1]}}
HUT = {
    "front": {"block": {"low": [1.2, 0.2, 0.25], "high": [1.3, 0.8, 0.8]}},
    "left": {"block": {"low": [1.3, 0.2, 0.0], "high": [1.6, 0.3, 0.8]}},
    "right": {"block": {"low": [1.3, 0.7, 0.0], "high": [1.6, 0.8, 0.8]}},
}
"""An onshore chamber narrower than the tank: front wall, two side walls, and the end of the tank."""
SPAR = {"revolution": {"profile": [[0.0, 0.7], [0.2, 0.7], [0.2, 0.3], [0.3, 0.3], [0.3, 0.8], [0.0, 0.8]]}}


def case(**changes):
    """A tank with an upright pipe around a chamber."""
    sections = {
        "dx": DX,
        "t1": 0.05,
        "tank": {"length": 1.6, "width": 1.0, "depth": 0.5, "height": 0.9},
        "scheme": {"kind": "incompressible"},
        "solid": {"pipe": PIPE},
        "chamber": {"main": {"at": [1.0, 0.5], "pto": {"resistance": 2000.0}}},
    }
    return Case.from_dict({key: value for key, value in (sections | changes).items() if value is not None})


def spar(**body):
    """Changes that float a spar with a hollow, open below and with a roof, in place of the pipe."""
    section = SPAR | {"density": 400.0, "free": ["heave"]} | body
    section["revolution"] = {"axis": [0.8, 0.5]} | section["revolution"]
    chamber = {"body": "spar", "at": [0.8, 0.5], "pto": {"resistance": 2000.0}}
    return {"solid": None, "bodies": {"spar": section}, "chamber": {"main": chamber}}


def surface(**changes):
    return Geometry.of(case(**changes)).stretches["main"]


def test_a_pipe_encloses_a_disc():
    """To half a per cent: points half a spacing apart, and a radius of four spacings."""
    pool = surface()
    assert pool.surface == pytest.approx(np.pi * 0.2**2, rel=5e-3)
    assert (pool.tip, pool.top) == pytest.approx((0.3, 0.8), abs=1e-3)
    assert (pool.first, pool.last) == pytest.approx((0.8, 1.2), abs=2e-3)
    assert pool.narrowest == pytest.approx(0.4, abs=5e-3)


def test_walls_and_the_end_of_the_tank_enclose_a_rectangle():
    pool = surface(solid=HUT, chamber={"main": {"at": [1.5, 0.5], "pto": {"resistance": 2000.0}}})
    assert pool.surface == pytest.approx(0.3 * 0.4, rel=5e-3)
    assert (pool.tip, pool.top) == pytest.approx((0.25, 0.8), abs=1e-3)
    corners = sorted(map(tuple, np.round(pool.corners, 2)))
    assert {(1.6, 0.3), (1.6, 0.7)} <= set(corners) and pool.first == pytest.approx(1.3, abs=1e-6)


def test_a_body_carries_a_chamber():
    pool = surface(**spar())
    assert pool.carrier == "spar"
    assert pool.surface == pytest.approx(np.pi * 0.2**2, rel=5e-3)
    assert (pool.tip, pool.top) == pytest.approx((0.3, 0.7), abs=1e-3)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"chamber": {"main": {"at": [0.3, 0.5], "pto": {"resistance": 1.0}}}}, "do not enclose this point"),
        ({"chamber": {"main": {"at": [0.72, 0.5], "pto": {"resistance": 1.0}}}}, "do not enclose this point"),
        ({"solid": {k: HUT[k] for k in ("front", "left")}}, "do not enclose this point"),
        ({"chamber": {"main": {"between": ["pipe", "far"]}}}, r"with a width give at = \[x, y\]"),
        ({"solid": None}, "there is no solid that could enclose"),
        (
            {"tank": {"length": 1.6, "depth": 0.5}, "solid": {"bed": BED}},
            "needs tank.width",
        ),
        (
            {"solid": {"pipe": {"revolution": PIPE["revolution"] | {"profile": CONE}}}},
            "needs upright walls",
        ),
        (
            {"solid": {"pipe": {"revolution": PIPE["revolution"] | {"profile": SHALLOW}}}},
            "lower edge is at z = 0.45 m",
        ),
        (
            {
                "chamber": {
                    n: {"at": [1.0, y], "pto": {"resistance": 1.0}} for n, y in (("a", 0.5), ("b", 0.6))
                }
            },
            "chamber.a and chamber.b: their water surfaces overlap",
        ),
        (spar(revolution={"profile": PIPE["revolution"]["profile"]}), "is open at the top"),
        (
            spar() | {"chamber": {"main": {"body": "hull", "at": [0.8, 0.5], "pto": {"resistance": 1.0}}}},
            "there is no such body; choose from spar",
        ),
    ],
)
def test_impossible_chambers_are_refused(changes, message):
    with pytest.raises(CaseError, match=message):
        case(**changes)


def test_a_plan_gives_level_and_mask():
    """The level follows from volume and area; a particle pressed into a wall still counts."""
    plan = Plan(jnp.asarray([[0.0, 0.0], [0.4, 0.0], [0.4, 0.2], [0.0, 0.2]]), jnp.asarray(0.3))
    assert float(plan.level(jnp.asarray(0.016))) == pytest.approx(0.5)
    x = tuple(jnp.asarray(a) for a in ([0.2, -0.02, -0.04, 0.2], [0.1, 0.1, 0.1, 0.25], [0.4, 0.4, 0.4, 0.4]))
    assert list(map(bool, plan.between(x, 1e-4, jnp.asarray(0.03)))) == [True, True, False, False]


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["incompressible", "weakly_compressible"])
@pytest.mark.parametrize("carried", [False, True])
def test_air_pushes_on_its_surface_and_on_nothing_else(kind, carried):
    """A pressure of 1 Pa pushes the water down by the area of the surface, and the body up by the same force.
    On a fading zone two spacings high the sum of the weight's slope is off by up to an eighth."""
    model, state = js.build(case(scheme={"kind": kind}, **(spar() if carried else {})))
    (air,) = jax.jit(functools.partial(airs_of, model))(state)[1].values()
    down = -float(jnp.sum(air.force[-1]))
    assert down == pytest.approx(float(model.chambers[0].surface), rel=0.15)
    for across in air.force[:-1]:
        assert abs(float(jnp.sum(across))) < 0.02 * down
    if carried:
        assert float(air.reaction["spar"][1]) == pytest.approx(down, rel=1e-5)


@pytest.mark.slow
def test_a_pressure_pushes_the_level_down():
    """By P/(rho g), less what the tank's level rises, to a tenth of it, after a slow ramp."""
    P = 300.0
    chamber = {"main": {"at": [1.0, 0.5], "pto": {"P_a": P, "ramp": 1.5}}}
    solution = js.run(case(t1=3.0, chamber=chamber), progress=False)
    pool = surface()
    solids = np.pi * (0.35**2 - 0.2**2)
    share = 1.0 - pool.surface / (1.6 * 1.0 - solids)
    fall = share * P / (1000.0 * 9.81)
    level = np.asarray(solution["chamber_level_main"])
    assert np.mean(level[-20:]) - level[0] == pytest.approx(-fall, rel=0.1)
