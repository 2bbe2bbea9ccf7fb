"""Types: what evolves (`State`), what stays (`Model`), what comes out (`Solution`), and the interfaces.

SI units. x runs along the tank from the wavemaker's rest position; the last axis points up and z = 0 is
the bed. In two dimensions everything is per metre of width.
"""

from __future__ import annotations

from typing import Any

import equinox as eqx
import numpy as np

from jaxsph.model.interfaces import (
    Model,
)
from jaxsph.model.state import State


class Solution(eqx.Module):
    """What a run gives: the samples as numpy arrays, the last state, and what to call things."""

    series: dict[str, np.ndarray]
    """Each reading at every sample, `[T]` or `[T, k]`; "time" among them."""
    units: dict[str, tuple[str, str]] = eqx.field(static=True)
    """(units, long name) of each reading."""
    model: Model
    state: State
    case: Any = None
    results: dict[str, float] | None = None
    """Scalars made from the series: efficiency, powers, reflection (see `analysis`)."""
    notices: tuple[str, ...] = eqx.field(static=True, default=())
    """What is to be said of the results: those that could not be made, and why."""

    @property
    def t(self) -> np.ndarray:
        """Sample times, s."""
        return self.series["time"]

    def __getitem__(self, name: str) -> np.ndarray:
        """The reading called `name`."""
        if name not in self.series:
            raise KeyError(f"no reading {name!r}; there are {', '.join(sorted(self.series))}")
        return self.series[name]
