"""Shapes in three dimensions: distances, moments and dummy particles; unions and differences; cases."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

import jaxsph as js
from jaxsph.case.case import Case
from jaxsph.errors import CaseError
from jaxsph.solids.composed import Difference, Placed, Union
from jaxsph.solids.shapes import AbstractShape, inertia_tensor
from jaxsph.solids.swept import Extrusion, Revolution
from jaxsph.solids.volumes import Capsule, Cylinder, Sphere

SPHERE = Sphere((0.31, 0.28, 0.3), 0.2)
UPRIGHT = Cylinder((0.3, 0.3, 0.1), (0.3, 0.3, 0.5), 0.15)
OBLIQUE = Cylinder((0.15, 0.2, 0.2), (0.45, 0.4, 0.35), 0.1)
SHELL = Difference(Sphere((0.3, 0.3, 0.3), 0.2), Sphere((0.3, 0.3, 0.3), 0.1))
DUMBBELL = Union((Sphere((0.15, 0.3, 0.3), 0.1), Sphere((0.45, 0.3, 0.3), 0.1)))
CAPSULE = Capsule((0.2, 0.25, 0.2), (0.4, 0.35, 0.35), 0.12)
TRAPEZE = ((0.12, 0.15), (0.48, 0.15), (0.4, 0.42), (0.12, 0.36))
SPINDLE = Revolution(((0.0, 0.1), (0.2, 0.15), (0.12, 0.4), (0.0, 0.5)), (0.3, 0.3))
RING = Revolution(((0.1, 0.2), (0.25, 0.2), (0.25, 0.35), (0.1, 0.35)), (0.3, 0.3))
SINGLE = {
    "sphere": SPHERE,
    "upright": UPRIGHT,
    "oblique": OBLIQUE,
    "capsule": CAPSULE,
    "prism_x": Extrusion(TRAPEZE, (0.1, 0.45), 0),
    "prism_y": Extrusion(TRAPEZE, (0.1, 0.45), 1),
    "prism_z": Extrusion(TRAPEZE, (0.1, 0.45), 2),
    "spindle": SPINDLE,
    "ring": RING,
}
TURNED = Placed.about_middle(CAPSULE, (0.3, -0.4, 0.8))
SHAPES = SINGLE | {"shell": SHELL, "dumbbell": DUMBBELL, "turned": TURNED}
SAMPLE = ("sphere", "oblique", "prism_y", "ring")
"""Shapes with curved and flat surfaces, edges and a hole, for tests that take seconds per shape."""


def points_inside(shape, side=0.6, count=120):
    """Points of a cubic lattice inside a shape, and the volume of each."""
    at = (np.arange(count) + 0.5) * side / count
    x = np.stack(np.meshgrid(at, at, at, indexing="ij"), -1).reshape(-1, 3)
    return x[np.asarray(shape.distance(jnp.asarray(x, jnp.float32))) < 0], (side / count) ** 3


@pytest.mark.parametrize("name", SHAPES)
def test_moments_are_those_of_points_inside(name):
    """The lattice gives volumes to the scatter of points on the surface, half a per cent."""
    x, cell = points_inside(SHAPES[name])
    volume, centre, second = SHAPES[name].moments()
    np.testing.assert_allclose(len(x) * cell, volume, rtol=5e-3)
    np.testing.assert_allclose(x.mean(axis=0), centre, atol=1e-3)
    found = inertia_tensor((x - centre).T @ (x - centre) * cell)
    np.testing.assert_allclose(found, second, atol=1e-2 * np.max(second))


@pytest.mark.parametrize("name", SINGLE)
def test_moments_in_closed_form_are_those_of_the_distance(name):
    """The sums over a grid of 96 cells converge with the square of its spacing: 1e-3, twice this at edges."""
    shape = SINGLE[name]
    exact, summed = shape.moments(), AbstractShape.moments(shape)
    np.testing.assert_allclose(summed[0], exact[0], rtol=1e-3)
    np.testing.assert_allclose(summed[1], exact[1], atol=1e-4)
    np.testing.assert_allclose(summed[2], exact[2], atol=2e-3 * np.max(exact[2]))


@pytest.mark.parametrize("name", [*SAMPLE, "shell", "turned"])
@pytest.mark.parametrize("dx", [0.04, 0.023])
def test_dummies_have_volume_and_centre_of_the_shape(name, dx):
    shape = SHAPES[name]
    x, volume = shape.dummies(dx, 100)
    total, centre, _ = shape.moments()
    np.testing.assert_allclose(volume.sum(), total, rtol=1e-6)
    np.testing.assert_allclose(volume @ x / volume.sum(), centre, atol=2e-3 * dx)
    assert np.asarray(shape.distance(jnp.asarray(x, jnp.float32))).max() < 0.0
    # a part smaller than 0.15 cells is added to another one
    assert 0.14 * dx**3 < volume.min() and volume.max() < 1.5 * dx**3


@pytest.mark.parametrize("name", SAMPLE)
def test_dummies_go_as_deep_as_the_water_feels(name):
    """Every point of the surface layers has a dummy particle within a cell's diagonal, and none is deeper."""
    shape, dx, layers = SINGLE[name], 0.03, 2
    x, _ = shape.dummies(dx, layers)
    depth = -np.asarray(shape.distance(jnp.asarray(x, jnp.float32)))
    assert depth.max() < layers * dx
    inside, _ = points_inside(shape, count=40)
    shallow = inside[np.asarray(shape.distance(jnp.asarray(inside, jnp.float32))) > -(layers - 1.0) * dx]
    assert KDTree(x).query(shallow)[0].max() < np.sqrt(3.0) * dx


