"""Reports of experiments: what is kept, what is flagged, and that the gallery shows what is committed."""

import json
import shlex
import types

import numpy as np
import pytest
from matplotlib.figure import Figure
from typer.testing import CliRunner

import jaxsph as js
from experiments import __main__ as runner
from experiments import common, prose, sentences
from experiments.benchmarks.bench_pairs import right_hand_side
from experiments.common import COMMITTED, OWN, Report
from experiments.studies import convergence, damping_study, owc_methods
from experiments.verification import thin_wall


@pytest.fixture
def results(tmp_path, monkeypatch):
    monkeypatch.setattr(Report, "folder", tmp_path)
    return tmp_path


@pytest.fixture
def quick(tmp_path, monkeypatch):
    """Temporary working folder, in which the experiment `thin_wall` makes one row and one picture."""

    def main(t1: float = 4.0) -> None:
        with Report("thin_wall", "A sample") as report:
            report.row("end", t1, "s")
            report.picture(Figure())

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(thin_wall, "main", main)
    monkeypatch.setattr(Report, "folder", OWN)  # restored after the test
    monkeypatch.setattr(Report, "command", "")
    return tmp_path


def called(*args):
    return CliRunner().invoke(runner.app, args)


def test_a_run_of_an_experiment_leaves_what_is_committed_alone(quick):
    before = {path.name: path.stat().st_mtime_ns for path in COMMITTED.iterdir()}
    assert called("run", "thin_wall", "--t1", "2").exit_code == 0
    assert {path.name: path.stat().st_mtime_ns for path in COMMITTED.iterdir()} == before
    found = json.loads((quick / "runs" / "results" / "thin_wall.json").read_text())
    assert found["rows"][0]["here"] == 2.0
    assert found["command"] == "python -m experiments run thin_wall --t1 2"
    assert (quick / "runs" / "results" / "thin_wall.png").exists()
    assert "end" in called("table", "--own").output


def test_only_commit_renews_what_is_committed(quick, monkeypatch):
    monkeypatch.setattr(runner, "COMMITTED", quick / "committed")
    assert called("run", "thin_wall", "--t1", "3", "--commit").exit_code == 0
    found = json.loads((quick / "committed" / "thin_wall.json").read_text())
    assert found["command"] == "python -m experiments run thin_wall --t1 3"
    assert not (quick / "runs").exists()


def test_all_rows_can_be_made_again_and_one_that_fails_stops_no_other(quick, monkeypatch):
    ran = []

    def run(command, cwd, **_):
        ran.append(command[4:])
        done = command[4] == "still_tank"
        if done:
            (cwd / OWN).mkdir(parents=True)
            (cwd / OWN / "still_tank_0.02.json").write_text("{}")
        return types.SimpleNamespace(returncode=0 if done else 1)

    monkeypatch.setattr(runner.subprocess, "run", run)
    monkeypatch.setattr(runner, "COMMITTED", quick / "committed")
    (quick / "committed").mkdir()
    names = ("still_tank", "lattice_stress")
    committed = {file: found for file, found in runner._committed(list(names), COMMITTED)}
    monkeypatch.setattr(runner, "_committed", lambda names: committed.items())
    first = called("again", *names, "--commit")
    assert first.exit_code == 1 and [command[0] for command in ran].count("still_tank") == 1
    assert "failed: python -m experiments run lattice_stress" in first.output
    assert (quick / "committed" / "still_tank_0.02.json").exists()
    assert called("again", *names).exit_code == 1  # what was made is not made again
    assert [command[0] for command in ran].count("still_tank") == 1 and len(ran) == 3


def test_names_of_experiments_and_their_options():
    listed = called("run").output
    assert all(f"  {name} " in listed for name in runner.experiments())
    assert "--incompressible" in called("run", "wave_tank", "--help").output
    wrong = called("run", "wave_tnak")
    assert wrong.exit_code == 2 and "did you mean wave_tank?" in wrong.output
    assert called("run", "wave_tank", "--spacing", "1").exit_code == 2


def test_names_are_of_one_experiment_each_with_a_main():
    files = [path for folder in runner.FOLDERS for path in (common.COMMITTED.parent / folder).glob("*.py")]
    assert len(runner.experiments()) == len(files) - len(runner.FOLDERS)
    assert all(runner.parser(name) for name in runner.experiments())


@pytest.mark.parametrize("found", runner.results(), ids=lambda found: found["title"][:40])
def test_committed_commands_can_be_called(found):
    python, flag, package, verb, name, *options = shlex.split(found["command"])
    assert (python, flag, package, verb) == ("python", "-m", "experiments", "run")
    runner.parser(name).make_context(name, options)


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
    assert runner.flag({"here": here, "paper": paper, "theory": 1.0, "passes": passes}) == expected


