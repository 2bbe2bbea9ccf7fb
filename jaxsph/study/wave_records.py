"""Records of wave height and period at a site, from the files of reanalyses and of buoys."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
import scipy  # which imports its subpackages on first use
from numpy.typing import NDArray

from jaxsph.case.data_files import read_bytes
from jaxsph.errors import CaseError

HEIGHTS = ("swh", "VHM0", "hs", "Hs")
"""Names of the significant height in ERA5, in the Copernicus Marine products, and in wave models."""
PERIODS = ("pp1d", "VTPK", "tp", "Tp")
"""Names of the peak period in the same files."""
FREQUENCIES = ("fp",)
"""Name of the peak frequency, Hz, in files of wave models without a peak period."""
COLUMNS = ("WVHT", "DPD")
"""Columns of significant height (m) and peak period (s) in files of the National Data Buoy Center."""
NINES = 90.0
"""Values from which on a number of these columns stands for a missing one, such as 99.00."""
PACKING = {"scale_factor": 1.0, "add_offset": 0.0}
"""Attributes of packed variables, and their values without packing."""
MOST_BYTES = 5 * 10**7
"""Largest size of a text file, bytes; a year of hourly values needs less than a million."""


class WaveRecord(NamedTuple):
    """Sea states at a site at equal intervals of time."""

    Hs: NDArray[np.float64]
    """Significant heights, m; NaN where unknown."""
    Tp: NDArray[np.float64]
    """Peak periods, s; NaN where unknown."""


def read_record(path: str | Path) -> WaveRecord:
    """Record of one site from a netCDF file (.nc) or a text file of the National Data Buoy Center (.txt).

    **Raises** CaseError if the file cannot be read, lacks height or period, or covers several places.
    """
    path = Path(path)
    if path.suffix.lower() == ".txt":
        return _buoy(path)
    try:
        with _variables(path) as found:
            names = [next((n for n in each if n in found), None) for each in (HEIGHTS, PERIODS, FREQUENCIES)]
            height, period, frequency = names
            if height is None or (period is None and frequency is None):
                raise CaseError(
                    f"{path}: must contain a significant height ({', '.join(HEIGHTS)}) and a peak period "
                    f"({', '.join((*PERIODS, *FREQUENCIES))})"
                )
            Hs = _values(path, height, found[height])
            if period is not None:
                return WaveRecord(Hs, _values(path, period, found[period]))
            return WaveRecord(Hs, 1.0 / _values(path, str(frequency), found[frequency]))
    except OSError as error:
        raise CaseError(f"{path} cannot be read: {error.strerror or 'it is no netCDF file'}") from None


@contextlib.contextmanager
def _variables(path: Path) -> Iterator[Mapping[Any, Any]]:
    """Variables of a netCDF file by name: of version 4, which is an HDF5 file, or of an earlier version."""
    with open(path, "rb") as file:
        first = file.read(4)
    if first[:3] == b"CDF":
        with scipy.io.netcdf_file(path, mmap=False) as found:
            yield found.variables
    else:
        with h5py.File(path) as found:
            yield found


def _values(path: Path, name: str, variable: Any) -> NDArray[np.float64]:
    """Values of a variable at one place, unpacked; NaN where missing."""
    attributes = getattr(variable, "attrs", None) or getattr(variable, "_attributes", {})
    packed = np.asarray(variable[()] if isinstance(variable, h5py.Dataset) else variable.data)
    if sum(size > 1 for size in packed.shape) > 1:
        raise CaseError(
            f"{path}: {name} has the shape {packed.shape}, and so several places; select one of them, for "
            "example with xarray: dataset.sel(latitude=..., longitude=...)"
        )
    packed = packed.ravel()
    missing = np.zeros(packed.shape, bool)
    for key in ("_FillValue", "missing_value"):
        if key in attributes:
            missing |= packed == np.ravel(attributes[key])[0]
    factor, offset = (np.float64(np.ravel(attributes.get(key, usual))[0]) for key, usual in PACKING.items())
    return np.where(missing, np.nan, packed * factor + offset)


def _buoy(path: Path) -> WaveRecord:
    """Record of a text file with a line of titles, of which `COLUMNS` are read."""
    text = read_bytes(path, "record of a buoy", "give the name of a text file", MOST_BYTES).decode(
        "utf-8", "replace"
    )
    lines = [line.split() for line in text.splitlines() if line.strip()]
    titles = [title.lstrip("#") for title in lines[0]] if lines else []
    if missing := [name for name in COLUMNS if name not in titles]:
        raise CaseError(
            f"{path}, line 1: must name the columns {' and '.join(COLUMNS)} of standard meteorological data, "
            f"but {' and '.join(missing)} is missing"
        )
    rows = [line for line in lines[1:] if not line[0].startswith("#")]
    return WaveRecord(*(_column(rows, titles.index(name)) for name in COLUMNS))


def _column(rows: Sequence[Sequence[str]], k: int) -> NDArray[np.float64]:
    """Column of numbers; NaN where a number is missing."""
    found = np.full(len(rows), np.nan)
    for i, row in enumerate(rows):
        with contextlib.suppress(ValueError, IndexError):
            found[i] = float(row[k])
    return np.where(found < NINES, found, np.nan)
