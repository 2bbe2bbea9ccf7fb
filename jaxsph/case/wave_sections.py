"""Wave sections of a case: regular, bichromatic, irregular and focused waves, and recorded series.

Each section gives the height and the period of the waves, and their sinusoidal components.
"""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator

from jaxsph.case.section import Coordinate, Section, Time, kind_of
from jaxsph.case.wave_section import AbstractWavesSection, Height, Period, Waves
from jaxsph.waves import second_order, spectra

MOST_PERIODS = 500
"""Largest repeat time of a sea, in peak periods. With this repeat time, computing the second-order terms of
all pairs of components takes half a minute."""
MOST_WAVES = 600
"""Largest number of sinusoidal components of a recorded series that are kept: those of largest amplitude."""
STEEPEST = float(np.radians(80.0))
"""Largest angle between the waves of a directional sea and the tank's axis, rad."""
BEYOND = 0.1
"""Largest fraction of the energy of a directional sea that may be left out because it would travel at a
larger angle than `STEEPEST` (-)."""
MOST_SAMPLES = 20_000
"""Largest number of samples of a recorded series; every run file stores the series as text."""


class RegularWavesSection(AbstractWavesSection):
    """Regular waves: `kind = "regular"`, the default."""

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
            raise ValueError(
                f"T = {list(self.T)} s: the two periods must differ by at least 0.1 %; change one of them"
            )
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
                f'gamma = {self.gamma:g} applies to spectrum = "jonswap" only; remove the key, or choose '
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
    spreading: float | None = Field(None, ge=1, le=1000)
    """Exponent s of a directional sea, whose energy is spread about `direction` as cos^2s(theta/2) (-); by
    default the sea is long-crested. The seed also determines which component has which direction."""

    @model_validator(mode="after")
    def _whole(self) -> IrregularWavesSection:
        grown = self.spectrum == "pierson_moskowitz"
        if grown != (self.Hs is None):
            raise ValueError(
                f"Hs = {self.Hs:g} m cannot be given, because the height of a Pierson-Moskowitz sea follows "
                'from Tp; remove Hs, or set spectrum = "bretschneider"'
                if grown
                else f'spectrum = "{self.spectrum}" needs waves.Hs, the significant wave height; give Hs'
            )
        if not 16.0 * self.Tp <= self.repeats <= MOST_PERIODS * self.Tp:
            raise ValueError(
                f"duration = {self.duration:g} s must be 16 to {MOST_PERIODS} peak periods "
                f"({16.0 * self.Tp:g} to {MOST_PERIODS * self.Tp:g} s)"
            )
        return self

    @model_validator(mode="after")
    def _spread_forwards(self) -> IrregularWavesSection:
        if self.spreading is None:
            return self
        if self.second_order:
            raise ValueError(
                f"spreading = {self.spreading:g} makes a directional sea, which is generated to first order "
                "only; set second_order = false, or remove spreading"
            )
        beyond = spectra.spread_beyond(self.spreading, self._within)
        if beyond > BEYOND:
            raise ValueError(
                f"with spreading = {self.spreading:g}, {beyond:.0%} of the energy would travel at more than "
                f"{STEEPEST:.3g} rad (80 degrees) from the tank's axis, but at most {BEYOND:.0%} is allowed; "
                "use a larger spreading, or a direction closer to 0"
            )
        return self

    @property
    def _within(self) -> tuple[float, float]:
        """Limits of the waves' directions, rad from their mean direction."""
        return max(-STEEPEST - self.direction, -np.pi), min(STEEPEST - self.direction, np.pi)

    @property
    def oblique(self):
        """See `AbstractWavesSection.oblique`."""
        return self.direction != 0.0 or self.spreading is not None

    def directions(self, count):
        """See `AbstractWavesSection.directions`."""
        if self.spreading is None:
            return super().directions(count)
        return self.direction + spectra.spread_directions(count, self.spreading, self.seed, self._within)

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
    """Position of the focused crest, m from the paddle, in the middle of the tank's width."""
    t: Time
    """Time at which the crest is at `x`, s."""

    @model_validator(mode="after")
    def _soon(self) -> FocusedWavesSection:
        if self.t > 0.25 * MOST_PERIODS * self.Tp:
            most = 0.25 * MOST_PERIODS
            raise ValueError(f"t = {self.t:g} s must be at most {most:g} peak periods, {most * self.Tp:g} s")
        return self

    @property
    def height(self):
        """See `AbstractWavesSection.height`: the significant height of a sea in which the highest of a
        thousand waves has this crest."""
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
        k = second_order.wavenumbers(omega, depth, g) * np.cos(self.direction)
        return a * np.exp(1j * (k * self.x - omega * self.t)), omega


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
    """Position at which `eta` was recorded, m from the paddle, in the middle of the tank's width."""

    @model_validator(mode="after")
    def _series(self) -> RecordedWavesSection:
        if (self.eta is None) == (self.X is None):
            raise ValueError(
                "give exactly one of waves.eta (elevations) and waves.X (displacements of the paddle)"
            )
        t, values = np.array(self.t), np.array(self.X if self.eta is None else self.eta)
        if len(t) != len(values):
            raise ValueError(
                f"t has {len(t)} times, but {'X' if self.eta is None else 'eta'} has {len(values)} values; "
                "give one value for each time"
            )
        if self.X is not None and self.x:
            raise ValueError(
                f"x = {self.x:g} m has no effect with X, because x is the position at which eta was "
                "recorded; remove x, or give eta instead of X"
            )
        step = np.diff(t)
        usual = float(np.median(step))
        if not usual > 0.0:
            raise ValueError(
                "the times t (s) must increase from one sample to the next; sort or correct them"
            )
        if np.any(np.abs(step - usual) > 0.02 * usual):
            k = int(np.argmax(np.abs(step - usual)))
            raise ValueError(
                f"t has a gap or a jump of {step[k]:g} s from t = {t[k]:g} s to the next sample, while "
                f"samples are usually {usual:g} s apart; fill the gap, or resample the series at evenly "
                "spaced times (s)"
            )
        if not np.std(values) > 0.0:
            raise ValueError("the series does not vary, and contains no waves; give a series of waves")
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
        # 1.8: ratio of height to stroke in a depth of 0.37 wavelengths; the tank's depth is not known here
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
        k = second_order.wavenumbers(omega, depth, g) * np.cos(self.direction)
        return a * np.exp(1j * k * self.x), omega


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
