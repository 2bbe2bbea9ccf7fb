"""The page of a run and of a sweep: its contents without a browser, and in a browser if there is one."""

import gzip
import json
import os
import re
import sys
import threading
import time
import urllib.error
import urllib.parse
import urllib.request

import h5py
import numpy as np
import pytest
from conftest import needs_browser

import jaxsph as js
from jaxsph.errors import CaseError, FileError
from jaxsph.output.hdf5 import Variable
from jaxsph.output.run_file import RunFile
from jaxsph.output.sweep_file import Meanings, SweepFile
from jaxsph.report.content import extremes_of, panels
from jaxsph.report.frames import FIELDS, UNSEEN, Frames, local_flow
from jaxsph.report.labels import LABELS, in_order
from jaxsph.report.pack import KINDS, Pack
from jaxsph.report.page import record_of
from jaxsph.report.sweeps import sweep_content

OWC = js.load_case("owc").replace({"dx": 0.04, "device.wall_thickness": 0.04})
# Number of colours in the picture of the water.
COLOURS = """() => {
    const canvas = document.querySelector("canvas.water");
    const data = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
    return new Set(new Uint32Array(data.buffer)).size;
}"""
# Pictures per second, for drawing alone.
DRAW = """() => {
    const began = performance.now();
    for (let k = 0; k < 40; k++) seek(2 + 0.3 * k);
    return 40000 / (performance.now() - began);
}"""

SCENE = {
    "dx": 0.04,
    "low": [0.0, 0.0],
    "high": [7.84, 0.8],
    "walls": [False, True, True],
    "level": 0.44,
    "solids": [
        {"name": "paddle", "corners": [[-9, -9], [0, -9], [0, 9], [-9, 9]], "pivot": [0, 0]},
        {"name": "", "corners": [[7.67, 0.28], [7.71, 0.28], [7.71, 9], [7.67, 9]], "pivot": [0, 0]},
    ],
}
"""Scene around the particles of an artificial run: a paddle, and a plate in front of the end."""


def make_run(path, particles=400, frames=6, results=True, case=OWC, samples=200, two=True):
    """File of an artificial run whose water rotates as a rigid body about the middle of the tank."""
    gauges = {"gauge_x": ("gauge", np.array([1.0, 2.0]), "m", "gauges")}
    run = RunFile.create(path, case.to_toml(), {}, gauges, scene=SCENE)
    rng, side = np.random.default_rng(0), int(np.sqrt(particles))
    x = np.stack(np.meshgrid(np.linspace(0.1, 7.7, side), np.linspace(0.02, 0.4, side)), -1).reshape(-1, 2)
    x += 1e-3 * rng.normal(size=x.shape)
    if not two:
        x = np.stack([x[:, 0], np.where(np.arange(len(x)) % 2, 0.5, 0.05), x[:, 1]], axis=1)
    middle = x.mean(axis=0)
    variables = {name: Variable("m", name) for name in ("eta", "chamber_level", "flow", "P_a")}
    energies = ("kinetic", "potential", "compression")
    variables |= {name: Variable("J m-1", name, group="energy") for name in energies}
    variables["power_pto"] = Variable("W m-1", "power_pto")
    variables["power_paddle"] = Variable("W m-1", "power_paddle", group="energy")
    for k in range(frames):
        t = (k * samples + 1 + np.arange(samples)) * 0.01
        wave = np.sin(2 * np.pi * t / 1.2)
        series = {name: 0.01 * wave for name in variables} | {
            "time": t,
            "eta": 0.01 * np.stack([wave, -wave], 1),
        }
        turn = 0.002 * k
        c, s = np.cos(turn), np.sin(turn)
        at = x.copy()
        at[:, [0, -1]] = (x[:, [0, -1]] - middle[[0, -1]]) @ np.array([[c, -s], [s, c]]) + middle[[0, -1]]
        u = np.zeros_like(x)
        u[:, 0], u[:, -1] = 0.1 * (at[:, -1] - middle[-1]), -0.1 * (at[:, 0] - middle[0])
        snapshot = {"time": t[-1], "step": k, "paddle": np.array([0.01 * k, 0, 0]), "id": np.arange(len(x))}
        snapshot |= {"x": at, "u": u, "p": 9810 * (0.42 - at[:, -1])}
        run.append(series, variables, snapshot, {"a": np.zeros(1)}, {"wall_seconds": 1.0})
    if results:
        powers = {
            "xi": 0.61,
            "xi_error": 0.007,
            "xi_scatter": 0.02,
            "P_inc": 2.19,
            "P_owc": 1.34,
            "periods": 8.0,
        }
        run.finish(powers | {"noise": 0.05, "energy_residual_share": 0.001})
    return path


