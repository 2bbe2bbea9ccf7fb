"""Power matrices, scatter tables, and linear theory in irregular seas."""

import functools
import re

import numpy as np
import pytest
import scipy.io
from typer.testing import CliRunner

import jaxsph as js
from jaxsph.cli.app import app
from jaxsph.output.plot.matrix import draw_matrix
from jaxsph.output.sweep_file import Meanings, SweepFile
from jaxsph.report.labels import with_error_in_words
from jaxsph.report.pack import Pack
from jaxsph.report.sweeps import sweep_content
from jaxsph.study.fast_model import FastModel
from jaxsph.study.matrix import matrix_of, of_the_sea
from jaxsph.waves import second_order, spectra
from jaxsph.waves.linear_owc import linear_response
from jaxsph.waves.linear_sea import integrated_sea_response, linear_sea_response
from jaxsph.waves.radiation import ChamberGeometry, radiation_and_scattering

CHAMBER = ChamberGeometry(0.42, 0.13, 0.16, 0.02)
DURATION = 128 * 1.4
SEA = spectra.draw_sea(spectra.JONSWAP(0.04, 1.4), DURATION, 1)
CASE = js.load_case("owc").replace({"waves": {"kind": "irregular", "Hs": 0.04, "Tp": 1.4}})

# --- linear theory


def test_a_sea_of_one_wave_has_a_gaussian_turbine_of_its_own():
    """The linearised resistance is 8/(3 pi) K^2 |q| for a sine and 2/sqrt(pi) K^2 |q|, 1.33 times as much,
    for a Gaussian flow of the same amplitude.

    With K^2 reduced by this factor the results are equal, to rounding.
    """
    a, omega = np.array([0.02 + 0j]), np.array([2.0 * np.pi / 1.2])
    ratio = np.sqrt(8.0 / (3.0 * np.pi) / (2.0 / np.sqrt(np.pi)))
    sea = linear_sea_response(CHAMBER, a, omega, 500.0 * ratio)
    regular = linear_response(radiation_and_scattering(CHAMBER, omega[0]), 0.04, 500.0)
    assert sea.xi == pytest.approx(float(regular.xi), rel=1e-6)
    assert sea.P_inc == pytest.approx(float(regular.P_inc), rel=1e-5)  # the group velocity in float32
    assert sea.sigma_q * np.sqrt(2.0) == pytest.approx(abs(regular.q), rel=1e-6)


def test_integrated_response_of_a_sine_is_near_its_describing_function():
    """They differ by the third harmonic of |q| q, a fifth of the first: by its square at most, 1 % here."""
    a, omega = np.array([0.02 + 0j]), np.array([2.0 * np.pi / 1.2])
    whole = integrated_sea_response(CHAMBER, a, omega, 500.0, 1.2)
    regular = linear_response(radiation_and_scattering(CHAMBER, omega[0]), 0.04, 500.0)
    assert whole.xi == pytest.approx(float(regular.xi), rel=0.01)


@pytest.mark.parametrize(("K_dm", "bar"), [(150.0, 0.05), (534.66, 0.03), (1500.0, 0.05)])
def test_stochastic_linearisation_has_the_turbine_s_mean_power(K_dm, bar):
    """In a sea of 128 waves, to 2.5 % at the built-in damping; elsewhere the flow is less Gaussian."""
    linear = linear_sea_response(CHAMBER, *SEA, K_dm)
    whole = integrated_sea_response(CHAMBER, *SEA, K_dm, DURATION)
    assert whole.P_owc == pytest.approx(linear.P_owc, rel=bar)
    assert whole.P_inc == pytest.approx(linear.P_inc)


def test_integrated_response_conserves_energy_in_the_open_and_closed_chamber():
    """Nothing is absorbed without damping, and almost nothing by a closed chamber."""
    assert linear_sea_response(CHAMBER, *SEA, 0.0).P_owc == 0.0
    assert linear_sea_response(CHAMBER, *SEA, 1e6).xi < 0.01
    with pytest.raises(ValueError, match="does not repeat"):
        integrated_sea_response(CHAMBER, *SEA, 500.0, 100.0)
    with pytest.raises(ValueError, match="must not be negative"):
        linear_sea_response(CHAMBER, *SEA, -1.0)