@pytest.mark.parametrize("name", SINGLE)
def test_distances_have_finite_slopes_and_unit_slopes_where_the_nearest_point_is_unique(name):
    """Slopes are finite at edges and axes too. Outside a convex shape the nearest point is unique."""
    shape = SINGLE[name]
    x = np.concatenate([np.random.default_rng(0).uniform(0.0, 0.6, (1000, 3)), np.full((1, 3), 0.3)])
    slopes = jax.vmap(jax.value_and_grad(lambda x: shape.distance(x[None])[0]))
    away, slope = map(np.asarray, slopes(jnp.asarray(x, jnp.float32)))
    size = np.linalg.norm(slope, axis=1)
    assert np.isfinite(away).all() and size.max() < 1.001
    # within a tenth of a millimetre of the surface the guard of the roots shows
    outside = away > (1e-4 if name != "ring" else np.inf)
    np.testing.assert_allclose(size[outside], 1.0, atol=1e-3)


@pytest.mark.parametrize("angle", [0.7, (0.0, 0.7, 0.0), (0.5, -0.3, 1.1)])
def test_a_turned_capsule_is_the_capsule_with_turned_ends(angle):
    """A rotation about y has one angle or three; the second of three angles is the same rotation."""
    turned = Placed(CAPSULE, by=(0.02, 0.01, -0.03), angle=angle, about=(0.3, 0.3, 0.3))
    foot, head = turned.moved(np.array([CAPSULE.foot, CAPSULE.head]))
    alpha, beta, gamma = (0.0, angle, 0.0) if isinstance(angle, float) else angle
    matrix = Rotation.from_euler("xyz", [alpha, beta, gamma]).as_matrix()
    np.testing.assert_allclose(foot, matrix @ (CAPSULE.foot - 0.3) + [0.32, 0.31, 0.27], atol=1e-12)
    x = jnp.asarray(points_inside(SPHERE, count=12)[0], jnp.float32)
    moved = Capsule(tuple(foot), tuple(head), 0.12)
    np.testing.assert_allclose(turned.distance(x), moved.distance(x), atol=1e-6)
    low, high = turned.bounds()
    assert np.all(low < moved.bounds()[0] + 1e-12) and np.all(high > moved.bounds()[1] - 1e-12)


def test_a_capsule_is_a_cylinder_between_two_spheres():
    x = jnp.asarray(np.random.default_rng(0).uniform(0.0, 0.6, (500, 3)), jnp.float32)
    ends = Sphere(tuple(CAPSULE.foot), 0.12), Sphere(tuple(CAPSULE.head), 0.12)
    whole = Union((Cylinder(tuple(CAPSULE.foot), tuple(CAPSULE.head), 0.12), *ends))
    outside = np.asarray(CAPSULE.distance(x)) > 0.0
    np.testing.assert_allclose(CAPSULE.distance(x)[outside], whole.distance(x)[outside], atol=1e-6)


