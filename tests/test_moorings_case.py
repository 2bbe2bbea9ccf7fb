"""Cases with moorings: what is refused, files of MoorDyn, and runs."""

import numpy as np
import pytest
from conftest import enable_x64, exact_and_difference

import jaxsph as js
from jaxsph.case.case import Case
from jaxsph.errors import CaseError

TANK = {"dx": 0.05, "t1": 1.0, "tank": {"length": 4.0, "depth": 0.5}, "scheme": {"kind": "incompressible"}}
BODY = {
    "block": {"low": [1.8, 0.4], "high": [2.2, 0.6]},
    "density": 500.0,
    "free": ["surge", "heave", "pitch"],
}
CHAIN = {"at": [1.8, 0.45], "anchor": [0.4, 0.0], "length": 1.52, "weight": 2.0, "axial_stiffness": 1e3}
LINE = {key: value for key, value in CHAIN.items() if key != "weight"} | {
    "kind": "line",
    "mass": 0.24,
    "diameter": 0.005,
    "drag": [1.2, 0.1],
    "segments": 10,
}


def moored(mooring, **sections):
    return TANK | {"body": BODY, "mooring": {"a": mooring}} | sections


@pytest.mark.parametrize(
    ("mooring", "message"),
    [
        (CHAIN | {"body": "buoy"}, "mooring.a.body: there is no body 'buoy'; choose from body"),
        (CHAIN | {"mass": 0.2}, "give either weight, or mass and diameter"),
        (
            CHAIN | {"segments": 10},
            'segments has no effect with kind = "catenary"; set kind = "line", or remove segments',
        ),
        (CHAIN | {"kind": "line"}, 'kind = "line" needs mass, diameter and drag'),
        (CHAIN | {"anchor": [-0.4, 0.0]}, r"mooring.a.anchor: \(-0.4, 0\) m is outside the tank"),
        (CHAIN | {"at": [1.8, 3.0]}, "mooring.a.at: .* is outside the tank"),
        (CHAIN | {"anchor": [2.0, 0.5]}, "mooring.a.anchor .* is inside body"),
        (CHAIN | {"anchor": [3.0, 0.1]}, "mooring.a.anchor .* is inside solid.step"),
        (CHAIN | {"length": 1.3}, "mooring.a.length = 1.3 m: the distance .* is 1.471 m"),
        (CHAIN | {"anchor": [0.4, 0.2], "length": 2.0}, "would sag .* below the bed: use an anchor on"),
        (
            CHAIN | {"at": [1.8, 0.55], "anchor": [3.9, 0.5], "length": 2.11},
            "at rest passes through body, up to .* m below its surface",
        ),
        (
            CHAIN | {"at": [2.2, 0.45], "anchor": [3.9, 0.0], "length": 1.8},
            "at rest passes through solid.step, up to .* m",
        ),
        (LINE | {"mass": 0.01}, "mooring.a weighs .* but must sink"),
        (LINE | {"axial_stiffness": 1e12}, "mooring.a.axial_stiffness = 1e.12 N: the line would take"),
        (CHAIN | {"weight": -1.0}, "mooring.a.weight = -1"),
        ({"at": [1.8, 0.45], "weight": 1.0}, "mooring.a.anchor"),
    ],
)
def test_moorings_that_do_not_fit_are_refused(mooring, message):
    step = {"step": {"block": {"low": [2.8, 0.0], "high": [3.2, 0.3]}}}
    with pytest.raises(CaseError, match=message):
        Case.from_dict(moored(mooring, solid=step))


@pytest.mark.parametrize(
    ("angle", "mooring", "message"),
    [
        (1.5, {"anchor": [2.0, 0.32], "length": 0.3}, "mooring.a.anchor .* is inside body"),
        (1.5, {}, "mooring.a.length = 1.52 m: the distance .* is 1.686 m"),
        (
            1.5,
            {"at": [2.0, 0.4], "anchor": [3.4, 0.0], "length": 1.6},
            "at rest passes through body, up to .* m below its surface",
        ),
        (1.5, {"at": [3.8, 0.45], "anchor": [2.8, 0.0]}, "mooring.a.at: .* is outside the tank"),
    ],
)
def test_moorings_are_judged_at_the_body_s_initial_angle(angle, mooring, message):
    """All fit to the upright body."""
    Case.from_dict(moored(CHAIN | mooring))
    with pytest.raises(CaseError, match=message):
        Case.from_dict(moored(CHAIN | mooring, body=BODY | {"angle": angle}))


