"""Tanks, sweeps and the paper's dimensionless numbers, shared by the studies of the OWC."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import RUNS, Report, solved
from jaxsph import analysis
from jaxsph.case.geometry import Geometry
from jaxsph.case.results import SettledPeriods, case_results
from jaxsph.model.meaning import Entry, Exchange
from jaxsph.output.run_file import RunFile
from jaxsph.problem.problem import summary_of
from jaxsph.problem.results import energy_result, noise_result

T, K_DM = 1.2, 534.66
CHAMBER, RHO_AIR = 0.13, 1.2


def study_case(dx: float, t1: float = 14.0) -> js.Case:
    """The OWC in a tank 4 m long, half as long as the built-in tank.

    The paddle absorbs the waves that the OWC reflects. Over the shorter distance the incident waves lose less
    energy, and they arrive at the OWC in half the time.
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


def short_case(dx: float, t1: float) -> js.Case:
    """The OWC in a tank 1.2 m long, where the first waves reach the chamber within a period."""
    return js.load_case("owc").replace(
        {
            "dx": dx,
            "t1": t1,
            "tank.length": 1.2,
            "probes.gauges": [0.5],
            "probes.pressure": None,
            "waves.ramp_periods": 0.5,
        }
    )


def damped(dx: float, K_dm: float, times: float = 1.0) -> tuple[js.Case, RunFile]:
    """The built-in OWC with damping K_dm (kg^0.5 m^-2.5), and the file of its run to `times` times t1."""
    case = js.load_case("owc").replace({"dx": dx, "pto.K_dm": K_dm})
    return case, solved(case, f"owc_{dx:g}_{K_dm:g}", times * case.t1)


def results_until(case: js.Case, series: dict[str, np.ndarray]) -> tuple[dict[str, float], tuple[str, ...]]:
    """Results and notices of a record, which may be the first part of the record of a run."""
    model = _Ledger(Geometry.of(case).depth, float(series["time"][-1]))
    state = SimpleNamespace(step=1, particles=SimpleNamespace(x=np.zeros((1, 2))))
    made = (energy_result(model, averaged=True), noise_result, *case_results(case))
    return summary_of(js.Solution(series, {}, model, state, case), made, SettledPeriods(case), 1.0, 1)


def swept(case: js.Case, over: dict[str, list[float]], name: str, grid: bool = True) -> js.Sweep:
    """Sweep in `runs/<name>.h5`, which is computed, continued, or only read if it is complete."""
    return js.sweep(case, over, RUNS / f"{name}.h5", grid=grid)


class _Ledger:
    """Stand-in for the model of a run that is only read, with the attributes that results use."""

    g = (0.0, -9.81)

    def __init__(self, depth: float, t_end: float) -> None:
        self.depth, self._t_end = depth, t_end

    def time(self, state: object) -> float:
        """Time at the end of the run, s."""
        del state
        return self._t_end

    def entries(self) -> dict[str, Entry]:
        """Meaning of the turbine's energy, by the name of its entry."""
        return {"pto": Entry("power take-off of the chamber", Exchange.HARVESTED)}


def amplitude(series: dict[str, np.ndarray], name: str, period: float, most: int = 10) -> float:
    """Amplitude of a reading at the frequency of the waves, in its unit, over the last whole periods."""
    t = series["time"]
    settled = analysis.whole_periods(t, period, max(1, min(most, int((t[-1] - 6.0) / period))))
    wave = np.exp(-2j * np.pi * t[settled] / period)
    return float(2.0 * abs(np.mean(series[name][settled] * wave)))


def damping_coefficient(B_star: float) -> float:
    """K_dm (kg^0.5 m^-2.5) of the dimensionless damping B* (Eq. 32)."""
    return float(B_star * np.sqrt(RHO_AIR) / CHAMBER)


def over_periods(
    report: Report, case: js.Case, key: str, label: str, values: tuple[float, ...], periods: tuple[float, ...]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sweeps a length of the device and the period of the waves, and reports how the efficiency changes.

    Returns xi of the simulation, its standard error from the scatter between periods, and xi of linear
    theory, each `[len(values), len(periods)]`. The theoretical xi is NaN over a bed that is not flat.
    """
    study = swept(case, {key: list(values), "waves.T": list(periods)}, report.name)
    xi, error = study["xi"], study["xi_error"]

    def linear(a: float, T: float) -> float:
        changed = case.replace({key: a, "waves.T": T})
        return np.nan if changed.device.platform_height else js.linear_owc(changed).xi

    theory = np.array([[linear(a, T) for T in periods] for a in values])
    report.seconds = float(np.nansum(study["wall_seconds"]))
    report.row("runs that failed", len(study.failures), theory=0.0, bar="none", passes=not study.failures)
    for i, a in enumerate(values):
        known = not np.isnan(theory[i]).any()
        best, best_linear = int(np.nanargmax(xi[i])), int(np.argmax(theory[i]))
        expected = (theory[i][best_linear], periods[best_linear]) if known else (None, None)
        report.row(f"{label} {a:g} m: largest xi", xi[i][best], theory=expected[0])
        report.row(f"{label} {a:g} m: period of the largest xi", periods[best], "s", theory=expected[1])
    for j, T in enumerate(periods):
        change, expected = xi[-1, j] - xi[0, j], theory[-1, j] - theory[0, j]
        report.row(
            f"T = {T:g} s: change of xi from a {label} of {values[0]:g} m to {values[-1]:g} m",
            change,
            theory=None if np.isnan(expected) else expected,
        )
    report.row("standard error of xi, median", np.nanmedian(error))
    report.table(
        {
            f"{key}_m": np.repeat(values, len(periods)),
            "T_s": np.tile(periods, len(values)),
            "xi": xi.ravel(),
            "xi_error": error.ravel(),
            "xi_linear": theory.ravel(),
            "incident_height_m": study["incident_height"].ravel(),
        }
    )
    figure = Figure(figsize=(8, 4.5), layout="constrained")
    axis = figure.subplots()
    for i, a in enumerate(values):
        axis.errorbar(periods, xi[i], error[i], fmt="o-", color=f"C{i}", label=f"{label} {a:g} m")
        axis.plot(periods, theory[i], "--", color=f"C{i}", lw=1)
    axis.set(xlabel="T, s", ylabel="efficiency xi", ylim=(0, None), title="SPH; linear theory dashed")
    axis.legend()
    report.picture(figure)
    return xi, error, theory
