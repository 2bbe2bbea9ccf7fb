"""Files of cases: the built-in ones by their names, and a user's TOML files."""

from __future__ import annotations

import difflib
import importlib.resources
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
        return Case.from_dict({"name": path.stem} | data)
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


def _text(path: Path) -> str:
    """Text of a case file. **Raises** CaseError for a file that is none."""
    try:
        if not path.is_file():
            raise CaseError(f"no case file {str(path)!r}")
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
