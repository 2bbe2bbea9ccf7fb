"""Cases: what is refused and with which message, what is rounded, and that a case survives as text."""

import math
import re
import tomllib

import numpy as np
import pytest
from conftest import COARSE, coarse
from hypothesis import given, settings
from hypothesis import strategies as st

import jaxsph as js
from jaxsph.case import limits
from jaxsph.case.case import Case, key_names
from jaxsph.case.expected import EXPECTED, ONLY_IN
from jaxsph.case.geometry import Geometry
from jaxsph.case.initial import initial_velocity
from jaxsph.case.scheme import make_scheme
from jaxsph.errors import CaseError
from jaxsph.solids.filling import DummyParticles, MirrorImages

OWC = js.load_case("owc")
INCOMPRESSIBLE = {"scheme.kind": "incompressible"}


# --- bad input


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        # an unknown key, with the nearest name
        ({"pto.Kdm": 300.0}, r"unknown key 'pto.Kdm'; did you mean 'pto.K_dm'\?"),
        ({"tank.lenght": 3.0}, r"unknown key 'tank.lenght'; did you mean 'tank.length'\?"),
        ({"waves.h": 0.1}, r"unknown key 'waves.h'; did you mean 'waves.H'\?"),
        ({"K_dm": 300.0}, r"unknown key 'K_dm'; did you mean 'pto.K_dm'\?"),
        ({"foo.bar": 1}, r"unknown key 'foo' \(keys here: .*tank"),
        ({"dx.fine": 1}, "dx is a value, not a section"),
        # a wall that the lattice or the method cannot hold
        ({"device.wall_thickness": 0.005}, r"device.wall_thickness = 0.005 m is less than half a spacing"),
        ({"device.thin_wall": "multi_node"}, r"device.wall_thickness = 0.02 m .*need 2.*or regional ghosts"),
        # dx that does not fit
        ({"dx": 0.3}, r"tank.depth = 0.42 m does not fit dx = 0.3 m: .* use dx of at most 0.105 m"),
        ({"dx": 0.05}, r"device.chamber_length = 0.13 m is 2.6 spacings of dx = 0.05 m long, .* three"),
        # lengths
        ({"dx": 0.0}, r"dx = 0.0: must be positive"),
        ({"tank.length": -1.0}, r"tank.length = -1.0: must be positive"),
        ({"tank.depth": 0.0}, r"tank.depth = 0.0: must be positive"),
        ({"device.draught": -0.1}, r"device.draught = -0.1: must be positive"),
        ({"device.wall_thickness": -0.04}, r"= -0.04: must be positive \(Thickness of the plate, m\)"),
        ({"t1": 0.0}, r"t1 = 0.0: must be positive"),
        # numbers as text
        ({"device.draught": "0.16 m"}, r"= '0.16 m': must be a number in m, without the unit"),
        ({"device.draught": "0,16"}, r"= '0,16': must be a number: use a decimal point"),
        ({"device.draught": "0.16"}, r"= '0.16': must be a number without quotes"),
        ({"waves.T": "1.2s"}, r"waves.T = '1.2s': must be a number in s, without the unit"),
        ({"device.draught": 0.42}, r"device.draught = 0.42 m: .* at most 0.38 m"),
        ({"device.platform_height": 0.1}, r"both device.platform_length and device.platform_height, or"),
        (
            {"device.platform_height": 0.24, "device.platform_length": 0.5},
            r"device.platform_height = 0.24 m: must leave at least two spacings .* at most 0.22 m",
        ),
        (
            {"device.platform_height": 0.1, "device.platform_length": 7.8},
            r"device.platform_length = 7.8 m: must leave at least four spacings .* use at most 7.76 m",
        ),
        ({"tank.height": 0.3}, r"tank.height = 0.3 m: must be more than tank.depth = 0.42 m"),
        ({"sponge.length": 20.0}, r"sponge.length = 20 m: must be shorter than the tank"),
        ({"dx": math.nan}, r"dx = nan: .*finite"),
        # probes outside
        ({"probes.gauges": [1.0, 9.0]}, r"probes.gauges\[1\] = 9 m is outside the tank \(0 to 7.84 m\)"),
        ({"probes.pressure": [[1.0, 5.0]]}, r"probes.pressure\[0\] = \[1.0, 5.0\] is not inside"),
        (
            {"probes.pressure": [[1.0, 0.1, 0.1]]},
            r"probes.pressure\[0\] = .*: must be a position \(x, z\), m",
        ),
        # the PTO
        ({"pto": {"K_dm": 1.0, "P_a": 2.0}}, "exactly one of K_dm .* and P_a .*; K_dm and P_a are given"),
        ({"pto": {"ramp": 0.0}}, "exactly one of K_dm .* and P_a .*; none of them is given"),
        ({"pto.K_dm": math.inf}, r"pto.K_dm = inf: .*finite"),
        ({"pto.K_dm": -1.0}, r"pto.K_dm = -1.0: .*greater than or equal to 0"),
        ({"device": None}, "pto is given, but there is no device"),
        # what excludes each other
        ({"start.amplitude": 0.01}, "start and waves exclude each other"),
        ({"tank.width": 0.5}, "tank.width = 0.5 m: a device needs a two-dimensional tank"),
        (
            {"scheme.kernel": "cubic"},
            r"scheme.kernel = 'cubic': .*'gaussian', 'wendland', 'semicircle' or 'polynomial'",
        ),
    ],
    ids=lambda value: None if isinstance(value, str) else "+".join(value),
)
def test_bad_input_is_named_with_what_is_allowed(changes, message):
    with pytest.raises(CaseError, match=message):
        OWC.replace(changes)


