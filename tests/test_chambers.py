"""Chambers between any walls, and ducts between chambers: keys of a case, laws, and energies."""

import itertools
import tomllib
from types import SimpleNamespace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import shapely
from conftest import enable_x64
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

import jaxsph as js
from jaxsph.case.geometry import Geometry
from jaxsph.cli.app import app
from jaxsph.core.arrays import columns
from jaxsph.core.slabs import ONE
from jaxsph.errors import CaseError
from jaxsph.model.air import Air, AirCoupling
from jaxsph.model.state import Pressures, Response, Tally
from jaxsph.output.run_file import RunFile
from jaxsph.parts.sides import Sides
from jaxsph.report.content import run_content
from jaxsph.report.pack import Pack
from jaxsph.run.amend import amended_case
from jaxsph.schemes.air import LEAST, WaterLine, finish_airs, meet_laws, water_line

FRONT = [[1.0, 0.24], [1.12, 0.24], [1.24, 0.56], [1.12, 0.56]]
BACK = [[1.48, 0.0], [1.8, 0.56], [2.0, 0.56], [2.0, 0.0]]
LEANING = js.Case.from_dict(
    {
        "name": "leaning",
        "dx": 0.04,
        "t1": 0.6,
        "scheme": {"kind": "incompressible"},
        "tank": {"length": 2.0, "depth": 0.4},
        "solid": {"front": {"polygon": FRONT}, "back": {"polygon": BACK}},
        "chamber": {"column": {"between": ["front", "back"], "pto": {"P_a": 150.0, "ramp": 0.3}}},
        "output": {"sample_dt": 0.05},
    }
)
SHARED = js.Case.from_dict(
    {
        "name": "shared",
        "dx": 0.04,
        "t1": 0.4,
        "scheme": {"kind": "incompressible"},
        "tank": {"length": 2.0, "depth": 0.4},
        "start": {"amplitude": 0.03, "mode": 1},
        "solid": {
            "front": {"block": {"low": [1.2, 0.24], "high": [1.32, 0.56]}},
            "middle": {"block": {"low": [1.56, 0.24], "high": [1.68, 0.56]}},
        },
        "chamber": {
            "sea": {"between": ["front", "middle"], "pto": {"K_dm": 200.0}},
            "land": {"between": ["middle", "far"]},
        },
        "duct": {"cross": {"between": ["sea", "land"], "area": 0.01}},
        "output": {"sample_dt": 0.04},
    }
)


# --- the walls


@st.composite
def faces(draw):
    """Corners of the faces of a front and a back wall between 0 and 1 m, which do not intersect."""
    found = []
    for low, high in ((0.0, 0.4), (0.6, 1.0)):
        z = np.linspace(0.0, 1.0, draw(st.integers(2, 5)))
        # GEOS gives a wrong area where an x is a subnormal number beside a zero
        x = st.floats(low, high, allow_subnormal=False)
        found.append([(draw(x), float(a)) for a in z])
    return found


@settings(deadline=None, max_examples=30)
@given(faces(), st.floats(0.36, 0.95))
def test_the_level_over_a_volume_is_exact_for_every_pair_of_walls(walls, level):
    """Area between the polylines, from an outside library, and back to the level."""
    front, back = walls
    with enable_x64():
        sides = Sides.of(front, back, 0.2, 0.35, 1.0, jnp.float64)
        whole = shapely.Polygon([*front, *back[::-1]])
        volume = whole.intersection(shapely.box(-1.0, 0.35, 2.0, level)).area
        assert float(sides.level(jnp.asarray(volume))) == pytest.approx(level, abs=1e-9)
        z = np.linspace(0.2, 1.0, 17)
        for face, found in zip(walls, sides.at(jnp.asarray(z)), strict=True):
            x, heights = np.transpose(face)
            np.testing.assert_allclose(found, np.interp(z, heights, x), atol=1e-12)


