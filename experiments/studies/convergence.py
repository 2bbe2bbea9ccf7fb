"""The OWC at three spacings in both schemes, with Richardson extrapolation, compared with linear theory.

The tank is 3 m long and the wall 0.02 m thick at every spacing, so that all runs and the theory have the same
device. At the lip of the front wall, linear theory includes a head loss of zeta = 0, 1 or 2 velocity heads,
based on the column's mean velocity. This range is assumed, not fitted. According to handbooks of hydraulics a
sharp-edged entry loses 0.5 to 1 velocity head in steady pipe flow, and an exit loses 1; an oscillating flow
also passes through the eddies that it has shed. The efficiency of linear theory is therefore given as a
range.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import typer
from matplotlib.figure import Figure

import jaxsph as js
from experiments import common
from experiments.common import BUDGET, Report, solved
from jaxsph import analysis
from jaxsph.output.run_file import RunFile

SPACINGS = (0.02, 0.01, 0.005)
SCHEMES: dict[str, dict[str, Any]] = {"incompressible": {}, "weakly_compressible": {}}
"""Changes to the case for each scheme; all other settings are defaults."""
ZETA = (0.0, 1.0, 2.0)
"""Loss coefficients of the lip in linear theory (-): none, one and two velocity heads."""
QUANTITIES = {"xi": ("xi", ""), "P_a": ("pressure amplitude", "Pa"), "flow": ("flow amplitude", "m2/s")}
"""Quantities compared between spacings: label and unit of each."""
BARS = ((0.02, 0.01, 0.05), (0.01, 0.005, 0.025))
"""Coarse and fine spacing (m), and largest allowed change of xi between them, relative to the coarse xi."""
SCHEMES_APART = (0.01, 0.03)
"""Spacing (m) at which the schemes are compared, and largest allowed difference in xi, relative to their
mean."""
ORDERS = (0.5, 2.0)
"""Smallest order that is extrapolated, and limit to which larger orders are reduced (-)."""
SAFETY = 1.25
"""Safety factor on the distance to the limit: Roache's for three spacings."""


class Found(NamedTuple):
    """Results of one run."""

    values: dict[str, float]
    """Values of `QUANTITIES`."""
    errors: dict[str, float]
    """Standard errors of `QUANTITIES`, from the scatter between periods."""
    results: dict[str, float]
    """Results by name, as in the file of the run."""
    seconds: float
    """Wall time per simulated second (s), at the rate of the last process of the run."""


class Limit(NamedTuple):
    """Limit of a quantity at zero spacing; if the sequence has no limit, the reason."""

    value: float | None
    """Value at zero spacing; None if the sequence has no limit."""
    error: float
    """Error of the value; if there is no value, the spread of the sequence (largest minus smallest)."""
    order: float | None
    """Observed order of convergence; None if it cannot be computed or the sequence only scatters."""
    why: str
    """How the value was computed, or why the sequence has no limit."""


def main(
    dx: Annotated[
        list[float] | None, typer.Option(help="Spacing, m; repeatable; default: 0.02, 0.01, 0.005.")
    ] = None,
    schemes: Annotated[list[str] | None, typer.Option(help="Scheme; repeatable; default: both.")] = None,
    t1: float = 14.0,
) -> None:
    """Runs or continues the requested spacings and schemes, and reports them with the runs that are already
    complete."""
    asked = tuple(SPACINGS if not dx else dx), tuple(schemes or SCHEMES)
    unknown = set(asked[1]) - set(SCHEMES)
    if unknown:
        raise typer.BadParameter(f"schemes = {', '.join(sorted(unknown))}: choose from {', '.join(SCHEMES)}")
    runs = {kind: _runs(kind, asked, t1) for kind in SCHEMES}
    theory = [js.linear_owc(study_case("incompressible", SPACINGS[-1]), zeta) for zeta in ZETA]
    with Report(
        "convergence", "Convergence of the OWC with the spacing, in both schemes and against linear theory"
    ) as report:
        every = [run for found in runs.values() for run in found.values()]
        # time of all processes of a run, if all were as fast as the last process
        report.seconds = sum(run.seconds * run.results["t_end"] for run in every)
        for kind, found in runs.items():
            for spacing, run in found.items():
                _rows(report, f"{_short(kind)}, {1e3 * spacing:g} mm", run)
        for kind, found in runs.items():
            _convergence(report, _short(kind), found)
        _schemes_apart(report, runs)
        for linear in theory:
            _theory(report, linear)
        columns = [_column(kind, h, run) for kind, found in runs.items() for h, run in found.items()]
        if columns:
            report.table({name: [column[name] for column in columns] for name in columns[0]})
        report.picture(_picture(runs, theory))