def test_thin_wall_message_names_the_case_s_own_dx():
    with pytest.raises(CaseError, match="dx = 0.02 m"):
        OWC.replace({"device.wall_thickness": 0.005})


def test_missing_section_is_named():
    with pytest.raises(CaseError, match="tank: is missing"):
        Case.from_dict({"dx": 0.1, "t1": 1.0})


def test_float64_has_to_be_switched_on():
    case = coarse("hydrostatic", {"precision": "float64"})  # valid, but float64 is not enabled
    with pytest.raises(CaseError, match=r'precision = "float64" needs .*jax_enable_x64'):
        js.build(case)


def test_unknown_built_in_has_a_hint():
    with pytest.raises(CaseError, match=r"no built-in case 'ocw'; did you mean 'owc'\?"):
        js.load_case("ocw")


def test_case_files(tmp_path):
    with pytest.raises(CaseError, match=r"no case file .*absent.toml"):
        js.load_case(tmp_path / "absent.toml")
    path = tmp_path / "mine.toml"
    path.write_text("dx = 0.1\nt1 = \n")
    with pytest.raises(CaseError, match=r"mine.toml is not a TOML file: .*line 2"):
        js.load_case(path)
    path.write_text("dx = 0.1\nt1 = 1.0\n[tank]\nlength = 1.0\ndepth = 0.5\n")
    assert js.load_case(path).name == "mine"


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("t1 = 0,4", "line 2, .*, in the line 't1 = 0,4'; use a decimal point"),
        ("t1 = 4 s  # the end", "line 2, .*, in the line 't1 = 4 s  # the end'; give numbers without"),
        ("t1 == 4", "line 2, .*, in the line 't1 == 4'$"),
        ("t1 =" + " 1" * 500, r"line 2, .*, in the line 't1 = 1.*\.\.\.'$"),
    ],
)
def test_a_faulty_line_of_a_case_file_is_shown(tmp_path, line, message):
    path = tmp_path / "mine.toml"
    path.write_text(f"dx = 0.1\n{line}\n")
    with pytest.raises(CaseError, match=message):
        js.load_case(path)


@pytest.mark.parametrize(
    ("changes", "notice"),
    [
        (
            {"waves.H": 0.2},
            r"waves.H = 0.2 m is near breaking, which begins at a height of 0.243 m \(Miche's limit",
        ),
        (
            {"waves.H": 0.32, "waves.T": 4.0},
            r"near breaking, which begins at a height of 0.328 m \(0.78 of the depth",
        ),
        (
            {"fluid.c0": 1.0, "scheme.kind": "weakly_compressible"},
            r"fluid.c0 = 1 m/s is less than three times the largest speed",
        ),
        ({"waves.T": 30.0}, r"shallow water"),
        ({"waves.T": 0.5}, r"deep water"),
        ({"waves.H": 0.02}, r"waves.H = 0.02 m is only 1.0 spacings high"),
        ({"device.wall_thickness": 0.01}, r"device.wall_thickness = 0.01 m is less than a spacing"),
    ],
)
def test_theory_s_limits_are_told_not_refused(changes, notice):
    assert any(re.search(notice, note) for note in OWC.replace(changes).notices())
    assert not any(re.search(notice, note) for note in OWC.notices())


# --- what no case may ask for


