"""Rigid bodies in space: rotations, velocities, the free top, joints, links and moorings in six motions."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import enable_x64
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import jaxsph as js
from experiments.verification import free_top
from jaxsph.case.shapes import inertia_of
from jaxsph.errors import CaseError
from jaxsph.model.mechanism import Mechanism
from jaxsph.model.rigid import PLANE, SPACE
from jaxsph.parts.catenary import GroundedCatenary
from jaxsph.parts.line import Bed, LumpedLine, Morison
from jaxsph.parts.moorings import FromAnchor, Mooring, QuasiStatic

F = jnp.float64
VECTORS = st.lists(st.floats(-1.7, 1.7), min_size=3, max_size=3).map(np.array)
"""Rotation vectors shorter than pi, and other vectors."""
PLACED = jax.jit(SPACE.pose)


def _pose(shift, vector):
    return PLACED(jnp.asarray(np.concatenate([shift, vector]), F))


@settings(max_examples=50, deadline=None)
@given(VECTORS, VECTORS, VECTORS, VECTORS)
def test_poses_in_space_are_those_of_rotations(shift, vector, r, other):
    """Against scipy, to rounding errors: rotated and carried vectors, and the coordinates of a pose."""
    with enable_x64():
        pose, turn = _pose(shift, vector), Rotation.from_rotvec(vector)
        np.testing.assert_allclose(SPACE.rotated(pose, jnp.asarray(r)), turn.apply(r), atol=1e-13)
        np.testing.assert_allclose(SPACE.rotated_back(pose, jnp.asarray(r)), turn.inv().apply(r), atol=1e-13)
        np.testing.assert_allclose(SPACE.coordinates(pose), [*shift, *vector], atol=1e-9)
        child = SPACE.carried(pose, jnp.asarray(r), _pose(shift, other))
        both = turn * Rotation.from_rotvec(other)
        found = Rotation.from_quat(np.asarray(child)[[4, 5, 6, 3]])
        assert (found * both.inv()).magnitude() < 1e-12
        np.testing.assert_allclose(child[:3], shift + turn.apply(r + shift) - r, atol=1e-12)


@settings(max_examples=50, deadline=None)
@given(VECTORS, VECTORS, VECTORS)
def test_velocities_in_space_are_those_of_moving_points(vector, spin, r):
    """Rotation vector and its rate give the velocity, and the centripetal acceleration, of every point."""
    with enable_x64():

        def place(t):
            return SPACE.pose(jnp.concatenate([t * spin, vector + t * spin]))

        pose, change = jax.jvp(place, (jnp.zeros((), F),), (jnp.ones((), F),))
        velocity = SPACE.velocity(pose, change)
        at = SPACE.rotated(pose, jnp.asarray(r))
        exact = (SPACE.moved(place(1e-5), r)[:3] - SPACE.moved(place(-1e-5), r)[:3]) / 2e-5
        found = jnp.einsum("knd,k->nd", SPACE.directions(at[None]), velocity)[0]
        np.testing.assert_allclose(found, exact, atol=1e-8)
        turning = velocity[3:]
        inwards = np.cross(turning, np.cross(turning, at))
        np.testing.assert_allclose(SPACE.centripetal(velocity, at[None])[0], inwards, atol=1e-12)


def test_rotations_have_slopes_at_rest():
    """Twice in forward and once in reverse mode, as the solver and a slope of a run need them."""
    turned = jax.jit(jax.jacfwd(jax.jacrev(lambda q: SPACE.rotated(SPACE.pose(q), jnp.ones(3)))))
    assert np.isfinite(turned(jnp.zeros(6))).all()
    back = jax.jit(jax.jacrev(lambda q: SPACE.coordinates(SPACE.pose(q))))
    np.testing.assert_allclose(back(jnp.zeros(6)), np.eye(6), atol=1e-6)


def test_a_free_top_keeps_energy_and_momentum_and_follows_eulers_equations():
    """Over ten turns in which it turns over; float32 accumulates the rounding errors of 2000 steps."""
    with enable_x64():
        energy, momentum, attitude = free_top.errors(free_top.tumble(F, 10))
        assert max(energy, momentum) < 1e-8 and attitude.max() < 1e-5
        energy, momentum, _ = free_top.errors(free_top.tumble(jnp.float32, 10))
        assert max(energy, momentum) < 1e-5


def test_coordinates_change_only_for_long_rotation_vectors():
    """The opposite vector is the same rotation with the same velocity; a hinge counts its turns."""
    with enable_x64():
        joint = js.SpatialJoint.of(SPACE.motions, dtype=F)
        q, rates = (
            jnp.array([1.0, 2.0, 3.0, 2.0, -2.0, 1.5], F),
            jnp.array([0.1, 0.2, 0.3, 0.5, 0.7, -0.4], F),
        )
        new, new_rates = joint.regular(q, rates)
        assert jnp.linalg.norm(new[3:]) < np.pi < jnp.linalg.norm(q[3:])
        old, then = (jax.jvp(SPACE.pose, (a,), (b,)) for a, b in ((q, rates), (new, new_rates)))
        np.testing.assert_allclose(SPACE.velocity(*old), SPACE.velocity(*then), atol=1e-12)
        np.testing.assert_allclose(SPACE.coordinates(old[0]), SPACE.coordinates(then[0]), atol=1e-12)
        hinge = js.SpatialJoint.of(["pitch"], dtype=F)
        assert hinge.regular(q, rates)[0] is q


def _pair(dim):
    """A block that floats in the plane of a spring, and a bar hinged to it, in 2-D or 3-D (1 m wide)."""

    def wide(*corner):
        return (corner[0], y, corner[1]) if dim == 3 else corner

    y = 0.0
    low = wide(0.0, 0.0), wide(1.0, 0.0)
    y = 1.0
    shapes = js.Block(low[0], wide(1.0, 0.2)), js.Block(low[1], wide(1.6, 0.3))
    y = 0.5
    kind, motions = (js.SpatialJoint, SPACE.motions) if dim == 3 else (js.PlanarJoint, PLANE.motions)
    speeds = [{"surge": 0.3, "pitch": 0.8}.get(name, 0.0) for name in motions]
    joints = (
        kind.of(("surge", "heave", "pitch"), velocity=tuple(speeds), dtype=F),
        kind.of(("pitch",), parent="raft", dtype=F),
    )
    bodies = [
        js.RigidBody.of(shape, (0, 0), joint, density=500.0, pivot=pivot, name=name, dtype=F)
        for shape, joint, pivot, name in zip(
            shapes, joints, (None, wide(1.0, 0.1)), ("raft", "bar"), strict=True
        )
    ]
    ends = js.BetweenPoints(
        "", "raft", *(jnp.array(wide(*a), F) for a in ((-1.0, 0.0), (0.0, 0.1))), jnp.array(1.0, F)
    )
    spring = js.Link(ends, js.Spring(jnp.array(3e3, F), jnp.array(10.0, F)))
    return Mechanism(tuple(bodies), (spring,))


def test_planar_motion_is_the_same_in_two_and_three_dimensions():
    """Joined bodies with a spring under gravity, over half a second."""
    with enable_x64():
        found = []
        for dim in (2, 3):
            mechanism, g = _pair(dim), jnp.zeros(dim, F).at[-1].set(-9.81)

            def step(parts, k, mechanism=mechanism, g=g):
                return mechanism.step(parts, k * 1e-3, jnp.array(1e-3, F), g).parts, None

            parts, _ = jax.jit(lambda parts: jax.lax.scan(step, parts, jnp.arange(500.0)))(mechanism.start(F))
            motions = [parts[name] for name in ("raft", "bar")]
            space = mechanism.space
            coordinates = np.stack([space.coordinates(one.pose) for one in motions])
            planar = [space.motions.index(name) for name in PLANE.motions]
            assert np.abs(np.delete(coordinates, planar, axis=1)).max(initial=0.0) < 1e-12
            found.append(coordinates[:, planar])
        np.testing.assert_allclose(found[1], found[0], atol=1e-10)
        assert np.abs(found[0]).max() > 0.1


def _line(law):
    """A catenary, or a line of lumped masses with this catenary at rest."""
    catenary = GroundedCatenary(*(jnp.array(a, F) for a in (12.0, 8.0, 1e5)))
    if law == "catenary":
        return QuasiStatic(catenary)
    numbers = [jnp.array(a, F) for a in (1.0, 20.0, 5.0, 0.5, 1.0, 0.1, 0.0, 1e4, 1e2)]
    mass, damping, *water = numbers[:6]
    return LumpedLine(catenary, mass, damping, Morison(*water), Bed(*numbers[6:]), 10, 40)


@pytest.mark.parametrize("law", ["catenary", "line"])
@pytest.mark.parametrize("angle", [0.7, np.pi / 2, 3.9])
def test_a_mooring_in_an_upright_plane_is_that_of_two_dimensions(law, angle):
    """Force, shape and energy, at rest and while the fairlead moves in the plane."""
    with enable_x64():
        law, c, s = _line(law), np.cos(angle), np.sin(angle)
        flat, rate = jnp.array([9.0, 4.0], F), jnp.array([0.2, -0.1], F)
        out = jax.jit(lambda a: jnp.array([c * a[0], s * a[0], a[1]]))

        def run(end, v):
            own = law.start(end)
            for _ in range(3):
                end = end + 0.01 * v
                own = law.advance(own, end, v, 0.0, jnp.array(0.01, F))
            force = law.force(own, end, v, 0.0) - jax.grad(law.stored, argnums=1)(own, end)
            return force, law.shape(own, end), law.stored(own, end)

        force, shape, energy = jax.jit(run)(flat, rate)
        found, points, stored = jax.jit(run)(out(flat), out(rate))
        np.testing.assert_allclose(found, out(force), rtol=1e-6, atol=1e-6 * float(jnp.abs(force).max()))
        np.testing.assert_allclose(points, jax.vmap(out)(shape), atol=1e-6)
        np.testing.assert_allclose(stored, energy, rtol=1e-8)


def test_a_mooring_pulls_a_body_round():
    """A line that pulls sideways off the centre turns the body in yaw, by the moment of its force."""
    with enable_x64():
        joint = js.SpatialJoint.of(SPACE.motions, dtype=F)
        shape = js.Block((0.0, 0.0, 4.0), (1.0, 1.0, 4.5))
        body = js.RigidBody.of(shape, (0, 0), joint, density=500.0, dtype=F)
        ends = FromAnchor("body", jnp.array([1.0, 0.0, 4.0], F), jnp.array([10.0, 0.0, 0.0], F))
        mechanism = Mechanism((body,), (Mooring(ends, _line("catenary")),))
        parts = mechanism.start(F)
        at = jnp.zeros((), F)
        pulls = jax.jit(
            lambda parts: mechanism.pulls(mechanism.kinematics(parts, at), parts, at, jnp.zeros(3, F))
        )
        loads, _ = pulls(parts)
        force = parts["mooring"].force
        moment = np.cross([0.5, -0.5, -0.25], force)
        np.testing.assert_allclose(loads[:6], [*force, *moment], rtol=1e-6)
        assert force[0] > 0 and abs(moment[2]) > 1.0


BUOY = """
name = "buoy"
dx = 0.05
t1 = 1.0
[tank]
length = 2.0
width = 1.0
depth = 0.5
[body]
free = ["surge", "sway", "heave", "roll", "pitch", "yaw"]
mass = 20.0
{}
[body.cylinder]
foot = [1.0, 0.5, 0.35]
head = [1.0, 0.5, 0.65]
radius = 0.2
"""


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ("inertia = 0.5", "also free in roll, yaw: give"),
        ("inertia = [0.1, 0.1, 0.3]", "no body has these moments of inertia"),
        ("inertia = [0.1, 0.1, 0.1, 0.2]", "must have 1, 3 or 6 numbers"),
        ("inertia = [0.1, 0.1, 0.1]\nvelocity = [0.0, 0.0]", "must have three values"),
        ("inertia = [0.1, 0.1, 0.1]\ncentre = [1.0]", "centre"),
    ],
)
def test_impossible_inertia_and_velocities_are_refused(tmp_path, lines, message):
    path = tmp_path / "buoy.toml"
    path.write_text(BUOY.format(lines))
    with pytest.raises(CaseError, match=message):
        js.load_case(path).problem()


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("body.free", ["heave", "roll"]),
        ("body.velocity", [0.0] * 6),
        ("body.centre", [0.5, 0.0, 0.5]),
        ("body.angle", [0.1, 0.0, 0.0]),
    ],
)
def test_motions_in_space_are_refused_in_two_dimensions(key, value):
    with pytest.raises(CaseError, match=key.replace(".", r"\.") + ".*(tank.width|three dimensions)"):
        js.load_case("buoy_heave").replace({key: value}).problem()


def test_inertia_of_a_case_is_a_tensor_about_the_centre_of_mass(tmp_path):
    """Six numbers about a pivot off the centre, against the parallel-axis theorem."""
    path = tmp_path / "buoy.toml"
    given = "inertia = [1.0, 1.4, 0.9, 0.02, -0.03, 0.04]\npivot = [1.1, 0.5, 0.4]\ncentre = [1.0, 0.5, 0.45]"
    path.write_text(BUOY.format(given))
    case = js.load_case(path)
    found = inertia_of(case.body, case.body.placed(case.dx), "body")
    arm = np.array([-0.1, 0.0, 0.05])
    tensor = np.array([[1.0, 0.02, -0.03], [0.02, 1.4, 0.04], [-0.03, 0.04, 0.9]])
    about = tensor - 20.0 * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    np.testing.assert_allclose(found.about_centre, about, atol=1e-12)
    np.testing.assert_allclose(found.centre - found.pivot, arm)
