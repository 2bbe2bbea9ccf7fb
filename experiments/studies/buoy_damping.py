"""Best damping of a heaving buoy in small waves, by search, against linear theory.

The buoy is that of the case `buoy_heave`, in waves 0.03 m high. A golden-section search over the damping's
logarithm finds the largest mean power. Near its maximum the power hardly depends on the damping: at 1.1 times
the best damping it is 0.3 % lower, which is within the scatter between runs. The best damping is therefore
taken from all runs of the search. In linear theory (Falnes 2002) the mean power is

    P = b |F|^2 / (2 |Z + b|^2),    so that  b / P = (|Z|^2 + 2 R b + b^2) 2 / |F|^2,

with the mechanical impedance Z = R + iX, and P is largest at b = |Z|. A parabola fitted to b / P as a
function of b gives |Z| without any number from theory.

Vortices at the sharp bilges of this buoy dissipate power. Linear theory neglects this dissipation; one
further run, at the best damping of linear theory, therefore has a buoy with round bilges.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import shapely
from matplotlib.figure import Figure

import jaxsph as js
from experiments.common import Report, solved
from experiments.floating_body import LinearBody, box_outline, displaced
from jaxsph.output.plot.style import BLUE, in_style

H, T = 0.03, 1.2
"""Height (m) and period (s) of the waves."""
BOUNDS = (60.0, 1500.0)
"""Smallest and largest damping of the search, N s/m per metre."""
RUNS = 7
"""Number of runs of the search."""
GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)
BILGE = 0.05
"""Radius of round bilges, m."""


def linear(bilge: float = 0.0) -> LinearBody:
    """The buoy in linear theory, with bilges of the radius `bilge` (m). Its moment of inertia does not matter
    in heave."""
    outline = box_outline(0.3, 0.1, 0.2, bilge)
    return LinearBody(outline, 0.4, displaced(outline), 0.3, (0.0, 0.0))


BODY = linear()


def golden_section(value: Callable[[float], float], low: float, high: float, count: int) -> float:
    """Position of a maximum between low and high (> 0), by `count` evaluations on a logarithmic scale.

    Kiefer, Sequential minimax search for a maximum, Proc. Am. Math. Soc. 4 (1953) 502-506.
    """
    a, b = float(np.log(low)), float(np.log(high))
    left, right = b - GOLDEN * (b - a), a + GOLDEN * (b - a)
    at_left, at_right = value(float(np.exp(left))), value(float(np.exp(right)))
    for _ in range(count - 2):
        if at_left > at_right:
            b, right, at_right = right, left, at_left
            left = b - GOLDEN * (b - a)
            at_left = value(float(np.exp(left)))
        else:
            a, left, at_left = left, right, at_right
            right = a + GOLDEN * (b - a)
            at_right = value(float(np.exp(right)))
    return float(np.exp(left if at_left > at_right else right))


def best_of(damping: np.ndarray, power: np.ndarray) -> tuple[float, float]:
    """Best damping (N s/m per metre), and largest power over the squared wave amplitude (W/m3), by a parabola
    fitted to b / P as a function of b."""
    # every power has about the same relative error, and so has b / P
    bend, slope, foot = np.polyfit(damping, damping / power, 2, w=power / damping)
    best = float(np.sqrt(foot / bend))
    return best, best / float(np.polyval([bend, slope, foot], best))


def linear_power(damping: float, body: LinearBody = BODY) -> float:
    """Mean power of linear theory over the squared wave amplitude, W/m3."""
    omega = 2.0 * np.pi / T
    water = body.water(omega)
    dynamic = body.stiffness[1, 1] - omega**2 * (body.mass + water.added_mass[1, 1])
    heave = water.excitation[1] / (dynamic - 1j * omega * (water.damping[1, 1] + damping))
    return float(0.5 * damping * abs(omega * heave) ** 2)


def linear_best(body: LinearBody = BODY) -> float:
    """Best damping of linear theory: the magnitude of the mechanical impedance, N s/m per metre."""
    omega = 2.0 * np.pi / T
    water = body.water(omega)
    reactance = omega * (body.mass + water.added_mass[1, 1]) - body.stiffness[1, 1] / omega
    return float(np.hypot(water.damping[1, 1], reactance))


def case_of(damping: float, dx: float, bilge: float = 0.0) -> js.Case:
    """The buoy with a damping (N s/m per metre) and round bilges of the radius `bilge` (m); dx in m."""
    changes = {"dx": dx, "waves.H": H, "waves.T": T, "link.take_off.damping": damping}
    if bilge:
        body = linear(bilge)
        corners = np.add(body.outline, (3.15, body.depth)).tolist()
        density = body.mass / shapely.Polygon(body.outline).area
        changes |= {"body.block": None, "body.polygon": corners, "body.density": density}
    return js.load_case("buoy_heave").replace(changes)


def main(dx: float = 0.01, runs: int = RUNS) -> None:
    """Searches for the best damping in `runs` runs."""
    found: dict[float, float] = {}
    heights: list[float] = []
    title = "Best damping of a heaving buoy in small waves, by search"
    with Report(f"buoy_damping_{dx:g}", title, dx) as report:
        seconds: list[float] = []

        def run(damping: float, bilge: float = 0.0) -> float:
            """Mean power over the squared amplitude of the incident waves, W/m3."""
            name = f"buoy_damping_{dx:g}_{damping:g}" + ("_round" if bilge else "")
            results = solved(case_of(damping, dx, bilge), name).results()
            seconds.append(results["wall_seconds"])
            heights.append(results["incident_height"])
            return results["P_pto"] / (0.5 * results["incident_height"]) ** 2

        def power(damping: float) -> float:
            """Result of `run` at the damping rounded to four digits, W/m3; it is stored in `found`."""
            damping = float(f"{damping:.4g}")
            found[damping] = run(damping)
            return found[damping]

        last = golden_section(power, *BOUNDS, runs)
        damping, values = np.array(sorted(found.items())).T
        (best, highest), optimum = best_of(damping, values), linear_best()
        most = linear_power(optimum)
        report.row("best damping of the search", last, "N s/m2", theory=optimum)
        report.against("best damping, by a parabola fitted to all runs", best, optimum, "N s/m2", bar=0.1)
        report.against("largest power over the squared wave amplitude", highest, most, "W/m3", bar=0.05)
        fit = np.polyval(np.polyfit(damping, damping / values, 2, w=values / damping), damping)
        scatter = float(np.std(damping / values / fit - 1.0)) * np.sqrt(len(fit) / max(len(fit) - 3, 1))
        report.row("scatter of the runs about the parabola", 100 * scatter, "%")
        body = linear(BILGE)
        given = float(f"{linear_best(body):.4g}")
        what = f"with round bilges, at {given:g} N s/m2: power over the squared wave amplitude"
        report.against(what, run(given, BILGE), linear_power(given, body), "W/m3", bar=0.05)
        report.seconds = sum(seconds)
        report.row("mean incident height over the specified height", float(np.mean(heights)) / H)
        report.picture(_picture(damping, values, best, highest))


@in_style
def _picture(damping: np.ndarray, power: np.ndarray, best: float, highest: float) -> Figure:
    """Figure of the power against the damping."""
    figure = Figure(figsize=(6.0, 4.0), layout="constrained")
    ax = figure.subplots()
    fine = np.geomspace(*BOUNDS, 60)
    ax.plot(fine, [linear_power(float(b)) for b in fine], "k--", lw=1, label="linear theory")
    ax.plot(damping, power, "o", color=BLUE, label="runs of the search")
    ax.plot(best, highest, "+", color=BLUE, ms=14, label="maximum of the fit")
    ax.set(xscale="log", xlabel="damping, N s/m per metre", ylabel="P/a^2, W/m per m2", ylim=(0, None))
    ax.legend(fontsize="small")
    return figure