TINY = js.load_case("hydrostatic").replace({"dx": 0.1, "probes": {}})
SQUARE = [[0.3, 0.3], [0.7, 0.3], [0.7, 0.7], [0.3, 0.7]]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        # wrong types and huge values
        ({"dx": True}, r"dx = True: must be a number"),
        ({"dx": "0.02"}, r"dx = '0.02': must be a number"),
        ({"t1": 10**400}, r"t1 = 1000.*\(401 characters\): must be a number"),
        ({"t1": 16**9000}, r"t1 = an integer of 36001 bits"),
        ({"tank": 3}, r"tank = 3: must be a section"),
        ({"probes.gauges": 0.3}, r"probes.gauges = 0.3: must be a list"),
        ({"probes.gauges": [0.1] * 20_000}, r"probes.gauges .*at most 10000 items"),
        ({"probes.gauges": ["a"] * 20}, r"probes.gauges.0 = 'a': (.|\n)*and 15 more"),
        (
            {"probes.gauges": [[[[[[[[[[[[0.1]]]]]]]]]]]]},
            r"probes.gauges: lists or sections are nested too deep",
        ),
        ({"name": "../case"}, r"name = '../case': "),
        # sizes
        ({"tank.length": 1e9}, r"tank.length = 1000000000.0: .*less than or equal to 100000"),
        ({"dx": 1e-5}, r"dx = 1e-05 m makes a lattice of 1.2e\+10 points .*: at most .*Use a larger dx"),
        ({"tank.length": 1e5}, r"dx = 0.1 m: float32 resolves .* to 0.012 m; .* at least 0.36 m"),
        # steps
        (
            {"t1": 1e8},
            r"t1 = 1e\+08 s takes .*e\+.* time steps of .* s, but at most 1e\+08.*sound speed, 31.3 m/s",
        ),
        (
            {"fluid.c0": 1e6, "t1": 1e3},
            r"time steps .*the sound speed, 1e\+06 m/s: change fluid.c0, scheme.cfl",
        ),
        ({"fluid.nu": 1e3, "t1": 1e3}, r"time steps .*the viscosity, 1e\+03 m2/s: change fluid.nu or dx"),
        ({"output.sample_dt": 1e-8}, r"time steps .*output.sample_dt = 1e-08 s: use a longer one"),
        ({"output.sample_dt": 10.0}, r"output.sample_dt = 10 s: must be at most t1 = 5 s"),
        (
            INCOMPRESSIBLE | {"scheme.speed": 5e-324},
            r"scheme.speed = 5e-324: .*greater than or equal to 0.000001",
        ),
        (INCOMPRESSIBLE | {"scheme.speed": 1e6, "t1": 1e3}, r"time steps .*1e\+06 m/s: change scheme.speed"),
        # waves
        (
            {"waves": {"H": 9.0, "T": 2.0}},
            r"waves.H = 9 m: .* break above a height of 0.618 m \(Miche's limit",
        ),
        (
            {"waves": {"H": 0.9, "T": 9.0}},
            r"waves.H = 0.9 m: .* break above a height of 0.78 m \(0.78 of the depth of 1 m",
        ),
        ({"waves": {"H": 0.01, "T": 0.3}}, r"waves.T = 0.3 s: the wavelength, 0.141 m, is less than four"),
        ({"waves": {"H": 0.7, "T": 9.0}}, r"stroke of 3.1\d m, more than half of the 1 m of water"),
        ({"waves": {"H": 0.1, "T": 1.0}, "tank.length": 0.5}, r"tank.length = 0.5 m: .* gauge needs 0.68 m"),
        ({"waves": {"H": 0.1, "T": 1.0}, "g": 0.0}, r"waves need gravity, but g = 0"),
        ({"g": 5e-324}, r"g = 5e-324: must be 0 or at least 0.001"),
        (
            {"start": {"amplitude": 0.01, "mode": 20}},
            r"start.mode = 20: .*less than two spacings.* at most 5",
        ),
        (
            {"start": {"amplitude": 1.0}},
            r"start.amplitude = 1 m: .* breaks in a depth of 1 m; use an amplitude of at most 0.218 m",
        ),
        # bodies
        (
            {"body": {"polygon": [*SQUARE, SQUARE[0]]}},
            r"corners 4 and 0 are at the same place.*closes by itself",
        ),
        ({"body": {"polygon": [SQUARE[i] for i in (0, 2, 1, 3)]}}, r"body.polygon: the sides must not cross"),
        (
            {"body": {"polygon": [[0.1, 0.2], [0.5, 0.2], [0.9, 0.21]]}},
            r"body.polygon is everywhere thinner than a spacing",
        ),
        ({"body": {"polygon": [[0.1, 0.2], [0.5, 0.2], [0.9, 0.2]]}}, r"body.polygon: "),
        ({"body": {"block": {"low": [0.3, 0.3], "high": [0.7, 0.31]}}}, r"body.block is 0.01 m thick"),
        (
            {"body": {"disc": {"centre": [0.5, 0.5], "radius": 0.04}}},
            r"body.disc.radius = 0.04 m: .*half",
        ),
        ({"body": {"polygon": SQUARE, "angle": 1.6, "pivot": [1.0, 0.0]}}, r"body extends outside the tank"),
        ({"tank.column": 0.5, "tank.layer": 1.0}, r"tank.layer = 1 m: must be less than the column's depth"),
    ],
    ids=lambda value: None if isinstance(value, str) else "+".join(value),
)
def test_what_cannot_be_is_refused_before_anything_is_made(changes, message):
    with pytest.raises(CaseError, match=message):
        TINY.replace(changes)