def study_case(kind: str, dx: float) -> js.Case:
    """The built-in OWC in a tank 3 m long with the scheme `kind`, at the spacing dx (m).

    The positions of wall and gauges do not depend on the spacing.
    """
    return js.load_case("owc").replace(
        {
            "name": "owc_convergence",
            "tank.length": 3.0,
            "probes.gauges": [0.8, 1.2, 1.5, 1.9],
            "probes.pressure": None,
            "device.wall_thickness": 0.02,
            "t1": 14.0,
            "output.snapshot_dt": 2.0,
            "dx": dx,
            "scheme.kind": kind,
            **SCHEMES[kind],
        }
    )


def _runs(kind: str, asked: tuple[tuple[float, ...], tuple[str, ...]], t1: float) -> dict[float, Found]:
    """Results of the scheme `kind` by spacing (m), coarse to fine: of the requested runs, and of other runs
    that are already complete."""
    found = {}
    for spacing in sorted({*SPACINGS, *asked[0]}, reverse=True):
        case, name = study_case(kind, spacing), f"convergence_{kind}_{spacing:g}"
        if spacing in asked[0] and kind in asked[1]:
            found[spacing] = read(case, solved(case, name, t1))
        elif _ended(case, path := common.RUNS / f"{name}.h5", t1):
            found[spacing] = read(case, RunFile.open(path))
    return found


def _ended(case: js.Case, path: Path, t1: float) -> bool:
    """Whether the file exists and contains a run of this case that reached t1 (s)."""
    if not path.exists():
        return False
    file = RunFile.open(path)
    return file.case_toml == case.to_toml() and file.results().get("t_end", 0.0) > t1 - case.output.sample_dt


def read(case: js.Case, file: RunFile) -> Found:
    """Results of a run over its settled periods.

    **Raises** ValueError if the run has no settled period, because its t1 is too short.
    """
    series, results = file.series(), file.results()
    periods = int(results.get("periods", 0))
    if periods < 1:
        raise ValueError(f"the run to {results['t_end']:g} s has no settled period: choose a longer t1")
    values, errors = {"xi": results["xi"]}, {"xi": results["xi_error"]}
    for name in ("P_a", "flow"):
        values[name], errors[name] = _amplitude(series, name, case.waves.T, periods)
    # after an interruption `wall_seconds` covers the last process only; its rate is used for all processes
    steps = len(file.snapshot(-1)["x"]) * results["steps"]
    seconds = steps / results["particle_steps_per_second"] / results["t_end"]
    return Found(values, errors, results, seconds)


def _amplitude(series: dict[str, np.ndarray], name: str, period: float, periods: int) -> tuple[float, float]:
    """Amplitude of a reading at the wave frequency over the last whole periods, and its standard error, in
    its unit."""
    t = series["time"]

    def over(samples: np.ndarray | slice) -> float:
        return float(2.0 * abs(np.mean(series[name][samples] * np.exp(-2j * np.pi * t[samples] / period))))

    last = t[-1] - period * np.arange(periods + 1)
    each = [over((t > end - period + 1e-9) & (t <= end + 1e-9)) for end in last[:-1]]
    whole = analysis.whole_periods(t, period, periods)
    return over(whole), float(np.std(each) / np.sqrt(periods))


