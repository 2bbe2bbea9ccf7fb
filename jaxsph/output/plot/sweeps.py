"""Picture of a sweep, an ensemble or a search: a result plotted against the varied parameters."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from jaxsph.output.plot.style import (
    BLUE,
    ORANGE,
    STYLE,
    WIDTH,
    in_style,
)
from jaxsph.output.sweep_file import SweepFile, over_members


def plot_sweep(
    sweep: SweepFile | str | Path, folder: str | Path | None = None, of: str | None = None
) -> list[Path]:
    """Writes the picture of a sweep, an ensemble or a search: the result `of` against the parameters.

    By default the result is xi, or else the first result that the problem itself defines.

    With one parameter the picture shows the members (xi with error bars), or the path of a search with short
    lines for the slopes. With two parameters it shows contours over a grid, or the members of a list or a
    search as coloured points.
    **Returns** the files written; none for more than two parameters, or if no member has the result.
    **Raises** FileError if the file cannot be read.
    """
    sweep = sweep if isinstance(sweep, SweepFile) else SweepFile(sweep)
    folder = Path(folder) if folder is not None else sweep.path.with_name(sweep.path.stem + "_plots")
    stored = sweep.read()
    results = over_members(stored.members, stored.shape)
    of = stored.meanings.first(results) if of is None else of
    if of is None or of not in results or len(stored.axes) > 2:
        return []
    if len(stored.axes) == 1:
        figure = _over_one(stored.axes, results, of)
    elif len(stored.shape) == 2:
        figure = _over_grid(stored.axes, results[of], of)
    else:
        figure = _over_list(stored.axes, results, of)
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / f"{of}.png", dpi=STYLE["savefig.dpi"])
    return [folder / f"{of}.png"]


@in_style
def _over_one(axes: dict[str, np.ndarray], results: dict[str, np.ndarray], of: str) -> Figure:
    (name, x), y = next(iter(axes.items())), results[of]
    figure = Figure(figsize=(0.7 * WIDTH, 4.5), layout="constrained")
    ax = figure.subplots()
    slopes = results.get(f"slope {name}")
    if slopes is None:
        error = results.get("xi_error") if of == "xi" else None
        order = np.argsort(x)
        ax.errorbar(
            x[order], y[order], None if error is None else error[order], fmt="o-", color=BLUE, capsize=2
        )
        ax.set_title(of if error is None else f"{of}, with its standard error over the periods")
    else:
        ax.plot(x, y, ":", color="0.6", lw=1.0)
        ax.plot(x, y, "o", color=BLUE)
        reach = 0.04 * (np.nanmax(x) - np.nanmin(x)) or 0.1 * np.nanmax(np.abs(x))
        for k, (a, b, slope) in enumerate(zip(x, y, slopes, strict=True)):
            ends = np.array([-reach, reach])
            ax.plot(a + ends, b + slope * ends, color=ORANGE, lw=2)
            ax.annotate(str(k + 1), (a, b), (4, 5), textcoords="offset points", fontsize=9)
        ax.set_title(f"{of}, numbered in the order of the search; the short lines show the slopes")
    ax.set(xlabel=name, ylabel=of)
    return figure


@in_style
def _over_grid(axes: dict[str, np.ndarray], values: np.ndarray, of: str) -> Figure:
    (x_name, x), (y_name, y) = axes.items()
    figure = Figure(figsize=(0.7 * WIDTH, 5.0), layout="constrained")
    ax = figure.subplots()
    if min(values.shape) > 1 and np.isfinite(values).sum() > 3:
        drawn = ax.contourf(x, y, np.ma.masked_invalid(values.T), levels=12, cmap="viridis")
        figure.colorbar(drawn, ax=ax, label=of)
    ax.plot(*(a.ravel() for a in np.meshgrid(x, y)), ".", color="k", ms=3)
    best = np.unravel_index(np.nanargmax(values), values.shape)
    ax.plot(x[best[0]], y[best[1]], "*", color=ORANGE, ms=14)
    ax.set(xlabel=x_name, ylabel=y_name, title=f"{of}: the star marks the largest value, {values[best]:.3g}")
    ax.grid(visible=False)
    return figure


@in_style
def _over_list(axes: dict[str, np.ndarray], results: dict[str, np.ndarray], of: str) -> Figure:
    (x_name, x), (y_name, y) = axes.items()
    figure = Figure(figsize=(0.7 * WIDTH, 5.0), layout="constrained")
    ax = figure.subplots()
    if f"slope {x_name}" in results:
        ax.plot(x, y, ":", color="0.6", lw=1.0)
    drawn = ax.scatter(x, y, c=results[of], cmap="viridis")
    figure.colorbar(drawn, ax=ax, label=of)
    for k, place in enumerate(zip(x, y, strict=True)):
        ax.annotate(str(k + 1), place, (4, 5), textcoords="offset points", fontsize=9)
    ax.set(xlabel=x_name, ylabel=y_name, title=of)
    return figure