@pytest.mark.parametrize(
    ("P_a", "message"),
    [
        (
            8e3,
            r"pto.P_a = 8000 Pa would lower the chamber's level .* wall ends 0.33 m .* at most 6\d\d\d",
        ),
        (-8e3, r"pto.P_a = -8000 Pa would raise the chamber's level .* m, but the walls end 0.24 m"),
    ],
)
def test_air_that_would_leave_its_chamber_is_refused(P_a, message):
    with pytest.raises(CaseError, match=message):
        js.load_case("vessel").replace({"pto.P_a": P_a})


def test_standing_waves_start_in_deep_water_too():
    """Two spacings per half wavelength, 250 spacings deep: at kd = 785 cosh(kd) overflows float64."""
    case = TINY.replace({"dx": 0.01, "tank.depth": 2.5, "start": {"amplitude": 1e-3, "mode": 50}})
    geometry = Geometry.of(case)
    x = np.array([[0.5, 0.0], [0.49, 2.5], [0.495, 2.49]])
    u = initial_velocity(case, geometry, x)
    k = 50 * np.pi
    scale = 1e-3 * np.sqrt(9.81 * k) * np.exp(k * (x[:, 1] - 2.5))
    # rounding of kx and k(z - d), which are of order some hundreds
    expected = np.stack([-np.sin(k * x[:, 0]) * scale, np.cos(k * x[:, 0]) * scale], axis=1)
    np.testing.assert_allclose(u, expected, rtol=1e-12, atol=1e-15)


def test_memory_is_counted_before_anything_is_made(monkeypatch):
    """The flap at 1/20 of its spacing: 6e7 particles of water in a tank of 6 x 0.8 x 0.36 m."""
    fine = js.load_case("flap_3d").replace({"dx": 0.003, "t1": 1.0})
    monkeypatch.setattr(limits, "machine_memory", lambda: 16e9)
    words = (
        r"dx = 0.003 m makes about 6.3\de\+07 particles of water .* of walls, .* need about 1\d\d GB .* 16 GB"
    )
    with pytest.raises(CaseError, match=words):
        js.build(fine)
    monkeypatch.undo()
    assert 1e8 < limits.machine_memory() < 1e15


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"dx = 0.1 # \xff", r"mine.toml is not UTF-8 text: byte 11 is not valid; save the file as UTF-8"),
        (b"dx = " + b"[" * 5000, r"mine.toml: lists or tables are nested too deep"),
        (b"dx = " + b"9" * 5000, r"mine.toml: a value cannot be read: .*4300"),
        (b"dx = 0x" + b"f" * 5000, r"dx = an integer of 20000 bits: must be a number"),
        (b"#" * 2_000_000, r"mine.toml is too large for a case file, .* 1e\+06 bytes"),
        (b"dx = \x00", r"mine.toml is not a text file: byte 5 is a NUL byte; save"),
    ],
)
def test_files_that_are_no_case(tmp_path, text, message):
    path = tmp_path / "mine.toml"
    path.write_bytes(text)
    with pytest.raises(CaseError, match=message):
        js.load_case(path)


# --- lattice


def test_snapping_says_what_became_of_each_length():
    notes = OWC.replace({"device.draught": 0.15}).notices()
    assert any("device.draught = 0.15 m" in note and "becomes 0.16 m" in note for note in notes)
    # Every length of the default geometry fits: the faces of the plate are not rounded to the lattice.
    assert not [note for note in OWC.notices() if "becomes" in note]
    assert Geometry.of(OWC).stretches["chamber"].surface == 0.13


