"""Results that every problem has: its energy balance, the noise of its particles and, in regular waves, the
amplitudes of its oscillating parts."""

from __future__ import annotations

import functools
from collections.abc import Iterator

import numpy as np

from jaxsph import analysis
from jaxsph.model.interfaces import Model
from jaxsph.model.meaning import Group, Label, Oscillation
from jaxsph.problem.record import AbstractAveraging, Record, RegularWave, Result, Scalars, harvested


def energy_result(model: Model, averaged: bool) -> Result:
    """Energy balance of a model over the window and, if means are `averaged`, also over the whole record."""
    unit = "J/m" if len(model.g) == 2 else "J"
    words = {n: f"  {entry.long_name}" for n, entry in model.entries().items()}
    labels = {f"energy_{n}": Label(text, unit, "", Group.NUMERICS) for n, text in words.items()}
    labels |= {
        f"whole_{name}": label._replace(text=f"{label.text}, whole run") for name, label in labels.items()
    }
    return Result(functools.partial(_energy, averaged), labels, "energy balance")


def _energy(averaged: bool, record: Record) -> Scalars:
    """Energy balance over the window; with `averaged`, also over the whole record.

    In regular waves the window consists of whole periods, because in every period a paddle recovers most
    of the energy that it gives to the water.
    """
    names, series = harvested(record.solution.model), record.solution.series
    over = {name: values[record.window.over] for name, values in series.items()}
    results = {f"energy_{name}": value for name, value in analysis.energy_budget(over, names).items()}
    if not averaged:
        return results
    whole = analysis.energy_budget(series, names)
    return results | {f"whole_energy_{name}": value for name, value in whole.items()}


def _noise(record: Record) -> Scalars:
    """Ratio of the particles' noise to their speed, both RMS; empty for water at rest.

    The RMS values are over the settled whole periods or, without such periods, over the last tenth of the
    window.
    """
    series, window = record.solution.series, record.window
    if "noise" not in series:
        return {}
    last = slice(-max(int(np.sum(window.over)) // 10, 1), None)
    over = window.over if window.periods else last
    # in double precision: squares of small speeds underflow in single precision
    noise, speed = (np.linalg.norm(np.float64(series[name][over])) for name in ("noise", "rms_speed"))
    return {"noise": float(noise / speed)} if speed > 0.0 else {}


noise_result = Result(_noise, what="noise")
"""Result: ratio of the particles' noise to their speed (-)."""


def amplitude(name: str) -> str:
    """Name of the result for the amplitude of the `Oscillation` called `name`."""
    return f"amplitude_{name}"


LINEAR = "linear_"
"""Prefix of the names of results by linear theory."""


def linear(name: str) -> str:
    """Name of the result of linear theory that corresponds to the result `name`."""
    return f"{LINEAR}{name}"


def oscillation_result(model: Model, averaging: AbstractAveraging) -> Result:
    """Amplitudes of a model's oscillating parts in regular waves, over whole settled periods.

    Each amplitude is that of the first harmonic, fitted by least squares. Ratios are to the incident
    amplitude that the gauges measure, or to the specified amplitude if no gauges separate incident and
    reflected waves.
    """
    wave = averaging.regular_wave()
    if wave is None:
        return Result(lambda _: {}, what="amplitudes")
    found = [_asked_of(name, one) for name, one in _swinging(model)]
    labels = {result: label for one in found for result, (label, _) in one.items()}
    return Result(functools.partial(_oscillations, wave), labels, "amplitudes")


def _swinging(model: Model) -> Iterator[tuple[str, Oscillation]]:
    """Oscillations of the model's parts, by name."""
    for part in model.parts:
        yield from part.oscillations(len(model.g)).items()


def _asked_of(
    name: str, one: Oscillation, size: float = 0.0, mean: float = 0.0, drift: float = 0.0, wave: float = 1.0
) -> dict[str, tuple[Label, float]]:
    """Labels and values of an oscillation's results, by name.

    The results follow from the oscillation's amplitude `size`, mean, and drift in a period, and from the wave
    amplitude (m).
    """
    found = {amplitude(name): (Label(f"{one.text}: amplitude", one.unit, "first harmonic"), size)}
    if one.over_waves:
        unit = "" if one.unit == "m" else f"{one.unit} per m"
        rao = Label(f"  {one.text}: divided by the wave amplitude", unit, "response amplitude operator (RAO)")
        found[f"rao_{name}"] = rao, size / wave
    if one.has_mean:
        found[f"mean_{name}"] = Label(f"  {one.text}: mean", one.unit, one.mean_is), mean
    if one.drifts:
        found[f"drift_{name}"] = Label(f"  {one.text}: drift in a period", one.unit), drift
    return found


def _oscillations(wave: RegularWave, record: Record) -> Scalars:
    """Amplitudes, means, drifts and ratios to the wave amplitude; empty without a whole period."""
    window, results = record.window, {}
    if not window.periods:
        return results
    of_waves = 0.5 * record.results.get("incident_height", wave.H)
    for name, one in _swinging(record.solution.model):
        if one.reading not in record.solution.series:
            continue
        values = record[one.reading][window.over].astype(np.float64)
        values = values if one.component is None else values[:, one.component]
        t, mean = record.t[window.over], float(np.mean(values[1:]))
        rate = analysis.drift_rate(t, values, wave.T) if one.drifts else 0.0
        size = float(abs(analysis.fundamental(t, values - rate * t, wave.T)))
        asked = _asked_of(name, one, size, mean, rate * wave.T, of_waves)
        results |= {result: value for result, (_, value) in asked.items()}
    return results
