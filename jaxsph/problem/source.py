"""Source of a problem, from which it can be rebuilt with other values."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from typing import Any, Protocol, Self, runtime_checkable

from jaxsph.problem.problem import Problem


@runtime_checkable
class Source(Protocol):
    """Source of a problem: a case with its keys, or a function with its arguments."""

    @property
    def name(self) -> str:
        """Name of the source, used for names of files."""
        ...

    def problem(self) -> Problem:
        """Builds the problem. **Raises** CaseError if it cannot be built."""
        ...

    def replace(self, changes: dict[str, Any]) -> Self:
        """Copy with `changes` by name; None removes a value. **Raises** CaseError for an invalid change."""
        ...

    def value(self, name: str) -> Any:
        """Value called `name`; None if no value is given. **Raises** CaseError for an unknown name."""
        ...

    def built(self, name: str) -> Any:
        """Value with which the problem is built; a case rounds some lengths to fit the particle spacing."""
        ...

    def to_toml(self) -> str:
        """All that defines the problem, as TOML text to store in a file."""
        ...

    def roughness(self, name: str) -> str:
        """Reason why the model may not depend smoothly on a value; empty if the dependence
        is smooth, or if only a test can tell."""
        ...


def identity(text: str) -> dict[str, Any]:
    """Returns the values in a source's TOML text by dotted name. Two sources are equal if these values
    are equal."""
    return _flat(tomllib.loads(text))


def _flat(section: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, value in section.items():
        found |= _flat(value, f"{before}{name}.") if isinstance(value, dict) else {before + name: value}
    return found
