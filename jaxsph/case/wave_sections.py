"""Wave sections of a case: regular, bichromatic, irregular and focused waves, and recorded series.

Each section gives the height and the period of the waves, and their sinusoidal components.
"""

from __future__ import annotations

import abc
from typing import Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Discriminator, Field, Tag, model_validator

from jaxsph.case.section import Coordinate, Length, Section, Time, kind_of
from jaxsph.waves import second_order, spectra

Height = Annotated[float, Field(ge=1e-6, le=1e5)]
Period = Annotated[float, Field(ge=1e-3, le=1e4)]
Waves = tuple[NDArray[np.complexfloating], NDArray[np.floating]]
"""Complex amplitudes (m) of waves at the paddle, and their angular frequencies (rad/s)."""

MOST_PERIODS = 500
"""Largest repeat time of a sea, in peak periods. For such a sea, computing the second-order terms of all
pairs of components takes half a minute."""
MOST_WAVES = 600
"""Largest number of sinusoidal components of a recorded series that are kept: those of largest amplitude."""
MOST_SAMPLES = 20_000
"""Largest number of samples of a recorded series; every run file stores the series as text."""


class AbstractWavesSection(Section, abc.ABC):
    """Waves made by a piston at x = 0."""

    height_key: ClassVar[str]
    """Name of the key that sets the wave height."""
    period_key: ClassVar[str]
    """Name of the key that sets the wave period."""
    least_length: ClassVar[int] = 40
    """Smallest allowed ratio of the wavelength to the particle spacing (-). A sea needs a larger ratio than
    regular waves, because the sea contains waves of a seventh of the peak wavelength."""

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
    def repeats(self) -> float | None:
        """Time after which the waves repeat, s; None for regular and bichromatic waves."""
        return None

    def highest(self, depth: float, g: float) -> float:
        """Height of the highest expected wave, m: twice the largest elevation at the paddle."""
        a, omega = self.sum_of_waves(depth, g)
        waves = second_order.Harmonics(a, omega, omega)
        return 2.0 * float(np.max(np.abs(waves.at(self._times))))

    def stroke(self, depth: float, g: float) -> float:
        """Stroke of the paddle from end to end, m: twice its largest first-order displacement."""
        a, omega = self.sum_of_waves(depth, g)
        motion = second_order.displacement(a, omega, depth, g)
        return 2.0 * float(np.max(np.abs(motion.at(self._times))))

    @property
    def _times(self) -> NDArray[np.float64]:
        """Times at which elevation and paddle displacement are computed to find their extremes, s."""
        return np.arange(0.0, self.cycle if self.repeats is None else self.repeats, 0.04 * self.period)


class RegularWavesSection(AbstractWavesSection):
    """Regular waves: `kind = "regular"`, or no kind."""

    least_length = 4
    height_key = "H"
    period_key = "T"
    kind: Literal["regular"] = "regular"
    """Kind of waves; each kind has its own keys."""
    H: Height
    """Wave height from trough to crest, m."""
    T: Period
    """Wave period, s."""

    @property
    def period(self):
        """See `AbstractWavesSection.period`."""
        return self.T

    @property
    def height(self):
        """See `AbstractWavesSection.height`."""
        return self.H

    def sum_of_waves(self, depth, g):
        """See `AbstractWavesSection.sum_of_waves`."""
        return np.array([0.5 * self.H + 0j]), np.array([2.0 * np.pi / self.T])

    def highest(self, depth, g):
        """See `AbstractWavesSection.highest`."""
        return self.H

    def stroke(self, depth, g):
        """See `AbstractWavesSection.stroke`."""
        return self.H / float(second_order.piston_transfer(np.array(2.0 * np.pi / self.T), depth, g))


