"""Derivatives of results: through the loop, compared with differences; over ensembles; and refused ones."""

from pathlib import Path

import jax
import numpy as np
import pytest
from conftest import coarse, enable_x64
from hypothesis import given, settings
from hypothesis import strategies as st

import jaxsph as js
from jaxsph.case.case import SMOOTH
from jaxsph.errors import CaseError
from jaxsph.output.hdf5 import Variable
from jaxsph.output.sweep_file import Meanings
from jaxsph.study import members as running
from jaxsph.study.ensemble import parabola
from jaxsph.study.tangents import LOST, _seed, grain

EXAMPLES = Path(js.__file__).parents[1] / "examples"
# Waves that ramp up within a quarter period, in a short tank: the chamber breathes within 0.2 s.
SHORT = {
    "tank.length": 1.2,
    "probes": {"gauges": [0.5]},
    "waves.ramp_periods": 0.25,
    "output.snapshot_dt": 0.1,
    "t1": 0.2,
    "precision": "float64",
}
CASE = coarse("owc", SHORT)
OWC = js.load_case("owc")


# --- through the loop


@pytest.fixture(scope="module")
def exact():
    """Function of changes to the case and of a parameter: the derivative of the absorbed energy."""

    def found(changes, parameter, method=None):
        with enable_x64():
            return js.derivative(
                CASE.replace(changes), parameter, "energy_pto", method or js.Exact(0.0), progress=False
            )

    return found


# every other parameter compiles another program
@pytest.mark.slow
@pytest.mark.parametrize("parameter", ["pto.K_dm", "waves.H"])
def test_exact_slope_is_that_of_differences(exact, parameter):
    section, name = parameter.split(".")
    value = getattr(getattr(CASE, section), name)
    step = 1e-5 * value
    ahead, behind = (exact({parameter: value + s * step}, parameter).value for s in (1, -1))
    here = exact({}, parameter)
    # The error of the difference itself: truncation (1e-5)^2, round-off 1e-16/1e-5. Measured: 3e-11 over 0.5
    # s; the seed of H is itself a difference of builds, good to 1e-8.
    assert here.slope == pytest.approx((ahead - behind) / (2 * step), rel=1e-6)
    assert here.error is None and here.reach > 0.01 * value
    # the result follows from the readings, and its slope from theirs
    assert here.value == pytest.approx(0.01 * here.series["power_pto"].sum())
    assert here.slope == pytest.approx(0.01 * here.slopes["power_pto"].sum())
    assert here.slopes["grain"].shape == here.series["time"].shape == (20,)


@pytest.mark.slow
@pytest.mark.parametrize("key", ["angle", "draught", "length"])
def test_exact_slope_over_a_shape_is_that_of_differences(key):
    """Water and dummies depend smoothly on a solid: on a wall's angle, its draught, a chamber's length.

    Measured: 4e-6, 2e-6 and 1e-5 with differences over 1e-5 of the value. Differences over 1e-3 of it are off
    by up to 2 %, because some particle enters or leaves the surface.
    """
    with enable_x64():
        program = js.Program.load(f"{EXAMPLES / 'leaning_column.py'}:column", {"precision": "float64"})
        value = program.value(key)
        step = 1e-5 * value
        here = js.derivative(program, key, "energy_pto", js.Exact(0.0), progress=False)
        ahead, behind = (
            js.run(program.replace({key: value + s * step}), progress=False)["power_pto_column"].sum() * 0.01
            for s in (1, -1)
        )
    assert here.slope == pytest.approx((ahead - behind) / (2 * step), rel=1e-4)


@pytest.mark.slow
def test_a_slope_over_what_a_loop_holds_fixed_is_refused(tmp_path):
    """The position of a thin plate is in no array: without the refusal its slope would silently be zero."""
    (tmp_path / "own.py").write_text(
        "import jaxsph as js\n\n\ndef screened(x: float = 0.57) -> js.Problem:\n"
        '    plate = {"foot": [x, 0.24], "head": [x, 0.6], "thickness": 0.08}\n'
        '    chamber = {"between": ["screen", "far"], "pto": {"K_dm": 10.0}}\n'
        '    parts = {"solid": {"screen": {"plate": plate}}, "chamber": {"column": chamber}}\n'
        '    tank = {"length": 1.0, "depth": 0.4, "height": 0.6}\n'
        '    case = {"name": "own", "dx": 0.04, "t1": 0.1, "tank": tank}\n'
        "    return js.Case.from_dict(case | parts).problem()\n"
    )
    program = js.Program.load(f"{tmp_path / 'own.py'}:screened")
    with pytest.raises(CaseError, match="x changes values that are fixed in the compiled loop"):
        js.derivative(program, "x", "energy_pto", js.Exact(), progress=False)


