"""Advice on numbers that a user wrote in a form that TOML does not allow: with a unit, or a decimal comma."""

from __future__ import annotations

import re

_UNIT = r"(?:kg|m|s|N|Pa|rad|J|W)(?:\d|\^-?\d(?:\.\d)?)?"
_IN = re.compile(rf", ({_UNIT}(?:[ /]{_UNIT})*)(?=[\s.,;:()]|$)")
"""Unit in the description of a key, such as "Thickness of the plate, m"."""
_NUMBER = r"[-+]?\d[\d_]*(?:\.\d*)?(?:[eE][-+]?\d+)?"
_COMMA = re.compile(r"[-+]?\d+,\d+")
_WITH_UNIT = re.compile(rf"{_NUMBER}\s*[A-Za-z]+\S*")
_LINE = re.compile(r"at line (\d+)")
LONGEST = 60
"""Largest number of characters of a line that a message shows."""


def unit_in(description: str) -> str:
    """Unit that the description of a key names; empty if it names none."""
    found = _IN.search(" ".join(description.split()))
    return found[1] if found else ""


def as_number(text: str, unit: str) -> str:
    """Advice on a text that is given in place of a number in a `unit`, to follow "must be a number"."""
    text = text.strip()
    if _COMMA.match(text):
        return ": use a decimal point, and no quotes"
    if _WITH_UNIT.fullmatch(text):
        return f" in {unit}, without the unit or quotes" if unit else ", without a unit or quotes"
    if re.fullmatch(_NUMBER, text):
        return " without quotes"
    return f" in {unit}" if unit else ""


def faulty_line(text: str, error: str) -> str:
    """The line of a TOML text that an `error` of the parser names by its number, and advice if the line has a
    number with a decimal comma or a unit; empty if the error names no line."""
    number = _LINE.search(error)
    lines = text.split("\n")
    if number is None or int(number[1]) > len(lines):
        return ""
    line = lines[int(number[1]) - 1].strip()
    shown = line if len(line) <= LONGEST else f"{line[:LONGEST]}..."
    value = line.partition("=")[2].partition("#")[0].strip()
    advice = ""
    if _COMMA.match(value):
        advice = "; use a decimal point in numbers"
    elif _WITH_UNIT.fullmatch(value):
        advice = "; give numbers without their units"
    return f", in the line {shown!r}{advice}"