def test_probes_on_a_wall_go_where_the_lattice_moved_it():
    """The dam break's far wall is moved from 3.22 m to 3.2 m with dx = 0.05 m; its sensor must move too."""
    case = js.load_case("dam_break").replace({"dx": 0.05})
    assert Geometry.of(case).pressure == ((3.2, 0.12),)
    assert any("probes.pressure[0]: 3.22 m is on the end wall" in note for note in case.notices())
    between = case.replace({"probes.pressure": [[3.21, 0.1], [1.0, 0.1]], "probes.gauges": [3.22]})
    assert Geometry.of(between).pressure == ((3.2, 0.1), (1.0, 0.1)) and Geometry.of(between).gauges == (3.2,)
    longer = case.replace({"tank.length": 3.23, "probes.pressure": [[3.23, 0.12]]})
    assert Geometry.of(longer).pressure == ((3.25, 0.12),)
    model, state = js.build(case)
    (sensors,) = (p for p in js.make_probes(case, model, state) if isinstance(p, js.PressureProbe))
    assert float(sensors.x[0, 0]) == pytest.approx(3.2)
    # also at the plate and at the side wall
    owc = OWC.replace({"tank.length": 7.85, "probes.pressure": [[7.70, 0.3], [7.72, 0.3], [7.85, 0.3]]})
    assert [x for x, _ in Geometry.of(owc).pressure] == pytest.approx([7.71, 7.73, 7.86])
    deep = js.load_case("flap_3d").replace({"tank.width": 0.79, "probes.surface": [[3.04, 0.79]]})
    assert Geometry.of(deep).surface == ((3.04, 0.8),)
    with pytest.raises(CaseError, match=r"probes.pressure\[0\] = \[3.24, 0.12\] is not inside the tank"):
        case.replace({"probes.pressure": [[3.24, 0.12]]})


def test_faces_of_a_block_that_miss_the_lattice_are_told():
    def notes(low, high):
        block = {"body": {"block": {"low": low, "high": high}}, "dx": 0.05}
        return [note for note in TINY.replace(block).notices() if "body.block" in note]

    assert not notes([0.3, 0.3], [0.7, 0.5])
    (note,) = notes([0.3, 0.3], [0.72, 0.5])
    assert "face at 0.72 m is 0.02 m from the nearest plane midway between particles" in note
    assert "of the lattice (dx = 0.05 m)" in note and "dx = 0.02 m fits all" in note
    (note,) = notes([0.3, 0.3], [0.7001, 0.5])
    assert "no dx close to 0.05 m" in note
    assert not [n for n in js.load_case("wedge_entry").notices() if "lattice" in n]  # a polygon


# processor time of a step (s) on one core, with N particles of water, and G ghosts of a filling
MEASURED = [
    ("hydrostatic", {"dx": 0.005}, 40_000, 4_973, MirrorImages, 4.42e-2),
    ("owc", {"scheme.kind": "weakly_compressible"}, 8_232, 3_922, MirrorImages, 1.37e-2),
    ("hydrostatic", {"dx": 0.05, "tank.width": 0.5}, 4_000, 24_047, MirrorImages, 4.04e-2),
    ("hydrostatic", {"dx": 0.025, "tank.width": 0.5}, 32_000, 64_986, MirrorImages, 2.99e-1),
    (
        "hydrostatic",
        {"dx": 0.05, "tank.width": 0.5, "scheme.integrator": "predictor_corrector"},
        4_000,
        24_047,
        MirrorImages,
        6.13e-2,
    ),
    (
        "dam_break_column",
        {"scheme.kind": "weakly_compressible", "dx": 0.04},
        1_200,
        14_220,
        DummyParticles,
        1.23e-1,
    ),
    ("hydrostatic", INCOMPRESSIBLE | {"dx": 0.005}, 40_000, 3_840, MirrorImages, 1.49e-1),
    ("owc", {}, 8_232, 3_019, MirrorImages, 3.30e-2),
    ("flap_2d", {"dx": 0.04}, 4_164, 1_203, DummyParticles, 1.49e-2),
    ("hydrostatic", INCOMPRESSIBLE | {"dx": 0.05, "tank.width": 0.5}, 4_000, 16_924, MirrorImages, 6.06e-2),
    ("wave_tank_3d", {"dx": 0.05}, 5_280, 50_074, MirrorImages, 9.67e-2),
    ("dam_break_column", {"dx": 0.03}, 2_600, 16_852, DummyParticles, 1.23e-1),
    ("sphere_decay", {"dx": 0.05}, 27_000, 22_116, DummyParticles, 5.76e-1),
    ("flap_3d", {"dx": 0.06}, 7_765, 17_028, DummyParticles, 2.71e-1),
]


