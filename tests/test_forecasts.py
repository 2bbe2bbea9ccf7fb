"""Notices before a run about its averages and its reflection coefficient; no simulation is run."""

import types
from typing import cast

import numpy as np
import pytest

import jaxsph as js
from jaxsph.analysis.periods import whole_periods
from jaxsph.case.geometry import Geometry
from jaxsph.case.linear import incident_energy, incident_power
from jaxsph.case.results import SettledPeriods, _power, incident_over
from jaxsph.case.settling import FEW, settled_periods
from jaxsph.model.meaning import Exchange
from jaxsph.problem.record import Record, Window
from jaxsph.report.doubts import doubts
from jaxsph.report.labels import label_of, short
from jaxsph.waves.second_order import wavenumbers

OWC = js.load_case("owc")
SEA = js.load_case("owc_irregular")
GAUGES = [2.0, 2.3, 2.75]


def notice(case, start):
    """Notice of a case that contains the text `start`; empty if no notice contains it."""
    found = [one for one in case.notices() if start in one]
    assert len(found) < 2
    return found[0] if found else ""


def of_part(case):
    return notice(case, "the averages cover")


def recorded(case):
    """Record without a power, of a run to the case's t1."""
    t = np.arange(0.0, case.t1 + 1e-9, 0.1)
    periods = settled_periods(case, case.t1)
    window = Window(whole_periods(t, case.waves.cycle, periods), periods)
    model = types.SimpleNamespace(entries=dict)
    solution = cast(js.Solution, types.SimpleNamespace(t=t, series={"time": t}, model=model))
    return Record(solution, window, 0.0, {})


# --- parts of a sea


def test_a_part_of_a_sea_with_another_power_is_told_before_the_run_and_after_it():
    part = SEA.replace({"t1": 40.0})
    periods = settled_periods(part, 40.0)
    ratio = incident_over(part, 40.0, periods) / incident_power(part)
    text = of_part(part)
    assert f"cover {periods} of 60 peak periods of the sea; the waves of this part carry {ratio:.2f}" in text
    assert "absorbed powers are not those of the sea: compare efficiencies, or raise t1 to" in text
    assert SettledPeriods(part).notices(recorded(part), {}) == [text]
    assert text not in part.notices(ended=True)  # the run's own notice replaces it
    longer = SEA.replace({"t1": float(text.rsplit("t1 to ", 1)[1].removesuffix(" s"))})
    assert settled_periods(longer, longer.t1 - longer.output.sample_dt) == 60 and not of_part(longer)


def test_a_part_with_nearly_the_power_of_the_sea_is_not_told():
    ends = np.arange(40.0, 90.0, 2.0)
    ratios = [incident_over(SEA, t, settled_periods(SEA, t)) / incident_power(SEA) for t in ends]
    unlike = np.abs(np.array(ratios) - 1.0) > 0.1
    assert 0 < np.sum(unlike) < len(ends)
    assert [bool(of_part(SEA.replace({"t1": t}))) for t in ends[-4:]] == list(unlike[-4:])


def test_energy_of_a_part_is_the_integral_of_the_power():
    """A repetition carries the mean power; parts add up; within a wave the power varies as 2 cos^2."""
    whole = incident_energy(SEA, 3.0, 10.0, 94.0)
    assert whole == pytest.approx(84.0 * incident_power(SEA), rel=1e-6)  # the power is summed in float32
    assert incident_energy(SEA, 3.0, 10.0, 31.0) + incident_energy(SEA, 3.0, 31.0, 94.0) == pytest.approx(
        whole, rel=1e-9
    )
    P, T = incident_power(OWC), OWC.waves.T
    assert incident_energy(OWC, 0.0, 0.0, 0.5 * T) == pytest.approx(0.5 * T * P, rel=1e-6)
    quarter = incident_energy(OWC, 0.0, -T / 8, T / 8)
    assert quarter == pytest.approx(0.25 * T * P * (1.0 + 2.0 / np.pi), rel=1e-6)
    # an eighth of a wavelength further the crest comes an eighth of a period later
    k = float(wavenumbers(np.array([2.0 * np.pi / T]), Geometry.of(OWC).depth, OWC.g)[0])
    assert incident_energy(OWC, 0.25 * np.pi / k, 0.0, T / 4) == pytest.approx(quarter, rel=1e-6)


def test_the_incident_power_says_of_which_waves_it_is():
    part = SEA.replace({"t1": 40.0})
    made = _power(part, recorded(part))
    assert made["P_inc_sea"] == pytest.approx(incident_power(part))
    assert made["P_inc"] == pytest.approx(incident_over(part, 40.0, settled_periods(part, 40.0)))
    assert "P_inc_sea" not in _power(SEA, recorded(SEA))
    assert label_of("P_inc", True).text == "incident power over the averaged periods"
    assert short(label_of("P_inc_sea", True)).strip() == "of the whole sea"
    assert label_of("P_inc_sea", False).unit == "W/m"
    assert dict(js.check(SEA))["incident power"].endswith("W per metre of width, mean of the whole sea")