@pytest.mark.slow
def test_a_slope_that_speaks_of_no_change_is_refused(exact):
    with pytest.raises(js.DerivativeError, match=r"because particle paths are chaotic: at t = 0.10 s"):
        exact({}, "pto.K_dm", js.Exact(least=1e6))


@pytest.mark.slow
def test_a_filtered_slope_has_the_filter_s_bias_for_an_error(exact):
    """Within 0.2 s, twenty averages remove little of the water's response; the value is that of the run."""
    sharp, smooth = (exact({}, "pto.K_dm", method) for method in (js.Exact(0.0), js.Filtered()))
    assert smooth.value == sharp.value
    response = smooth.slope - 2.0 * smooth.value / CASE.pto.K_dm
    assert smooth.error == pytest.approx(LOST[CASE.scheme.kind] * abs(response))
    assert abs(smooth.slope - sharp.slope) < smooth.error and smooth.slope != sharp.slope


# --- over an ensemble


@pytest.fixture
def members(monkeypatch):
    """Members of a sweep with a parabola and given scatter as efficiency; the members are not run."""
    scatter, failing = {}, set()

    def member(case, stem):
        K = case.pto.K_dm
        xi = 0.5 - 1e-6 * (K - 600.0) ** 2 + scatter.get(round(K), 0.0)
        results = {} if round(K) in failing else {"xi": xi, "P_owc": 2 * xi}
        series = {"time": np.arange(3) * 0.01}
        return {
            "results": results,
            "series": series,
            "failure": "too fast" if not results else "",
        }, Meanings()

    monkeypatch.setattr(running, "run_member", member)
    return scatter, failing


def test_ensemble_finds_the_slope_of_a_parabola(members):
    found = js.derivative(OWC.replace({"pto.K_dm": 500.0}), "pto.K_dm", method=js.Ensemble(), progress=False)
    assert found.value == pytest.approx(0.49) and found.slope == pytest.approx(2e-4)
    assert found.error < 1e-12 and found.reach == pytest.approx(150.0)
    assert found.members["pto.K_dm"] == pytest.approx(np.linspace(350.0, 650.0, 9))


def test_an_ensemble_over_a_length_is_fitted_to_the_lengths_that_are_built(monkeypatch):
    """With a spacing of 0.02 m nine draughts become five; a result of 3 times the draught has slope 3."""

    def member(case, stem):
        return {
            "results": {"xi": 3.0 * case.built("device.draught")},
            "series": {},
            "failure": "",
        }, Meanings()

    monkeypatch.setattr(running, "run_member", member)
    found = js.derivative(OWC, "device.draught", "xi", js.Ensemble(), progress=False)
    assert found.members["device.draught"] == pytest.approx([0.12, 0.14, 0.16, 0.18, 0.2])
    assert found.value == pytest.approx(0.48) and found.slope == pytest.approx(3.0)
    assert found.error == pytest.approx(0.0, abs=1e-9)
    with pytest.raises(
        js.CaseError, match=r"rounds the values between 0.144 and 0.176 m to only 0.14, 0.16, 0.18 m"
    ):
        js.derivative(OWC, "device.draught", "xi", js.Ensemble(spread=0.1), progress=False)


def test_energy_of_an_ensemble_is_that_from_the_start(monkeypatch):
    """It is not the sweep's result of that name, which covers the last whole periods only."""

    def member(case, stem):
        series = {"time": np.arange(100) * 0.01, "power_pto": np.ones(100)}
        results = {"energy_pto": -1.0, "whole_energy_pto": 1e-3 * case.pto.K_dm}
        meanings = Meanings({"power_pto": Variable("W m-1", "power")})
        return {"results": results, "series": series, "failure": ""}, meanings

    monkeypatch.setattr(running, "run_member", member)
    case = OWC.replace({"pto.K_dm": 500.0})
    found = js.derivative(case, "pto.K_dm", "energy_pto", js.Ensemble(), progress=False)
    assert found.value == pytest.approx(0.5) and found.slope == pytest.approx(1e-3)