@pytest.mark.parametrize(("name", "changes", "water", "ghosts", "filling", "measured"), MEASURED)
def test_expected_time_of_a_step_is_that_of_a_run(name, changes, water, ghosts, filling, measured):
    """Within a factor of 1.5. Images of particles cost little, other ghosts as much as water."""
    quiet = {"tank.layer": None} if name == "dam_break_column" else {"probes.pressure": None}
    case = js.load_case(name).replace(changes | quiet)
    expected = (water + filling.effort * ghosts) * make_scheme(case).cost(case.dx, case.dim)
    assert 1 / 1.5 < expected / measured < 1.5


@settings(max_examples=100, deadline=None)
@given(dx=st.floats(0.01, 0.03), length=st.floats(2.0, 9.0), depth=st.floats(0.4, 0.8))
def test_walls_stand_between_particles(dx, length, depth):
    """Every length, except those of the plate, is a whole number of spacings."""
    try:
        case = OWC.replace({"dx": dx, "tank.length": length, "tank.depth": depth, "probes": {}})
    except CaseError as error:
        assert "dx" in str(error)
        return
    geometry = Geometry.of(case)
    plate = geometry.plate
    lengths = [geometry.length, geometry.depth, plate.tip]
    # The lengths are rounded to 12 digits.
    assert all(abs(a / dx - round(a / dx)) < 1e-8 for a in lengths)
    assert abs(geometry.length - length) <= dx / 2 + 1e-9
    assert geometry.length - plate.x1 == pytest.approx(case.device.chamber_length, abs=1e-11)
    assert plate.thickness == pytest.approx(case.device.wall_thickness, abs=1e-11)


# --- the scheme


def test_the_scheme_s_kind_decides_its_keys():
    for name, changes in (("wave_tank", INCOMPRESSIBLE), ("owc", {"scheme.kind": "weakly_compressible"})):
        case = js.load_case(name)
        other = case.replace(changes)
        assert other.scheme == type(other.scheme)() and type(other.scheme) is not type(case.scheme)
        assert other.replace({"scheme.cfl": 0.2, "scheme.kind": case.scheme.kind}).scheme.cfl == 0.2
        assert Case.from_dict(tomllib.loads(other.to_toml())) == other
    assert OWC.replace({"scheme": {"cfl": 0.4}}).scheme.kind == "weakly_compressible"


@pytest.mark.parametrize(
    ("case", "changes", "message"),
    [
        ("flap_2d", {"scheme.alpha": 0.1}, r'scheme.alpha belongs to scheme.kind = "weakly_compressible"'),
        ("wave_tank", {"scheme.speed": 2.0}, r'scheme.speed belongs to scheme.kind = "incompressible"'),
        ("owc", {"scheme.kind": "sph"}, r"scheme.kind = 'sph': must be \"weakly_compressible\" or"),
        ("owc", {"scheme": "incompressible"}, r"scheme = 'incompressible': must be a section"),
        ("flap_2d", {"scheme.sped": 2.0}, r"unknown key 'scheme.sped'; did you mean 'scheme.speed'"),
        ("owc", {"isph.cfl": 0.1}, r'\[scheme\]\nkind = "incompressible"\ncfl = 0.1$'),
        ("owc", {"isph": None}, r'Replace .*\n\[scheme\]\nkind = "incompressible"$'),
        ("owc", {"tank.widht": None}, r"unknown key 'tank.widht'; did you mean 'tank.width'"),
    ],
)
def test_keys_of_the_other_kind_are_refused_with_what_to_write(case, changes, message):
    with pytest.raises(CaseError, match=message):
        js.load_case(case).replace(changes)


def test_lattice_checks_use_the_kernel_s_own_reach():
    """The Gaussian reaches 4.2 spacings and needs four layers; the polynomial reaches 3.05 and needs 3."""
    wide = OWC.replace({"scheme.kernel": "gaussian"})
    assert wide.layers == OWC.replace({"scheme.kind": "weakly_compressible"}).layers == 4
    assert OWC.layers == 3 and OWC.pto.K_dm == 534.66
    two = {"device.thin_wall": "multi_node", "device.wall_thickness": 0.04}
    assert OWC.replace(two).device.thin_wall == "multi_node"  # which needs one layer less than the kernel
    with pytest.raises(CaseError, match="multi-node ghosts need 3"):
        wide.replace(two)


