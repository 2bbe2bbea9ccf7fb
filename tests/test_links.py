"""Links without water: springs, dampers, friction, stops, latches, hydraulics, and their energy."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import enable_x64
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import jaxsph as js
from jaxsph.model.mechanism import Mechanism

F = jnp.float64
MASS = 500.0 * 0.2 * 0.2
"""Mass of the sliding blocks, kg/m."""


def slider(name="a", x=0.0, free=("surge",), velocity=0.0):
    """A block that slides along x."""
    joint = js.PlanarJoint.of(free, velocity=(velocity, 0.0, 0.0), dtype=F)
    block = js.Block((x - 0.1, -0.1), (x + 0.1, 0.1))
    return js.RigidBody.of(block, (0, 0), joint, density=500.0, name=name, dtype=F)


def leaf(*values):
    return tuple(jnp.asarray(value, F) for value in values)


def along(law, body="a"):
    return js.Link(js.AlongJoint(body, 0, "m"), law)


def march(mechanism, t1, n, g=(0.0, 0.0)):
    """Positions of the first body, energy of bodies and links, and energy taken, at each of n steps to t1.

    The kicks and drifts are those of a scheme, without the water's pressure.
    """
    dt, g = jnp.asarray(t1 / n, F), jnp.asarray(g, F)
    first = mechanism.bodies[0].name

    def step(carry, k):
        parts, taken = carry
        t = k * dt
        parts, lost, _ = mechanism.step(parts, t, dt, g)
        taken = taken + sum(lost.values())
        energy = sum(sum(one.energy(parts[one.name], g)) for one in mechanism.bodies)
        energy = energy + mechanism.stored(parts, t + dt)
        forces = {link.name: parts[link.name].force for link in mechanism.links}
        return (parts, taken), (parts[first].pose[0], parts[first].velocity[0], energy, taken, forces)

    start = mechanism.start(F)
    begin = (start, jnp.zeros((), F))
    _, found = jax.jit(lambda s: jax.lax.scan(step, s, jnp.arange(n)))(begin)
    return (dt * np.arange(1, n + 1), *map(np.asarray, found[:4]), found[4])


def test_a_spring_swings_with_its_period_and_keeps_its_energy():
    with enable_x64():
        k = 80.0
        mechanism = Mechanism((slider(velocity=1.0),), (along(js.Spring(*leaf(k, 0.0))),))
        t, x, _, energy, taken, _ = march(mechanism, 20.0, 8000)
    omega = np.sqrt(k / MASS)
    np.testing.assert_allclose(x, np.sin(omega * t) / omega, atol=2e-3)
    np.testing.assert_allclose(energy, 0.5 * MASS, rtol=1e-4)
    assert np.abs(taken).max() == 0.0


def test_a_spring_a_thousand_times_too_stiff_stays_bounded():
    """Explicit steps are stable up to omega dt = 2; here it is 63, and the step neither grows nor damps."""
    with enable_x64():
        dt = 0.01
        k = MASS * (2.0 / dt) ** 2 * 1000.0
        mechanism = Mechanism((slider(velocity=1.0),), (along(js.Spring(*leaf(k, 0.0))),))
        _, x, v, energy, *_ = march(mechanism, 10.0, 1000)
    assert np.abs(v).max() < 1.0 + 1e-6
    assert np.abs(x).max() < 1.1 * dt
    assert energy.max() < 1000.0 * 0.5 * MASS


def test_a_damper_slows_exponentially_and_takes_the_energy():
    with enable_x64():
        c = 30.0
        mechanism = Mechanism((slider(velocity=1.0),), (along(js.Damper(*leaf(c, 0.0))),))
        t, _, v, energy, taken, _ = march(mechanism, 2.0, 4000)
    np.testing.assert_allclose(v, np.exp(-c / MASS * t), atol=1e-3)
    np.testing.assert_allclose(energy + taken, 0.5 * MASS, rtol=1e-9)


def test_a_quadratic_damper_slows_hyperbolically():
    with enable_x64():
        c = 30.0
        mechanism = Mechanism((slider(velocity=1.0),), (along(js.Damper(*leaf(0.0, c))),))
        t, _, v, *_ = march(mechanism, 2.0, 4000)
    np.testing.assert_allclose(v, 1.0 / (1.0 + c / MASS * t), atol=1e-3)


def test_friction_stops_after_the_distance_of_coulomb():
    with enable_x64():
        size = 5.0
        mechanism = Mechanism((slider(velocity=1.0),), (along(js.Friction(*leaf(size, 1e-3))),))
        _, x, v, *_ = march(mechanism, 10.0, 5000)
    assert x[-1] == pytest.approx(0.5 * MASS / size, rel=0.01)
    assert abs(v[-1]) < 1e-6


def test_end_stops_send_back_with_the_same_speed():
    with enable_x64():
        mechanism = Mechanism((slider(velocity=1.0),), (along(js.EndStops(*leaf(-0.2, 0.2, 1e4))),))
        _, x, v, *_ = march(mechanism, 5.0, 10_000)
    assert np.abs(x).max() < 0.2 + 1.01 * np.sqrt(MASS / 1e4)
    inside = np.abs(x) < 0.19
    np.testing.assert_allclose(np.abs(v[inside]), 1.0, atol=0.01)
    assert np.sum(np.diff(np.sign(v)) != 0) == 9  # five metres at 0.4 m and a bounce each


def test_a_latch_holds_at_every_reversal_and_lets_go():
    with enable_x64():
        k, hold = 80.0, 0.4
        laws = js.Laws((js.Spring(*leaf(k, 0.0)), js.Latch(*leaf(hold, 1e6))))
        t, x, v, energy, taken, _ = march(Mechanism((slider(velocity=1.0),), (along(laws),)), 12.0, 24_000)
    still = np.abs(v) < 1e-3
    begins = t[1:][still[1:] & ~still[:-1]]
    begins = begins[np.diff(begins, prepend=-1.0) > 0.1]  # the step that crosses zero is still, too
    half = np.pi / np.sqrt(k / MASS)
    np.testing.assert_allclose(np.diff(begins)[:4], half + hold, rtol=0.02)
    assert np.ptp(x[still & (t > begins[0]) & (t < begins[0] + hold)]) < 1e-3
    np.testing.assert_allclose(energy + taken, energy[0] + taken[0], rtol=1e-4)


def test_hydraulics_balance_their_energy():
    """What the cylinder takes from the motion is in the accumulator or has gone through the motor."""
    with enable_x64():
        hydraulic = js.HydraulicTakeOff(*leaf(2e-3, 1e4, 2e-3, 1e-8, 1.4, 1e-2))
        laws = js.Laws((js.Spring(*leaf(400.0, 0.0)), hydraulic))
        mechanism = Mechanism((slider(velocity=1.5),), (along(laws),))
        _, _, _, energy, taken, _ = march(mechanism, 6.0, 12_000)
    np.testing.assert_allclose(energy + taken, 0.5 * MASS * 1.5**2, rtol=1e-4)
    # the force has the pressure before the step: at first, half of p' dV^2, 8e-6 J, is missing in every step
    assert np.all(np.diff(taken) > -1e-5) and taken[-1] > 1.0


def test_control_of_one_s_own_is_differentiable():
    """Exact slope of the final position over a gain, against the difference of two runs."""

    def final(gain):
        law = js.Controlled.of(control, gain)
        return march_end(Mechanism((slider(velocity=1.0),), (along(law),)))

    def control(gain, s, v, t):
        return -gain * jnp.sin(3.0 * t) * v - 10.0 * s

    with enable_x64():
        slope = jax.jvp(final, leaf(4.0), leaf(1.0))[1]
        apart = (final(*leaf(4.0 + 1e-4)) - final(*leaf(4.0 - 1e-4))) / 2e-4
    np.testing.assert_allclose(slope, apart, rtol=1e-6)


def march_end(mechanism):
    """Position after 0.5 s, with derivatives."""
    dt = jnp.asarray(0.005, F)

    def step(k, parts):
        return mechanism.step(parts, k * dt, dt, jnp.zeros(2, F)).parts

    return jax.lax.fori_loop(0, 100, step, mechanism.start(F))["a"].pose[0]


@pytest.fixture(scope="module")
def pair():
    """Two free bodies with a spring and a damper between two of their points: momenta before and after."""
    with enable_x64():
        bodies = (
            slider("a", free=("surge", "heave", "pitch")),
            slider("b", 1.0, ("surge", "heave", "pitch")),
        )
        a, b = leaf((0.1, 0.05), (0.9, -0.08))
        ends = js.BetweenPoints("a", "b", a, b, *leaf(0.7))
        link = js.Link(ends, js.Laws((js.Spring(*leaf(50.0, 5.0)), js.Damper(*leaf(2.0, 1.0)))), name="rope")
        mechanism = Mechanism(bodies, (link,))

        @jax.jit
        def momenta(rates):
            parts = dict(mechanism.start(F))
            for name, own in zip("ab", rates, strict=True):
                parts[name] = eqx.tree_at(lambda m: m.rates, parts[name], own)
            parts = {**parts, **mechanism.placed(parts, jnp.zeros((), F))}
            before = momentum(mechanism, parts)
            dt, zero = jnp.asarray(0.01, F), jnp.zeros((), F)
            for _ in range(20):
                parts = mechanism.step(parts, zero, dt, jnp.zeros(2, F)).parts
            return before, momentum(mechanism, parts)

        yield momenta


def momentum(mechanism, parts):
    """Momentum (kg m/s) and angular momentum about the origin (kg m2/s) of all bodies."""
    kinematics = mechanism.kinematics(parts, jnp.zeros((), F))
    centre = jnp.stack([one.centre for one in mechanism.bodies]) + kinematics.poses[1, :, :2]
    p = jnp.einsum("bkl,bl->bk", kinematics.mass, kinematics.velocities[1])
    about = centre[:, 1] * p[:, 0] - centre[:, 0] * p[:, 1] + p[:, 2]
    return jnp.stack([p[:, 0].sum(), p[:, 1].sum(), about.sum()])


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.floats(-1.0, 1.0), min_size=6, max_size=6))
def test_a_link_acts_on_both_bodies_with_opposite_forces(pair, rates):
    """Momentum and angular momentum stay, whatever the link does."""
    with enable_x64():
        before, after = pair(jnp.asarray(rates, F).reshape(2, 3))
    np.testing.assert_allclose(after, before, atol=1e-8 * (1.0 + np.abs(before).max()) + 1e-9)


def test_a_link_to_no_body_is_refused():
    with pytest.raises(ValueError, match="the link pto connects b, which is not among the bodies"):
        Mechanism((slider(),), (along(js.Damper(*leaf(1.0, 0.0)), "b"),)).check()
