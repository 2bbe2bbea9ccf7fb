"""Records of sea states from the files of reanalyses and buoys, and scatter tables of them."""

import h5py
import numpy as np
import pytest
import scipy.io
from hypothesis import given, settings
from hypothesis import strategies as st

import jaxsph as js
from jaxsph.study.wave_records import WaveRecord, read_record

HS, TP = np.array([1.25, 2.5, np.nan, 0.75]), np.array([8.0, 10.5, 9.0, 6.25])


def _netcdf4(path, shape=(4, 1, 1)):
    """Heights packed into integers, as in a reanalysis, and periods as they are."""
    with h5py.File(path, "w") as file:
        packed = np.where(np.isnan(HS), -32767, np.rint((np.nan_to_num(HS) - 5.0) / 0.25)).astype(np.int16)
        height = file.create_dataset("swh", data=packed.reshape(shape))
        height.attrs.update(
            {"scale_factor": 0.25, "add_offset": np.array([5.0]), "_FillValue": np.int16(-32767)}
        )
        file["pp1d"] = TP.reshape(shape)


def _netcdf3(path):
    with scipy.io.netcdf_file(path, "w") as file:
        file.createDimension("time", 4)
        for name, values in (("hs", np.nan_to_num(HS, nan=-9.0)), ("fp", 1.0 / TP)):
            variable = file.createVariable(name, "f8", ("time",))
            variable[:] = values
            variable.missing_value = -9.0


def _buoy(path):
    path.write_text(
        "#YY  MM DD hh mm WDIR WSPD WVHT   DPD   APD\n"
        "#yr  mo dy hr mn degT m/s     m   sec   sec\n"
        "2024 01 01 00 00 310  5.0  1.25   8.0   6.0\n"
        "2024 01 01 01 00 310  5.0  2.50  10.5   6.0\n"
        "2024 01 01 02 00 310  5.0 99.00   9.0   6.0\n"
        "2024 01 01 03 00 310  5.0  0.75  6.25   6.0\n"
        "2024 01 01 04 00 310  5.0  0.75    MM   6.0\n"
    )


@pytest.mark.parametrize(("name", "write"), [("a.nc", _netcdf4), ("b.nc", _netcdf3), ("c.txt", _buoy)])
def test_records_of_reanalyses_and_buoys_are_read(tmp_path, name, write):
    write(tmp_path / name)
    found = read_record(tmp_path / name)
    np.testing.assert_allclose(found.Hs[:4], HS, rtol=1e-6)
    np.testing.assert_allclose(found.Tp[:4], TP, rtol=1e-6)
    table = js.ScatterTable.read(tmp_path / name)
    assert len(table.Hs) == 3 and table.share == pytest.approx(np.full(3, 1.0 / 3.0)) and table.hours is None


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 1000), st.floats(0.1, 2.0), st.floats(0.2, 4.0))
def test_a_table_has_the_power_of_its_record(seed, height, period):
    """Power in deep water is in proportion to Hs^2 Tp; and no class is wider than asked."""
    random = np.random.default_rng(seed)
    record = WaveRecord(2.0 * random.weibull(1.6, 500), random.uniform(4.0, 16.0, 500))
    record.Hs[::50] = np.nan
    table = js.ScatterTable.of_record(record, height, period)
    assert np.sum(table.share) == pytest.approx(1.0)
    assert np.sum(table.share * table.Hs**2 * table.Tp) == pytest.approx(np.nanmean(record.Hs**2 * record.Tp))
    assert len(np.unique(np.stack([table.Hs // height, table.Tp // period]), axis=1).T) == len(table.Hs)


@pytest.mark.parametrize(
    ("name", "write", "words"),
    [
        ("a.nc", lambda path: _netcdf4(path, (2, 2)), r"swh has the shape \(2, 2\), and so several places"),
        ("a.nc", lambda path: path.write_bytes(b"no data"), "cannot be read: it is no netCDF file"),
        ("a.nc", lambda path: None, "No such file"),
        ("a.nc", lambda path: h5py.File(path, "w").close(), r"must contain a significant height \(swh, VHM0"),
        ("a.txt", lambda path: path.write_text("#YY MM WVHT\n2024 1 2.0\n"), "line 1: .* but DPD is missing"),
        ("a.txt", lambda path: path.write_text(""), "WVHT and DPD is missing"),
        ("a.txt", lambda path: path.write_text("WVHT DPD\n99.0 8.0\n"), "no sea state with both"),
    ],
)
def test_files_that_are_no_records_are_refused(tmp_path, name, write, words):
    write(tmp_path / name)
    with pytest.raises(js.CaseError, match=words):
        js.ScatterTable.read(tmp_path / name)