def test_linear_theory_of_a_case_s_sea():
    found = js.linear_sea(CASE)
    assert 0.4 < found.xi < 0.7 and found.P_inc == pytest.approx(js.incident_power(CASE), rel=1e-4)
    with pytest.raises(js.CaseError, match="use linear_owc"):
        js.linear_sea(js.load_case("owc"))
    with pytest.raises(js.CaseError, match="no waves are given"):
        js.linear_sea(js.load_case("vessel"))
    with pytest.raises(js.CaseError, match=r'waves.kind = "irregular"'):
        js.linear_owc(CASE)


# --- matrices


def a_sweep(powers, errors=0.1):
    """A sweep over two heights, three periods and two seeds, without runs."""
    axes = {
        "waves.Hs": np.array([0.02, 0.04]),
        "waves.Tp": np.array([1.2, 1.4, 1.6]),
        "waves.seed": np.arange(2),
    }
    P_inc = np.full((2, 3, 2), 2.0)
    results = {
        "P_owc": powers,
        "xi": powers / 2.0,
        "xi_error": np.full((2, 3, 2), errors / 2.0),
        "P_inc": P_inc,
    }
    failures = {tuple(map(int, i)): "lost" for i in np.argwhere(np.isnan(powers))}
    return js.Sweep(CASE, axes, results, failures, {})


POWERS = np.arange(12.0).reshape(2, 3, 2)


def test_a_cell_is_the_mean_over_its_seeds_with_their_error():
    """Two seeds differ by 1: the standard error of their mean is 0.5, more than the runs' own 0.1/sqrt(2)."""
    matrix = matrix_of(a_sweep(POWERS))
    np.testing.assert_allclose(matrix.P, POWERS.mean(axis=2))
    np.testing.assert_allclose(matrix.error, 0.5)
    np.testing.assert_allclose(matrix_of(a_sweep(POWERS, 3.0)).error, 3.0 / np.sqrt(2.0))
    np.testing.assert_allclose(matrix.xi, matrix.P / 2.0)
    assert matrix.linear[1, 1] == pytest.approx(js.linear_sea(CASE).P_owc)
    assert np.all(np.diff(matrix.linear, axis=0) > 0.0)


def test_the_power_of_a_part_of_a_sea_is_scaled_to_the_whole_sea():
    """The waves of one run of two carry 1.6 times the power of the sea: its efficiency counts."""
    done = a_sweep(POWERS, 3.0)
    done.results["P_inc_sea"] = np.full(POWERS.shape, np.nan)
    done.results["P_inc_sea"][0, 0, 1] = 1.25
    matrix = matrix_of(done)
    np.testing.assert_allclose(matrix.P[0, 0], 0.5 * (POWERS[0, 0, 0] + POWERS[0, 0, 1] / 1.6))
    np.testing.assert_allclose(matrix.error[0, 0], 0.5 * 3.0 * np.hypot(1.0, 1.0 / 1.6))
    np.testing.assert_allclose(matrix.P[1], POWERS[1].mean(axis=1))
    np.testing.assert_allclose(matrix.xi, POWERS.mean(axis=2) / 2.0)


def test_a_year_is_the_weighted_mean_with_its_error(tmp_path):
    """For cells, and for a sea state in the middle of four cells."""
    matrix = matrix_of(a_sweep(POWERS))
    (tmp_path / "a.csv").write_text("Hs (m),Tp (s),share\n0.02,1.2,0.5\n0.04,1.6,0.5\n")
    year = matrix.annual(js.ScatterTable.read(tmp_path / "a.csv"))
    assert year.value == pytest.approx(0.5 * (POWERS[0, 0].mean() + POWERS[1, 2].mean()))
    assert year.error == pytest.approx(0.5 * np.hypot(0.5, 0.5))
    (tmp_path / "b.csv").write_text("hours,Hs,Tp\n8766,0.03,1.3\n0,9,9\n")
    table = js.ScatterTable.read(tmp_path / "b.csv")
    year = matrix.annual(table)
    assert table.hours == 8766.0
    assert year.value == pytest.approx(POWERS[:, :2].mean()) and year.error == pytest.approx(0.25)


