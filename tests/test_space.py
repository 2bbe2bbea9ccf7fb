"""The view of a run in three dimensions on its page: solids, poses, the free surface, and the picture."""

import sys

import numpy as np
import pytest
from conftest import needs_browser
from scipy.spatial.transform import Rotation
from test_report import read

import jaxsph as js
from jaxsph.case.extras import library
from jaxsph.case.meshes import Triangles
from jaxsph.output.hdf5 import Variable
from jaxsph.output.run_file import RunFile
from jaxsph.report import space
from jaxsph.report.pack import UNSEEN
from jaxsph.report.page import record_of
from jaxsph.report.solids import full_pivot, full_pose, rotation, shaded, solids_of, surface_of
from jaxsph.report.surfaces import HeightGrid, in_levels
from jaxsph.run.scene import scene_of
from jaxsph.solids.composed import Difference, Placed
from jaxsph.solids.shapes import Block
from jaxsph.solids.volumes import Cylinder, Sphere

BALL = js.load_case("sphere_decay").replace(
    {
        "dx": 0.1,
        "tank": {"length": 1.6, "width": 1.6, "depth": 0.9},
        "body.sphere.centre": [0.8, 0.8, 0.93],
    }
)
DX = 0.05
# Number of colours in the picture, which is drawn anew because WebGL forgets a picture once it is shown.
COLOURS = """() => {
    show();
    const canvas = document.querySelector("canvas.space"), gl = canvas.getContext("webgl2");
    const pixels = new Uint8Array(4 * canvas.width * canvas.height);
    gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    return new Set(new Uint32Array(pixels.buffer)).size;
}"""


# --- solids


