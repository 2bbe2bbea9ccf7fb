"""Pictures: made if their data exist, not blank, and drawn to scale."""

import matplotlib.image
import numpy as np
import pytest
from conftest import coarse
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PathCollection
from typer.testing import CliRunner

import jaxsph as js
from jaxsph import analysis
from jaxsph.case.geometry import Geometry
from jaxsph.cli.app import app
from jaxsph.errors import FileError
from jaxsph.output.hdf5 import Variable
from jaxsph.output.plot.particles import animate, particles
from jaxsph.output.plot.pictures import plot_run
from jaxsph.output.plot.series import body, chamber, energy, energy_terms, gauges
from jaxsph.output.plot.spectrum import draw_sea
from jaxsph.output.plot.style import ORANGE
from jaxsph.output.plot.sweeps import _over_grid, _over_one, plot_sweep
from jaxsph.output.plot.tank import Outline, Tank
from jaxsph.output.run_file import RunFile
from jaxsph.output.sweep_file import Meanings, SweepFile
from jaxsph.run.scene import scene_of
from jaxsph.waves.linear_owc import linear_response
from jaxsph.waves.radiation import ChamberGeometry, radiation_and_scattering

CASE = 'name = "little owc"\ndx = 0.05\n'


def _scene(length=3.0):
    """A tank with a paddle, and a plate in front of its end."""
    paddle = {"name": "paddle", "corners": [[-9, -9], [0, -9], [0, 9], [-9, 9]], "pivot": [0, 0]}
    x0, x1 = length - 0.25, length - 0.2
    plate = {"name": "", "corners": [[x0, 0.2], [x1, 0.2], [x1, 9], [x0, 9]], "pivot": [0, 0]}
    box = {"dx": 0.05, "low": [0, 0], "high": [length, 0.6], "walls": [False, True, True], "level": 0.3}
    return box | {"solids": [paddle, plate]}


SCALARS = {
    "chamber_level": "m",
    "flow": "m2 s-1",
    "P_a": "Pa",
    "power_pto": "W m-1",
    "kinetic": "J m-1",
    "potential": "J m-1",
    "compression": "J m-1",
    "power_paddle": "W m-1",
    "power_sponge": "W m-1",
    "loss_viscous": "W m-1",
    "loss_diffusive": "W m-1",
}
STILLS = [
    "chamber.png",
    "energy.png",
    "gauges.png",
    "particles_pressure.png",
    "particles_speed.png",
    "pressure_sensors.png",
]


def _lattice(dim=2):
    ends = [3.0, 0.3] if dim == 2 else [3.0, 0.2, 0.3]
    axes = [np.arange(0.025, end, 0.05) for end in ends]
    return np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, dim)


def _series(k):
    t = 0.1 * k + 0.01 * np.arange(10)
    series = {name: np.sin(t) ** 2 for name in SCALARS}
    series["eta"] = np.stack([np.sin(t), np.cos(t)], 1)
    series["pressure"] = 1000.0 + series["eta"][:, :1]
    return {"time": t} | series


def _make(path, case=CASE, snapshots=3, dim=2, drop=(), scene=None):
    """A run with all series except those dropped, and snapshots of a hydrostatic lattice."""
    gauge = {"gauge_x": ("gauge", np.array([1.0, 2.0]), "m", "x")}
    sensor = {f"sensor_{c}": ("sensor", np.array([0.1]), "m", c) for c in "xz"}
    scene = _scene() if scene is None else scene
    run = RunFile.create(path, case, {}, gauge | sensor, scene=scene)
    variables = {name: Variable(units, name) for name, units in SCALARS.items()}
    for name in ("kinetic", "power_paddle", "power_sponge"):
        variables[name] = Variable(SCALARS[name], name, group="energy")
    variables |= {"eta": Variable("m", "eta", "gauge"), "pressure": Variable("Pa", "p", "sensor")}
    x = _lattice(dim)
    for k in range(max(snapshots, 1)):
        series = {name: v for name, v in _series(k).items() if name not in drop}
        snapshot = {
            "time": 0.1 * (k + 1),
            "paddle": np.array([0.02 * k, 0.0, 0.0]),
            "x": x,
            "u": x,
            "p": 9810.0 * (0.3 - x[:, -1]),
            "id": np.arange(len(x)),
        }
        run.append(series, variables, snapshot if snapshots else None, {}, {})
    return run