def test_the_power_in_the_whole_sea_has_the_efficiency_of_the_part():
    part = SEA.replace({"t1": 40.0})
    made, taken = recorded(part), types.SimpleNamespace(exchange=Exchange.HARVESTED)
    series = {"power_pto": 1.0 + np.sin(made.t)}
    model = types.SimpleNamespace(entries=lambda: {"pto": taken})

    class Recorded(types.SimpleNamespace):
        def __getitem__(self, name):
            return self.series[name]

    solution = cast(js.Solution, Recorded(t=made.t, series=series, model=model))
    made = _power(part, made._replace(solution=solution))
    assert made["P_owc_sea"] / made["P_inc_sea"] == pytest.approx(made["P_owc"] / made["P_inc"])
    assert made["P_owc_sea"] != pytest.approx(made["P_owc"], rel=1e-3)


def test_a_repetition_of_a_sea_is_averaged_without_a_notice():
    assert not [one for one in SEA.notices() if "repeats" in one or "averages" in one]
    group = js.load_case("focused_wave").replace({"t1": 95.0})
    assert "the wave group repeats after 89.6 s; use a smaller t1" in notice(group, "repeats")


# --- settled periods


@pytest.mark.parametrize("changes", [{"t1": 3.0}, {"t1": 11.0}, {"t1": 14.0, "output.periods": 3}])
def test_a_t1_that_is_too_short_is_told_with_one_that_is_not(changes):
    """The rule is that of the doubts about the results."""
    case = OWC.replace(changes)
    text = notice(case, "the waves settle at about t = ")
    left = max(int((case.t1 - 9.414) / 1.2), 0)
    assert (
        f"the waves settle at about t = 9.414 s; t1 = {case.t1:g} s leaves {left or 'no'} whole period"
        in text
    )
    t1 = float(text.split("use t1 = ")[1].split(" s")[0])
    changed = {"t1": t1} | ({"output.periods": FEW} if "output.periods = 5" in text else {})
    enough = case.replace(changed)
    assert not notice(enough, "the waves settle at about")
    for one, doubtful in ((case, True), (enough, False)):
        periods = settled_periods(one, one.t1 - one.output.sample_dt)
        results = {"t_end": 1.0} | ({"periods": float(periods)} if periods > 0 else {})
        assert bool(doubts(results, True)) == doubtful


def test_the_return_of_reflected_waves_is_told_before_the_run():
    """The same t1 as in the notice of the run, see `test_means_before_the_second_reflection_say_so`."""
    assert "raise t1 to 35.04 s for the final xi" in notice(OWC.replace({"t1": 22.8}), "averaging starts at")
    assert "or more (t1 = 35.04 s or more if the device reflects" in notice(
        OWC.replace({"t1": 11.0}), "the waves settle at"
    )
    assert not notice(OWC, "averaging starts at")


# --- gauges


@pytest.mark.parametrize(
    ("gauges", "message"),
    [
        ([2.0, 3.0], "three gauges or more are needed between x = 0.42 and .* but there are 2"),
        ([2.0, 2.981, 3.962], "gauges at .* cannot separate incident and reflected waves"),
    ],
)
def test_gauges_without_a_reflection_are_told_before_the_run(gauges, message):
    """The texts of `test_a_run_that_has_ended_does_not_die_in_its_results`."""
    text = notice(OWC.replace({"probes.gauges": gauges}), "reflection: ")
    with pytest.raises(AssertionError, match=f"no result for the reflection: {message}"):
        raise AssertionError(text)
    for others in (GAUGES, []):
        assert not notice(OWC.replace({"probes.gauges": others}), "reflection")


# --- linear theory and heights


def test_check_gives_the_linear_theory_of_a_sea():
    rows, sea = dict(js.linear_check(SEA)), js.linear_sea(SEA)
    assert rows["linear efficiency"] == f"{sea.xi:.3g} (mean of the whole sea)"
    assert rows["linear power"] == f"{sea.P_owc:.4g} W per metre of width"


def test_a_height_of_three_spacings_is_three_in_spite_of_rounding():
    scale = {"dx": 1.6, "t1": 300.0, "tank": {"length": 800.0, "depth": 32.0}}
    waves = {"waves": {"H": 4.8, "T": 10.0}, "output": {"sample_dt": 0.1, "snapshot_dt": 1.0}}
    case = js.Case.from_dict(scale | waves)
    assert case.waves.H < 3 * case.dx and not notice(case, "spacings high")
    assert "2.9 spacings high" in notice(case.replace({"waves.H": 4.64}), "spacings high")
