"""What a fast model needs to know about a kind of device: linear theory in JAX, and what runs add to it."""

from __future__ import annotations

import abc
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, Self

import jax

from jaxsph.case.case import Case
from jaxsph.core.chebyshev import Series
from jaxsph.waves.fast_owc import Incident

__all__ = ["AbstractFastTheory", "Fitted", "Predictable", "Values"]

Values = Mapping[str, Any]
"""Numbers or traced values by name."""


class Predictable(NamedTuple):
    """A result that a model predicts."""

    text: str
    unit: str
    """Unit per metre of width; empty for a ratio."""
    like: str
    """Result of the runs whose relative error it has, by the names in `AbstractFastTheory.read`."""


class Fitted(NamedTuple):
    """How additions are fitted to runs; each field has the form of the additions."""

    start: Any
    """Values from which a fit starts."""
    scale: Any
    """Typical sizes."""
    low: Any
    high: Any


@dataclass(frozen=True)
class AbstractFastTheory(abc.ABC):
    """Linear theory of a case's device in waves, in JAX, with additions that are found from runs.

    Additions are named tuples of numbers, or of tuples of numbers.
    """

    case: Case
    water: Any
    """Response of the water in linear theory."""

    power: ClassVar[str]
    """Name of the mean absorbed power among the predictable results."""
    smooth: ClassVar[bool] = True
    """Whether results are smooth functions of the parameters, so that a gradient search finds the best."""

    @classmethod
    @abc.abstractmethod
    def why_not(cls, case: Case) -> str:
        """Reason why the theory does not cover a case; empty if it does."""

    @classmethod
    @abc.abstractmethod
    def of(cls, case: Case, omega: tuple[float, ...]) -> Self:
        """Theory of a case for the ranges of angular frequency between successive values of omega (rad/s)."""

    @classmethod
    @abc.abstractmethod
    def restored(cls, case: Case, series: Series) -> Self:
        """Theory of a case with series over the frequency that were found before."""

    @property
    def series(self) -> Series:
        """Series over the frequency."""
        return self.water.series

    @classmethod
    @abc.abstractmethod
    def keys(cls, case: Case) -> dict[str, str]:
        """Parameters of a case's device that a model can change, with their names in `respond`."""

    @classmethod
    @abc.abstractmethod
    def dampings(cls, case: Case) -> tuple[str, ...]:
        """Parameters of `keys` that differ between the runs of a calibration, besides the waves."""

    @classmethod
    def signed(cls, case: Case) -> dict[str, str]:
        """Parameters of `keys` that may be zero or negative; none by default."""
        del case
        return {}

    @classmethod
    @abc.abstractmethod
    def moves(cls, case: Case, parameter: str) -> bool:
        """Whether a parameter of the device, such as a length, needs a theory of its own for each value."""

    @property
    @abc.abstractmethod
    def read(self) -> dict[str, str]:
        """Results of a run to which a model is fitted, by the names of the model's results."""

    @property
    @abc.abstractmethod
    def predictable(self) -> dict[str, Predictable]:
        """Results that a model predicts."""

    @property
    @abc.abstractmethod
    def additions(self) -> Fitted:
        """How the additions are fitted."""

    @abc.abstractmethod
    def additions_from(self, given: Values) -> Any:
        """Additions from their names and values in a file."""

    @abc.abstractmethod
    def found(self, added: Any, error: Any) -> list[tuple[str, str]]:
        """Labels and values of additions with their standard errors, to be printed."""

    @abc.abstractmethod
    def respond(self, added: Any, values: Values, waves: Incident) -> Any:
        """Response to waves, with parameters of the device by the names in `keys`; may be traced."""

    @abc.abstractmethod
    def results(self, response: Any) -> dict[str, jax.Array]:
        """Results in a response, by the names in `predictable`."""

    @abc.abstractmethod
    def within(self, values: Values) -> Any:
        """Whether the device is in the range of the model."""
