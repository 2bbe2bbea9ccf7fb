"""Linear theory of bodies: limits, closed forms, energy, the OWC's theory, and cases that it refuses."""

import functools
import tomllib
from types import SimpleNamespace

import jax
import numpy as np
import pytest

import jaxsph as js
from jaxsph.case.geometry import Geometry
from jaxsph.case.linear_bodies import has_free_bodies, linear_motions, why_no_motions
from jaxsph.case.resting import Resting
from jaxsph.case.results import _linear
from jaxsph.problem.results import oscillation_result
from jaxsph.report.content import _extremes, _theory
from jaxsph.waves.linear_bodies import Compliance, Damping, SmallMotion, linear_motion
from jaxsph.waves.linear_owc import LinearAir, linear_response
from jaxsph.waves.panels import Chamber, Hull, Section, hydrodynamics
from jaxsph.waves.radiation import ChamberGeometry, radiation_and_scattering

G, RHO = 9.81, 1000.0
load = functools.cache(js.load_case)


def _taken(found):
    """Share of the incident power that is neither reflected nor transmitted, and that links and chambers
    take."""
    left = 1.0 - abs(found.R) ** 2 - abs(found.transmitted) ** 2
    return left, (found.link_power.sum() + found.chamber_power.sum()) / found.P_inc


def _block(name, x0, x1, z0, z1=0.3, pivot=(0.0, 0.0)):
    return Hull(name, ((x0, z0), (x1, z0), (x1, z1), (x0, z1)), pivot)


def test_chamber_at_an_end_wall_is_that_of_the_owc():
    omega, b, a = 4.0, 0.5, 0.3
    section = Section(1.0, (_block("wall", -0.7, -b, -a),), 0.0, (Chamber("air", -b, 0.0),))
    still = SmallMotion(*(np.zeros((0, 0)),) * 3, np.zeros((3, 0)), (), (Compliance(50.0, 300.0, 1e-5),))
    found = linear_motion(hydrodynamics(section, omega), still, 0.08)
    water = radiation_and_scattering(ChamberGeometry(1.0, b, a, 0.2), omega)
    exact = linear_response(water, 0.08, 300.0, air=LinearAir(50.0, 1e-5))
    # both methods have an error of about 1e-6
    for name in ("q", "q_pto", "P_a", "R"):
        assert np.ravel(getattr(found, name))[0] == pytest.approx(complex(getattr(exact, name)), rel=1e-5)
    assert found.chamber_power[0] == pytest.approx(float(exact.P_owc), rel=1e-5)
    assert found.P_inc == pytest.approx(float(exact.P_inc), rel=1e-12)


def test_floating_chamber_and_links_take_what_the_waves_lose():
    # a barge with a chamber between its two walls, on springs; a damper of each kind
    outline = (
        *((0.0, -0.3), (0.1, -0.3), (0.1, 0.2), (0.5, 0.2), (0.5, -0.15)),
        *((0.6, -0.15), (0.6, 0.3), (0.0, 0.3)),
    )
    section = Section(1.0, (Hull("barge", outline, (0.3, 0.0)),), None, (Chamber("air", 0.1, 0.5, "barge"),))
    dampings = (
        Damping(np.array([1.0, 0.0, 0.2]), lambda v: -30.0 * v),
        Damping(np.array([0.0, 1.0, 0.0]), lambda v: -400.0 * abs(v) * v),
        Damping(np.array([0.0, 0.0, 1.0]), lambda v: -0.5 * np.tanh(v / 1e-3)),
    )
    K = np.diag([300.0, RHO * G * 0.2, 60.0])
    bodies = SmallMotion(
        np.diag([45.0, 45.0, 3.0]),
        K,
        np.zeros((3, 3)),
        np.eye(3),
        dampings,
        (Compliance(K_dm=80.0, give=2e-6),),
    )
    for omega in (3.0, 4.5, 6.0):
        found = linear_motion(hydrodynamics(section, omega), bodies, 0.06)
        left, taken = _taken(found)
        # the error of the panels is about 1e-6, that of the iteration 1e-8
        assert left == pytest.approx(taken, abs=5e-6) and min(*found.link_power, *found.chamber_power) > 0.0


