"""Cases: a validated description in SI units, and `build`, which turns it into a model and a state.

Everything that fixes an array's shape is spent here, on the host. Lengths are snapped to the lattice of
spacing dx, and `Case.notices` says what became of each.
"""

from __future__ import annotations

import difflib
import importlib.resources
import tomllib
from pathlib import Path

from jaxsph.case.case import Case
from jaxsph.errors import CaseError


def built_in_cases() -> dict[str, str]:
    """Name and description of every built-in case."""
    found = {}
    for entry in sorted(
        importlib.resources.files("jaxsph").joinpath("cases").iterdir(), key=lambda e: e.name
    ):
        if entry.name.endswith(".toml"):
            found[entry.name[:-5]] = tomllib.loads(entry.read_text())["description"]
    return found


def load_case(name: str | Path) -> Case:
    """The case of a TOML file, or a built-in one by its name.

    **Raises** CaseError where there is no such case, or it is not valid.
    """
    path = Path(name)
    if path.suffix == ".toml":
        if not path.is_file():
            raise CaseError(f"no case file {str(path)!r}")
        text, default = path.read_text(), path.stem
    else:
        names = built_in_cases()
        if str(name) not in names:
            near = difflib.get_close_matches(str(name), names, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise CaseError(
                f"no built-in case {str(name)!r}{hint} (there are {', '.join(names)}; "
                "a file's name ends in .toml)"
            )
        resource = importlib.resources.files("jaxsph").joinpath("cases", f"{name}.toml")
        text, default = resource.read_text(), str(name)
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise CaseError(f"{path}: not a TOML file: {error}") from None
    return Case.from_dict({"name": default} | data)
