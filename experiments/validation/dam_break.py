"""Dam breaks: fronts of Martin and Moyce and of Koshizuka and Oka, and Buchner's pressure on the far wall.

The sources of the measured series are in `experiments/reference/README.md`.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
import typer
from matplotlib.figure import Figure
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

import jaxsph as js
from experiments.common import Report, reference, solved
from jaxsph import analysis
from jaxsph.output.run_file import RunFile

G, RHO = 9.81, 1000.0

WIDTH = 0.05715
"""Width a of Martin and Moyce's column, m: 2.25 in; it is twice as high as wide (n^2 = 2)."""
HEIGHT = 2 * WIDTH
TANK = 9.0
"""Length of the tank divided by a. The front does not reach the end of the tank in the time compared."""
LAST = 5.0
"""End of the runs for the front, in T = t sqrt(2g/a)."""
MARKS = np.arange(1.25, 3.6, 0.05)
"""Positions x/a at which times are compared; all measured series cover them."""

BUCHNER = 0.6
"""Height H of Buchner's column, m: the column is 2H x H in a tank of length 5.366 H."""
SENSOR, DISC = 0.2 * BUCHNER, 0.09
"""Height and diameter of Buchner's transducer, m."""
HEIGHTS = SENSOR + DISC * (np.arange(9) - 4) / 9
"""Heights of the sensors, m: the middles of nine strips of equal height on the disc of the transducer."""
SMOOTHING = 0.1
"""Width of the pressure's running mean, in sqrt(H/g); the fall after the peak lasts ten times as long."""
PLATEAU, PEAK, WINDOW = (3.3, 5.1), (2.4, 3.2), (2.4, 5.4)
"""Intervals of t sqrt(g/H) of the steady pressure, of the first peak and of the comparison (Buchner)."""


class Front(NamedTuple):
    """Time T = t sqrt(2g/a), front x/a and residual height over 2a, at every snapshot."""

    T: np.ndarray
    x: np.ndarray
    height: np.ndarray


class Series(NamedTuple):
    """A measured series of the front: time T = t sqrt(2g/a) and position x/a."""

    T: np.ndarray
    x: np.ndarray


def main(
    resolutions: Annotated[list[int] | None, typer.Argument(help="H/dx; by default 30 and 60")] = None,
) -> None:
    """Runs both dam breaks at each resolution."""
    resolutions = resolutions or [30, 60]
    _fronts(resolutions)
    _impacts(resolutions)


# --------------------------------------------------------------------------- the front


def front_case(layers: int) -> js.Case:
    """Martin and Moyce's column with `layers` spacings over its height, in a long tank."""
    dx = HEIGHT / layers
    unit = float(np.sqrt(WIDTH / (2 * G)))  # unit of T, s
    sample = float(f"{unit / 50:.3g}")
    return js.load_case("dam_break").replace(
        {
            "name": "dam_break_front",
            "description": "column of Martin and Moyce (1952), n^2 = 2, a = 2.25 in",
            "dx": dx,
            "t1": float(f"{LAST * unit:.4g}"),
            "tank.length": TANK * WIDTH,
            "tank.depth": HEIGHT,
            "tank.height": 1.5 * HEIGHT,
            "tank.column": WIDTH,
            "probes": {},
            "output.sample_dt": sample,
            "output.snapshot_dt": 2 * sample,
        }
    )


def connected(x: np.ndarray, dx: float) -> np.ndarray:
    """Mask of the particles in the largest body of water; gaps of more than 2 dx separate bodies of water."""
    pairs = cKDTree(x).query_pairs(2.0 * dx, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs)), tuple(pairs.T)), shape=(len(x), len(x)))
    label = connected_components(graph, directed=False)[1]
    return label == np.bincount(label).argmax()


def front_and_height(x: np.ndarray, dx: float) -> tuple[float, float]:
    """Largest x of the connected water, and its level at the back wall, m.

    A particle extends half a spacing from its centre. The level is read within 2.5 spacings of the wall.
    """
    water = x[connected(x, dx)]
    beside = water[water[:, 0] < 2.5 * dx]
    return float(water[:, 0].max() + 0.5 * dx), float(beside[:, -1].max() + 0.5 * dx)