@pytest.mark.parametrize(
    ("shape", "volume"),
    [
        (Sphere((0.3, 0.2, 0.1), 0.4), 4.0 / 3.0 * np.pi * 0.4**3),
        (Block((0.0, 0.0, 0.0), (1.0, 0.5, 0.25)), 0.125),
        (Placed(Cylinder((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0.3), angle=(0.4, 0.2, 0.1)), np.pi * 0.09),
        (Difference(Sphere((0.0, 0.0, 0.0), 0.5), Sphere((0.0, 0.0, 0.0), 0.25)), np.pi / 6 * 0.875),
    ],
)
def test_surface_of_a_shape_is_closed_and_encloses_its_volume(shape, volume):
    trimesh = library("trimesh", "geometry", "a test")
    found = surface_of(shape)
    mesh = trimesh.Trimesh(*found, process=False)
    assert mesh.is_watertight and mesh.is_winding_consistent
    # the edges of the box, 7 m long, are cut off by at most half the square of a grid interval: 1.2 %
    assert abs(mesh.volume) == pytest.approx(volume, rel=0.015) and len(found.faces) <= 4000
    assert mesh.volume > 0.0  # the triangles face outwards, towards the light
    sharp = shaded(found)
    assert trimesh.Trimesh(*sharp, process=False).volume == pytest.approx(mesh.volume, rel=1e-3)


def test_shape_thinner_than_the_grid_has_no_surface():
    plate = Block((0.0, 0.0, 0.0), (1.0, 1.0, 0.0))
    assert not len(surface_of(plate).faces)


def test_poses_of_either_form_turn_points_as_scipy_does():
    rng = np.random.default_rng(2)
    for vector in [np.zeros(3), np.array([1e-9, 0, 0]), *rng.normal(size=(5, 3))]:
        np.testing.assert_allclose(rotation(vector), Rotation.from_rotvec(vector).as_matrix(), atol=1e-12)
    six = rng.normal(size=6)
    np.testing.assert_array_equal(full_pose(six), six)
    pose = full_pose([0.1, 0.2, 0.3])
    np.testing.assert_array_equal(pose, [0.1, 0.0, 0.2, 0.0, 0.3, 0.0])
    # pitch is positive from z towards x
    np.testing.assert_allclose(rotation(pose[3:]) @ [0, 0, 1], [np.sin(0.3), 0.0, np.cos(0.3)], atol=1e-12)
    np.testing.assert_array_equal(full_pivot([1.0, 2.0]), [1.0, 0.0, 2.0])
    np.testing.assert_array_equal(full_pivot([1.0, 2.0, 3.0]), [1.0, 2.0, 3.0])


@pytest.fixture(scope="module")
def ball():
    """Solid of the sphere's case, with its scene."""
    problem = BALL.problem()
    scene = scene_of(problem)
    (solid,) = solids_of(BALL, scene)
    return solid, scene


def test_solid_of_a_case_is_where_the_case_puts_it_and_moves_with_its_pose(ball):
    solid, _ = ball
    assert solid.name == "body" and solid.floats
    np.testing.assert_allclose(solid.surface.vertices.mean(axis=0), [0.8, 0.8, 0.93], atol=1e-3)
    pose = np.array([0.1, 0.05, 0.02, 0.3, -0.2, 0.1])
    turned = (
        Rotation.from_rotvec(pose[3:]).apply(solid.surface.vertices - solid.pivot) + solid.pivot + pose[:3]
    )
    assert np.abs(solid.distance(turned, pose)).max() < 0.01 * 0.15


def test_plates_and_the_paddle_reach_across_the_tank():
    case = js.load_case("wave_tank_3d")
    scene = {"solids": [
        {"name": "paddle", "corners": [[-9, -9], [0, -9], [0, 9], [-9, 9]], "pivot": [0, 0]},
        {"name": "", "corners": [[1.0, 0.1], [1.1, 0.1], [1.1, 9.0], [1.0, 9.0]], "pivot": [0, 0]},
    ]}  # fmt: skip
    plate, paddle = solids_of(case, scene)
    width = case.tank.width
    for one in (paddle, plate):
        assert not one.floats
        assert np.ptp(one.surface.vertices[:, 1]) == pytest.approx(width, rel=0.01)
    assert paddle.surface.vertices[:, 0].max() == pytest.approx(0.0, abs=0.01 * width)


def test_solid_from_a_file_is_drawn_by_its_own_triangles():
    case = js.load_case("hull")
    scene = {"solids": [{"name": "body", "corners": [], "pivot": [0.8, 0.5]}]}
    (hull,) = solids_of(case, scene)
    np.testing.assert_array_equal(hull.surface.vertices, case.body.corners())
    assert isinstance(hull.surface, Triangles)


# --- free surface


def wave_at(x, y):
    """Height (m) of a plane wave that runs obliquely."""
    return 0.6 + 0.06 * np.sin(2 * np.pi * (x + 0.5 * y) / 1.2)


def water(noise=0.0, size=(2.4, 1.2)):
    """Particles of a tank whose layers follow the wave, m."""
    rng = np.random.default_rng(3)
    plane = [np.arange(0.5 * DX, end, DX) for end in size]
    x, y = (a.ravel() for a in np.meshgrid(*plane, indexing="ij"))
    layers = (np.arange(12) + 0.5) / 12
    found = np.stack([np.repeat(x, 12), np.repeat(y, 12), (wave_at(x, y)[:, None] * layers).ravel()], 1)
    return found + noise * DX * rng.uniform(-1, 1, found.shape)


@pytest.mark.parametrize("noise", [0.0, 0.15])
def test_height_of_a_plane_wave_is_within_half_a_spacing(noise):
    grid = HeightGrid.over(np.zeros(2), np.array([2.4, 1.2]), DX, 10_000)
    x, y = grid.axes()
    assert x[0] == 0.0 and x[-1] == pytest.approx(2.4) and y[-1] == pytest.approx(1.2)
    heights = grid.heights(water(noise))
    error = heights - wave_at(*np.meshgrid(x, y, indexing="ij"))
    assert np.isfinite(heights).all()
    assert np.abs(error).max() < 0.5 * DX
    assert np.sqrt(np.mean(error**2)) < 0.2 * DX


def test_a_drop_in_the_air_is_not_the_surface_and_a_dry_bed_has_none():
    grid = HeightGrid.over(np.zeros(2), np.array([2.4, 1.2]), DX, 10_000)
    still = water()
    drop = np.concatenate([still, [[1.0, 0.6, 1.5]]])
    assert grid.heights(drop).max() < 0.7
    dry = grid.heights(still[still[:, 0] < 1.2])
    assert np.isnan(dry[-5:]).all() and np.isfinite(dry[:5]).all()


def test_there_is_no_surface_inside_a_body_and_no_gap_around_it():
    """A half-immersed sphere: below it is water too, whose top is the sphere's surface."""
    middle, radius = np.array([1.2, 0.6, 0.6]), 0.3
    x = water()
    x = x[np.linalg.norm(x - middle, axis=1) > radius]
    grid = HeightGrid.over(np.zeros(2), np.array([2.4, 1.2]), DX, 10_000)
    heights = grid.heights(x, lambda at: np.linalg.norm(at - middle, axis=1) < radius)
    away = np.hypot(*(a - b for a, b in zip(np.meshgrid(*grid.axes(), indexing="ij"), middle, strict=False)))
    assert np.isnan(heights[away < radius - 2 * grid.sides.max()]).all()
    assert np.isfinite(heights[away > radius - 0.3 * grid.sides.min()]).all()
    assert np.nanmin(heights) > 0.5


def test_heights_are_stored_within_a_hundredth_of_a_spacing():
    heights = np.array([[0.1, 0.2, np.nan], [0.35, 0.11, 0.3]])
    levels, low, step = in_levels(heights, DX)
    assert levels[0, 2] == UNSEEN
    seen = np.isfinite(heights)
    np.testing.assert_allclose((low + step * levels)[seen], heights[seen], atol=0.01 * DX)
    levels, low, step = in_levels(np.array([0.0, 1000.0]), DX)  # a range of more than 65534 levels
    assert low + step * levels[1] == pytest.approx(1000.0)


# --- page


def swayed(t):
    """Surge, heave (m) and pitch (rad) of the sphere at time t (s)."""
    return [0.0, 0.03 * np.sin(5.0 * t), 0.1 * np.sin(4.0 * t)]


def make_run(path, scene, frames=12, results=True, dx=DX, pose=swayed):
    """File of an artificial run of the sphere's case: waves pass the sphere, which heaves and pitches."""
    run = RunFile.create(path, BALL.to_toml(), {}, {}, scene=scene | {"dx": dx})
    rng, plane = np.random.default_rng(4), np.arange(0.5 * dx, 1.6, dx)
    rest = np.stack(np.meshgrid(plane, plane, np.arange(0.5 * dx, 0.9, dx), indexing="ij"), -1).reshape(-1, 3)
    rest = rest[np.linalg.norm(rest - [0.8, 0.8, 0.9], axis=1) > 0.16]
    for k in range(frames):
        t = 0.05 * (k + 1)
        x = rest + 0.1 * dx * rng.uniform(-1, 1, rest.shape)
        x[:, 2] *= 1.0 + 0.02 * np.sin(4.0 * x[:, 0] - 5.0 * t)
        snapshot = {
            "time": t,
            "step": k,
            "id": np.arange(len(x)),
            "x": x,
            "u": 0.1 * x,
            "p": 9810 * (0.9 - x[:, 2]),
        }
        series = {"time": np.array([t]), "heave": np.array(swayed(t)[1:2])}
        run.append(
            series,
            {"heave": Variable("m", "heave")},
            snapshot | {"body": np.array(pose(t))},
            {"a": np.zeros(1)},
            {},
        )
    if results:
        run.finish({"periods": 3.0})
    return path


@pytest.fixture(scope="module")
def run(tmp_path_factory, ball):
    return make_run(tmp_path_factory.mktemp("space") / "run.h5", ball[1])


@pytest.fixture(scope="module")
def run_page(run):
    return js.report(run)


def test_page_of_a_run_in_three_dimensions_has_the_view_and_is_small(run, run_page):
    text = run_page.read_text()
    assert 'id="three"' in text and not any(word in text for word in ("http://", "https://", "@import"))
    assert len(text) < 12e6
    player = read(record_of([run]))["runs"][0]["player"]
    view, frames = player["space"], len(player["t"])
    size = len(view["x"]) * len(view["y"])
    assert len(view["heights"]) == 2 * frames * size
    (solid,) = view["solids"]
    np.testing.assert_allclose(
        solid["poses"].reshape(frames, 6)[:, 4], 0.1 * np.sin(4.0 * player["t"]), atol=1e-6
    )
    assert solid["faces"].max() < len(solid["vertices"]) / 3
    # the grid's first frame, from the stored differences
    small = view["heights"][:size].astype(int) + 256 * view["heights"][size : 2 * size].astype(int)
    levels = ((small >> 1) ^ -(small & 1)) % 65536
    heights = view["low"] + view["step"] * levels[levels != UNSEEN]
    # waves of 0.02 m, but no water below the sphere, which is 0.15 m deep
    assert np.count_nonzero(levels == UNSEEN) < 0.1 * size
    np.testing.assert_allclose(heights, 0.9, atol=0.03)


def test_poses_of_six_numbers_are_shown_in_both_pictures(tmp_path, ball):
    path = make_run(tmp_path / "run.h5", ball[1], frames=2, pose=lambda t: [0.1, 0.2, t, 0.3, 0.4, 0.5])
    player = read(record_of([path]))["runs"][0]["player"]
    np.testing.assert_allclose(
        player["space"]["solids"][0]["poses"][6:], [0.1, 0.2, 0.1, 0.3, 0.4, 0.5], rtol=1e-6
    )
    np.testing.assert_allclose(player["tank"]["solids"][0]["poses"][3:], [0.1, 0.1, 0.4], rtol=1e-6)


def test_sections_lie_across_the_tank_and_share_their_scales(run):
    player = read(record_of([run]))["runs"][0]["player"]
    places = [section["y"] for section in player["sections"]]
    assert len(places) == 5 and player["y"] == pytest.approx(0.8, abs=1e-3) == places[2]
    assert np.all(np.diff(places) > 1.5 * DX)
    for name, field in player["fields"].items():
        assert {section["fields"][name]["high"] for section in player["sections"]} == {field["high"]}
    assert all(section["count"] > 0 for section in player["sections"])


def test_page_without_the_library_says_what_to_install(run, tmp_path, monkeypatch):
    for module in (space, sys.modules["jaxsph.report.page"]):
        monkeypatch.setattr(module, "three", lambda: None)
    text = js.report(run, tmp_path / "page.html").read_text()
    player = read(record_of([run]))["runs"][0]["player"]
    assert 'id="three"' not in text and player["space"] is None
    assert player["missing"] == space.MISSING and "pip install" in space.MISSING


def test_library_is_whole_and_has_its_licence():
    text = space.three().decode()
    assert "license" in text[:200].lower()
    assert text.rstrip().endswith("}));") and "WebGLRenderer" in text and "TrackballControls" not in text


@needs_browser
def test_browser_draws_turns_and_plays_the_view(visit, run_page):
    page = visit(run_page)
    assert page.evaluate("jaxsph.spaces.length") == 1
    assert page.evaluate(COLOURS) > 100  # shaded solids and a coloured surface
    turned, far = "jaxsph.spaces[0].round", "jaxsph.spaces[0].far"
    before, t = page.evaluate(turned), page.evaluate("jaxsph.t")
    page.focus("canvas.space")
    page.keyboard.press("ArrowRight")
    page.keyboard.press("+")
    assert page.evaluate(turned) > before and page.evaluate(far) < 1.0
    assert page.evaluate("jaxsph.t") == t  # the arrow has not moved the time as well
    page.keyboard.press("0")
    assert page.evaluate(far) == 1.0
    canvas = page.locator("canvas.space")
    canvas.scroll_into_view_if_needed()
    box = canvas.bounding_box()
    page.mouse.move(box["x"] + 200, box["y"] + 100)
    page.mouse.down()
    page.mouse.move(box["x"] + 250, box["y"] + 100)
    page.mouse.up()
    assert page.evaluate(turned) > before + 0.1
    page.evaluate("seek(0.3)")
    heave = page.evaluate("jaxsph.spaces[0].solids[0].position.z")
    assert heave == pytest.approx(0.93 + 0.03 * np.sin(1.5), abs=1e-3)
    assert "free surface from" in canvas.get_attribute("aria-label")
    shown = page.evaluate("jaxsph.drawn")
    page.select_option(".section select", "0")
    assert page.evaluate("jaxsph.drawn") != shown
    assert page.evaluate("jaxsph.spaces[0].cut.position.y") < 0.4


@needs_browser
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [390, 1200])
def test_browser_finds_no_barrier_in_the_view(visit, run_page, width, scheme):
    from axe_playwright_python.sync_playwright import Axe

    page = visit(run_page, viewport={"width": width, "height": 800}, color_scheme=scheme)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    rules = {"runOnly": ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa"]}
    found = Axe().run(page, options=rules).response["violations"]
    assert not [one["id"] for one in found if one["impact"] in ("serious", "critical")]


@needs_browser
def test_browser_keeps_the_view_of_a_run_that_goes_on(visit, tmp_path, ball):
    path = make_run(tmp_path / "run.h5", ball[1], frames=3, results=False)
    with js.Watch(path) as served:
        page = visit(served.address)
        page.wait_for_function("jaxsph.taken === 1")
        page.evaluate("jaxsph.spaces[0].turnBy(1.0, 0.0); window.before = jaxsph.spaces[0]")
        page.select_option(".section select", "1")
        RunFile.open(path).finish({"periods": 3.0})
        page.wait_for_function("jaxsph.taken === 2")
        # the same canvas: a browser has few of them for WebGL
        assert page.evaluate("jaxsph.spaces.length === 1 && jaxsph.spaces[0] === before")
        assert page.evaluate("jaxsph.spaces[0].round") == pytest.approx(1.55)
        assert page.input_value(".section select") == "1"


@needs_browser
@pytest.mark.slow
def test_browser_draws_the_view_fast(visit, tmp_path, ball):
    """Twenty pictures a second without a graphics card, and 12 MB, for 147,000 particles and 37 frames."""
    path = js.report(make_run(tmp_path / "run.h5", ball[1], frames=37, dx=0.025))
    size = path.stat().st_size / 1e6
    page = visit(path)
    first = page.evaluate("jaxsph.firstPicture")
    page.evaluate("jaxsph.pictures = 0; jaxsph.speed = 0.25; seek(0); play(true)")
    page.wait_for_timeout(4000)
    rate = page.evaluate("jaxsph.pictures") / 4.0
    print(f"{size:.1f} MB, first picture {first:.0f} ms, {rate:.0f} pictures a second")
    assert size < 12.0
    assert rate > 20
