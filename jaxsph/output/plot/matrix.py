"""Picture of a power matrix: mean power of every sea state as a number, next to linear theory."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from jaxsph.output.plot.style import STYLE, WIDTH, in_style

Table = NDArray[np.float64]


class MeanPower(Protocol):
    """Interface of a power matrix, as implemented by `jaxsph.PowerMatrix`."""

    @property
    def Hs(self) -> Table:
        """Significant wave heights, m."""
        ...

    @property
    def Tp(self) -> Table:
        """Peak periods, s."""
        ...

    @property
    def P(self) -> Table:
        """Mean power, `[Hs, Tp]`, W (W/m in 2-D); NaN if no run of the sea state was completed."""
        ...

    @property
    def error(self) -> Table:
        """Standard error of the mean power, `[Hs, Tp]`, W (W/m in 2-D)."""
        ...

    @property
    def linear(self) -> Table:
        """Mean power by linear theory, `[Hs, Tp]`, W/m; NaN if the theory does not cover the case."""
        ...

    @property
    def unit(self) -> str:
        """Unit of the powers."""
        ...


def plot_matrix(matrix: MeanPower, folder: str | Path) -> Path:
    """Writes the picture of a power matrix into a folder and returns its path."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "matrix.png"
    draw_matrix(matrix).savefig(path, dpi=STYLE["savefig.dpi"])
    return path


@in_style
def draw_matrix(matrix: MeanPower) -> Figure:
    """Figure of the mean power with its standard error, and of linear theory if it covers the case."""
    panels = [("mean power", matrix.P, matrix.error)]
    if np.any(np.isfinite(matrix.linear)):
        panels.append(("linear theory", matrix.linear, np.zeros(matrix.linear.shape)))
    figure = Figure(figsize=(0.6 * WIDTH * len(panels), 4.0), layout="constrained")
    known = [values[np.isfinite(values)] for _, values, _ in panels]
    most = max((float(np.max(values)) for values in known if values.size), default=1.0)
    for ax, (title, values, error) in zip(np.ravel(figure.subplots(1, len(panels))), panels, strict=True):
        ax.imshow(values, origin="lower", aspect="auto", cmap="viridis", vmin=0.0, vmax=most)
        for i, j in np.ndindex(values.shape):
            there = bool(np.isfinite(values[i, j]))
            text = f"{values[i, j]:.3g}" if there else "failed"
            if there and error[i, j] > 0.0:
                text += f"\n+- {error[i, j]:.1g}"
            dark = there and values[i, j] < 0.6 * most
            ax.text(j, i, text, ha="center", va="center", color="w" if dark else "k")
        ax.set_xticks(range(len(matrix.Tp)), [f"{T:g}" for T in matrix.Tp])
        ax.set_yticks(range(len(matrix.Hs)), [f"{H:g}" for H in matrix.Hs])
        ax.set(xlabel="Tp, s", ylabel="Hs, m", title=f"{title}, {matrix.unit}")
        ax.grid(visible=False)
    return figure