def _pixels(figure):
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3]


def test_every_picture_is_written_and_none_is_blank(tmp_path):
    image = pytest.importorskip("PIL.Image")
    run = _make(tmp_path / "run.h5")
    written = plot_run(run.path)
    assert {p.parent for p in written} == {tmp_path / "run_plots"}
    assert sorted(p.name for p in written if p.suffix == ".png") == STILLS
    for path in written:
        if path.suffix == ".png":
            with image.open(path) as picture:
                assert np.ptp(np.asarray(picture.convert("L"))) > 150
    with image.open(tmp_path / "run_plots" / "animation.gif") as movie:
        assert movie.n_frames == 3
        assert movie.info["duration"] == pytest.approx(100, abs=10)  # ms: in real time
        first = np.asarray(movie.convert("L")).astype(int)
        movie.seek(2)
        last = np.asarray(movie.convert("L")).astype(int)
        assert first.shape == last.shape and np.any(first != last)


def test_pictures_without_data_are_left_out(tmp_path):
    bare = RunFile.create(tmp_path / "bare.h5", "", {}, {})
    assert plot_run(bare) == [] and not (tmp_path / "bare_plots").exists()
    some = _make(tmp_path / "some.h5", snapshots=0, drop=(*SCALARS, "pressure"))
    assert [p.name for p in plot_run(some, folder=tmp_path / "here")] == ["gauges.png"]
    one = _make(tmp_path / "one.h5", snapshots=1)
    assert animate(one, tmp_path / "a") == []


def test_foreign_file(tmp_path):
    with pytest.raises(FileError):
        plot_run(tmp_path / "none.h5")


@pytest.mark.parametrize("scene", [_scene(), {}])
@pytest.mark.parametrize("dim", [2, 3])
def test_particles_are_drawn_to_scale_with_a_scene_and_without(tmp_path, scene, dim):
    run = _make(tmp_path / "run.h5", snapshots=1, dim=dim, scene=scene)
    figure = particles(run)
    pixels = _pixels(figure)
    collections = [c for ax in figure.axes for c in ax.collections]
    dots = [c for c in collections if isinstance(c, PathCollection)]  # the colour bar has other collections
    assert dots
    for dot in dots:
        ax = dot.axes
        a, b = ax.transData.transform([(0.0, 0.0), (0.05, 0.05)])
        across, up = b - a
        assert across == pytest.approx(up, rel=0.02)  # equal axes, to about a pixel
        diameter = np.sqrt(dot.get_sizes()[0]) * figure.dpi / 72
        # Tiles are larger than the spacing and smaller than two, also if the spacing is estimated.
        assert 1.0 < diameter / across < 2.0
    assert np.ptp(pixels) > 150


def test_long_tank_has_strips_and_the_device_enlarged(tmp_path):
    run = _make(tmp_path / "run.h5", snapshots=1)
    titles = [ax.get_title(loc="left") for ax in particles(run).axes]
    assert "the device, enlarged" in titles
    long = _make(tmp_path / "long.h5", snapshots=1, scene=_scene(12.0))
    assert len(particles(long).axes) > len(titles)


def test_solids_are_drawn_where_the_model_has_them(tmp_path):
    """The plate and the raised bed of a device, and a paddle that has moved; nothing beyond the walls."""
    raised = {"device.platform_length": 0.52, "device.platform_height": 0.12}
    case = coarse("owc", raised)
    geometry, scene = Geometry.of(case), scene_of(case.problem())
    tank = Tank.of(_make(tmp_path / "run.h5", snapshots=1, scene=scene))
    shown = {one.name or k: one.corners for k, one in enumerate(tank.solids)}
    assert list(shown) == [0, 1, "paddle"] and tank.walls == (False, True, True)
    assert tank.depth == pytest.approx(geometry.depth) and tank.x1 == pytest.approx(geometry.length)
    plate, bed = shown[0], shown[1]
    assert sorted(set(plate[:, 0])) == pytest.approx([geometry.plate.x0, geometry.plate.x1])
    assert plate[:, 1].min() == pytest.approx(geometry.plate.tip) and plate[:, 1].max() > 1.0
    assert sorted(set(bed[:, 0])) == pytest.approx([geometry.platform.start, geometry.length])
    assert sorted(set(bed[:, 1])) == pytest.approx([0.0, geometry.platform.height])
    moved = tank.solids[2].at({"paddle": np.array([0.05, 0.0, 0.0])})
    assert moved[:, 0].max() == pytest.approx(0.05)