def fronts_and_heights(file: RunFile, dx: float) -> np.ndarray:
    """`front_and_height` of every snapshot of a run, [2, snapshots], m."""
    return np.array([front_and_height(file.snapshot(i)["x"], dx) for i in range(file.snapshot_count)]).T


def front_of(file: RunFile, dx: float) -> Front:
    """Front and residual height over all snapshots of a run, in dimensionless form."""
    x, height = fronts_and_heights(file, dx)
    T = file.snapshot_times() * np.sqrt(2 * G / WIDTH)
    # the release itself has no snapshot
    return Front(np.append(0.0, T), np.append(1.0, x / WIDTH), np.append(1.0, height / HEIGHT))


def measured() -> dict[str, Series]:
    """Measured fronts, by source."""
    table = _read("martin_moyce_front_table")
    return {
        "Martin and Moyce, table": Series(table[1], table[3]),
        "Martin and Moyce, figure": Series(*_read("martin_moyce_front_figure")),
        "Koshizuka and Oka": Series(*_read("koshizuka_oka_front")),
    }


def mps() -> Series:
    """Front computed by Koshizuka and Oka, inviscid and without a gate."""
    return Series(*_read("koshizuka_oka_front_mps"))


def residual(T: np.ndarray | float) -> np.ndarray | float:
    """Martin and Moyce's column height at the back wall divided by 2a at time T; the table has T/sqrt(2)."""
    tau, height = _read("martin_moyce_height_table")
    return np.interp(T, np.sqrt(2) * tau, height)


def _read(name: str) -> np.ndarray:
    """Columns of a reference file, sorted by the first column."""
    columns = reference(f"{name}.csv").T
    return columns[:, np.argsort(columns[0], kind="stable")]


class Comparison(NamedTuple):
    """Comparison of a front with the measured fronts, in x/a at the marks."""

    lead: dict[str, float]
    """Time by which the front leads each source, in T; one constant per source."""
    deviation: dict[str, np.ndarray]
    """Computed minus measured x/a at the marks, by source, with the times of the source shifted by `lead`."""
    raw: dict[str, np.ndarray]
    """Computed minus measured x/a at the marks, by source, without a shift."""
    outside: np.ndarray
    """Distance from the envelope of the shifted sources; zero inside the envelope."""
    scatter: float
    """RMS difference between Martin and Moyce's table and their figure: the reading error."""


def compared(front: Front) -> Comparison:
    """Compares the front with each source, shifted in time, at the times when the source is at the marks.

    The envelope lies between the smallest and the largest of the shifted sources. The two readings of Martin
    and Moyce belong to one experiment and share one shift.
    """
    sources = measured()
    here = np.interp(MARKS, front.x, front.T)
    there = {name: np.interp(MARKS, s.x, s.T) for name, s in sources.items()}
    early = {name: float(np.mean(T - here)) for name, T in there.items()}
    twice = np.mean([v for name, v in early.items() if name.startswith("Martin")])
    early = {name: float(twice) if name.startswith("Martin") else v for name, v in early.items()}
    deviation = {n: np.interp(T - early[n], front.T, front.x) - MARKS for n, T in there.items()}
    raw = {n: np.interp(T, front.T, front.x) - MARKS for n, T in there.items()}
    # the same times for all sources: when the front here is at the marks
    levels = np.array([np.interp(here + early[n], s.T, s.x) for n, s in sources.items()])
    outside = np.maximum(levels.min(axis=0) - MARKS, 0.0) + np.maximum(MARKS - levels.max(axis=0), 0.0)
    table, figure = (s for name, s in sources.items() if name.startswith("Martin"))
    within = (table.T >= figure.T[0]) & (table.x <= MARKS[-1])
    reading = np.interp(table.T[within], figure.T, figure.x) - table.x[within]
    return Comparison(early, deviation, raw, outside, float(np.sqrt(np.mean(reading**2))))


def slope(T: np.ndarray, x: np.ndarray, low: float, high: float) -> float:
    """Speed d(x/a)/dT between two positions x/a, by least squares on points evenly spaced in x."""
    marks = np.linspace(low, high, 40)
    return float(1.0 / np.polyfit(marks, np.interp(marks, x, T), 1)[0])


