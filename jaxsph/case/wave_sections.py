"""Sections of a case's waves: regular, bichromatic, irregular and focused waves, and recorded series.

Every kind says how high and how long its waves are, and of which sinusoidal waves they are the sum.
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
"""Largest number of peak periods after which a sea repeats: the second order of all pairs of its waves then
takes half a minute."""
MOST_WAVES = 600
"""Largest number of waves of a recorded series: its highest are taken."""
MOST_SAMPLES = 20_000
"""Largest number of samples of a recorded series: its text is in every file of its runs."""


class AbstractWavesSection(Section, abc.ABC):
    """Waves from a piston at x = 0."""

    height_key: ClassVar[str]
    """Key that gives the waves their height."""
    period_key: ClassVar[str]
    """Key that gives the waves their period."""
    least_length: ClassVar[int] = 40
    """Least length of the waves over the spacing: a sea has waves of a seventh of its peak's length."""

    ramp_periods: float = Field(2.0, ge=0, le=1e4)
    """Periods over which the paddle's amplitude grows from zero."""
    second_order: bool = True
    """Second-order correction of the paddle's motion, which keeps free waves of second order out."""
    absorption: bool = True
    """Active absorption: the paddle takes up the waves that come back to it."""
    zone: Length | None = None
    """Length of a relaxation zone in front of the paddle, m, which makes the waves and takes up those that
    come back, in the place of the paddle's own motion and absorption."""

    @property
    @abc.abstractmethod
    def period(self) -> float:
        """Period of the waves, or of their spectrum's peak, s."""

    @property
    @abc.abstractmethod
    def height(self) -> float:
        """Height of the waves, or their significant height, m."""

    @property
    def cycle(self) -> float:
        """Time of which means are taken over whole numbers, s."""
        return self.period

    @abc.abstractmethod
    def sum_of_waves(self, depth: float, g: float) -> Waves:
        """Waves whose sum this section asks for, on a depth (m)."""

    @property
    def repeats(self) -> float | None:
        """Time after which the waves repeat, s; None where that is a period, or too long to tell."""
        return None

    def highest(self, depth: float, g: float) -> float:
        """Height of the highest wave to expect, m: twice the largest elevation at the paddle."""
        a, omega = self.sum_of_waves(depth, g)
        waves = second_order.Harmonics(a, omega, omega)
        return 2.0 * float(np.max(np.abs(waves.at(self._times))))

    def stroke(self, depth: float, g: float) -> float:
        """Stroke of the paddle, crest to trough, m: twice its largest displacement of first order."""
        a, omega = self.sum_of_waves(depth, g)
        motion = second_order.displacement(a, omega, depth, g)
        return 2.0 * float(np.max(np.abs(motion.at(self._times))))

    @property
    def _times(self) -> NDArray[np.float64]:
        """Times at which the waves' extremes are looked for, s."""
        return np.arange(0.0, self.cycle if self.repeats is None else self.repeats, 0.04 * self.period)


class RegularWavesSection(AbstractWavesSection):
    """Regular waves: `kind = "regular"`, or no kind."""

    least_length = 4
    height_key = "H"
    period_key = "T"
    kind: Literal["regular"] = "regular"
    """Kind of the waves; another kind has other keys."""
    H: Height
    """Wave height from trough to crest, m."""
    T: Period
    """Wave period, s."""

    @property
    def period(self):
        """See `AbstractWavesSection`."""
        return self.T

    @property
    def height(self):
        """See `AbstractWavesSection`."""
        return self.H

    def sum_of_waves(self, depth, g):
        """See `AbstractWavesSection`."""
        return np.array([0.5 * self.H + 0j]), np.array([2.0 * np.pi / self.T])

    def highest(self, depth, g):
        """See `AbstractWavesSection`."""
        return self.H

    def stroke(self, depth, g):
        """See `AbstractWavesSection`."""
        return self.H / float(second_order.piston_transfer(np.array(2.0 * np.pi / self.T), depth, g))


class BichromaticWavesSection(AbstractWavesSection):
    """Two regular waves at once, which make groups: `kind = "bichromatic"`."""

    least_length = 4
    height_key = "H"
    period_key = "T"
    kind: Literal["bichromatic"] = "bichromatic"
    """Kind of the waves; another kind has other keys."""
    H: tuple[Height, Height]
    """Heights of the two waves from trough to crest, m."""
    T: tuple[Period, Period]
    """Periods of the two waves, s."""

    @model_validator(mode="after")
    def _two(self) -> BichromaticWavesSection:
        if abs(self.T[0] / self.T[1] - 1.0) < 1e-3:
            raise ValueError(f"T = {list(self.T)}: two periods must differ by a thousandth at least")
        return self

    @property
    def period(self):
        """See `AbstractWavesSection`: of the higher wave."""
        return self.T[int(np.argmax(self.H))]

    @property
    def height(self):
        """See `AbstractWavesSection`."""
        return float(np.hypot(*self.H) * np.sqrt(2.0))  # four standard deviations

    @property
    def cycle(self):
        """See `AbstractWavesSection`: a group."""
        return 1.0 / abs(1.0 / self.T[0] - 1.0 / self.T[1])

    def highest(self, depth, g):
        """See `AbstractWavesSection`."""
        return sum(self.H)

    def sum_of_waves(self, depth, g):
        """See `AbstractWavesSection`: a crest of both at the paddle at t = 0."""
        return 0.5 * np.array(self.H) + 0j, 2.0 * np.pi / np.array(self.T)


