"""Tables of runs, sweeps and power matrices: CSV files, a workbook, or a matrix for WEC-Sim or as netCDF."""

from __future__ import annotations

import csv
import tomllib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy  # which imports its subpackages on first use
from numpy.typing import NDArray

from jaxsph.errors import FileError
from jaxsph.output.dataset import wanted
from jaxsph.output.hdf5 import tell_write_errors
from jaxsph.output.run_file import RunFile
from jaxsph.output.sweep_file import StoredSweep, SweepFile
from jaxsph.report.froude import check_scale, factor
from jaxsph.report.labels import OF_PROGRAM, components_of, in_order, is_flat, label_of
from jaxsph.study.matrix import SEA_AXES, PowerMatrix, matrix_of
from jaxsph.study.sweep import read_sweep

MATRIX = "matrix"
"""Name of the table of a power matrix."""
Cell = str | float | None
"""Content of a cell; None leaves it empty."""


class Table(NamedTuple):
    """Table with column titles and rows."""

    name: str
    """Name of the sheet in a workbook, and suffix of the name of a CSV file."""
    head: list[str]
    """Names of the columns, with their units."""
    rows: Sequence[Sequence[Cell]]
    """Rows, with one cell per column."""


def tables(path: str | Path, scale: float = 1.0) -> list[Table]:
    """Tables of a file: results and series of a run, one row per member of a sweep, and one row per sea state
    of a power matrix.

    `scale`: see `export`; at another scale than the runs', a power matrix has no table of members. **Raises**
    FileError if the file was not written by jaxsph.
    """
    check_scale(scale)
    if not SweepFile(path).is_one():
        return list(_of_run(RunFile.open(path), scale))
    stored = SweepFile(path).read()
    powers = any({"P_owc", "P_pto"} & one["results"].keys() for one in stored.members.values())
    if [*stored.axes] == SEA_AXES and powers:
        members = [_members(stored)] if scale == 1.0 else []
        return [*members, _sea_states(matrix_of(read_sweep(path)), scale)]
    if scale != 1.0:
        raise FileError(
            f"{path} contains a sweep, whose swept values have no units: omit the scale, or give the file of "
            "a run"
        )
    return [_members(stored)]


def export(path: str | Path, out: str | Path, overwrite: bool = False, scale: float = 1.0) -> list[Path]:
    """Writes the tables of a run, a sweep or a power matrix, in a format that depends on the suffix of `out`:
    CSV, an Excel workbook, or for a power matrix a MAT or netCDF file.

    `scale`: lengths of the tables over those of the run; all values of the tables follow by Froude's law.

    For a run, the series go to the CSV file `out` and the results to a file with `_results` added to the
    name, or both to one workbook with two sheets. A power matrix goes to `out`, and its runs to a file or
    sheet called members. The MAT file contains the variable mcr, by which WEC-Sim runs the same sea states
    (simu.mcrMatFile), and Hs, Tp and the columns of the matrix in the same order; the netCDF file contains
    them over Hs and Tp. **Returns** the files.
    **Raises** FileError for another suffix, for a MAT or netCDF file of something else than a power matrix,
    if a file exists and `overwrite` is not set, or if openpyxl, which writes the workbook, is missing.
    """
    out = Path(out)
    if out.suffix not in WRITERS:
        raise FileError(f"{out}: the name must end in .csv, .xlsx or .mat, or in .nc for netCDF")
    found = tables(path, scale)
    if out.suffix in OF_MATRIX:
        found = [one for one in found if one.name == MATRIX]
        if not found:
            raise FileError(
                f"{path}: only a power matrix (jaxsph matrix) can be written as a {out.suffix} file"
            )
    *others, last = found
    files = {out: [*found] if out.suffix == ".xlsx" else [last]}
    if out.suffix == ".csv":
        files |= {out.with_name(f"{out.stem}_{one.name}.csv"): [one] for one in others}
    for file in files:
        if file.exists() and not overwrite:
            raise FileError(
                f"{file} exists; give another name with --out, or replace the file with --overwrite"
            )
    for file, content in files.items():
        with tell_write_errors(file):
            file.parent.mkdir(parents=True, exist_ok=True)
            WRITERS[out.suffix](file, content)
    return sorted(files)


def _of_run(run: RunFile, scale: float) -> Iterator[Table]:
    """Tables of a run: results with their labels, and series over time with one column per component.

    `scale`: see `export`; at another scale than the run's, numbers of the run itself are left out.
    """
    results, labels = run.results(), run.labels()
    flat = is_flat(run.case_keys())
    rows: list[list[Cell]] = []
    for name in in_order(results, labels):
        if scale == 1.0 or name not in OF_PROGRAM:
            label = label_of(name, flat, labels)
            value = results[name] * factor(label.unit, scale)
            rows.append([name, value, label.unit, label.text.strip(), label.meaning])
    yield Table("results", ["result", "value", "unit", "name", "meaning"], rows)
    series, variables, places = run.series(), run.variables(), run.coordinates()
    columns: dict[str, np.ndarray] = {"time (s)": series.get("time", np.zeros(0)) * factor("s", scale)}
    for name, values in series.items():
        if name == "time":
            continue
        units, dim = variables[name].units, variables[name].dim
        where = [scale * at for of, at, *_ in places.values() if of == dim]
        if values.ndim == 1:
            columns[f"{name} ({units})"] = values * factor(units, scale)
            continue
        names = list(components_of(variables[name], values.shape[1]))
        for k, column in enumerate(values.reshape(len(values), -1).T):
            named = names[k] if names else str(k + 1)
            place = ", ".join(f"{at[k]:.4g}" for at in where if at.ndim == 1) or named
            columns[f"{name} [{place}] ({_unit(units, k)})"] = column * factor(_unit(units, k), scale)
    yield Table(
        "series", list(columns), [list(map(float, row)) for row in zip(*columns.values(), strict=True)]
    )


