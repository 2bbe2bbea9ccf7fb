"""Results without the error of the particle spacing, from runs at two spacings."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Limit(NamedTuple):
    """Result extrapolated to spacing zero, with its error; all in the unit of the result."""

    value: float
    """Limit of the result if its error is proportional to the spacing."""
    error: float
    """Half of the range in which the limit is expected, on either side of `value`."""
    coarse: float
    """Mean result at the larger spacing."""
    fine: float
    """Mean result at the smaller spacing."""
    scatter: float
    """Standard deviation of the results at the larger spacing; NaN for a single run."""


def limit(dx: np.ndarray, results: np.ndarray) -> Limit:
    """Limit of a result for spacing zero, from `results` of runs with the spacings `dx` (m), two different
    ones; several runs at one spacing show the scatter between runs.

    If the error of a result is proportional to the spacing, the results f at a spacing and c at one that is r
    times as large have the limit f + (f - c)/(r - 1) (Richardson's extrapolation; Roache 1994).
    The error of this limit has two parts that are added: all of the extrapolation, since the order of the
    error is assumed and not measured, and twice the standard error that the limit has from the scatter
    between runs. The scatter at the smaller spacing is assumed to be that at the larger one. **Raises**
    ValueError if there are not exactly two spacings.
    """
    fine_dx, *larger = np.unique(dx)
    if len(larger) != 1:
        raise ValueError(f"results at {1 + len(larger)} spacings: two are needed")
    coarse, fine = results[dx == larger[0]], results[dx == fine_dx]
    weight = 1.0 / (larger[0] / fine_dx - 1.0)
    c, f = float(np.mean(coarse)), float(np.mean(fine))
    step = weight * (f - c)
    scatter = float(np.std(coarse, ddof=1)) if len(coarse) > 1 else float("nan")
    own = np.hypot((1.0 + weight) / len(fine) ** 0.5, weight / len(coarse) ** 0.5) * np.nan_to_num(scatter)
    return Limit(f + step, abs(step) + 2.0 * float(own), c, f, scatter)
