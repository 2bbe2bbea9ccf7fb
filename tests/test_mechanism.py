"""Joined bodies without water: pendulums and a crank against independent solutions, energy, given motions."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import enable_x64
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import jaxsph as js
from jaxsph.model.mechanism import Mechanism, inverse_where
from jaxsph.model.solids import AbstractJoint
from jaxsph.parts.body import RigidBody
from jaxsph.parts.joint import MOTIONS, PlanarJoint
from jaxsph.parts.paths import HarmonicPath, SampledPath

G = 9.81


def body(name, shape, joint, pivot, dtype):
    return RigidBody.of(shape, (0, 0), joint, density=500.0, pivot=pivot, name=name, dtype=dtype)


def march(bodies, t1, n, dtype, every=1):
    """Motions of the bodies at every `every`-th of n steps to t1, with the kicks and drifts of the scheme."""
    mechanism, dt = Mechanism(bodies), jnp.asarray(t1 / n, dtype)
    g = jnp.asarray([0.0, -G], dtype)

    def step(carry, k):
        parts, done = carry
        t = k * dt
        parts = mechanism.drifted(parts, t, 0.5 * dt)
        kinematics = mechanism.kinematics(parts, t + 0.5 * dt)
        forces, damping = mechanism.pulls(kinematics, parts, g)
        mass = kinematics.mass_matrix + dt * jnp.diag(damping)
        change = inverse_where(kinematics.movable, mass) @ forces
        power = mechanism.given(kinematics, change, forces)
        parts = mechanism.kicked(parts, t + 0.5 * dt, dt * change)
        parts = mechanism.drifted(parts, t + 0.5 * dt, 0.5 * dt)
        return (parts, done + dt * sum(power.values())), None

    def block(carry, k):
        carry, _ = jax.lax.scan(step, carry, k)
        parts, done = carry
        energy = sum(sum(one.energy(parts[one.name], g)) for one in bodies)
        return carry, ({one.name: parts[one.name].pose for one in bodies}, energy, done)

    start = mechanism.start(dtype)
    steps = jnp.arange(n).reshape(-1, every)
    _, found = jax.jit(lambda s: jax.lax.scan(block, (s, jnp.zeros((), dtype)), steps))(start)
    return found


def double_pendulum(dtype, angles=(0.7, -0.4)):
    """Two bars of 1 and 0.8 m, hinged at (0, 0) and at the end of the first; upright bars hang downwards."""
    upper, lower = js.Block((-0.05, -1.0), (0.05, 0.0)), js.Block((-0.05, -1.8), (0.05, -1.0))
    joints = [
        PlanarJoint.of(["pitch"], position=(0.0, 0.0, angle), parent=parent, dtype=dtype)
        for angle, parent in zip(angles, ("", "upper"), strict=True)
    ]
    return (
        body("upper", upper, joints[0], (0.0, 0.0), dtype),
        body("lower", lower, joints[1], (0.0, -1.0), dtype),
    )


def pendulum_equations(t, y, lengths=(1.0, 0.8), width=0.1):
    """Lagrange's equations of the double pendulum in absolute angles a, b from the vertical."""
    a, b, va, vb = y
    (l1, l2), m1, m2 = lengths, 500.0 * width * lengths[0], 500.0 * width * lengths[1]
    i1, i2 = (m * (long * long + width * width) / 12.0 for m, long in ((m1, l1), (m2, l2)))
    c, s = np.cos(a - b), np.sin(a - b)
    mass = [
        [i1 + m1 * l1**2 / 4 + m2 * l1**2, m2 * l1 * l2 / 2 * c],
        [m2 * l1 * l2 / 2 * c, i2 + m2 * l2**2 / 4],
    ]
    force = [
        -m2 * l1 * l2 / 2 * s * vb**2 - (m1 / 2 + m2) * G * l1 * np.sin(a),
        m2 * l1 * l2 / 2 * s * va**2 - m2 * G * l2 / 2 * np.sin(b),
    ]
    return [va, vb, *np.linalg.solve(mass, force)]


def test_double_pendulum_follows_lagrange_s_equations():
    """Over 3 s, or two periods, with steps of 0.5 ms: errors of second order, 4e-6 rad when written."""
    with enable_x64():
        poses, *_ = march(double_pendulum(jnp.float64), 3.0, 6000, jnp.float64, 100)
    exact = solve_ivp(pendulum_equations, (0, 3), [0.7, 0.3, 0, 0], rtol=1e-10, atol=1e-12, dense_output=True)
    t = np.linspace(0.05, 3.0, 60)
    for name, angle in zip(("upper", "lower"), exact.sol(t)[:2], strict=True):
        np.testing.assert_allclose(poses[name][:, 2], angle, atol=1e-4)


@pytest.mark.slow
def test_double_pendulum_keeps_its_energy_over_a_hundred_periods():
    """Kicks and drifts are symplectic, so that the error oscillates and does not grow."""
    with enable_x64():
        _, energy, _ = march(double_pendulum(jnp.float64), 190.0, 190_000, jnp.float64, 1000)
    swing = 0.5 * G * (500.0 * 0.1 * (0.5 + 0.8) * (1 - np.cos(0.7)))
    late = np.abs(np.asarray(energy) - float(energy[0]))
    assert late.max() < 1e-5 * swing
    assert late[-50:].mean() < 3.0 * late[:50].mean()