def _unit(units: str, component: int) -> str:
    """Unit of a component of a reading; `units` may be a list, separated by commas."""
    each = units.split(", ")
    return each[component] if len(each) > component else units


def _members(stored: StoredSweep) -> Table:
    """Table with one row per member of a sweep: parameters, results, and the reason for a failure."""
    names = {name for one in stored.members.values() for name in one["results"]}
    ordered = in_order(names, stored.meanings.labels)
    flat = is_flat(tomllib.loads(stored.case_toml))
    units = {name: label_of(name, flat, stored.meanings.labels).unit for name in ordered}
    titles = [f"{name} ({units[name]})" if units[name] else name for name in ordered]
    head = [*stored.axes, *titles, "failure"]
    rows = []
    for index, one in sorted(stored.members.items()):
        at = stored.place(index)
        rows.append([*at.values(), *(one["results"].get(name) for name in ordered), one["failure"] or None])
    return Table("members", head, rows)


def _sea_states(matrix: PowerMatrix, scale: float) -> Table:
    """Table with one row per sea state of a power matrix, at `scale` times the lengths of the runs."""
    columns = {
        ("waves.Hs", "m"): np.broadcast_to(matrix.Hs[:, None], matrix.P.shape),
        ("waves.Tp", "s"): np.broadcast_to(matrix.Tp, matrix.P.shape),
        ("P", matrix.unit): matrix.P,
        ("P_error", matrix.unit): matrix.error,
        ("xi", ""): matrix.xi,
        ("P_linear", matrix.unit): matrix.linear,
    }
    head = [f"{name} ({unit})" if unit else name for name, unit in columns]
    values = [column.ravel() * factor(unit, scale) for (_, unit), column in columns.items()]
    rows = [
        [value if np.isfinite(value) else None for value in map(float, row)]
        for row in zip(*values, strict=True)
    ]
    return Table(MATRIX, head, rows)


def _columns(table: Table) -> dict[str, tuple[NDArray[np.float64], str]]:
    """Columns of the table of a power matrix and their units, by name."""
    columns = np.array([[np.nan if v is None else v for v in row] for row in table.rows], float).T
    titles = [title.removeprefix("waves.").rstrip(")").partition(" (") for title in table.head]
    return {name: (column, unit) for (name, _, unit), column in zip(titles, columns, strict=True)}


def _write_mat(path: Path, content: Sequence[Table]) -> None:
    named = {name: column[:, None] for name, (column, _) in _columns(*content).items()}
    header = np.array(["waves.height", "waves.period"], object)
    seas = {"header": header, "cases": np.hstack([named["Hs"], named["Tp"]])}
    scipy.io.savemat(path, {"mcr": seas, **named})


def _write_netcdf(path: Path, content: Sequence[Table]) -> None:
    columns = _columns(*content)
    axes = {name: np.unique(columns[name][0]) for name in ("Hs", "Tp")}
    shape = tuple(map(len, axes.values()))
    with scipy.io.netcdf_file(path, "w") as file:
        for name, values in axes.items():
            file.createDimension(name, len(values))
        for name, (column, unit) in columns.items():
            over, values = ((name,), axes[name]) if name in axes else (tuple(axes), column.reshape(shape))
            variable = file.createVariable(name, "f8", over)
            variable[:] = values
            variable.units = unit or "1"


def _write_csv(path: Path, content: Sequence[Table]) -> None:
    (table,) = content
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(table.head)
        writer.writerows(table.rows)


def _write_book(path: Path, content: Sequence[Table]) -> None:
    with wanted("A workbook", "openpyxl"):
        import openpyxl
    book = openpyxl.Workbook(write_only=True)
    for table in content:
        sheet = book.create_sheet(table.name)
        sheet.freeze_panes = "A2"
        sheet.append(table.head)
        for row in table.rows:
            # a workbook cannot store numbers that are not finite
            sheet.append([None if isinstance(v, float) and not np.isfinite(v) else v for v in row])
    book.save(path)


OF_MATRIX: dict[str, Callable[[Path, Sequence[Table]], None]] = {".mat": _write_mat, ".nc": _write_netcdf}
"""Writers of the table of a power matrix, by the suffix of the file."""
WRITERS = {".csv": _write_csv, ".xlsx": _write_book, **OF_MATRIX}
"""Writers of all tables."""
