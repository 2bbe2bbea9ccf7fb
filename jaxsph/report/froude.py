"""Froude's law: values at full scale from the values of a model, by their units."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxsph.errors import CaseError, FileError
from jaxsph.output.run_file import RunFile
from jaxsph.report.labels import OF_PROGRAM, is_flat, label_of

BASES = {"m": 1.0, "s": 0.5, "kg": 3.0, "N": 3.0, "Pa": 1.0, "J": 4.0, "W": 3.5, "Hz": -0.5}
"""Exponent of the scale by unit: lengths grow with n, times with n^0.5, masses with n^3, since g and the
density of the water stay the same."""
PLAIN = ("rad", "deg", "degrees", "%", "1", "-")
"""Units of quantities that are the same at every scale."""


class Scaled(NamedTuple):
    """Result at full scale."""

    value: float
    unit: str
    meaning: str
    """Name of the result in words."""


def exponent(unit: str) -> float:
    """Exponent of the scale n in the factor n^exponent of a quantity with a unit such as "W/m" or "m2 s-1".

    Per metre of width means per metre at full scale. **Raises** CaseError for an unknown unit.
    """
    total = 0.0
    for sign, part in zip((1.0, -1.0), (unit or "1").split("/"), strict=False):
        for word in part.split():
            found = re.fullmatch(r"([A-Za-z%-]+?)(-?\d+(?:\.\d+)?)?", word)
            base, power = found.groups() if found else (word, None)
            if base in BASES:
                total += sign * BASES[base] * float(power or 1.0)
            elif word not in PLAIN:
                raise CaseError(
                    f"unit {unit!r}: how {word!r} grows with the scale is not known; known units are "
                    f"{', '.join((*BASES, *PLAIN))}, their powers and products"
                )
    if unit.count("/") > 1:
        raise CaseError(f"unit {unit!r}: write at most one '/', for example 'J/m', or powers, 'J m-1'")
    return total


def factor(unit: str, scale: float) -> float:
    """Ratio of a quantity with the unit to that of a model whose lengths are `scale` times smaller.

    **Raises** CaseError for an unknown unit, unless the scale is 1.
    """
    return 1.0 if scale == 1.0 else scale ** exponent(unit)


def full_scale(run: RunFile | str | Path, scale: float) -> dict[str, Scaled]:
    """Results of a run at full scale, by Froude's law; numbers of the run itself are left out.

    **Arguments**: `run`: a run's file; `scale`: lengths at full scale over those of the run, for example 40.
    Results of a two-dimensional run are per metre of the device's width. With compressible air the law holds
    only if the air of the run was softened accordingly. **Raises** CaseError for a scale that is not positive
    or a result of unknown unit; FileError if the file was not written by jaxsph.
    """
    check_scale(scale)
    opened = run if isinstance(run, RunFile) else RunFile.open(run)
    labels, flat = opened.labels(), is_flat(opened.case_keys())
    if not (results := opened.results()):
        raise FileError(f"{opened.path} has no results yet: finish the run with jaxsph resume")
    found = {}
    for name, value in results.items():
        if name not in OF_PROGRAM:
            label = label_of(name, flat, labels)
            found[name] = Scaled(factor(label.unit, scale) * value, label.unit, label.text.strip())
    return found


def check_scale(scale: float) -> None:
    """Checks the ratio of full-scale to model lengths. **Raises** CaseError."""
    if not (np.isfinite(scale) and scale > 0.0):
        raise CaseError(
            f"scale = {scale:g}: must be a positive number, the full-scale length of 1 m of the run"
        )