def test_upright_walls_are_those_of_plain_numbers():
    sides = Sides.of(1.0, [(1.5, 0.0), (1.5, 2.0)], 0.2, 0.3, 1.0, jnp.float32)
    assert np.all(np.asarray(sides.at(jnp.linspace(0.0, 2.0, 9))) == [[np.float32(1.0)], [np.float32(1.5)]])
    assert float(sides.level(jnp.float32(0.1))) == pytest.approx(0.5, rel=1e-6)


def test_the_faces_are_those_of_the_case_s_solids():
    """The lip is the front wall's lower end; the chamber is as long as the still water between the faces."""
    stretch = Geometry.of(LEANING).stretches["column"]
    assert stretch.tip == pytest.approx(0.24) and stretch.top == pytest.approx(0.56)
    inner, outer = 1.12 + 0.12 * 0.16 / 0.32, 1.48 + 0.32 * 0.4 / 0.56
    assert stretch.surface == pytest.approx(outer - inner, abs=1e-9)
    (chamber,) = LEANING.problem().model.chambers
    assert float(chamber.surface) == pytest.approx(outer - inner, abs=1e-5)


def test_flow_is_what_crosses_a_level_between_leaning_walls():
    """Water that rises uniformly: its speed times the length between the walls, at the height where the air
    acts.

    Four rows of particles give the flow to 3 %.
    """
    model, state = js.build(LEANING.replace({"dx": 0.02}))
    (chamber,) = model.chambers
    x, V = columns(state.particles.x), state.particles.m / model.scheme.rho0
    along, upwards = js.BodyForceGrip().force(chamber, x, V, None)
    flow = -float(jnp.sum(upwards * 0.1))
    x0, x1 = chamber.sides.at(0.5 * (chamber.fade_low + chamber.fade_high))
    assert not np.any(along) and flow == pytest.approx(0.1 * float(x1 - x0), rel=0.05)


# --- cases that are refused


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"chamber.column.between": ["front", "front"]}, "needs two different walls"),
        (
            {"chamber.column.between": ["front", "quay"]},
            "no wall 'quay'; choose from front, back, far",
        ),
        ({"chamber.column.between": ["front", "device"]}, "there is no wall 'device'"),
        (
            {"solid.front.polygon": [[1.0, 0.12], [1.12, 0.12], [1.12, 0.36], [1.0, 0.36]]},
            "front does not pierce the still water surface at z = 0.4 m",
        ),
        (
            {"solid.front.polygon": [[1.0, 0.36], [1.12, 0.36], [1.24, 0.56], [1.12, 0.56]]},
            "at z = 0.36 m, and must be at least two spacings below still water",
        ),
        (
            {"solid.front.polygon": [[1.48, 0.24], [1.6, 0.24], [1.6, 0.56], [1.48, 0.56]]},
            r"the chamber is .* m long at the still water level, and must be at least three spacings",
        ),
        (
            {"solid.post.block": {"low": [1.36, 0.2], "high": [1.5, 0.6]}},
            "solid.post pierces the surface in the chamber",
        ),
        ({"chamber.column.pto": None}, "chamber.column: the air has no outlet"),
        (
            {"chamber.column.pto": {"K_dm": 300.0, "P_a": 2.0}},
            "give exactly one of K_dm",
        ),
        ({"chamber.column.pto.P_a": 5e3}, r"chamber.column.pto.P_a = 5000 Pa would lower .* at most"),
        ({"chamber.column.air": {"volume": 0.2}}, r"chamber.column.air: compressible air needs a turbine"),
        (
            {"chamber.other": {"between": ["front", "far"], "pto": {"K_dm": 3.0}}},
            "solid.back pierces the surface in the chamber",
        ),
        (
            {"chamber.other": {"between": ["front", "back"], "pto": {"K_dm": 3.0}}},
            "chamber.column and chamber.other both cover the surface from",
        ),
        (
            {"chamber.column": None, "chamber.front": {"between": ["front", "back"], "pto": {"K_dm": 3.0}}},
            "solid.front and chamber.front have the same name",
        ),
        ({"pto": {"K_dm": 3.0}}, r"pto is given, but there is no device .* \[chamber.NAME.pto\]"),
        ({"chamber.colunm.betwen": ["front", "back"]}, "did you mean 'chamber.NAME.between'"),
        ({"duct.cross": {"between": ["column", "land"], "area": 0.1}}, "there is no chamber 'land'"),
        ({"duct.cross": {"between": ["column", "column"], "area": 0.1}}, "needs two different chambers"),
        ({"duct.cross": {"between": ["column", "land"]}}, "duct.cross: give exactly one of area"),
        ({"waves": {"H": 0.17, "T": 1.4}}, "a wall ends 0.16 m above the water, and waves are 0.17 m high"),
        ({"tank.width": 1.0}, "dimensions|two-dimensional tank"),
    ],
)
def test_a_chamber_that_cannot_be_is_refused(changes, message):
    with pytest.raises(CaseError, match=message):
        LEANING.replace(changes)