def make_sweep(path, axes, shape, slopes=False, about=None):
    """File of a sweep over axes; member k has the result xi = 0.1 k."""
    t = 0.1 * np.arange(30)
    members = {}
    for k in range(int(np.prod(shape))):
        results = {"xi": 0.1 * k, "xi_error": 0.003, "periods": 9.0, "P_owc": 0.2 * k}
        results |= {f"slope {name}": 0.5 for name in axes} if slopes else {}
        members[k] = {"results": results, "series": {"time": t, "P_a": np.sin(t) * k}, "failure": ""}
    members[0] |= {"failure": "a particle has left", "results": {}}
    meanings = Meanings({"P_a": Variable("Pa", "P_a"), "time": Variable("s", "t")})
    SweepFile(path).write(OWC.to_toml(), axes, shape, members, meanings, about)
    return path


def read(record):
    """Text and arrays of a record, as the page reads them."""
    data = gzip.decompress(record)
    length = int.from_bytes(data[:4], "little")

    def array(found):
        if {"at", "n", "type"} == set(found):
            return np.frombuffer(data, KINDS[found["type"]], found["n"], 4 + length + found["at"])
        return found

    return json.loads(data[4 : 4 + length], object_hook=array)


def played(player):
    """Positions `[frame, 2, particle]` (m) and levels of a page, from the stored differences."""
    frames, count = len(player["t"]), player["count"]
    parts = player["places"].reshape(frames, 2, 2, count).astype(np.int64)
    small = parts[:, :, 0] + 256 * parts[:, :, 1]
    step = (small >> 1) ^ -(small & 1)
    whole = np.cumsum(step, axis=0) % 65536
    low, high = np.asarray(player["low"])[:, None], np.asarray(player["high"])[:, None]
    places = np.where(whole == UNSEEN, np.nan, low + whole * (high - low) / (UNSEEN - 1))
    levels = {
        name: np.cumsum(field["levels"].reshape(frames, count).astype(np.int64), axis=0) % 256
        for name, field in player["fields"].items()
    }
    return places, levels


# --- contents


def test_places_and_fields_of_a_page_are_those_of_the_snapshots(tmp_path):
    path = make_run(tmp_path / "run.h5")
    run, player = RunFile.open(path), read(record_of([path]))["runs"][0]["player"]
    places, levels = played(player)
    for k in range(run.snapshot_count):
        snapshot = run.snapshot(k)
        # half a level of 65534, over the tank and half a metre on either side
        np.testing.assert_allclose(places[k].T, snapshot["x"], atol=0.51 * 9.0 / 65534)
        field = player["fields"]["pressure"]
        p = field["low"] + levels["pressure"][k] / 255 * (field["high"] - field["low"])
        within = (field["low"] < snapshot["p"]) & (snapshot["p"] < field["high"])  # without clipped values
        np.testing.assert_allclose(p[within], snapshot["p"][within], atol=0.51 * field["high"] / 255)


