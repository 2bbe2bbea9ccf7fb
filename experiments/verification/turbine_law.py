"""Readings of pressure and flow against the law of the power take-off, for every law.

The OWC runs in a tank 1.2 m long over three wave periods, with quadratic turbines of low to very high damping
and with the other laws. Each law is fitted to its readings by least squares. Optionally the OWC also runs in
the tank of the built-in case with the quadratic turbines; its efficiency, pressure and flow are reported.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

import jaxsph as js
from experiments.common import Report
from experiments.owc_tank import damped, results_until, short_case

Pressure = Callable[[NDArray[np.float64]], NDArray[np.float64]]

CURVE = ((-0.1, -900.0), (0.0, 0.0), (0.02, 30.0), (0.1, 900.0))
DAMPINGS = (150.0, 534.66, 2000.0, 1e4)
PERIODS, BAR = 3.0, 0.002


def quadratic(K_dm: float) -> Pressure:
    """Pressure (Pa) of a quadratic turbine as a function of the flow (m2/s)."""
    return lambda q: K_dm**2 * np.abs(q) * q


def laws() -> dict[str, tuple[dict[str, Any], Pressure]]:
    """Keys of the case, and pressure (Pa) as a function of the flow (m2/s), by name of the law."""
    found: dict[str, tuple[dict[str, Any], Pressure]] = {
        f"K_dm = {K:g}": ({"pto.K_dm": K}, quadratic(K)) for K in DAMPINGS
    }
    found["linear turbine (Wells)"] = ({"pto.resistance": 4e3}, lambda q: 4e3 * q)
    found["curve"] = ({"pto.curve": CURVE}, lambda q: np.interp(q, *np.array(CURVE).T))
    found["K_dm = 534.66 and a relief valve, below its limit"] = ({"pto.relief": 60.0}, quadratic(534.66))
    found["K_dm = 534.66 with compressible air"] = ({"air.volume": 0.5}, quadratic(534.66))
    return found


def main(dx: float = 0.04, built_in: bool = False) -> None:
    """Runs every law; `built_in`: also the four dampings in the built-in tank, ten periods of each."""
    with Report(
        f"turbine_law_{dx:g}", "Pressure and flow of the chamber against the turbine's law", dx
    ) as report:
        for name, (keys, pressure) in laws().items():
            case = short_case(dx, 1.0).replace(keys)
            case = case.replace({"t1": PERIODS * case.waves.T, "device.wall_thickness": max(dx, 0.02)})
            solution = js.run(case, progress=False)
            P_a = np.float64(solution["P_a"])
            law = pressure(np.float64(solution["flow_pto" if case.air is not None else "flow"]))
            free = P_a < 60.0 if case.pto.relief is not None else np.ones(len(P_a), bool)
            fitted = fit(P_a[free], law[free], case.pto.quadratic is not None)
            obeyed(report, f"{name}: fitted ratio of the readings to the law", fitted)
    if built_in:
        in_the_tank(dx)


def in_the_tank(dx: float) -> None:
    """Runs the built-in OWC with four dampings to its end, and reports law, efficiency, pressure and flow."""
    title = "The built-in OWC with four dampings: the law, efficiency, pressure and flow"
    with Report(f"turbine_law_{dx:g}_built_in", title, dx) as report:
        for K in DAMPINGS:
            case, file = damped(dx, K)
            series = file.series()
            asked = series["time"] <= case.t1 + 1e-6  # the file may hold a longer run
            series = {name: values[asked] for name, values in series.items()}
            P_a, flow = np.float64(series["P_a"]), np.float64(series["flow"])
            found, _ = results_until(case, series)
            label = f"K_dm = {K:g}"
            obeyed(
                report,
                f"{label}: fitted ratio of the readings to the law",
                fit(P_a, quadratic(K)(flow), True),
            )
            report.row(f"{label}: xi", found["xi"])
            report.row(f"{label}: xi based on the measured incident power", found["xi_measured"])
            report.row(f"{label}: periods averaged", found["periods"])
            report.row(f"{label}: largest P_a", P_a.max(), "Pa")
            report.row(f"{label}: smallest P_a", P_a.min(), "Pa")
            report.row(f"{label}: largest flow in either direction", np.abs(flow).max(), "m2/s")


def fit(P_a: NDArray[np.float64], law: NDArray[np.float64], quadratic: bool) -> float:
    """Least-squares ratio of the measured pressure to the law (-); for a quadratic law, the square root of
    this ratio."""
    ratio = float(np.sum(P_a * law) / np.sum(law**2))
    return float(np.sqrt(ratio)) if quadratic else ratio


def obeyed(report: Report, check: str, fitted: float) -> None:
    """Reports whether a law is obeyed."""
    report.row(check, fitted, theory=1.0, bar="0.002", passes=abs(fitted - 1) < BAR)
