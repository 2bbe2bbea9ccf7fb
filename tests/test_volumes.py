"""Shapes in three dimensions: distances, moments and dummy particles; unions and differences; cases."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import KDTree

import jaxsph as js
from jaxsph.case.case import Case
from jaxsph.errors import CaseError
from jaxsph.solids.composed import Difference, Union
from jaxsph.solids.shapes import AbstractShape
from jaxsph.solids.volumes import Cylinder, Sphere

SPHERE = Sphere((0.31, 0.28, 0.3), 0.2)
UPRIGHT = Cylinder((0.3, 0.3, 0.1), (0.3, 0.3, 0.5), 0.15)
OBLIQUE = Cylinder((0.15, 0.2, 0.2), (0.45, 0.4, 0.35), 0.1)
SHELL = Difference(Sphere((0.3, 0.3, 0.3), 0.2), Sphere((0.3, 0.3, 0.3), 0.1))
DUMBBELL = Union((Sphere((0.15, 0.3, 0.3), 0.1), Sphere((0.45, 0.3, 0.3), 0.1)))
SINGLE = {"sphere": SPHERE, "upright": UPRIGHT, "oblique": OBLIQUE}
SHAPES = SINGLE | {"shell": SHELL, "dumbbell": DUMBBELL}


def points_inside(shape, side=0.6, count=120):
    """Points of a cubic lattice inside a shape, and the volume of each."""
    at = (np.arange(count) + 0.5) * side / count
    x = np.stack(np.meshgrid(at, at, at, indexing="ij"), -1).reshape(-1, 3)
    return x[np.asarray(shape.distance(jnp.asarray(x, jnp.float32))) < 0], (side / count) ** 3


@pytest.mark.parametrize("name", SHAPES)
def test_moments_are_those_of_points_inside(name):
    """The lattice gives volumes to the share of points on the surface, half a per cent."""
    x, cell = points_inside(SHAPES[name])
    volume, centre, second = SHAPES[name].moments()
    np.testing.assert_allclose(len(x) * cell, volume, rtol=5e-3)
    np.testing.assert_allclose(x.mean(axis=0)[[0, 2]], centre, atol=1e-3)
    np.testing.assert_allclose(np.sum((x[:, [0, 2]] - centre) ** 2) * cell, second, rtol=1e-2)


@pytest.mark.parametrize("name", SINGLE)
def test_moments_in_closed_form_are_those_of_the_distance(name):
    """The sums over a grid of 96 cells converge with the square of its spacing: 1e-3, twice this at edges."""
    shape = SINGLE[name]
    exact, summed = shape.moments(), AbstractShape.moments(shape)
    np.testing.assert_allclose(summed[0], exact[0], rtol=1e-3)
    np.testing.assert_allclose(summed[1], exact[1], atol=1e-4)
    np.testing.assert_allclose(summed[2], exact[2], rtol=2e-3)


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("dx", [0.04, 0.023])
def test_dummies_have_volume_and_centre_of_the_shape(name, dx):
    shape = SHAPES[name]
    x, volume = shape.dummies(dx, 100)
    total, centre, _ = shape.moments()
    np.testing.assert_allclose(volume.sum(), total, rtol=1e-6)
    np.testing.assert_allclose((volume @ x / volume.sum())[[0, 2]], centre, atol=2e-3 * dx)
    assert np.asarray(shape.distance(jnp.asarray(x, jnp.float32))).max() < 0.0
    # a part smaller than 0.15 cells is added to another one
    assert 0.14 * dx**3 < volume.min() and volume.max() < 1.5 * dx**3


@pytest.mark.parametrize("name", SINGLE)
def test_dummies_go_as_deep_as_the_water_feels(name):
    """Every point of the surface layers has a dummy particle within a cell's diagonal, and none is deeper."""
    shape, dx, layers = SINGLE[name], 0.02, 3
    x, _ = shape.dummies(dx, layers)
    depth = -np.asarray(shape.distance(jnp.asarray(x, jnp.float32)))
    assert depth.max() < layers * dx
    inside, _ = points_inside(shape, count=40)
    shallow = inside[np.asarray(shape.distance(jnp.asarray(inside, jnp.float32))) > -(layers - 1.0) * dx]
    assert KDTree(x).query(shallow)[0].max() < np.sqrt(3.0) * dx


@settings(max_examples=25)
@given(st.tuples(*[st.floats(0.0, 0.6)] * 3))
def test_distances_have_unit_slopes_away_from_edges_and_axes(at):
    """The gradient of a distance is a unit vector wherever the nearest point of the surface is unique."""
    for shape in SINGLE.values():
        away, slope = jax.value_and_grad(lambda x, shape=shape: shape.distance(x[None])[0])(jnp.asarray(at))
        assert np.isfinite(away) and np.linalg.norm(slope) < 1.001
        if isinstance(shape, Sphere) and np.linalg.norm(np.subtract(at, shape.centre)) > 1e-3:
            np.testing.assert_allclose(np.linalg.norm(slope), 1.0, atol=1e-3)


def test_a_cylinder_has_the_distances_of_its_side_ends_and_rims():
    x = jnp.asarray([[0.3, 0.3, 0.3], [0.5, 0.3, 0.3], [0.3, 0.3, 0.6], [0.3, 0.49, 0.53], [0.3, 0.3, 0.12]])
    np.testing.assert_allclose(UPRIGHT.distance(x), [-0.15, 0.05, 0.1, 0.05, -0.02], atol=1e-6)


@pytest.mark.parametrize("name", SHAPES)
def test_bounds_and_silhouette_enclose_the_shape(name):
    x, _ = points_inside(SHAPES[name])
    low, high = SHAPES[name].bounds()
    assert np.all(x > low) and np.all(x < high)
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


@pytest.mark.parametrize(
    ("sections", "message"),
    [
        (
            {"body": BUOY | {"sphere": {"centre": [0.6, 0.4, 0.5], "radius": 0.04}}},
            "body.sphere.radius = 0.04 m",
        ),
        ({"body": BUOY | {"sphere": {"centre": [1.1, 0.4, 0.5], "radius": 0.15}}}, "body: extends outside"),
        ({"body": BUOY | {"sphere": {"centre": [0.6, 0.4], "radius": 0.15}}}, "body.sphere.centre"),
        ({"body": BUOY | {"disc": {"centre": [0.6, 0.5], "radius": 0.1}}}, "give exactly one of"),
        ({"body": {"disc": {"centre": [0.6, 0.5], "radius": 0.1}}}, "2 dimensions, and the tank has 3"),
        (
            {"solid": {"post": POST}, "tank": {"length": 1.2, "depth": 0.5}},
            "3 dimensions, and the tank has 2",
        ),
        (
            {"solid": {"post": {"cylinder": POST["cylinder"] | {"head": [0.3, 0.4, 0.0]}}}},
            "foot and head are the same point",
        ),
        (
            {"solid": {"post": {"cylinder": POST["cylinder"] | {"head": [0.3, 0.4, 0.03]}}}},
            "solid.post.cylinder: is 0.03 m long",
        ),
        (
            {"solid": {"post": {"cylinder": POST["cylinder"] | {"foot": [0.3, 0.4, -0.2]}}}},
            "solid.post: extends outside",
        ),
        ({"body": BUOY, "solid": {"post": {"sphere": BUOY["sphere"]}}}, "body and solid.post: have"),
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