@functools.cache
def a_model():
    """Linear theory of the device, as a fast model."""
    return FastModel.of_theory(js.load_case("owc"), (1.2, 1.6))


def of_model(Hs, Tp):
    """Its mean power in a sea, W/m."""
    return float(a_model().results({"waves.Hs": Hs, "waves.Tp": Tp})["P_owc"])


def like_the_model(tilt):
    """Powers in the runs of `a_sweep`: 0.9 times those of the model, and more by `tilt` in higher waves."""
    cells = [[of_model(Hs, Tp) for Tp in (1.2, 1.4, 1.6)] for Hs in (0.02, 0.04)]
    return 0.9 * np.stack(2 * [np.array(cells)], axis=2) * np.array([1.0, 1.0 + tilt])[:, None, None]


BETWEEN = js.ScatterTable(np.array([0.03, 0.033, 0.05]), np.array([1.3, 1.5, 1.2]), np.array([0.5, 0.3, 0.2]))
"""Seas that differ from those of the runs; one is higher than all of them."""


def test_a_model_gives_the_power_between_and_beyond_the_runs():
    """Powers in a fixed ratio to a model have this ratio in every sea; interpolated linearly they are too
    large, since they grow more than in proportion to the height."""
    found = matrix_of(a_sweep(like_the_model(0.0))).annual(BETWEEN, a_model())
    assert found.value == pytest.approx(0.9 * float(a_model().annual(BETWEEN)), rel=1e-5)
    assert found.between == pytest.approx(0.0, abs=1e-5) and np.isnan(found.spacing)
    # the seeds agree, and each run has an error of 5 % of 2 W/m
    assert found.error == pytest.approx(found.waves) and 0.0 < found.waves < 0.1
    inner = js.ScatterTable(np.array([0.03]), np.array([1.4]), np.array([1.0]))
    rough = matrix_of(a_sweep(like_the_model(0.0))).annual(inner)
    assert rough.value > 1.05 * 0.9 * of_model(0.03, 1.4) and np.isnan(rough.between)


def test_ratios_that_differ_are_an_error_of_seas_without_runs():
    matrix = matrix_of(a_sweep(like_the_model(0.1)))
    found = matrix.annual(BETWEEN, a_model())
    # three ratios are 0.9, and three are 0.99
    scatter = np.std(3 * [0.9] + 3 * [0.99], ddof=1) / 0.945
    assert found.between == pytest.approx(scatter * found.value, rel=1e-4)
    runs = js.ScatterTable(np.array([0.02, 0.04]), np.array([1.2, 1.6]), np.array([0.4, 0.6]))
    exact, modelled = matrix.annual(runs), matrix.annual(runs, a_model())
    assert modelled.value == pytest.approx(exact.value, rel=1e-6)
    assert modelled.waves == pytest.approx(exact.waves, rel=1e-6) and modelled.between == exact.between == 0.0
    half = js.ScatterTable(np.array([0.04, 0.04]), np.array([1.2, 1.3]), np.array([1.0, 1e-9]))
    assert matrix.annual(half, a_model()).between == pytest.approx(0.0, abs=1e-8)


def test_one_run_has_the_error_of_the_model(monkeypatch):
    monkeypatch.setattr(FastModel, "error", {"xi": 0.03})
    axes = {"waves.Hs": np.array([0.03]), "waves.Tp": np.array([1.3]), "waves.seed": np.arange(1)}
    results = {"P_owc": np.full((1, 1, 1), 0.2), "P_inc": np.ones((1, 1, 1))}
    found = matrix_of(js.Sweep(CASE, axes, results, {}, {})).annual(BETWEEN, a_model())
    part = 1.0 - 0.5 * of_model(0.03, 1.3) / float(a_model().annual(BETWEEN))
    assert found.between == pytest.approx(0.03 * part * found.value, rel=1e-5)


def test_seas_and_devices_beyond_a_model_are_refused():
    matrix = matrix_of(a_sweep(POWERS))
    far = js.ScatterTable(np.array([0.03]), np.array([2.4]), np.array([1.0]))
    with pytest.raises(js.CaseError, match=r"no power at Hs = 0\.03 m, Tp = 2\.4 s, which is outside"):
        matrix.annual(far, a_model())
    with pytest.raises(js.CaseError, match="that of another kind of device"):
        matrix.annual(far, FastModel.of_theory(js.load_case("buoy_heave")))