def test_what_leaves_the_tank_is_not_seen(tmp_path):
    path = make_run(tmp_path / "run.h5", frames=1)
    run = RunFile.open(path)
    snapshot = run.snapshot(0)
    snapshot["x"][3] = [50.0, 0.2]
    snapshot["x"][4] = np.nan
    frames = Frames(run)
    frames.run = type("One", (), {
        "path": path, "case_keys": lambda self: run.case_keys(), "snapshot_count": 1,
        "scene": lambda self: run.scene(),
        "snapshot": lambda self, i: snapshot,
    })()  # fmt: skip
    pack = Pack()
    content = frames.content(pack)
    places, _ = played(read(pack.compress(content)))
    assert np.isnan(places[0]).any(axis=0).sum() == 1  # the distant one; the NaN is left out
    assert content["count"] == len(snapshot["id"]) - 1


def test_many_particles_are_thinned_evenly_and_stay_the_same(tmp_path, monkeypatch):
    monkeypatch.setattr(sys.modules[Frames.__module__], "MOST", 20 * 900)
    path = make_run(tmp_path / "run.h5", particles=2500, frames=30)
    player = read(record_of([path]))["runs"][0]["player"]
    assert player["thinning"] == 3 and player["dx"] == pytest.approx(0.04 * np.sqrt(3))
    assert len(player["t"]) >= 21
    assert player["count"] == pytest.approx(2500 / 3, rel=0.1)  # the same particles in every frame
    places, _ = played(player)
    counts, *_ = np.histogram(places[0, 0], 5, (0.1, 7.7))
    assert counts.min() > 0.7 * counts.mean()


def test_three_dimensions_are_shown_in_the_middle_of_the_width(tmp_path):
    case = js.load_case("dam_break_column")
    path = make_run(tmp_path / "run.h5", case=case, two=False)
    found = read(record_of([path]))["runs"][0]
    assert found["player"]["slice"] and 0 <= found["player"]["count"] < 400


def test_local_flow_of_a_linear_field_is_its_vorticity_without_noise():
    rng = np.random.default_rng(1)
    x = rng.random((500, 2))
    u = np.stack([0.3 * x[:, 0] + 2.0 * x[:, 1], 0.5 * x[:, 0] - 0.3 * x[:, 1]], axis=1)
    found = local_flow(x, u)
    np.testing.assert_allclose(found.vorticity, 1.5, rtol=1e-4)  # du/dz - dw/dx
    assert np.max(found.noise) < 1e-4  # from the small number that regularises the fit
    rough = local_flow(x, u + 0.1 * rng.normal(size=u.shape))
    # two components of 0.1 each, minus the fit of three terms over about ten effective neighbours
    assert np.sqrt(np.mean(rough.noise**2)) == pytest.approx(0.1 * np.sqrt(2), rel=0.2)


def test_long_lines_keep_their_extremes():
    t = np.arange(10_003) * 0.01
    y = np.sin(t)
    y[5000] = 9.0
    at, values = extremes_of(t, y, 20)
    assert values.max() == 9.0 and at[np.argmax(values)] == t[5000]
    assert len(at) == 2 * 500 + 3 and np.all(np.diff(at) > 0)


def test_forces_on_a_solid_are_named_by_their_components():
    t = np.arange(4.0)
    units = {3: "N m-1, N m-1, N", 6: "N, N, N, N m, N m, N m"}
    for count, unit in units.items():
        force = np.stack([t + k for k in range(count)], axis=1)
        variables = {"force_pile": Variable(unit, "the water's force on the pile", "motion")}
        (panel,) = panels({"time": t, "force_pile": force}, variables, {}, Pack())
        names = [line["name"] for line in panel["lines"]]
        assert names[0] == "along the tank (x)" and names[-1] == {3: "moment", 6: "moment in yaw"}[count]
        assert panel["unit"] == {3: "N m⁻¹ (force), N (moment)", 6: "N (force), N m (moment)"}[count]


