"""Linear theory of the OWC, compared with an independent table, with identities and with known limits."""

import csv
import itertools
import warnings
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import coarse
from hypothesis import given, settings
from hypothesis import strategies as st

import jaxsph as js
from jaxsph.case.geometry import Geometry
from jaxsph.case.linear import incident_power, linear_owc
from jaxsph.case.results import _power, mean_of_power
from jaxsph.case.settling import settled_window
from jaxsph.model.meaning import Entry, Exchange
from jaxsph.model.solution import Solution
from jaxsph.problem.record import Record
from jaxsph.waves import theory
from jaxsph.waves.linear_owc import linear_response
from jaxsph.waves.radiation import _FUNCTIONS, ChamberGeometry, _solve, radiation_and_scattering

G = 9.81
OWC = js.load_case("owc")


def _solved(h, b, a, t, Kh):
    return radiation_and_scattering(ChamberGeometry(h, b, a, t), float(np.sqrt(Kh * G / h)), G)


def _table():
    path = Path(__file__).parent / "data" / "owc_thin_wall_b_over_h_1.csv"
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    return {key: np.array([row[key] for row in rows], float) for key in rows[0]}


@pytest.fixture(scope="module")
def water():
    """The built-in case's chamber in its waves."""
    return linear_owc(OWC).water


# --- the water


def _open_level(water):
    """Ratio of the mean elevation's amplitude in an open chamber to the incident amplitude (-)."""
    return abs(water.q_S) / (water.omega * water.geometry.length)


def test_table_of_thin_walls():
    table = _table()
    given_ = zip(table["b_over_h"], table["a_over_h"], table["Kh"], strict=True)
    found = [_solved(1.0, b, a, 0.0, Kh) for b, a, Kh in given_]
    columns = {
        "mu": [w.mu for w in found],
        "nu": [w.nu for w in found],
        "eta_max": [w.eta_max for w in found],
        "open_chamber_column_amp_over_A": [_open_level(w) for w in found],
    }
    for name, values in columns.items():
        # The table has six digits: half of the sixth is up to 5e-6 of the value.
        np.testing.assert_allclose(values, table[name], rtol=5.1e-6)


@pytest.mark.parametrize(
    ("a", "b", "Kh", "mu", "nu", "eta_max"),
    [
        (0.5, 1.0, 0.7, None, None, 0.9997),
        (0.5, 1.0, 1.5, None, None, 0.5399),
        (0.25, 0.5, 0.5, 1.15051, 0.497378, 0.568174),
        (0.25, 0.5, 1.0, 1.26548, 1.08502, 0.788543),
        (0.25, 0.5, 1.5, 0.858928, 2.13152, 0.962400),
        (0.25, 0.5, 2.0, -0.915012, 2.26488, 0.962221),
        (0.25, 0.5, 3.0, -1.04308, 0.340056, 0.473231),
    ],
)
def test_other_thin_walls(a, b, Kh, mu, nu, eta_max):
    w = _solved(1.0, b, a, 0.0, Kh)
    assert w.eta_max == pytest.approx(eta_max, abs=5.1e-5 if mu is None else 5.1e-7)  # the digits given
    if mu is not None:
        assert (w.mu, w.nu) == pytest.approx((mu, nu), rel=5.1e-6)  # six digits


@pytest.mark.parametrize(("Kh", "q_R"), [(1.0, 0.6757 + 0.7480j), (2.0, -0.7362 + 0.5674j)])
def test_thick_wall(Kh, q_R):
    w = _solved(1.0, 0.5, 0.25, 0.125, Kh)
    # Four decimals of each part; computed independently by the same method.
    assert abs(w.q_R.real - q_R.real) < 5.1e-5 and abs(w.q_R.imag - q_R.imag) < 5.1e-5


@pytest.mark.parametrize("Kh", [0.5, 1.0, 3.0])
def test_thick_wall_becomes_thin(Kh):
    thin = _solved(1.0, 0.5, 0.25, 0.0, Kh).q_R
    gaps = [abs(_solved(1.0, 0.5, 0.25, t, Kh).q_R - thin) / abs(thin) for t in (0.02, 0.01, 0.005)]
    # The longer path under the wall changes q_R as t log(1/t): halving t divides the change by 1.6 to 1.9.
    assert gaps[0] < 0.1
    assert all(1.6 < wide / narrow < 2.0 for wide, narrow in itertools.pairwise(gaps))