def test_a_matrix_of_a_buoy_takes_its_model():
    """Linear theory of bodies needs regular waves, which the case of a matrix does not have."""
    buoy = js.load_case("buoy_heave")
    model = FastModel.of_theory(buoy, (1.1, 1.3))
    P = np.array([float(model.results({"waves.Hs": 0.03, "waves.Tp": T})["P_pto"]) for T in (1.1, 1.3)])
    axes = {"waves.Hs": np.array([0.03]), "waves.Tp": np.array([1.1, 1.3]), "waves.seed": np.arange(1)}
    sea = buoy.replace({"waves": {"kind": "irregular", "Hs": 0.03, "Tp": 1.2}})
    results = {"P_pto": 1.1 * P.reshape(1, 2, 1), "P_inc": np.ones((1, 2, 1))}
    table = js.ScatterTable(np.array([0.03]), np.array([1.2]), np.array([1.0]))
    found = matrix_of(js.Sweep(sea, axes, results, {}, {})).annual(table, model)
    assert found.value == pytest.approx(1.1 * float(model.annual(table)), rel=1e-5)


def test_the_error_of_the_spacing_is_that_of_the_members_which_have_limits():
    """Limits that are 3 % smaller, with an error of 4 %: together 5 %."""
    done = a_sweep(like_the_model(0.0))
    for name, share in (("limit P_owc", 0.97), ("limit error P_owc", 0.04)):
        done.results[name] = np.full(POWERS.shape, np.nan)
        done.results[name][1, 1, 0] = share * done.results["P_owc"][1, 1, 0]
    found = matrix_of(done).annual(BETWEEN, a_model())
    assert found.spacing == pytest.approx(0.05 * found.value) and np.isnan(found.scheme)
    assert found.error == pytest.approx(np.hypot(np.hypot(found.waves, found.between), found.spacing))


def test_the_error_of_the_scheme_is_that_of_the_members_which_both_schemes_ran():
    """Errors of 2 and 4 % of the power without the error of the spacing."""
    done = a_sweep(like_the_model(0.0))
    for name in ("limit P_owc", "limit error P_owc", "scheme error P_owc"):
        done.results[name] = np.full(POWERS.shape, np.nan)
    for place, share in (((1, 1, 0), 0.02), ((0, 1, 0), 0.04)):
        limit = 1.1 * done.results["P_owc"][place]
        for name, value in (("limit", 1.0), ("limit error", 0.0), ("scheme error", share)):
            done.results[f"{name} P_owc"][place] = value * limit
    found = matrix_of(done).annual(BETWEEN, a_model())
    assert found.scheme == pytest.approx(np.hypot(0.02, 0.04) / np.sqrt(2.0) * found.value, rel=1e-4)
    assert found.error == pytest.approx(np.linalg.norm(found[1:]))


def test_a_table_of_a_site_becomes_one_of_the_model(tmp_path):
    (tmp_path / "site.csv").write_text("Hs,Tp,hours\n1.6,8.4,600\n0.8,7.2,400\n")
    site = js.ScatterTable.read(tmp_path / "site.csv")
    model = site.at_scale(40.0)
    np.testing.assert_allclose(model.Hs, [0.04, 0.02])
    np.testing.assert_allclose(model.Tp * np.sqrt(40.0), site.Tp)
    assert model.period == ("1,000 h of the table", 1000.0) and np.all(model.share == site.share)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("Hs,Tp,share\n0.02,1.2,0.5\n", "the shares must add up to 1, but add up to 0.5"),
        ("Hs,Tp,hours\n0.02,1.2,-5\n", "values of hours must not be negative"),
        ("Hs,Tp\n0.02,1.2\n", "must name the columns Hs"),
        ("Hs (ft),Tp,share\n0.02,1.2,1\n", "line 1 .*: Hs must be in m"),
        ("Hs;Tp;share\n0.02;1.2;1\n", r"must name the columns Hs \(m\), Tp \(s\), share .* by commas"),
        ("Hs\\Tp,1.2,1.4\n0.02,1,2\n", "must name the columns"),
        ("Hs,Tp,share\n0.06,1.2,1\n", "Hs = 0.06 m, but the matrix covers only 0.02 to 0.04 m"),
        ("Hs,Tp,share\n0.02,1.7,1\n", "the table has Tp = 1.7 s, but the matrix covers only"),
    ],
)
def test_a_table_that_does_not_fit_is_refused(tmp_path, text, words):
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(js.CaseError, match=words):
        matrix_of(a_sweep(POWERS)).annual(js.ScatterTable.read(tmp_path / "a.csv"))