def test_results_are_in_words_and_every_one_of_a_run_has_a_label(tmp_path):
    found = read(record_of([make_run(tmp_path / "run.h5")]))["runs"][0]
    rows = {row["name"]: row for row in found["results"]}
    assert rows["xi"]["value"] == "0.61 ± 0.007" and "target waves" in rows["xi"]["meaning"]
    names = [row["name"] for row in found["results"]]
    assert names == in_order(rows) and names[:4] == ["xi", "xi_error", "xi_scatter", "P_owc"]
    assert found["answer"] == {
        "label": "hydrodynamic efficiency",
        "value": "0.61 ± 0.007",
        "unit": "",
        "expected": "",
        "note": "± from the changes within this run only",
    }
    assert set(rows) <= set(LABELS)
    panels = {panel["name"]: panel for panel in found["panels"]}
    assert [line["name"] for line in panels["eta"]["lines"]] == ["x = 1 m", "x = 2 m"]
    dashed = [line for line in panels["P_a"]["lines"] if line.get("dash")]
    linear = js.linear_owc(OWC)
    assert [line["y"][0] for line in dashed] == pytest.approx([-linear.P_a_peak, linear.P_a_peak])


@pytest.mark.parametrize(
    ("results", "warning"),
    [
        ({}, "has not ended: it has reached t = 12 s"),
        ({"noise": 0.3, "periods": 9}, "noisy: .* 0.3 of their speed"),
        ({"energy_residual_share": -0.08, "periods": 9}, r"-8.0 % of the paddle's work"),
        ({"periods": 2}, "over 2 periods only"),
        ({"t_end": 3.0}, "too short for a mean"),
    ],
)
def test_a_run_that_cannot_be_trusted_is_warned_of(tmp_path, results, warning):
    path = make_run(tmp_path / "run.h5", results=False)
    if results:
        RunFile.open(path).finish(results)
    found = read(record_of([path]))["runs"][0]["warnings"]
    assert any(re.search(warning, text) for text in found), found


def test_runs_side_by_side_are_told_apart(tmp_path):
    paths = [make_run(tmp_path / f"{name}.h5") for name in "ab"]
    found = read(record_of(paths))
    assert [run["label"] for run in found["runs"]] == ["a.h5", "b.h5"]


SEAS = {"waves.Hs": np.array([0.03, 0.04]), "waves.Tp": np.array([1.2, 1.4]), "waves.seed": np.array([1, 2])}


@pytest.mark.parametrize(
    ("axes", "shape", "kind"),
    [({"pto.K_dm": np.array([100.0, 200.0, 300.0])}, (3,), "sweep"), (SEAS, (2, 2, 2), "matrix")],
)
def test_a_sweep_has_its_members_with_linear_theory(tmp_path, axes, shape, kind):
    found = read(record_of([make_sweep(tmp_path / "s.h5", axes, shape)]))["sweeps"][0]
    assert found["kind"] == kind and found["grid"] and len(found["members"]) == np.prod(shape)
    assert "failed: a particle has left" in found["warnings"][0]
    last = found["members"][-1]
    assert last["at"] == [float(v[-1]) for v in axes.values()]
    np.testing.assert_allclose(
        last["panels"][0]["lines"][0]["y"], np.sin(0.1 * np.arange(30)) * last["index"], rtol=1e-6
    )
    if kind == "sweep":
        expected = js.linear_owc(OWC.replace({"pto.K_dm": 300.0})).xi
        assert last["linear"]["xi"] == pytest.approx(float(expected))


@pytest.mark.parametrize("method", ["Ensemble", "model"])
def test_a_search_keeps_its_order(tmp_path, method):
    axes, about = {"pto.K_dm": np.array([300.0, 100.0, 200.0])}, {"of": "xi", "method": method}
    path = make_sweep(tmp_path / "s.h5", axes, (3,), slopes=method == "Ensemble", about=about)
    found = read(record_of([path]))["sweeps"][0]
    assert found["kind"] == "search" and [one["at"][0] for one in found["members"]] == [300.0, 100.0, 200.0]


