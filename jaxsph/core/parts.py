"""Names of the parts of a time step, under which profilers show the step's operations."""

from __future__ import annotations

import enum
from collections.abc import Callable
from typing import Any, TypeVar, cast

import jax

F = TypeVar("F", bound=Callable[..., Any])


ITERATION = "iteration"
"""Name under which profilers show an iteration of the pressure solver."""


class Part(enum.Enum):
    """Part of a time step; the value is the part's name in a profile."""

    SEARCH = "neighbour search"
    GHOSTS = "ghosts of the walls"
    WALLS = "moving walls"
    MOMENTUM = "momentum"
    CONTINUITY = "continuity"
    VISCOSITY = "viscosity"
    EQUATION = "weights of the pressure equation"
    SOLVER = "pressure solver"
    PRESSURE = "pressure force"
    BODIES = "bodies"
    AIR = "air of the chambers"
    REGULARISATION = "regularisation"
    CHECKS = "checks of the state"
    PROBES = "probes"

    def scope(self) -> Callable[[F], F]:
        """Decorator that puts all operations traced in a function under the part's name."""
        return cast(Callable[[F], F], jax.named_scope(self.value))
