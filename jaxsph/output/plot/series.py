"""Pictures of a run over time: gauges, chamber, body, pressure sensors, energy budget.

Every function for a picture takes a `RunFile` and returns a matplotlib `Figure`, or None if the run did not
record the necessary series.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jaxsph import analysis
from jaxsph.model.rigid import space_with
from jaxsph.output.hdf5 import Variable
from jaxsph.output.plot.style import (
    BLUE,
    GREEN,
    GREY,
    OLIVE,
    ORANGE,
    PURPLE,
    RED,
    SKY,
    STORED,
    Overlay,
    axis_name,
    has_samples,
    in_style,
    share_limits,
    stacked_axes,
)
from jaxsph.output.run_file import RunFile
from jaxsph.waves.linear_owc import LinearOWC


@in_style
def gauges(run: RunFile, overlay: Overlay | None = None) -> Figure | None:
    """Figure of the elevation (m) at each wave gauge over time: one panel per gauge, on a common scale."""
    series = run.series()
    if not has_samples(series, "eta"):
        return None
    positions = run.coordinates().get("gauge_x")
    x = positions[1] if positions is not None else [None] * series["eta"].shape[1]
    t, figure, axes = series["time"], *stacked_axes(len(x), 1.5)
    for ax, at, eta in zip(axes, x, series["eta"].T, strict=True):
        ax.plot(t, eta, color=BLUE, label="simulation")
        ax.set_title(axis_name(ax, "gauge") if at is None else f"gauge at x = {at:.4g} m")
        if overlay is not None and at is not None:
            ax.plot(t, overlay(t, float(at)), "--", color=RED, lw=1.2, label="theory")
    if overlay is not None:
        # the legend is above the axes, where no line crosses it
        axes[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.1)
    share_limits(list(axes))
    figure.supylabel("elevation above still water (m)", fontsize=11)
    return figure


SEVERAL = (BLUE, ORANGE, GREEN, RED)
"""Colours of several chambers, the same in every panel."""


@in_style
def chamber(run: RunFile, linear: LinearOWC | None = None) -> Figure | None:
    """Figure of level, flow, pressure and power of the chambers over time.

    With `linear`, dashed lines show linear theory: the extremes of level, flow and pressure, and the mean
    power. The lines span the periods over which the efficiency was averaged, or else the last period.
    """
    panels = [
        ("chamber_level", "level (m)", "mean level relative to still water, positive upwards", BLUE),
        ("flow", "flow", "air flow out of the chamber (m$^3$/s; m$^2$/s in two dimensions)", GREEN),
        ("P_a", "pressure (Pa)", "air pressure above atmospheric, positive when compressed", RED),
        ("power_pto", "power", "power absorbed by the PTO (W; W/m in two dimensions)", PURPLE),
    ]
    series = run.series()
    ends = [name.removeprefix("P_a") for name in series if name == "P_a" or name.startswith("P_a_")]
    lines = {name: [end for end in ends if has_samples(series, name + end)] for name, *_ in panels}
    panels = [panel for panel in panels if lines[panel[0]]]
    if not panels:
        return None
    t, figure, axes = series["time"], *stacked_axes(len(panels), 2.0)
    for ax, (name, label, title, colour) in zip(axes, panels, strict=True):
        shades = dict(zip(ends, itertools.cycle(SEVERAL if len(ends) > 1 else (colour,)), strict=False))
        for end in lines[name]:
            shade = shades[end]
            ax.plot(t, series[name + end], color=shade, label=end.removeprefix("_"))
            if name == "power_pto":
                _fill(ax, t, series[name + end], shade)
        ax.axhline(0.0, color="0.5", lw=0.8, zorder=1)
        ax.set_ylabel(label)
        ax.set_title(title)
        if linear is not None:
            settled = t[-1] - run.results().get("periods", 1.0) * linear.T
            _expect(ax, (max(settled, t[0]), t[-1]), name, linear)
    if linear is not None or len(ends) > 1:
        axes[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.1)
    figure.align_ylabels(axes)
    return figure


@in_style
def body(run: RunFile) -> Figure | None:
    """Figure of the rigid body's motions, the water's force on it and the power of its PTO over time."""
    series = run.series()
    if not has_samples(series, "body_force"):
        return None
    force = series["body_force"]
    space = space_with(force.shape[1])
    # a fixed body has no motions
    panels = [
        (scale * series[name], f"{name} ({shown})", f"{name} of the body", BLUE)
        for name, unit in zip(space.motions, space.units, strict=True)
        for scale, shown in ((1.0, "m") if unit == "m" else (180.0 / np.pi, "deg"),)
        if name in series
    ]
    panels += [
        (values, _symbol(name), f"the water's {words} on the body ({_unit(name)})", RED)
        for (name, words), values in zip(space.loads.items(), force.T, strict=True)
    ]
    power = "power absorbed by the PTO (W; W/m in two dimensions)"
    panels += [(series[name], "power", power, PURPLE) for name in harvested(run.variables())]
    panels = [panel for panel in panels if np.ptp(panel[0]) > 0.0]
    if not panels:
        return None
    t, figure, axes = series["time"], *stacked_axes(len(panels), 1.7)
    for ax, (values, label, title, colour) in zip(axes, panels, strict=True):
        ax.plot(t, values, color=colour)
        ax.axhline(0.0, color="0.5", lw=0.8, zorder=1)
        ax.set_ylabel(label)
        ax.set_title(title)
    figure.align_ylabels(axes)
    return figure


def _unit(load: str) -> str:
    """Units of a force or a moment, by its name in `rigid.AbstractSpace.loads`."""
    return "N m; N in two dimensions" if load.startswith("moment") else "N; N/m in two dimensions"


def _symbol(load: str) -> str:
    """Symbol of a force or a moment, by its name in `rigid.AbstractSpace.loads`."""
    kind, *axis = load.split("_")
    return {"force": "F", "moment": "M"}[kind] + "".join(f"$_{one}$" for one in axis)


def _expect(ax: Axes, span: tuple[float, float], name: str, linear: LinearOWC) -> None:
    """Draws dashed lines of linear theory over a span of time."""
    if name == "power_pto":
        values = [linear.P_owc]
    else:
        # for the pressure, the peak of the quadratic law; the amplitude of its fundamental is 15 % lower
        peaks = {"chamber_level": abs(linear.level), "flow": abs(linear.q), "P_a": linear.P_a_peak}
        values = [-peaks[name], peaks[name]]
    for value in values:
        (line,) = ax.plot(span, [value, value], "--", color="black", lw=1.2)
    line.set_label("linear theory")


def _fill(ax: Axes, t: np.ndarray, power: np.ndarray, colour: str) -> None:
    ax.fill_between(t, power, color=colour, alpha=0.2, lw=0)
    ax.set_ylim(bottom=min(0.0, float(np.min(power))))


@in_style
def pressures(run: RunFile) -> Figure | None:
    """Figure of the gauge pressure (Pa) at each sensor over time."""
    series = run.series()
    if not has_samples(series, "pressure"):
        return None
    where = [v for k, v in run.coordinates().items() if k.startswith("sensor_")]
    t, figure, axes = series["time"], *stacked_axes(series["pressure"].shape[1], 1.9)
    for i, ax in enumerate(axes):
        ax.plot(t, series["pressure"][:, i], color=BLUE)
        point = ", ".join(f"{values[i]:.4g}" for _, values, _, _ in where)
        ax.set_title(f"sensor at ({point}) m" if point else f"sensor {i + 1}")
    figure.supylabel("gauge pressure (Pa)", fontsize=11)
    return figure


@in_style
def energy(run: RunFile) -> Figure | None:
    """Figure of the energy budget (J; J/m in 2-D) over time: the paddle's work, the losses, and the stored
    energy."""
    series = run.series()
    if not all(has_samples(series, name) for name in ("kinetic", "potential", "compression")):
        return None
    from_ptos = harvested(run.variables())
    terms = energy_terms(series, from_ptos)
    work = work_of(series, "power_paddle")
    t, figure, axes = series["time"], *stacked_axes(1, 5.2)
    ax = axes[0]
    # Stacked areas show the sum only if no loss is negative. Otherwise draw lines, for example if a
    # prescribed pressure does work on the water.
    largest = max(float(np.max(np.abs(values))) for _, values, _ in terms)
    losses = [values for _, values, _ in terms[:-1]]
    if all(float(np.min(values)) >= -0.01 * largest for values in losses):
        _areas(ax, t, terms)
    else:
        for label, values, colour in terms:
            ax.plot(t, values, color=colour, label=label)
    if np.any(work):
        ax.plot(t, work, color="black", lw=1.6, label="work done by the paddle")
    ax.axhline(0.0, color="0.5", lw=0.8)
    units = run.variables()["kinetic"].units
    ax.set_ylabel("energy since the start " + ("(J)" if units == "J" else "(J/m)"))
    ax.set_title(_budget_title(series, from_ptos))
    handles, labels = ax.get_legend_handles_labels()
    ax.legend(handles[::-1], labels[::-1], loc="upper left")  # in the order of the areas
    return figure


LOSSES = {
    "sponge": ("absorbed by the sponge", PURPLE),
    "hyperviscosity": ("lost by hyperviscosity", OLIVE),
    "contact": ("lost in contact with solids", BLUE),
    "projection": ("lost in the projection", RED),
    "viscous": ("viscous loss", ORANGE),
    "diffusive": ("density diffusion", RED),
}
"""Labels and colours of the energies lost by the water, by the names of their powers without "power_" or
"loss_"."""
LEAST = 3.0e-3
"""Ratio of an energy to the largest energy in a budget (-), below which the energy is drawn in "the rest"."""


def harvested(variables: Mapping[str, Variable]) -> list[str]:
    """Names of the power take-offs' series. All other powers are in the group "energy" of the file."""
    return [name for name, of in variables.items() if name.startswith("power_") and of.group == "series"]


