"""What every part of a model says of itself: its name, its energies and its readings."""

from __future__ import annotations

import abc
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax

from jaxsph.core.arrays import Array, Components, Float, Scalar
from jaxsph.model.meaning import Entry, Exchange, Oscillation, Reading

__all__ = ["AbstractPart", "Sampled"]


class Sampled(NamedTuple):
    """What a part's readings at a sample are made from, besides the part's own state."""

    x: Components
    """Places of the particles, one array an axis, m."""
    V: Float[Array, " N"]
    """Volumes of the particles, m3 (m2 in 2-D)."""
    rho0: Scalar
    """Density of water at zero gauge pressure, kg/m3."""
    dx: Scalar
    """Particle spacing, m."""
    interval: Scalar
    """Time since the last sample, s."""


class AbstractPart(eqx.Module):
    """A part of a model: a moving solid, a body, a chamber, a damper, an outlet.

    Its energies and its readings have its name behind them, `P_a_left` of a chamber called "left", unless
    that is the usual one, as of the only part of its kind.
    """

    name: eqx.AbstractVar[str]
    """Key of the part's state in `State.parts`."""
    usual_name: ClassVar[str] = ""
    """Name of the only part of its kind in a model."""

    def called(self, what: str) -> str:
        """Name of an energy or a reading of this part, from what it is."""
        return what if self.name == self.usual_name else f"{what}_{self.name}"

    @abc.abstractmethod
    def entries(self) -> Mapping[str, Entry]:
        """Meaning of the energies that the part books, by their names in the ledger."""

    def harvest(self) -> tuple[str, ...]:
        """Names in the ledger of the energies that the part's power take-off takes."""
        return tuple(name for name, entry in self.entries().items() if entry.exchange is Exchange.HARVESTED)

    def readings(self, dim: int) -> Mapping[str, Reading]:
        """Unit and meaning of the readings of `read`, by name, in so many dimensions; none by default."""
        del dim
        return {}

    def read(self, state: Any, sampled: Sampled) -> Mapping[str, jax.Array]:
        """Readings of the part at a sample, by name; `state`: its own, `State.parts[name]`."""
        del state, sampled
        return {}

    def oscillations(self, dim: int) -> Mapping[str, Oscillation]:
        """Readings whose amplitude in regular waves is a result, by the name of what swings; none by default.

        The results are called `amplitude_NAME`, `mean_NAME` and, over the waves' amplitude, `rao_NAME`.
        """
        del dim
        return {}