geometries = st.tuples(
    st.floats(0.1, 10.0),  # h
    st.floats(0.05, 2.0),  # b / h
    st.floats(0.02, 0.95),  # a / h
    st.one_of(st.just(0.0), st.floats(0.01, 1.0)),  # t / h
    st.floats(0.01, 6.0),  # Kh
)


def _draw(numbers):
    h, b, a, t, Kh = numbers
    return h, b * h, a * h, t * h, Kh


@settings(max_examples=25, deadline=None)
@given(geometries)
def test_identities(numbers):
    w = _solved(*_draw(numbers))
    h, K = w.geometry.depth, w.omega**2 / w.g
    assert w.omega**2 == pytest.approx(w.g * w.k * np.tanh(w.k * h), rel=1e-13)  # roundings
    # Both identities hold for any truncation, to the rounding of a linear system, whose condition is up to
    # 1e4 at the small ends of the ranges (the largest of 700 draws was 5e-13).
    assert abs(w.R) == pytest.approx(1.0, abs=1e-11)
    # q_S for a unit coefficient of psi_0, from q_S for a unit elevation.
    kh = w.k * h
    psi_0 = np.cosh(kh) / np.sqrt(0.5 * (1.0 + np.sinh(2.0 * kh) / (2.0 * kh)))
    q_S = abs(w.q_S) * w.omega * psi_0 / w.g
    # Im q_R loses digits next to a larger real part; the largest error met was 1.1e-11 of that part.
    damping = q_S**2 / (4.0 * K * w.k * h)
    assert w.q_R.imag == pytest.approx(damping, rel=1e-9, abs=5e-11 * abs(w.q_R))
    assert damping == pytest.approx(abs(w.q_S) ** 2 / (4.0 * w.omega * w.group_velocity), rel=1e-12)


@settings(max_examples=8, deadline=None)
@given(geometries)
def test_converged(numbers):
    w = _solved(*_draw(numbers))
    finer = _solve(w.geometry, w.omega, w.g, _FUNCTIONS + 8)
    # The thinnest walls (a hundredth of the depth) are worst: the largest of 175 draws was 6e-6. If waves do
    # not reach under the wall, q_S is near zero and is compared with a thousandth of a long wave's flow.
    assert abs(w.q_R - finer.q_R) < 2e-5 * abs(finer.q_R)
    assert abs(w.q_S - finer.q_S) < 2e-5 * (abs(finer.q_S) + w.omega * w.geometry.length * 1e-3)


def test_long_waves_lift_the_water_in_step():
    w = _solved(0.42, 0.13, 0.16, 0.02, 1e-5)
    # The level follows the level at a wall, twice the incident one, and mu -> 1. The next terms are of order
    # kh = 3e-3 and its square.
    assert _open_level(w) == pytest.approx(2.0, rel=1e-4)
    assert w.mu == pytest.approx(1.0, rel=1e-3)
    # In phase: at t = 0 the crest is at the wall, and the flow i omega b is a quarter period ahead.
    level = 1j * w.q_S / (w.omega * w.geometry.length)
    assert abs(np.angle(level)) < 0.01


def test_resonance_of_a_deep_draught():
    """A column of draught a swings like a pendulum of length a, plus a small length for the water below."""
    a, b, h = 0.4, 0.02, 1.0
    K = np.linspace(1.5, 2.5, 41)
    levels = [_open_level(_solved(h, b, a, 0.0, Kh)) for Kh in K]
    added = 1.0 / K[int(np.argmax(levels))] - a
    # The added length is that of the mouth of a slit: a fraction of b, times a logarithm of h / b.
    assert 0.0 < added < 2.5 * b
    assert max(levels) > 10.0


@pytest.mark.parametrize("t", [0.0, 0.05])
def test_a_chamber_that_fits_half_a_wave_does_no_harm(t):
    kh = 2.0
    b, Kh = np.pi / kh, kh * np.tanh(kh)
    w, beside = _solved(1.0, b, 0.3, t, Kh), _solved(1.0, b * (1.0 + 1e-9), 0.3, t, Kh)
    # cot kb is infinite. The bound is a change of 1e-9 in length, times a slope of order 10.
    assert w.q_R == pytest.approx(beside.q_R, abs=1e-7)
    assert abs(w.R) == pytest.approx(1.0, abs=1e-12)
    if t == 0.0:  # a standing wave has no flow under a thin wall, except for rounding
        assert abs(w.q_S) < 1e-12


