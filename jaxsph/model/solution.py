"""Solution of a run: the series of its readings, its last state and its results."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import equinox as eqx
import numpy as np

from jaxsph.model.interfaces import Model
from jaxsph.model.meaning import Label
from jaxsph.model.state import State


class Solution(eqx.Module):
    """Result of a run: the samples as numpy arrays with their units and names, and the last state."""

    series: dict[str, np.ndarray]
    """Series of every reading by name, `[T]` or `[T, k]`, in the units of `units`, and "time" (s)."""
    units: Mapping[str, tuple[Any, ...]] = eqx.field(static=True)
    """Pair (unit, long name) of each reading, by its name."""
    model: Model
    """Model of the run."""
    state: State
    """State at the end of the run."""
    case: Any = None
    """Case or other source of the run; None for a model that `march` has run."""
    results: dict[str, float] | None = None
    """Scalar results computed from the series, by name, such as the efficiency (`jaxsph.analysis`)."""
    notices: tuple[str, ...] = eqx.field(static=True, default=())
    """Notices about the averaging of the results, and about results that could not be computed."""
    labels: Mapping[str, Label] = eqx.field(static=True, default_factory=dict)
    """Labels of the problem's results, by name."""

    @property
    def t(self) -> np.ndarray:
        """Times of the samples, s."""
        return self.series["time"]

    def __getitem__(self, name: str) -> np.ndarray:
        """Series of the reading `name`. **Raises** KeyError if there is no such reading."""
        if name not in self.series:
            raise KeyError(f"no reading {name!r}; use one of {', '.join(sorted(self.series))}")
        return self.series[name]
