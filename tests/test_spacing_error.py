"""Results without the error of the spacing: their limits, the study, and the command."""

import numpy as np
import pytest
from conftest import coarse
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

import jaxsph as js
from jaxsph.analysis.spacing import Limit, limit
from jaxsph.cli.app import app
from jaxsph.cli.running import _limit_rows
from jaxsph.errors import CaseError
from jaxsph.output.sweep_file import Meanings
from jaxsph.report.labels import with_error_in_words
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
    rows = [f"{label}|{' '.join(value.split())}" for label, value in _limit_rows(found, True)]
    assert rows == ["|limit dx = 0.01 m 0.02 m", "hydrodynamic efficiency|0.710 ± 0.050 0.68 0.65"]


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
