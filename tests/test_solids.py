"""Solids at rest: their keys in a case, still water beside them, and the forces on them."""

import tomllib

import numpy as np
import pytest
from typer.testing import CliRunner

import jaxsph as js
from jaxsph.case.commented import commented_toml
from jaxsph.case.geometry import Geometry
from jaxsph.cli.app import app
from jaxsph.errors import CaseError
from jaxsph.output.run_file import RunFile
from jaxsph.problem.toml import toml_text
from jaxsph.report.content import run_content
from jaxsph.report.pack import Pack

SLOPE = [[0.8, 0.0], [2.0, 0.3], [2.0, 0.0]]
TANK = js.Case.from_dict(
    {
        "name": "slope",
        "dx": 0.04,
        "t1": 1.0,
        "scheme": {"kind": "incompressible"},
        "tank": {"length": 2.0, "depth": 0.4},
        "solid": {"bed": {"polygon": SLOPE}},
        "output": {"sample_dt": 0.05},
    }
)


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"solid.bed.polygon": [[0.8, 0.0], [2.0, 0.3]]}, r"solid.bed.polygon = .*at least 3"),
        (
            {"solid.bed.polygon": [SLOPE[i] for i in (0, 1)] + [[0.9, 0.2], [1.5, 0.0]]},
            "solid.bed.polygon:.*cross",
        ),
        ({"solid.bed.disc": {"centre": [1.0, 0.2], "radius": 0.1}}, "solid.bed: give exactly one of block"),
        (
            {"solid.step.block": {"low": [1.0, 0.0], "high": [1.2, 0.2]}},
            "solid.bed and solid.step have .* m2",
        ),
        (
            {"solid.step.block": {"low": [0.2, 0.0], "high": [0.4, 0.0]}},
            "every coordinate of low must be less than that of high",
        ),
        (
            {"solid.step.block": {"low": [-0.2, 0.0], "high": [0.4, 0.2]}},
            "solid.step extends outside the tank",
        ),
        (
            {"solid.step.block": {"low": [0.2, 0.0, 0.0], "high": [0.4, 0.2, 0.2]}},
            "solid.step: .* 3 dimensions",
        ),
        ({"solid.step.block": {"low": [0.2, 0.0], "high": [0.21, 0.2]}}, "solid.step.block is 0.01 m thick"),
        (
            {"solid.bed.block": {"low": [0.0, 0.0], "high": [2.0, 0.6]}, "solid.bed.polygon": None},
            "no water in it",
        ),
        ({"solid.Step.disc": {"centre": [0.4, 0.2], "radius": 0.1}}, "solid.Step = .*lower-case letter"),
        ({"solid.body.disc": {"centre": [0.4, 0.2], "radius": 0.1}}, "solid.body: .*another name"),
        ({"solid.bed.polgon": SLOPE}, "unknown key 'solid.bed.polgon'; did you mean 'solid.NAME.polygon'"),
        ({"solid": 3}, "solid = 3: must be a section"),
        ({"tank.walls": "images"}, 'tank.walls = "images": .* needs "dummy" walls'),
        ({"probes.pressure": [[1.9, 0.1]]}, r"probes.pressure\[0\] = .* inside the bed"),
        (
            {"device": {"chamber_length": 0.3, "wall_thickness": 0.08, "draught": 0.2}},
            "solid.bed and device have .* m2 in common",
        ),
        (
            {"waves": {"H": 0.05, "T": 1.0, "zone": 1.0}},
            "solid.bed begins at x = 0.8 m, but the relaxation zone",
        ),
        (
            {
                "waves": {"H": 0.05, "T": 1.0},
                "solid.at_paddle.block": {"low": [0.0, 0.0], "high": [0.2, 0.2]},
            },
            "but the paddle needs",
        ),
    ],
)
def test_a_solid_that_cannot_be_is_refused(changes, message):
    with pytest.raises(CaseError, match=message):
        TANK.replace(changes).problem()


def test_a_case_with_solids_is_what_its_file_says():
    """To TOML and back, changed by key, with and without a solid; the commented file contains each solid."""
    assert js.Case.from_dict(tomllib.loads(TANK.to_toml())) == TANK
    moved = TANK.replace(
        {
            "solid.bed.polygon": [[0.9, 0.0], *SLOPE[1:]],
            "solid.post.disc": {"centre": [0.4, 0.2], "radius": 0.1},
        }
    )
    assert moved.value("solid.post.disc.radius") == 0.1
    assert moved.replace({"solid.post": None, "solid.bed.polygon": SLOPE}) == TANK
    assert "[solid.post.disc]" in commented_toml(moved)
    assert "[solid" not in toml_text(
        TANK.replace({"solid.bed": None}).model_dump(exclude_none=True, mode="json")
    )


