"""Cases: what is refused and in which words, what is snapped, and that a case survives its own text."""

import math
import tomllib

import pytest
from conftest import COARSE, coarse
from hypothesis import given, settings
from hypothesis import strategies as st

import jaxsph as js
from jaxsph.case.case import Case
from jaxsph.case.geometry import Geometry
from jaxsph.errors import CaseError

OWC = js.load_case("owc")


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
        ({"device.thin_wall": "multi_node"}, r"device.wall_thickness = 0.02 m .*need 3.*or regional ghosts"),
        # dx that does not fit
        ({"dx": 0.3}, r"tank.depth = 0.42 m does not fit dx = 0.3 m: .* use dx of at most 0.105 m"),
        ({"dx": 0.05}, r"device.chamber_length = 0.13 m holds 2.6 spacings of dx = 0.05 m; three are"),
        # lengths
        ({"dx": 0.0}, r"dx = 0.0: .*greater than 0"),
        ({"tank.length": -1.0}, r"tank.length = -1.0: .*greater than 0"),
        ({"tank.depth": 0.0}, r"tank.depth = 0.0: .*greater than 0"),
        ({"device.draught": -0.1}, r"device.draught = -0.1: .*greater than 0"),
        ({"device.draught": 0.42}, r"device.draught = 0.42 m: .* at most 0.38 m"),
        ({"device.platform_height": 0.1}, r"both device.platform_length and device.platform_height, or"),
        (
            {"device.platform_height": 0.24, "device.platform_length": 0.5},
            r"device.platform_height = 0.24 m: must leave at least two spacings .* at most 0.22 m",
        ),
        (
            {"device.platform_height": 0.1, "device.platform_length": 7.8},
            r"device.platform_length = 7.8 m: must leave water in front of it, so at most 7.76 m",
        ),
        ({"tank.height": 0.3}, r"tank.height = 0.3 m: must be above the water, tank.depth = 0.42 m"),
        ({"sponge.length": 20.0}, r"sponge.length = 20 m: must be shorter than the tank"),
        ({"dx": math.nan}, r"dx = nan: .*finite"),
        # probes outside
        ({"probes.gauges": [1.0, 9.0]}, r"probes.gauges\[1\] = 9 m is outside the tank \(0 to 7.84 m\)"),
        ({"probes.pressure": [[1.0, 5.0]]}, r"probes.pressure\[0\] = \[1.0, 5.0\] is not a point"),
        ({"probes.pressure": [[1.0, 0.1, 0.1]]}, r"probes.pressure\[0\] .*2 coordinates"),
        # the PTO
        ({"pto": {"K_dm": 1.0, "P_a": 2.0}}, "exactly one of pto.K_dm .* and pto.P_a"),
        ({"pto": {"ramp": 0.0}}, "exactly one of pto.K_dm .* and pto.P_a"),
        ({"pto.K_dm": math.inf}, r"pto.K_dm = inf: .*finite"),
        ({"pto.K_dm": -1.0}, r"pto.K_dm = -1.0: .*greater than or equal to 0"),
        ({"device": None}, "pto is given, but there is no device"),
        # what excludes each other
        ({"start.amplitude": 0.01}, "start and waves exclude each other"),
        ({"tank.width": 0.5}, "tank.width: a device needs a two-dimensional tank"),
        ({"scheme.kernel": "cubic"}, r"scheme.kernel = 'cubic': .*'gaussian' or 'wendland'"),
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
    with pytest.raises(CaseError, match="tank: Field required"):
        Case.from_dict({"dx": 0.1, "t1": 1.0})


def test_float64_has_to_be_switched_on():
    case = coarse("hydrostatic", {"precision": "float64"})  # valid: only the program is not ready
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
    with pytest.raises(CaseError, match=r"mine.toml: not a TOML file: .*line 2"):
        js.load_case(path)
    path.write_text("dx = 0.1\nt1 = 1.0\n[tank]\nlength = 1.0\ndepth = 0.5\n")
    assert js.load_case(path).name == "mine"


@pytest.mark.parametrize(
    ("changes", "notice"),
    [
        ({"waves.H": 0.3}, r"Miche's limit .* the wave breaks"),
        ({"waves.T": 30.0}, r"shallow water"),
        ({"waves.T": 0.5}, r"deep water"),
        ({"waves.H": 0.02}, r"waves.H = 0.02 m is only 1.0 spacings high"),
    ],
)
def test_theory_s_limits_are_told_not_refused(changes, notice):
    import re

    assert any(re.search(notice, note) for note in OWC.replace(changes).notices())
    assert not any(re.search(notice, note) for note in OWC.notices())