def test_ensemble_goes_on_without_members_that_failed(members, tmp_path):
    _, failing = members
    failing |= {350, 650}
    method = js.Ensemble(spread=0.3, members=7, out=tmp_path / "e.h5")
    case = OWC.replace({"pto.K_dm": 500.0})
    found = js.derivative(case, "pto.K_dm", "P_owc", method, progress=False)
    assert found.slope == pytest.approx(4e-4) and np.isnan(found.members["P_owc"][[0, -1]]).all()
    failing |= {400, 450}
    (tmp_path / "e.h5").unlink()
    with pytest.raises(
        js.DerivativeError, match="only 3 of 7 members gave P_owc, but a slope needs four: too fast"
    ):
        js.derivative(case, "pto.K_dm", "P_owc", method, progress=False)


@settings(max_examples=5, deadline=None)
@given(st.integers(0, 1000))
def test_error_of_a_parabola_s_slope_covers_it(seed):
    """For 2000 parabolas with known scatter, the mean square of the error matches that of the deviation."""
    x = np.linspace(-1.0, 1.0, 9)
    noise = np.random.default_rng(seed).normal(scale=0.1, size=(2000, 9))
    fits = [parabola(x, 2.0 + 3.0 * x - 0.5 * 4.0 * x**2 + e) for e in noise]
    spread = np.mean([(f.slope - 3.0) ** 2 for f in fits])
    # the relative error of a mean of 2000 squares is 0.03 to 0.05; five times that is allowed
    assert np.mean([f.error**2 for f in fits]) == pytest.approx(spread, rel=0.25)
    assert np.mean([f.curvature for f in fits]) == pytest.approx(-4.0, abs=0.1)


# --- towards a maximum


@pytest.fixture
def theory(monkeypatch):
    """Members with the efficiency of linear theory and a scatter of 0.005; returns the list of cases run."""
    ran = []

    def member(case, stem):
        ran.append(case)
        noise = 0.005 * np.random.default_rng(int(1e3 * case.pto.K_dm)).normal()
        series = {"time": np.arange(3) * 0.01}
        return {
            "results": {"xi": js.linear_owc(case).xi + noise},
            "series": series,
            "failure": "",
        }, Meanings()

    monkeypatch.setattr(running, "run_member", member)
    return ran


@pytest.mark.parametrize("start", [150.0, 2400.0])
def test_maximise_climbs_to_the_best_damping(theory, tmp_path, start):
    case = OWC.replace({"pto.K_dm": start})
    found = js.maximise(case, {"pto.K_dm": (100.0, 2500.0)}, tmp_path / "o.h5", progress=False)
    best = js.linear_owc(case)
    assert js.linear_owc(found.case).xi > 0.95 * best.eta_max
    assert len(found.history) <= 10 and found.history[0]["pto.K_dm"] == pytest.approx(start)
    assert found.value == max(one["xi"] for one in found.history)


def test_maximise_chooses_a_length_of_the_device_too(theory, tmp_path):
    """Damping and draught: the members for the draught are built anew, each with another wall."""
    case = OWC.replace({"pto.K_dm": 150.0, "device.draught": 0.12})
    over = {"pto.K_dm": (100.0, 2500.0), "device.draught": (0.1, 0.2)}
    found = js.maximise(case, over, tmp_path / "o.h5", progress=False)
    best = max(
        js.linear_owc(case.replace({"device.draught": a, "pto.K_dm": K})).xi
        for a in np.linspace(0.1, 0.2, 6)
        for K in np.geomspace(100.0, 2500.0, 30)
    )
    assert js.linear_owc(found.case).xi > 0.95 * best and len(found.history) <= 10
    assert found.case.device.draught > 0.15
    assert {"slope device.draught", "error pto.K_dm"} < found.history[0].keys()


def test_an_interrupted_search_goes_on(theory, tmp_path):
    case = OWC.replace({"pto.K_dm": 150.0})
    arguments = (case, {"pto.K_dm": (100.0, 2500.0)}, tmp_path / "o.h5")
    method = js.Ensemble(members=5)
    js.maximise(*arguments, method=method, evaluations=2, progress=False)
    assert len(theory) == 10
    found = js.maximise(*arguments, method=method, evaluations=3, progress=False)
    assert len(theory) == 15 and len(found.history) == 3
    stored = js.read_sweep(tmp_path / "o.h5")
    assert stored.axes["pto.K_dm"] == pytest.approx([one["pto.K_dm"] for one in found.history])
    assert stored["slope pto.K_dm"] == pytest.approx([one["slope pto.K_dm"] for one in found.history])
    with pytest.raises(js.FileError, match="contains another search"):
        js.maximise(OWC, *arguments[1:], method=method, progress=False)