class BichromaticWavesSection(AbstractWavesSection):
    """Two superposed regular waves, which form groups: `kind = "bichromatic"`."""

    least_length = 4
    height_key = "H"
    period_key = "T"
    kind: Literal["bichromatic"] = "bichromatic"
    """Kind of waves; each kind has its own keys."""
    H: tuple[Height, Height]
    """Heights of the two waves from trough to crest, m."""
    T: tuple[Period, Period]
    """Periods of the two waves, s."""

    @model_validator(mode="after")
    def _two(self) -> BichromaticWavesSection:
        if abs(self.T[0] / self.T[1] - 1.0) < 1e-3:
            raise ValueError(f"T = {list(self.T)}: the two periods must differ by at least a thousandth")
        return self

    @property
    def period(self):
        """See `AbstractWavesSection.period`: the period of the higher wave."""
        return self.T[int(np.argmax(self.H))]

    @property
    def height(self):
        """See `AbstractWavesSection.height`."""
        return float(np.hypot(*self.H) * np.sqrt(2.0))  # four standard deviations

    @property
    def cycle(self):
        """See `AbstractWavesSection.cycle`: the duration of a wave group."""
        return 1.0 / abs(1.0 / self.T[0] - 1.0 / self.T[1])

    def highest(self, depth, g):
        """See `AbstractWavesSection.highest`."""
        return sum(self.H)

    def sum_of_waves(self, depth, g):
        """See `AbstractWavesSection.sum_of_waves`: both waves have a crest at the paddle at t = 0."""
        return 0.5 * np.array(self.H) + 0j, 2.0 * np.pi / np.array(self.T)


class _SpectralSection(AbstractWavesSection):
    """Waves with a given spectrum."""

    spectrum: Literal["jonswap", "pierson_moskowitz", "bretschneider"] = "jonswap"
    """Spectrum: JONSWAP (a growing sea), Pierson-Moskowitz (a fully developed sea, whose height follows from
    Tp) or Bretschneider (independent height and period)."""
    Tp: Period
    """Peak period, s."""
    gamma: float | None = Field(None, ge=1, le=20)
    """Peak enhancement factor of a JONSWAP spectrum (-); by default 3.3."""

    @model_validator(mode="after")
    def _gamma(self) -> _SpectralSection:
        if self.gamma is not None and self.spectrum != "jonswap":
            raise ValueError(
                f'gamma = {self.gamma:g}: applies to spectrum = "jonswap" only; remove the key, or choose '
                "this spectrum"
            )
        return self

    @property
    def period(self):
        """See `AbstractWavesSection.period`."""
        return self.Tp

    def shape(self, Hs: float) -> spectra.AbstractSpectrum:
        """Spectrum with the significant wave height Hs (m)."""
        if self.spectrum == "jonswap":
            return spectra.JONSWAP(Hs, self.Tp, 3.3 if self.gamma is None else self.gamma)
        return spectra.Bretschneider(Hs, self.Tp)


class IrregularWavesSection(_SpectralSection):
    """A sea state: `kind = "irregular"`."""

    height_key = "Hs"
    period_key = "Tp"
    kind: Literal["irregular"] = "irregular"
    """Kind of waves; each kind has its own keys."""
    Hs: Height | None = None
    """Significant wave height, m; omit it for a Pierson-Moskowitz spectrum, whose height follows from Tp."""
    seed: int = Field(0, ge=0, le=2**32 - 1)
    """Seed of the random phases; the same seed gives the same sea."""
    duration: Time | None = None
    """Time after which the sea repeats, s; by default 128 peak periods."""

    @model_validator(mode="after")
    def _whole(self) -> IrregularWavesSection:
        grown = self.spectrum == "pierson_moskowitz"
        if grown != (self.Hs is None):
            raise ValueError(
                f"Hs = {self.Hs}: the height of a Pierson-Moskowitz sea follows from Tp; remove the key, or "
                'set spectrum = "bretschneider"'
                if grown
                else f'spectrum = "{self.spectrum}" needs waves.Hs'
            )
        if not 16.0 * self.Tp <= self.repeats <= MOST_PERIODS * self.Tp:
            raise ValueError(
                f"duration = {self.duration:g} s: must be 16 to {MOST_PERIODS} peak periods "
                f"({16.0 * self.Tp:g} to {MOST_PERIODS * self.Tp:g} s)"
            )
        return self

    @property
    def height(self):
        """See `AbstractWavesSection.height`."""
        return spectra.pierson_moskowitz_height(self.Tp) if self.Hs is None else self.Hs

    @property
    def repeats(self):
        """See `AbstractWavesSection.repeats`."""
        return 128.0 * self.Tp if self.duration is None else self.duration

    def sum_of_waves(self, depth, g):
        """See `AbstractWavesSection.sum_of_waves`."""
        return spectra.draw_sea(self.shape(self.height), self.repeats, self.seed)