def test_a_chamber_named_as_the_device_s_is_refused():
    case = js.load_case("owc")
    with pytest.raises(CaseError, match=r"chamber.chamber: \[pto\] belongs to the device's chamber"):
        case.replace({"chamber.chamber": {"between": ["device", "far"], "pto": {"K_dm": 3.0}}})
    with pytest.raises(CaseError, match="air: compressible air needs a turbine"):
        case.replace({"pto": None, "air": {"volume": 1.0}})


# --- short forms


@pytest.mark.parametrize("name", ["owc", "vessel", "owc_irregular"])
def test_a_short_form_is_the_same_problem(name):
    """Equal bit for bit in every array of model and state; equal words for readings and results."""
    case = js.load_case(name).replace({"dx": 0.04, "device.wall_thickness": 0.04})
    case = case.replace({"air.volume": 0.3}) if case.pto.is_turbine else case
    one, other = case.problem(), case.expanded().problem()
    assert case.expanded().pto is None and set(case.expanded().chamber) == {"chamber"}
    assert bool(eqx.tree_equal((one.model, one.state), (other.model, other.state)))
    assert one.model.chambers[0].readings(2) == other.model.chambers[0].readings(2)
    assert case.expanded().turbines == case.turbines and js.linear_check(case) == js.linear_check(
        case.expanded()
    )


def test_show_prints_a_case_without_short_forms(tmp_path):
    path = tmp_path / "shown.toml"
    path.write_text(CliRunner().invoke(app, ["show", "owc"]).stdout, encoding="utf-8")
    shown = js.load_case(str(path))
    assert shown == js.load_case("owc").expanded()
    whole = CliRunner().invoke(app, ["show", "owc", "--whole", "--set", "dx=0.01"]).stdout
    assert js.Case.from_dict(tomllib.loads(whole)).dx == 0.01 and "[fluid]" in whole
    program = CliRunner().invoke(app, ["show", "nothing.py:made"])
    assert program.exit_code != 0


def test_another_law_of_a_named_chamber_takes_the_place_of_the_one_before():
    changed = LEANING.replace({"chamber.column.pto.K_dm": 40.0})
    assert changed.chamber["column"].pto.P_a is None and changed.value("chamber.column.pto.K_dm") == 40.0
    assert not LEANING.roughness("chamber.column.pto.K_dm") and not SHARED.roughness("duct.cross.area")
    assert LEANING.roughness("chamber.column.between")


# --- laws coupled through the water


class _Chambers:
    """Stand-ins for a model and the states of its parts, for laws without water."""

    def __init__(self, chambers, ducts):
        self.model = SimpleNamespace(chambers=chambers, ducts=ducts)
        self.parts = {part.name: part.start(float) for part in (*chambers, *ducts)}

    def meet(self, flows, compliance, dt=0.01):
        names = [c.name for c in self.model.chambers]
        line = WaterLine(
            dict(zip(names, flows, strict=True)),
            {(a, b): compliance[i][j] for (i, a), (j, b) in itertools.product(enumerate(names), repeat=2)},
        )
        interval = SimpleNamespace(t=jnp.asarray(0.0), dt=jnp.asarray(dt))
        met = meet_laws(self.model, self.parts, line, interval)
        q = {
            a: line.flows[a] - sum(line.compliance[a, b] * met.chambers[b].P_a for b in names) for a in names
        }
        return met, q