FLOATING_OWC = """
dx = 0.02
t1 = 14.0
tank = { length = 9.0, depth = 0.6 }
waves = { H = 0.04, T = 1.2 }
sponge = { length = 3.5 }
scheme = { kind = "incompressible" }

[body]
polygon = [[3.0, 0.4], [3.1, 0.4], [3.1, 0.76], [3.4, 0.76], [3.4, 0.5], [3.5, 0.5], [3.5, 0.8], [3.0, 0.8]]
mass = 30.0
inertia = 1.6
centre = [3.2, 0.55]
free = ["heave"]

[chamber.air]
body = "body"
pto = { K_dm = 150.0 }
"""


def test_floating_owc_of_a_case():
    case = js.Case.from_dict(tomllib.loads(FLOATING_OWC))
    open_to, closed = (linear_motions(case.replace({"chamber.air.pto.K_dm": K})) for K in (0.0, 1e6))
    found = linear_motions(case)
    left, taken = _taken(found.response)
    assert left == pytest.approx(taken, abs=5e-6) and found.xi == pytest.approx(taken) and taken > 0.02
    # the air of a closed chamber holds the water to the body: its level does not move in the body's frame
    assert closed.results["amplitude_flow_air"] < 1e-3 * open_to.results["amplitude_flow_air"]
    assert open_to.xi == 0.0 and open_to.results["amplitude_P_a_air"] == 0.0
    assert found.levels["power_pto_air"] == [found.P_pto]
    assert found.results["amplitude_chamber_level_air"] == pytest.approx(
        found.results["amplitude_flow_air"] / (found.response.water.omega * 0.3)
    )


def test_results_and_page_show_the_theory():
    case = load("buoy_heave")
    found = linear_motions(case)
    record = SimpleNamespace(results={"P_inc": 2.0, "xi": 0.3, "P_pto": 0.6})
    shown = _linear(case, record)
    assert shown["linear_xi"] == found.xi and shown["linear_P_pto"] == found.P_pto
    assert shown["linear_amplitude_heave"] == found.results["amplitude_heave"]
    assert _linear(case, SimpleNamespace(results={})) == {}  # no whole period has settled
    assert _extremes(case, {}, {}) == found.levels
    steep = case.replace({"waves.kind": "irregular", "waves.Hs": 0.03, "waves.Tp": 1.2})
    assert _extremes(steep, {}, {}) == {} and _linear(steep, record) == {}
    why = 'not drawn: waves.kind = "irregular": linear theory of bodies covers regular waves only'
    assert _theory(case) == [] and _theory(steep)[0][1] == why


def test_equivalent_damping_of_known_laws():
    quadratic = Damping(np.ones(1), lambda v: -7.0 * abs(v) * v)
    friction = Damping(np.ones(1), lambda v: -7.0 * np.tanh(v / 1e-5))
    assert quadratic.linearised(0.3) == pytest.approx(7.0 * 0.3 * 8.0 / (3.0 * np.pi), rel=1e-4)
    assert friction.linearised(0.3) == pytest.approx(4.0 * 7.0 / (np.pi * 0.3), rel=1e-3)


