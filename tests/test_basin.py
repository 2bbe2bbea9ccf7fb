"""Waves over the plan of a basin: fields, zones, the segmented wavemaker, directions and refusals."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import enable_x64
from hypothesis import given, settings
from hypothesis import strategies as st

import jaxsph as js
from jaxsph import analysis
from jaxsph.parts.relaxation import BasinZone, RelaxationZone
from jaxsph.parts.segmented import SegmentedPaddle, Segments
from jaxsph.waves import spectra
from jaxsph.waves.fields import DirectionalSea, LongCrestedWaves
from jaxsph.waves.regular import RegularWaves
from jaxsph.waves.seas import Sea
from jaxsph.waves.theory import stokes3_wavenumber

D, G, WIDTH = 0.5, 9.81, 3.0
ANGLES = st.floats(-1.4, 1.4)


def long_crested(direction, H=1e-6, T=1.3, **more):
    return LongCrestedWaves(
        waves=RegularWaves(H, T, D, **more), direction=jnp.asarray(direction), middle=jnp.asarray(0.5 * WIDTH)
    )


def directional(directions, **more):
    directions = np.asarray(directions, float)
    omega = 2.0 * np.pi / np.linspace(1.1, 1.7, len(directions))
    a = 1e-6 * np.exp(1j * np.arange(len(directions)))
    return DirectionalSea.of(
        a, omega, directions, D, middle=0.5 * WIDTH, dtype=jnp.result_type(float), **more
    )


def at_point(field, p, t):
    """Velocity of a field at one point p (m)."""
    return field.velocity(p[:1], p[1:2], p[2:], t)[:, 0, 0, 0]


@eqx.filter_jit
def potential_flow(field, p, t):
    """Velocity (m/s) and its gradient at p (m), w on the bed; and w, d eta/dt, du/dt and g grad eta at the
    still level."""
    level = p.at[2].set(D)
    return {
        "gradient": jax.jacfwd(at_point, 1)(field, p, t),
        "bed": at_point(field, p.at[2].set(0.0), t)[2],
        "up": at_point(field, level, t)[2],
        "rate": jax.jacfwd(field.elevation, 2)(p[0], p[1], t),
        "force": jax.jacfwd(at_point, 2)(field, level, t)[:2],
        "slope": G * jnp.array(jax.jacfwd(field.elevation, (0, 1))(p[0], p[1], t)),
    }


@settings(max_examples=20, deadline=None)
@given(ANGLES, ANGLES, st.floats(0.0, 4.0), st.floats(0.0, WIDTH), st.floats(0.05, D), st.floats(5.0, 9.0))
def test_fields_are_potential_flow_under_a_linear_surface(one, other, x, y, z, t):
    """No divergence, no rotation (so that the potential obeys Laplace's equation), no flow through the bed;
    w = d eta/dt and du/dt = -g d eta/dx at the still level.

    To 1e-5 of a omega k; the second order of the long-crested waves is kH = 3e-6 of the first.
    """
    with enable_x64():
        for field in (long_crested(one), directional([one, other, 0.3])):
            found = potential_flow(field, jnp.array([x, y, z]), jnp.asarray(t))
            scale = 1e-5 * 1e-6 * 5.0 * 3.0 * 3.0  # of the sum over three waves
            gradient = found["gradient"]
            assert abs(jnp.trace(gradient)) < scale and jnp.max(jnp.abs(gradient)) > 0.0
            assert jnp.max(jnp.abs(gradient - gradient.T)) < scale
            assert abs(found["bed"]) < scale
            assert found["up"] == pytest.approx(float(found["rate"]), abs=scale)
            np.testing.assert_allclose(found["force"], -found["slope"], atol=5.0 * scale)


X, Y, Z = jnp.linspace(-0.2, 2.0, 23), jnp.linspace(0.0, WIDTH, 7), jnp.linspace(0.0, 0.8, 17)


def test_regular_waves_of_a_basin_have_the_length_of_third_order():
    """One of these lengths along their direction, elevation, velocity and wavemaker repeat; in between there
    is no divergence."""
    case = js.Case.from_dict(SMALL)
    field = case.problem().model.dampers[0].field
    waves, T, d = field.waves, case.waves.T, case.tank.depth
    length = 2.0 * np.pi / float(stokes3_wavenumber(case.waves.H, T, d))
    assert length > 1.005 * 2.0 * np.pi / float(waves.k)
    step = length * np.array([np.cos(0.35), np.sin(0.35)])
    here, there = np.array([0.3, 1.4]), np.array([0.3, 1.4]) + step
    # float32 phases of 40 rad are rounded to 4e-6
    a = 0.5 * case.waves.H
    assert float(field.elevation(*here, 6.3)) == pytest.approx(
        float(field.elevation(*there, 6.3)), abs=2e-5 * a
    )
    z = jnp.array([0.1, 0.3])
    u, other = (field.velocity(p[:1], p[1:], z, 6.3) for p in (jnp.asarray(here), jnp.asarray(there)))
    np.testing.assert_allclose(u, other, atol=1e-4 * a * waves.omega)
    gradient = jax.jacfwd(at_point, 1)(field, jnp.array([*here, 0.2]), jnp.asarray(6.3))
    assert abs(jnp.trace(gradient)) < 1e-4 * jnp.max(jnp.abs(gradient))


def test_a_field_along_the_basin_is_that_of_the_flume():
    """Also in the zone: the same velocities, everywhere across the basin, after the first period's start."""
    waves = RegularWaves(0.1, 1.3, D, ramp=2.6)
    field = LongCrestedWaves(waves=waves, direction=jnp.asarray(0.0), middle=jnp.asarray(1.5))
    for t in (1.4, 5.0):
        u, v, w = field.velocity(X, Y, Z, t)
        expected = waves.velocity(X, Z, t)
        np.testing.assert_allclose(u, np.broadcast_to(expected[0][:, None], u.shape), atol=1e-6)
        np.testing.assert_allclose(w, np.broadcast_to(expected[1][:, None], u.shape), atol=1e-6)
        assert not v.any()
        shift = field.mean_displacement(Y, t)
        np.testing.assert_allclose(shift, np.full(len(Y), waves.mean_displacement(t)), atol=1e-7)
    numbers = (2.0, 5.0)
    flume = RelaxationZone(waves, *(jnp.asarray(a) for a in numbers), X, Z)
    basin = zone(field, side_strength=0.0)
    x = jnp.array([[0.0, 1.0, 0.4], [0.53, 0.0, 0.33], [1.9, 2.9, 0.2], [2.5, 2.0, 0.4]])
    ones = jnp.ones_like(x)
    np.testing.assert_allclose(
        basin.damp(x, ones, 5.0, 0.1), flume.damp(x, ones, jnp.asarray(5.0), 0.1), atol=1e-6
    )


def zone(field, **more):
    numbers = {"length": 2.0, "sides": 1.0, "width": WIDTH, "strength": 5.0, "side_strength": 20.0} | more
    return BasinZone(field, *(jnp.asarray(float(a)) for a in numbers.values()), X, Y, Z)


def test_a_sea_in_one_direction_is_the_sea_of_the_flume_turned():
    """Velocity, elevation and the wavemaker's displacement, to the rounding of float32."""
    omega, a = 2.0 * np.pi / np.array([1.3, 1.5]), np.array([0.02, 0.015j])
    sea = Sea.of(a, omega, D, 0.0, second_order_piston=False)
    turned = LongCrestedWaves(waves=sea, direction=jnp.asarray(0.4), middle=jnp.asarray(1.5))
    other = DirectionalSea.of(a, omega, np.full(2, 0.4), D, middle=1.5)
    t = jnp.asarray(7.0)
    np.testing.assert_allclose(other.velocity(X, Y, Z, t), turned.velocity(X, Y, Z, t), atol=2e-6)
    np.testing.assert_allclose(other.elevation(0.3, Y, t), turned.elevation(0.3, Y, t), atol=1e-6)
    np.testing.assert_allclose(other.mean_displacement(Y, t), turned.mean_displacement(Y, t), atol=1e-6)


@pytest.mark.parametrize("direction", [-0.7, 0.35])
def test_the_wavemaker_supplies_the_flow(direction):
    """Its velocity is the depth-averaged u at x = 0, to second order and 0.3 % of the integration."""
    with enable_x64():
        waves = RegularWaves(1e-5, 1.3, D)
        fields = [
            LongCrestedWaves(waves=waves, direction=jnp.asarray(direction), middle=jnp.asarray(1.5)),
            directional([direction, 0.2]),
        ]
        z = jnp.linspace(0.0, D, 41)
        for field in fields:
            rate = jax.jacfwd(lambda t, f=field: f.mean_displacement(Y, t))(6.0)
            flow = jnp.trapezoid(field.velocity(jnp.zeros(1), Y, z, 6.0)[0, 0], z, axis=1) / D
            np.testing.assert_allclose(rate, flow, atol=3e-3 * np.max(np.abs(flow)))


def test_waves_start_from_rest_everywhere():
    """Also where their ramp begins before t = 0."""
    field = long_crested(0.8, H=0.1, ramp=0.5)
    shift, rate = jax.jvp(lambda t: field.mean_displacement(Y, t), (0.0,), (1.0,))
    assert not shift.any() and not rate.any()
    assert not field.velocity(X, Y, Z, 0.0).any()


def test_zones_along_the_sides_fade_into_the_basin_and_pass_the_waves():
    field = long_crested(0.35, H=0.1)
    basin = zone(field)
    x = jnp.array([[3.0, 0.0, 0.3], [3.0, 0.5, 0.3], [3.0, 1.0, 0.3], [3.0, 1.5, 0.3], [3.0, 2.9, 0.3]])
    rate = np.asarray(basin.rate(x))
    assert rate[0] == 20.0 and rate[1] == pytest.approx(10.0) and not rate[2:4].any() and rate[4] > 19.0
    there = basin.asked(x.at[:, 0].set(1.0), 6.0)
    np.testing.assert_allclose(basin.damp(x.at[:, 0].set(1.0), there, 6.0, 0.1), there, atol=1e-6)


@pytest.mark.parametrize("key", ["direction", "waves.H", "waves.T"])
def test_a_zone_depends_smoothly_on_its_waves(key):
    """Slope of the relaxed velocities against a central difference, to 1e-3: the zone's grid is in float32,
    whose rounding the difference magnifies."""

    def relaxed(value):
        field = eqx.tree_at(
            lambda f: functools.reduce(getattr, key.split("."), f), long_crested(0.35, H=0.1), value
        )
        return zone(field).damp(jnp.array([[0.4, 0.3, 0.3], [1.0, 2.8, 0.1]]), jnp.zeros((2, 3)), 6.0, 0.1)

    with enable_x64():
        at = {"direction": 0.35, "waves.H": 0.1, "waves.T": 1.3}[key]
        slope = jax.jacfwd(relaxed)(jnp.asarray(at))
        difference = (relaxed(jnp.asarray(at + 1e-4)) - relaxed(jnp.asarray(at - 1e-4))) / 2e-4
        np.testing.assert_allclose(slope, difference, atol=1e-3 * np.max(np.abs(slope)))
        assert np.max(np.abs(slope)) > 1e-2


def test_faces_of_a_segmented_wavemaker():
    """Linear between joints, mirrored behind the side walls, as the water's mirror images need."""
    paddle = SegmentedPaddle(field=long_crested(0.35), y=jnp.array([0.0, 1.0, 2.0]), rows=(0, 0))
    motion = Segments(jnp.array([0.1, 0.2, 0.4]), jnp.array([0.0, 1.0, -1.0]))
    x = jnp.array([[0.05, 0.5, 0.1], [0.5, -0.5, 0.1], [0.3, 1.5, 0.1], [0.5, 2.5, 0.1]])
    np.testing.assert_allclose(paddle.shift(motion, x), [0.15, 0.15, 0.3, 0.3], atol=1e-6)
    np.testing.assert_allclose(paddle.velocity(motion, x)[:, 0], [0.5, 0.5, 0.0, 0.0], atol=1e-6)
    assert np.array_equal(paddle.contains(motion, x, 0.05), [True, False, False, False])
    assert paddle.read(motion, 0.0)["paddle"] == pytest.approx(0.2)


# --------------------------------------------------------------------------- directions of seas


@pytest.mark.parametrize("exponent", [3.0, 10.0, 75.0])
def test_spreading_has_its_mean_and_spread(exponent):
    """The circular standard deviation of cos^2s(theta/2) is sqrt(2/(s + 1)), to the rule of 500 quantiles."""
    theta = spectra.spread_directions(500, exponent, 3, (-np.pi, np.pi))
    mean = np.mean(np.exp(1j * theta))
    assert abs(np.angle(mean)) < 1e-6
    assert np.sqrt(2.0 * (1.0 - abs(mean))) == pytest.approx(np.sqrt(2.0 / (exponent + 1.0)), rel=2e-3)
    again, other = (spectra.spread_directions(500, exponent, seed, (-np.pi, np.pi)) for seed in (3, 4))
    assert np.array_equal(theta, again) and not np.array_equal(theta, other)
    assert np.array_equal(np.sort(theta), np.sort(other))


def test_energy_beyond_the_limits():
    """cos^2(theta/2) beyond a right angle: 1/2 - 1/pi."""
    assert spectra.spread_beyond(1.0, (-0.5 * np.pi, 0.5 * np.pi)) == pytest.approx(
        0.5 - 1.0 / np.pi, abs=1e-6
    )
    theta = spectra.spread_directions(50, 1.0, 0, (-1.0, 0.5))
    assert -1.0 < theta.min() < theta.max() < 0.5


GAUGES = np.array([[1.0, 0.0], [1.6, 0.1], [1.2, 0.5]])


@settings(max_examples=20, deadline=None)
@given(st.floats(-3.1, 3.1), st.integers(0, 100))
def test_direction_of_waves_from_three_gauges(direction, seed):
    """With noise of a twentieth of the amplitude on each of 100 samples: five standard errors of the phase,
    5 sqrt(2/100)/20 over k times 0.5 m."""
    t, k, T = np.arange(100) * 0.05, 3.0, 1.25
    phase = k * GAUGES @ [np.cos(direction), np.sin(direction)]
    clean = 0.04 * np.cos(2.0 * np.pi / T * t - phase[:, None])
    found = analysis.wave_direction(clean, GAUGES, t, T, D)
    assert np.angle(np.exp(1j * (found.direction - direction))) == pytest.approx(0.0, abs=1e-9)
    assert found.height == pytest.approx(0.08) and found.wavenumber == pytest.approx(k)
    noise = 0.002 * np.random.default_rng(seed).standard_normal(clean.shape)
    found = analysis.wave_direction(clean + noise, GAUGES, t, T, D)
    assert abs(np.angle(np.exp(1j * (found.direction - direction)))) < 0.035
    assert found.height == pytest.approx(0.08, rel=0.03)


@pytest.mark.parametrize(
    ("x", "words"),
    [
        (GAUGES[:2], "to find the direction of the waves, use at least three gauges, not 2"),
        ([[0.0, 0.0], [0.5, 0.0], [1.0, 0.01]], "nearly on one line"),
        (
            [[0.0, 0.0], [1.2, 0.0], [0.0, 1.2]],
            "1.2 m from the most central gauge: .* half of the shortest wavelength, 1.09 m",
        ),
        ([0.0, 0.5, 1.0], r"x the shape \(3,\)"),
    ],
)
def test_gauges_that_give_no_direction_are_refused(x, words):
    x = np.array(x)
    t = np.arange(100) * 0.05
    phase = 3.0 * (x @ [0.8, 0.6] if x.ndim == 2 else x)
    with pytest.raises(ValueError, match=words):
        analysis.wave_direction(np.cos(2.0 * np.pi / 1.25 * t - phase[:, None]), x, t, 1.25, D)


def test_mean_direction_of_a_directional_sea():
    """To a tenth of the spread: 64 peak periods have some 50 independent directions in their peak."""
    a, omega = spectra.draw_sea(spectra.JONSWAP(0.04, 1.4), 128.0 * 1.4, 1)
    theta = 0.3 + spectra.spread_directions(len(a), 12.0, 1, (-1.0, 1.0))
    field = DirectionalSea.of(a, omega, theta, D)
    t = np.arange(0.0, 128.0 * 1.4, 0.1)
    eta = np.stack([field.elevation(float(x), float(y), t) for x, y in 0.3 * GAUGES])
    found = analysis.sea_direction(eta, 0.3 * GAUGES, t, D, f=(0.5 / 1.4, 2.5 / 1.4))
    energy = np.abs(a) ** 2
    mean = np.sum(energy * np.exp(1j * theta)) / np.sum(energy)
    assert found.direction == pytest.approx(np.angle(mean), abs=0.02)
    assert found.spread == pytest.approx(np.sqrt(2.0 * (1.0 - abs(mean))), rel=0.05)
    assert found.direction == pytest.approx(0.3, abs=0.04)
    with pytest.raises(
        ValueError, match="only 0 frequencies of the record are between .* use a longer record"
    ):
        analysis.sea_direction(eta[:, :50], 0.3 * GAUGES, t[:50], D, f=(0.5, 0.6))


# --------------------------------------------------------------------------- cases

SMALL = {
    "dx": 0.1,
    "t1": 0.2,
    "tank": {"length": 4.0, "width": 3.2, "depth": 0.4},
    "scheme": {"kind": "incompressible"},
    "waves": {"H": 0.08, "T": 1.0, "direction": 0.35, "zone": 1.0, "side_zones": 0.8},
    "output": {"sample_dt": 0.04},
}
STILL = {key: value for key, value in SMALL.items() if key != "waves"} | {"sponge": {"length": 0.5}}
WAVES = {"H": 0.08, "T": 1.0}
BUOY = {
    "body": {"sphere": {"centre": [2.0, 1.6, 1.0], "radius": 0.5}},
    "tank": {"length": 4.0, "width": 3.2, "depth": 1.0},
}
SEA_STATE = {"kind": "irregular", "Hs": 0.1, "Tp": 3.0, "zone": 3.0, "second_order": False}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"tank.width": None},
            r"waves.direction = 0.35 rad needs a tank in three dimensions: give tank.width",
        ),
        ({"waves.zone": None}, r"waves.direction = 0.35 rad: the paddle makes only waves along the tank"),
        ({"waves.direction": 20.0}, r"waves.direction = 20.0: must be between -pi/2 and pi/2 rad"),
        ({"waves.direction": -1.5708}, r"between -pi/2 and pi/2 rad, because waves travel into the tank"),
        ({"probes.gauges": [1.0]}, r"probes.gauges = .* averages across the tank, .* use probes.surface"),
        (
            {"waves.direction": 0.0, "waves.zone": None},
            r"waves.side_zones = 0.8 m: the zones need waves.zone",
        ),
        ({"waves.side_zones": 0.3}, r"waves.side_zones = 0.3 m: must be at least a quarter .* 0.366 m"),
        ({"waves.side_zones": 1.5}, r"leave less than a tenth of the width of 3.2 m"),
        (
            {"solid.post.block": {"low": [2.0, 0.5, 0.0], "high": [2.5, 1.5, 0.8]}},
            r"waves.side_zones = 0.8 m: .* from y = 0 to 0.8 m covers the solid post, from 0.5 to 1.5 m",
        ),
        ({"waves.spreading": 10.0}, r'waves.spreading belongs to waves.kind = "irregular"'),
        (
            {"waves": SEA_STATE | {"spreading": 10.0, "second_order": True}},
            r"is generated to first order only; set second_order",
        ),
        ({"waves": SEA_STATE | {"spreading": 1.0}}, r"of the energy would travel at more than 1.4 rad"),
        ({"waves.heading": 0.3}, r"the direction of waves is `waves.direction`, rad"),
        ({"waves.sides": 0.3}, r"absorption at the side walls: .* give `waves.side_zones`"),
    ],
)
def test_waves_that_a_basin_cannot_have_are_refused(changes, words):
    with pytest.raises(js.CaseError, match=words):
        js.Case.from_dict(SMALL).replace(changes)


