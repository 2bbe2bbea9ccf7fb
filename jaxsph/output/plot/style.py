"""Style of all pictures: colours, widths, and columns of panels with a common time axis."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, cast

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

Overlay = Callable[[np.ndarray, float], np.ndarray]
"""Function that returns the expected elevation (m) at times t (s) and a position x (m)."""


# Okabe and Ito's colours, which colour-blind readers can distinguish.
BLUE, ORANGE, GREEN, RED, PURPLE, SKY = (
    "#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9",
)  # fmt: skip


OLIVE, GREY = "#999933", "0.6"
"""Further colours for pictures with more lines: Tol's olive, which suits the colours above, and grey."""


WALL = "0.3"


STORED = "stored in the water"


STYLE = {
    "font.size": 11,
    "axes.titlesize": 11,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "0.9",
    "grid.linewidth": 0.8,
    "axes.axisbelow": True,
    "lines.linewidth": 1.4,
    "legend.frameon": False,
    "figure.dpi": 100,
    "savefig.dpi": 150,
}


in_style = matplotlib.rc_context(cast(Any, STYLE))
"""Decorator for functions that draw."""


WIDTH = 11.0
"""Width of most figures, inches; the others have a multiple or a fraction of this width."""


def has_samples(series: dict[str, np.ndarray], name: str) -> bool:
    """Whether a series exists and has at least two samples, the minimum for a line."""
    return name in series and series[name].size > 0 and len(series["time"]) > 1


def axis_name(ax: Axes, kind: str) -> str:
    """Title of a panel in a column: `kind`, and the number of the panel, counted from the top."""
    return f"{kind} {cast(Any, ax.get_subplotspec()).rowspan.start + 1}"


def stacked_axes(count: int, height: float) -> tuple[Figure, np.ndarray]:
    """Figure with a column of `count` panels, each `height` inches high, over one time axis."""
    figure = Figure(figsize=(WIDTH, 0.8 + height * count), layout="constrained")
    cast(Any, figure.get_layout_engine()).set(w_pad=0.1, h_pad=0.08)
    axes = figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0]
    axes[-1].set_xlabel("time (s)")
    for ax in axes:
        ax.margins(x=0.0)
    return figure, axes


def share_limits(axes: Sequence[Axes]) -> None:
    """Gives all panels the same vertical limits, from the lowest to the highest limit of all panels."""
    low, high = zip(*(ax.get_ylim() for ax in axes), strict=True)
    for ax in axes:
        ax.set_ylim(min(low), max(high))