def test_cells_that_failed_are_not_averaged_away(tmp_path):
    powers = POWERS.copy()
    powers[0, 0, 1] = np.nan
    assert matrix_of(a_sweep(powers)).P[0, 0] == powers[0, 0, 0]
    powers[0, 0, 0] = np.nan
    matrix = matrix_of(a_sweep(powers))
    assert np.isnan(matrix.P[0, 0])
    table = js.ScatterTable(np.array([0.02]), np.array([1.2]), np.array([1.0]))
    with pytest.raises(js.CaseError, match="no mean power for some sea states"):
        matrix.annual(table)
    beside = js.ScatterTable(np.array([0.04]), np.array([1.6]), np.array([1.0]))
    assert matrix.annual(beside).value == POWERS[1, 2].mean()
    figure = draw_matrix(matrix)
    assert "failed" in [text.get_text() for text in figure.axes[0].texts]
    assert [ax.get_title(loc="left") for ax in figure.axes] == ["mean power, W/m", "linear theory, W/m"]


def test_what_makes_no_matrix_is_refused(tmp_path):
    out = tmp_path / "m.h5"
    with pytest.raises(js.CaseError, match='give a case with waves.kind = "irregular"'):
        js.power_matrix(js.load_case("owc"), [0.04], [1.4], out)
    with pytest.raises(js.CaseError, match="seeds = 0"):
        js.power_matrix(CASE, [0.04], [1.4], out, seeds=0)
    with pytest.raises(js.CaseError, match="ascending"):
        js.power_matrix(CASE, [0.04, 0.02], [1.4], out)
    with pytest.raises(js.CaseError, match=r"waves.Tp = 0.7 s"):
        js.power_matrix(CASE, [0.04], [0.7], out)


def test_powers_of_a_part_become_those_of_the_sea():
    """Numbers and arrays; a run over the whole sea keeps its powers."""
    found = of_the_sea(
        {"P_inc": np.array([1.0, 2.0]), "P_inc_sea": np.array([1.5, np.nan]), "P_owc": np.ones(2)}
    )
    np.testing.assert_allclose(found["P_owc"], [1.5, 1.0])
    np.testing.assert_allclose(found["P_inc"], [1.5, 2.0])
    assert of_the_sea({"P_inc": 2.0, "P_owc": 1.0}) == {"P_inc": 2.0, "P_owc": 1.0}
    assert of_the_sea({"xi": 0.5, "P_inc": 2.0, "P_inc_sea": 3.0, "P_pto": 1.0})["P_pto"] == pytest.approx(
        1.5
    )


@pytest.mark.slow
def test_the_command_makes_a_matrix_and_goes_on(tmp_path, monkeypatch):
    """Its arguments reach `power_matrix`; it prints the mean over the year and writes the picture."""
    asked = {}

    def power_matrix(case, Hs, Tp, out, **options):
        asked.update(case=case, Hs=Hs, Tp=Tp, out=out, **options)
        done = a_sweep(POWERS)
        SweepFile(out).write(case.to_toml(), done.axes, POWERS.shape, {}, Meanings())
        return matrix_of(done)

    monkeypatch.setattr(js, "power_matrix", power_matrix, raising=False)
    (tmp_path / "sea.toml").write_text(CASE.to_toml())
    (tmp_path / "table.csv").write_text("Hs,Tp,share\n0.02,1.2,1\n")
    arguments = [
        "matrix",
        str(tmp_path / "sea.toml"),
        "--hs",
        "0.02,0.04",
        "--tp",
        "1.2:1.6:3",
        "--seeds",
        "2",
    ]
    arguments += ["--table", str(tmp_path / "table.csv"), "--out", str(tmp_path / "m.h5")]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    assert (
        asked["Hs"] == [0.02, 0.04] and asked["Tp"] == pytest.approx([1.2, 1.4, 1.6]) and asked["seeds"] == 2
    )
    assert "Hs = 0.04 m, Tp = 1.6 s" in done.output and "linear theory" in done.output
    assert re.search(r"mean over the year +0.50 ± 0.50 W/m", done.output)
    assert re.search(r"error due to the random seas +0.5 W/m", done.output)
    assert re.search(r"energy in 8,766 h +0.0044 ± 0.0044 MWh/m", done.output)
    assert (tmp_path / "m_plots" / "matrix.png").exists()
    answer = sweep_content(SweepFile(tmp_path / "m.h5"), Pack())["answer"]
    assert answer["label"] == "mean power over the year" and answer["value"] == "0.50 ± 0.50"
    assert (tmp_path / "m.html").exists()


