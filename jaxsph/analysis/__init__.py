"""Analysis of recorded series on the host, by numpy functions that JAX does not trace."""

from jaxsph.analysis.direction import SeaDirection, WaveDirection, sea_direction, wave_direction
from jaxsph.analysis.energy import energy_budget, takers
from jaxsph.analysis.extrema import Extrema, extrema, mae_amplitude, mae_phase, matched_extrema
from jaxsph.analysis.oscillation import (
    DampedOscillation,
    decay_per_wavelength,
    fit_damped_oscillation,
    oscillation_period,
)
from jaxsph.analysis.periods import (
    Efficiency,
    efficiency,
    per_period,
    phase_average,
    settled_from,
    whole_periods,
)
from jaxsph.analysis.reflection import (
    Reflection,
    TwoWaySea,
    check_separable,
    drift_rate,
    fundamental,
    reflection,
    two_way_sea,
)
from jaxsph.analysis.spectrum import (
    Mean,
    Spectrum,
    ZeroCrossingWaves,
    mean_with_error,
    rayleigh_exceedance,
    spectrum,
    zero_crossing_waves,
)

__all__ = [
    "DampedOscillation",
    "Efficiency",
    "Extrema",
    "Mean",
    "Reflection",
    "SeaDirection",
    "Spectrum",
    "TwoWaySea",
    "WaveDirection",
    "ZeroCrossingWaves",
    "check_separable",
    "decay_per_wavelength",
    "drift_rate",
    "efficiency",
    "energy_budget",
    "extrema",
    "fit_damped_oscillation",
    "fundamental",
    "mae_amplitude",
    "mae_phase",
    "matched_extrema",
    "mean_with_error",
    "oscillation_period",
    "per_period",
    "phase_average",
    "rayleigh_exceedance",
    "reflection",
    "sea_direction",
    "settled_from",
    "spectrum",
    "takers",
    "two_way_sea",
    "wave_direction",
    "whole_periods",
    "zero_crossing_waves",
]