def test_table_counts_what_misses(results, monkeypatch):
    with Report("sample", "A sample", 0.01) as report:
        report.row("one", 1.0, passes=True)
        report.row("two", 2.0, "Pa", theory=1.0, bar="1 %", passes=False)
    monkeypatch.setattr(runner, "COMMITTED", results)
    assert "2 rows, 1 outside their limits" in called("table").output
    assert "0 rows" in called("table", "other").output
    assert "two 2 Pa (reference 1) **(missed)**" in runner.gallery_text(results)


def test_gallery_names_the_row_that_another_row_continues(results):
    with Report("sample", "A sample") as report:
        report.row("force", 1.0)
        report.row("the same: deviation", 2.0, "%", passes=True)
        report.row("height", 3.0, passes=True)
        report.row("the same: spread", 4.0, passes=True)
    text = runner.gallery_text(results)
    assert "force: deviation 2 %; height 3; the same: spread 4." in text


def test_gallery_is_that_of_the_committed_results():
    assert runner.GALLERY.read_text(encoding="utf-8") == runner.gallery_text()


def test_optimum_of_a_parabola_in_the_logarithm():
    K_dm = [100.0, 200.0, 400.0, 800.0]
    xi = 0.8 - 0.1 * np.log(np.array(K_dm) / 270.0) ** 2
    found = damping_study.optimum(K_dm, np.stack([xi, np.arange(4.0)]))
    assert found == pytest.approx([270.0, 800.0])  # an optimum at the end of the range is that end


def test_events_of_the_cycle_are_found_in_its_mean():
    """With a level of cos and a power of sin^2 the events have the paper's order, in quarters of a period."""
    T = owc_methods.PERIOD
    t = np.arange(0.0, 8 * T, 0.01)
    phase = 2 * np.pi * t / T
    level = np.cos(phase + 0.7)
    power = np.sin(phase + 0.7) ** 2
    found = owc_methods.events({"time": t, "chamber_level": level, "power_pto": power}, 4)
    for when, published in found.values():
        assert when == pytest.approx(published, abs=0.01)  # the period is not a whole number of samples


QUIET = [0.0, 0.0, 0.0]


@pytest.mark.parametrize("order", [0.8, 1.0, 1.7])
def test_richardson_finds_the_limit_of_its_own_law(order):
    dx = [0.02, 0.01, 0.005]
    found = convergence.richardson(dx, [0.7 - 3.0 * h**order for h in dx], QUIET)
    assert found.value == pytest.approx(0.7, rel=1e-12) and found.order == pytest.approx(order)
    # the error is 1.25 times the remaining difference from the limit
    assert found.error == pytest.approx(1.25 * 3.0 * 0.005**order)


@pytest.mark.parametrize(
    ("dx", "values", "errors", "why"),
    [
        ([0.02, 0.01, 0.005], [0.5, 0.6, 0.58], QUIET, "not monotone"),
        ([0.02, 0.01, 0.005], [0.5, 0.6, 0.6], QUIET, "not monotone"),
        ([0.02, 0.01, 0.005], [0.5, 0.6, 0.61], [0.0, 0.01, 0.01], "scatters"),
        ([0.02, 0.01, 0.005], [0.5, 0.6, 0.68], QUIET, "too low for an extrapolation"),
        ([0.02, 0.01, 0.005], [0.5, 0.6, 0.75], QUIET, "too low for an extrapolation"),
        ([0.02, 0.01, 0.008], [0.5, 0.6, 0.62], QUIET, "constant ratio"),
        ([0.02, 0.01], [0.5, 0.6], [0.0, 0.0], "constant ratio"),
    ],
)
def test_richardson_gives_the_spread_where_there_is_no_limit(dx, values, errors, why):
    found = convergence.richardson(dx, values, errors)
    assert found.value is None and why in found.why
    assert found.error == pytest.approx(max(values) - min(values))


def test_richardson_trusts_no_order_above_two():
    found = convergence.richardson([0.02, 0.01, 0.005], [0.5, 0.66, 0.67], [0.0, 0.001, 0.002])
    assert found.order == pytest.approx(4.0) and "taken as 2" in found.why
    assert found.value == pytest.approx(0.67 + 0.01 / 3.0)
    # 1.25 times the remaining difference, and the scatter of the two finest values, propagated
    own = np.hypot(4.0 / 3.0 * 0.002, 0.001 / 3.0)
    assert found.error == pytest.approx(np.hypot(1.25 * 0.01 / 3.0, own))


def test_convergence_is_of_one_device_by_two_schemes():
    for kind in convergence.SCHEMES:
        cases = [convergence.study_case(kind, dx) for dx in convergence.SPACINGS]
        assert all(case.scheme.kind == kind for case in cases)
        assert len({js.linear_owc(case).water.geometry for case in cases}) == 1


