"""Meshes as shapes: distances and moments, files that are not closed, thin walls, and the text in a case."""

import tomllib
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import trimesh

import jaxsph as js
from experiments.hull import hull
from jaxsph.case.case import Case
from jaxsph.case.meshes import Triangles, mesh_of, read_mesh, thin_places
from jaxsph.errors import CaseError
from jaxsph.solids.volumes import Capsule

CAPSULE = Capsule((0.3, 0.3, 0.25), (0.3, 0.3, 0.4), 0.12)
DX = 0.025
TANK = """
dx = 0.05
t1 = 0.1
tank = {{ length = 1.2, width = 0.8, depth = 0.5 }}
scheme = {{ kind = "incompressible" }}
[body]
file = "{file}"
scale = 0.001
at = [0.6, 0.4, 0.5]
density = 500.0
free = ["heave"]
"""


def surface(mesh):
    return Triangles(np.asarray(mesh.vertices), np.asarray(mesh.faces))


def packed(mesh):
    return surface(mesh).packed()


@pytest.fixture(scope="module")
def capsule():
    """The capsule, in triangles of a sixth of its radius, whose chords cut off 0.3 % of it."""
    mesh = trimesh.creation.capsule(height=0.15, radius=0.12, count=[64, 64])
    mesh.apply_translation([0.3, 0.3, 0.25] - mesh.bounds[0] - [0.12, 0.12, 0.0] + [0.0, 0.0, -0.12])
    return surface(mesh)


def test_distances_and_moments_are_those_of_the_shape(capsule):
    """Within a spacing of the surface the distance is that of the shape, to a fortieth of a spacing."""
    mesh = mesh_of(capsule.packed(), DX)
    x = jnp.asarray(np.random.default_rng(0).uniform(0.1, 0.6, (4000, 3)), jnp.float32)
    exact, found = np.asarray(CAPSULE.distance(x)), np.asarray(mesh.distance(x))
    near = np.abs(exact) < DX
    # Linear interpolation between points an interval h apart is off by h^2/8 for each of two curvatures; a
    # spacing inside the surface their radius is 0.095 m: 0.016 of a spacing. The chords are off by 0.006.
    assert np.abs(found - exact)[near].max() < 0.025 * DX
    outside = exact > 0.0
    assert np.all(found[outside] > exact[outside] - 0.025 * DX)  # an upper bound far away
    volume, centre, second = mesh.moments()
    exact_volume, exact_centre, exact_second = CAPSULE.moments()
    np.testing.assert_allclose(volume, exact_volume, rtol=5e-3)
    np.testing.assert_allclose(second, exact_second, atol=5e-3 * np.max(exact_second))
    np.testing.assert_allclose(centre, exact_centre, atol=1e-4)
    np.testing.assert_allclose(mesh.bounds(), CAPSULE.bounds(), atol=1e-3)


def test_the_distance_has_a_derivative(capsule):
    """Outside and inside it points away from the surface, with a magnitude of one to a tenth."""
    mesh = mesh_of(capsule.packed(), DX)
    slope = jax.vmap(jax.grad(lambda x: mesh.distance(x[None])[0]))
    x = jnp.asarray([[0.45, 0.31, 0.3], [0.38, 0.3, 0.33], [0.3, 0.31, 0.55], [0.05, 0.3, 0.3]], jnp.float32)
    exact = jax.vmap(jax.grad(lambda x: CAPSULE.distance(x[None])[0]))(x)
    np.testing.assert_allclose(slope(x), exact, atol=0.1)


def test_dummies_have_the_volume_of_the_mesh(capsule):
    mesh = mesh_of(capsule.packed(), DX)
    x, volume = mesh.dummies(DX, 100)
    np.testing.assert_allclose(volume.sum(), mesh.moments()[0], rtol=1e-6)
    np.testing.assert_allclose(volume @ x / volume.sum(), [0.3, 0.3, 0.325], atol=2e-3 * DX)


def test_the_built_in_hull_is_that_of_its_formula():
    """In millimetres, to float32."""
    read, made = read_mesh(Path(js.__file__).parent / "cases" / "hull.stl"), hull()
    found = trimesh.Trimesh(*read)
    assert len(read.faces) == len(made.faces) and found.volume == pytest.approx(made.volume, rel=1e-5)
    np.testing.assert_allclose(found.bounds, made.bounds, atol=1e-3)