def _chamber(name, pto, air=None):
    return js.Chamber.of(pto, between=(0.0, 1.0), tip=0.0, level=1.0, dx=0.1, name=name, air=air, dtype=float)


@settings(deadline=None, max_examples=20)
@given(st.floats(-3.0, 0.5))
def test_a_response_that_would_drive_the_air_is_limited(opposed):
    """Water whose response to the air is larger than the push of the air itself (`opposed` below -1)."""
    force, m, dt = jnp.asarray([0.02, 0.03]), jnp.asarray([0.4, 0.4]), jnp.asarray(0.01)
    air = AirCoupling(jnp.arange(2), (jnp.zeros(2), -force), m, ONE, {})
    pushed = -jnp.stack([jnp.zeros(2), force / m], axis=1) * dt
    response = Response(Pressures(jnp.zeros(2), jnp.zeros(0), (), {}), opposed * pushed)
    flows, before = {"column": jnp.asarray(0.05)}, {"column": jnp.asarray(300.0)}
    line = water_line({"column": air}, {"column": response}, (), flows, before, dt)
    own = float(dt * air.mobility())
    compliance = float(line.compliance["column", "column"])
    np.testing.assert_allclose(compliance, max(1.0 + opposed, LEAST) * own, rtol=1e-5)
    assert float(line.limited) == (2.0 if 1.0 + opposed < LEAST else 0.0)  # both particles
    P_a = js.PneumaticPTO(jnp.asarray(300.0)).pressure(line.flows["column"], compliance, 0.0)
    q = float(line.flows["column"]) - compliance * float(P_a)
    np.testing.assert_allclose(float(P_a), 300.0**2 * abs(q) * q, rtol=1e-3)


FLOWS = st.floats(-0.2, 0.2).filter(lambda q: abs(q) > 1e-4)
DAMPINGS = st.sampled_from([0.0, 5.0, 300.0, 3e4])


@settings(deadline=None, max_examples=40)
@given(FLOWS, FLOWS, DAMPINGS, DAMPINGS, st.floats(0.0, 0.45))
def test_two_chambers_and_a_duct_meet_every_law_at_once(q0, q1, K_duct, K_sea, shared):
    """A turbine of any damping on one chamber, only the duct on the other; the water couples both."""
    with enable_x64():
        sea = _chamber("sea", js.PneumaticPTO(jnp.asarray(K_sea)))
        land = _chamber("land", js.ClosedPTO())
        duct = js.Duct(("sea", "land"), js.Constriction(jnp.asarray(K_duct)), name="cross")
        C = 2e-5 * np.array([[1.0, shared], [shared, 1.5]])
        pair = _Chambers((sea, land), (duct,))
        met, q = pair.meet([jnp.asarray(q0), jnp.asarray(q1)], C)
        P = {name: float(pressed.P_a) for name, pressed in met.chambers.items()}
        drop, flow = float(met.ducts["cross"].P_a), float(met.ducts["cross"].passed)
        scale = max(abs(q0), abs(q1))
        pressure = scale / 2e-5
        assert P["sea"] - P["land"] == pytest.approx(drop, abs=1e-7 * pressure)
        assert drop == pytest.approx(K_duct**2 * abs(flow) * flow, abs=1e-7 * pressure)
        assert float(q["land"]) == pytest.approx(-flow, abs=1e-7 * scale)
        through = float(q["sea"]) - flow
        assert P["sea"] == pytest.approx(K_sea**2 * abs(through) * through, abs=1e-7 * pressure)


