"""Thin plates in any direction, and the level of the water at walls of dummy particles."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import jaxsph as js
from jaxsph.errors import CaseError
from jaxsph.output.run_file import RunFile
from jaxsph.solids.box import LeaningPlate, WallPlate
from jaxsph.solids.divisions import DiagonalDivision, FivePartDivision, HorizontalDivision, Regions

DX = 0.04
PLATE = {"foot": [0.6, 0.2], "head": [1.05, 0.46], "thickness": 0.04}
TANK = js.Case.from_dict(
    {
        "name": "screen",
        "dx": DX,
        "t1": 1.0,
        "scheme": {"kind": "incompressible"},
        "tank": {"length": 1.6, "depth": 0.4},
        "solid": {"screen": {"plate": PLATE}},
    }
)


@pytest.fixture(scope="module")
def model():
    """Model of the tank with the leaning plate."""
    return js.build(TANK)[0]


@pytest.mark.parametrize("division", [DiagonalDivision(), HorizontalDivision(), FivePartDivision()])
def test_an_upright_plate_of_any_direction_is_an_upright_plate(division):
    """Foot and head of an upright plate divide the water as the tip of a `WallPlate` does, up to the head."""
    x = jnp.asarray(np.random.default_rng(1).uniform((0.8, 0.0), (1.2, 0.9), (4000, 2)), jnp.float32)
    upright = Regions((WallPlate(0.98, 1.02, 0.3),), division)
    leaning = Regions((), division, (), (LeaningPlate((1.0, 0.3), (1.0, 3.0), 0.04),))
    np.testing.assert_array_equal(upright.index(x), leaning.index(x))
    assert upright.count == leaning.count and upright.sets == leaning.sets


@given(angle=st.floats(-3.1, 3.1), seed=st.integers(0, 2**16))
def test_no_pair_across_a_plate_sees_each_other(angle, seed):
    """Particles on different sides of a plate do not interact, whatever the direction of the plate."""
    rng = np.random.default_rng(seed)
    along = np.array([np.cos(angle), np.sin(angle)])
    aside = np.array([along[1], -along[0]])
    foot = rng.uniform(-1.0, 1.0, 2)
    plate = LeaningPlate(tuple(foot), tuple(foot + 0.5 * along), 0.02)
    regions = Regions((), HorizontalDivision(), (), (plate,))
    where, off = rng.uniform(0.05, 0.45, (2, 40, 1)), rng.uniform(0.02, 0.1, (2, 40, 1))
    right, left = (foot + where[k] * along + side * off[k] * aside for k, side in ((0, 1.0), (1, -1.0)))
    kinds, sees = [], []
    for x in (right, left):
        region = regions.index(jnp.asarray(x, jnp.float32))
        kinds.append(np.asarray(regions.kind(region)))
        sees.append(np.asarray(regions.sees(region)))
    assert not (kinds[0][:, None] & sees[1]).any() and not (kinds[1][:, None] & sees[0]).any()
    assert (kinds[0][:, None] & sees[0]).all()


def test_each_face_of_a_plate_has_a_full_depth_of_dummies(model):
    """Dummies behind either face fill the kernel's reach, and only the water on that side sees them."""
    (plate,), walls = model.walls.regions.leaning, model.walls
    (body,) = model.bodies
    rows = slice(*body.rows)
    x, volume, kind = (np.asarray(a[rows], float) for a in (walls.x, walls.volume, walls.kind))
    across = np.asarray(plate.across(tuple(jnp.asarray(x.T))))
    depth = int(np.ceil(float(model.scheme.smoothing.radius) / DX - 0.5)) * DX
    for which, side in ((0, -1.0), (1, 1.0)):
        mine = kind == walls.regions.set_kind(which)
        assert volume[mine].sum() == pytest.approx(plate.length * depth, rel=1e-3)
        inward = 0.5 * plate.thickness - side * across[mine]
        assert 0.4 * DX < inward.min() and inward.max() < depth
    inside = kind == walls.regions.set_kind(2)
    assert np.abs(across[inside]).max() < 0.5 * plate.thickness


def test_a_plate_s_dummies_go_on_where_it_is_held(model):
    """None lie beyond a free end; at the bed they continue below it, as deep as the kernel reaches."""
    held = js.build(TANK.replace({"solid.screen.plate.foot": [0.6, 0.0]}))[0]
    for one, past in ((model, False), (held, True)):
        (plate,), (body,) = one.walls.regions.leaning, one.bodies
        x = np.asarray(one.walls.x[slice(*body.rows)], float)
        x = x[x[:, -1] > 0]
        beyond = (x - np.asarray(plate.foot)) @ np.asarray(plate.along) < -1e-6
        assert beyond.any() == past


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"solid.screen.plate.thickness": 0.01}, "solid.screen.plate.thickness = 0.01 m is less than half"),
        ({"solid.screen.plate.head": [0.62, 0.22]}, "solid.screen.plate is 0.02828 m long"),
        ({"solid.screen.plate.head": [1.7, 0.4]}, "solid.screen extends outside the tank"),
        (
            {"solid.screen.disc": {"centre": [1.0, 0.2], "radius": 0.1}},
            "block, polygon, disc, sphere, .* mesh and plate",
        ),
        (
            {"solid.step.block": {"low": [0.6, 0.0], "high": [1.2, 0.4]}},
            "solid.screen and solid.step have .* m2 in common",
        ),
        (
            {
                f"solid.s{k}.plate": {"foot": [0.2 * k, 0.0], "head": [0.2 * k, 0.44], "thickness": 0.04}
                for k in (1, 2, 6)
            },
            "solid: 4 plates make 81 regions .* use fewer",
        ),
        ({"body.plate": PLATE}, "unknown key 'body.plate'"),
    ],
)
def test_a_plate_that_does_not_fit_is_refused(changes, message):
    """The message names the section and says what to do."""
    with pytest.raises(CaseError, match=message):
        TANK.replace(changes).problem()


