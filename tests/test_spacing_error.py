"""Results without the error of the spacing: their limits, the study, and the command."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from conftest import coarse
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

import jaxsph as js
from jaxsph.analysis.spacing import Limit, limit
from jaxsph.cli.app import app
from jaxsph.cli.spacing import chosen_members, limit_rows, print_errors
from jaxsph.errors import CaseError
from jaxsph.output.sweep_file import Meanings, SweepFile
from jaxsph.report.labels import with_error_in_words
from jaxsph.report.pack import Pack
from jaxsph.report.sweeps import sweep_content
from jaxsph.study import spacing_error
from jaxsph.study.spacing_error import WithError

NUMBERS = st.floats(-100.0, 100.0)
CASE = coarse("wave_tank", {"t1": 0.1})


@given(NUMBERS, NUMBERS, st.floats(0.001, 0.1), st.floats(1.2, 4.0))
def test_an_error_proportional_to_the_spacing_is_removed(exact, slope, dx, ratio):
    spacings = np.array([dx, ratio * dx])
    found = limit(spacings, exact + slope * spacings)
    assert found.value == pytest.approx(exact, abs=1e-9)
    assert found.error == pytest.approx(abs(slope) * dx, abs=1e-9)


@given(NUMBERS, NUMBERS, st.floats(0.6, 4.0))
def test_the_error_covers_errors_of_other_orders(exact, amplitude, order):
    """With half the spacing an error of order p falls to 2^-p. The limit is then wrong by the error times
    2^(1-p) - 1, which is at most the extrapolation for p > 0.585."""
    spacings = np.array([1.0, 2.0])
    found = limit(spacings, exact + amplitude * (spacings / 2.0) ** order)
    assert abs(found.value - exact) <= found.error + 1e-9


def test_scatter_between_runs_widens_the_error():
    dx, rng, covered = np.array([0.01, 0.02, 0.02, 0.02]), np.random.default_rng(0), []
    for _ in range(1000):
        found = limit(dx, 0.7 - 0.001 * dx + rng.normal(0.0, 0.02, 4))
        covered.append(abs(found.value - 0.7) <= found.error)
    assert 0.9 < np.mean(covered) <= 1.0
    assert found.scatter > 0.0 and found.coarse != found.fine


@pytest.mark.parametrize("dx", [[0.02, 0.02], [0.01, 0.02, 0.04]])
def test_two_spacings_are_needed(dx):
    with pytest.raises(ValueError, match=f"results at {len(set(dx))} spacings: two are needed"):
        limit(np.array(dx), np.ones(len(dx)))


def _pretended(monkeypatch, results, failures=None):
    """Replaces the sweep by one that pretends to have run; returns the arguments it was called with."""
    called = {}

    def sweep(source, over, out, **options):
        called.update(source=source, over=over, out=out, **options)
        axes = {name: np.asarray(values) for name, values in over.items()}
        return js.Sweep(source, axes, results, failures or {}, {}, Meanings())

    monkeypatch.setattr(spacing_error, "sweep", sweep)
    return called


def test_the_case_is_run_at_its_spacing_and_at_half_of_it(monkeypatch):
    nan = np.full(4, np.nan)
    called = _pretended(monkeypatch, {"xi": np.array([0.68, 0.64, 0.66, 0.65]), "unknown": nan})
    found = js.with_error(CASE, "any.h5")
    assert called["over"]["dx"] == pytest.approx([0.5 * CASE.dx, *[CASE.dx] * 3])
    densities = called["over"]["fluid.rho0"]
    assert len(set(densities[1:])) == 3 and densities == pytest.approx([CASE.fluid.rho0] * 4, rel=1e-4)
    assert not called["grid"] and found.dx == (CASE.dx, 0.5 * CASE.dx)
    assert found["xi"].value == pytest.approx(0.71) and found["xi"].error > 0.03
    assert list(found.results) == ["xi"]
    with pytest.raises(CaseError, match="no result 'unknown' in all runs; use one of xi"):
        found["unknown"]


def test_the_other_scheme_runs_the_same_case(monkeypatch):
    """Its difference, of which the two schemes are samples, is a part of the error."""
    called, asked = _pretended(monkeypatch, {"xi": np.array([0.68, 0.64, 0.66, 0.65])}), []
    pretended = spacing_error.sweep

    def sweep(source, over, out, **options):
        asked.append((source.scheme.kind, Path(out).name, source.dx))
        done = pretended(source, over, out, **options)
        return done if len(over) > 1 else dataclasses.replace(done, results={"xi": np.array([0.67])})

    monkeypatch.setattr(spacing_error, "sweep", sweep)
    found, plain = js.with_error(CASE, "any.h5", other_scheme=True), js.with_error(CASE, "any.h5")
    kinds = {"weakly_compressible", "incompressible"}
    assert asked[0][1:] == ("any.h5", CASE.dx) and asked[1][1:] == ("any_other_scheme.h5", 0.5 * CASE.dx)
    assert {asked[0][0], asked[1][0]} == kinds and called["grid"] is False
    assert found.error_of_scheme("xi") == pytest.approx(0.01 / np.sqrt(2.0))
    assert found.error("xi") == pytest.approx(np.hypot(found["xi"].error, 0.01 / np.sqrt(2.0)))
    assert np.isnan(plain.error_of_scheme("xi")) and plain.error("xi") == plain["xi"].error
    rows = [" ".join(value.split()) for _, value in limit_rows(found, True)]
    assert rows[0].endswith("other scheme") and rows[1].endswith("0.65 0.67")


def test_a_scheme_that_cannot_run_the_case_is_named():
    flume = js.load_case("owc").replace({"tank.depth": 0.4, "flume": {"length": 2.0, "factor": 2}})
    assert spacing_error.with_other_scheme(js.load_case("owc")).scheme.kind == "weakly_compressible"
    with pytest.raises(CaseError, match="the weakly compressible scheme cannot run this case: "):
        js.with_error(flume, "any.h5", other_scheme=True)
    for command in (["run", "owc"], ["sweep", "owc", "--grid", "pto.K_dm=300,900"]):
        done = CliRunner().invoke(app, [*command, "--other-scheme"])
        assert done.exit_code == 2 and "--other-scheme: needs --error" in done.output


def test_all_runs_have_the_geometry_of_the_case(monkeypatch):
    """At half of the spacing this depth would be rounded to another value."""
    case = CASE.replace({"tank.depth": 10.6 * CASE.dx})
    called = _pretended(monkeypatch, {"steps": np.ones(4), "xi": np.ones(4)})
    found = js.with_error(case, "any.h5")
    assert list(found.results) == ["xi"]
    assert case.built("tank.depth") != case.replace({"dx": 0.5 * case.dx}).built("tank.depth")
    members = [called["source"].replace({"dx": dx}) for dx in called["over"]["dx"]]
    for key in ("tank.depth", "tank.length"):
        assert [one.built(key) for one in members] == pytest.approx([case.built(key)] * 4)


def test_a_failed_run_and_wrong_input_are_named(monkeypatch):
    _pretended(monkeypatch, {"xi": np.ones(4)}, {(0,): "the water left the tank"})
    with pytest.raises(CaseError, match=r"the run with dx = 0\.\d+ m failed: the water left the tank"):
        js.with_error(CASE, "any.h5")
    with pytest.raises(CaseError, match="repeats = 1: must be 2 or more"):
        js.with_error(CASE, "any.h5", repeats=1)
    with pytest.raises(CaseError, match="only the spacing of a case can be changed, and this is a program"):
        js.with_error(CASE.problem(), "any.h5")


def test_the_command_refuses_options_of_a_single_run():
    done = CliRunner().invoke(app, ["run", "owc", "--error", "--overwrite", "--devices", "2"])
    assert done.exit_code == 2
    assert "--error: omit --overwrite and --devices" in done.output


def test_limits_are_printed_next_to_the_values_at_both_spacings():
    found = WithError(
        (0.02, 0.01),
        {"xi": Limit(0.71, 0.05, 0.65, 0.68, 0.01), "whole_energy_in": Limit(1.0, 0.1, 1.0, 1.0, 0.0)},
        js.Sweep(CASE, {}, {}, {}, {}, Meanings()),
    )
    rows = [f"{label}|{' '.join(value.split())}" for label, value in limit_rows(found, True)]
    assert rows == ["|limit dx = 0.01 m 0.02 m", "hydrodynamic efficiency|0.710 ± 0.050 0.68 0.65"]


GRID = {"pto.K_dm": [300, 500.0, 900], "waves.T": [1.2, 1.4]}


@pytest.mark.parametrize(
    "values, members",
    [
        ({}, [(i, j) for i in range(3) for j in range(2)]),
        ({"pto.K_dm": [500]}, [(1, 0), (1, 1)]),
        ({"waves.T": [1.4], "pto.K_dm": [900, 300]}, [(2, 1), (0, 1)]),
    ],
)
def test_members_are_chosen_by_their_values(values, members):
    assert js.members_at(GRID, values) == members


def test_values_that_a_sweep_does_not_have_are_named():
    with pytest.raises(
        CaseError, match=r"waves\.H: not a parameter of the sweep; use one of pto\.K_dm, waves\.T"
    ):
        js.members_at(GRID, {"waves.H": [0.1]})
    command = ["sweep", "owc", "--grid", "pto.K_dm=300,900", "--error-at"]
    done = CliRunner().invoke(app, [*command, "pto.K_dm=500"])
    assert done.exit_code == 2
    assert "--error-at pto.K_dm = 500: no member has this value; use one of 300, 900" in done.output
    assert (
        "--error-at 'pto.K_dm': must be KEY=VALUE" in CliRunner().invoke(app, [*command, "pto.K_dm"]).output
    )


def test_a_sweep_on_a_cluster_cannot_state_errors():
    assert chosen_members(CASE, GRID, [], "tcp://host:8786") == []
    with pytest.raises(CaseError, match="--error-at: omit --scheduler"):
        chosen_members(CASE, GRID, ["pto.K_dm=300"], "tcp://host:8786")


def test_limits_of_members_are_stored_in_the_file_of_the_sweep(monkeypatch, tmp_path):
    """The other results remain, and the page shows the limits beside them."""
    out, runs = tmp_path / "tank.h5", []
    axes = {"waves.H": np.array([0.04, 0.06])}
    members = {k: {"results": {"xi": 0.6 + 0.1 * k}, "series": {}, "failure": ""} for k in range(2)}
    file = SweepFile(out)
    file.write(CASE.to_toml(), axes, (2,), members, Meanings())

    def pretended(case, out, **options):
        runs.append((case.waves.H, out.name))
        limits = {"xi": Limit(0.75, 0.02, 0.7, 0.725, 0.0)}
        return WithError((0.02, 0.01), limits, js.read_sweep(file.path), {"xi": 0.69})

    monkeypatch.setattr(spacing_error, "with_error", pretended)
    print_errors(js.read_sweep(out), [(1,)], out, None, quiet=True)
    assert runs == [(0.06, "tank_error_1.h5")]
    done = js.read_sweep(out)
    np.testing.assert_array_equal(done["xi"], [0.6, 0.7])
    np.testing.assert_array_equal(done["limit xi"], [np.nan, 0.75])
    np.testing.assert_array_equal(done["limit error xi"], [np.nan, 0.02])
    np.testing.assert_allclose(done["scheme error xi"], [np.nan, 0.035 / np.sqrt(2.0)])
    content = sweep_content(file, Pack())
    assert [one["limits"] for one in content["members"]] == [{}, {"xi": (0.75, 0.02)}]
    assert [one["name"] for one in content["choices"]] == ["xi"]
    (row,) = content["members"][1]["rows"]
    assert row["limit"] == "0.750 ± 0.020"


@pytest.mark.slow
def test_a_sweep_states_the_error_at_a_member(tmp_path):
    """Runs two short members, and one of them at both spacings."""
    case, out = tmp_path / "tank.toml", tmp_path / "tank_sweep.h5"
    case.write_text(CASE.to_toml(), encoding="utf-8")
    heights = f"waves.H={CASE.waves.H},{1.5 * CASE.waves.H}"
    command = [
        "sweep",
        str(case),
        "--grid",
        heights,
        "--error-at",
        f"waves.H={CASE.waves.H}",
        "--out",
        str(out),
    ]
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 0, done.output
    found = js.read_sweep(out)
    for name in ("limit noise", "limit error noise"):
        assert np.isfinite(found[name]).tolist() == [True, False]


@pytest.mark.slow
def test_the_command_prints_limits_and_writes_a_page(tmp_path):
    """Runs a short case at both spacings."""
    case, out = tmp_path / "tank.toml", tmp_path / "tank_error.h5"
    case.write_text(CASE.to_toml(), encoding="utf-8")
    done = CliRunner().invoke(app, ["run", str(case), "--error", "--quiet", "--out", str(out)])
    assert done.exit_code == 0, done.output
    again = CliRunner().invoke(app, ["run", str(case), "--error", "--no-report", "--out", str(out)])
    assert f"dx = {0.5 * CASE.dx:g} m" in again.output and " ± " in again.output
    stored = js.read_sweep(out)
    np.testing.assert_allclose(sorted(stored.axes["dx"]), [0.5 * CASE.dx, *[CASE.dx] * 3])
    assert out.with_suffix(".html").exists()


@pytest.mark.parametrize(
    "value, error, words",
    [
        (0.68123, 0.0312, "0.681 ± 0.031"),
        (0.68, 0.0, "0.68"),
        (1234.5, 25.0, "1234 ± 25"),
        (1234.5, 250.0, "1230 ± 250"),
        (2.0, float("nan"), "2"),
    ],
)
def test_values_have_the_digits_that_their_errors_leave(value, error, words):
    assert with_error_in_words(value, error) == words