class Rod(AbstractJoint):
    """Connecting rod of a crank: its far end stays on the line z = 0, so that it has no coordinate."""

    parent: str = eqx.field(static=True, default="crank")
    length: float = eqx.field(static=True, default=1.0)
    free = ()
    coordinates = ()
    moves = (True, True, True)
    driven = False

    def start(self, dtype):
        return jnp.zeros(0, dtype), jnp.zeros(0, dtype)

    def pose(self, q, t):
        raise NotImplementedError

    def place(self, above, arm, q, t):
        pin = jnp.stack(
            [
                jnp.cos(above[2]) * arm[0] + jnp.sin(above[2]) * arm[1],
                jnp.cos(above[2]) * arm[1] - jnp.sin(above[2]) * arm[0],
            ]
        )
        return jnp.stack([*(pin - arm), jnp.arcsin(pin[1] / self.length)])

    def movable(self, t):
        return jnp.zeros(0, t.dtype)


class Piston(Rod):
    """Piston at the far end of the rod."""

    parent: str = eqx.field(static=True, default="rod")

    def place(self, above, arm, q, t):
        end = above[0] + self.length * (jnp.cos(above[2]) - 1.0)
        return jnp.stack([end, 0.0 * end, 0.0 * end])


def crank_equation(t, y, r=0.3, length=1.0):
    """Equation of a crank with rod and piston in the angle from the x axis, upwards, by Lagrange."""
    m = {"crank": 500.0 * 0.1 * 0.3, "rod": 500.0 * 0.1 * 1.0, "piston": 500.0 * 0.04}
    i_crank = m["crank"] * ((0.3**2 + 0.1**2) / 12 + 0.15**2)
    i_rod = m["rod"] * (1.0 + 0.1**2) / 12

    def parts(a):
        """Mass and height by the angle a."""
        b = np.arcsin(r / length * np.sin(a))
        db = r / length * np.cos(a) / np.cos(b)
        rod = np.array([-r * np.sin(a) - length / 2 * np.sin(b) * db, r * np.cos(a) / 2])
        piston = -r * np.sin(a) - length * np.sin(b) * db
        mass = i_crank + i_rod * db**2 + m["rod"] * rod @ rod + m["piston"] * piston**2
        return mass, G * (m["crank"] * 0.5 * r + m["rod"] * 0.5 * r) * np.sin(a)

    a, v = y
    (mass, _), h = parts(a), 1e-5
    slope, pull = ((np.array(parts(a + h)) - np.array(parts(a - h))) / (2 * h)).tolist()
    return [v, (-pull - 0.5 * slope * v**2) / mass]


def test_a_closed_chain_in_closed_form_follows_lagrange_s_equation():
    """Slider-crank: joints without coordinates that depend on the pose of the body that carries them."""
    with enable_x64():
        f = jnp.float64
        bodies = (
            body("crank", js.Block((0.0, -0.05), (0.3, 0.05)), PlanarJoint.of(["pitch"], dtype=f), (0, 0), f),
            body("rod", js.Block((0.3, -0.05), (1.3, 0.05)), Rod(), (0.3, 0.0), f),
            body("piston", js.Block((1.2, -0.1), (1.4, 0.1)), Piston(), (1.3, 0.0), f),
        )
        poses, *_ = march(bodies, 3.0, 6000, f, 100)
    exact = solve_ivp(crank_equation, (0, 3), [0.0, 0.0], rtol=1e-9, atol=1e-11, dense_output=True)
    t = np.linspace(0.05, 3.0, 60)
    np.testing.assert_allclose(-poses["crank"][:, 2], exact.sol(t)[0], atol=1e-4)


def test_a_drive_gives_what_the_bodies_gain():
    """A pendulum on a carriage with a given motion: work of the drive against the energy of both."""
    with enable_x64():
        f = jnp.float64
        path = HarmonicPath(*(jnp.asarray(a, f) for a in ([0.2, 0.05, 0.1], 7.0, [0.0, 0.5, 1.0], 0.5)))
        bodies = (
            body("cart", js.Block((-0.2, -0.1), (0.2, 0.1)), PlanarJoint.of(path=(path,), dtype=f), None, f),
            body(
                "bob",
                js.Block((-0.05, -0.8), (0.05, 0.0)),
                PlanarJoint.of(["pitch"], parent="cart", dtype=f),
                (0.0, 0.0),
                f,
            ),
        )
        _, energy, given = march(bodies, 2.0, 8000, f, 100)
    gained = np.asarray(energy - energy[0])
    assert np.ptp(gained) > 10.0
    np.testing.assert_allclose(given - given[0], gained, atol=1e-3 * np.ptp(gained))


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
    p = kinematics.mass * kinematics.velocities[1]
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
    with pytest.raises(ValueError, match="lower is joined to upper, which is not among the bodies before"):
        Mechanism((lower, upper)).check()