@jax.jit
def _volumes(model, state):
    """Volumes of the ghosts in a state, m2."""
    state, tables = model.scheme.prepare(model, state)
    return model.scheme.place_ghosts(model, state, tables).V


def _wet(model, state):
    """Share `[G]` of every ghost's volume that is wet."""
    return np.asarray(_volumes(model, state) / model.walls.volume, float)


@pytest.mark.parametrize("rise", [-0.3, 0.0, 0.25])
def test_dummies_of_an_upright_wall_end_at_the_level(upright, rise):
    """Dummies above a level that is `rise` spacings higher are dry; in the cell at the level they are partly
    wet.

    The share is right to an eighth: the mean height of three rows of particles is not quite that of water.
    """
    model, state = upright
    higher = state.particles.x.at[:, 1].multiply(1.0 + rise * DX / 0.4)
    wet, x = (
        _wet(model, eqx.tree_at(lambda s: s.particles.x, state, higher)),
        np.asarray(model.walls.x, float),
    )
    first = (x[:, 0] < 0.0) & (x[:, 0] > -DX) & (x[:, 1] > 0.0)
    expected = np.clip((0.4 + rise * DX - x[first, 1]) / DX + 0.5, 0.0, 1.0)
    np.testing.assert_allclose(wet[first], expected, atol=0.125)


@pytest.fixture(scope="module")
def upright():
    """Model and state of still water between upright walls of dummies."""
    return js.build(TANK.replace({"solid": None, "tank.walls": "dummy"}))


def test_dummies_over_the_surface_are_dry_under_a_roof_too():
    """A plate that rises out of the water at 30 degrees does not push the water from above where it is dry.

    Well below the surface, and in a block there, all dummies are wet.
    """
    block = {"low": [0.16, 0.12], "high": [0.48, 0.24]}
    model, state = js.build(TANK.replace({"solid.block.block": block}))
    wet, x = _wet(model, state), np.asarray(model.walls.x, float)
    of = {body.name: np.arange(len(x))[slice(*body.rows)] for body in model.bodies}
    (plate,), screen = model.walls.regions.leaning, of["screen"]
    face = plate.foot[1] + (x[screen] - np.asarray(plate.foot)) @ np.asarray(plate.along) * plate.along[1]
    over, sees = x[screen, 1] > 0.4 + 0.75 * DX, np.asarray(model.walls.brim.full)[screen] > 0.02
    under = sees & (face < 0.4 - DX)
    assert over.sum() > 10 and under.sum() > 10
    assert wet[screen[over]].max() < 0.2 and wet[screen[under]].min() > 0.8
    np.testing.assert_array_equal(wet[of["block"]], 1.0)


@pytest.mark.slow
def test_the_air_of_a_chamber_moves_no_level_under_a_roof():
    """Under a wall that leans over a chamber, the level follows from the pressure in excess of the air's.

    With suction of 1.5 spacings of water in the chamber's air and water, as many dummies are wet. The scheme
    is weakly compressible, because the pressure of the incompressible scheme already excludes the air's.
    """
    front = {"polygon": [[0.2, 0.28], [0.36, 0.28], [1.2, 0.6], [1.04, 0.6]]}
    parts = {
        "solid": {"front": front},
        "chamber.column": {"between": ["front", "far"], "pto": {"K_dm": 10.0}},
    }
    model, state = js.build(TANK.replace(parts | {"scheme.kind": "weakly_compressible"}))
    (chamber,), p = model.chambers, state.particles
    head = 1.5 * DX * 9.81 * 1000.0

    def under(P_a):
        """State of still water below air of this pressure (Pa), with an unchanged surface."""
        air = P_a * chamber.weight((p.x[:, 0], p.x[:, 1]))
        own = eqx.tree_at(lambda a: a.P_a, state.parts["column"], jnp.asarray(P_a, jnp.float32))
        here = eqx.tree_at(lambda s: s.parts, state, {**state.parts, "column": own})
        return eqx.tree_at(lambda s: s.particles.rho, here, p.rho + air / model.scheme.c0**2)

    dry = _wet(model, under(0.0))
    assert 10 < (dry < 0.5).sum() < len(dry) - 10
    np.testing.assert_allclose(_wet(model, under(-head)), dry, atol=1e-3)


@pytest.mark.slow
def test_still_water_around_a_leaning_plate_stays_still(tmp_path):
    """From 1 to 4 s no particle is faster than 1.5 % of sqrt(g d), a speed due to sloshing as the water
    settles.

    If dummies reached above the surface, a jet of 4 % would run along the plate.
    """
    out = tmp_path / "plate.h5"
    js.run(TANK.replace({"dx": 0.02, "t1": 4.0}), out=out)
    series = RunFile.open(out).series()
    assert series["max_speed"][series["time"] > 1.0].max() < 0.015 * np.sqrt(9.81 * 0.4)