def test_a_name_of_a_mooring_and_a_link_at_once_is_refused():
    link = {"a": {"body": "body", "motion": "heave", "damping": 1.0}}
    with pytest.raises(CaseError, match="have the same name"):
        Case.from_dict(moored(CHAIN, link=link))


def test_a_rope_of_a_case_goes_slack():
    rope = {"between": ["body", "tank"], "at": [[1.8, 0.4], [1.0, 0.0]], "stiffness": 50.0, "slack": True}
    model = Case.from_dict(TANK | {"body": BODY, "link": {"a": rope}}).problem().model
    (law,) = model.links[0].law.laws
    assert isinstance(law, js.Rope)
    with pytest.raises(CaseError, match="slack needs between, at and stiffness"):
        Case.from_dict(TANK | {"body": BODY, "link": {"a": rope | {"friction": 1.0}}})


MOORDYN = """--- MoorDyn input ---
--------------------- LINE TYPES --------------------------
TypeName  Diam   Mass/m  EA    BA/-zeta  EI   Cd   Ca   CdAx  CaAx
(name)    (m)    (kg/m)  (N)   (N-s/-)   (N-m^2) (-) (-) (-)  (-)
chain     0.005  0.24    1e3   -0.4      0    2.4  1.0  1.15  0.5
--------------------- POINTS ------------------------------
ID  Type    X     Y  Z      Mass Volume CdA Ca
(#) (-)     (m)   (m) (m)   (kg) (m^3) (m^2) (-)
1   Fixed   -1.6  0  -0.5   0    0      0   0
2   Coupled -0.2  0  -0.05  0    0      0   0
3   Coupled 0.2   0  -0.05  0    0      0   0
4   Anchor  1.6   0  -0.5   0    0      0   0
--------------------- LINES -------------------------------
ID  LineType AttachA AttachB UnstrLen NumSegs Outputs
(#) (name)   (#)     (#)     (m)      (-)     (-)
1   chain    1       2       1.52     12      p
2   chain    3       4       1.52     12      -
--------------------- OPTIONS -----------------------------
0.001  dtM    time step
2e5    kBot   stiffness of the bed
0.5    WtrDpth
--------------------- need this line ----------------------
"""


def written(tmp_path, text, keys="at = [2.0, 0.5]\n"):
    """A case file that names a MoorDyn file with this text."""
    (tmp_path / "lines.txt").write_text(text, encoding="utf-8")
    case = Case.from_dict(TANK | {"body": BODY}).to_toml()
    (tmp_path / "case.toml").write_text(f'{case}\n[mooring]\nfile = "lines.txt"\n{keys}', encoding="utf-8")
    return tmp_path / "case.toml"


