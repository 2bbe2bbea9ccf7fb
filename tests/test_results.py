"""Amplitudes, means and RAOs of a model's oscillating parts; the order of results in tables."""

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

import jaxsph as js
from jaxsph.case.results import SettledPeriods
from jaxsph.model.interfaces import Model
from jaxsph.model.meaning import Group, Label, Oscillation
from jaxsph.problem.record import Record, WholeRecord, Window
from jaxsph.problem.results import oscillation_result
from jaxsph.report.labels import in_order, label_of, short

CASE = js.load_case("owc")
T, H = 1.2, 0.04
SWINGS = {
    "heave": Oscillation("heave", "heave of the buoy", "m", None, True, True),
    "force_z": Oscillation("force", "force upwards on the buoy", "N/m", 1, True, True),
    "P_a": Oscillation("P_a", "air pressure", "Pa"),
    "absent": Oscillation("not_read", "what no probe reads", "m"),
}
MODEL = cast(
    Model, SimpleNamespace(g=np.zeros(2), parts=(SimpleNamespace(oscillations=lambda dim: dict(SWINGS)),))
)


def recorded(periods=5, results=None):
    """Record of eight periods: heave with a transient and a harmonic, a force, and a pressure."""
    t = np.arange(0.0, 8.0 * T + 1e-9, 0.01)
    swing = np.cos(2.0 * np.pi / T * t - 0.7)
    transient = np.where(t < 3.0 * T, 5.0, 0.0)
    series = {
        "time": t,
        "heave": np.float32(0.1 + 0.03 * swing + transient + 0.01 * np.sin(4.0 * np.pi / T * t)),
        "force": np.float32(np.stack([0.0 * t, 300.0 - 40.0 * swing, 0.0 * t], axis=1)),
        "P_a": np.float32(150.0 * swing),
    }
    solution = js.Solution(series, {}, MODEL, cast(js.State, None))
    over = t >= t[-1] - periods * T - 1e-9
    return Record(solution, Window(over, periods), 0.0, results or {})


def test_amplitudes_are_those_of_the_first_harmonic_over_the_settled_periods():
    found = oscillation_result(MODEL, SettledPeriods(CASE)).make(recorded())
    assert found["amplitude_heave"] == pytest.approx(0.03, rel=1e-4)  # float32 record
    assert found["mean_heave"] == pytest.approx(0.1, rel=1e-4)
    assert found["rao_heave"] == pytest.approx(0.03 / (0.5 * H), rel=1e-4)
    assert found["amplitude_force_z"] == pytest.approx(40.0, rel=1e-4)
    assert found["mean_force_z"] == pytest.approx(300.0, rel=1e-4)
    assert found["amplitude_P_a"] == pytest.approx(150.0, rel=1e-4)
    assert not {"mean_P_a", "rao_P_a", "amplitude_absent"} & set(found)


def test_measured_waves_come_before_the_asked_ones():
    found = oscillation_result(MODEL, SettledPeriods(CASE)).make(recorded(results={"incident_height": 0.05}))
    assert found["rao_heave"] == pytest.approx(0.03 / 0.025, rel=1e-4)


@pytest.mark.parametrize(
    "averaging",
    [WholeRecord(), *(SettledPeriods(js.load_case(name)) for name in ("owc_irregular", "focused_wave"))],
)
def test_only_regular_waves_have_amplitudes(averaging):
    result = oscillation_result(MODEL, averaging)
    assert not result.make(recorded()) and not result.labels


def test_no_amplitude_before_a_period_has_settled():
    record = recorded()._replace(window=Window(np.ones(961, bool)))
    assert not oscillation_result(MODEL, SettledPeriods(CASE)).make(record)


def test_means_and_ratios_of_a_body_are_explained():
    (body,) = js.load_case("flap_2d").problem().model.bodies
    model = cast(Model, SimpleNamespace(g=np.zeros(2), parts=(body,)))
    labels = oscillation_result(model, SettledPeriods(CASE)).labels
    assert "includes the hydrostatic force" in labels["mean_body_force_z"].meaning
    assert labels["mean_body_force_x"].meaning.startswith("mean drift force")
    assert "RAO" in labels["rao_pitch"].meaning and not labels["mean_pitch"].meaning


def test_every_amplitude_has_words_and_a_unit():
    result = oscillation_result(MODEL, SettledPeriods(CASE))
    assert set(result.make(recorded())) <= set(result.labels)
    assert result.labels["rao_heave"].unit == "" and result.labels["rao_force_z"].unit == "N/m per m"


def test_parts_of_built_in_cases_say_what_swings():
    expected = {
        "owc": {"P_a", "flow", "chamber_level"},
        "section_fixed": {"force_x_section", "force_z_section", "moment_section"},
        "flap_2d": {"pitch", "body_force_x", "body_force_z", "body_moment"},
        "owc_two_chambers": {"P_a_land", "flow_sea", "duct_flow_cross", "pressure_drop_cross"},
    }
    for name, some in expected.items():
        problem = js.load_case(name).problem()
        readings = problem.units
        swings = {n: one for part in problem.model.parts for n, one in part.oscillations(2).items()}
        assert some <= set(swings), name
        assert all(one.reading in readings for one in swings.values()), name


def test_results_of_the_device_come_first_and_linear_theory_behind_its_namesake():
    own = {
        "amplitude_P_a": Label("air pressure: amplitude", "Pa"),
        "energy_duct": Label("  absorbed by the duct", "J/m", "", Group.NUMERICS),
        "rao_heave": Label("  heave of the buoy: divided by the wave amplitude"),
    }
    names = ["noise", "energy_residual", "energy_duct", "linear_amplitude_P_a", "P_inc", "amplitude_P_a"]
    ordered = in_order([*names, "xi", "linear_xi", "rao_heave", "unknown"], own)
    assert ordered == [
        *("xi", "linear_xi", "amplitude_P_a", "linear_amplitude_P_a", "rao_heave", "unknown"),
        *("P_inc", "energy_duct", "energy_residual", "noise"),
    ]
    linear = label_of("linear_amplitude_P_a", True, own)
    assert (linear.text.strip(), linear.unit) == ("air pressure: amplitude: linear theory", "Pa")
    assert short(linear) == "  linear theory" and short(own["amplitude_P_a"]) == "air pressure: amplitude"


def test_linear_theory_stands_beside_the_device_it_covers_only():
    from jaxsph.case.results import case_results

    def linear(case):
        (result,) = (one for one in case_results(case) if one.what == "linear theory")
        return result.make(Record(cast(js.Solution, None), Window(np.ones(1, bool)), 0.0, {"xi": 0.6}))

    assert linear(CASE)["linear_xi"] == pytest.approx(float(js.linear_owc(CASE).xi))
    assert linear(CASE)["linear_amplitude_P_a"] == pytest.approx(abs(complex(js.linear_owc(CASE).P_a)))
    for name in ("owc_slope", "flap_2d"):
        assert linear(js.load_case(name)) == {}