def test_best_damping_of_a_heaving_body():
    """A damper takes at most |X|^2 A^2 / (4 (B + |Z|)), Z = B + i ((M + A) omega - K / omega)."""
    water = hydrodynamics(Section(1.0, (_block("buoy", 0.0, 0.4, -0.2),)), 4.0)
    M, K, a = 80.0, RHO * G * 0.4, 0.02
    A, B, X = water.added_mass[1, 1], water.damping[1, 1], water.excitation[1]
    Z = B + 1j * ((M + A) * water.omega - K / water.omega)
    heave = np.eye(3)[:, 1:2]

    def power(c):
        body = SmallMotion(
            *(np.array([[v]]) for v in (M, K, 0.0)), heave, (Damping(np.ones(1), lambda v: -c * v),)
        )
        return linear_motion(water, body, 2.0 * a).link_power[0]

    best = power(abs(Z))
    assert best == pytest.approx(abs(X * a) ** 2 / (4.0 * (B + abs(Z))), rel=1e-9)
    assert power(0.7 * abs(Z)) < best and power(1.4 * abs(Z)) < best


def test_stiffness_of_a_moored_box():
    """Buoyancy and weight by formula; a spring of stiffness k that is not extended gives k n n^T."""
    case = load("box_moored")
    with jax.enable_x64(True):
        found = Resting(case, Geometry.of(case))
    water = np.diag([0.0, RHO * G * 0.3, RHO * G * (0.3**3 / 12.0 - 0.03 * 0.05)])
    expected = water.copy()
    for at, end in (((-0.15, -0.05), (-0.75, -0.4)), ((0.15, -0.05), (0.75, -0.4))):
        way = np.subtract(at, end) / np.hypot(0.6, 0.35)
        arm = np.array([way[0], way[1], at[1] * way[0] - at[0] * way[1]])
        expected += 60.0 * np.outer(arm, arm)
    assert found.q == pytest.approx(np.zeros(3), abs=1e-9)
    assert found.stiffness == pytest.approx(expected, rel=1e-6, abs=1e-6)


def test_box_follows_long_waves():
    case = load("box_in_waves").replace({"waves.T": 7.0, "waves.H": 0.01})
    found = linear_motions(case)
    k, a = found.response.water.k, 0.005
    surge, heave, pitch = found.motions["body"]
    # the box is 0.11 k long, and the phase of the water at its middle is that of the wave at x = 3.15 m
    wave = a * np.exp(1j * k * 3.15)
    assert heave == pytest.approx(wave, rel=0.02)
    assert surge == pytest.approx(1j * wave / np.tanh(0.4 * k), rel=0.02)
    assert pitch == pytest.approx(-1j * k * wave, rel=0.06)  # a surface that rises towards +x turns it back


def test_box_of_the_case():
    # another code, with constant panels on the whole boundary and 6 m of free surface, gives these to 0.5 %
    found = np.abs(linear_motions(load("box_in_waves")).motions["body"])
    assert found == pytest.approx([0.0183, 0.0249, 0.0287], rel=5e-3)
    found = np.abs(linear_motions(load("box_moored")).motions["body"])
    assert found == pytest.approx([0.0196, 0.0244, 0.055], rel=5e-3)


@pytest.mark.parametrize("name", ["box_moored", "buoy_heave", "raft", "flap_2d"])
def test_cases_keep_their_energy(name):
    found = linear_motions(load(name)).response
    left, taken = _taken(found)
    assert left == pytest.approx(taken, abs=5e-6)


def test_raft_without_a_hinge_is_one_body():
    raft = load("raft").to_toml()
    locked = linear_motions(load("raft").replace({"bodies.aft.pto.damping": 1e9}))
    rigid = load("raft").given()
    del rigid["bodies"]["aft"]["pto"]
    rigid["bodies"]["aft"]["free"] = []
    found = linear_motions(js.Case.from_dict(rigid))
    assert load("raft").to_toml() == raft
    assert locked.motions["fore"] == pytest.approx(found.motions["fore"], rel=1e-5)
    assert abs(locked.relative["aft"][2]) < 1e-7


def test_body_finds_its_draught_before_it_moves():
    given, asked = load("box_in_waves"), {"body.mass": 33.0, "body.angle": 0.05}
    rest = linear_motions(given.replace(asked)).rest["body"]
    # 33 kg/m sink the box by 1 cm; the waves turn it about the upright position
    assert rest == pytest.approx([0.0, -0.01, 0.0], abs=1e-7)