class FocusedWavesSection(_SpectralSection):
    """A wave group that focuses in one crest (NewWave): `kind = "focused"`."""

    height_key = "crest"
    period_key = "Tp"
    kind: Literal["focused"] = "focused"
    """Kind of waves; each kind has its own keys."""
    crest: Height
    """Elevation of the crest by linear theory, m."""
    x: Coordinate
    """Position of the focused crest, m from the paddle."""
    t: Time
    """Time at which the crest is at `x`, s."""

    @model_validator(mode="after")
    def _soon(self) -> FocusedWavesSection:
        if self.t > 0.25 * MOST_PERIODS * self.Tp:
            raise ValueError(f"t = {self.t:g} s: must be at most {0.25 * MOST_PERIODS:g} peak periods")
        return self

    @property
    def height(self):
        """See `AbstractWavesSection.height`: the significant height of a sea whose highest wave in a thousand
        has this crest."""
        return 2.0 * self.crest / 1.86

    @property
    def repeats(self):
        """See `AbstractWavesSection.repeats`: long enough to keep repeated groups apart."""
        return max(64.0 * self.Tp, 4.0 * self.t)

    def highest(self, depth, g):
        """See `AbstractWavesSection.highest`."""
        return 2.0 * self.crest

    def sum_of_waves(self, depth, g):
        """See `AbstractWavesSection.sum_of_waves`."""
        a, omega = spectra.draw_group(self.shape(1.0), self.repeats, self.crest)
        return a * np.exp(1j * (second_order.wavenumbers(omega, depth, g) * self.x - omega * self.t)), omega