def test_side_walls_that_reflect_are_noticed():
    case = js.Case.from_dict(SMALL)
    assert not any("side walls" in note for note in case.notices())
    bare = case.replace({"waves.side_zones": None})
    assert any("direction = 0.35 rad: the side walls reflect" in note for note in bare.notices())


def test_a_directional_sea_is_built():
    """Its field has the directions of the section, about the middle of the basin."""
    sea = SEA_STATE | {"Hs": 0.05, "spreading": 20.0, "direction": 0.2, "duration": 60.0, "zone": 3.5}
    case = js.Case.from_dict(SMALL | {"waves": sea, "tank": {"length": 8.0, "width": 2.0, "depth": 0.4}})
    (paddle,) = case.problem().model.moving
    assert isinstance(paddle.field, DirectionalSea) and float(paddle.field.middle) == 1.0
    theta = np.arctan2(*np.asarray(paddle.field.k).T[::-1])
    np.testing.assert_allclose(theta, case.waves.directions(len(theta)), atol=1e-5)
    assert np.mean(theta) == pytest.approx(0.2, abs=0.01)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"sponge.sides": 0.4, "waves": WAVES}, r"sponge.sides = 0.4 m would damp .* waves.side_zones, a"),
        ({"sponge.near": 0.4, "waves": WAVES}, r"sponge.near = 0.4 m would damp .* give waves.zone, a"),
        ({"sponge.sides": 0.4, "tank.width": None}, r"sponge.sides = 0.4 m needs a tank in three dim"),
        ({"sponge.sides": 1.6}, r"sponge.sides = 1.6 m: must be less than half the width of 3.2 m"),
        ({"sponge.near": 3.5}, r"sponge.length \+ sponge.near = 4 m: must together be shorter than .* \(4 m"),
        ({"sponge.sides": 1.2} | BUOY, r"the zone from y = 0 to 1.2 m covers the body, from 1.1 to 2.1 m"),
        ({"sponge.near": 1.6} | BUOY, r"the zone from x = 0 to 1.6 m covers the body, from 1.5 to 2.5 m"),
    ],
)
def test_sponges_that_a_tank_cannot_have_are_refused(changes, words):
    with pytest.raises(js.CaseError, match=words):
        js.Case.from_dict(STILL).replace(changes)


