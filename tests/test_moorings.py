"""Moorings without water: the catenary, the line of lumped masses, and their energy."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import enable_x64
from hypothesis import given, settings
from hypothesis import strategies as st

import jaxsph as js
from jaxsph.core.roots import increasing_root
from jaxsph.model.links import positive_part
from jaxsph.model.mechanism import Mechanism
from jaxsph.parts.catenary import GroundedCatenary, HangingCatenary
from jaxsph.parts.line import Bed, LumpedLine, Morison
from jaxsph.parts.moorings import FromAnchor, Mooring, QuasiStatic

KINDS = (HangingCatenary, GroundedCatenary)
LENGTH, WEIGHT = 3.1, 0.9


def line(kind=GroundedCatenary, length=LENGTH, weight=WEIGHT, axial_stiffness=1e3, dtype=jnp.float64):
    return kind(*(jnp.asarray(a, dtype) for a in (length, weight, axial_stiffness)))


@eqx.filter_jit
def solved(one, x, z):
    """Forces at the ends, gradient of the energy over x and z, and stiffness."""
    energy = one.energy
    return (
        one.end_forces(jnp.abs(x), z),
        jnp.stack(jax.grad(energy, argnums=(0, 1))(x, z)),
        jnp.array(jax.hessian(energy, argnums=(0, 1))(x, z)),
    )


@eqx.filter_jit
def differences(one, x, z, h):
    """Central differences of the energy over x and z."""
    steps = h * jnp.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
    energy = jax.vmap(lambda step: one.energy(x + step[0], z + step[1]))(steps)
    return (energy[:2] - energy[2:]) / (2.0 * h)


@eqx.filter_jit
def shaped(one, x, z):
    return one.shape(jnp.abs(x), z, jnp.linspace(0.0, one.length, 401))


PLACES = st.tuples(
    st.sampled_from(KINDS),
    st.floats(-3.25, 3.25),
    st.floats(0.01, 3.25),
    st.sampled_from((1e2, 1e3, 1e5)),
).filter(lambda place: np.hypot(place[1], place[2]) < 1.05 * LENGTH)
"""Kind of line, x and z of the fairlead from the anchor (m), axial stiffness (N): slack to 5 % strain."""


@settings(max_examples=60)
@given(PLACES)
def test_a_line_is_in_equilibrium(place):
    """The vertical forces carry what hangs, the curve ends at the fairlead, and the tension follows it."""
    kind, x, z, stiffness = place
    with enable_x64():
        one = line(kind, axial_stiffness=stiffness)
        force, _, _ = solved(one, jnp.asarray(x), jnp.asarray(z))
        points = np.asarray(shaped(one, jnp.asarray(x), jnp.asarray(z)))
    across, up, below = (float(a) for a in force)
    hung = min(up / WEIGHT, LENGTH) if kind is GroundedCatenary else LENGTH
    assert up - below == pytest.approx(WEIGHT * hung, rel=1e-12)
    assert across >= 0.0
    # the smallest span that is solved for is 1e-6 of the length
    np.testing.assert_allclose(points[-1], [abs(x), z], atol=1e-5 * LENGTH)
    if across > 1e-3:
        last = points[-1] - points[-3]
        # chord of two of 400 pieces; the angle of a slack line changes most, here by less than 0.06
        angle = np.arctan2(last[1], last[0])
        assert angle == pytest.approx(np.arctan2(up, across), abs=0.06)
        tension = np.hypot(across, up)
        assert np.linalg.norm(last) <= 2 * LENGTH / 400 * (1.0 + tension / stiffness) * (1 + 1e-9)


@settings(max_examples=60)
@given(PLACES)
def test_the_force_is_the_slope_of_the_energy_and_the_stiffness_is_symmetric(place):
    kind, x, z, stiffness = place
    with enable_x64():
        one = line(kind, axial_stiffness=stiffness)
        force, gradient, hessian = solved(one, jnp.asarray(x), jnp.asarray(z))
        h = 1e-5
        apart = differences(one, jnp.asarray(x), jnp.asarray(z), h)
        size = float(force.across + force.up)
    # the energy of a stiff line has a curvature of stiffness / length, and rounding of 1e-16 of its terms
    near = 1e-6 * size + 1e-3 * h * stiffness / LENGTH
    np.testing.assert_allclose(gradient, apart, atol=near)
    if abs(x) > 1e-3:
        np.testing.assert_allclose(gradient, [np.sign(x) * force.across, force.up], rtol=1e-5, atol=1e-9)
    hessian = np.asarray(hessian)
    np.testing.assert_allclose(hessian, hessian.T, atol=1e-9 * np.abs(hessian).max())
    assert np.linalg.eigvalsh(hessian).min() > -1e-9 * np.abs(hessian).max()


def test_lines_with_a_known_force():
    """Slack on the bed, a hanging end, a vertical and a nearly weightless taut line."""
    with enable_x64():
        slack = line().end_forces(jnp.asarray(1.0), jnp.asarray(0.4))
        # w h = V + V^2 / (2 EA)
        stiffness, weight = 1e3, WEIGHT
        up = stiffness * (np.sqrt(1.0 + 2.0 * weight * 0.4 / stiffness) - 1.0)
        assert float(slack.across) == 0.0 and float(slack.up) == pytest.approx(up, rel=1e-12)
        folded = line(HangingCatenary, axial_stiffness=1e9).end_forces(jnp.asarray(0.0), jnp.asarray(1.0))
        assert float(folded.up) == pytest.approx(0.5 * weight * (LENGTH + 1.0), rel=1e-5)
        for kind in KINDS:
            upright = line(kind).end_forces(jnp.asarray(0.0), jnp.asarray(1.02 * LENGTH))
            tension = stiffness * 0.02 + 0.5 * weight * LENGTH
            assert float(upright.up) == pytest.approx(tension, rel=1e-5)
            taut = line(kind, weight=1e-4).end_forces(jnp.asarray(3.0), jnp.asarray(2.0))
            apart = np.hypot(3.0, 2.0)
            tension = stiffness * (apart / LENGTH - 1.0)
            assert float(taut.across) == pytest.approx(tension * 3.0 / apart, rel=1e-5)
            # half of the weight is carried at either end
            assert float(taut.up) == pytest.approx(tension * 2.0 / apart, rel=1e-5)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("place", [(2.9, 0.38), (2.6, 0.38), (-2.0, 1.5), (3.2, 0.4), (0.02, 3.13)])
def test_slopes_over_the_line_are_those_of_differences(kind, place):
    """Exact slopes of both forces over length, weight and stiffness, forward and reverse."""

    def forces(parameters):
        x, z = (jnp.asarray(a, jnp.float64) for a in place)
        return jnp.stack(jax.grad(kind(*parameters).energy, argnums=(0, 1))(x, z))

    with enable_x64():
        at = jnp.asarray([LENGTH, WEIGHT, 1e3])
        forward, reverse = jax.jacfwd(forces)(at), jax.jacrev(forces)(at)
        steps = np.diag(1e-6 * np.asarray(at))
        found = jax.jit(jax.vmap(forces))(jnp.concatenate([at + steps, at - steps]))
        apart = (found[:3] - found[3:]).T / (2e-6 * np.asarray(at))
        # a slope may be zero: the force of slack does not depend on the length
        scale = np.abs(apart).max(axis=0) + 0.01 * np.abs(forces(at)).max() / np.asarray(at)
    np.testing.assert_allclose(forward / scale, apart / scale, atol=1e-6)
    np.testing.assert_allclose(reverse / scale, forward / scale, atol=1e-10)


@settings(max_examples=80)
@given(PLACES.filter(lambda place: place[3] < 1e5))
def test_float32_agrees_with_float64(place):
    """Positions are rounded to 6e-8; a taut line turns this into its stiffness times so small a strain."""
    kind, x, z, stiffness = place
    single = solved(line(kind, axial_stiffness=stiffness, dtype=jnp.float32), jnp.float32(x), jnp.float32(z))
    with enable_x64():
        double = solved(
            line(kind, axial_stiffness=stiffness),
            jnp.asarray(np.float32(x), float),
            jnp.asarray(np.float32(z), float),
        )
    size = float(np.hypot(double[0].across, double[0].up))
    near = 3e-5 * size + 1e-6 * stiffness * size / (size + WEIGHT)
    np.testing.assert_allclose(np.array(single[0]), np.array(double[0]), atol=near)
    assert np.all(np.isfinite(single[2]))


def test_vectorised_and_compiled_lines_are_those_of_a_loop():
    x, z = jnp.linspace(-3.0, 3.0, 7), jnp.linspace(0.1, 0.9, 7)
    one = line(dtype=jnp.float32)
    grad = jax.grad(one.energy, argnums=(0, 1))
    together = jax.jit(jax.vmap(grad))(x, z)
    each = [grad(a, b) for a, b in zip(x, z, strict=True)]
    np.testing.assert_allclose(np.stack(together, axis=1), np.array(each), rtol=1e-4, atol=1e-5)


@jax.jit
def root_and_slope(a):
    """Root of x + x^3 = a between -3 and 3, and its derivative by a."""
    low, high = jnp.full_like(a, -3.0), jnp.full_like(a, 3.0)
    return jax.value_and_grad(lambda a: increasing_root(lambda x, a: x + x**3 - a, low, high, a))(a)


@given(st.floats(-50.0, 50.0))
def test_roots_of_increasing_functions(shift):
    """The root of x + x^3 = shift, its derivative, and the end of an interval without a root."""

    with enable_x64():
        root, slope = map(float, root_and_slope(jnp.asarray(shift)))
    if abs(shift) < 30.0:
        assert root + root**3 == pytest.approx(shift, abs=1e-12)
        assert slope == pytest.approx(1.0 / (1.0 + 3.0 * root**2), rel=1e-12)
    else:
        assert root == pytest.approx(np.copysign(3.0, shift), rel=1e-6) and slope == 0.0


@settings(max_examples=60)
@given(st.lists(st.floats(-2.0, 2.0), min_size=6, max_size=6), st.booleans())
def test_the_positive_part_of_a_matrix(numbers, equal):
    """Its eigenvalues are the positive ones; its derivative holds for equal eigenvalues, too."""
    with enable_x64():
        matrix = np.eye(2) * numbers[0] if equal else np.array(numbers[:4]).reshape(2, 2)
        change = np.array(numbers[2:]).reshape(2, 2)
        symmetric = 0.5 * (matrix + matrix.T)
        values = np.linalg.eigvalsh(symmetric)
        part, slope = jax.jvp(positive_part, (jnp.asarray(matrix),), (jnp.asarray(change),))
        if np.abs(values).min() > 1e-3:
            apart = (positive_part(matrix + 1e-6 * change) - positive_part(matrix - 1e-6 * change)) / 2e-6
            # the second derivative is at most the change squared over the smallest eigenvalue
            np.testing.assert_allclose(slope, apart, atol=1e-4)
    np.testing.assert_allclose(np.linalg.eigvalsh(part), np.maximum(values, 0.0), atol=1e-12)


def lumped(segments=20, length=2.87, dt=0.004, **changes):
    """A light chain on a firm bed, in float64."""
    d, rho, mass = 0.0036, 1000.0, 0.1214
    area = 0.25 * np.pi * d**2
    weight = (mass - rho * area) * 9.81
    water = (0.5 * rho * d * 2.4, 0.5 * rho * np.pi * d * 1.15, rho * area, 0.0)
    one = LumpedLine(
        at_rest=line(GroundedCatenary, length, weight, 2e3),
        mass=jnp.asarray(mass),
        damping=jnp.asarray(0.5),
        water=Morison(*map(jnp.asarray, water)),
        bed=Bed(*map(jnp.asarray, (0.0, 3e5 * d, 3e4 * d))),
        segments=segments,
    )
    return dataclasses.replace(one, **changes).stepped(dt)


def test_a_line_at_rest_pulls_like_a_catenary_and_stays():
    """The error of straight segments falls with the square of their length (0.3 % for 20 segments)."""
    with enable_x64():
        s, zero = jnp.asarray([2.8, 0.4]), jnp.zeros(2)
        off = []
        for segments in (10, 20, 40):
            one = lumped(segments)
            own = eqx.filter_jit(one.start)(s)
            force = -np.asarray(one.force(own, s, zero, 0.0))  # the step before had no length
            static = one.at_rest.end_forces(s[0], s[1])
            off.append(np.hypot(*force) / np.hypot(static.across, static.up) - 1.0)
        assert abs(off[1]) < 0.004 and abs(off[0]) > 3.0 * abs(off[1])
        one = lumped(20)
        later = jax.jit(lambda own: one.advance(own, s, zero, 0.0, jnp.asarray(0.004)))
        own = eqx.filter_jit(one.start)(s)
        begin = own.x
        own = jax.lax.fori_loop(0, 500, lambda _, own: later(own), own)
        # the nodes around the point of touchdown settle into the bed, whose depth under weight is 1 mm; the
        # quadratic drag leaves a vibration of a tenth of a millimetre
        assert np.abs(own.x - begin).max() < 1.5e-3 and np.abs(own.u).max() < 0.02
        assert float(one.anchor_tension(own, s)) == pytest.approx(float(static.across), rel=0.01)


def moored(law, anchor=(-2.8, -0.4), velocity=0.3):
    """A mechanism of a block of 20 kg that slides along x, on a mooring."""
    joint = js.PlanarJoint.of(("surge",), velocity=(velocity, 0.0, 0.0), dtype=jnp.float64)
    block = js.RigidBody.of(
        js.Block((-0.1, -0.1), (0.1, 0.1)), (0, 0), joint, density=500.0, name="a", dtype=jnp.float64
    )
    ends = FromAnchor("a", jnp.zeros(2), jnp.asarray(anchor))
    return Mechanism((block,), (Mooring(ends, law),))


def march(mechanism, t1, n):
    """Position of the block, energy of block and mooring, and energy taken, after every step."""
    dt, g = jnp.asarray(t1 / n), jnp.zeros(2)

    def step(carry, k):
        parts, taken = carry
        parts, lost, _ = mechanism.step(parts, k * dt, dt, g)
        taken = taken + sum(lost.values())
        energy = sum(mechanism.bodies[0].energy(parts["a"], g)) + mechanism.stored(parts, (k + 1) * dt)
        return (parts, taken), (parts["a"].pose[0], energy, taken)

    start = (mechanism.start(jnp.float64), jnp.zeros(()))
    return [np.asarray(a) for a in jax.jit(lambda s: jax.lax.scan(step, s, jnp.arange(n)))(start)[1]]


def test_a_block_on_a_catenary_keeps_its_energy_and_swings_with_its_period():
    with enable_x64():
        law = QuasiStatic(line(GroundedCatenary, 2.87, 1.09, 2e3))
        x, energy, taken = march(moored(law), 8.0, 8000)
        assert np.ptp(energy) < 1e-4 * 0.5 * 20.0 * 0.3**2 and np.all(taken == 0.0)
        assert np.ptp(x) > 0.1


def test_what_a_line_takes_is_booked():
    """Energy of block and line, and what the line took, stay constant; drag and damping only take."""
    with enable_x64():
        _, energy, taken = march(moored(lumped(dt=0.004), velocity=0.3), 4.0, 1000)
    kinetic = 0.5 * 20.0 * 0.3**2
    # the midpoint rule keeps the energy of the block and the work of the line's force to rounding errors
    np.testing.assert_allclose(energy + taken, energy[0] + taken[0], atol=1e-9 * kinetic)
    assert taken[-1] > 0.02 * kinetic
    # a single step may give back what the mean force of the step before took too much
    assert np.diff(taken).min() > -1e-3 * taken[-1]


def test_a_stiff_line_takes_more_steps_and_stays_stable():
    with enable_x64():
        stiff = lumped()
        stiff = dataclasses.replace(
            stiff, at_rest=dataclasses.replace(stiff.at_rest, axial_stiffness=jnp.asarray(2e5))
        ).stepped(0.004)
        assert 5 * lumped().substeps < stiff.substeps < 200
        x, *_ = march(moored(stiff, velocity=0.1), 0.8, 200)
    assert np.all(np.isfinite(x)) and np.abs(x).max() < 0.1


def test_a_rope_only_pulls():
    """A taut rope is a spring with a damper; a slack rope has no force, and neither has ever a thrust."""
    rope = js.Rope(*map(jnp.float32, (50.0, 2.0, 5.0)))
    for s, v in ((0.1, 0.2), (0.1, -0.2), (0.1, -50.0), (-0.05, 1.0), (-0.05, -1.0)):
        at = jnp.float32(s)
        total = float(-jax.grad(rope.stored, argnums=1)((), at) + rope.force((), at, jnp.float32(v), 0.0))
        taut = 50.0 * s + 2.0 > 0.0
        assert total == pytest.approx(-max(50.0 * s + 2.0 + 5.0 * v, 0.0) if taut else 0.0, abs=1e-4)


def test_ends_along_a_joint_have_the_unit_of_its_coordinate():
    block = js.RigidBody.of(js.Block((0.0, 0.0), (1.0, 1.0)), (0, 0), ("heave",), density=500.0, name="buoy")
    assert [js.AlongJoint.of(block, index).unit for index in range(3)] == ["m", "m", "rad"]
    with pytest.raises(ValueError, match=r"coordinate = 3 of the joint of buoy: must be one of 0 \(surge\)"):
        js.AlongJoint.of(block, 3)


def test_an_accumulator_at_constant_temperature_and_a_full_one():
    """Work of p dV at gamma = 1 is the limit of that for gamma > 1, and a full accumulator stays finite."""

    def hydraulic(gamma):
        return js.HydraulicTakeOff(*map(jnp.float32, (2e-3, 1e4, 5e-4, 1e-8, gamma, 0.01)))

    oil, zero = jnp.float32(2e-4), jnp.float32(0.0)
    work = 1e4 * (5e-4 * np.log(5.0 / 3.0) - 2e-4)
    assert float(hydraulic(1.0).stored(oil, zero)) == pytest.approx(work, rel=1e-4)
    assert float(hydraulic(1.001).stored(oil, zero)) == pytest.approx(work, rel=2e-3)
    full = hydraulic(1.4).advance(oil, zero, jnp.float32(100.0), zero, jnp.float32(1.0))
    assert full < 5e-4 and np.isfinite(hydraulic(1.4).stored(full, zero))
