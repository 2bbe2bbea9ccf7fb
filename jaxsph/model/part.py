"""Interface of every part of a model: its name, its energies and its readings."""

from __future__ import annotations

import abc
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax

from jaxsph.core.arrays import Array, Components, Float, Scalar
from jaxsph.model.meaning import Entry, Exchange, Oscillation, Reading

__all__ = ["AbstractPart", "Sampled", "name_of"]


def name_of(what: str, part: str, usual: str) -> str:
    """Name of the energy or reading `what` of a part, followed by the part's name unless the part has the
    usual name."""
    return what if part == usual else f"{what}_{part}"


class Sampled(NamedTuple):
    """Data for a part's readings at a sample, in addition to the part's state."""

    x: Components
    """Positions of the particles, one array per axis, m."""
    V: Float[Array, " N"]
    """Volumes of the particles, m3 (m2 in 2-D)."""
    rho0: Scalar
    """Density of water at zero gauge pressure, kg/m3."""
    dx: Scalar
    """Particle spacing, m."""
    interval: Scalar
    """Time since the last sample, s."""
    parts: Mapping[str, Any]
    """States of all parts of the model, by name."""


class AbstractPart(eqx.Module):
    """A part of a model: a moving solid, a body, a chamber, a damper, an outlet.

    The names of a part's energies and readings end with the part's name, for example `P_a_left` for a chamber
    called "left". The suffix is omitted for a part with the usual name, which is normally the only part of
    its kind.
    """

    name: eqx.AbstractVar[str]
    """Key of the part's state in `State.parts`."""
    usual_name: ClassVar[str] = ""
    """Default name, for the only part of its kind in a model."""

    def called(self, what: str) -> str:
        """Name of this part's energy or reading `what`, followed by the part's name unless the part has the
        usual name."""
        return name_of(what, self.name, self.usual_name)

    @abc.abstractmethod
    def entries(self) -> Mapping[str, Entry]:
        """Meaning of the energies that the part adds to the ledger, by name."""

    def harvest(self) -> tuple[str, ...]:
        """Ledger names of the energies that the part's power take-off harvests."""
        return tuple(name for name, entry in self.entries().items() if entry.exchange is Exchange.HARVESTED)

    def readings(self, dim: int) -> Mapping[str, Reading]:
        """Unit and meaning of the readings of `read`, by name, in `dim` dimensions; empty by default."""
        del dim
        return {}

    def read(self, state: Any, sampled: Sampled) -> Mapping[str, jax.Array]:
        """Readings of the part at a sample, by name; `state`: the part's state, `State.parts[name]`."""
        del state, sampled
        return {}

    def oscillations(self, dim: int) -> Mapping[str, Oscillation]:
        """Oscillations whose amplitude in regular waves is a result, by name; empty by default.

        The results are `amplitude_NAME` and, as the `Oscillation` states, `rao_NAME` (relative to the
        amplitude of the waves), `mean_NAME` and `drift_NAME`.
        """
        del dim
        return {}