@pytest.mark.parametrize("t", [0.0, 0.02])
def test_extremes_warn_of_nothing(t):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for Kh in (1e-8, 300.0, 4e4):  # tides, ripples, and waves that do not reach under the wall
            found = linear_response(_solved(0.42, 0.13, 0.16, t, Kh), 0.04, [0.0, 500.0, 1e6])
            assert np.all(np.isfinite(found.q)) and np.all(found.xi >= 0.0)
            assert np.all(found.xi <= found.eta_max + 1e-12)
        assert np.isfinite(_solved(0.42, 0.13, 0.16, 1e-7, 1.0).q_R)  # thinner than the modes resolve


# --- the turbine


@settings(max_examples=25, deadline=None)
@given(geometries, st.floats(1e-3, 0.5), st.floats(0.0, 1e6))
def test_energy_goes_into_the_turbine_or_back(numbers, H, K_dm):
    found = linear_response(_solved(*_draw(numbers)), H, K_dm)
    # The far field is a check that does not use the power: phases and amplitudes of q_R, q_S and R all enter.
    # Rounding is as in the identities.
    assert found.xi == pytest.approx(1.0 - abs(found.R) ** 2, abs=1e-10)
    assert 0.0 <= found.xi <= found.eta_max + 1e-10


def test_the_linear_turbine_takes_what_the_quadratic_one_would(water):
    found = linear_response(water, 0.04, 534.66)
    q = abs(found.q) * np.cos(np.linspace(0.0, 2 * np.pi, 1000, endpoint=False))
    # A mean over equidistant phases of |cos|^3, whose Fourier series falls as n^-4.
    assert np.mean(534.66**2 * np.abs(q) ** 3) == pytest.approx(found.P_owc, rel=1e-8)
    assert found.P_a_peak == pytest.approx(534.66**2 * np.max(q) ** 2)
    assert found.P_a * found.Lambda == pytest.approx(found.q)
    assert found.q == pytest.approx(water.q_S * 0.02 - water.Z() * found.P_a)  # roundings
    assert abs(found.level) * found.omega * 0.13 == pytest.approx(abs(found.q))


def test_damping_from_open_to_closed(water):
    K_dm = np.concatenate([[0.0], np.geomspace(1.0, 1e6, 60)])
    found = linear_response(water, 0.04, K_dm)
    assert found.xi[0] == 0.0 and found.P_a[0] == 0.0 and np.isinf(found.Lambda[0])
    assert abs(found.level[0]) == pytest.approx(0.02 * _open_level(water))
    assert np.all(np.diff(np.abs(found.q)) < 0.0) and np.all(np.diff(np.abs(found.P_a)) > 0.0)
    # The pressure of a closed chamber is |q_S A / Z|, except for a share |Z| / Lambda of about 1e-3, in
    # quadrature and in phase.
    assert abs(found.P_a[-1]) == pytest.approx(abs(water.q_S * 0.02 / water.Z()), rel=2e-3)
    best = linear_response(water, 0.04, found.K_dm_best[0])
    assert best.xi == pytest.approx(found.eta_max, rel=1e-12)
    assert found.xi.max() <= best.xi
    assert best.Lambda == pytest.approx(abs(water.Z()), rel=1e-12)


def test_arrays_are_the_single_answers(water):
    H, K_dm = np.array([[0.02], [0.08]]), np.array([0.0, 300.0, 1000.0])
    found = linear_response(water, H, K_dm)
    assert found.xi.shape == found.H.shape == (2, 3)
    alone = linear_response(water, 0.08, 300.0)
    assert np.ndim(alone.xi) == 0 and alone.xi == pytest.approx(found.xi[1, 1], rel=1e-14)


def test_height_and_damping_act_together(water):
    # Dimensionless results depend on K_dm^2 H only.
    a, b = linear_response(water, 0.08, 300.0), linear_response(water, 0.02, 600.0)
    assert a.xi == pytest.approx(b.xi, rel=1e-12) and abs(a.q) == pytest.approx(4.0 * abs(b.q), rel=1e-12)


