"""Readers of the files that a case or a command names: text files, and columns of numbers in CSV files.

A case may come from an untrusted source, and may name any file on the machine. Messages therefore state
where a data file is wrong and what is expected there, but never show the file's content.
"""

from __future__ import annotations

import csv
import io
import math
import os
import re
import stat
from pathlib import Path

from jaxsph.errors import CaseError

MOST_BYTES = 10**6
"""Largest size of a case or data file, bytes. Ten thousand probes need half of this size, and a series of
50 000 samples needs all of it."""


def read_series(path: str | Path) -> dict[str, list[float]]:
    """Columns t (s) and either eta or X (m) of a CSV file; see `read_columns`."""
    return read_columns(path, {"t": "s", "eta": "m", "X": "m"}, [{"t", "eta"}, {"t", "X"}])


def read_columns(path: str | Path, units: dict[str, str], wanted: list[set[str]]) -> dict[str, list[float]]:
    """Columns of a CSV file by the names in its first line, such as "eta", "eta (m)", "eta [m]" or "eta_m".

    **Arguments**: `units` by column name; `wanted`: allowed sets of columns, one of which the file must have.
    **Raises** CaseError if the file cannot be read, has other columns or units, or contains values that are
    not numbers. The message gives the number and the length of the line, but not the content.
    """
    path = Path(path)
    if path.suffix.lower() != ".csv":
        raise CaseError(f"{path}: must be a CSV file whose name ends in .csv")
    rows = _rows(
        path,
        read_text(path, "data file", "give the name of a CSV file; in a case, relative to the case's folder"),
    )
    place, titles = rows[0] if rows else (f"{path}, line 1 (0 characters)", [])
    alone = len(titles) < 2  # the columns are not separated by commas
    header = [] if alone else [_column(place, title, units) for title in titles]
    if set(header) not in wanted or len(set(header)) < len(header):
        raise CaseError(f"{place}: must name the columns {_listed(units, wanted)}, separated by commas")
    found: dict[str, list[float]] = {name: [] for name in header}
    for place, row in rows[1:]:
        values = [_number(cell) for cell in row]
        if len(row) != len(header) or not all(math.isfinite(value) for value in values):
            raise CaseError(
                f"{place}: must have {len(header)} finite numbers ({', '.join(header)}), separated by commas"
            )
        for name, value in zip(header, values, strict=True):
            found[name].append(value)
    return found


def read_bytes(path: Path, kind: str, remedy: str, most: int) -> bytes:
    """Content of a file of at most `most` bytes.

    **Arguments**: `kind` of the file, in words; `remedy`: what to do if there is no such file.
    **Raises** CaseError if the file does not exist, is not a regular file, or is too large.
    """
    try:
        # without O_NONBLOCK, opening a pipe that has no writer would block for ever
        with open(os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0)), "rb") as file:
            if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
                raise CaseError(f"{path} is a folder, a pipe or a device, not a {kind}; {remedy}")
            data = file.read(most + 1)  # some files, for example those in /proc, report no size
    except FileNotFoundError:
        raise CaseError(f"no {kind} {str(path)!r}: {remedy}") from None
    except OSError as error:
        raise CaseError(f"{path} cannot be read: {error.strerror}") from None
    except ValueError as error:  # an invalid file name
        raise CaseError(f"{str(path)!r} cannot be read: {error}") from None
    if len(data) > most:
        raise CaseError(f"{path} is too large for a {kind}, which may have at most {most:.0e} bytes")
    return data


def read_text(path: Path, kind: str, remedy: str) -> str:
    """Text of a file in UTF-8, of at most `MOST_BYTES`; see `read_bytes`.

    **Raises** CaseError if the file cannot be read, or is not text.
    """
    data = read_bytes(path, kind, remedy, MOST_BYTES)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise CaseError(
            f"{path} is not UTF-8 text: byte {error.start} is not valid; save the file as UTF-8"
        ) from None
    if "\0" in text:
        raise CaseError(
            f"{path} is not a text file: byte {data.index(0)} is a NUL byte; save the file as UTF-8 text"
        )
    return text


def _listed(units: dict[str, str], wanted: list[set[str]]) -> str:
    """Allowed sets of columns in words; many sets are described by their common and their other columns."""

    def words(names: set[str]) -> str:
        return ", ".join(f"{name} ({units[name]})" for name in units if name in names)

    if len(wanted) < 4:
        return " or ".join(map(words, wanted))
    common = set.intersection(*wanted)
    return f"{words(common)} and at least one of {words(set.union(*wanted) - common)}"


def _rows(path: Path, text: str) -> list[tuple[str, list[str]]]:
    """Non-empty rows of a CSV text, each with its position in words."""
    lines = io.StringIO(text, newline="").readlines()
    reader, rows, number = csv.reader(lines, strict=True), [], 0
    try:
        for cells in reader:
            length = sum(len(line.rstrip("\r\n")) for line in lines[number : reader.line_num])
            place, number = f"{path}, line {number + 1} ({length} characters)", reader.line_num
            if any(cell.strip() for cell in cells):
                rows.append((place, [cell.strip() for cell in cells]))
    except csv.Error:
        length = len(lines[number].rstrip("\r\n"))
        raise CaseError(
            f"{path}, line {number + 1} ({length} characters): not valid CSV, because a quotation mark is "
            "not closed or is misplaced, or a value is too long"
        ) from None
    return rows


def _number(cell: str) -> float:
    """Number in a cell; NaN if the cell is not a number."""
    try:
        return float(cell)
    except ValueError:
        return math.nan


def _column(place: str, title: str, units: dict[str, str]) -> str:
    """Name of a column from its title. **Raises** CaseError if the title's unit is not in `units`."""
    known = [name for name in units if re.match(rf"{re.escape(name)}(?![A-Za-z0-9])", title)]
    name = max(known, key=len, default=title)
    unit = title.removeprefix(name).strip(" _()[]")
    if name in units and re.fullmatch(r"[\w/%^*.-]+", unit) and unit != units[name]:
        raise CaseError(f"{place}: {name} must be in {units[name]}; convert the values and correct the title")
    return name