def energy_terms(
    series: dict[str, np.ndarray], from_ptos: Collection[str] = ("power_pto",)
) -> list[tuple[str, np.ndarray, str]]:
    """Terms of the energy budget: (label, energy since the start, colour), with the stored energy last.

    `from_ptos`: names of the power take-offs' series.
    """
    stored = series["kinetic"] + series["potential"] + series["compression"]
    terms = [
        ("absorbed by the PTO", _of_every_pto(series, from_ptos), GREEN),
        *(
            (LOSSES[name][0], _integral(series, f"loss_{name}"), LOSSES[name][1])
            for name in ("viscous", "diffusive")
        ),
    ]
    for taker in analysis.takers(series, from_ptos):
        label, colour = LOSSES.get(taker, (taker.replace("_", " "), GREY))
        terms.append((label, work_of(series, f"power_{taker}"), colour))
    last = (STORED, stored - stored[0], SKY)
    sizes = [float(np.max(np.abs(values))) for _, values, _ in (*terms, last)]
    large = [size > LEAST * max(sizes) for size in sizes[:-1]]
    shown = [term for term, alone in zip(terms, large, strict=True) if alone]
    small = [values for (_, values, _), alone in zip(terms, large, strict=True) if not alone]
    rest = sum(small, np.zeros_like(stored))
    if np.any(rest):
        shown.append(("the rest", rest, GREY))
    return [*shown, last]