def richardson(dx: list[float], values: list[float], errors: list[float]) -> Limit:
    """Limit of a quantity at zero spacing, in its unit, from values at three spacings (m), coarse to fine.

    With e = (f1 - f2, f2 - f3) and the ratio r of the spacings, the order is p = log(e1 / e2) / log(r) and
    the limit f3 - e2 / (r^p - 1). `errors` are standard errors of the values. There is no value, only the
    spread, if the sequence is not monotone, changes less than it scatters, has an order below 0.5, or has
    spacings without a common ratio. An order above 2 is taken as 2, which puts the limit farther away.
    """
    f, h = np.asarray(values, float), np.asarray(dx, float)
    spread = float(np.ptp(f))
    ratios = h[:-1] / h[1:]
    if len(f) != 3 or abs(ratios[0] / ratios[1] - 1.0) > 1e-6:
        return Limit(None, spread, None, "not three spacings with a constant ratio")
    e1, e2 = -np.diff(f)
    scatter = np.hypot(errors[1:], errors[:-1])
    if e1 * e2 <= 0.0:
        return Limit(None, spread, None, "not monotone")
    if abs(e1) < scatter[0] or abs(e2) < scatter[1]:
        return Limit(None, spread, None, "changes less than it scatters")
    order = float(np.log(e1 / e2) / np.log(ratios[0]))
    if order < ORDERS[0]:
        return Limit(None, spread, order, f"order {order:.2g}, too low for an extrapolation")
    rest = 1.0 / (ratios[0] ** min(order, ORDERS[1]) - 1.0)
    own = np.hypot((1.0 + rest) * errors[2], rest * errors[1])
    why = f"order {order:.2g}" + (f", taken as {ORDERS[1]:g}" if order > ORDERS[1] else "")
    return Limit(float(f[2] - rest * e2), float(np.hypot(SAFETY * rest * e2, own)), order, why)


def _rows(report: Report, where: str, run: Found) -> None:
    """Reports one run: the quantities, the distribution of the paddle's work, and the cost."""
    for name, (label, unit) in QUANTITIES.items():
        report.row(f"{where}: {label}", run.values[name], unit)
        report.row(f"{where}: {label}, standard error", run.errors[name], unit)
    for name, share in _shares(run.results).items():
        label = BUDGET.get(name, f"energy ({name})")
        report.row(f"{where}: {label}, over the paddle's work", 100.0 * share, "%")
    for name, label, unit in (
        ("incident_height", "incident height", "m"),
        ("reflection", "reflection", ""),
        ("noise", "noise", ""),
    ):
        if name in run.results:
            report.row(f"{where}: {label}", run.results[name], unit)
    report.row(f"{where}: wall time per simulated second", run.seconds, "s")


def _shares(results: dict[str, float]) -> dict[str, float]:
    """Energies divided by the paddle's work (-), by name; energies that are zero are left out."""
    names = [name.removeprefix("energy_") for name in results if name.startswith("energy_")]
    names = [name for name in names if name not in ("paddle", "residual_share")]
    place = {"pto": -2, "stored": -1, "residual": 1}
    names.sort(key=lambda name: place.get(name, 0))
    return {n: results[f"energy_{n}"] / results["energy_paddle"] for n in names if results[f"energy_{n}"]}


def _convergence(report: Report, where: str, found: dict[float, Found]) -> None:
    """Reports the change of xi between spacings for one scheme, and the limits of all quantities."""
    for coarse, fine, bar in BARS:
        if coarse in found and fine in found:
            change = found[fine].values["xi"] / found[coarse].values["xi"] - 1.0
            report.row(
                f"{where}: change of xi from {1e3 * coarse:g} to {1e3 * fine:g} mm",
                100.0 * change,
                "%",
                bar=f"within {100 * bar:g} %",
                passes=abs(change) < bar,
            )
    if not set(SPACINGS) <= set(found):
        return
    for name, (label, unit) in QUANTITIES.items():
        limit = _limit(found, name)
        if limit.value is None:
            report.row(f"{where}: {label}, extrapolated to zero spacing", limit.why)
            report.row(f"{where}: {label}, spread between the spacings", limit.error, unit)
        else:
            report.row(f"{where}: {label}, extrapolated to zero spacing ({limit.why})", limit.value, unit)
            report.row(f"{where}: {label}, error of the extrapolation", limit.error, unit)


