"""Gates of the border between a coarse flume and finer water: still water, a standing wave, a train of waves,
and the OWC against the same spacing everywhere."""

from __future__ import annotations

import json
import time
from typing import Any

import jax
import numpy as np

import jaxsph as js
from experiments.common import COMMITTED, Report, solved, use_threads
from experiments.studies.convergence import QUANTITIES, Found, read, study_case
from jaxsph import analysis
from jaxsph.analysis.reflection import fundamental, separated
from jaxsph.run.simulate import simulate_chunk
from jaxsph.waves import theory

DEPTH, HEIGHT, PERIOD = 0.4, 0.04, 1.2
"""Depth and height of the waves, m, and their period, s."""
IN_FLUME, BEHIND = (2.2, 2.5, 2.75, 3.0), (6.0, 6.3, 6.55, 6.8)
"""Positions of the gauges on the two sides of the border of the long tank, m."""
BORDER = 4.8
"""Position of the border in the long tank, m."""
TURNS = 3
"""Number of chunks whose time is measured."""
OWC_BORDER = 2.34
"""Position of the border in the tank of 3 m with the OWC, m."""


def main(
    dx: float = 0.005, factor: int = 4, train: bool = True, device: bool = True, members: int = 2
) -> None:
    """Runs the gates with the spacing dx (m) behind the border, and `factor` times dx in the flume.

    `train`, `device`: also the train of waves and the OWC, which take most of the time, the OWC in `members`
    runs.
    """
    with Report(f"border_{dx:g}_{factor}", "Border between a coarse flume and finer water", dx) as report:
        _still(report, dx, factor)
        _standing(report, dx, factor)
        if device:
            _device(report, dx, factor, members)
        if train:
            _train(report, dx, factor)
        _cost(report, dx, factor)


def tank(dx: float, factor: int, length: float, flume: float | None, **changes: Any) -> js.Case:
    """A tank of this length (m) with a flume of the length `flume` (m), or without a flume."""
    own = {} if flume is None else {"flume": {"length": flume, "factor": factor}}
    return js.Case.from_dict(
        {
            "name": "border",
            "dx": dx,
            "t1": 10.0,
            "scheme": {"kind": "incompressible"},
            "tank": {"length": length, "depth": DEPTH},
            "output": {"sample_dt": 0.02, "snapshot_dt": 1.0},
            **own,
            **changes,
        }
    )


def _still(report: Report, dx: float, factor: int) -> None:
    run = solved(tank(dx, factor, 2.0, 0.8), f"border_still_{dx:g}")
    speed = float(np.max(run.series()["max_speed"])) / np.sqrt(9.81 * DEPTH)
    report.row(
        "still water, 10 s: largest speed over sqrt(g d)",
        100 * speed,
        "%",
        bar="0.5 %",
        passes=speed <= 0.005,
    )


def _standing(report: Report, dx: float, factor: int) -> None:
    k = np.pi  # mode 2 of a tank of 2 m
    linear = 2.0 * np.pi / np.sqrt(9.81 * k * np.tanh(k * DEPTH))
    gauges = {"gauges": [0.05, 1.0, 1.95]}
    for name, flume in (("across the border", 0.8), ("coarse everywhere", None)):
        spacing = dx if flume else factor * dx
        case = tank(spacing, factor, 2.0, flume, start={"amplitude": 0.02, "mode": 2}, probes=gauges)
        series = solved(case, f"border_standing_{spacing:g}_{bool(flume):d}").series()
        found = [analysis.fit_damped_oscillation(series["time"], eta) for eta in series["eta"].T]
        period = float(np.mean([2.0 * np.pi / one.omega for one in found])) / linear - 1.0
        decay = [one.decay_rate for one in found]
        what, apart = f"standing wave {name}", bool(flume)
        bar = {"bar": "0.5 %", "passes": abs(period) <= 0.005} if apart else {}
        report.row(f"{what}: period over the linear one, less one", 100 * period, "%", theory=0.0, **bar)
        mean = float(np.mean(decay))
        bar = {"bar": "0.003 1/s", "passes": abs(mean) <= 0.003} if apart else {}
        report.row(f"{what}: decay rate, mean of three gauges", mean, "1/s", **bar)
        each = "; ".join(f"{rate:.4f}" for rate in decay)
        report.row(f"{what}: decay rate at each gauge, which the wave's own harmonics modulate", each, "1/s")


def _train(report: Report, dx: float, factor: int) -> None:
    found = {}
    for flume in (BORDER, None):
        spacing = dx if flume else factor * dx
        case = tank(
            spacing,
            factor,
            9.2,
            flume,
            t1=20.0,
            waves={"H": HEIGHT, "T": PERIOD},
            sponge={"length": 2.0, "strength": 5.0},
            probes={"gauges": [*IN_FLUME, *BEHIND]},
        )
        run = solved(case, f"border_train_{spacing:g}_{bool(flume):d}")
        found[bool(flume)] = _two_ways(run.series())
        if flume:
            results = run.results()
            share = results["border_residual"]
            report.row(
                "train of waves: share of the power lost at the border, by the ledger", 100 * share, "%"
            )
            energies = {name: results[f"energy_{name}"] for name in ("paddle", "projection")}
            report.row(
                "train of waves: energy lost in the projection behind the border, over the power through it",
                100 * energies["projection"] / energies["paddle"],
                "%",
            )
            report.row("train of waves: power through the border", results["border_power"], "W/m")
    here, coarse = found[True], found[False]
    reflected = abs(here[0] - coarse[0])
    report.row(
        "train of waves: reflection by the border", 100 * reflected, "%", bar="1 %", passes=reflected <= 0.01
    )
    wavelengths = (BEHIND[0] - IN_FLUME[0]) / _wavelength()
    for name, (_, ratio, kept) in (("border", here), ("coarse everywhere", coarse)):
        lost = 1.0 - kept
        bar = {"bar": "0.5 %", "passes": abs(lost) <= 0.005} if name == "border" else {}
        report.row(
            f"train of waves, {name}: share of the waves' power lost between the gauges, by their heights",
            100 * lost,
            "%",
            **bar,
        )
        decay = 100 * (1.0 - ratio) / wavelengths
        bar = {"bar": "0.5 %", "passes": abs(decay) <= 0.5} if name == "border" else {}
        report.row(f"train of waves, {name}: decay per wavelength between the gauges", decay, "%", **bar)