def test_page_is_one_file_that_asks_nobody(tmp_path):
    page = js.report(make_run(tmp_path / "run.h5"))
    assert page == tmp_path / "run.html"
    text = page.read_text()
    # the library's own text is compressed; the remaining text contains no address
    assert not any(word in text for word in ("http://", "https://", '<link rel="stylesheet', "@import"))
    assert page.stat().st_size < 2.5e6  # 1.9 MB of it is the library


def old_file(path, change):
    """Turns a run's file into one of an older version, without checksums, and changes it."""
    with h5py.File(path, "r+") as file:
        file.attrs["schema"] = 3
        change(file)


@pytest.mark.parametrize(
    "change",
    [
        lambda file: file.attrs.update(case="name = ["),
        lambda file: file.attrs.update(case='tank = 1\nscheme = "none"\ndx = "wide"\n'),
        lambda file: file.__delitem__("snapshots/000001/x"),
        lambda file: file["snapshots/000001"].attrs.__delitem__("time"),
        lambda file: file["numbers"].__setitem__((), "[1, 2"),
        lambda file: file["notices"].__setitem__((), "{"),
        lambda file: file["series"].move("eta", "etta") or file["series/P_a"].resize(7, axis=0),
    ],
)
def test_page_of_a_damaged_file_is_refused_in_words(tmp_path, change):
    """In a file without checksums, the damage is found only while the page is made."""
    path = make_run(tmp_path / "run.h5", frames=2)
    old_file(path, change)
    with pytest.raises((FileError, CaseError), match=r"run\.h5"):
        js.report(path)
    assert not path.with_suffix(".html").exists()


def test_page_replaces_a_page_and_nothing_else(tmp_path, monkeypatch):
    path, out = make_run(tmp_path / "run.h5", frames=1), tmp_path / "thesis.html"
    out.write_text("three years of work")
    with pytest.raises(FileError, match="is not a page of jaxsph; .*--overwrite"):
        js.report(path, out)
    assert out.read_text() == "three years of work"
    js.report(path, out, overwrite=True)
    before = out.read_bytes()
    js.report(path, out)  # replaces its own page
    with monkeypatch.context() as full:
        full.setattr(os, "replace", lambda *_: (_ for _ in ()).throw(OSError(28, "No space left")))
        with pytest.raises(FileError, match="No space left"):
            js.report(path, out)
    assert out.read_bytes() == before and sorted(os.listdir(tmp_path)) == ["run.h5", "thesis.html"]
    with pytest.raises(FileError, match="is a folder"):
        js.report(path, tmp_path)


def test_wrong_files_are_refused(tmp_path):
    with pytest.raises(FileError, match="no file"):
        js.report([])
    (tmp_path / "x.h5").write_text("nothing")
    with pytest.raises(FileError, match=r"x\.h5"):
        js.report(tmp_path / "x.h5")
    path = make_run(tmp_path / "run.h5")
    with pytest.raises(FileError, match="is one of the files"):
        js.report(path, path)


# --- watch


def _get(address):
    with urllib.request.urlopen(address, timeout=10) as answer:
        return answer.status, answer.headers.get("ETag"), answer.read()


def test_watch_serves_what_is_new_and_nothing_else(tmp_path):
    path = make_run(tmp_path / "run.h5", results=False, frames=2)
    with js.Watch(path) as served:
        assert served.address.startswith("http://127.0.0.1:")
        assert b"jaxsph" in _get(served.address)[2]
        status, mark, record = _get(served.address + "record?known=")
        assert status == 200 and not read(record)["runs"][0]["ended"]
        assert _get(f"{served.address}record?known={mark}")[0] == 204
        RunFile.open(path).finish({"xi": 0.5, "periods": 9.0})
        status, newer, record = _get(f"{served.address}record?known={mark}")
        assert status == 200 and newer != mark and read(record)["runs"][0]["ended"]
        with pytest.raises(urllib.error.HTTPError, match="404"):
            _get(served.address + "run.h5")
        port = urllib.parse.urlsplit(served.address).port
        with pytest.raises(CaseError, match=f"--port {port}"):
            js.Watch(path, port)


