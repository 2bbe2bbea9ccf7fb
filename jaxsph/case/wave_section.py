"""Base class of the wave sections of a case, with the keys that all kinds of waves have."""

from __future__ import annotations

import abc
import functools
from collections.abc import Hashable
from typing import Annotated, ClassVar, cast

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator

from jaxsph.case.section import Length, Section
from jaxsph.waves import second_order

Height = Annotated[float, Field(ge=1e-6, le=1e5)]
Period = Annotated[float, Field(ge=1e-3, le=1e4)]
Waves = tuple[NDArray[np.complexfloating], NDArray[np.floating]]
"""Complex amplitudes (m) of waves at the paddle, and their angular frequencies (rad/s)."""


class AbstractWavesSection(Section, abc.ABC):
    """Waves made by a paddle at x = 0, or by a relaxation zone in front of the paddle."""

    height_key: ClassVar[str]
    """Name of the key that sets the wave height."""
    period_key: ClassVar[str]
    """Name of the key that sets the wave period."""
    least_length: ClassVar[int] = 40
    """Smallest allowed ratio of the wavelength to the particle spacing (-). A sea needs a larger ratio than
    regular waves, because in deep water its shortest waves have an eighth of the peak wavelength."""

    ramp_periods: float = Field(2.0, ge=0, le=1e4)
    """Number of periods over which the paddle's amplitude grows from zero."""
    second_order: bool = True
    """Whether the paddle's motion is corrected to second order, which suppresses free waves of second
    order."""
    absorption: bool = True
    """Whether the paddle absorbs waves that return to it (active absorption)."""
    zone: Length | None = None
    """Length of a relaxation zone in front of the paddle, m. The zone makes the waves and absorbs those that
    return; it replaces wavemaking and absorption by the paddle."""
    direction: float = 0.0
    """Direction towards which the waves travel, rad from the tank's axis towards the y axis. Oblique waves
    need a tank with a width, and a `zone`."""
    side_zones: Length | None = None
    """Width of relaxation zones along both side walls, m. The zones transmit oblique waves, and absorb waves
    that bodies reflect or radiate sideways; only with `zone`."""

    @field_validator("direction")
    @classmethod
    def _into_the_tank(cls, direction: float) -> float:
        if not abs(direction) < 0.5 * np.pi:
            raise ValueError(
                "must be between -pi/2 and pi/2 rad, because waves travel into the tank; 20 degrees are "
                "0.349 rad"
            )
        return direction

    @property
    @abc.abstractmethod
    def period(self) -> float:
        """Period of the waves, or peak period of their spectrum, s."""

    @property
    @abc.abstractmethod
    def height(self) -> float:
        """Height of the waves, or significant wave height, m."""

    @property
    def cycle(self) -> float:
        """Duration of a cycle, s; results are averaged over whole cycles."""
        return self.period

    @abc.abstractmethod
    def sum_of_waves(self, depth: float, g: float) -> Waves:
        """Complex amplitudes (m) at the paddle and angular frequencies (rad/s) of the waves' sinusoidal
        components.

        **Arguments**: `depth` of the water (m); acceleration of gravity `g` (m/s2).
        """

    @property
    def oblique(self) -> bool:
        """Whether some waves do not travel along the tank."""
        return self.direction != 0.0

    def directions(self, count: int) -> NDArray[np.floating]:
        """Directions of the `count` waves of `sum_of_waves`, rad from the tank's axis."""
        return np.full(count, self.direction)

    @property
    def repeats(self) -> float | None:
        """Time after which the waves repeat, s; None for regular and bichromatic waves."""
        return None

    def highest(self, depth: float, g: float) -> float:
        """Height of the highest expected wave, m: twice the largest elevation at the paddle."""
        return _highest(cast(Hashable, self), depth, g)

    def stroke(self, depth: float, g: float) -> float:
        """Stroke of the paddle from end to end, m: twice its largest first-order displacement."""
        return _stroke(cast(Hashable, self), depth, g)

    @property
    def times(self) -> NDArray[np.float64]:
        """Times at which elevation and paddle displacement are computed to find their extremes, s."""
        return np.arange(0.0, self.cycle if self.repeats is None else self.repeats, 0.04 * self.period)


# the sums over a long sea take seconds, and the geometry of a case is computed many times
@functools.lru_cache(maxsize=64)
def _highest(waves: AbstractWavesSection, depth: float, g: float) -> float:
    """See `AbstractWavesSection.highest`."""
    a, omega = waves.sum_of_waves(depth, g)
    return 2.0 * float(np.max(np.abs(second_order.Harmonics(a, omega, omega).at(waves.times))))


@functools.lru_cache(maxsize=64)
def _stroke(waves: AbstractWavesSection, depth: float, g: float) -> float:
    """See `AbstractWavesSection.stroke`."""
    a, omega = waves.sum_of_waves(depth, g)
    return 2.0 * float(np.max(np.abs(second_order.displacement(a, omega, depth, g).at(waves.times))))
