"""Reader of mooring lines from input files of MoorDyn, version 2 (Hall and Goupee 2015).

Line types, points, lines, and the options of the bed are read. Lines must be in the x-z plane, between a
fixed point and a point that moves with the body. Features that are not available here are refused. Messages
never show the content of the file, because a case may name any file.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from jaxsph.case.data_files import read_text
from jaxsph.errors import CaseError

SUFFIXES = (".txt", ".dat")
"""File-name extensions of MoorDyn input files."""
FIXED = ("fixed", "fix", "anchor")
MOVING = ("coupled", "vessel", "coupledpinned")
"""Types of points that are fixed in the tank, and of points that move with the body."""
TABLES = {"LINE TYPES": "types", "POINTS": "points", "LINES": "lines", "OPTIONS": "options"}
"""Tables that are read, by the words in their headings."""
OLD = {"LINE DICTIONARY": "LINE TYPES", "CONNECTION": "POINTS", "NODE PROPERTIES": "POINTS"}
"""Words in the headings of version 1, with the corresponding words of version 2."""
REFUSED = {"BOD": "bodies", "ROD": "rods", "FAIL": "failures", "CONTROL": "controls", "EXTERNAL": "loads"}
"""Words in the headings of tables that must be empty, with the name of their content in messages."""
ON_PLANE = 1e-6
"""Largest distance at which a point counts as in the x-z plane or on the bed, m."""


def read_moordyn(
    path: Path, body: Any = "body", at: Any = None, kind: Any = "line", lines: Any = 1.0
) -> dict[str, Any]:
    """Sections of all lines of a MoorDyn file, by the names line1, line2 and so on.

    **Arguments**: name of the `body` that has all fairleads; `at`: position (x, z) of the file's origin in
    the tank, m; by default x = 0 and z = the water depth given in the file; `kind` of all moorings; `lines`:
    number of identical lines for each line in the file, in two dimensions per metre of width. **Raises**
    CaseError if the file cannot be read, or has features that are not available; ValueError if `at` is not
    valid.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise CaseError(f"{path}: must be a MoorDyn file whose name ends in {' or '.join(SUFFIXES)}")
    remedy = "give the name of a MoorDyn file, relative to the case's folder"
    file = _File(path, read_text(path, "MoorDyn file", remedy))
    options = file.options()
    if at is None:
        if "wtrdpth" not in options:
            raise CaseError(
                f"{path} has no WtrDpth in OPTIONS: give mooring.at, the position of the file's origin"
            )
        at = [0.0, options["wtrdpth"]]
    if not (isinstance(at, list) and len(at) == 2 and all(isinstance(one, int | float) for one in at)):
        raise ValueError(f"at = {at!r}: must be a position [x, z], m")
    types, points, found = file.types(), file.points(), {}
    for number, words in file.rows("lines", 6):
        fixed, moving = file.ends(number, words, points)
        if words[1] not in types:
            raise file.error(number, "the line's type is not among LINE TYPES; correct its name")
        anchor, fairlead = ([x + at[0], _on_bed(z + at[1])] for x, z in (fixed, moving))
        line = types[words[1]] | {
            "body": body,
            "kind": kind,
            "lines": lines,
            "at": fairlead,
            "anchor": anchor,
            "length": file.number(number, words[4]),
            "segments": int(file.number(number, words[5])),
            "bed_stiffness": options.get("kbot", 3.0e6),
            "bed_damping": options.get("cbot", 3.0e5),
        }
        line["damping"] = _ratio(line)
        if kind != "line":
            line = {key: value for key, value in line.items() if key not in DYNAMIC}
        found[f"line{words[0]}"] = line
    if not found:
        raise CaseError(
            f"{path} has no lines (table LINES): expected a MoorDyn file of version 2 with at least one line"
        )
    return found


DYNAMIC = ("segments", "damping", "drag", "added_mass", "bed_stiffness", "bed_damping")
"""Keys that only lines of lumped masses have."""