@settings(deadline=None, max_examples=20)
@given(FLOWS, FLOWS, st.booleans())
def test_energies_of_chambers_and_ducts_are_the_water_s(before, after, spring):
    """The ledger's energies sum to P_a times the mean flow at every surface, for any air and any turbine."""
    with enable_x64():
        air = js.IsentropicAir(*map(jnp.asarray, (0.5, 101_325.0, 1.4))) if spring else None
        parts = (
            _chamber("sea", js.PneumaticPTO(jnp.asarray(300.0)), air),
            _chamber("mid", js.ClosedPTO(), air),
            _chamber("land", js.ClosedPTO()),
        )
        ducts = tuple(
            js.Duct(ends, js.Constriction(jnp.asarray(K)), name=name)
            for name, ends, K in (("a", ("sea", "mid"), 200.0), ("b", ("mid", "land"), 900.0))
        )
        three = _Chambers(parts, ducts)
        C = 2e-5 * np.array([[1.0, 0.3, 0.1], [0.3, 1.0, 0.3], [0.1, 0.3, 1.0]])
        met, q = three.meet([jnp.asarray(after), jnp.asarray(-before), jnp.asarray(before)], C)
        flows = {name: (jnp.asarray(before), q[name]) for name in q}
        airs, taken = finish_airs(three.model, three.parts, met, flows, jnp.asarray(0.01))
        work = sum(0.01 * float(met.chambers[n].P_a) * 0.5 * (before + float(q[n])) for n in q)
        assert sum(map(float, taken.values())) == pytest.approx(work, rel=1e-9, abs=1e-12)
        assert set(airs) == {"sea", "mid", "land", "a", "b"}
        lost = {name for name in taken if name.startswith("duct_")}
        assert lost == {"duct_a", "duct_b"}


def test_a_wide_duct_makes_one_chamber_of_two():
    with enable_x64():
        sea, land = (_chamber(name, js.PneumaticPTO(jnp.asarray(300.0))) for name in ("sea", "land"))
        duct = js.Duct(("sea", "land"), js.Constriction(jnp.asarray(0.0)), name="cross")
        met, _ = _Chambers((sea, land), (duct,)).meet(
            [jnp.asarray(0.1), jnp.asarray(0.02)], 2e-5 * np.array([[1.0, 0.2], [0.2, 1.0]])
        )
        pressures = [float(pressed.P_a) for pressed in met.chambers.values()]
        assert pressures[0] == pytest.approx(pressures[1], rel=1e-9) and pressures[0] > 0.0


def test_a_duct_to_nowhere_is_refused():
    model, state = js.build(LEANING)
    with pytest.raises(ValueError, match="ducts end at sea, but must end at chambers of the model"):
        js.assemble(
            np.asarray(state.particles.x),
            np.asarray(state.particles.u),
            scheme=model.scheme,
            walls=model.walls,
            dx=0.04,
            sample_dt=0.05,
            bodies=model.bodies,
            chambers=model.chambers,
            ducts=[js.Duct(("column", "sea"), js.Constriction(jnp.float32(1.0)))],
        )


def test_air_at_rest_of_a_duct_gives_finite_slopes():
    with enable_x64():
        sea, land = _chamber("sea", js.PneumaticPTO(jnp.asarray(300.0))), _chamber("land", js.ClosedPTO())

        def pressure(K, q):
            duct = js.Duct(("sea", "land"), js.Constriction(K), name="cross")
            pair = _Chambers((sea, land), (duct,))
            met, _ = pair.meet([q, -0.5 * q], 2e-5 * np.array([[1.0, 0.2], [0.2, 1.0]]))
            return met.chambers["land"].P_a

        assert np.isfinite(float(jax.grad(pressure)(jnp.asarray(100.0), jnp.asarray(0.0))))
        slope = float(jax.grad(pressure)(jnp.asarray(100.0), jnp.asarray(0.1)))
        apart = [float(pressure(jnp.asarray(K), jnp.asarray(0.1))) for K in (99.9, 100.1)]
        assert slope == pytest.approx((apart[1] - apart[0]) / 0.2, rel=1e-5)


# --- runs


@pytest.fixture(scope="module")
def shared(tmp_path_factory):
    """Two chambers with a duct, run in two parts: the file, and the final solution."""
    path = tmp_path_factory.mktemp("chambers") / "shared.h5"
    js.run(SHARED, 0.2, out=path, progress=False)
    return path, js.resume(path, 0.4, progress=False)


