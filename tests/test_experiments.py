"""Reports of experiments: what is kept, what is flagged, and that the gallery shows what is committed."""

import json

import numpy as np
import pytest
from matplotlib.figure import Figure

from experiments import __main__ as table
from experiments import common, damping_study, owc_methods
from experiments.common import Report


@pytest.fixture
def results(tmp_path, monkeypatch):
    for room in (common, table):
        monkeypatch.setattr(room, "RESULTS", tmp_path)
    return tmp_path


def test_report_keeps_rows_pictures_and_columns(results, capsys):
    with Report("sample", "A sample", 0.02) as report:
        report.row("height", 1.23456789, "m", theory=1.0, paper=1.1, bar="within 5 %", passes=False)
        report.row("quiet", "yes", passes=True)
        report.table({"a_m": [1.0, 2.0], "b": [3.0, 1 / 3]})
        report.picture(Figure())
    kept = json.loads((results / "sample.json").read_text())
    assert kept["rows"][0] == {
        "check": "height",
        "here": 1.23457,
        "unit": "m",
        "theory": 1.0,
        "paper": 1.1,
        "bar": "within 5 %",
        "passes": False,
    }
    assert kept["dx"] == 0.02 and kept["pictures"] == ["sample.png"] and (results / "sample.png").exists()
    assert (results / "sample.csv").read_text() == "a_m,b\n1,3\n2,0.333333\n"
    assert "MISSED" in capsys.readouterr().out


def test_an_experiment_that_fails_leaves_its_last_result(results):
    with Report("sample", "A sample") as report:
        report.row("one", 1.0)
    with pytest.raises(RuntimeError), Report("sample", "A sample") as report:
        report.row("one", 2.0)
        raise RuntimeError
    assert json.loads((results / "sample.json").read_text())["rows"][0]["here"] == 1.0


@pytest.mark.parametrize(
    ("here", "paper", "passes", "expected"),
    [
        (1.3, 1.1, False, "MISSED worse than the paper"),
        (1.05, 1.1, True, "ok"),
        (0.8, 1.1, None, "worse than the paper"),
        ("yes", 1.1, True, "ok"),
    ],
)
def test_flags(here, paper, passes, expected):
    assert table.flag({"here": here, "paper": paper, "theory": 1.0, "passes": passes}) == expected


def test_table_counts_what_misses(results, capsys):
    with Report("sample", "A sample", 0.01) as report:
        report.row("one", 1.0, passes=True)
        report.row("two", 2.0, "Pa", theory=1.0, bar="1 %", passes=False)
    table.main([])
    assert "2 rows, 1 outside their bars" in capsys.readouterr().out
    table.main(["other"])
    assert "0 rows" in capsys.readouterr().out
    assert "two 2 Pa (theory 1) **(missed)**" in table.gallery_text()


def test_gallery_is_that_of_the_committed_results():
    assert table.GALLERY.read_text(encoding="utf-8") == table.gallery_text()


def test_optimum_of_a_parabola_in_the_logarithm():
    K_dm = [100.0, 200.0, 400.0, 800.0]
    xi = 0.8 - 0.1 * np.log(np.array(K_dm) / 270.0) ** 2
    found = damping_study.optimum(K_dm, np.stack([xi, np.arange(4.0)]))
    assert found == pytest.approx([270.0, 800.0])  # an end of the range is that end


def test_events_of_the_cycle_are_found_in_its_mean():
    """A level of cos, a power of sin^2: the paper's order of events, in quarters of the period."""
    T = owc_methods.PERIOD
    t = np.arange(0.0, 8 * T, 0.01)
    phase = 2 * np.pi * t / T
    level = np.cos(phase + 0.7)
    power = np.sin(phase + 0.7) ** 2
    found = owc_methods.events({"time": t, "chamber_level": level, "power_pto": power}, 4)
    for when, published in found.values():
        assert when == pytest.approx(published, abs=0.01)  # the samples do not divide the period
