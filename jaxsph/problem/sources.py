"""What a user may run: a case, a function that returns a problem, or a problem. Each becomes a `Source`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

from jaxsph.errors import CaseError
from jaxsph.problem.problem import Problem
from jaxsph.problem.program import Program
from jaxsph.problem.source import Source
from jaxsph.problem.toml import toml_text


class Assembled:
    """Source of a problem that is already built; its values can no longer be changed."""

    def __init__(self, problem: Problem) -> None:
        """**Arguments**: the problem."""
        self._problem = problem

    @property
    def name(self) -> str:
        """Name of the problem."""
        return self._problem.name

    def problem(self) -> Problem:
        """The problem."""
        return self._problem

    def replace(self, changes: dict[str, Any]) -> Assembled:
        """See `Source.replace`: always **raises** CaseError, since the problem is already built."""
        raise CaseError(
            f"{', '.join(changes)}: the problem {self.name!r} is already built and cannot change; give the "
            "function that builds the problem"
        )

    def value(self, name: str) -> Any:
        """See `Source.value`."""
        return self.replace({name: None})

    def built(self, name: str) -> Any:
        """See `Source.built`."""
        return self.value(name)

    def to_toml(self) -> str:
        """See `Source.to_toml`."""
        return toml_text({"name": self.name, "program": ""})

    def roughness(self, name: str) -> str:
        """See `Source.roughness`."""
        return f"the problem {self.name!r} is already built"


def source_of(given: Any) -> Source:
    """Source of a case, a problem, or a function that returns a problem. **Raises** CaseError otherwise."""
    if isinstance(given, Problem):
        return Assembled(given)
    if isinstance(given, Source):
        return given
    if callable(given):
        return Program(cast(Callable[..., Problem], given))
    raise CaseError(
        f"{type(given).__name__} cannot be run: give a js.Case, a js.Problem, or a function that returns a "
        "js.Problem"
    )
