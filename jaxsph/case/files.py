"""Files of cases: the built-in ones by their names, and a user's TOML files."""

from __future__ import annotations

import difflib
import importlib.resources
import tomllib
from pathlib import Path
from typing import Any

from jaxsph.case.case import Case
from jaxsph.case.data_files import read_columns, read_series, read_text
from jaxsph.errors import CaseError


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
        remedy = f"jaxsph new {path.stem} writes one, jaxsph cases lists those that are built in"
        data = _parsed(path, read_text(path, "case file", remedy))
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
        data["waves"] = read_series(_named("waves", waves, folder)) | _without_file(waves)
    if isinstance(pto, dict) and "file" in pto:
        columns = read_columns(_named("pto", pto, folder), {"q": "m2/s", "P_a": "Pa"}, [{"q", "P_a"}])
        points = zip(columns["q"], columns["P_a"], strict=True)
        data["pto"] = {"curve": [list(point) for point in points]} | _without_file(pto)
    return data


def _named(section: str, keys: dict[str, Any], folder: Path) -> Path:
    """Path of the data file that a section names. **Raises** CaseError where that is no name."""
    if not isinstance(keys["file"], str):
        raise CaseError(f"{section}.file: must be the name of a CSV file, as text in quotes")
    return folder / keys["file"]


def _without_file(section: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in section.items() if key != "file"}


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