def test_sponge_damps_along_every_wall_it_is_given():
    """Rates grow as the square of the distance into the layer, and the higher of two rates counts."""
    (sponge,) = (
        js.Case.from_dict(STILL | {"sponge": {"length": 0.5, "near": 1.0, "sides": 0.8}})
        .problem()
        .model.dampers
    )
    # in the middle, halfway into each of the layers, whose ends are a spacing (0.1 m) behind the walls
    middle, half = (2.0, 1.6), ((0.45, 1.6), (3.8, 1.6), (2.0, 0.35), (2.0, 2.85))
    x = np.array([(*point, 0.2) for point in (middle, *half, (0.45, 0.0))])
    rates = (1.0 - np.asarray(sponge.factor(x, 1e-3))) / 1e-3
    # float32 rounds 1 - dt times the rate to 6e-8, so the rates to 6e-5
    np.testing.assert_allclose(rates, [0.0, 2.5, 2.5, 2.5, 2.5, 10.0 * (8 / 9) ** 2], atol=2e-4)


def test_zone_and_sponge_book_the_energy_they_exchange():
    """In a flume with long time steps; what is left is the rounding of sums in float32.

    An energy booked from the velocities just before and after the damping, and not from the means over the
    step with which the particles move, would leave a hundredth of the kinetic energy.
    """
    flume = {
        "dx": 0.05,
        "t1": 1.2,
        "tank": {"length": 3.0, "depth": 0.4},
        "scheme": {"kind": "incompressible"},
        "waves": {"H": 0.08, "T": 1.0, "zone": 1.0, "ramp_periods": 0.5},
        "sponge": {"length": 1.0},
        "output": {"sample_dt": 0.04},
    }
    done = js.run(js.Case.from_dict(flume), progress=False)
    assert min(abs(float(done.state.ledger[name].total)) for name in ("zone", "sponge")) > 0.0
    assert abs(done.results["energy_residual"]) < 2e-4 * max(done["kinetic"])


@pytest.mark.slow
def test_a_basin_runs_and_books_its_energy():
    """Oblique waves over a period: the budget closes to rounding, and the water moves as asked.

    A correlation of 0.9 leaves room for the lag of the start and for a depth of only four particles.
    """
    case = js.Case.from_dict(SMALL).replace({"t1": 1.24, "waves.ramp_periods": 0.5})
    done = js.run(case, progress=False)
    assert done.state.ledger["zone"].total != 0.0
    assert abs(done.results["energy_residual"]) < 2e-4 * max(abs(done["kinetic"]))
    model, water = done.model, done.state.particles
    t = model.t0 + done.state.step * model.dt
    near = (water.x[:, 0] < 0.3) & (water.x[:, 2] < 0.3)
    asked = model.dampers[0].asked(water.x, t)[near]
    for axis in range(3):
        assert np.corrcoef(asked[:, axis], water.u[near][:, axis])[0, 1] > 0.9