# --- the lip

losses = st.floats(0.0, 50.0)


@settings(max_examples=25, deadline=None)
@given(geometries, st.floats(1e-3, 0.5), st.floats(0.0, 1e4), losses)
def test_energy_goes_into_the_turbine_the_lip_or_back(numbers, H, K_dm, zeta):
    found = linear_response(_solved(*_draw(numbers)), H, K_dm, lip_loss=zeta)
    share = found.P_lip / found.P_inc
    # The far field does not depend on the powers, which are shares of the incident power; rounding as above.
    assert found.xi + share + abs(found.R) ** 2 == pytest.approx(1.0, abs=1e-10)
    assert found.xi >= 0.0 and share >= 0.0 and found.xi + share <= found.eta_max + 1e-10


def test_no_loss_at_the_lip_changes_no_bit(water):
    H, K_dm = np.array([[0.02], [0.08]]), np.array([0.0, 300.0, 1e6])
    plain, none = linear_response(water, H, K_dm), linear_response(water, H, K_dm, lip_loss=0.0)
    assert np.array_equal(plain.xi, none.xi) and np.array_equal(plain.q, none.q)
    assert np.all(none.P_lip == 0.0) and np.all(none.lip_loss == 0.0)
    # the law of the turbine alone: r |1 + Z r| = 8/(3 pi) K_dm^2 |q_S| A
    r = 1.0 / none.Lambda
    drive = 8.0 / (3.0 * np.pi) * K_dm**2 * abs(water.q_S) * 0.5 * H
    np.testing.assert_allclose(r * np.abs(1.0 + water.Z() * r), drive, rtol=1e-12)
    assert linear_owc(OWC, lip_loss=0.0).xi == linear_owc(OWC).xi


def test_the_lip_takes_what_its_quadratic_law_would(water):
    rho0, b, zeta, K_dm = 1000.0, 0.13, 1.5, 534.66
    found = linear_response(water, 0.04, K_dm, rho0, zeta)
    v = abs(found.q) / b * np.cos(np.linspace(0.0, 2 * np.pi, 1000, endpoint=False))
    # a mean over equidistant phases of |cos|^3, whose Fourier series falls as n^-4
    assert np.mean(0.5 * rho0 * zeta * np.abs(v) ** 3) * b == pytest.approx(found.P_lip, rel=1e-8)
    assert np.mean(K_dm**2 * np.abs(v * b) ** 3) == pytest.approx(found.P_owc, rel=1e-8)
    # both pressures act on the water, and only the turbine's on the air
    drop = 8.0 / (3.0 * np.pi) * 0.5 * rho0 * zeta / b**2 * abs(found.q) * found.q
    assert found.q == pytest.approx(water.q_S * 0.02 - water.Z() * (found.P_a + drop), rel=1e-12)


def test_more_loss_at_the_lip_is_less_of_everything(water):
    zeta = np.concatenate([[0.0], np.geomspace(0.01, 1000.0, 60)])
    found = linear_response(water, 0.04, 534.66, lip_loss=zeta)
    # The case has more than the best damping, so that an additional loss at the lip only reduces power.
    assert np.all(np.diff(found.xi) < 0.0) and np.all(np.diff(np.abs(found.q)) < 0.0)
    assert np.all(np.diff(np.abs(found.P_a)) < 0.0)
    open_chamber = linear_response(water, 0.04, 0.0, lip_loss=1.0)
    assert open_chamber.xi == 0.0 and open_chamber.P_lip > 0.0 and np.isinf(open_chamber.Lambda)


@settings(max_examples=25, deadline=None)
@given(geometries, st.floats(1e-3, 0.5), st.floats(1.0, 1e4), losses, losses)
def test_efficiency_never_rises_with_the_loss(numbers, H, K_dm, one, other):
    water = _solved(*_draw(numbers))
    less, more = (linear_response(water, H, K_dm, lip_loss=zeta).xi for zeta in sorted((one, other)))
    # P_owc is proportional to |q|^3 at a given K_dm, and any resistance reduces |q|.
    assert more <= less * (1.0 + 1e-12)


# --- the case


