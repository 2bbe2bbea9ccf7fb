"""Results that every problem has: its energy balance, and the noise of its particles."""

from __future__ import annotations

import functools

import numpy as np

from jaxsph import analysis
from jaxsph.model.interfaces import Model
from jaxsph.model.meaning import Label
from jaxsph.problem.record import Record, Result, Scalars, harvested


def energy_result(model: Model, averaged: bool) -> Result:
    """Energy balance of a model over the window, and of the whole record where means are `averaged`."""
    unit = "J/m" if len(model.g) == 2 else "J"
    words = {n: f"  {entry.long_name}" for n, entry in model.entries().items()}
    labels = {f"energy_{n}": Label(text, unit) for n, text in words.items()}
    labels |= {f"whole_energy_{n}": Label(f"{text}, whole run", unit) for n, text in words.items()}
    return Result(functools.partial(_energy, averaged), labels, "energy balance")


def _energy(averaged: bool, record: Record) -> Scalars:
    """Energy balance: a paddle gives and takes back far more than its waves keep, hence whole periods."""
    names, series = harvested(record.solution.model), record.solution.series
    over = {name: values[record.window.over] for name, values in series.items()}
    results = {f"energy_{name}": value for name, value in analysis.energy_budget(over, names).items()}
    if not averaged:
        return results
    whole = analysis.energy_budget(series, names)
    return results | {f"whole_energy_{name}": value for name, value in whole.items()}


def _noise(record: Record) -> Scalars:
    """Noise of the particles over their speed, both RMS over settled whole periods where there are some, or
    over the last tenth of the record; none for water that does not move."""
    series, window = record.solution.series, record.window
    if "noise" not in series:
        return {}
    last = slice(-max(int(np.sum(window.over)) // 10, 1), None)
    over = window.over if window.periods else last
    # in double precision: the squares of small speeds are nothing in single
    noise, speed = (np.linalg.norm(np.float64(series[name][over])) for name in ("noise", "rms_speed"))
    return {"noise": float(noise / speed)} if speed > 0.0 else {}


noise_result = Result(_noise, what="noise")
"""Noise of the particles over their speed."""