def test_convergence_reports_the_runs_that_are_there(results, monkeypatch, tmp_path):
    """One scheme has runs, with xi = 0.6 - 5 dx, the other has none: only what was asked for is run."""

    def found(dx):
        values = {"xi": 0.6 - 5.0 * dx, "P_a": 130.0, "flow": 0.02}
        energies = {"energy_paddle": 2.0, "energy_pto": 1.0, "energy_residual": 0.02, "energy_sponge": 0.0}
        return convergence.Found(values, dict.fromkeys(values, 1e-4), energies | {"t_end": 14.0}, 10.0)

    runs = {"incompressible": {dx: found(dx) for dx in convergence.SPACINGS}, "weakly_compressible": {}}
    monkeypatch.setattr(convergence, "_runs", lambda kind, asked, t1: runs[kind])
    convergence.main()
    kept = json.loads((results / "convergence.json").read_text())
    rows = {row["check"]: row for row in kept["rows"]}
    assert rows["incompressible: xi, extrapolated to zero spacing (order 1)"]["here"] == pytest.approx(0.6)
    assert rows["incompressible: pressure amplitude, extrapolated to zero spacing"]["here"] == "not monotone"
    assert rows["incompressible: change of xi from 20 to 10 mm"]["passes"] is False
    assert rows["incompressible, 5 mm: energy (pto), over the paddle's work"]["here"] == 50.0
    assert not any("sponge" in check or check.startswith("weakly") for check in rows)
    assert rows["linear theory, zeta = 0: xi"]["here"] == pytest.approx(0.779, abs=1e-3)
    assert kept["seconds"] == 420.0
    assert len((results / "convergence.csv").read_text().splitlines()) == 4


def test_convergence_passes_over_runs_that_are_not_there(monkeypatch, tmp_path):
    monkeypatch.setattr(common, "RUNS", tmp_path)
    assert convergence._runs("incompressible", ((0.01,), ("weakly_compressible",)), 14.0) == {}


def test_numbers_in_prose_are_those_of_the_committed_results():
    results = prose.Results()
    for page in sentences.pages():
        text = (sentences.ROOT / page).read_text(encoding="utf-8")
        assert prose.renewed(page, text, results, sentences.PROSE) == text, (
            f"{page}: run `python -m experiments gallery`"
        )


def test_numbers_in_prose_follow_the_results_and_nothing_else_changes(tmp_path):
    (tmp_path / "tank.json").write_text(
        json.dumps(
            {
                "rows": [
                    {"check": "a", "here": -0.04},
                    {"check": "a", "here": 1234.5},
                    {"check": "b", "here": 2},
                ]
            }
        )
    )
    results = prose.Results(tmp_path)
    assert results("tank", "a", after="a") == 1234.5
    for check, after in (("c", None), ("b", "c"), ("a", "b")):
        with pytest.raises(KeyError, match="tank has no row"):
            results("tank", check, after)
    sentence = prose.Sentence(
        "lost {:z.1f} % and gained {:,.0f} N", lambda r: (r("tank", "a"), r("tank", "a", "a")), ("p",)
    )
    page = "In 3 tanks, lost 17 % and\ngained -1e-3 N. 4 more"
    assert (
        prose.renewed("p", page, results, (sentence,)) == "In 3 tanks, lost 0.0 % and\ngained 1,234 N. 4 more"
    )
    for text in ("nothing", page + page):
        with pytest.raises(ValueError, match=r"p has 'lost .* it must occur once"):
            prose.renewed("p", text, results, (sentence,))


def test_pair_sums_are_evaluated_for_given_inputs():
    """Uniform water: the divergence of the positions is 2 inside, and gradients and rates vanish."""
    n, dx = 24, 0.01
    x, y = (a.ravel().astype(np.float32) for a in np.meshgrid(*[dx * np.arange(n)] * 2, indexing="ij"))
    zero = np.zeros_like(x)
    given = {"x": x, "y": y, "u": zero, "v": zero, "rho": zero + 1000.0, "volume": zero + dx**2}
    given |= {"h": 1.2 * dx, "radius": 3.6 * dx, "dx": dx, "c0": 10.0, "rho0": 1000.0, "delta": 0.1}
    evaluate, found = right_hand_side(given | {"alpha": 0.01})
    inside = (np.abs(x - x.mean()) < 6 * dx) & (np.abs(y - y.mean()) < 6 * dx)
    for name, values in found.items():
        expected = 2.0 if name == "position_divergence" else 0.0
        np.testing.assert_allclose(values[inside], expected, atol=0.01, err_msg=name)
    evaluate()