@pytest.fixture(scope="module")
def slope(tmp_path_factory):
    """Still water over the slope for a second, run in two parts: its file and its solution."""
    path = tmp_path_factory.mktemp("solids") / "slope.h5"
    js.run(TANK, 0.5, out=path, progress=False)
    return path, js.resume(path, 1.0, progress=False)


def test_water_over_a_slope_stays_where_it_is(slope):
    """Largest speed relative to sqrt(g d): 0.6 % at ten spacings of depth, 0.3 % at twenty."""
    _, solution = slope
    speed = np.hypot(*np.asarray(solution.state.particles.u).T)
    assert speed.max() < 1e-2 * np.sqrt(9.81 * 0.4)
    assert abs(solution.results["energy_residual"]) < 1e-3


def test_the_force_on_a_slope_is_that_of_still_water(slope):
    """Weight of the water above the slope, and the pressure over its height, rho g (d - z/2) z.

    Corners at the wall behind the slope, a spacing in size, change it by a few per cent at ten spacings of
    depth.
    """
    x, z, _ = np.mean(slope[1]["force_mean_bed"][10:], axis=0)
    np.testing.assert_allclose(z, -9810.0 * (0.4 * 1.2 - 0.5 * 0.3 * 1.2), rtol=0.01)
    np.testing.assert_allclose(x, 9810.0 * (0.4 - 0.15) * 0.3, rtol=0.1)


def test_a_solid_is_drawn_and_told_about(slope, tmp_path):
    """It is on the page and has readings; a solid at rest has no results about its motion."""
    path, solution = slope
    told = {name for name in solution.series if name.endswith("_bed")}
    assert told == {"force_bed", "force_mean_bed"}
    assert not any(name.startswith("body") for name in solution.results)
    assert CliRunner().invoke(app, ["report", str(path), "--out", str(tmp_path / "page.html")]).exit_code == 0
    titles = [panel["title"] for panel in run_content(RunFile.open(path), Pack())["panels"]]
    assert [title for title in titles if "force" in title] == [
        "The water's force on the bed, and its moment about the pivot, by default the centroid"
    ]


@pytest.mark.parametrize("dx", [0.036, 0.05, 0.07])
def test_a_solid_at_the_far_wall_goes_with_it(dx):
    """The lattice moves the wall by at most half a spacing, and no gap opens between wall and solid."""
    geometry = Geometry.of(
        TANK.replace({"dx": dx, "solid.step.block": {"low": [0.2, 0.0], "high": [0.5, 0.2]}})
    )
    assert geometry.length != 2.0 or dx == 0.05
    assert geometry.solids["bed"].bounds()[1][0] == geometry.length
    np.testing.assert_array_equal(geometry.solids["step"].bounds()[1], [0.5, 0.2])


def test_solids_may_stand_side_by_side_and_under_a_device():
    """Touching faces do not overlap, and a bed may lie under the plate of a chamber."""
    case = TANK.replace({"solid.step.block": {"low": [0.4, 0.0], "high": [0.8, 0.12]}})
    assert [body.name for body in case.problem().model.bodies] == ["bed", "step"]
    column = case.replace(
        {
            "solid.bed.polygon": [[0.8, 0.0], [2.0, 0.12], [2.0, 0.0]],
            "device": {"chamber_length": 0.4, "wall_thickness": 0.12, "draught": 0.12},
            "pto": {"K_dm": 100.0},
        }
    )
    assert len(column.problem().model.chambers) == 1


@pytest.mark.parametrize("angle", [-0.5, 0.0, 0.17])
def test_water_is_packed_around_a_body_as_it_leans(angle):
    """At least a fifth of a spacing is left, at a corner.

    With water packed around the upright body, particles would be up to two spacings inside the leaning one.
    """
    flap = {"block": {"low": [0.88, 0.08], "high": [1.08, 0.28]}, "pivot": [1.0, 0.2], "angle": angle}
    model, state = js.build(TANK.replace({"solid.bed": None, "body": flap}))
    (body,) = model.bodies
    away = body.distance(state.parts["body"], state.particles.x)
    assert float(away.min()) > 0.2 * TANK.dx
