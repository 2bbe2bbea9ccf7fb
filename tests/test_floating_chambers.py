"""Chambers in bodies: momentum and energy of air, water and body, the level at rest, what is refused."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import airs_of, enable_x64, exact_and_difference

import jaxsph as js
from jaxsph.errors import CaseError
from jaxsph.solids.filling import DummyParticles
from jaxsph.solids.placement import lattice

DX = 0.04
HULL = [
    [0.6, 0.2],
    [0.76, 0.2],
    [0.76, 0.64],
    [1.0, 0.64],
    [1.0, 0.2],
    [1.16, 0.2],
    [1.16, 0.72],
    [0.6, 0.72],
]
"""Two walls under a roof, in water 0.4 m deep."""
OPEN = [[0.6, 0.2], [1.16, 0.2], [1.16, 0.7], [1.0, 0.7], [1.0, 0.3], [0.76, 0.3], [0.76, 0.7], [0.6, 0.7]]
"""A hull whose hollow is open at the top instead of at the bottom."""
TWO = [*HULL[:5], [1.16, 0.2], [1.16, 0.64], [1.4, 0.64], [1.4, 0.2], [1.56, 0.2], [1.56, 0.72], HULL[-1]]
"""A hull with two hollows."""
MASS = 1000.0 * 0.2 * 0.32
"""Mass with which the hull floats at this position, kg/m."""


def case(**changes):
    """A floating hull with a chamber in a short closed tank."""
    return js.Case.from_dict(
        {
            "dx": DX,
            "t1": 1.0,
            "tank": {"length": 1.76, "depth": 0.4},
            "scheme": {"kind": "incompressible"},
            "bodies": {
                "hull": {
                    "polygon": HULL,
                    "mass": MASS,
                    "centre": [0.88, 0.4],
                    "inertia": 0.1 * MASS,
                    "free": ["surge", "heave", "pitch"],
                }
            },
            "chamber": {"inner": {"body": "hull", "pto": {"resistance": 2000.0}}},
            "output": {"sample_dt": 0.05},
        }
    ).replace(changes)


def in_a_channel(kind):
    """Model and state of the hull in a channel without ends, which moves and turns at the start."""
    box = js.Box((0.0, 0.0), (1.76, 0.8), sides=("periodic", "floor"))
    if kind is js.ISPH:
        scheme = js.ISPH.of(DX, 1.0, dim=2, period=box.period)
    else:
        scheme = js.DeltaSPH.of(DX, 20.0, period=box.period)
    shape = js.Polygon(tuple(map(tuple, HULL)))
    walls = js.Ghosts.build(
        box, DX, scheme.smoothing, js.FreeSlip(), shapes=(shape,), filling=DummyParticles()
    )
    joint = js.PlanarJoint.of(("surge", "heave", "pitch"), velocity=(0.3, 0.0, 0.5))
    hull = js.RigidBody.of(shape, walls.dummies[0], joint, density=MASS / shape.moments()[0], name="hull")
    x = lattice(box.low, (1.76, 0.4), DX)[0].astype(np.float32)
    x = x[np.asarray(shape.distance(jnp.asarray(x))) > 0.3 * DX]
    chamber = js.Chamber.of(
        js.LinearTurbine(jnp.float32(2000.0)),
        between=(0.76, 1.0),
        tip=0.2,
        level=0.4,
        dx=DX,
    ).in_body(hull)
    return js.assemble(
        x,
        np.zeros_like(x),
        scheme=scheme,
        walls=walls,
        dx=DX,
        sample_dt=0.02,
        p=9810.0 * (0.4 - x[:, 1]),
        g=(0.0, -9.81),
        bodies=(hull,),
        chambers=(chamber,),
        speed=1.0,
    )


def momentum(state):
    """Momentum (N s/m) along the channel of water and hull."""
    p, hull = state.particles, state.parts["hull"]
    return np.sum(np.asarray(p.m, float) * np.asarray(p.u[:, 0], float)) + MASS * float(hull.velocity[0])


@pytest.fixture(scope="module", params=[js.ISPH, pytest.param(js.DeltaSPH, marks=pytest.mark.slow)])
def channel(request):
    """Model of the hull in a channel, its initial state, and its run to 0.3 s."""
    model, state = in_a_channel(request.param)
    return model, state, js.simulate(model, state, n_steps=round(0.3 / float(model.dt)))


def test_air_pushes_water_and_hull_with_opposite_forces(channel):
    """Sum and moment vanish, and the flow is that through the hull, also when the hull is turned."""
    model, _, (state, _) = channel

    @jax.jit
    def coupled(state):
        state, airs = airs_of(model, state)
        (air,) = airs.values()
        hull = state.parts["hull"]
        # water that moves with the hull lets no air out
        rigid = model.bodies[0].velocity(hull, state.particles.x)
        return state, air, rigid, air.flow(rigid, {"hull": hull.velocity})

    state, air, rigid, flow = coupled(state)
    used = np.asarray(air.index) < len(state.particles.x)
    x = np.asarray(state.particles.x, float)[np.asarray(air.index)[used]]
    force = np.stack([np.asarray(f, float)[used] for f in air.force], 1)
    hull, pivot = state.parts["hull"], np.asarray(model.bodies[0].pivot, float)
    assert abs(float(hull.pose[2])) > 0.02
    arm = x - pivot - np.asarray(hull.pose[:2], float)
    on_water = [*force.sum(axis=0), np.sum(arm[:, 1] * force[:, 0] - arm[:, 0] * force[:, 1])]
    size = np.abs(force).sum()
    np.testing.assert_allclose(air.reaction["hull"], -np.array(on_water), atol=1e-5 * size)
    assert abs(float(flow)) < 1e-5 * size * float(jnp.max(jnp.abs(rigid)))


def test_water_and_hull_keep_their_momentum(channel):
    """In a channel without ends. The hull feels its contact with individual particles a step later.

    Without a chamber the same sums miss 1.3e-5 and 3.7e-5 of the momenta that moved, by rounding.
    """
    model, start, (state, _) = channel
    moved = np.sum(np.abs(np.asarray(state.particles.m * state.particles.u[:, 0], float))) + MASS * 0.3
    owed = float(model.dt) * float(state.parts["hull"].contact[0])
    assert abs(momentum(state) + owed - momentum(start)) < 5e-5 * moved
    assert abs(float(state.parts["chamber"].P_a)) > 5.0  # Pa


@pytest.mark.slow
def test_energy_balance_and_law_of_a_floating_chamber():
    """P_a q is all that the air takes from water and hull, and the energy balance closes."""
    run = js.run(case(t1=0.6, **{"bodies.hull.velocity": [0.2, 0.1, 0.4]}))
    series = run.series
    np.testing.assert_allclose(series["P_a_inner"], 2000.0 * series["flow_inner"], rtol=2e-3, atol=0.05)
    started = 0.5 * MASS * (0.2**2 + 0.1**2) + 0.5 * 0.1 * MASS * 0.4**2
    assert run.results["energy_pto"] > 0.02 * started
    assert abs(run.results["energy_residual"]) < 1e-3 * started


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["incompressible", "weakly_compressible"])
def test_air_lifts_a_hull_as_hydrostatics_says(kind):
    """The lift is p b / (rho g A) over the water outside, to a tenth of a spacing of 0.02 m.

    The hull of 0.24 m of waterline floats in a tank 2 m long with a chamber of 0.28 m under 100 Pa.
    """
    hull = np.array([[0, -14], [12, -14], [12, 20], [40, 20], [40, -14], [52, -14], [52, 26], [0, 26]]) * 0.01
    changes = {
        "dx": 0.02,
        "t1": 5.0,
        "tank.length": 2.0,
        "scheme.kind": kind,
        "bodies.hull.polygon": (hull + np.array([0.74, 0.4])).tolist(),
        "bodies.hull.mass": 33.6,
        "bodies.hull.centre": [1.0, 0.42],
        "bodies.hull.free": ["heave"],
        "chamber.inner.pto": {"P_a": 100.0, "ramp": 1.0},
    }
    series = js.run(case(**changes)).series
    late = series["time"] > 3.5
    lift, depression = 100.0 * 0.28 / (9810.0 * 0.24), 100.0 / 9810.0
    rise = (0.28 * depression - 0.24 * lift) / 2.0  # of the water outside, in a tank without inflow
    assert np.mean(series["heave_hull"][late]) == pytest.approx(lift + rise, abs=0.002)
    level = np.mean(series["chamber_level_inner"][late])
    assert level == pytest.approx(-depression - lift, abs=0.0024)


@pytest.mark.slow
@pytest.mark.parametrize("key", ["chamber.inner.pto.resistance", "duct.cross.area", "bodies.hull.mass"])
def test_exact_slopes_of_a_floating_device_are_those_of_differences(key):
    """Slopes of the energy that a turbine takes, with two chambers joined by a duct."""
    with enable_x64():
        two = case(
            **{
                "precision": "float64",
                "scheme.tolerance": 1e-11,  # differences need a finer solution
                "t1": 0.2,
                "tank.length": 2.4,
                "bodies.hull.polygon": TWO,
                "bodies.hull.mass": 1.5 * MASS,
                "bodies.hull.centre": [1.08, 0.4],
                "bodies.hull.inertia": 0.3 * MASS,
                "bodies.hull.velocity": [0.2, 0.1, 0.4],
                "chamber.inner.at": 0.9,
                "chamber.outer": {"body": "hull", "at": 1.3},
                "duct.cross": {"between": ["inner", "outer"], "area": 0.02},
                "output.sample_dt": 0.02,
            }
        )
        exact, apart = exact_and_difference(two, key)
    assert exact == pytest.approx(apart, rel=1e-4)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"chamber.inner.body": "buoy"},
            r"chamber.inner.body = 'buoy': there is no such body; choose from hull",
        ),
        ({"chamber.inner.between": ["hull", "far"]}, r"give exactly one of between .* and body"),
        (
            {"chamber.inner.at": 0.5},
            r"chamber.inner.at = 0.5 m is not inside a hollow of the body hull: give a position x",
        ),
        ({"bodies.hull.polygon": HULL[:2] + HULL[4:]}, r"has no hollow at the still water level, z = 0.4 m"),
        (
            {"bodies.hull.polygon": OPEN},
            r"the hollow from x = 0.76 to 1 m is open at the top; add a roof",
        ),
        ({"bodies.hull.polygon": TWO, "tank.length": 2.4}, r"hollows from x = .*; give chamber.inner.at"),
        (
            {"dx": 0.1},
            r"the chamber is .* m long at the still water level, and must be at least three spacings",
        ),
        (
            {"bodies.hull.polygon": [(x, max(z, 0.36)) for x, z in HULL]},
            r"lower edge is at z = 0.36 m, and must be at least two spacings below still water",
        ),
        (
            {"solid.post.block": {"low": [0.84, 0.0], "high": [0.92, 0.56]}},
            r"solid.post pierces the surface in the chamber, from x = 0.84 to 0.92 m",
        ),
        ({"chamber.inner.pto.resistance": None}, r"the air has no outlet|give exactly one of K_dm"),
    ],
)
def test_a_hollow_that_holds_no_air_is_refused(changes, message):
    with pytest.raises(CaseError, match=message):
        js.build(case(**changes))
