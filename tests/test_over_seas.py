"""Slopes and searches over a scatter table."""

from pathlib import Path

import numpy as np
import pytest
from conftest import coarse

import jaxsph as js
from jaxsph.errors import CaseError
from jaxsph.study.base import AbstractMethod
from jaxsph.study.scatter import ScatterTable

TABLE = ScatterTable(np.array([0.03, 0.04, 0.05]), np.array([1.3, 1.4, 1.4]), np.array([0.25, 0.75, 0.0]))


class _Parabola(AbstractMethod):
    """Power Hs^2 K exp(-K / 300), with its exact slope and a small error."""

    seen: list

    def derivative(self, case, parameter, of, progress):
        K, height = case.pto.K_dm, case.waves.Hs**2
        self.seen.append((case.waves.Hs, case.waves.Tp))
        value = height * K * np.exp(-K / 300.0)
        slope = height * (1.0 - K / 300.0) * np.exp(-K / 300.0)
        return js.Derivative(parameter, of, value, slope, 1e-9, 0.3 * K, self)


@pytest.fixture
def case():
    sea = {"kind": "irregular", "Hs": 0.04, "Tp": 1.4, "duration": 28.0}
    return js.load_case("owc_irregular").replace({"waves": sea, "tank.length": 4.0, "probes.gauges": []})


def test_the_year_s_slope_is_the_weighted_one_of_its_seas(case):
    seen = []
    found = js.OverSeas(TABLE, _Parabola(seen)).derivative(case, "pto.K_dm", "P_owc", False)
    assert seen == [(0.03, 1.3), (0.04, 1.4)]  # no run for a sea with a share of 0
    seas = (case.replace({"waves.Hs": H}) for H in (0.03, 0.04))
    each = [_Parabola([]).derivative(sea, "pto.K_dm", "P_owc", False) for sea in seas]
    assert found.value == pytest.approx(0.25 * each[0].value + 0.75 * each[1].value)
    assert found.slope == pytest.approx(0.25 * each[0].slope + 0.75 * each[1].slope)
    assert found.error == pytest.approx(1e-9 * np.hypot(0.25, 0.75))


def test_a_search_over_a_year_ends_where_the_mean_power_is_largest(case, tmp_path):
    way = js.OverSeas(TABLE, _Parabola([]))
    start = case.replace({"pto.K_dm": 150.0})
    found = js.maximise(
        start, {"pto.K_dm": (50.0, 2000.0)}, tmp_path / "year.h5", "P_owc", way, progress=False
    )
    # K exp(-K / 300) is largest at 300 and flat there: a fifth away it is 2 % lower
    assert found.case.pto.K_dm == pytest.approx(300.0, rel=0.2)


def test_every_sea_has_a_file_of_its_own():
    way = js.OverSeas(TABLE, js.Ensemble(members=5)).kept(Path("a/00_pto.K_dm.h5"))
    assert way._of_sea(1).out == Path("a/00_pto.K_dm_sea01.h5")
    assert js.OverSeas(TABLE)._of_sea(1).out is None
    assert way.kept(Path("b.h5")).out == way.out  # the path given first stays


def test_what_has_no_meaning_over_a_year_is_refused(case):
    with pytest.raises(CaseError, match="'xi': over a scatter table it must be 'P_owc'"):
        js.OverSeas(TABLE).derivative(case, "pto.K_dm", "xi", False)
    with pytest.raises(CaseError, match='give a case with waves.kind = "irregular"'):
        js.OverSeas(TABLE).derivative(coarse("owc"), "pto.K_dm", "P_owc", False)
