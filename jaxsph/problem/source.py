"""Source of a problem: what it is made of, so that it can be made again with other values."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from typing import Any, Protocol, Self, runtime_checkable

from jaxsph.problem.problem import Problem


@runtime_checkable
class Source(Protocol):
    """What a problem is made of: a case's keys, or a function and its arguments."""

    @property
    def name(self) -> str:
        """Name, after which files are called."""
        ...

    def problem(self) -> Problem:
        """Makes the problem. **Raises** CaseError where it cannot be made."""
        ...

    def replace(self, changes: dict[str, Any]) -> Self:
        """A copy with values changed, by name; None removes one. **Raises** CaseError."""
        ...

    def value(self, name: str) -> Any:
        """Value called `name`; None where it is not given. **Raises** CaseError where there is none."""
        ...

    def to_toml(self) -> str:
        """All that makes the problem, as TOML text, which a file keeps."""
        ...

    def roughness(self, name: str) -> str:
        """Why the model may not depend smoothly on a value; empty where it does, or where that is not known
        before it is tried."""
        ...


def identity(text: str) -> dict[str, Any]:
    """Values of a source by dotted name, from its TOML text: two are the same where these are."""
    return _flat(tomllib.loads(text))


def _flat(section: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, value in section.items():
        found |= _flat(value, f"{before}{name}.") if isinstance(value, dict) else {before + name: value}
    return found
