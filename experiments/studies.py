"""What the studies of the OWC share: the tank they run in, their sweeps, the numbers of the paper."""

from __future__ import annotations

import numpy as np

import jaxsph as js
from experiments.common import RUNS
from jaxsph import analysis

T, K_DM = 1.2, 534.66
CHAMBER, RHO_AIR = 0.13, 1.2


def study_case(dx: float, t1: float = 14.0) -> js.Case:
    """The OWC in a tank of 4 m, half the built-in one's.

    The paddle absorbs what the OWC sends back, the wave loses less on its way, and it is there in half the
    time.
    """
    return js.load_case("owc").replace(
        {
            "name": "owc_study",
            "dx": dx,
            "t1": t1,
            "tank.length": 4.0,
            "probes.gauges": [1.0, 1.5, 1.8, 2.25],
            "probes.pressure": None,
            "output.snapshot_dt": 1.0,
        }
    )


def swept(case: js.Case, over: dict[str, list[float]], name: str, grid: bool = True) -> js.Sweep:
    """The sweep in `runs/<name>.h5`, made, finished or only read."""
    return js.sweep(case, over, RUNS / f"{name}.h5", grid=grid)


def amplitude(series: dict[str, np.ndarray], name: str, period: float, most: int = 10) -> float:
    """Amplitude of a reading at the waves' frequency, over the whole periods after the transient."""
    t = series["time"]
    settled = analysis.whole_periods(t, period, max(1, min(most, int((t[-1] - 6.0) / period))))
    wave = np.exp(-2j * np.pi * t[settled] / period)
    return float(2.0 * abs(np.mean(series[name][settled] * wave)))


def damping_coefficient(B_star: float) -> float:
    """K_dm (kg^0.5 m^-2.5) of the dimensionless damping B* (Eq. 32)."""
    return float(B_star * np.sqrt(RHO_AIR) / CHAMBER)