def test_watch_tells_what_it_cannot_read_and_goes_on(tmp_path):
    path = make_run(tmp_path / "run.h5", frames=1)
    whole = path.read_bytes()
    with js.Watch(path) as served:
        path.write_bytes(whole[: len(whole) // 2])
        with pytest.raises(urllib.error.HTTPError, match="503") as told:
            _get(served.address + "record?known=")
        assert b"run.h5" in told.value.read()
        path.write_bytes(whole)
        assert _get(served.address + "record?known=")[0] == 200


@pytest.mark.parametrize("text", ["name = [", "dx = -1.0\n", 'dx = "wide"\nwaves = 3\n', "tank = 1\n"])
def test_a_watched_file_that_gets_a_bad_case_is_told_and_watched_on(tmp_path, text):
    path = make_run(tmp_path / "run.h5", frames=1)
    whole = path.read_bytes()
    with js.Watch(path) as served:
        old_file(path, lambda file: file.attrs.update(case=text))
        # a case of another version is shown as far as possible; anything else gives a message
        try:
            assert _get(served.address + "record?known=")[0] == 200
        except urllib.error.HTTPError as told:
            assert told.code == 503 and b"run.h5" in told.read()
        path.write_bytes(whole)
        assert _get(served.address + "record?known=")[0] == 200


def test_watch_answers_to_its_own_name_and_token_only(tmp_path):
    """A page of another site can send requests to this machine, by any name, but without the token."""
    path = make_run(tmp_path / "run.h5", frames=1)
    with js.Watch(path) as served, js.Watch(path) as other:
        port = urllib.parse.urlsplit(served.address).port
        token = urllib.parse.urlsplit(other.address).path
        root = f"http://127.0.0.1:{port}"
        for place in ("/", "/record", "/record?known=", token, token + "record", "/" + served.address[-9:]):
            with pytest.raises(urllib.error.HTTPError, match="403"):
                _get(root + place)
        for host in ("evil.example", f"evil.example:{port}", "127.0.0.1", f"127.0.0.1:{port}.evil.example"):
            request = urllib.request.Request(served.address + "record", headers={"Host": host})
            with pytest.raises(urllib.error.HTTPError, match="403"):
                _get(request)
        request = urllib.request.Request(served.address, headers={"Host": f"localhost:{port}"})
        assert _get(request)[0] == 200


# --- in a browser


def _box(place):
    """Position of an element on the screen, after scrolling it into the mouse's reach."""
    place.scroll_into_view_if_needed()
    return place.bounding_box()


@pytest.fixture(scope="module")
def run_page(tmp_path_factory):
    return js.report(make_run(tmp_path_factory.mktemp("page") / "run.h5", particles=900, frames=12))


@needs_browser
def test_browser_plays_by_button_key_and_slider(visit, run_page):
    page = visit(run_page)
    assert page.evaluate("jaxsph.drawn") > 0
    assert page.evaluate(COLOURS) > 30  # colours of the pressure, not a blank picture
    page.click("#play")
    page.wait_for_function("jaxsph.t > 2.2 && jaxsph.pictures > 10")
    page.click("#play")
    stopped = page.evaluate("jaxsph.t")
    page.keyboard.press("ArrowRight")  # the focus is on the button, which ignores the key
    step = page.evaluate("jaxsph.t") - stopped
    assert step == pytest.approx(2.0, rel=1e-3)  # one frame
    page.evaluate("seek(12.0)")
    assert page.inner_text(".controls output") == "t = 12.00 s"
    # at a sample, the reading is that of the sample
    reading = page.inner_text(".readings dd >> nth=0")
    assert reading.endswith(" m") and abs(float(reading[:-2])) < 1e-5  # 0.01 m sin(2 pi 12 s / 1.2 s)
    page.focus("#time")
    page.keyboard.press("ArrowLeft")
    assert page.evaluate("jaxsph.t") < 12.0


@needs_browser
def test_browser_colours_and_zooms(visit, run_page):
    page = visit(run_page)
    picture = "document.querySelector('canvas.water').toDataURL()"
    before = page.evaluate(picture)
    for name, field in FIELDS.items():
        page.select_option("#colour", name)
        assert page.inner_text(".legend span >> nth=0") == field.label
    assert page.evaluate(picture) != before
    scale = "jaxsph.players[0].view.scale"
    was = page.evaluate(scale)
    page.click("button[aria-label='Zoom in']")
    assert page.evaluate(scale) == pytest.approx(1.4 * was)
    x = page.evaluate("jaxsph.players[0].view.x")
    box = _box(page.locator("canvas.water"))
    page.mouse.move(box["x"] + 300, box["y"] + 100)
    page.mouse.down()
    page.mouse.move(box["x"] + 200, box["y"] + 100)
    page.mouse.up()
    assert page.evaluate("jaxsph.players[0].view.x") > x
    page.click("button[aria-label='Show the whole tank']")
    assert page.evaluate("jaxsph.players[0].view.x") < 0.1


@needs_browser
def test_browser_links_its_charts(visit, run_page):
    page = visit(run_page)
    plot = "document.querySelector('.chart .js-plotly-plot')"
    page.evaluate(f"Plotly.relayout({plot}, {{'xaxis.range': [4, 8]}})")
    # all panels have one time axis
    assert page.evaluate(f"new Set({plot}.data.map((line) => line.xaxis)).size") == 1
    page.evaluate("seek(6.0)")
    left = page.evaluate("parseFloat(document.querySelector('.now').style.left)")
    size = page.evaluate(f"(() => {{ const s = {plot}._fullLayout._size; return [s.l, s.w]; }})()")
    assert left == pytest.approx(size[0] + 0.5 * size[1], abs=1.5)
    box = _box(page.locator(".chart .nsewdrag").first)
    page.mouse.move(box["x"] + 0.25 * box["width"], box["y"] + 60)
    page.wait_for_selector(".hoverlayer .legend, .hoverlayer .hovertext")
    page.mouse.click(box["x"] + 0.25 * box["width"], box["y"] + 60)
    page.wait_for_function("Math.abs(jaxsph.t - 5) < 0.05")
    lines = page.evaluate(f"{plot}.data.length")
    page.locator(".chart .legendtoggle").first.click()
    page.wait_for_function(f"{plot}.data.filter((line) => line.visible === 'legendonly').length === 1")
    assert page.evaluate(f"{plot}.data.length") == lines


@needs_browser
def test_browser_opens_a_member_of_a_sweep(visit, tmp_path):
    axes = {"waves.H": np.array([0.02, 0.04]), "pto.K_dm": np.array([100.0, 200.0])}
    page = visit(js.report(make_sweep(tmp_path / "s.h5", axes, (2, 2))))
    box = _box(page.locator(".map .nsewdrag"))
    page.mouse.click(box["x"] + 0.75 * box["width"], box["y"] + 0.25 * box["height"])
    page.wait_for_selector("#opened-0 h3")
    assert page.inner_text("#opened-0 h3") == "waves.H = 0.04, pto.K_dm = 200"
    assert page.locator("#opened-0 .js-plotly-plot").count() == 1
    page.click("summary >> nth=0")
    page.locator("button.open").first.press("Enter")
    page.wait_for_function("document.querySelector('#opened-0 .warnings')")
    assert "a particle has left" in page.inner_text("#opened-0")


@pytest.fixture(scope="module")
def sweep_page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("page")
    return js.report(make_sweep(folder / "s.h5", {"pto.K_dm": np.array([100.0, 200.0, 300.0])}, (3,)))


@needs_browser
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize(("which", "width"), [("run_page", 390), ("run_page", 1200), ("sweep_page", 390)])
def test_browser_finds_no_barrier(visit, request, which, scheme, width):
    """Rules of WCAG 2.1, levels A and AA: contrast, names, roles; and nothing wider than a narrow screen."""
    from axe_playwright_python.sync_playwright import Axe

    page = visit(
        request.getfixturevalue(which), viewport={"width": width, "height": 800}, color_scheme=scheme
    )
    if which == "sweep_page":
        page.click("summary >> nth=0")
        page.locator("button.open").last.press("Enter")
        page.wait_for_selector("#opened-0 h3")
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    rules = {"runOnly": ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa"]}
    found = Axe().run(page, options=rules).response["violations"]
    serious = [one for one in found if one["impact"] in ("serious", "critical")]
    told = [(one["id"], [node["html"][:200] for node in one["nodes"]]) for one in serious]
    assert not serious, json.dumps(told, indent=1)


@needs_browser
def test_browser_follows_a_run_that_goes_on(visit, tmp_path):
    path = make_run(tmp_path / "run.h5", results=False, frames=3)
    with js.Watch(path) as served:
        page = visit(served.address)
        page.wait_for_function("jaxsph.taken === 1")
        assert "in progress" in page.inner_text("#state") and page.evaluate("jaxsph.t") == pytest.approx(6.0)
        page.evaluate("jaxsph.players[0].zoomBy(3)")
        RunFile.open(path).finish({"xi": 0.5, "periods": 9.0})
        page.wait_for_function("jaxsph.taken === 2")
        assert page.inner_text("#state") == "The run has ended."
        assert page.evaluate("jaxsph.players[0].moved")  # the view that the reader has chosen is kept


@needs_browser
def test_browser_follows_a_sweep_that_goes_on(visit, tmp_path):
    path = make_sweep(tmp_path / "s.h5", {"pto.K_dm": np.array([300.0, 400.0])}, (2,))
    with js.Watch(path) as served:
        page = visit(served.address)
        page.wait_for_function("jaxsph.taken === 1")
        make_sweep(path, {"pto.K_dm": np.array([300.0, 400.0, 500.0])}, (3,))
        page.wait_for_function("jaxsph.taken === 2")
        assert page.evaluate("jaxsph.sweeps[0].members.length") == 3


@needs_browser
@pytest.mark.slow
def test_browser_is_fast(visit, tmp_path):
    """In software: 30 pictures per second of 8,000 particles, 10 of 50,000; the first picture within 2 s."""
    for particles, bar in ((8000, 30), (50_000, 10)):
        path = js.report(make_run(tmp_path / f"{particles}.h5", particles=particles, frames=24))
        began = time.perf_counter()
        page = visit(path)
        print(
            f"{particles}: first picture {page.evaluate('jaxsph.firstPicture'):.0f} ms,"
            f" page {time.perf_counter() - began:.1f} s"
        )
        assert page.evaluate("jaxsph.firstPicture") < 2000
        page.click("button[aria-label='Show the whole tank']")
        page.evaluate("jaxsph.pictures = 0; seek(0); play(true)")
        threading.Event().wait(4.0)
        rate = page.evaluate("jaxsph.pictures") / 4.0
        drawn = page.evaluate(DRAW)
        print(f"{particles}: {rate:.0f} pictures a second on the screen, {drawn:.0f} drawn")
        assert rate > bar


def test_members_of_a_sweep_are_doubted_with_their_number(tmp_path):
    path = make_sweep(tmp_path / "s.h5", {"pto.K_dm": np.array([300.0, 400.0, 500.0])}, (3,))
    file = SweepFile(path)
    stored = file.read()
    stored.members[1]["results"] |= {"periods": 3.0, "energy_residual_share": -0.05}
    stored.members[2]["results"] |= {"periods": 4.0}
    file.write(stored.case_toml, stored.axes, stored.shape, stored.members, stored.meanings)
    warnings = sweep_content(file, Pack())["warnings"]
    assert "2 of 2 members are averaged over fewer than 5 settled periods: raise t1." in warnings
    open_budget = (
        "1 of 2 members have an energy budget that does not close within 3 %: do not use their results"
    )
    assert f"{open_budget}, and report the case." in warnings