def test_the_command_takes_a_table_of_a_site_and_a_model(tmp_path, monkeypatch):
    """At a quarter of the lengths the sea lies between those of the runs."""

    def power_matrix(case, Hs, Tp, out, **options):
        done = a_sweep(like_the_model(0.1))
        SweepFile(out).write(case.to_toml(), done.axes, POWERS.shape, {}, Meanings())
        return matrix_of(done)

    monkeypatch.setattr(js, "power_matrix", power_matrix, raising=False)
    case, site, model = (tmp_path / name for name in ("sea.toml", "site.csv", "model.json"))
    case.write_text(CASE.to_toml())
    site.write_text("Hs,Tp,share\n0.12,2.6,1\n")
    a_model().write(model)
    call = ["matrix", str(case), "--hs", "0.02,0.04", "--tp", "1.2:1.6:3", "--seeds", "2", "--quiet"]
    call += ["--out", str(tmp_path / "m.h5"), "--no-report"]
    at_site = ["--table", str(site), "--scale", "4"]
    done = CliRunner().invoke(app, [*call, *at_site, "--model", str(model)])
    assert done.exit_code == 0, done.output
    one = js.ScatterTable(np.array([0.03]), np.array([1.3]), np.array([1.0]))
    year = matrix_of(a_sweep(like_the_model(0.1))).annual(one, a_model())
    for label, text in (
        ("mean over the year", with_error_in_words(year.value, year.error)),
        ("error in sea states without runs", f"{year.between:.1g}"),
        ("the same at 4 times the lengths", with_error_in_words(32.0 * year.value, 32.0 * year.error)),
        ("energy in 8,766 h", with_error_in_words(*(32.0 * 8766e-6 * a for a in (year.value, year.error)))),
    ):
        assert re.search(rf"{label} +{text} ", done.output), f"{label}: {text}"
    for options, words in (
        (["--model", str(model)], "needs --table, as the model is for sea states without runs"),
        (["--scale", "4"], "--scale 4: needs --table"),
        ([*at_site, "--scale", "-1"], "scale = -1"),
    ):
        done = CliRunner().invoke(app, [*call, *options])
        assert done.exit_code == 2 and words in done.output, done.output
    # a program has no waves that a model could look at
    (tmp_path / "own.py").write_text("def problem():\n    pass\n")
    program = ["matrix", f"{tmp_path / 'own.py'}:problem", *call[2:], *at_site, "--model", str(model)]
    done = CliRunner().invoke(app, program)
    assert done.exit_code == 2 and "a power matrix varies waves.Hs" in done.output, done.output


def test_second_order_wavenumbers_are_the_theory_s():
    """Double precision on the host, compared with the traced float32."""
    omega = 2.0 * np.pi / np.array([0.8, 1.4, 5.0])
    from jaxsph.waves import theory

    np.testing.assert_allclose(
        second_order.wavenumbers(omega, 0.5, 9.81), theory.wavenumber(omega, 0.5), rtol=1e-6
    )


def _written(path, powers=POWERS):
    """File of a power matrix without runs."""
    done = a_sweep(powers)
    members = {
        i: {
            "results": {name: float(values.ravel()[i]) for name, values in done.results.items()},
            "series": {},
            "failure": "",
        }
        for i in range(powers.size)
    }
    SweepFile(path).write(CASE.to_toml(), done.axes, powers.shape, members, Meanings())
    return path


