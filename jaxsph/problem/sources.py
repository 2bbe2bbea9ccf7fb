"""Sources of what users give in the place of a problem: a case, a function, or a problem itself."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

from jaxsph.errors import CaseError
from jaxsph.problem.problem import Problem
from jaxsph.problem.program import Program
from jaxsph.problem.source import Source
from jaxsph.problem.toml import toml_text


class Assembled:
    """Source of a problem that was put together in a program: it is what it is, and is not made again."""

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
        """See `Source`: **raises** CaseError, for a value that has been spent cannot change."""
        raise CaseError(f"{', '.join(changes)}: the problem {self.name!r} is made already: give its function")

    def value(self, name: str) -> Any:
        """See `Source`."""
        return self.replace({name: None})

    def to_toml(self) -> str:
        """See `Source`."""
        return toml_text({"name": self.name, "program": ""})

    def roughness(self, name: str) -> str:
        """See `Source`."""
        return f"the problem {self.name!r} is made already"


def source_of(given: Any) -> Source:
    """Source of a case, a problem, or a function that returns one. **Raises** CaseError for anything else."""
    if isinstance(given, Problem):
        return Assembled(given)
    if isinstance(given, Source):
        return given
    if callable(given):
        return Program(cast(Callable[..., Problem], given))
    raise CaseError(
        f"{type(given).__name__}: cannot be run: give a js.Case, a js.Problem, or a function that returns one"
    )