def test_a_revolution_of_a_rectangle_is_a_cylinder():
    """The side of the profile along the axis is not a surface."""
    barrel = Revolution(((0.0, 0.1), (0.15, 0.1), (0.15, 0.5), (0.0, 0.5)), (0.3, 0.3))
    x = jnp.asarray(np.random.default_rng(1).uniform(0.0, 0.6, (500, 3)), jnp.float32)
    np.testing.assert_allclose(barrel.distance(x), UPRIGHT.distance(x), atol=1e-6)
    np.testing.assert_allclose(barrel.moments()[0], UPRIGHT.moments()[0], rtol=1e-12)
    np.testing.assert_allclose(barrel.moments()[2], UPRIGHT.moments()[2], atol=1e-15)


def test_a_cylinder_has_the_distances_of_its_side_ends_and_rims():
    x = jnp.asarray([[0.3, 0.3, 0.3], [0.5, 0.3, 0.3], [0.3, 0.3, 0.6], [0.3, 0.49, 0.53], [0.3, 0.3, 0.12]])
    np.testing.assert_allclose(UPRIGHT.distance(x), [-0.15, 0.05, 0.1, 0.05, -0.02], atol=1e-6)


@pytest.mark.parametrize("name", SHAPES)
def test_bounds_and_silhouette_enclose_the_shape(name):
    x, _ = points_inside(SHAPES[name])
    low, high = SHAPES[name].bounds()
    assert np.all(x > low) and np.all(x < high)
    if name == "turned":
        return  # its bounds are those of the turned box around the capsule
    # the lattice of points leaves up to its spacing free
    np.testing.assert_allclose([x.min(axis=0), x.max(axis=0)], [low, high], atol=0.012)
    x0, z0, x1, z1 = SHAPES[name].region().bounds
    np.testing.assert_allclose([x0, z0, x1, z1], [*low[[0, 2]], *high[[0, 2]]], atol=2e-3)


TANK = {
    "dx": 0.05,
    "t1": 0.1,
    "tank": {"length": 1.2, "width": 0.8, "depth": 0.5},
    "scheme": {"kind": "incompressible"},
}
BUOY = {"sphere": {"centre": [0.6, 0.4, 0.5], "radius": 0.15}, "free": ["heave"], "density": 500.0}
POST = {"cylinder": {"foot": [0.3, 0.4, 0.0], "head": [0.3, 0.4, 0.6], "radius": 0.1}}


LATHE = {"axis": [0.6, 0.4]}
PRISM = {"outline": [[0.3, 0.3], [0.5, 0.3], [0.4, 0.5]], "z": [0.0, 0.4]}


def test_spheres_beside_each_other_do_not_overlap():
    """The boxes around two spheres may overlap, and so may their silhouettes."""
    spheres = (
        {"sphere": {"centre": [0.25, 0.2, 0.2], "radius": 0.15}},
        {"sphere": {"centre": [0.45, 0.45, 0.3], "radius": 0.15}},
    )
    case = Case.from_dict(TANK | {"solid": dict(zip("ab", spheres, strict=True))})
    assert {"a", "b"} <= set(case.solid)