def test_a_body_is_drawn_in_its_pose():
    """A block turned landward by a quarter turn about its pivot lies on its side."""
    body = Outline("flap", np.array([[1.0, 0.0], [1.2, 0.0], [1.2, 0.6], [1.0, 0.6]]), np.array([1.1, 0.0]))
    lying = body.at({"flap": np.array([0.1, 0.05, 0.5 * np.pi])})
    assert lying.min(axis=0) == pytest.approx([1.2, -0.05]) and lying.max(axis=0) == pytest.approx(
        [1.8, 0.15]
    )


def test_overlay_is_drawn_at_each_gauge(tmp_path):
    seen = []

    def theory(t, x):
        seen.append(x)
        return 0.0 * t

    figure = gauges(_make(tmp_path / "run.h5"), theory)
    assert seen == [1.0, 2.0]
    assert [len(ax.lines) for ax in figure.axes] == [2, 2]


@pytest.mark.parametrize(("finished", "periods"), [({"periods": 2.0}, 2.0), ({}, 1.0)])
def test_linear_theory_is_drawn_over_the_settled_part(tmp_path, finished, periods):
    run = _make(tmp_path / "run.h5")
    run.finish(finished)
    T = 0.1
    water = radiation_and_scattering(ChamberGeometry(0.3, 0.2, 0.1, 0.05), 2 * np.pi / T)
    linear = linear_response(water, 0.02, 500.0)
    bare, figure = chamber(run), chamber(run, linear)
    drawn = [[line for line in ax.lines if line.get_linestyle() == "--"] for ax in (*bare.axes, *figure.axes)]
    expected = [abs(linear.level), abs(linear.q), linear.P_a_peak, linear.P_owc]
    assert [len(lines) for lines in drawn] == [0, 0, 0, 0, 2, 2, 2, 1]
    for lines, value in zip(drawn[4:], expected, strict=True):
        assert [abs(line.get_ydata()[0]) for line in lines] == [value] * len(lines)
        end = run.series()["time"][-1]
        assert lines[0].get_xdata() == pytest.approx([end - periods * T, end])


def test_energy_areas_end_at_the_budget(tmp_path):
    run = _make(tmp_path / "run.h5")
    terms = energy_terms(run.series())
    from jaxsph import analysis

    budget = analysis.energy_budget(run.series())
    total = sum(values[-1] for _, values, _ in terms)
    assert total == pytest.approx(budget["paddle"] - budget["residual"], rel=1e-12)
    assert "%" in energy(run).axes[0].get_title(loc="left")


def test_every_loss_of_size_is_drawn(tmp_path):
    """A power without a standard label has its own area; a power that is too small is part of the rest."""
    series = _make(tmp_path / "run.h5").series()
    for name, share in (("hyperviscosity", 0.5), ("friction_of_the_bed", 0.2), ("separation", 1e-4)):
        series[f"power_{name}"] = share * np.abs(series["power_pto"])
    terms = {label: values[-1] for label, values, _ in energy_terms(series)}
    assert terms["lost by hyperviscosity"] == pytest.approx(0.5 * terms["absorbed by the PTO"])
    assert terms["friction of the bed"] == pytest.approx(0.2 * terms["absorbed by the PTO"])
    assert terms["the rest"] == pytest.approx(1e-4 * terms["absorbed by the PTO"])


def test_energy_where_the_device_does_work_on_the_water(tmp_path, monkeypatch):
    run = _make(tmp_path / "run.h5")
    series = run.series()
    series["power_pto"] = -series["power_pto"]
    series["power_paddle"] *= 0.0
    monkeypatch.setattr(RunFile, "series", lambda self: series)
    ax = energy(run).axes[0]
    assert len(ax.lines) > 3 and "largest kinetic energy" in ax.get_title(loc="left")


# --- sweeps and searches


def _swept(path, axes, shape, **results):
    members = {
        i: {"results": {k: float(np.ravel(v)[i]) for k, v in results.items()}, "series": {}, "failure": ""}
        for i in range(int(np.prod(shape)))
    }
    SweepFile(path).write(CASE, axes, shape, members, Meanings())
    return path


