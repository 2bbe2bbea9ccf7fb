"""Picture of a sea's spectra: incident waves with confidence band, reflected waves, and target spectrum."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from jaxsph import analysis
from jaxsph.case.case import Case
from jaxsph.case.geometry import Geometry
from jaxsph.case.results import two_way_sea
from jaxsph.output.plot.style import BLUE, RED, WIDTH, has_samples, in_style
from jaxsph.output.run_file import RunFile

WITHIN = 0.9
"""Probability (-) that the confidence band of the incident spectrum contains the true spectrum."""


@in_style
def spectrum(run: RunFile) -> Figure | None:
    """Figure of the spectra (m2/Hz) of a run in an irregular sea; None for other waves, or if the record or
    the gauges cannot separate incident from reflected waves."""
    keys, series = run.case_keys(), run.series()
    if keys.get("waves", {}).get("kind") != "irregular" or not has_samples(series, "eta"):
        return None
    case = Case.from_dict(keys)
    try:
        sea = two_way_sea(case, series["time"], series["eta"], Geometry.of(case).depth)
    except ValueError:
        return None
    return draw_sea(sea, case)


@in_style
def draw_sea(sea: analysis.TwoWaySea, case: Case) -> Figure:
    """Figure of the incident and reflected spectra of a sea, and of the target spectrum of the case."""
    figure = Figure(figsize=(WIDTH, 4.5), layout="constrained")
    ax, f = figure.subplots(), sea.incident.f
    low, high = sea.incident.band(WITHIN)
    ax.fill_between(f, low, high, color=BLUE, alpha=0.25, label=f"{100 * WITHIN:g} % band")
    ax.plot(f, sea.incident.S, color=BLUE, label="incident")
    ax.plot(f, sea.reflected.S, color=RED, label="reflected")
    # the target is averaged over the band of each frequency, because a band can be as wide as the peak
    within = (np.arange(4) - 1.5) / case.waves.repeats
    asked = case.waves.shape(case.waves.height).density(np.maximum(f[:, None] + within, 1e-9)).mean(axis=1)
    ax.plot(f, asked, "k--", label="target spectrum")
    top = 1.05 * max(float(np.max(sea.incident.S)), float(np.max(asked)))
    ax.set(xlabel="frequency (Hz)", ylabel="variance density (m2/Hz)", ylim=(0.0, 1.5 * top))
    ax.set(xlim=(0.4 / case.waves.Tp, 2.5 / case.waves.Tp))
    asked_for = f"Hm0 = {sea.incident.Hm0:.3g} m (target {case.waves.height:.3g} m)"
    ax.set_title(f"{asked_for}, reflection {sea.coefficient:.2g}")
    ax.legend()
    return figure
