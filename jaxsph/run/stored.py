"""Reads the source of a run or a sweep (case, program or problem) from the text in its file."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from jaxsph.case.case import Case
from jaxsph.errors import CaseError, FileError
from jaxsph.output.run_file import RunFile
from jaxsph.problem.program import Program
from jaxsph.problem.source import Source, identity
from jaxsph.problem.sources import Assembled, source_of


def stored_source(file: RunFile, given: Any = None) -> Source:
    """Source of a run (case, program or problem), from the run's file.

    **Arguments**: `given`: the program or the problem that was run; not needed for a case. **Raises**
    FileError if `given` is another source, if its code has changed since the run began, or if it is missing.
    """
    keys = file.case_keys()
    if "program" in keys:
        return _program(file.path, keys, given)
    stored = Case.from_dict(keys)
    if given is not None and given != stored:
        raise FileError(
            f"{file.path} contains a run of the case {stored.name!r}, which differs from the given case or "
            f"program {getattr(given, 'name', given)!r}; resume the file without giving a case, or run the "
            "given case with a new output file"
        )
    return stored


def _program(path: Path, keys: dict[str, Any], given: Any) -> Source:
    """Source of a file that was not made from a case. **Raises** FileError, as `stored_source`."""
    place = keys["program"]
    if given is None and place:
        raise FileError(
            f"{path} was made by {place}; jaxsph does not import code that is only named in a file, so pass "
            f"the function or the problem again: jaxsph resume {path} --program {place}"
        )
    if given is None:
        raise FileError(
            f"{path} holds a run of a problem assembled in Python, which the file does not contain; pass the "
            "problem again: js.resume(path, given=problem)"
        )
    source = source_of(given)
    if isinstance(source, Program) and source.arguments != keys.get("arguments"):
        source = _with_arguments(path, source, keys.get("arguments", {}))
    if isinstance(source, Case) or isinstance(source, Assembled) == bool(place):
        raise FileError(
            f"{path} was made by {place or 'an assembled problem'}, and not by {source.name!r}; pass the "
            f"{'function' if place else 'problem'} that made the file"
        )
    if isinstance(source, Program):
        if Path(source.place).name != Path(place).name:
            raise FileError(
                f"{path} was made by {place}, and not by {source.place}; pass the function that made the file"
            )
        if source.digest != keys["digest"]:
            raise FileError(
                f"{path}: {place} has changed since the run began, and might build a different problem; use "
                "the unchanged program, or run the changed program with a new output file"
            )
    return source


def _with_arguments(path: Path, program: Program, arguments: dict[str, Any]) -> Program:
    try:
        return program.replace(arguments)
    except CaseError as error:
        raise FileError(
            f"{path} was made with arguments that the given function does not accept ({error}); pass the "
            "function that made the file"
        ) from None


def stored_identity(path: Path, text: str, version: str) -> dict[str, Any]:
    """Values of a run's source by dotted name, from a file's text. **Raises** FileError if this version
    cannot read the text."""
    try:
        keys = tomllib.loads(text)
        return identity(text if "program" in keys else Case.from_dict(keys).to_toml())
    except (CaseError, tomllib.TOMLDecodeError) as error:
        raise FileError(
            f"{path}: this version cannot read the case ({error}); use jaxsph {version}, which wrote the file"
        ) from None
