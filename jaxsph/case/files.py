"""Files of cases: built-in cases by name, and the TOML files of users."""

from __future__ import annotations

import difflib
import functools
import importlib.resources
import itertools
import math
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jaxsph.case.body_sections import MOTIONS, PLANAR, ROTATIONS
from jaxsph.case.case import Case
from jaxsph.case.data_files import read_columns, read_series, read_text
from jaxsph.case.drawings import DRAWINGS, read_outline
from jaxsph.case.meshes import MESHES, Triangles, read_mesh
from jaxsph.case.moordyn import read_moordyn
from jaxsph.case.numbers import faulty_line
from jaxsph.case.sections import BODY_KEYS
from jaxsph.errors import CaseError


class Reader(NamedTuple):
    """Reader of a section's keys from the file that the section names."""

    read: Callable[..., dict[str, Any]]
    """Function that returns the section's keys. Its arguments are the path of the file and, by keyword, the
    `options` that the section gives."""
    options: tuple[str, ...] = ()
    """Keys other than `file` that determine how the file is read; they do not become keys of the case."""


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
    """Loads a case from a TOML file, or a built-in case by name.

    **Raises** CaseError if there is no such case, the file cannot be read, or the case is not valid.
    """
    path = Path(name)
    if path.suffix == ".toml":
        remedy = f"write one with jaxsph new {path.stem}, or run a built-in case (jaxsph cases lists them)"
        data = _parsed(path, read_text(path, "case file", remedy))
        return Case.from_dict({"name": path.stem} | _with_files(data, path.parent))
    names = built_in_cases()
    if str(name) not in names:
        near = difflib.get_close_matches(str(name), names, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise CaseError(
            f"no built-in case {str(name)!r}{hint} (the built-in cases are {', '.join(names)}; "
            "the name of a case file ends in .toml)"
        )
    with importlib.resources.as_file(importlib.resources.files("jaxsph").joinpath("cases")) as folder:
        data = _parsed(path, (folder / f"{name}.toml").read_text(encoding="utf-8"))
        return Case.from_dict({"name": str(name)} | _with_files(data, folder))


def _with_files(data: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Keys of a case, with the content of the data files in place of the `file` keys of its sections.

    The run file therefore contains all data of the run. File names are relative to the folder of the case.
    """
    data = dict(data)
    tank, waves = data.get("tank"), data.get("waves")
    flow = "m3/s" if isinstance(tank, dict) and "width" in tank else "m2/s"
    if isinstance(waves, dict) and "file" in waves and waves.get("kind") != "recorded":
        raise CaseError(
            'waves.file is only allowed with waves.kind = "recorded": set this kind, or remove waves.file'
        )
    for place, reader in _readers(flow).items():
        _put(data, place.split("."), "", reader, folder)
    return data


def _put(data: dict[str, Any], place: list[str], key: str, reader: Reader, folder: Path) -> None:
    """Replaces the key `file` of a section by the content of the file.

    `place`: path of the section below the dotted name `key`; NAME stands for every name.
    """
    if not place:
        file = data.pop("file", None)
        if file is not None and not isinstance(file, str):
            raise CaseError(
                f"{key}.file = {file!r:.60}: must be the name of a data file, for example a CSV file, in "
                "quotes"
            )
        if file is not None:
            try:
                options = {name: data.pop(name) for name in reader.options if name in data}
                found = reader.read(folder / file, **options)
            except ValueError as error:
                raise CaseError(f"{key}.{error}") from None
            data.update(found | data)
        return
    for name in list(data) if place[0] == "NAME" else place[:1]:
        if isinstance(data.get(name), dict):
            data[name] = dict(data[name])
            _put(data[name], place[1:], f"{key}.{name}".lstrip("."), reader, folder)


def _read_curve(path: Path, flow: str) -> dict[str, Any]:
    """Reads the characteristic curve of a turbine from the columns q (in the unit `flow`) and P_a (Pa)."""
    columns = read_columns(path, {"q": flow, "P_a": "Pa"}, [{"q", "P_a"}])
    return {"curve": [list(point) for point in zip(columns["q"], columns["P_a"], strict=True)]}


def _read_motion(path: Path) -> dict[str, Any]:
    """Reads the prescribed motion of a body from the column t (s) and columns of motions (m, rad)."""
    units = {"t": "s"} | {name: "rad" if name in ROTATIONS else "m" for name in (*PLANAR, *MOTIONS)}
    motions = [name for name in units if name != "t"]
    counts = range(1, len(motions) + 1)
    wanted = [{"t", *some} for count in counts for some in itertools.combinations(motions, count)]
    return read_columns(path, units, wanted)


def _read_shape(path: Path, scale: Any = None, at: Any = None) -> dict[str, Any]:
    """Reads a mesh, or the corners of a shape in order along the outline, from columns x and z (m) or from a
    drawing.

    `scale` multiplies the lengths, and `at` is the position (m) of the file's origin in the tank.
    **Raises** ValueError if `scale` or `at` is not valid.
    """
    solid = path.suffix.lower() in MESHES
    at = [0.0] * (3 if solid else 2) if at is None else at
    if scale is not None and not (_is_number(scale) and scale > 0.0):
        raise ValueError(f"scale = {scale!r}: must be a positive number")
    if not (isinstance(at, list) and len(at) == (3 if solid else 2) and all(map(_is_number, at))):
        raise ValueError(f"at = {at!r}: must be a position [x, {'y, ' if solid else ''}z], m")
    if solid:
        surface = read_mesh(path, 1.0 if scale is None else scale)
        return {"mesh": {"packed": Triangles(surface.vertices + at, surface.faces).packed()}}
    if path.suffix.lower() in DRAWINGS:
        corners = read_outline(path, scale)
    elif path.suffix.lower() != ".csv":
        raise CaseError(
            f"{path}: must be a CSV file whose name ends in .csv, a drawing whose name ends in "
            f"{' or '.join(DRAWINGS)}, or a mesh whose name ends in {' or '.join(MESHES)}"
        )
    else:
        columns = read_columns(path, {"x": "m", "z": "m"}, [{"x", "z"}])
        corners = np.stack([columns["x"], columns["z"]], axis=1) * (1.0 if scale is None else scale)
    return {"polygon": (corners + at).tolist()}


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _readers(flow: str) -> dict[str, Reader]:
    """Sections that may name a file, with the reader of their keys.

    NAME in a section's name stands for every name. `flow`: unit of the flow through a turbine.
    """
    curve, shape = Reader(functools.partial(_read_curve, flow=flow)), Reader(_read_shape, ("scale", "at"))
    return {
        "waves": Reader(read_series),
        "pto": curve,
        "chamber.NAME.pto": curve,
        "duct.NAME.pto": curve,
        **dict.fromkeys(BODY_KEYS, shape),
        **{f"{body}.motion": Reader(_read_motion) for body in BODY_KEYS},
        "solid.NAME": shape,
        "mooring": Reader(read_moordyn, ("body", "at", "kind", "lines")),
    }


def _parsed(path: Path, text: str) -> dict[str, Any]:
    """Keys and sections of a TOML text. **Raises** CaseError if the text is not TOML."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise CaseError(f"{path} is not a TOML file: {error}{faulty_line(text, str(error))}") from None
    except RecursionError:
        raise CaseError(f"{path}: lists or tables are nested too deeply for a case") from None
    except ValueError as error:  # integers of thousands of digits
        raise CaseError(f"{path}: a value cannot be read: {error}") from None
