"""Shapes of solids: distances, dummies, moments; and motions of a rigid body."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import shapely
from conftest import enable_x64
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxsph.case.body_sections import PLANAR as MOTIONS
from jaxsph.core.kernels import Gaussian, Semicircle, WendlandC2
from jaxsph.model.mechanism import Mechanism
from jaxsph.model.state import Tally
from jaxsph.output.plot.tank import move
from jaxsph.parts.body import BodyMotion, RigidBody
from jaxsph.parts.joint import PlanarJoint
from jaxsph.solids import brim
from jaxsph.solids.composed import Difference, Placed, Union
from jaxsph.solids.shapes import AbstractShape, Block, Disc, Polygon, _along, _apart

SQUARE = ((0.1, 0.2), (0.5, 0.2), (0.5, 0.4), (0.1, 0.4))
L_SHAPE = Union((Block((0.1, 0.1), (0.5, 0.25)), Block((0.1, 0.1), (0.25, 0.5))))
RING = Difference(Disc((0.3, 0.3), 0.2), Disc((0.3, 0.3), 0.1))
TILTED = Placed(Polygon(SQUARE), by=(0.02, -0.01), angle=0.4, about=(0.3, 0.3))
COMPOSED = [L_SHAPE, RING, TILTED]
BLOCK = Block((0.1, 0.2), (0.5, 0.4))


def test_a_polygon_of_four_sides_is_a_block():
    x = jnp.asarray(np.random.default_rng(1).uniform(0.0, 0.6, (200, 2)), jnp.float32)
    np.testing.assert_allclose(Polygon(SQUARE).distance(x), BLOCK.distance(x), atol=1e-6)
    for a, b in zip(Polygon(SQUARE).moments(), BLOCK.moments(), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12)


SHAPES = [
    BLOCK,
    Block((0.113, 0.207), (0.131, 0.391)),
    Polygon(SQUARE),
    Polygon(((0.0, 0.1), (0.6, 0.1), (0.6, 0.16))),
    Disc((0.3, 0.3), 0.2),
    *COMPOSED,
]


@pytest.mark.parametrize("shape", SHAPES, ids=lambda s: type(s).__name__)
@pytest.mark.parametrize("dx", [0.02, 0.013])
def test_dummies_have_volume_and_centre_of_the_shape(shape, dx):
    """For faces, edges and thin plates at any position in the lattice, except for a share of 1e-4."""
    x, volume = shape.dummies(dx, 100)
    area, centre, _ = shape.moments()
    np.testing.assert_allclose(volume.sum(), area, rtol=2e-4)
    np.testing.assert_allclose(volume @ x / volume.sum(), centre, atol=1e-4)
    # where the layers of two sides meet, a particle may have half a cell more
    assert volume.max() < 1.6 * dx**2


@pytest.mark.parametrize("shape", SHAPES, ids=lambda s: type(s).__name__)
def test_dummies_go_as_deep_as_the_water_feels(shape):
    """Their volume is that of the layers; at a corner a centroid may be farther from the surface."""
    dx, layers = 0.02, 2
    x, volume = shape.dummies(dx, layers)
    region = shape.region()
    deep = region.buffer(-layers * dx, join_style="mitre")
    np.testing.assert_allclose(volume.sum(), region.area - deep.area, rtol=1e-3)
    assert not any(deep.buffer(-1e-6).contains(shapely.Point(*at)) for at in x)


@pytest.mark.parametrize("shape", [BLOCK, Polygon(SQUARE)], ids=lambda s: type(s).__name__)
def test_dummies_between_places_of_the_lattice_are_its_cells(shape):
    """If faces fit the lattice, dummies are cells of dx, with centres 0.5, 1.5, ... spacings behind it."""
    dx = 0.02
    x, volume = shape.dummies(dx, 3)
    np.testing.assert_allclose(volume, dx**2)
    depth = -np.asarray(shape.distance(jnp.asarray(x, jnp.float32))) / dx
    assert np.abs(depth[:, None] - [0.5, 1.5, 2.5]).min(axis=1).max() < 1e-3


@pytest.mark.parametrize(
    "shape", [BLOCK, Polygon(SQUARE), Disc((0.3, 0.3), 0.2), *COMPOSED], ids=lambda s: type(s).__name__
)
def test_dummies_are_inside_and_apart(shape):
    """Dummies are in the shape, also around a hole, and no two are closer than 0.6 spacings."""
    dx = 0.02
    x, _ = shape.dummies(dx, 3)
    region = shape.region()
    assert all(region.contains(shapely.Point(*at)) for at in x)
    gaps = np.linalg.norm(x[:, None] - x[None], axis=-1) + np.eye(len(x))
    assert gaps.min() > 0.6 * dx


@pytest.mark.parametrize("shape", [Disc((0.3, 0.3), 0.2), TILTED], ids=lambda s: type(s).__name__)
def test_dummies_of_a_curved_or_tilted_face_stand_in_layers(shape):
    """The first layer is half a spacing behind the face, and the others follow at every spacing."""
    dx = 0.02
    x, _ = shape.dummies(dx, 3)
    depth = -np.asarray(shape.distance(jnp.asarray(x, jnp.float32))) / dx
    assert np.abs(depth[:, None] - [0.5, 1.5, 2.5]).min(axis=1).max() < 0.1


def test_dummies_of_a_box_in_three_dimensions():
    x, volume = Block((0.0, 0.11, 0.2), (0.3, 0.31, 0.33)).dummies(0.02, 100)
    np.testing.assert_allclose(volume.sum(), 0.3 * 0.2 * 0.13)
    np.testing.assert_allclose(volume @ x / volume.sum(), [0.15, 0.21, 0.265])


@pytest.mark.parametrize(
    "shape", [BLOCK, Polygon(SQUARE), Disc((0.3, 0.3), 0.2), *COMPOSED], ids=lambda s: type(s).__name__
)
def test_moments_are_those_of_points_inside(shape):
    """A lattice of 400 x 400 points gives the area to the share of points on its edge, half a per cent."""
    at = (np.arange(400) + 0.5) * 0.6 / 400
    x = np.stack(np.meshgrid(at, at, indexing="ij"), -1).reshape(-1, 2)
    x = x[np.asarray(shape.distance(jnp.asarray(x, jnp.float32))) < 0]
    area, centre, second = shape.moments()
    np.testing.assert_allclose(len(x) * (0.6 / 400) ** 2, area, rtol=5e-3)
    np.testing.assert_allclose(x.mean(axis=0), centre, rtol=5e-3)
    np.testing.assert_allclose(np.sum((x - centre) ** 2) * (0.6 / 400) ** 2, second, rtol=2e-2)


class Ellipse(AbstractShape):
    """A user-defined shape, given by its distance and its bounds."""

    def distance(self, x):
        return 0.1 * (jnp.sqrt(jnp.sum(((x - 0.3) / jnp.array([0.2, 0.1])) ** 2, axis=1)) - 1.0)

    def bounds(self):
        return np.array([0.1, 0.2]), np.array([0.5, 0.4])


def test_the_outline_of_a_distance_has_its_precision():
    """A disc grown by 1e-9 m, which single precision does not resolve."""
    with enable_x64():
        small, large = (AbstractShape.region(Disc((0.3, 0.3), r)).area for r in (0.1, 0.1 + 1e-9))
    # to the error of a polygon with so many corners
    assert large - small == pytest.approx(2.0 * np.pi * 0.1 * 1e-9, rel=1e-3)


def test_a_shape_is_known_by_its_distance():
    """Area, centre and second moment of an ellipse; the grid has 240 intervals, hence errors of 1e-4."""
    area, centre, second = Ellipse().moments()
    np.testing.assert_allclose(area, np.pi * 0.2 * 0.1, rtol=2e-4)
    np.testing.assert_allclose(centre, 0.3, rtol=1e-5)
    np.testing.assert_allclose(second, 0.25 * np.pi * 0.2 * 0.1 * (0.2**2 + 0.1**2), rtol=4e-4)
    around = np.hypot(*((Ellipse().outline() - 0.3) / [0.2, 0.1]).T)
    assert len(around) > 100 and np.abs(around - 1.0).max() < 1e-3
    x, _ = Ellipse().dummies(0.02, 2)
    inside = np.asarray(Ellipse().distance(jnp.asarray(x, jnp.float32)))
    assert len(x) > 40 and inside.max() < 0.0


@pytest.mark.parametrize("shape", COMPOSED, ids=lambda s: type(s).__name__)
def test_distance_of_a_composed_shape_is_that_of_its_region(shape):
    """Negative inside and nowhere too large; exact outside a union, and wherever a face is the nearest."""
    x = np.random.default_rng(2).uniform(0.0, 0.6, (400, 2))
    found = np.asarray(shape.distance(jnp.asarray(x, jnp.float32)))
    region = shape.region()
    exact = np.array([region.boundary.distance(shapely.Point(*at)) for at in x])
    inside = np.array([region.contains(shapely.Point(*at)) for at in x])
    clear = exact > 1e-5
    assert np.all((found < 0)[clear] == inside[clear])
    # a circle of a thousand corners has an error of 1e-6 m
    assert np.all(np.abs(found) <= exact + 5e-6)
    alike = {"Union": ~inside, "Difference": inside}.get(type(shape).__name__, np.ones(len(x), bool))
    np.testing.assert_allclose(np.abs(found)[alike], exact[alike], atol=5e-6)


def test_numbers_of_a_shape_are_leaves():
    """Slopes with respect to a radius, a face and an angle need one compiled program for all values."""
    x = jnp.array([[0.7, 0.3], [0.3, 0.9]])

    def away(shape):
        return jnp.sum(shape.distance(x))

    compiled = jax.jit(jax.grad(away, allow_int=False))
    for radius in (0.1, 0.2):
        disc = jax.tree.map(jnp.float32, Disc((0.3, 0.3), radius))
        assert float(compiled(disc).radius) == pytest.approx(-2.0)
    assert compiled._cache_size() == 1
    block = jax.tree.map(jnp.float32, Block((0.1, 0.2), (0.5, 0.4)))
    assert float(compiled(block).high[0]) == pytest.approx(-1.0)
    tilted = jax.tree.map(jnp.float32, Placed(Block((0.1, 0.2), (0.5, 0.4)), about=(0.3, 0.3)))
    # a positive angle lowers the right end: the slope for the point level with the middle is zero
    ahead = jax.tree.map(jnp.float32, Placed(Block((0.1, 0.2), (0.5, 0.4)), angle=1e-3, about=(0.3, 0.3)))
    slope = float(compiled(tilted).angle)
    assert float(away(ahead) - away(tilted)) / 1e-3 == pytest.approx(slope, abs=2e-3)


def test_a_polygon_that_crosses_itself_is_refused():
    with pytest.raises(ValueError, match="the sides must not cross or touch each other"):
        Polygon(((0.0, 0.0), (1.0, 1.0), (1.0, 0.0), (0.0, 1.0)))


def _body(free=MOTIONS, pivot=(0.3, 0.3), release=0.0):
    return RigidBody(
        shape=BLOCK,
        mass=jnp.float32(2.0),
        inertia=jnp.float32(0.5),
        pivot=jnp.array(pivot),
        centre=jnp.array([0.3, 0.3]),
        joint=PlanarJoint.of(free, release=release),
        rows=(0, 0),
    )


def _moving(pose, velocity=(0.0, 0.0, 0.0)):
    pose, velocity = jnp.asarray(pose, jnp.float32), jnp.asarray(velocity, jnp.float32)
    none = jnp.zeros(3)
    return BodyMotion(pose, velocity, pose, velocity, none, none, Tally.zero(jnp.float32, (3,)))


POSES = st.tuples(*(st.floats(-1.0, 1.0, width=32) for _ in range(3)))


@settings(max_examples=30, deadline=None)
@given(POSES, POSES)
def test_velocities_are_the_rate_of_positions(pose, velocity):
    """Distances are kept, and carrying points back is the inverse motion."""
    body, x = _body(), jnp.asarray(BLOCK.dummies(0.1, 1)[0], jnp.float32)
    pose, velocity = jnp.asarray(pose, jnp.float32), jnp.asarray(velocity, jnp.float32)
    state = _moving(pose, velocity)

    def at(t):
        return body.carry(_moving(pose + t * velocity, velocity), x)

    there, rate = jax.jvp(at, (0.0,), (1.0,))
    np.testing.assert_allclose(body.velocity(state, there), rate, atol=2e-6)
    # distances from points of the moved surface, which `distance` carries back to rest
    np.testing.assert_allclose(body.distance(state, there), BLOCK.distance(x), atol=2e-6)
    second = jax.jvp(lambda t: jax.jvp(at, (t,), (1.0,))[1], (0.0,), (1.0,))[1]
    np.testing.assert_allclose(body.centripetal(state, there), second, atol=2e-5)


def test_weight_turns_a_leaning_flap_further():
    """The centre of mass is above and landward of the hinge: a landward moment of M g times the arm."""
    body = _body(("pitch",), pivot=(0.3, 0.2))
    mechanism, parts = Mechanism((body,)), {"body": _moving((0.0, 0.0, 0.2))}
    t = jnp.float32(0.0)
    forces, _ = mechanism.pulls(mechanism.kinematics(parts, t), parts, t, jnp.array([0.0, -9.81]))
    np.testing.assert_allclose(forces[2], 2.0 * 9.81 * 0.1 * np.sin(0.2), rtol=1e-5)


def test_pictures_draw_the_body_where_it_is():
    body, pose = _body(), np.array([0.1, -0.2, 0.4])
    corners = np.asarray(SQUARE)
    moved = body.carry(_moving(pose), jnp.asarray(corners, jnp.float32))
    np.testing.assert_allclose(move(corners, np.asarray(body.pivot), pose), moved, atol=1e-6)


def test_a_body_is_held_until_its_release():
    joint = _body(("heave",), release=0.5).joint
    for t, expected in ((0.4, [0, 0, 0]), (0.5, [0, 1, 0])):
        np.testing.assert_array_equal(joint.movable(jnp.float32(t)), expected)


@pytest.mark.parametrize("dim", [2, 3])
def test_filling_in_parts_is_the_sum_over_all_pairs(monkeypatch, dim):
    """To round-off of the order of summation, in parts of about twenty points each."""
    monkeypatch.setattr(brim, "PAIRS", 600)
    rng = np.random.default_rng(dim)
    points, water = rng.uniform(0, 1, (50, dim)), rng.uniform(0, 1, (400, dim))
    volume, h = rng.uniform(1e-3, 2e-3, 400), 0.1
    r = np.linalg.norm(points[:, None] - water, axis=-1)
    for kernel in (Gaussian(3.0), WendlandC2(), Semicircle.of(dim)):
        weight = np.where(r < kernel.reach * h, np.asarray(kernel.value(r**2, h, dim)), 0.0)
        found = brim.kernel_fill(points, water, volume, kernel, h)
        np.testing.assert_allclose(found, weight @ volume, rtol=1e-5)  # single precision
        assert not brim.kernel_fill(points, water[:0], volume[:0], kernel, h).any()


def test_where_insets_meet_the_later_points_give_way():
    """A thin wedge, point by point: a point stays unless an earlier one that stays is within 0.6 spacings."""
    dx = 0.02
    whole = shapely.Polygon(((0.0, 0.0), (1.0, 0.0), (1.0, 0.1)))
    insets = (whole.buffer(-(k + 0.5) * dx, join_style="mitre", mitre_limit=20.0) for k in range(3))
    x = np.concatenate([_along(inset.exterior, dx) for inset in insets if not inset.is_empty])
    stay = []
    for a in x:
        if all(np.hypot(*(a - b)) > 0.6 * dx for b in stay):
            stay.append(a)
    assert len(stay) < len(x)
    np.testing.assert_array_equal(_apart(x, 0.6 * dx), stay)