# --- replace and text


def test_replace_gives_a_changed_copy():
    changed = OWC.replace({"pto.K_dm": 300.0, "dx": 0.01})
    assert (changed.pto.K_dm, changed.dx) == (300.0, 0.01) and (OWC.pto.K_dm, OWC.dx) == (534.66, 0.02)
    assert OWC.replace({}) == OWC != changed
    pressed = OWC.replace({"pto.P_a": 10.0})  # replaces K_dm, which need not be removed first
    assert pressed.pto.K_dm is None and pressed.replace({"pto.K_dm": 534.66}) == OWC
    assert OWC.replace({"waves": None}).waves is None


# Text that TOML can hold: all characters except surrogates.
TEXT = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)


@settings(max_examples=100, deadline=None)
@given(
    description=TEXT,
    K_dm=st.floats(0.0, 1e6),
    H=st.floats(1e-6, 0.1),
    c0=st.none() | st.floats(1e-3, 1e4),
    # the plate is between 7.69 and 7.71 m, and no gauge may be inside it
    gauges=st.lists(st.floats(0.0, 7.84).filter(lambda x: not 7.68 < x < 7.72), max_size=4),
    absorption=st.booleans(),
)
def test_case_survives_its_own_text(description, K_dm, H, c0, gauges, absorption):
    case = OWC.replace(
        {
            "description": description,
            "pto.K_dm": K_dm,
            "waves.H": H,
            "fluid.c0": c0,
            "probes.gauges": gauges,
            "waves.absorption": absorption,
        }
    )
    assert Case.from_dict(tomllib.loads(case.to_toml())) == case


# --- built-ins


def test_built_in_cases_are_those_of_the_command_line():
    assert {"owc", "wave_tank", "vessel", "hydrostatic", "dam_break"} <= set(js.built_in_cases())
    assert all(js.built_in_cases().values())


SPATIAL = ("basin", "buoy_3d", "flap_3d", "hull", "owc_3d", "owc_spar", "sphere_decay")
"""Built-in cases in three dimensions that take ten seconds and more to build."""


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.slow] * (n in SPATIAL)) for n in sorted(js.built_in_cases())]
)
def test_built_in_cases_load_and_check(name):
    assert js.load_case(name).name == name
    case = coarse(name) if name in COARSE else js.load_case(name)
    rows = dict(js.check(case))
    made = [int(word) for word in re.findall(r"\d+", rows["particles"].replace(",", ""))[:2]]
    # counted from the geometry alone, without the volume of bodies, plates and platforms
    assert limits.particle_counts(case, Geometry.of(case)) == pytest.approx(made, rel=0.1)
    assert {"particles", "time step", "neighbours", "wall time"} <= set(rows)
    assert ("incident power" in rows) == (js.load_case(name).waves is not None)


RAISED = {
    "device.platform_length": 1.0,
    "device.platform_height": 0.1,
    "probes.velocity": [[7.2, 0.04]],
}
FLOATING = {"device": None, "pto": None, "body": {"block": {"low": [3.0, 0.3], "high": [3.4, 0.5]}}}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"probes.gauges": [7.7]}, r"probes.gauges\[0\] = 7.7 m is inside the plate"),
        ({"probes.pressure": [[7.7, 0.4]]}, r"probes.pressure\[0\] = .* is inside the plate"),
        ({"probes.velocity": [[7.7, 0.4]]}, r"probes.velocity\[0\] = .* is inside the plate"),
        (FLOATING | {"probes": {"velocity": [[3.2, 0.4]]}}, r"probes.velocity\[0\] = .* inside the body"),
        (RAISED, r"probes.velocity\[0\] = .* inside the platform"),
        ({"sponge.length": 2.0}, "sponge.length = 2 m: the zone .* covers the device"),
        (FLOATING | {"sponge.length": 5.0, "probes": {}}, "sponge.length = 5 m: .* covers the body"),
        (FLOATING | {"waves.zone": 3.2, "probes": {}}, "waves.zone = 3.2 m: .* covers the body"),
    ],
)
def test_probes_in_solids_and_zones_over_devices_are_refused(changes, message):
    with pytest.raises(CaseError, match=message):
        OWC.replace(changes)


