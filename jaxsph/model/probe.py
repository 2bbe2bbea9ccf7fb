"""Interface of a probe, which takes readings of the state inside the time loop."""

from __future__ import annotations

import abc
from collections.abc import Mapping

import equinox as eqx
import jax
import numpy as np

from jaxsph.model.interfaces import Model
from jaxsph.model.meaning import Reading
from jaxsph.model.state import State, Tables

__all__ = ["AbstractProbe", "places"]

Coordinates = Mapping[str, tuple[str, np.ndarray, str, str]]
"""Positions of gauges and sensors, by name: (dimension, values `[k]`, unit, long name)."""


class AbstractProbe(eqx.Module):
    """A probe: readings of the state, taken inside the time loop."""

    @abc.abstractmethod
    def measure(self, model: Model, state: State, tables: Tables) -> Mapping[str, jax.Array]:
        """Readings at the state's time, by name."""

    @abc.abstractmethod
    def describe(self) -> Mapping[str, Reading]:
        """Unit and meaning of every reading, by name."""

    def coordinates(self) -> Coordinates:
        """Coordinates of the second dimensions of the readings, by name; empty by default."""
        return {}


def places(points: jax.Array | np.ndarray, dimension: str, what: str, axes: str) -> Coordinates:
    """Coordinates of points `[k, D]` (m) by name, for example "sensor_x"; `axes` has a letter for each axis.

    The values are the decimal numbers as given, without the rounding error of single precision.
    """
    values = np.asarray(points).astype(str).astype(float)
    columns = zip(axes, values.T, strict=True)
    return {f"{dimension}_{axis}": (dimension, row, "m", f"{axis} of the {what}") for axis, row in columns}