class _SpectralSection(AbstractWavesSection):
    """Waves of a spectrum."""

    spectrum: Literal["jonswap", "pierson_moskowitz", "bretschneider"] = "jonswap"
    """Spectrum: of a growing sea, of a fully grown one (whose height follows from Tp), or of two numbers."""
    Tp: Period
    """Peak period, s."""
    gamma: float | None = Field(None, ge=1, le=20)
    """Peak enhancement of a JONSWAP spectrum (-), by default 3.3."""

    @model_validator(mode="after")
    def _gamma(self) -> _SpectralSection:
        if self.gamma is not None and self.spectrum != "jonswap":
            raise ValueError(f'gamma = {self.gamma:g}: only spectrum = "jonswap" has one; remove the key')
        return self

    @property
    def period(self):
        """See `AbstractWavesSection`."""
        return self.Tp

    def shape(self, Hs: float) -> spectra.AbstractSpectrum:
        """Spectrum of a significant height Hs (m)."""
        if self.spectrum == "jonswap":
            return spectra.JONSWAP(Hs, self.Tp, 3.3 if self.gamma is None else self.gamma)
        return spectra.Bretschneider(Hs, self.Tp)


class IrregularWavesSection(_SpectralSection):
    """A sea state: `kind = "irregular"`."""

    height_key = "Hs"
    period_key = "Tp"
    kind: Literal["irregular"] = "irregular"
    """Kind of the waves; another kind has other keys."""
    Hs: Height | None = None
    """Significant wave height, m; that of a Pierson-Moskowitz spectrum follows from Tp."""
    seed: int = Field(0, ge=0, le=2**32 - 1)
    """Seed of the waves' random phases: the same seed gives the same sea."""
    duration: Time | None = None
    """Time after which the sea repeats, s; by default 128 peak periods."""

    @model_validator(mode="after")
    def _whole(self) -> IrregularWavesSection:
        grown = self.spectrum == "pierson_moskowitz"
        if grown != (self.Hs is None):
            raise ValueError(
                f"Hs = {self.Hs}: a Pierson-Moskowitz sea's height follows from Tp; remove the key, or take "
                'spectrum = "bretschneider"'
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
        """See `AbstractWavesSection`."""
        return spectra.pierson_moskowitz_height(self.Tp) if self.Hs is None else self.Hs

    @property
    def repeats(self):
        """See `AbstractWavesSection`."""
        return 128.0 * self.Tp if self.duration is None else self.duration

    def sum_of_waves(self, depth, g):
        """See `AbstractWavesSection`."""
        return spectra.draw_sea(self.shape(self.height), self.repeats, self.seed)


class FocusedWavesSection(_SpectralSection):
    """A group whose waves meet in one crest (NewWave): `kind = "focused"`."""

    height_key = "crest"
    period_key = "Tp"
    kind: Literal["focused"] = "focused"
    """Kind of the waves; another kind has other keys."""
    crest: Height
    """Elevation of the crest by linear theory, m."""
    x: Coordinate
    """Place of the crest, m from the paddle."""
    t: Time
    """Time of the crest, s."""

    @model_validator(mode="after")
    def _soon(self) -> FocusedWavesSection:
        if self.t > 0.25 * MOST_PERIODS * self.Tp:
            raise ValueError(f"t = {self.t:g} s: must be at most {0.25 * MOST_PERIODS:g} peak periods")
        return self

    @property
    def height(self):
        """See `AbstractWavesSection`: of the sea of which this is the highest wave in a thousand."""
        return 2.0 * self.crest / 1.86

    @property
    def repeats(self):
        """See `AbstractWavesSection`: long enough for the group to be alone."""
        return max(64.0 * self.Tp, 4.0 * self.t)

    def highest(self, depth, g):
        """See `AbstractWavesSection`."""
        return 2.0 * self.crest

    def sum_of_waves(self, depth, g):
        """See `AbstractWavesSection`."""
        a, omega = spectra.draw_group(self.shape(1.0), self.repeats, self.crest)
        return a * np.exp(1j * (second_order.wavenumbers(omega, depth, g) * self.x - omega * self.t)), omega


class RecordedWavesSection(AbstractWavesSection):
    """Waves by a series of elevations or of the paddle's displacement: `kind = "recorded"`.

    A case file may give `file`, a CSV with a header and the columns t (s) and eta or X (m), for all three.
    """

    height_key = "eta"
    period_key = "t"
    kind: Literal["recorded"] = "recorded"
    """Kind of the waves; another kind has other keys."""
    t: tuple[float, ...] = Field(min_length=32, max_length=MOST_SAMPLES)
    """Times of the samples, s, evenly spaced."""
    eta: tuple[float, ...] | None = Field(None, max_length=MOST_SAMPLES)
    """Elevations at x, m."""
    X: tuple[float, ...] | None = Field(None, max_length=MOST_SAMPLES)
    """Displacements of the paddle, m; in the place of `eta`."""
    x: Coordinate = 0.0
    """Place of the elevations, m from the paddle."""

    @model_validator(mode="after")
    def _series(self) -> RecordedWavesSection:
        if (self.eta is None) == (self.X is None):
            raise ValueError("give one of waves.eta (elevations) and waves.X (the paddle's displacement)")
        t, values = np.array(self.t), np.array(self.X if self.eta is None else self.eta)
        if len(t) != len(values):
            raise ValueError(f"{len(t)} times and {len(values)} values: must be as many")
        if self.X is not None and self.x:
            raise ValueError("x belongs to elevations: remove it, or give waves.eta")
        step = np.diff(t)
        usual = float(np.median(step))
        if not usual > 0.0 or np.any(np.abs(step - usual) > 0.02 * usual):
            k = int(np.argmax(np.abs(step - usual)))
            raise ValueError(
                f"t has a gap or a jump: {step[k]:g} s from t = {t[k]:g} s on, where samples are {usual:g} s "
                "apart; times must be in s and evenly spaced: fill or resample the series"
            )
        if not np.std(values) > 0.0:
            raise ValueError("the series does not vary: there are no waves in it")
        return self

    @property
    def _spectrum(self) -> Waves:
        """Complex amplitudes of the series, with its start at t = 0, and the frequencies (rad/s)."""
        values = np.array(self.X if self.eta is None else self.eta)
        a = 2.0 * np.fft.rfft(values - np.mean(values)) / len(values)
        omega = 2.0 * np.pi * np.arange(len(a)) / self.repeats
        energy = np.abs(a[1:-1]) ** 2
        mean = float(np.sum(energy * omega[1:-1]) / np.sum(energy))
        # longer waves than these are no waves of a tank, and shorter ones no piston makes
        keep = (omega > 0.3 * mean) & (omega < 3.5 * mean) & (np.arange(len(a)) < len(a) - 1)
        sizes = np.abs(a[keep])
        least = max(1e-3 * np.max(sizes), np.sort(sizes)[-MOST_WAVES:][0])
        keep &= np.abs(a) >= least
        return a[keep], omega[keep]

    @property
    def left_out(self) -> float:
        """Share of the series' variance that is in waves too long or too short to be made."""
        a, _ = self._spectrum
        values = np.array(self.X if self.eta is None else self.eta, float)
        return 1.0 - float(np.sum(np.abs(a) ** 2) / 2.0 / np.var(values))

    @property
    def period(self):
        """See `AbstractWavesSection`: by the mean frequency of the spectrum's square."""
        a, omega = self._spectrum
        weight = np.abs(a) ** 4
        return float(2.0 * np.pi * np.sum(weight) / np.sum(weight * omega))

    @property
    def height(self):
        """See `AbstractWavesSection`: four standard deviations of the elevation."""
        if self.eta is not None:
            return 4.0 * float(np.std(self.eta))
        # on a depth of half a wavelength; its own is not known here
        return 4.0 * float(np.std(np.array(self.X))) * 1.8

    @property
    def repeats(self):
        """See `AbstractWavesSection`."""
        return len(self.t) * (self.t[-1] - self.t[0]) / (len(self.t) - 1)

    def sum_of_waves(self, depth, g):
        """See `AbstractWavesSection`."""
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
"""Sections of waves by `waves.kind`; the first where none is given."""

WavesSection = Annotated[
    Annotated[RegularWavesSection, Tag("regular")]
    | Annotated[BichromaticWavesSection, Tag("bichromatic")]
    | Annotated[IrregularWavesSection, Tag("irregular")]
    | Annotated[FocusedWavesSection, Tag("focused")]
    | Annotated[RecordedWavesSection, Tag("recorded")],
    Discriminator(kind_of(WAVES)),
]
"""The waves: one section, whose `kind` says which keys it has."""