def test_a_matrix_is_exported_as_a_table_and_for_wec_sim(tmp_path):
    file = _written(tmp_path / "m.h5")
    matrix = matrix_of(js.read_sweep(file))
    written = js.export(file, tmp_path / "m.csv")
    assert [path.name for path in written] == ["m.csv", "m_members.csv"]
    rows = (tmp_path / "m.csv").read_text().splitlines()
    assert rows[0] == "waves.Hs (m),waves.Tp (s),P (W/m),P_error (W/m),xi,P_linear (W/m)" and len(rows) == 7
    assert [float(row.split(",")[2]) for row in rows[1:]] == pytest.approx(list(matrix.P.ravel()))
    assert len((tmp_path / "m_members.csv").read_text().splitlines()) == 13
    js.export(file, tmp_path / "m.mat")
    found = scipy.io.loadmat(tmp_path / "m.mat", squeeze_me=True)
    header, cases = found["mcr"]["header"].item(), found["mcr"]["cases"].item()
    assert [str(name) for name in header] == ["waves.height", "waves.period"]
    np.testing.assert_allclose(cases[:, 0], np.repeat(matrix.Hs, 3))
    np.testing.assert_allclose(cases[:, 1], np.tile(matrix.Tp, 2))
    np.testing.assert_allclose(found["P"], matrix.P.ravel())
    np.testing.assert_allclose(found["xi"], matrix.xi.ravel())


def test_a_matrix_is_exported_as_netcdf(tmp_path):
    file = _written(tmp_path / "m.h5")
    matrix = matrix_of(js.read_sweep(file))
    js.export(file, tmp_path / "m.nc", scale=4.0)
    with scipy.io.netcdf_file(tmp_path / "m.nc", mmap=False) as found:
        assert found.variables["P"].dimensions == ("Hs", "Tp") and found.variables["P"].units == b"W/m"
        np.testing.assert_allclose(found.variables["P"].data, 32.0 * matrix.P)
        np.testing.assert_allclose(found.variables["Tp"].data, 2.0 * matrix.Tp)
        np.testing.assert_allclose(found.variables["xi"].data, matrix.xi)


def test_runs_that_all_failed_are_still_exported(tmp_path):
    axes = {"waves.Hs": np.array([0.02]), "waves.Tp": np.array([1.2]), "waves.seed": np.arange(1)}
    members = {0: {"results": {}, "series": {}, "failure": "a particle has left"}}
    SweepFile(tmp_path / "m.h5").write(CASE.to_toml(), axes, (1, 1, 1), members, Meanings())
    (written,) = js.export(tmp_path / "m.h5", tmp_path / "m.csv")
    assert "a particle has left" in written.read_text()


def test_a_matrix_at_full_scale_follows_froude(tmp_path):
    file = _written(tmp_path / "m.h5")
    matrix = matrix_of(js.read_sweep(file))
    (written,) = js.export(file, tmp_path / "full.csv", scale=4.0)
    values = np.loadtxt(written, delimiter=",", skiprows=1, usecols=(0, 1, 2, 4))
    np.testing.assert_allclose(values[:, 0], 4.0 * np.repeat(matrix.Hs, 3))
    np.testing.assert_allclose(values[:, 1], 2.0 * np.tile(matrix.Tp, 2))
    np.testing.assert_allclose(values[:, 2], 32.0 * matrix.P.ravel())
    np.testing.assert_allclose(values[:, 3], matrix.xi.ravel())


def test_only_a_matrix_is_written_for_wec_sim(tmp_path):
    SweepFile(tmp_path / "s.h5").write(CASE.to_toml(), {"pto.K_dm": np.array([1.0])}, (1,), {}, Meanings())
    with pytest.raises(js.FileError, match=r"only a power matrix .* can be written as a \.mat file"):
        js.export(tmp_path / "s.h5", tmp_path / "s.mat")
    with pytest.raises(js.FileError, match=r"must end in \.csv, \.xlsx or \.mat"):
        js.export(tmp_path / "s.h5", tmp_path / "s.txt")