@pytest.mark.parametrize(
    ("sections", "message"),
    [
        (
            {"body": BUOY | {"sphere": {"centre": [0.6, 0.4, 0.5], "radius": 0.04}}},
            "body.sphere.radius = 0.04 m",
        ),
        ({"body": BUOY | {"sphere": {"centre": [1.1, 0.4, 0.5], "radius": 0.15}}}, "body extends outside"),
        ({"body": BUOY | {"sphere": {"centre": [0.6, 0.4], "radius": 0.15}}}, "body.sphere.centre"),
        ({"body": BUOY | {"disc": {"centre": [0.6, 0.5], "radius": 0.1}}}, "give exactly one of"),
        ({"body": {"disc": {"centre": [0.6, 0.5], "radius": 0.1}}}, "2 dimensions, but the tank has 3"),
        (
            {"solid": {"post": POST}, "tank": {"length": 1.2, "depth": 0.5}},
            "3 dimensions, but the tank has 2",
        ),
        (
            {"solid": {"post": {"cylinder": POST["cylinder"] | {"head": [0.3, 0.4, 0.0]}}}},
            "foot and head are the same point",
        ),
        (
            {"solid": {"post": {"cylinder": POST["cylinder"] | {"head": [0.3, 0.4, 0.03]}}}},
            "solid.post.cylinder is 0.03 m long",
        ),
        (
            {"solid": {"post": {"cylinder": POST["cylinder"] | {"foot": [0.3, 0.4, -0.2]}}}},
            "solid.post extends outside",
        ),
        ({"body": BUOY, "solid": {"post": {"sphere": BUOY["sphere"]}}}, "body and solid.post have"),
        ({"solid": {"post": {"capsule": POST["cylinder"] | {"radius": 0.03}}}}, "solid.post.capsule.radius"),
        ({"solid": {"post": {"capsule": POST["cylinder"]}}}, "solid.post extends outside"),
        (
            {"solid": {"post": {"revolution": LATHE | {"profile": [[-0.1, 0], [0.2, 0], [0, 0.3]]}}}},
            "profile has a corner at r = -0.1 m",
        ),
        (
            {
                "solid": {
                    "post": {
                        "revolution": {
                            "profile": [[0, 0], [0.2, 0.3], [0.2, 0], [0, 0.3]],
                            "axis": [0.6, 0.4],
                        }
                    }
                }
            },
            "solid.post.revolution.profile: the sides must not cross",
        ),
        ({"solid": {"post": {"extrusion": PRISM | {"z": None}}}}, "give exactly one of x, y and z"),
        ({"solid": {"post": {"extrusion": PRISM | {"z": [0.3, 0.1]}}}}, "must be an increasing pair"),
        (
            {"solid": {"post": {"extrusion": PRISM | {"z": [0.1, 0.12]}}}},
            "solid.post.extrusion.z: the prism is",
        ),
        (
            {
                "tank": {"length": 1.2, "depth": 0.5},
                "solid": {"post": {"block": {"low": [0.4, 0], "high": [0.6, 0.2]}, "turned": [0, 0.1, 0]}},
            },
            "turned is only for shapes in three dimensions",
        ),
        (
            {"solid": {"post": {"mesh": {"packed": "c3VyZmFjZQ=="}}}},
            "is not the packed surface of a mesh file",
        ),
    ],
)
def test_impossible_shapes_are_refused(sections, message):
    with pytest.raises(CaseError, match=message):
        Case.from_dict(TANK | sections)


@pytest.mark.slow
def test_water_and_solids_fill_the_tank():
    """The water's volume is that of the tank less the wet parts of a sphere and a post, in both schemes."""
    case = Case.from_dict(TANK | {"body": BUOY, "solid": {"post": POST}})
    _, state = js.build(case)
    wet = 0.5 * SPHERE.moments()[0] * (0.15 / 0.2) ** 3 + np.pi * 0.1**2 * 0.5
    water = float(np.sum(np.asarray(state.particles.m))) / case.fluid.rho0
    # the packing leaves a thousandth of the volume
    np.testing.assert_allclose(water, 1.2 * 0.8 * 0.5 - wet, rtol=2e-3)


@pytest.mark.slow
def test_a_floating_sphere_and_an_upright_cylinder_stay_at_their_draughts():
    """After 1 s in still water, at half of the water's density: within 0.3 spacings, as in two dimensions."""
    barrel = {"cylinder": {"foot": [0.6, 0.4, 0.35], "head": [0.6, 0.4, 0.65], "radius": 0.15}}
    for body in (BUOY, {"free": ["heave"], "density": 500.0} | barrel):
        solution = js.run(Case.from_dict(TANK | {"body": body, "t1": 1.0}), progress=False)
        heave = np.asarray(solution["heave"])
        assert np.abs(heave).max() < 0.3 * TANK["dx"]