class _File:
    """Rows of a file's tables, with their line numbers."""

    def __init__(self, path: Path, text: str) -> None:
        """Splits the text into tables. **Raises** CaseError for a table that is refused."""
        self.path = path
        self.tables: dict[str, list[tuple[int, list[str]]]] = {name: [] for name in TABLES.values()}
        here, skip, refused = "", 0, ""
        for number, line in enumerate(text.splitlines(), start=1):
            if line.lstrip().startswith("---"):
                heading = line.upper()
                for old, new in OLD.items():
                    heading = heading.replace(old, new)
                refused = next((what for word, what in REFUSED.items() if word in heading), "")
                here = next((name for word, name in TABLES.items() if word in heading), "")
                skip = 0 if here == "options" else 2
                continue
            words = line.split("!")[0].split()
            if skip or not words:
                skip = max(skip - 1, 0)
                continue
            if refused:
                raise self.error(number, f"{refused} are not available; remove the table")
            if here:
                self.tables[here].append((number, words))

    def error(self, number: int, what: str) -> CaseError:
        """Error in a line of the file."""
        return CaseError(f"{self.path}, line {number}: {what}")

    def number(self, number: int, word: str) -> float:
        """Converts a word of a line to a number. **Raises** CaseError if the word is not a finite number."""
        try:
            value = float(word)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise self.error(number, "expected one number; tables and lists of stiffnesses are not supported")
        return value

    def rows(self, table: str, least: int) -> Iterator[tuple[int, list[str]]]:
        """Rows of a table. **Raises** CaseError for a row of fewer than `least` columns."""
        for number, words in self.tables[table]:
            if len(words) < least:
                raise self.error(number, f"has {len(words)} columns, expected at least {least}")
            yield number, words

    def options(self) -> dict[str, float]:
        """Values of the options that are read, by name in lower case."""
        known = ("wtrdpth", "kbot", "cbot")
        rows = [(number, words) for number, words in self.tables["options"] if len(words) > 1]
        return {
            words[1].lower(): self.number(number, words[0])
            for number, words in rows
            if words[1].lower() in known
        }

    def types(self) -> dict[str, dict[str, Any]]:
        """Keys of a mooring for each line type, by the type's name, with the damping as given in the file."""
        found = {}
        for number, words in self.rows("types", 10):
            values = [self.number(number, one) for one in words[1:10]]
            diameter, mass, stiffness, damping, bending, *drag = values
            if bending:
                raise self.error(number, "bending stiffness (EI) is not available; set EI to 0")
            found[words[0]] = {
                "diameter": diameter,
                "mass": mass,
                "axial_stiffness": stiffness,
                "damping": damping,
                "drag": [drag[0], drag[2]],
                "added_mass": [drag[1], drag[3]],
            }
        return found

    def points(self) -> dict[str, tuple[str, float, float]]:
        """Type, x and z (m) of the points, by number. **Raises** CaseError for a point off the x-z plane."""
        found = {}
        for number, words in self.rows("points", 9):
            kind = words[1].lower()
            x, y, z = (self.number(number, one) for one in words[2:5])
            if abs(y) > ON_PLANE:
                raise self.error(number, "the point is not in the x-z plane; set Y to 0")
            found[words[0]] = "fixed" if kind in FIXED else "moving" if kind in MOVING else "other", x, z
        return found

    def ends(self, number: int, words: list[str], points: dict) -> tuple[list[float], list[float]]:
        """Positions (m) of the fixed and of the moving end of a line, in either order."""
        ends = [points[word] for word in words[2:4] if word in points]
        by_kind = {kind: [x, z] for kind, x, z in ends}
        if len(ends) != 2 or set(by_kind) != {"fixed", "moving"}:
            raise self.error(
                number,
                "the line must join a Fixed point and a Coupled point; free points, and points on bodies and "
                "rods, are not available",
            )
        return by_kind["fixed"], by_kind["moving"]


def _ratio(line: dict[str, Any]) -> float:
    """Internal damping of a segment, divided by l sqrt(EA m) (-), where l is the segment's length, EA the
    axial stiffness and m the mass per length."""
    if line["damping"] <= 0.0:
        return -line["damping"]
    size = line["length"] / max(line["segments"], 1)
    return line["damping"] / (size * math.sqrt(max(line["axial_stiffness"] * line["mass"], 1e-300)))


def _on_bed(z: float) -> float:
    """Height above the bed (m), set to zero for a point on the bed."""
    return 0.0 if abs(z) < ON_PLANE else z
