"""Files of cases: the built-in ones by their names, and a user's TOML files."""

from __future__ import annotations

import csv
import difflib
import importlib.resources
import math
import re
import tomllib
from pathlib import Path
from typing import Any

from jaxsph.case.case import Case
from jaxsph.errors import CaseError

MOST_BYTES = 10**6
"""Largest case file, bytes: ten thousand probes are half of it."""


def built_in_cases() -> dict[str, str]:
    """Name and description of every built-in case."""
    found = {}
    for entry in sorted(
        importlib.resources.files("jaxsph").joinpath("cases").iterdir(), key=lambda e: e.name
    ):
        if entry.name.endswith(".toml"):
            found[entry.name[:-5]] = tomllib.loads(entry.read_text(encoding="utf-8"))["description"]
    return found


def load_case(name: str | Path) -> Case:
    """Case of a TOML file, or a built-in one by its name.

    **Raises** CaseError where there is no such case, the file cannot be read, or the case is not valid.
    """
    path = Path(name)
    if path.suffix == ".toml":
        data = _parsed(path, _text(path))
        return Case.from_dict({"name": path.stem} | _with_files(data, path.parent))
    names = built_in_cases()
    if str(name) not in names:
        near = difflib.get_close_matches(str(name), names, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise CaseError(
            f"no built-in case {str(name)!r}{hint} (there are {', '.join(names)}; "
            "a file's name ends in .toml)"
        )
    resource = importlib.resources.files("jaxsph").joinpath("cases", f"{name}.toml")
    return Case.from_dict({"name": str(name)} | _parsed(path, resource.read_text(encoding="utf-8")))


def _with_files(data: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Keys of a case with the contents of its CSV files, `waves.file` and `pto.file`, in their place.

    Their names start from the case's own folder. A run's file then has all that the run needs.
    """
    data, waves, pto = dict(data), data.get("waves"), data.get("pto")
    if isinstance(waves, dict) and "file" in waves:
        if waves.get("kind") != "recorded":
            raise CaseError('waves.file: belongs to waves.kind = "recorded"')
        data["waves"] = read_series(folder / str(waves["file"])) | _without_file(waves)
    if isinstance(pto, dict) and "file" in pto:
        columns = read_columns(folder / str(pto["file"]), {"q": "m2/s", "P_a": "Pa"}, [{"q", "P_a"}])
        points = zip(columns["q"], columns["P_a"], strict=True)
        data["pto"] = {"curve": [list(point) for point in points]} | _without_file(pto)
    return data


def _without_file(section: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in section.items() if key != "file"}


def read_series(path: str | Path) -> dict[str, list[float]]:
    """Columns t (s) and eta or X (m) of a CSV file, see `read_columns`."""
    return read_columns(path, {"t": "s", "eta": "m", "X": "m"}, [{"t", "eta"}, {"t", "X"}])


def read_columns(path: str | Path, units: dict[str, str], wanted: list[set[str]]) -> dict[str, list[float]]:
    """Columns of a CSV file by the names in its first line, such as "eta", "eta (m)", "eta [m]" or "eta_m".

    **Arguments**: `units` of columns by their names; `wanted`: the sets of columns of which it must have one.
    **Raises** CaseError for a file that cannot be read, other columns or units, and what is no number.
    """
    lines = _text(Path(path)).splitlines()
    rows = [[cell.strip() for cell in row] for row in csv.reader(lines) if any(cell.strip() for cell in row)]
    header = [_column(path, name, units) for name in rows[0]] if rows else []
    if set(header) not in wanted or len(set(header)) < len(header):
        sets = " or ".join(
            ", ".join(f"{name} ({units[name]})" for name in units if name in one) for one in wanted
        )
        raise CaseError(
            f"{path}: has the columns {', '.join(rows[0]) if rows else 'none'}: must be {sets}, named in the "
            "first line"
        )
    found: dict[str, list[float]] = {name: [] for name in header}
    for number, row in enumerate(rows[1:], start=2):
        for name, cell in zip(header, row, strict=False):
            try:
                value = float(cell)
            except ValueError:
                value = math.nan
            if len(row) != len(header) or not math.isfinite(value):
                raise CaseError(
                    f"{path}, row {number}: {','.join(row)!r} are not {len(header)} finite numbers"
                )
            found[name].append(value)
    return found


def _column(path: str | Path, title: str, units: dict[str, str]) -> str:
    """Name of a column from its title. **Raises** CaseError where that has another unit."""
    title = title.strip()
    known = [name for name in units if re.match(rf"{re.escape(name)}(?![A-Za-z0-9])", title)]
    name = max(known, key=len, default=title)
    unit = title.removeprefix(name).strip(" _()[]")
    if name in units and unit and unit != units[name]:
        raise CaseError(f"{path}: {title}: must be in {units[name]}; convert the column and its title")
    return name


def _text(path: Path) -> str:
    """Text of a case file. **Raises** CaseError for a file that is none."""
    try:
        if not path.is_file():
            raise CaseError(
                f"no case file {str(path)!r}: jaxsph new {path.stem} writes one, jaxsph cases lists those "
                "that are built in"
            )
        size = path.stat().st_size
        if size > MOST_BYTES:
            raise CaseError(f"{path}: {size:.2g} bytes are no case file, which has at most {MOST_BYTES:.0e}")
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise CaseError(
            f"{path}: not a text in UTF-8: byte {error.object[error.start]:#04x} at {error.start}; "
            "save the file as UTF-8"
        ) from None
    except (OSError, ValueError) as error:
        raise CaseError(f"{path}: cannot be read: {error}") from None


def _parsed(path: Path, text: str) -> dict[str, Any]:
    """Keys and sections of a TOML text. **Raises** CaseError for one that is none."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise CaseError(f"{path}: not a TOML file: {error}") from None
    except RecursionError:
        raise CaseError(f"{path}: lists or tables are nested too deep for a case") from None
    except ValueError as error:  # integers of thousands of digits
        raise CaseError(f"{path}: a value cannot be read: {error}") from None