def test_a_duct_s_law_holds_in_the_water(shared):
    _, solution = shared
    drop, flow = (np.float64(solution[f"{name}_cross"])[1:] for name in ("pressure_drop", "duct_flow"))
    P = {name: np.float64(solution[f"P_a_{name}"])[1:] for name in ("sea", "land")}
    largest = np.abs(P["sea"]).max()
    assert largest > 1.0
    K = float(solution.model.ducts[0].pto.K_dm)
    # rounding: ten times that of the pressures, whose difference is the drop
    assert np.abs(drop - K**2 * np.abs(flow) * flow).max() < 1e-5 * largest
    assert np.abs(P["sea"] - P["land"] - drop).max() < 1e-5 * largest
    assert np.abs(np.float64(solution["flow_land"])[1:] + flow).max() < 1e-5 * np.abs(flow).max()
    assert abs(solution.results["energy_residual"]) < 1e-4
    assert float(solution.state.ledger["duct_cross"].total) > 0.0


def test_a_run_with_a_duct_goes_on_as_if_it_had_not_stopped(shared):
    whole = js.run(SHARED, 0.4, progress=False)
    for name in ("P_a_sea", "duct_flow_cross", "chamber_level_land", "power_duct_cross"):
        np.testing.assert_array_equal(shared[1][name], whole[name])


def test_chambers_and_ducts_are_told_on_the_page(shared):
    titles = [panel["title"] for panel in run_content(RunFile.open(shared[0]), Pack())["panels"]]
    assert {"Air pressure, positive when compressed: sea", "Level in the chamber: land"} <= set(titles)
    assert any("from the sea to the land" in title for title in titles)


def test_a_run_may_change_a_named_turbine_and_not_a_chamber():
    assert amended_case(SHARED, {"chamber.sea.pto.K_dm": 900.0}).turbines[0].K_dm == 900.0
    assert amended_case(SHARED, {"duct.cross.area": 0.02}).duct["cross"].area == 0.02
    for key, value in (("chamber.sea.between", ["front", "far"]), ("duct.cross.between", ["land", "sea"])):
        with pytest.raises(CaseError, match=f"{key} cannot change during a run"):
            amended_case(SHARED, {key: value})
    with pytest.raises(CaseError, match=r"chamber.sea.pto cannot change between a turbine and a prescribed"):
        amended_case(SHARED, {"chamber.sea.pto.P_a": 90.0})


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("owc_slope", "none: chamber.column is not between the plate of a device and the end wall"),
        ("owc_two_chambers", "none: there are several chambers"),
    ],
)
def test_where_there_is_no_linear_theory_check_says_why(name, why):
    assert js.linear_check(js.load_case(name)) == [("linear theory", why)]
    assert len(js.linear_check(js.load_case("owc_ning"))) == 3
    assert js.linear_check(js.load_case("beach")) == []


@pytest.mark.slow
def test_water_between_leaning_walls_is_pushed_down_as_far_as_its_weight_says():
    """The level falls by the pressure over rho g, less the rise outside, because the volume is conserved.

    Mean over the last samples, within a third of a spacing at ten spacings of depth, swings included.
    """
    case = LEANING.replace({"t1": 6.0, "chamber.column.pto.ramp": 3.0, "output.sample_dt": 0.1})
    solution = js.run(case, progress=False)
    level = np.float64(solution["chamber_level_column"])[-20:]
    stretch = Geometry.of(case).stretches["column"]
    outside = 1.0 + 0.12 * 0.16 / 0.32
    down = 150.0 / 9810.0 * outside / (outside + stretch.length)
    assert np.mean(level) == pytest.approx(-down, abs=0.08 * down)


def test_still_air_starts_at_rest():
    air = js.Duct(("a", "b"), js.ClosedPTO()).start(jnp.float32)
    assert isinstance(air, Air) and float(air.P_a) == 0.0 and isinstance(air.driven, Tally)