def _fronts(resolutions: list[int]) -> None:
    fronts, seconds = {}, 0.0
    with Report("dam_break_front", "Dam break, n^2 = 2: front and residual height") as report:
        for layers in resolutions:
            case = front_case(layers)
            file = solved(case, f"dam_break_front_{layers}")
            fronts[layers] = front_of(file, case.dx)
            seconds += file.results()["wall_seconds"]
            _front_rows(report, f"H/dx = {layers}", fronts[layers])
            _energy_rows(report, f"H/dx = {layers}", file, WIDTH, HEIGHT)
        report.seconds = seconds
        report.picture(_front_picture(fronts))
        report.picture(_particles(file, case, [1.0, 2.0, 3.0, 4.0], WIDTH / 2, "t sqrt(2g/a)"), "_particles")


def _front_rows(report: Report, label: str, front: Front) -> None:
    found = compared(front)
    sources = measured()
    outside = float(np.max(found.outside))
    report.row(
        f"{label}: largest distance of the front from the envelope of the shifted measurements",
        outside,
        "a",
        theory=0.0,
        bar=f"< {found.scatter:.2g} (reading error)",
        passes=outside < found.scatter,
    )
    report.row(f"{label}: the same, RMS", float(np.sqrt(np.mean(found.outside**2))), "a", theory=0.0)
    for name in sources:
        for kind, off in (("unshifted", found.raw[name]), ("shifted", found.deviation[name])):
            off_by = f"{label}: deviation of the front from {name}, {kind}"
            report.row(f"{off_by}, largest", float(off[np.argmax(abs(off))]), "a", theory=0.0)
            report.row(f"{off_by}, RMS", float(np.sqrt(np.mean(off**2))), "a", theory=0.0)
        report.row(f"{label}: lead over {name}, in T", found.lead[name])
    for low, high in ((2.0, 3.6), (4.0, 6.5)):
        of = {n: slope(s.T, s.x, low, high) for n, s in sources.items() if s.x[-1] >= high}
        report.row(
            f"{label}: slope d(x/a)/dT from {low:g} to {high:g}",
            slope(front.T, front.x, low, high),
            paper=", ".join(f"{v:.3g}" for v in of.values()),
        )
    tau, height = _read("martin_moyce_height_table")
    T = np.sqrt(2) * tau
    early = found.lead["Martin and Moyce, table"]
    known = T - early < front.T[-1]
    for kind, shift in (("unshifted", 0.0), ("with the front's shift", early)):
        off = np.interp(T[known] - shift, front.T, front.height) - height[known]
        rms = float(np.sqrt(np.mean(off**2)))
        report.row(f"{label}: residual height, {kind}, RMS error over 2a", rms, theory=0.0)


def _energy_rows(report: Report, label: str, file: RunFile, length: float, height: float) -> None:
    """Reports the energy. Stored energy can only fall: no gate, paddle or air does work on the water."""
    grown, share = energy_growth(file.series(), length, height)
    report.row(
        f"{label}: largest rise of the stored energy over the initial potential energy",
        grown,
        theory=0.0,
        bar="< 1e-3",
        passes=grown < 1e-3,
    )
    what = "energy not accounted for over the initial potential energy"
    report.row(f"{label}: {what}", share, theory=0.0)


def energy_growth(series: dict[str, np.ndarray], length: float, height: float) -> tuple[float, float]:
    """Largest rise of the stored energy above its previous minimum, and energy not accounted for at the end.

    Both are divided by the potential energy of the column, rho g height^2 length/2.
    """
    scale = 0.5 * RHO * G * height**2 * length
    stored = series["kinetic"] + series["potential"] + series["compression"]
    missing = analysis.energy_budget(series)["residual"]
    return float(np.max(stored - np.minimum.accumulate(stored)) / scale), missing / scale