K, H = np.array([200.0, 400.0, 600.0]), np.array([0.02, 0.04])


@pytest.mark.parametrize(
    ("axes", "shape", "results"),
    [
        ({"pto.K_dm": K}, (3,), {"xi": [0.3, 0.5, 0.4], "xi_error": [0.03] * 3}),
        ({"pto.K_dm": K}, (3,), {"xi": [0.3, 0.5, 0.4], "slope pto.K_dm": [1e-3, 1e-4, -1e-3]}),
        ({"pto.K_dm": K, "waves.H": H}, (3, 2), {"xi": np.arange(6.0)}),
        ({"pto.K_dm": K, "waves.H": np.full(3, 0.04)}, (3,), {"xi": [0.3, 0.5, 0.4]}),
    ],
    ids=["one", "search", "grid", "list"],
)
def test_sweeps_have_a_picture(tmp_path, axes, shape, results):
    file = _swept(tmp_path / "s.h5", axes, shape, **results)
    (picture,) = plot_sweep(file)
    assert picture == tmp_path / "s_plots" / "xi.png" and matplotlib.image.imread(picture).std() > 0.02
    assert plot_sweep(file, of="nothing") == []


@pytest.mark.parametrize("option", [("--vtk", "a.vtkhdf"), ("--linear",)])
def test_options_for_runs_are_refused_for_a_sweep(tmp_path, option):
    file = _swept(tmp_path / "s.h5", {"pto.K_dm": K}, (3,), xi=[0.3, 0.5, 0.4])
    result = CliRunner().invoke(app, ["plot", str(file), *option])
    assert result.exit_code == 2 and f"{option[0]}: {file} contains a sweep" in " ".join(
        result.output.split()
    )
    assert not (tmp_path / "s_plots").exists()


def test_slopes_are_drawn_as_they_are():
    """The short tangent at each evaluation has the slope that the search found."""
    found = {"xi": np.array([0.3, 0.5, 0.4]), "slope pto.K_dm": np.array([1e-3, 1e-4, -1e-3])}
    (axis,) = _over_one({"pto.K_dm": K}, found, "xi").axes
    lines = [line.get_xydata() for line in axis.lines if line.get_color() == ORANGE]
    assert [(b[1] - a[1]) / (b[0] - a[0]) for a, b in lines] == pytest.approx(found["slope pto.K_dm"])


def test_the_grid_s_picture_names_the_largest():
    (axis, _) = _over_grid({"pto.K_dm": K, "waves.H": H}, np.arange(6.0).reshape(3, 2), "xi").axes
    star = axis.lines[-1].get_xydata()
    assert star == pytest.approx(np.array([[600.0, 0.04]])) and "largest value, 5" in axis.get_title(
        loc="left"
    )


def test_spectrum_has_both_ways_the_band_and_what_was_asked_for():
    case = js.load_case("owc_irregular")
    f = np.arange(1, 60) / 30.0
    asked = js.JONSWAP(case.waves.Hs, case.waves.Tp).density(f)
    sea = analysis.TwoWaySea(
        analysis.Spectrum(f, 0.9 * asked, 8.0), analysis.Spectrum(f, 0.01 * asked, 8.0), 0.1, 0.0
    )
    ax = draw_sea(sea, case).axes[0]
    lines = {line.get_label(): line.get_ydata() for line in ax.lines}
    assert np.allclose(lines["incident"], 0.9 * asked) and np.allclose(lines["reflected"], 0.01 * asked)
    # mean over four frequencies of the sea, a narrow band here
    shown = f > 0.5
    assert np.allclose(lines["target spectrum"][shown], asked[shown], rtol=0.1, atol=1e-5)
    assert "target 0.04 m" in ax.get_title(loc="left") + ax.get_title()


def test_figure_of_a_fixed_body_shows_the_forces_only():
    class Fixed:
        """Readings of a body without motions."""

        def series(self):
            time = np.linspace(0.0, 1.0, 5)
            return {"time": time, "body_force": np.stack([time, 2.0 * time, np.zeros(5)], 1)}

        def variables(self):
            return {}

    figure = body(Fixed())
    assert [ax.get_ylabel() for ax in figure.axes] == ["F$_x$", "F$_z$"]
