"""Joined bodies without water: pendulums and a crank against independent solutions, energy, drives."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import enable_x64
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import jaxsph as js
from experiments.linkages import body, double_pendulum
from experiments.verification import joints
from jaxsph.case.body_sections import PLANAR as MOTIONS
from jaxsph.model.mechanism import Mechanism
from jaxsph.parts.joint import PlanarJoint
from jaxsph.parts.paths import SampledPath


def test_double_pendulum_follows_lagrange_s_equations():
    """Over 3 s, or two periods, with steps of 0.5 ms: errors of second order, 2e-6 rad when written."""
    with enable_x64():
        _, found, exact = joints.pendulum()
    np.testing.assert_allclose(found, exact, atol=1e-4)


@pytest.mark.slow
def test_double_pendulum_keeps_its_energy_over_a_hundred_periods():
    """Kicks and drifts are symplectic, so that the error oscillates and does not grow."""
    with enable_x64():
        late = np.abs(joints.change_of_energy())
    assert late.max() < 5e-6
    assert late[-50:].mean() < 3.0 * late[:50].mean()


def test_a_closed_chain_in_closed_form_follows_lagrange_s_equation():
    """Slider-crank: joints without coordinates that depend on the pose of the body that carries them."""
    with enable_x64():
        _, found, exact = joints.crank()
    np.testing.assert_allclose(found, exact, atol=1e-4)


def test_a_drive_gives_what_the_bodies_gain():
    """A pendulum on a carriage with a prescribed motion: work of the drive against the energy of both."""
    with enable_x64():
        work, gained = joints.work_and_gain()
    assert np.ptp(gained) > 10.0
    np.testing.assert_allclose(work, gained, atol=1e-3 * np.ptp(gained))


@pytest.fixture(scope="module")
def chain():
    """Two hinged bodies that float freely, and their drift over 0.01 s, compiled once."""
    with enable_x64():
        f = jnp.float64
        bodies = (
            body("a", js.Block((0, 0), (1.0, 0.2)), PlanarJoint.of(MOTIONS, dtype=f), None, f),
            body(
                "b", js.Block((1, 0), (1.6, 0.3)), PlanarJoint.of(["pitch"], parent="a", dtype=f), (1, 0.1), f
            ),
        )
        mechanism = Mechanism(bodies)
        drift = jax.jit(lambda parts: mechanism.drifted(parts, jnp.zeros((), f), jnp.asarray(0.01, f)))
        place = jax.jit(lambda parts: mechanism.placed(parts, jnp.zeros((), f)))
        kept = jax.jit(lambda parts: _kept(mechanism, parts))
        yield mechanism.start(f), place, drift, kept


def _kept(mechanism, parts):
    """Kinetic energy (J), momentum (kg m/s) and angular momentum about the origin (kg m2/s) of all bodies."""
    kinematics = mechanism.kinematics(parts, jnp.zeros(()))
    centre = jnp.stack([one.centre for one in mechanism.bodies]) + kinematics.poses[1, :, :2]
    p = jnp.einsum("bkl,bl->bk", kinematics.mass, kinematics.velocities[1])
    about = centre[:, 1] * p[:, 0] - centre[:, 0] * p[:, 1] + p[:, 2]
    energy = sum(one.energy(parts[one.name], jnp.zeros(2))[0] for one in mechanism.bodies)
    return jnp.stack([energy, p[:, 0].sum(), p[:, 1].sum(), about.sum()])


@settings(max_examples=50, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.floats(-3.0, 3.0), min_size=6, max_size=6))
def test_a_free_chain_keeps_energy_and_momentum(chain, values):
    """Without forces, over 0.2 s, for any angles and velocities: what is left is the error of Runge-Kutta."""
    start, place, drift, kept = chain
    with enable_x64():
        turn_a, turn_b, *rates = values
        parts = {
            "a": eqx.tree_at(lambda m: (m.q, m.rates), start["a"], _arrays([0, 0, turn_a], rates[:3])),
            "b": eqx.tree_at(lambda m: (m.q, m.rates), start["b"], _arrays([0, 0, turn_b], [0, 0, rates[3]])),
        }
        parts = place(parts)
        before = kept(parts)
        for _ in range(20):
            parts = drift(parts)
        after = kept(parts)
    np.testing.assert_allclose(after, before, rtol=1e-6, atol=1e-5 * (1.0 + float(before[0])))


def _arrays(*lists):
    return tuple(jnp.asarray(one, jnp.float64) for one in lists)


def test_samples_of_a_motion_are_met_and_end_at_rest():
    t = np.array([0.0, 0.4, 1.0, 1.5])
    poses = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.2], [0.0, -0.1, 0.1], [0.3, 0.0, 0.0]])
    path = SampledPath.of(t, poses)
    np.testing.assert_allclose([path.pose(jnp.float32(one)) for one in t], poses, atol=1e-6)
    np.testing.assert_allclose(path.pose(jnp.float32(9.0)), poses[-1], atol=1e-6)
    speed = jax.jacfwd(path.pose)
    for one in (0.0, 1.5 - 1e-4, 3.0):
        np.testing.assert_allclose(speed(jnp.float32(one)), 0.0, atol=2e-3)


def test_an_inclined_slider_moves_along_its_axis():
    joint = PlanarJoint.of(["surge"], angle=0.5)
    pose = joint.pose(jnp.array([2.0, 0.0, 0.1]), jnp.float32(0.0))
    np.testing.assert_allclose(pose, [2.0 * np.cos(0.5), 2.0 * np.sin(0.5), 0.1], rtol=1e-6)


def test_bodies_out_of_order_are_refused():
    upper, lower = double_pendulum(jnp.float32)
    with pytest.raises(
        ValueError, match="lower is joined to upper, which is not among the bodies listed before"
    ):
        Mechanism((lower, upper)).check()