class RecordedWavesSection(AbstractWavesSection):
    """Waves from a series of elevations or of the paddle's displacement: `kind = "recorded"`.

    Instead of `t` and either `eta` or `X`, a case file may give `file`, a CSV file with a header and the
    columns t (s) and either eta (m) or X (m).
    """

    height_key = "eta"
    period_key = "t"
    kind: Literal["recorded"] = "recorded"
    """Kind of waves; each kind has its own keys."""
    t: tuple[float, ...] = Field(min_length=32, max_length=MOST_SAMPLES)
    """Times of the samples, s, evenly spaced."""
    eta: tuple[float, ...] | None = Field(None, max_length=MOST_SAMPLES)
    """Elevations at x, m."""
    X: tuple[float, ...] | None = Field(None, max_length=MOST_SAMPLES)
    """Displacements of the paddle, m; an alternative to `eta`."""
    x: Coordinate = 0.0
    """Position at which `eta` was recorded, m from the paddle."""

    @model_validator(mode="after")
    def _series(self) -> RecordedWavesSection:
        if (self.eta is None) == (self.X is None):
            raise ValueError("give one of waves.eta (elevations) and waves.X (displacements of the paddle)")
        t, values = np.array(self.t), np.array(self.X if self.eta is None else self.eta)
        if len(t) != len(values):
            raise ValueError(f"{len(t)} times and {len(values)} values: give one value for each time")
        if self.X is not None and self.x:
            raise ValueError(
                "x is the position of elevations: remove it, or give waves.eta instead of waves.X"
            )
        step = np.diff(t)
        usual = float(np.median(step))
        if not usual > 0.0 or np.any(np.abs(step - usual) > 0.02 * usual):
            k = int(np.argmax(np.abs(step - usual)))
            raise ValueError(
                f"t has a gap or a jump: {step[k]:g} s from t = {t[k]:g} s to the next sample, while samples "
                f"are usually {usual:g} s apart; times must be in s and evenly spaced: fill or resample the "
                "series"
            )
        if not np.std(values) > 0.0:
            raise ValueError("the series does not vary: it contains no waves")
        return self

    @property
    def _spectrum(self) -> Waves:
        """Complex amplitudes (m) of the series, shifted to start at t = 0, and angular frequencies
        (rad/s)."""
        values = np.array(self.X if self.eta is None else self.eta)
        a = 2.0 * np.fft.rfft(values - np.mean(values)) / len(values)
        omega = 2.0 * np.pi * np.arange(len(a)) / self.repeats
        energy = np.abs(a[1:-1]) ** 2
        mean = float(np.sum(energy * omega[1:-1]) / np.sum(energy))
        # longer components are not waves of a tank, and a piston cannot make shorter components
        keep = (omega > 0.3 * mean) & (omega < 3.5 * mean) & (np.arange(len(a)) < len(a) - 1)
        sizes = np.abs(a[keep])
        least = max(1e-3 * np.max(sizes), np.sort(sizes)[-MOST_WAVES:][0])
        keep &= np.abs(a) >= least
        return a[keep], omega[keep]

    @property
    def left_out(self) -> float:
        """Fraction (-) of the series' variance in components that are left out: too long, too short or too
        small."""
        a, _ = self._spectrum
        values = np.array(self.X if self.eta is None else self.eta, float)
        return 1.0 - float(np.sum(np.abs(a) ** 2) / 2.0 / np.var(values))

    @property
    def period(self):
        """See `AbstractWavesSection.period`: the period of the mean frequency, weighted by the squared
        spectrum."""
        a, omega = self._spectrum
        weight = np.abs(a) ** 4
        return float(2.0 * np.pi * np.sum(weight) / np.sum(weight * omega))

    @property
    def height(self):
        """See `AbstractWavesSection.height`: four standard deviations of the elevation."""
        if self.eta is not None:
            return 4.0 * float(np.std(self.eta))
        # 1.8: ratio of height to stroke on a depth of 0.37 wavelengths; the tank's depth is not known here
        return 4.0 * float(np.std(np.array(self.X))) * 1.8

    @property
    def repeats(self):
        """See `AbstractWavesSection.repeats`."""
        return len(self.t) * (self.t[-1] - self.t[0]) / (len(self.t) - 1)

    def sum_of_waves(self, depth, g):
        """See `AbstractWavesSection.sum_of_waves`."""
        a, omega = self._spectrum
        if self.eta is None:
            return 1j * a * second_order.piston_transfer(omega, depth, g), omega
        return a * np.exp(1j * second_order.wavenumbers(omega, depth, g) * self.x), omega


WAVES: dict[str, type[Section]] = {
    "regular": RegularWavesSection,
    "bichromatic": BichromaticWavesSection,
    "irregular": IrregularWavesSection,
    "focused": FocusedWavesSection,
    "recorded": RecordedWavesSection,
}
"""Classes of wave sections by `waves.kind`; the first is the default."""

WavesSection = Annotated[
    Annotated[RegularWavesSection, Tag("regular")]
    | Annotated[BichromaticWavesSection, Tag("bichromatic")]
    | Annotated[IrregularWavesSection, Tag("irregular")]
    | Annotated[FocusedWavesSection, Tag("focused")]
    | Annotated[RecordedWavesSection, Tag("recorded")],
    Discriminator(kind_of(WAVES)),
]
"""Section of the waves; its `kind` determines its keys."""
