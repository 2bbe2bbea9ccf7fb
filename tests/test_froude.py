"""Froude's law: exponents from units, tables at full scale, and a run at two scales."""

import csv

import numpy as np
import pytest
from conftest import coarse
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

import jaxsph as js
from jaxsph.cli.app import app
from jaxsph.errors import CaseError, FileError
from jaxsph.output.run_file import RunFile
from jaxsph.output.sweep_file import Meanings, SweepFile
from jaxsph.report.froude import BASES, exponent, factor
from jaxsph.report.labels import LABELS

N = 4.0
"""Scale of the runs. Lengths, times and all products then grow by powers of 2, which floats carry exactly."""
LENGTHS = ("dx", "tank.length", "tank.depth", "waves.H", "device.chamber_length", "device.wall_thickness")
TIMES = ("t1", "waves.T", "output.sample_dt", "output.snapshot_dt")


@pytest.mark.parametrize(
    ("unit", "expected"),
    [
        ("", 0.0),
        ("m", 1.0),
        ("Pa", 1.0),
        ("s", 0.5),
        ("m s-1", 0.5),
        ("1/s", -0.5),
        ("m2/s", 1.5),
        ("m2 s-1", 1.5),
        ("m3 s-1", 2.5),
        ("W/m", 2.5),
        ("W m-1", 2.5),
        ("W", 3.5),
        ("J/m", 3.0),
        ("N m-1", 2.0),
        ("N m", 4.0),
        ("rad/m", -1.0),
        ("rad s-1", -0.5),
        ("kg m2", 5.0),
        ("N s/m", 2.5),
    ],
)
def test_exponents_are_those_of_the_table(unit, expected):
    """The exponents of docs/how-to/scale.md."""
    assert exponent(unit) == expected


@given(
    st.lists(st.tuples(st.sampled_from(sorted(BASES)), st.integers(-3, 3)), max_size=4), st.floats(0.1, 100.0)
)
def test_factors_of_products_are_products(parts, scale):
    """The factor of a product of units is the product of their factors, however the unit is written."""
    unit = " ".join(f"{base}{power}" for base, power in parts)
    expected = np.prod([factor(base, scale) ** power for base, power in parts])
    assert factor(unit, scale) == pytest.approx(expected, rel=1e-9)
    assert factor(f"1/{parts[0][0]}" if parts else "", scale) == pytest.approx(
        1.0 / factor(parts[0][0], scale) if parts else 1.0
    )


def test_every_standard_result_has_a_known_unit():
    for label in LABELS.values():
        exponent(label.unit)


@pytest.mark.parametrize("unit", ["furlong", "W/m/s", "m s^-1"])
def test_an_unknown_unit_is_refused(unit):
    """A user's reading may have any unit, as long as it is not scaled."""
    with pytest.raises(CaseError, match="unit"):
        exponent(unit)
    assert factor(unit, 1.0) == 1.0


def _at(scale, air):
    """The coarse OWC at the scale."""
    case = coarse("owc", {"fluid.nu": 1e-6 * scale**1.5, "t1": 1.0})
    if air:
        # the ambient pressure stays the same: the volume per metre grows with n instead of n^2
        case = case.replace({"air.volume": 0.05 * scale})
    draught, K_dm = case.value("device.draught"), case.value("pto.K_dm")
    gauges = [scale * x for x in case.value("probes.gauges")]
    changes = {name: scale * case.value(name) for name in LENGTHS}
    changes |= {name: scale**0.5 * case.value(name) for name in TIMES}
    changes |= {"device.draught": scale * draught, "pto.K_dm": K_dm / scale}
    return case.replace(changes | {"probes.gauges": gauges, "probes.pressure": []})


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Files of the run of a model and of the same device at N times its lengths; with air or without."""
    folder, found = tmp_path_factory.mktemp("froude"), {}
    for air in (False, True):
        found[air] = folder / f"model_{air}.h5", folder / f"full_{air}.h5"
        for path, scale in zip(found[air], (1.0, N), strict=True):
            js.run(_at(scale, air), out=path, progress=False)
    return found


@pytest.mark.parametrize(("air", "allowed"), [(False, 1e-3), (True, 1e-2)])
def test_a_run_at_full_scale_has_the_results_of_the_model(files, air, allowed):
    """Readings and results of the model, scaled, are those of the run at full scale.

    The ambient pressure does not grow with the scale; the law of the air is linear to 1 % at these pressures.
    """
    model, full = files[air]
    series, variables = RunFile.open(model).series(), RunFile.open(model).variables()
    for name in ("eta", "P_a", "flow", "kinetic"):
        found = RunFile.open(full).series()[name]
        scaled = series[name] * factor(variables[name].units, N)
        assert np.max(np.abs(found - scaled)) < allowed * np.max(np.abs(found)), name
    expected, results = js.full_scale(model, N), RunFile.open(full).results()
    for name in ("energy_paddle", "energy_pto", "t_end"):
        assert results[name] == pytest.approx(expected[name].value, rel=3 * allowed), name
    assert "wall_seconds" not in expected


def test_tables_at_full_scale(files, tmp_path):
    model, _ = files[False]
    js.export(model, tmp_path / "model.csv")
    js.export(model, tmp_path / "full.csv", scale=N)
    one, other = (list(csv.reader(open(tmp_path / f"{name}.csv"))) for name in ("model", "full"))
    heads = [head.split(" [")[0].split(" (")[0] for head in one[0]]
    assert heads == [head.split(" [")[0].split(" (")[0] for head in other[0]]
    for name, exponent_of in (("time", 0.5), ("P_a", 1.0), ("flow", 1.5), ("eta", 1.0)):
        column = heads.index(name)
        for a, b in zip(one[5:], other[5:], strict=True):
            assert float(b[column]) == pytest.approx(N**exponent_of * float(a[column]), rel=1e-6)
    # the positions of gauges in the titles grow too
    place = float(one[0][heads.index("eta")].split("[")[1].split("]")[0])
    assert float(other[0][heads.index("eta")].split("[")[1].split("]")[0]) == pytest.approx(
        N * place, rel=1e-3
    )
    names = [row[0] for row in csv.reader(open(tmp_path / "full_results.csv"))]
    assert "wall_seconds" not in names and "energy_pto" in names


@pytest.mark.parametrize("air", [False, True])
def test_the_command_warns_of_compressible_air(files, tmp_path, air):
    out = tmp_path / "full.csv"
    found = CliRunner().invoke(app, ["export", str(files[air][0]), "--scale", "40", "--out", str(out)])
    assert found.exit_code == 0 and out.exists()
    assert ("the air is compressible" in found.stderr) == air


@pytest.mark.parametrize("scale", [0.0, -40.0, float("nan"), float("inf")])
def test_a_scale_must_be_positive(files, tmp_path, scale):
    with pytest.raises(CaseError, match="must be a positive number"):
        js.export(files[False][0], tmp_path / "out.csv", scale=scale)
    with pytest.raises(CaseError, match="must be a positive number"):
        js.full_scale(files[False][0], scale)


def test_a_sweep_has_no_scale(tmp_path):
    axes = {"pto.K_dm": np.array([300.0])}
    SweepFile(tmp_path / "sweep.h5").write(coarse("owc").to_toml(), axes, (1,), {}, Meanings())
    with pytest.raises(FileError, match="contains a sweep"):
        js.export(tmp_path / "sweep.h5", tmp_path / "out.csv", scale=2.0)