# --- lattice


def test_snapping_says_what_became_of_each_length():
    notes = OWC.replace({"device.draught": 0.15}).notices()
    assert any("device.draught = 0.15 m" in note and "becomes 0.16 m" in note for note in notes)
    # Every length of the default geometry fits: beside the plate nothing is snapped.
    assert not [note for note in OWC.notices() if "becomes" in note]
    assert Geometry.of(OWC).chamber_length == 0.13


@settings(max_examples=100, deadline=None)
@given(dx=st.floats(0.01, 0.03), length=st.floats(2.0, 9.0), depth=st.floats(0.4, 0.8))
def test_walls_stand_between_particles(dx, length, depth):
    """Every length but those beside the plate is a whole number of spacings."""
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


INCOMPRESSIBLE = {"scheme.kind": "incompressible"}


def test_the_scheme_s_kind_decides_its_keys():
    for name, changes in (("owc", INCOMPRESSIBLE), ("flap_2d", {"scheme.kind": "weakly_compressible"})):
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
        ("owc", {"scheme.speed": 2.0}, r'scheme.speed belongs to scheme.kind = "incompressible"'),
        ("owc", {"scheme.kind": "sph"}, r"scheme.kind = 'sph': must be \"weakly_compressible\" or"),
        ("owc", {"scheme": "incompressible"}, r"scheme = 'incompressible': must be a section"),
        ("flap_2d", {"scheme.sped": 2.0}, r"unknown key 'scheme.sped'; did you mean 'scheme.speed'"),
        ("owc", {"isph.cfl": 0.1}, r'\[scheme\]\nkind = "incompressible"\ncfl = 0.1$'),
        ("owc", {"isph": None}, r'Write .*\n\[scheme\]\nkind = "incompressible"$'),
        ("owc", {"tank.widht": None}, r"unknown key 'tank.widht'; did you mean 'tank.width'"),
    ],
)
def test_keys_of_the_other_kind_are_refused_with_what_to_write(case, changes, message):
    with pytest.raises(CaseError, match=message):
        js.load_case(case).replace(changes)


def test_lattice_checks_use_the_kernel_s_own_reach():
    """The Gaussian reaches 3.6 spacings and Wendland's kernel 4: 4 layers, or 3 where h is smaller."""
    assert OWC.layers == OWC.replace(INCOMPRESSIBLE).layers == 4
    narrow = OWC.replace(INCOMPRESSIBLE | {"scheme.h_over_dx": 1.5, "device.thin_wall": "regional"})
    assert narrow.layers == 3 and narrow.pto.K_dm == 534.66
    two = {"device.thin_wall": "multi_node", "device.wall_thickness": 0.04}
    assert narrow.replace(two).device.thin_wall == "multi_node"  # which needs a layer less than the kernel
    with pytest.raises(CaseError, match="multi-node ghosts need 3"):
        OWC.replace(two)


# --- replace and text


def test_replace_gives_a_changed_copy():
    changed = OWC.replace({"pto.K_dm": 300.0, "dx": 0.01})
    assert (changed.pto.K_dm, changed.dx) == (300.0, 0.01) and (OWC.pto.K_dm, OWC.dx) == (534.66, 0.02)
    assert OWC.replace({}) == OWC != changed
    pressed = OWC.replace({"pto.P_a": 10.0})  # the other law, without having to remove the first
    assert pressed.pto.K_dm is None and pressed.replace({"pto.K_dm": 534.66}) == OWC
    assert OWC.replace({"waves": None}).waves is None


# What TOML and its reader hold of text: no surrogates, which are no characters.
TEXT = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)


@settings(max_examples=100, deadline=None)
@given(
    description=TEXT,
    K_dm=st.floats(0.0, 1e6),
    H=st.floats(1e-6, 0.1),
    c0=st.none() | st.floats(1e-3, 1e16),
    gauges=st.lists(st.floats(0.0, 7.84), max_size=4),
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


@pytest.mark.parametrize("name", sorted(js.built_in_cases()))
def test_built_in_cases_load_and_check(name):
    assert js.load_case(name).name == name
    rows = dict(js.check(coarse(name) if name in COARSE else js.load_case(name)))
    assert {"particles", "time step", "neighbours", "wall time"} <= set(rows)
    assert ("incident power" in rows) == (js.load_case(name).waves is not None)