def _of_every_pto(series: dict[str, np.ndarray], from_ptos: Collection[str]) -> np.ndarray:
    """Energy absorbed by all power take-offs together, J (J/m in 2-D)."""
    works = [work_of(series, name) for name in from_ptos]
    return np.sum([np.zeros_like(series["time"]), *works], axis=0)


def _areas(ax: Axes, t: np.ndarray, terms: list[tuple[str, np.ndarray, str]]) -> None:
    base = np.zeros_like(t)
    for label, values, colour in terms:
        # stored energy is negative when the paddle moves back, so it is drawn behind the losses
        z = 1.5 if label == STORED else 2.0
        ax.fill_between(t, base, base + values, color=colour, lw=0, label=label, zorder=z)
        base = base + values


def _budget_title(series: dict[str, np.ndarray], from_ptos: list[str]) -> str:
    budget = analysis.energy_budget(series, from_ptos)
    paddle = abs(budget["paddle"])
    if paddle > 0.0 and paddle >= float(np.max(np.abs(series["kinetic"]))):
        share, whole = budget["residual"] / paddle, "the paddle's work"
    else:
        share, whole = budget["residual_share"], "the largest kinetic energy"
    percent = round(100 * share, 2) + 0.0  # avoids -0.00
    return f"energy budget: {percent:+.2f} % of {whole} is not accounted for"


def work_of(series: dict[str, np.ndarray], name: str) -> np.ndarray:
    """Energy, J (J/m in 2-D), from a power whose samples are means over the interval before each sample."""
    if name not in series:
        return np.zeros_like(series["time"])
    work = np.cumsum(series[name][1:] * np.diff(series["time"]))
    return np.concatenate([[0.0], work])


def _integral(series: dict[str, np.ndarray], name: str) -> np.ndarray:
    """Energy, J (J/m in 2-D), from a power with instantaneous samples, by the trapezoidal rule."""
    if name not in series:
        return np.zeros_like(series["time"])
    power = series[name]
    work = np.cumsum(0.5 * (power[1:] + power[:-1]) * np.diff(series["time"]))
    return np.concatenate([[0.0], work])