def test_a_moordyn_file_gives_its_lines(tmp_path):
    case = js.load_case(written(tmp_path, MOORDYN))
    assert set(case.mooring) == {"line1", "line2"}
    one, two = case.mooring["line1"], case.mooring["line2"]
    np.testing.assert_allclose([one.at, one.anchor], [[1.8, 0.45], [0.4, 0.0]], atol=1e-12)
    np.testing.assert_allclose([two.at, two.anchor], [[2.2, 0.45], [3.6, 0.0]], atol=1e-12)
    assert (one.length, one.segments, one.mass, one.diameter) == (1.52, 12, 0.24, 0.005)
    assert (one.damping, one.drag, one.added_mass) == (0.4, (2.4, 1.15), (1.0, 0.5))
    assert (one.bed_stiffness, one.bed_damping) == (2e5, 3e5)
    # a positive value is the damping of the line, N s
    size = 1.52 / 12
    damped = js.load_case(written(tmp_path, MOORDYN.replace("-0.4 ", "0.3 "))).mooring["line1"]
    assert damped.damping == pytest.approx(0.3 / (size * np.sqrt(1e3 * 0.24)))
    static = js.load_case(written(tmp_path, MOORDYN, 'at = [2.0, 0.5]\nkind = "catenary"\nlines = 2.0\n'))
    assert static.mooring["line2"].kind == "catenary" and static.mooring["line2"].lines == 2.0
    # without a place the origin is at x = 0, at the file's level of still water
    with pytest.raises(CaseError, match=r"mooring.line1.at: \(-0.2, 0.45\) m is outside the tank"):
        js.load_case(written(tmp_path, MOORDYN, ""))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("1   Fixed   -1.6  0 ", "1   Fixed   -1.6  0.5 ", "lines.txt, line 9: the point is not in the x-z"),
        ("2   Coupled", "2   Free", "line 16: the line must join a Fixed point and a Coupled point"),
        ("2   Coupled", "2   Body1", "points on bodies and rods, are not available"),
        ("-0.4      0 ", "-0.4      5 ", r"line 5: bending stiffness \(EI\) is not available"),
        ("1e3 ", "file.txt ", "line 5: expected one number"),
        ("1   chain ", "1   rope ", "line 16: the line's type is not among LINE TYPES"),
        ("4   Anchor  1.6   0  -0.5", "4   Anchor", "line 12: has 6 columns, expected at least 9"),
        (
            "--------------------- LINES",
            "------ BODIES ----\na\nb\n1 Coupled 0 0\n--- LINES",
            "bodies are not",
        ),
        (
            MOORDYN[MOORDYN.index("1   chain") : MOORDYN.index("--------------------- OPTIONS")],
            "",
            r"has no lines \(table LINES\)",
        ),
    ],
)
def test_what_a_moordyn_file_has_too_much_is_refused(tmp_path, old, new, message):
    assert old in MOORDYN
    with pytest.raises(CaseError, match=message) as error:
        js.load_case(written(tmp_path, MOORDYN.replace(old, new)))
    assert "Fixed   -1.6" not in str(error.value)  # messages do not show the file


@pytest.mark.slow
def test_moorings_are_recorded_and_resumed_to_the_bit(tmp_path):
    """A catenary and a line that are alike begin with the same tensions, within 3 % for ten segments."""
    stern = CHAIN | {
        "at": [2.2, 0.45],
        "anchor": [3.6, 0.0],
        "weight": (0.24 - 1000.0 * np.pi * 0.0025**2) * 9.81,
    }
    case = Case.from_dict(
        TANK | {"body": BODY, "mooring": {"bow": LINE, "stern": stern}, "output": {"sample_dt": 0.02}}
    )
    whole = js.run(case, t1=0.12, progress=False)
    cut = tmp_path / "cut.h5"
    js.run(case, t1=0.06, out=cut, progress=False)
    resumed = js.resume(cut, t1=0.12, progress=False)
    for name in ("fairlead_tension", "anchor_tension", "fairlead_angle"):
        for mooring in ("bow", "stern"):
            np.testing.assert_array_equal(resumed[f"{name}_{mooring}"], whole[f"{name}_{mooring}"])
        assert whole[f"{name}_bow"][0] == pytest.approx(whole[f"{name}_stern"][0], rel=0.03)
    assert whole.units["fairlead_tension_bow"].units == "N m-1"
    assert "power_bow" in whole.units and "power_stern" not in whole.units


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mooring", "key"),
    [(CHAIN, "length"), (CHAIN, "axial_stiffness"), (CHAIN, "weight"), (LINE, "length"), (LINE, "mass")],
    ids=lambda one: one if isinstance(one, str) else one.get("kind", "catenary"),
)
def test_exact_slopes_over_a_mooring_are_those_of_differences(mooring, key):
    """Slope of the energy that a damper takes from a heaving body whose mooring is taut."""
    with enable_x64():
        case = Case.from_dict(
            moored(
                mooring | {"length": 1.465},
                precision="float64",
                scheme={"kind": "incompressible", "tolerance": 1e-11},  # differences need a finer solution
                t1=0.2,
                body=BODY | {"free": ["heave"], "velocity": [0.0, -0.3, 0.0]},
                link={"take": {"body": "body", "motion": "heave", "damping": 100.0, "take_off": True}},
                output={"sample_dt": 0.02},
            )
        )
        slope, apart = exact_and_difference(case, f"mooring.a.{key}")
    assert slope == pytest.approx(apart, rel=1e-4)
