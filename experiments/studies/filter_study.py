"""Accuracy of a filtered derivative: d xi/d K_dm of the OWC at three dampings, against a fit through runs.

The tank is 4 m long, as in the other studies, and dx = 0.02 m. A further run covers 30 periods in a tank of
1.2 m, where the slopes must stay bounded.
"""

from __future__ import annotations

import dataclasses
import json
import time

import numpy as np
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import RUNS, Report
from experiments.owc_tank import T, short_case, study_case, swept
from jaxsph.case.linear import incident_power

POINTS = (257.0, 534.66, 1300.0)
"""Values of K_dm (kg^0.5 m^-2.5) below, near and above the best."""
MEMBERS = 13
RANGE = (180.0, 1900.0)


def main(dx: float = 0.02) -> None:
    """Runs the three slopes, the thirteen runs and the long run; finished runs are read from their files."""
    case = study_case(dx)
    found = [slope(case.replace({"pto.K_dm": k}), f"filter_study_{dx:g}_{k:g}") for k in POINTS]
    long = slope(short_case(dx, 30 * T), f"filter_study_{dx:g}_long")
    study, fit = fitted(case)
    with Report(
        f"filter_study_{dx:g}", "Filtered derivative of the efficiency with respect to K_dm", dx
    ) as report:
        report.seconds = float(np.nansum(study["wall_seconds"])) + sum(
            one["seconds"] for one in (*found, long)
        )
        report.row("scatter of xi about the fit", fit.scatter)
        for k, one in zip(POINTS, found, strict=True):
            expected, error = fit.slope(k)
            off = abs(one["slope"] - expected)
            right = abs(expected) < 2 * error or one["slope"] * expected > 0
            report.row(f"K_dm = {k:g}: 1e4 times the slope of the fit", 1e4 * expected)
            report.row(f"K_dm = {k:g}: 1e4 times the standard error of the slope of the fit", 1e4 * error)
            report.row(
                f"K_dm = {k:g}: 1e4 times the filtered slope",
                1e4 * one["slope"],
                theory=1e4 * expected,
                bar="within 20 % or the error, same sign",
                passes=bool(right and off < max(0.2 * abs(expected), error)),
            )
            response = expected - 2 * one["value"] / k
            report.row(
                f"K_dm = {k:g}: share of the water's response that the filter removes",
                (one["slope"] - expected) / -response,
            )
        slopes = np.asarray(long["per_period"])
        # the direct term is the slope without any response of the water; twice this term is taken as growth
        grown = np.flatnonzero(np.abs(slopes) > 2 * long["direct"])
        whole = int(grown[0]) if grown.size else len(slopes)
        report.row(
            "tank of 1.2 m: periods without growth of the filtered slope",
            whole,
            bar="30",
            passes=whole == len(slopes),
        )
        figure = Figure(figsize=(10, 4), layout="constrained")
        left, right = figure.subplots(1, 2)
        left.plot(fit.K, fit.xi, "k.", label="runs")
        fine = np.geomspace(*RANGE, 200)
        left.plot(fine, fit.value(fine), "k-", lw=0.8, label="quartic in ln K_dm")
        for k, one in zip(POINTS, found, strict=True):
            beside = k * np.array([0.8, 1.25])
            left.plot(beside, one["value"] + one["slope"] * (beside - k), "C1-", lw=2)
            left.plot(k, one["value"], "C1o")
        left.set(xscale="log", xlabel="K_dm", ylabel="xi", title="filtered slopes (orange)")
        left.legend()
        right.plot(1 + np.arange(len(slopes)), 1e4 * slopes, ".-")
        right.axhline(1e4 * long["direct"], color="0.6", ls="--", label="2 xi/K_dm: no response at all")
        right.set(
            xlabel="wave period", ylabel="1e4 d xi/d K_dm of the period", title="30 periods, tank of 1.2 m"
        )
        right.set_ylim(-1e4 * long["direct"], 2e4 * long["direct"])
        right.legend()
        report.picture(figure)


def fitted(case: js.Case) -> tuple[js.Sweep, Fit]:
    """The thirteen runs over K_dm (computed, completed or only read), and the fit through them."""
    K = np.round(np.geomspace(*RANGE, MEMBERS), 2)
    study = swept(case, {"pto.K_dm": list(K)}, f"filter_study_{case.dx:g}")
    return study, Fit(K, study["xi"])


def slope(case: js.Case, name: str) -> dict:
    """Efficiency of a case, its filtered slope with respect to K_dm, and slopes of single periods; stored in
    `runs/<name>.json`."""
    kept = RUNS / f"{name}.json"
    if kept.exists():
        return json.loads(kept.read_text(encoding="utf-8"))
    begun = time.perf_counter()
    found = js.derivative(case, "pto.K_dm", "xi", js.Filtered())
    per_period = round(case.waves.T / case.output.sample_dt)
    whole = len(found.series["time"]) // per_period * per_period
    powers = found.slopes["power_pto"][:whole].reshape(-1, per_period).mean(axis=1)
    one = {
        "value": found.value,
        "slope": found.slope,
        "direct": 2 * found.value / case.pto.K_dm,
        "per_period": (powers / incident_power(case)).tolist(),
        "seconds": time.perf_counter() - begun,
    }
    kept.parent.mkdir(parents=True, exist_ok=True)
    kept.write_text(json.dumps(one), encoding="utf-8")
    return one


@dataclasses.dataclass
class Fit:
    """Quartic in ln K_dm fitted to efficiencies; the residuals of a cubic exceed the scatter of the runs."""

    K: np.ndarray
    xi: np.ndarray

    def __post_init__(self) -> None:
        """Fits by least squares, assuming equal errors of all points."""
        A = self._powers(self.K)
        self.found = np.linalg.lstsq(A, self.xi, rcond=None)[0]
        rest = self.xi - A @ self.found
        self.scatter = float(np.sqrt(rest @ rest / (len(rest) - A.shape[1])))
        self.covariance = self.scatter**2 * np.linalg.inv(A.T @ A)

    def _powers(self, K: np.ndarray) -> np.ndarray:
        return np.log(np.atleast_1d(K) / 500.0)[:, None] ** np.arange(5)

    def value(self, K: np.ndarray) -> np.ndarray:
        """Efficiency xi (-) of the fit at K (kg^0.5 m^-2.5)."""
        return self._powers(K) @ self.found

    def slope(self, K: float) -> tuple[float, float]:
        """Slope d xi/d K_dm of the fit at K (kg^0.5 m^-2.5) and its standard error, kg^-0.5 m^2.5."""
        x = np.log(K / 500.0)
        a = np.array([0.0, 1.0, 2 * x, 3 * x**2, 4 * x**3]) / K
        return float(a @ self.found), float(np.sqrt(a @ self.covariance @ a))
