"""The wave tank of section 4.1 (T = 1.2 s, H = 0.1 m, d = 0.5 m) against Stokes' second order."""

from __future__ import annotations

import numpy as np
import typer

import jaxsph as js
from experiments.common import row, solved
from jaxsph import analysis, waves

AT = (0.5, 1.0, 2.0)
"""Distances from the paddle at which the errors are taken, wavelengths."""


def main(dx: float = 0.01) -> None:
    """Runs the tank with the spacing dx and prints errors, drift, decay and reflection."""
    case = js.load_case("wave_tank").replace({"dx": dx})
    file = solved(case, f"wave_tank_{dx:g}")
    series = file.series()
    t, x, eta = series["time"], np.asarray(case.probes.gauges), series["eta"]
    H, T, d = case.waves.H, case.waves.T, case.tank.depth
    wavelength = float(waves.wavelength(T, d))
    speed = float(waves.group_velocity(2 * np.pi / T, d))
    label = f"wave tank, dx = {dx:g} m"
    amplitudes, means = [], []
    for at in AT:
        i = int(np.argmin(abs(x - at * wavelength)))
        window = settled(t, x[i] / speed, T, case.waves.ramp_periods)
        reference = np.asarray(waves.stokes2_elevation(x[i], t[window], H, T, d))
        args = (t[window], eta[window, i], t[window], reference)
        height = analysis.mae_amplitude(*args, H / 2, T, window=5)
        phase = analysis.mae_phase(*args, T, window=5)
        row(f"{label}, {at:g} wavelengths: MAE_a", f"{100 * height:.2f} %", "< 5 %", height < 0.05)
        row(f"{label}, {at:g} wavelengths: MAE_p", f"{100 * phase:.2f} %", "< 2 %", phase < 0.02)
        means.append(np.mean(eta[window, i]))
        amplitudes.append(2 * abs(np.mean(eta[window, i] * np.exp(-2j * np.pi * t[window] / T))))
    row(f"{label}: mean level", f"{1e3 * np.mean(means):+.2f} mm")
    at = np.asarray(AT) * wavelength
    row(
        f"{label}: decay per wavelength",
        f"{100 * analysis.decay_per_wavelength(at, amplitudes, wavelength):.2f} %",
    )
    results = file.results()
    row(f"{label}: reflection by the sponge", f"{100 * results['reflection']:.1f} %")
    row(f"{label}: energy not accounted for", f"{100 * results['energy_residual_share']:+.1f} %")


def settled(t: np.ndarray, delay: float, T: float, ramp: float, most: int = 5) -> np.ndarray:
    """Whole periods, `most` at most, from when the ramp's waves have passed a gauge."""
    start = ramp * T + delay + T
    periods = min(most, int((t[-1] - start) / T))
    return (t >= start) & (t < start + periods * T)


if __name__ == "__main__":
    typer.run(main)