def test_catenaries_pull_a_box_down_and_hold_it():
    data = load("box_moored").given()
    del data["link"]
    free = linear_motions(js.Case.from_dict(data))
    line = {"body": "body", "length": 1.85, "weight": 1.09, "axial_stiffness": 2000.0}
    data["mooring"] = {
        "seaward": line | {"at": (3.0, 0.34), "anchor": (1.2, 0.0)},
        "landward": line | {"at": (3.3, 0.34), "anchor": (5.1, 0.0)},
    }
    found = linear_motions(js.Case.from_dict(data))
    # each line weighs 2.0 N/m, of which the box carries at least what hangs, and the water 2943 N/m per m
    surge, heave, pitch = found.rest["body"]
    assert -2.0 * 2.0 / (RHO * G * 0.3) < heave < 0.0 and abs(surge) < 1e-9 and abs(pitch) < 1e-9
    left, taken = _taken(found.response)
    assert left == pytest.approx(0.0, abs=5e-6) and taken == 0.0  # catenaries take no energy
    assert abs(found.motions["body"][0] - free.motions["body"][0]) > 1e-3


def test_check_and_results_name_the_same_things():
    case = load("buoy_heave")
    rows = dict(js.linear_check(case))
    found = linear_motions(case)
    assert rows["linear heave"].startswith(f"{abs(found.motions['body'][1]):.3g} m")
    assert rows["linear efficiency"] == f"{found.xi:.3g}"
    problem = case.problem()
    known = set(oscillation_result(problem.model, problem.averaging).labels) | {"xi", "P_pto", "P_owc"}
    assert set(found.results) <= known
    assert found.results["rao_heave"] == pytest.approx(found.results["amplitude_heave"] / 0.02)
    assert found.levels["heave"] == pytest.approx(
        [-found.results["amplitude_heave"], found.results["amplitude_heave"]]
    )
    assert found.levels["power_take_off"] == [found.P_pto]


@pytest.mark.parametrize(
    ("name", "changes", "words"),
    [
        ("flap_3d", {}, "three dimensions"),
        ("box_in_waves", {"body.mass": 70.0}, "not in equilibrium"),
        ("box_in_waves", {"body.mass": 55.0, "body.centre": (3.15, 0.49)}, "no stable equilibrium"),
        (
            "buoy_heave",
            {"link.take_off.stops": (-0.01, 0.01), "link.take_off.stop_stiffness": 1e4},
            "end stops",
        ),
        ("buoy_heave", {"link.take_off.latch": 0.2, "link.take_off.latch_damping": 1e4}, "history"),
        ("buoy_heave", {"body.velocity": (0.1, 0.0, 0.0)}, "prescribes the motion in surge"),
        (
            "box_in_waves",
            {"waves.kind": "irregular", "waves.Hs": 0.03, "waves.Tp": 1.2},
            'waves.kind = "irregular"',
        ),
        (
            "box_in_waves",
            {"solid.beach.polygon": ((6.0, 0.0), (9.0, 0.0), (9.0, 0.6))},
            "solid.beach slopes at the water surface",
        ),
    ],
)
def test_refusals(name, changes, words):
    case = load(name).replace(changes)
    assert has_free_bodies(case) and words in why_no_motions(case)
    assert js.linear_check(case) == [("linear theory", f"none: {why_no_motions(case)}")]


def test_cases_without_free_bodies_have_no_theory_of_bodies():
    assert not has_free_bodies(load("owc"))
    with pytest.raises(js.CaseError, match="a body with a free motion"):
        linear_motions(load("owc"))
    with pytest.raises(ValueError, match="jacobian has 1 rows"):
        water = hydrodynamics(Section(1.0, (_block("buoy", 0.0, 0.4, -0.2),)), 4.0)
        linear_motion(water, SmallMotion(*(np.eye(1),) * 4), 0.1)