def test_probes_on_a_plate_and_under_it_are_taken():
    assert OWC.replace({"probes.pressure": [[7.69, 0.3], [7.71, 0.3], [7.7, 0.1]]})
    assert OWC.replace(FLOATING | {"sponge.length": 4.0, "probes": {"velocity": [[3.2, 0.2]]}})


@pytest.mark.parametrize(
    ("changes", "notice"),
    [
        ({"output": {"sample_dt": 0.2, "snapshot_dt": 0.2}}, "sample_dt = 0.2 s is more than a tenth"),
        ({"probes.gauges": [7.64]}, r"probes.gauges\[0\] = 7.64 m: .* the plate is in this range"),
        (
            FLOATING | {"probes": {"gauges": [3.2]}},
            r"probes.gauges\[0\] = 3.2 m: .* the body is in this range",
        ),
    ],
)
def test_long_samples_and_gauges_beside_solids_have_a_notice(changes, notice):
    assert any(re.search(notice, note) for note in OWC.replace(changes).notices())
    assert not any(re.search("sample_dt|is there", note) for note in OWC.notices())


def test_a_sponge_that_is_shorter_than_the_waves_has_a_notice():
    short = js.load_case("flap_2d")
    assert any(
        "sponge.length = 3.5 m: waves with a period of 2 s are 4.18 m long" in n for n in short.notices()
    )
    for change in ({"tank.length": 13.0, "sponge.length": 4.2}, {"waves.T": 1.7}):
        assert not any("sponge" in note for note in short.replace(change).notices())


@pytest.mark.parametrize("key", sorted(EXPECTED))
def test_a_key_that_users_expect_is_answered_with_what_there_is(key):
    """And every key that the answer names exists."""
    words = EXPECTED[key]
    assert key not in key_names(Case)
    named = [one for one in re.findall(r"`([A-Za-z_.0-9]+)`", words)]
    series = {"force_NAME", "body_force", "body_force_NAME"}
    real = {*key_names(Case), *js.built_in_cases(), "file", *series}
    assert set(named) <= real, set(named) - real
    where = ONLY_IN.get(key, "tank")
    with pytest.raises(js.CaseError, match=re.escape(words)):
        OWC.replace({f"{where}.{key}" if where else key: 1.0})


def test_a_misspelt_key_is_still_answered_with_the_nearest():
    for key, near in (("tank.hight", "tank.height"), ("waves.h", "waves.H"), ("body.pto.dampin", "damping")):
        with pytest.raises(js.CaseError, match=f"did you mean '.*{near}'"):
            js.load_case("flap_2d").replace({key: 1.0})


BUOY = js.load_case("buoy_heave")


@pytest.mark.parametrize(
    ("changes", "notice"),
    [
        # Archimedes: a box 0.2 m high with the density r has the draught 0.2 r / 1000; it is given with 0.1 m
        (
            {"body.density": 800.0},
            r"body floats 0.06 m below its given position, because its mass of 48 kg/m",
        ),
        ({"body.density": 350.0}, r"body floats 0.03 m above its given position"),
        ({"body.density": 0.5}, r"body.density = 0.5 kg/m3 is very small: densities are in kg/m3"),
        (
            {"probes.pressure": [[1.0, 0.44]]},
            r"probes.pressure\[0\] = \[1.0, 0.44\] m is 0.04 m above the still",
        ),
    ],
)
def test_doubtful_positions_and_densities_are_told(changes, notice):
    assert any(re.match(notice, note) for note in BUOY.replace(changes).notices())
    assert not any(re.match(notice, note) for note in BUOY.notices())


@pytest.mark.parametrize(("bottom", "told"), [(0.03, True), (0.06, False), (0.05, True)])
def test_a_narrow_gap_between_a_body_and_the_bed_is_told(bottom, told):
    flap = js.load_case("flap_2d").replace({"body.block": {"low": [6.0, bottom], "high": [6.12, 0.64]}})
    notes = [
        note for note in flap.notices() if note.startswith(f"body leaves a gap of {bottom:g} m to the bed")
    ]
    assert bool(notes) == told
    if told:
        assert f"use dx of at most {bottom / 2.0:.3g} m" in notes[0]


def test_a_body_near_its_equilibrium_or_held_by_a_spring_gets_no_notice():
    near = BUOY.replace({"body.density": 580.0})  # 0.016 m, less than a spacing
    held = BUOY.replace({"body.density": 800.0, "link.take_off.stiffness": 100.0})
    for case in (near, held):
        assert not any("floats" in note for note in case.notices())