def _front_picture(fronts: dict[int, Front]) -> Figure:
    """Figure of fronts, without and with shift, and of the residual height, with the measurements."""
    figure = Figure(figsize=(12, 5), layout="constrained")
    raw, shifted, level = figure.subplots(1, 3)
    finest = compared(fronts[max(fronts)])
    for marker, (name, series) in zip("osD", measured().items(), strict=True):
        raw.plot(*series, marker, ms=4, mfc="none", label=name)
        early = finest.lead[name]
        shifted.plot(
            series.T - early, series.x, marker, ms=4, mfc="none", label=f"{name}, {early:.2f} earlier"
        )
    raw.plot(*mps(), "k:", lw=1, label="Koshizuka and Oka, computed (MPS)")
    tau, height = _read("martin_moyce_height_table")
    level.plot(np.sqrt(2) * tau, height, "o", ms=4, mfc="none", label="Martin and Moyce, table")
    for layers, front in fronts.items():
        for axis in (raw, shifted):
            axis.plot(front.T, front.x, label=f"here, H/dx = {layers}")
        level.plot(front.T, front.height, label=f"here, H/dx = {layers}")
    for axis, title in ((raw, "front"), (shifted, "front, measured series shifted in time")):
        axis.set(xlabel="t sqrt(2g/a)", ylabel="x/a", xlim=(0, LAST), ylim=(1, TANK), title=title)
    level.set(xlabel="t sqrt(2g/a)", ylabel="height at the back wall / 2a", xlim=(0, LAST), ylim=(0, 1.05))
    for axis in (raw, shifted, level):
        axis.legend(fontsize="small")
    return figure


def _particles(file: RunFile, case: js.Case, moments: list[float], unit_length: float, unit: str) -> Figure:
    """Figure of particles coloured by pressure at the `moments` t sqrt(g/unit_length).

    `unit`: formula of these dimensionless times, for the titles.
    """
    high = case.tank.depth
    snapshots = []
    for moment in moments:
        t = moment * np.sqrt(unit_length / G)
        snapshots.append(file.snapshot(int(np.argmin(abs(file.snapshot_times() - t)))))
    top = 1.1 * max(high, *(s["x"][:, 1].max() for s in snapshots))
    right = min(case.tank.length, 1.1 * max(s["x"][:, 0].max() for s in snapshots))
    columns = 2
    rows = (len(moments) + 1) // columns
    figure = Figure(figsize=(12, 0.7 + rows * (0.4 + 5.1 * top / right)), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True).ravel()
    for axis, moment, snapshot in zip(axes, moments, snapshots, strict=False):
        axis.set(xlim=(0, right), ylim=(0, top), aspect="equal", title=f"{unit} = {moment:g}")
        # dots as wide as a spacing: an axis is 5.4 inches wide and shows `right` metres
        size = (1.3 * 72 * 5.4 / right * case.dx) ** 2
        dots = axis.scatter(
            *snapshot["x"].T,
            c=snapshot["p"] / (RHO * G * high),
            s=size,
            lw=0,
            vmin=0.0,
            vmax=1.0,
        )
    figure.colorbar(dots, ax=axes, label="p/(rho g H)", extend="both")
    for axis in axes:
        axis.set(xlabel="x, m", ylabel="z, m")
        axis.label_outer()
    return figure


# --------------------------------------------------------------------------- the impact


def impact_case(layers: int) -> js.Case:
    """Buchner's tank with `layers` spacings over the column's height, and sensors across the transducer."""
    length = js.load_case("dam_break").tank.length
    return js.load_case("dam_break").replace(
        {
            "dx": BUCHNER / layers,
            "probes.pressure": [[length, float(z)] for z in HEIGHTS],
            "output.sample_dt": 0.002,
        }
    )


def averaged(pressure: np.ndarray) -> np.ndarray:
    """Mean over the disc from sensors at `HEIGHTS` (the last axis), weighted by the disc's width there."""
    chord = np.sqrt((DISC / 2) ** 2 - (HEIGHTS - SENSOR) ** 2)
    return pressure @ (chord / chord.sum())


def smoothed(t: np.ndarray, p: np.ndarray, width: float) -> np.ndarray:
    """Running mean of p over `width`, at evenly spaced times t."""
    count = max(1, round(width / (t[1] - t[0])))
    return np.convolve(p, np.ones(count) / count, mode="same")


class Impact(NamedTuple):
    """Arrival, first peak and plateau of a pressure series, in t sqrt(g/H) and p/(rho g H)."""

    arrival: float
    """Time when the pressure first exceeds a fifth of rho g H."""
    peak: float
    plateau: float

    @classmethod
    def of(cls, t: np.ndarray, p: np.ndarray) -> Impact:
        """Evaluates a series of times t and pressures p."""
        first = t[np.argmax(p > 0.2)]
        peak = p[(t > PEAK[0]) & (t < PEAK[1])].max()
        return cls(float(first), float(peak), float(p[(t > PLATEAU[0]) & (t < PLATEAU[1])].mean()))