def test_a_search_ends_at_its_bounds(theory, tmp_path):
    case = OWC.replace({"pto.K_dm": 150.0})
    found = js.maximise(case, {"pto.K_dm": (100.0, 200.0)}, tmp_path / "o.h5", progress=False)
    assert found.reason == "at the bounds" and found.case.pto.K_dm == pytest.approx(200.0)


@pytest.mark.parametrize("bounds", [(0.0, 100.0), (100.0, 50.0), (600.0, 700.0)])
def test_bounds_must_hold_the_case(bounds, tmp_path):
    with pytest.raises(
        js.CaseError, match="bounds must be positive, ascending and contain the case's value, 534"
    ):
        js.maximise(OWC, {"pto.K_dm": bounds}, tmp_path / "o.h5")


# --- grain


@given(st.floats(-2, 2), st.floats(-2, 2), st.integers(0, 100))
def test_grain_sees_what_neighbours_differ_by(a, b, seed):
    rng = np.random.default_rng(seed)
    x = rng.random((2000, 2))
    smooth = np.stack([a * x[:, 0] + b * x[:, 1], b - a * x[:, 1]], 1)
    assert grain(x, smooth, 0.02) < 1e-12
    rough = rng.normal(size=x.shape)
    # the fit of a line to some 13 points in a cell uses three of them; sqrt(2) for two components
    assert grain(x, smooth + rough, 0.02) == pytest.approx(np.sqrt(2 * 10 / 13), rel=0.05)


# --- what is refused


@pytest.mark.parametrize(
    ("changes", "arguments", "message"),
    [
        (
            {},
            {"parameter": "device.draught", "method": js.Exact()},
            "device.draught: the model may change discontinuously .*fluid.nu.* method=js.Ensemble",
        ),
        ({}, {"parameter": "pto.k_dm"}, "did you mean 'pto.K_dm'"),
        ({}, {"parameter": "scheme.solver"}, "scheme.solver = .* must be a number"),
        ({}, {"parameter": "pto.P_a"}, "pto.P_a is not given in the case"),
        ({}, {"parameter": "pto.K_dm", "of": "eta"}, "of = 'eta': must be 'xi', 'P_owc' or 'energy_pto'"),
        ({"t1": 5.0}, {"parameter": "pto.K_dm"}, "of = 'xi' needs a whole wave period .* raise t1 = 5 s"),
        ({"pto": None}, {"parameter": "waves.H"}, r"needs a turbine \(for example pto.K_dm\)"),
        ({"pto.K_dm": 0.0}, {"parameter": "pto.K_dm"}, "pto.K_dm = 0: must not be 0"),
    ],
)
def test_what_has_no_derivative_is_named(changes, arguments, message):
    with pytest.raises(js.CaseError, match=message):
        js.derivative(OWC.replace(changes), progress=False, **arguments)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"spread": 1.0}, "spread = 1: must lie between 0 and 1"),
        ({"spread": 0.0}, "spread = 0: must lie between 0 and 1"),
        ({"members": 3}, "members = 3: must lie between 4 and"),
    ],
)
def test_an_ensemble_without_a_slope_is_refused(arguments, message):
    with pytest.raises(js.CaseError, match=message):
        js.Ensemble(**arguments)


def test_what_the_lattice_takes_its_shape_from_is_no_derivative_s():
    """Every parameter that is offered changes a build smoothly, and keeps the shapes of its arrays."""
    weakly = {"scheme.kind": "weakly_compressible", "scheme.alpha": 0.01}
    case = OWC.replace({"dx": 0.04, "device.wall_thickness": 0.04} | weakly)
    problem = case.problem()
    for name in ("pto.K_dm", "waves.H", "scheme.alpha"):
        assert name in SMOOTH
        d_model, d_state = _seed(case, name, problem)
        moved = [np.abs(np.asarray(leaf)).max() for leaf in jax.tree.leaves((d_model, d_state)) if leaf.size]
        assert np.isfinite(moved).all() and max(moved) > 0
    d_model, _ = _seed(case, "pto.K_dm", problem)
    # float32: the rounding of 535 over a step of 1 %
    assert float(d_model.chambers[0].pto.K_dm) == pytest.approx(1.0, abs=1e-4)