def test_built_in_case():
    found = linear_owc(OWC)
    assert found.omega == pytest.approx(2 * np.pi / 1.2) and found.T == pytest.approx(1.2)
    assert found.water.geometry == ChamberGeometry(0.42, 0.13, 0.16, 0.02)
    # `theory` computes in float32
    assert found.P_inc == pytest.approx(float(theory.incident_power(0.04, 1.2, 0.42)), rel=1e-5)
    assert found.water.k == pytest.approx(float(theory.wavenumber(found.omega, 0.42)), rel=1e-6)
    # Values when this was written; there is no other source.
    assert (found.xi, found.eta_max) == pytest.approx((0.7790, 0.7942), abs=1e-4)
    assert found.water is linear_owc(OWC.replace({"pto.K_dm": 300.0})).water  # solved once


def test_lengths_are_those_on_the_lattice():
    """The particles are 0.44 m deep; theory for 0.42 m would be relative to another incident power."""
    case = OWC.replace({"dx": 0.04, "device.wall_thickness": 0.05, "probes.pressure": None})
    assert linear_owc(case).water.geometry == ChamberGeometry(0.44, 0.13, 0.16, 0.05)


def test_every_efficiency_is_relative_to_one_incident_power():
    """The lattice changes the depth by 5 %, and the device absorbs exactly the incident power."""
    case = coarse("owc")
    P = incident_power(case)
    depth = Geometry.of(case).depth
    assert depth != case.tank.depth
    assert P == pytest.approx(float(theory.incident_power(0.04, 1.2, depth)), rel=1e-6)
    t = np.arange(0.0, case.t1, case.output.sample_dt)
    all_of_it = np.full_like(t, P)
    series = {"power_pto": all_of_it}
    model = SimpleNamespace(entries=lambda: {"pto": Entry("power take-off", Exchange.HARVESTED)})
    solution = Solution(series | {"time": t}, {}, model, None)
    results = _power(case, Record(solution, settled_window(case, t, [all_of_it]), 0.0))
    assert results["P_inc"] == P and results["P_owc"] == pytest.approx(P, rel=1e-9)
    assert results["xi"] == pytest.approx(1.0, rel=1e-9)
    assert mean_of_power(case, "xi")(t, all_of_it).of_power(all_of_it) == pytest.approx(1.0, rel=1e-9)
    # linear theory is in float64, the case in float32
    assert linear_owc(case).P_inc == pytest.approx(P, rel=1e-5)
    assert dict(js.check(case))["incident power"] == f"{P:.4g} W per metre of width"


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"device": None, "pto": None}, "device"),
        ({"waves": None}, "waves"),
        ({"pto": None}, "pto.K_dm"),
        ({"pto.P_a": 100.0}, "pto.K_dm"),
        (
            {"device.platform_height": 0.1, "device.platform_length": 0.5},
            "platform_height = 0.1 m makes the bed uneven",
        ),
    ],
)
def test_incomplete_cases(changes, field):
    case = OWC.replace(changes)
    with pytest.raises(js.CaseError, match=field):
        linear_owc(case)
    # for a turbine in waves the check gives the reason; in other cases there is nothing to compute
    asked = case.turbines and case.waves is not None
    assert js.linear_check(case) == ([("linear theory", f"none: device.{field}")] if asked else [])


def test_check_says_what_to_expect():
    rows = dict(js.linear_check(OWC))
    assert rows["linear efficiency"] == "0.779 (at most 0.794, at K_dm = 439.8)"
    assert list(rows) == ["linear efficiency", "linear pressure", "linear chamber level"]


def test_values_out_of_range(water):
    with pytest.raises(ValueError, match="draught"):
        ChamberGeometry(0.4, 0.1, 0.4)
    with pytest.raises(ValueError, match="positive"):
        ChamberGeometry(0.4, 0.0, 0.1)
    with pytest.raises(ValueError, match="omega"):
        radiation_and_scattering(water.geometry, 0.0)
    with pytest.raises(ValueError, match="K_dm"):
        linear_response(water, 0.04, -1.0)
    with pytest.raises(ValueError, match="H"):
        linear_response(water, 0.0, 1.0)
    with pytest.raises(ValueError, match="lip_loss"):
        linear_response(water, 0.04, 1.0, lip_loss=-1.0)