def _limit(found: dict[float, Found], name: str) -> Limit:
    """Limit of a quantity over the three spacings, in its unit."""
    runs = [found[h] for h in SPACINGS]
    return richardson(list(SPACINGS), [r.values[name] for r in runs], [r.errors[name] for r in runs])


def _schemes_apart(report: Report, runs: dict[str, dict[float, Found]]) -> None:
    spacing, bar = SCHEMES_APART
    if not all(spacing in found for found in runs.values()):
        return
    xi = [found[spacing].values["xi"] for found in runs.values()]
    apart = (xi[0] - xi[1]) / np.mean(xi)
    report.row(
        f"{' minus '.join(map(_short, runs))}, {1e3 * spacing:g} mm: relative difference of xi",
        100.0 * apart,
        "%",
        theory=0.0,
        bar=f"within {100 * bar:g} %",
        passes=abs(apart) < bar,
    )


def _theory(report: Report, linear: js.LinearOWC) -> None:
    """Reports linear theory with one loss coefficient of the lip."""
    where = f"linear theory, zeta = {linear.lip_loss:g}"
    for name, (label, unit) in QUANTITIES.items():
        report.row(f"{where}: {label}", _expected(linear, name), unit)
    report.row(f"{where}: power lost at the lip / incident power", 100.0 * linear.P_lip / linear.P_inc, "%")


def _expected(linear: js.LinearOWC, name: str) -> float:
    return float({"xi": linear.xi, "P_a": abs(linear.P_a), "flow": abs(linear.q)}[name])


def _short(kind: str) -> str:
    return kind.replace("_", " ")


def _column(kind: str, spacing: float, run: Found) -> dict[str, float]:
    """Line of one run in the table; the scheme is given as its index in `SCHEMES`."""
    line = {"scheme": float(list(SCHEMES).index(kind)), "dx_m": spacing}
    for name, (_, unit) in QUANTITIES.items():
        named = f"{name}_{unit.replace('/', '_')}".rstrip("_")
        line |= {named: run.values[name], f"{named}_error": run.errors[name]}
    return line | {"seconds_per_second": run.seconds}


def _picture(runs: dict[str, dict[float, Found]], theory: list[js.LinearOWC]) -> Figure:
    figure = Figure(figsize=(11, 4), layout="constrained")
    axes = figure.subplots(1, 3)
    for axis, (name, (label, unit)) in zip(axes, QUANTITIES.items(), strict=True):
        for i, (kind, found) in enumerate(runs.items()):
            h = 1e3 * np.array(list(found))
            values, errors = ([getattr(r, of)[name] for r in found.values()] for of in ("values", "errors"))
            axis.errorbar(h, values, errors, fmt="o-", color=f"C{i}", label=_short(kind))
            limit = _limit(found, name) if set(SPACINGS) <= set(found) else None
            if limit is not None and limit.value is not None:
                axis.errorbar(0.0, limit.value, limit.error, fmt="s", mfc="none", capsize=3, color=f"C{i}")
        for linear, style in zip(theory, ("-", "--", ":"), strict=True):
            label_ = f"linear theory, zeta = {linear.lip_loss:g}"
            axis.axhline(_expected(linear, name), color="k", ls=style, lw=1, label=label_)
        axis.set(xlabel="dx, mm", ylabel=f"{label}, {unit}".rstrip(", "), xlim=(-1, None), ylim=(0, None))
    axes[0].legend(fontsize="small")
    axes[1].set_title("SPH; squares: Richardson's estimates")
    return figure
