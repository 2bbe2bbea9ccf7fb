"""Base class of the sections of a case file, ranges of numbers, and sections of several kinds."""

from __future__ import annotations

import ast
import functools
import inspect
import itertools
import re
import textwrap
import typing
from collections.abc import Callable, Collection, Mapping
from typing import Annotated, Any, cast

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

# Ranges wide enough for every tank, and narrow enough that no product of a few values overflows float32.
Length = Annotated[float, Field(ge=1e-5, le=1e5)]
Coordinate = Annotated[float, Field(ge=-1e5, le=1e5)]
Time = Annotated[float, Field(ge=1e-9, le=1e9)]
Duration = Annotated[float, Field(ge=0, le=1e9)]
Inertia = Annotated[float, Field(ge=1e-9, le=1e15)]
Density = Annotated[float, Field(ge=1e-3, le=1e5)]
Speed = Annotated[float, Field(ge=1e-6, le=1e6)]
Velocity = Annotated[float, Field(ge=-1e4, le=1e4)]
Coefficient = Annotated[float, Field(ge=0, le=1e15)]
Angle = Annotated[float, Field(ge=-6.3, le=6.3)]
Harmonic = Annotated[float, Field(ge=-10, le=10)]
Point = Annotated[tuple[Coordinate, ...], Field(max_length=3)]


def _plain_name(name: str) -> str:
    """Name of a part, unchanged; the names of the part's readings end with this name. **Raises** ValueError
    if the name is not valid."""
    if not re.fullmatch(r"[a-z][a-z0-9_]{0,39}", name):
        raise ValueError(
            "must begin with a lower-case letter; up to 39 more lower-case letters, digits and "
            "underscores may follow"
        )
    return name


Name = Annotated[str, AfterValidator(_plain_name)]
"""Name chosen in a case for a part: lower-case letters, digits and underscores."""
NAME = "NAME"
"""Placeholder in lists of keys for a name chosen in a case, as in `solid.NAME.polygon`."""
MOST_POINTS = 10_000
"""Largest number of points in one list of probes."""


class Section(BaseModel):
    """Section of a case file: keys with types, ranges and defaults. Immutable."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True, defer_build=True)

    @property
    def changed(self) -> list[str]:
        """Keys whose values are not the defaults."""
        fields = type(self).model_fields.items()
        return [key for key, field in fields if getattr(self, key) != field.get_default()]

    def refuse(self, keys: Collection[str], where: str, instead: str) -> None:
        """Refuses keys that would be ignored.

        **Arguments**: the `keys`; `where` they have no effect; what the user may do `instead` of removing
        them. **Raises** ValueError if a key differs from its default.
        """
        given = [key for key in self.changed if key in keys]
        if given:
            raise ValueError(
                f"{' and '.join(given)} {'have' if len(given) > 1 else 'has'} no effect {where}; {instead}, "
                f"or remove {'these keys' if len(given) > 1 else given[0]}"
            )


@functools.cache
def meanings(section: type[Section]) -> dict[str, str]:
    """Meanings of a section's keys: the docstring below each field, on one line.

    The docstrings are read here, on demand; pydantic would read them at the start of every run.
    """
    found: dict[str, str] = {}
    for part in reversed(section.__mro__):
        if not issubclass(part, Section):
            continue
        (written,) = ast.parse(textwrap.dedent(inspect.getsource(part))).body
        for one, below in itertools.pairwise(cast(ast.ClassDef, written).body):
            match one, below:
                case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=str(text))):
                    found[name] = " ".join(text.split())
    return found


def by_name(annotation: Any) -> bool:
    """Whether a field holds sections under names chosen in the case, as in `[solid.bed]`."""
    return typing.get_origin(annotation) is dict


def choice(names: Collection[str], what: str) -> str:
    """Advice to choose one of the `names`, as text; without names, statement that the case has no `what`."""
    return f"choose from {', '.join(names)}" if names else f"the case has no {what}"


def kind_of(kinds: Mapping[str, type[Section]]) -> Callable[[Any], Any]:
    """Function that returns the `kind` of a section, or of a mapping to be validated as a section. A mapping
    without a kind has the first of the `kinds`."""
    usual = next(iter(kinds))

    def kind(section: Any) -> Any:
        return section.get("kind", usual) if isinstance(section, Mapping) else getattr(section, "kind", None)

    return kind
