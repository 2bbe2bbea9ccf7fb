"""Commented case files, and tables of all keys of a case with their meanings."""

from __future__ import annotations

import inspect
import textwrap
import types
import typing
from typing import Any, NamedTuple, cast

from pydantic.fields import FieldInfo

from jaxsph.case.case import NAME, Case, section_in
from jaxsph.case.section import Section, by_name, meanings
from jaxsph.case.sections import KINDS, Sections
from jaxsph.problem.toml import toml_value

WIDTH = 100
"""Width of the comments in a commented case file, characters."""
HEAD = """\
# {name}: all values in SI units; x = 0 is the paddle at rest, or the near end wall, and z = 0 the bed.
# A line "# key = value" is a key at its default; a line "# key =" is a key that is not set.
#
#   jaxsph check {name}.toml     describes the run, without starting it
#   jaxsph run {name}.toml       runs the case, and writes a page for the browser at the end
"""


class Key(NamedTuple):
    """Key of a section: name, allowed values, default as TOML (empty without a default), and meaning."""

    name: str
    allowed: str
    default: str
    meaning: str


def keys_of(section: type[Section]) -> list[Key]:
    """Keys of a section, without its subsections; `kind` comes first."""
    held = [name for name, field in section.model_fields.items() if section_in(field.annotation) is None]
    meaning = meanings(section)
    return [
        _key(name, section.model_fields[name], meaning.get(name, ""))
        for name in sorted(held, key=lambda name: name != "kind")
    ]


def sections_of(section: type[Section] = Sections, prefix: str = "") -> dict[str, type[Section]]:
    """Section classes by dotted name, with an entry for each kind, for example `waves (kind = "focused")`."""
    found = {}
    for name, field in section.model_fields.items():
        inner = section_in(field.annotation)
        if prefix + name in KINDS:
            found |= {f'{name} (kind = "{kind}")': one for kind, one in KINDS[prefix + name].items()}
        elif inner is not None:
            name = f"{name}.{NAME}" if by_name(field.annotation) else name
            found |= {prefix + name: inner} | sections_of(cast("type[Section]", inner), f"{prefix}{name}.")
    return found


def commented_toml(case: Case) -> str:
    """Text of a case file: the keys that the case sets, all other keys of its sections commented out, and the
    meaning of each key."""
    used, text = [], HEAD.format(name=case.name) + "\n" + _section_text(case, "")
    for name in type(case).model_fields:
        part = getattr(case, name)
        if isinstance(part, Section):
            used.append(name)
            text += _with_inner(part, name)
        elif isinstance(part, dict) and part:
            used.append(name)
            text += "".join(_with_inner(one, f"{name}.{key}") for key, one in part.items())
    text += "\n# Sections that this case does not use:\n"
    for name, section in sections_of().items():
        plain = name.split(" ")[0]
        key = plain.removesuffix(f".{NAME}")
        if "." not in key and key not in used:
            text += _comment(f"[{plain}]{name.removeprefix(plain)}: {_summary(section)}")
    return text


def _with_inner(part: Section, name: str) -> str:
    text = f"\n{_comment(_summary(type(part)))}[{name}]\n" + _section_text(part, name)
    for inner in type(part).model_fields:
        if isinstance(value := getattr(part, inner), Section):
            text += _with_inner(value, f"{name}.{inner}")
    return text


def _section_text(part: Section, name: str) -> str:
    text = ""
    for key in keys_of(Sections if name == "" else type(part)):
        if key.name == "name":  # the name of a case is the name of its file
            continue
        text += _comment(key.meaning)
        value = getattr(part, key.name)
        shown = toml_value(part.model_dump(mode="json")[key.name]) if value is not None else ""
        if key.name in part.model_fields_set and value is not None:
            text += f"{key.name} = {shown}\n"
        else:
            text += f"# {key.name} = {shown or key.default}".rstrip() + "\n"
    return text


def _comment(text: str) -> str:
    lines = textwrap.wrap(" ".join(text.split()), WIDTH - 2)
    return "".join(f"# {line}\n" for line in lines)


def _summary(section: type[Section]) -> str:
    return (inspect.getdoc(section) or "").split("\n\n")[0]


def _key(name: str, field: FieldInfo, meaning: str) -> Key:
    default = "" if field.is_required() or field.default is None else toml_value(_plain(field.default))
    return Key(name, _allowed(field), default, meaning)


def _plain(value: Any) -> Any:
    return [_plain(one) for one in value] if isinstance(value, tuple) else value


def _members(annotation: Any) -> list[Any]:
    """Types of a union, without their annotations."""
    if typing.get_origin(annotation) is typing.Annotated:
        return _members(typing.get_args(annotation)[0])
    if typing.get_origin(annotation) in (typing.Union, types.UnionType):
        return [one for part in typing.get_args(annotation) for one in _members(part)]
    return [annotation]


def _allowed(field: FieldInfo) -> str:
    """Allowed values of a key, in words."""
    kinds = [one for one in _members(field.annotation) if one is not type(None)]
    if typing.get_origin(kinds[0]) is typing.Literal:
        return " or ".join(toml_value(one) for one in typing.get_args(kinds[0]))
    name = {float: "number", int: "whole number", bool: "true or false", str: "text"}.get(kinds[0], "list")
    limits = _limits(field.annotation) | {
        key: getattr(one, key) for one in field.metadata for key in ("ge", "le") if hasattr(one, key)
    }
    if {"ge", "le"} <= set(limits) and name.endswith("number"):
        return f"{name} from {limits['ge']:g} to {limits['le']:g}"
    return name


def _limits(annotation: Any) -> dict[str, float]:
    """Bounds `ge` and `le` in all parts of an annotation."""
    found = {}
    if typing.get_origin(annotation) is typing.Annotated:
        for one in annotation.__metadata__:
            for part in [one, *getattr(one, "metadata", ())]:
                found |= {key: getattr(part, key) for key in ("ge", "le") if hasattr(part, key)}
    if typing.get_origin(annotation) in (typing.Union, types.UnionType):
        for part in typing.get_args(annotation):
            found |= _limits(part)
    return found