def _wavelength() -> float:
    return 2.0 * np.pi / float(theory.wavenumber(2.0 * np.pi / PERIOD, DEPTH, 9.81))


def _two_ways(series: dict[str, np.ndarray]) -> tuple[complex, float, float]:
    """Complex reflection coefficient in the flume, and ratios of the incident heights and of the waves' net
    powers behind and in it."""
    t = series["time"]
    last = t > t[-1] - 5.0 * PERIOD
    k, waves = 2.0 * np.pi / _wavelength(), []
    for at, columns in ((IN_FLUME, slice(0, 4)), (BEHIND, slice(4, 8))):
        B = fundamental(t[last], series["eta"].T[columns][:, last], PERIOD)
        (along,), (against,), _ = separated(np.array([k]), np.array(at), B[None])
        waves.append((along, against))
    heights, net = abs(waves[1][0]) / abs(waves[0][0]), [abs(a) ** 2 - abs(b) ** 2 for a, b in waves]
    return complex(waves[0][1] / waves[0][0]), float(heights), float(net[1] / net[0])


def _device(report: Report, dx: float, factor: int, members: int) -> None:
    case = study_case("incompressible", dx).replace({"flume.length": OWC_BORDER, "flume.factor": factor})
    found = _members(case, f"border_owc_{dx:g}_behind", members)
    rows = json.loads((COMMITTED / "convergence.json").read_text())["rows"]
    whole = {row["check"].removeprefix(f"incompressible, {1e3 * dx:g} mm: "): row["here"] for row in rows}
    for name, (text, _) in QUANTITIES.items():
        here, error = (float(np.mean([getattr(one, a)[name] for one in found])) for a in ("values", "errors"))
        there, its_error = whole[text], whole[f"{text}, standard error"]
        change = here / there - 1.0
        bar = {} if name == "xi" else {"bar": "1 %", "passes": abs(change) <= 0.01}
        what = f"OWC, {text}: change against the same spacing everywhere (`convergence`)"
        report.row(what, 100 * change, "%", **bar)
        error = float(np.hypot(error / np.sqrt(members), its_error)) / there
        report.row(
            f"OWC, {text}: standard error of this change, from the scatter of periods", 100 * error, "%"
        )
    # a coarse paddle sends other waves than a fine one
    height, its_height = (
        float(np.mean([one.results["incident_height"] for one in found])),
        whole["incident height"],
    )
    report.row("OWC: change of the height of the incident wave", 100 * (height / its_height - 1.0), "%")
    here = float(np.mean([one.results["xi_measured"] for one in found]))
    there = whole[QUANTITIES["xi"][0]] * (case.value("waves.H") / its_height) ** 2
    change = here / there - 1.0
    report.row(
        "OWC, xi over the measured incident wave: change against the same spacing everywhere",
        100 * change,
        "%",
        bar="1 %",
        passes=abs(change) <= 0.01,
    )
    report.row("OWC: xi, mean of the runs", float(np.mean([one.values["xi"] for one in found])))
    lost = float(np.mean([one.results["border_residual"] for one in found]))
    report.row("OWC: share of the power lost at the border", 100 * lost, "%")


def _members(case: js.Case, name: str, members: int) -> list[Found]:
    """Results of runs whose damping differs by rounding, which the vortices at the lip amplify."""
    K_dm, found = case.value("pto.K_dm"), []
    for k in range(members):
        member = case.replace({"pto.K_dm": K_dm * (1.0 + 1e-5 * k)})
        found.append(read(member, solved(member, f"{name}_{k}")))
    return found


def _cost(report: Report, dx: float, factor: int) -> None:
    """Time of the first steps of the built-in OWC behind a border and with the same spacing everywhere, both
    in turns on one core."""
    use_threads(1)
    everywhere = js.load_case("owc").replace({"dx": dx})
    behind = everywhere.replace({"flume.length": 7.1, "flume.factor": factor})
    problems = [case.problem() for case in (behind, everywhere)]
    seconds: list[list[float]] = [[], []]
    states = [problem.state for problem in problems]
    for turn in range(TURNS + 1):
        for k, problem in enumerate(problems):
            began = time.perf_counter()
            chunk = (problem.probes, problem.per_chunk, problem.sample_every)
            states[k], _ = jax.block_until_ready(simulate_chunk(problem.model, states[k], *chunk))
            if turn:  # the first chunk is compiled
                seconds[k].append((time.perf_counter() - began) / problem.per_chunk)
    here, there = (min(each) for each in seconds)
    report.row("built-in OWC: time per step", 1e3 * here, "ms")
    ratio, what = here / there, "built-in OWC: time per step over that with this spacing everywhere"
    report.row(what, ratio, bar="a fifth", passes=ratio <= 0.2)