@pytest.mark.parametrize("ending", ["stl", "obj"])
def test_a_file_becomes_a_body(tmp_path, ending):
    """The case contains the surface: it loads from its own text without the file."""
    ball = trimesh.creation.icosphere(subdivisions=3, radius=150.0)
    ball.export(tmp_path / f"ball.{ending}")
    (tmp_path / "case.toml").write_text(TANK.format(file=f"ball.{ending}"))
    case = js.load_case(tmp_path / "case.toml")
    (tmp_path / f"ball.{ending}").unlink()
    assert Case.from_dict(tomllib.loads(case.to_toml())) == case
    low, high = case.body.placed(0.05).bounds()
    np.testing.assert_allclose([low, high], [[0.45, 0.25, 0.35], [0.75, 0.55, 0.65]], atol=2e-3)


def test_a_surface_with_a_hole_is_refused_with_its_place(tmp_path):
    box = trimesh.creation.box((2.0, 2.0, 2.0))
    top = np.flatnonzero(box.triangles_center[:, 2] > 0.99)
    box.update_faces(np.delete(np.arange(12), top[0]))
    box.export(tmp_path / "box.stl")
    with pytest.raises(CaseError, match=r"not watertight: 3 edges .* the first at \((-1, 0|0, -1|0, 0), 1\)"):
        read_mesh(tmp_path / "box.stl")


def test_triangles_that_face_both_ways_are_refused(tmp_path):
    box = trimesh.creation.box((1.0, 1.0, 1.0))
    faces = np.array(box.faces)
    faces[0] = faces[0][::-1]
    text = "".join(f"v {' '.join(map(str, v))}\n" for v in box.vertices)
    (tmp_path / "box.obj").write_text(text + "".join(f"f {' '.join(map(str, f + 1))}\n" for f in faces))
    with pytest.raises(CaseError, match="unify the normals"):
        read_mesh(tmp_path / "box.obj")


def test_a_surface_turned_inside_out_is_mended(tmp_path):
    box = trimesh.creation.box((1.0, 1.0, 1.0))
    box.invert()
    box.export(tmp_path / "box.stl")
    assert mesh_of(read_mesh(tmp_path / "box.stl").packed(), 0.1).moments()[0] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("name", "content"), [("a.stl", b"solid"), ("a.obj", b"f 1 2 3\n"), ("a.stl", b"\0" * 300)]
)
def test_damaged_files_are_refused(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(CaseError, match="cannot be read as a mesh|contains no triangles"):
        read_mesh(tmp_path / name)


def test_thin_walls_are_found_and_edges_are_not():
    """A wall 1.5 spacings thick is thin; a cube has edges everywhere and is not."""
    assert not len(thin_places(packed(trimesh.creation.box((0.1, 0.1, 0.1)).subdivide().subdivide()), 0.02))
    plate = packed(trimesh.creation.box((0.4, 0.03, 0.3)).subdivide())
    assert len(thin_places(plate, 0.02)) and not len(thin_places(plate, 0.014))


def test_a_mesh_of_another_size_is_refused(tmp_path):
    """A file in metres read as millimetres, and one in millimetres read as metres."""
    trimesh.creation.icosphere(subdivisions=2, radius=0.15).export(tmp_path / "ball.stl")
    (tmp_path / "case.toml").write_text(TANK.format(file="ball.stl"))
    with pytest.raises(CaseError, match=r"body.mesh extends over 0.0003 m .* \(scale gives"):
        js.load_case(tmp_path / "case.toml")
    (tmp_path / "case.toml").write_text(TANK.format(file="ball.stl").replace("0.001", "1000.0"))
    with pytest.raises(CaseError, match=r"body.mesh: the grid of distances .* \(scale gives"):
        js.load_case(tmp_path / "case.toml")


@pytest.mark.parametrize(("key", "value"), [("scale", "0.0"), ("at", "[0.6, 0.5]"), ("scale", '"mm"')])
def test_options_of_a_mesh_are_checked(tmp_path, key, value):
    trimesh.creation.icosphere(subdivisions=2, radius=150.0).export(tmp_path / "ball.stl")
    lines = TANK.format(file="ball.stl").splitlines()
    text = "\n".join(f"{key} = {value}" if line.startswith(f"{key} ") else line for line in lines)
    (tmp_path / "case.toml").write_text(text)
    with pytest.raises(CaseError, match=f"body.{key} = "):
        js.load_case(tmp_path / "case.toml")