def measured_impact() -> np.ndarray:
    """Buchner's measured pressure: t sqrt(g/H) and p/(rho g H)."""
    return _read("buchner_pressure")


def _impacts(resolutions: list[int]) -> None:
    t_there, p_there = measured_impact()
    there = Impact.of(t_there, p_there)
    found, seconds = {}, 0.0
    with Report("dam_break_impact", "Dam break: pressure on the far wall (Buchner 2002)") as report:
        for layers in resolutions:
            case = impact_case(layers)
            file = solved(case, f"dam_break_impact_{layers}")
            series = file.series()
            seconds += file.results()["wall_seconds"]
            t = series["time"] * np.sqrt(G / BUCHNER)
            p = series["pressure"] / (RHO * G * BUCHNER)
            found[layers] = (t, p[:, len(HEIGHTS) // 2], averaged(p))
            window = (t_there > WINDOW[0]) & (t_there < WINDOW[1])
            for kind, raw in (("point", found[layers][1]), ("disc", found[layers][2])):
                label = f"H/dx = {layers}, {kind}"
                smooth = smoothed(t, raw, SMOOTHING)
                here = Impact.of(t, smooth)
                report.row(f"{label}: arrival, t sqrt(g/H)", here.arrival, paper=there.arrival)
                report.row(f"{label}: first peak, p/(rho g H)", here.peak, paper=there.peak)
                report.row(f"{label}: plateau, p/(rho g H)", here.plateau, paper=there.plateau)
                off = np.interp(t_there[window], t, smooth) - p_there[window]
                rms = float(np.sqrt(np.mean(off**2)))
                report.row(
                    f"{label}: RMS error from {WINDOW[0]:g} to {WINDOW[1]:g} sqrt(H/g)", rms, "rho g H"
                )
                steady = (t > PLATEAU[0]) & (t < PLATEAU[1])
                noise = float(np.std(raw[steady] - smooth[steady]))
                report.row(f"{label}: noise of the plateau, unsmoothed", noise, "rho g H", theory=0.0)
            _energy_rows(report, f"H/dx = {layers}", file, 2 * BUCHNER, BUCHNER)
            last = file.snapshot(file.snapshot_count - 1)["x"]
            inside = (last[:, 0] > 0) & (last[:, 0] < case.tank.length) & (last[:, 1] > 0)
            report.row(
                f"H/dx = {layers}: particles outside the walls at the end",
                float(np.sum(~inside)),
                theory=0.0,
                bar="0",
                passes=bool(inside.all()),
            )
        report.seconds = seconds
        report.picture(_impact_picture(found, t_there, p_there))
        report.picture(_particles(file, case, [2.6, 3.6, 5.9, 7.0], BUCHNER, "t sqrt(g/H)"), "_particles")


def _impact_picture(found: dict[int, tuple], t_there: np.ndarray, p_there: np.ndarray) -> Figure:
    """Figure of the pressure over time at the point and over the disc, unsmoothed (thin) and smoothed."""
    figure = Figure(figsize=(10, 7), layout="constrained")
    axes = figure.subplots(2, sharex=True, sharey=True)
    for axis, which, title in ((axes[0], 1, "at the point"), (axes[1], 2, "over the disc of 90 mm")):
        for (layers, series), colour in zip(found.items(), ("C0", "C1", "C2"), strict=False):
            t, p = series[0], series[which]
            axis.plot(t, p, lw=0.4, alpha=0.5, color=colour)
            axis.plot(t, smoothed(t, p, SMOOTHING), color=colour, label=f"here, H/dx = {layers}")
        axis.plot(t_there, p_there, "ko", ms=3, mfc="none", label="Buchner 2002")
        axis.set(ylabel="p/(rho g H)", ylim=(-0.3, 2.0), title=title)
        axis.legend(fontsize="small", loc="upper left")
    axes[-1].set(xlabel="t sqrt(g/H)", xlim=(2.0, 7.5))
    return figure
